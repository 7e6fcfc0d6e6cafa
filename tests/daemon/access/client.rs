//! A doorcam with rules of access, and a client that can also send what no browser or library would.

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::os::unix::fs::PermissionsExt;
use std::time::Duration;

use tungstenite::client::IntoClientRequest;

use crate::common::{Daemon, doorcam, grey_recording, manifest};

pub const CONTROL: &str = "control-0123456789abcdef";
pub const READ: &str = "read-0123456789abcdef0123";

/// A running doorcam with a recording of an empty room.
pub struct Guarded {
    pub daemon: Daemon,
    _recording: tempfile::TempDir,
}

impl Guarded {
    /// Listens on a free port of loopback.
    pub fn start(more: &[&str]) -> Self {
        Self::start_with("127.0.0.1:0", "", &[], more)
    }

    /// Has both tokens.
    pub fn with_tokens(more: &[&str]) -> Self {
        Self::start_with("127.0.0.1:0", "", &[("DOORCAM_TOKEN", CONTROL), ("DOORCAM_READ_TOKEN", READ)], more)
    }

    /// Has a configuration.
    pub fn configured(config: &str, environment: &[(&str, &str)]) -> Self {
        Self::start_with("127.0.0.1:0", config, environment, &[])
    }

    pub fn start_with(listen: &str, config: &str, environment: &[(&str, &str)], more: &[&str]) -> Self {
        let directory = grey_recording(&manifest(), 9);
        let file = directory.path().join("doorcam.toml");
        std::fs::write(&file, config).unwrap();
        let source = format!("replay:{},loop", directory.path().display());
        let mut command = doorcam(&["serve", "--source", &source, "--listen", listen, "--config"]);
        command
            .arg(file)
            .arg("--storage")
            .arg(directory.path().join("state"))
            .args(more)
            .envs(environment.iter().copied());
        Self { daemon: Daemon::spawn(command), _recording: directory }
    }

    /// The address at which a client on this machine reaches it.
    pub fn address(&self) -> SocketAddr {
        let port = self.daemon.url.rsplit(':').next().unwrap().parse().unwrap();
        SocketAddr::from(([127, 0, 0, 1], port))
    }

    /// Sends a request with only these headers, `Host` and `Connection: close`.
    pub fn ask(&self, method: &str, path: &str, headers: &[(&str, &str)]) -> Answer {
        self.send(method, path, headers, "")
    }

    /// Like `ask`, with a body.
    pub fn send(&self, method: &str, path: &str, headers: &[(&str, &str)], body: &str) -> Answer {
        let address = self.address();
        let mut request = format!("{method} {path} HTTP/1.1\r\nConnection: close\r\n");
        if !headers.iter().any(|(name, _)| *name == "Host") {
            request.push_str(&format!("Host: {address}\r\n"));
        }
        if !body.is_empty() {
            request.push_str(&format!("Content-Type: application/json\r\nContent-Length: {}\r\n", body.len()));
        }
        for (name, value) in headers {
            request.push_str(&format!("{name}: {value}\r\n"));
        }
        exchange(address, &format!("{request}\r\n{body}"))
    }

    /// Opens the live socket with these headers.
    pub fn live(&self, headers: &[(&'static str, &str)]) -> tungstenite::WebSocket<TcpStream> {
        live(self.address(), headers)
    }

    /// Asks for the upgrade to a WebSocket and returns the status, 101 if it is granted.
    pub fn upgrade(&self, headers: &[(&str, &str)]) -> u16 {
        let address = self.address();
        let mut request = String::from(
            "GET /api/v1/live HTTP/1.1\r\nConnection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n\
             Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n",
        );
        if !headers.iter().any(|(name, _)| *name == "Host") {
            request.push_str(&format!("Host: {address}\r\n"));
        }
        for (name, value) in headers {
            request.push_str(&format!("{name}: {value}\r\n"));
        }
        let mut stream = connect(address);
        stream.write_all(format!("{request}\r\n").as_bytes()).unwrap();
        let mut start = [0; 12];
        stream.read_exact(&mut start).unwrap();
        String::from_utf8_lossy(&start[9..]).parse().unwrap()
    }
}

/// Writes a file with exactly these permissions.
pub fn write_with_mode(file: &std::path::Path, text: &str, mode: u32) {
    std::fs::write(file, text).unwrap();
    std::fs::set_permissions(file, std::fs::Permissions::from_mode(mode)).unwrap();
}

/// The value of `Authorization` for a token.
pub fn bearer(token: &str) -> String {
    format!("Bearer {token}")
}

/// An answer, read to the end of the connection.
#[derive(Debug)]
pub struct Answer {
    pub status: u16,
    pub headers: Vec<(String, String)>,
    pub body: String,
}

impl Answer {
    /// The first header with this name, which must be in lower case.
    pub fn header(&self, name: &str) -> Option<&str> {
        self.headers.iter().find(|(n, _)| n == name).map(|(_, value)| value.as_str())
    }

    /// The body as a problem, which every refusal must be.
    pub fn problem(&self) -> serde_json::Value {
        assert_eq!(self.header("content-type"), Some("application/problem+json"), "{self:?}");
        let problem: serde_json::Value = serde_json::from_str(&self.body).expect("JSON");
        assert_eq!(problem["status"], self.status);
        problem
    }
}

/// Opens the live socket of a doorcam that listens there, with these headers.
pub fn live(address: SocketAddr, headers: &[(&'static str, &str)]) -> tungstenite::WebSocket<TcpStream> {
    let mut request = format!("ws://{address}/api/v1/live").into_client_request().expect("a request");
    for (name, value) in headers {
        request.headers_mut().insert(*name, value.parse().expect("a header"));
    }
    tungstenite::client(request, connect(address)).expect("upgrades").0
}

pub fn connect(address: SocketAddr) -> TcpStream {
    let stream = TcpStream::connect(address).expect("connects");
    stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
    stream
}

/// Sends a request, which must ask for the connection to be closed, and reads the answer.
pub fn exchange(address: SocketAddr, request: &str) -> Answer {
    let mut stream = connect(address);
    // After an early refusal the connection may already be closed, but the answer is still there.
    let _ = stream.write_all(request.as_bytes());
    answer(&mut stream).expect("an answer")
}

/// Reads an answer to the end of the connection; `None` if there is none.
pub fn answer(stream: &mut impl Read) -> Option<Answer> {
    let mut bytes = Vec::new();
    // A reset after the answer does not matter.
    let _ = stream.read_to_end(&mut bytes);
    let end = bytes.windows(4).position(|four| four == b"\r\n\r\n")?;
    let (head, body) = (String::from_utf8_lossy(&bytes[..end]), &bytes[end + 4..]);
    let mut lines = head.lines();
    let status = lines.next()?.split(' ').nth(1)?.parse().ok()?;
    let headers: Vec<_> = lines
        .filter_map(|line| line.split_once(':'))
        .map(|(name, value)| (name.to_ascii_lowercase(), value.trim().to_owned()))
        .collect();
    let chunked = headers.iter().any(|(name, value)| name == "transfer-encoding" && value == "chunked");
    let body = if chunked { joined(body) } else { body.to_owned() };
    Some(Answer { status, headers, body: String::from_utf8_lossy(&body).into_owned() })
}

/// The content of chunks.
fn joined(mut chunks: &[u8]) -> Vec<u8> {
    let mut body = Vec::new();
    while let Some(end) = chunks.windows(2).position(|two| two == b"\r\n") {
        let length = usize::from_str_radix(str::from_utf8(&chunks[..end]).expect("a length"), 16).expect("a length");
        let Some(chunk) = chunks.get(end + 2..end + 2 + length) else { break };
        body.extend_from_slice(chunk);
        chunks = chunks.get(end + 4 + length..).unwrap_or_default();
    }
    body
}
