//! What a token has let in ends with it: sessions, live sockets and streams.

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::path::Path;

use serde_json::json;
use tungstenite::protocol::frame::coding::CloseCode;
use tungstenite::{Message, WebSocket};

use super::client::{CONTROL, READ, bearer, connect, live, write_with_mode};
use crate::common::{Daemon, camera_recording, doorcam};

const ANOTHER: &str = "another-0123456789abcdef";

/// A doorcam with both tokens in files.
fn start(directory: &Path) -> (Daemon, SocketAddr) {
    let files = ["token", "read-token"].map(|name| directory.join(name).display().to_string());
    write_with_mode(Path::new(&files[0]), CONTROL, 0o600);
    write_with_mode(Path::new(&files[1]), READ, 0o600);
    let source = format!("replay:{},loop", directory.display());
    let [control, read] = &files;
    let more = ["--listen", "127.0.0.1:0", "--token-file", control, "--read-token-file", read];
    let daemon = Daemon::spawn(doorcam(&[&["serve", "--source", &source], &more[..]].concat()));
    let address = daemon.url.trim_start_matches("http://").parse().unwrap();
    (daemon, address)
}

/// The cookie of a session that begins with a token.
fn log_in(address: SocketAddr, token: &str) -> String {
    let body = json!({ "token": token }).to_string();
    let request = format!(
        "POST /api/v1/session HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\nContent-Length: {}\r\n\r\n{body}",
        body.len()
    );
    let answer = super::client::exchange(address, &request);
    answer.header("set-cookie").expect("a session").split(';').next().unwrap().to_owned()
}

/// A stream of pictures whose first bytes have come.
fn stream(address: SocketAddr, name: &str, value: &str) -> TcpStream {
    let mut stream = connect(address);
    let head = format!("GET /api/v1/stream.mjpg HTTP/1.1\r\nHost: localhost\r\n{name}: {value}\r\n\r\n");
    loop {
        stream.write_all(head.as_bytes()).unwrap();
        let mut start = [0; 12];
        stream.read_exact(&mut start).unwrap();
        if start.ends_with(b"200") {
            return stream;
        }
        // There is no frame yet.
        assert!(start.ends_with(b"404"), "{}", String::from_utf8_lossy(&start));
        stream = connect(address);
    }
}

/// Reads a socket to its farewell.
fn farewell(mut socket: WebSocket<TcpStream>) -> CloseCode {
    loop {
        if let Message::Close(farewell) = socket.read().expect("a message or a farewell") {
            return farewell.expect("a reason").code;
        }
    }
}

#[test]
fn a_replaced_token_ends_all_that_it_has_let_in_and_nothing_else() {
    let directory = camera_recording(6);
    let (daemon, address) = start(directory.path());
    let [control, read] = [CONTROL, READ].map(|token| {
        let cookie = log_in(address, token);
        let ways = [("authorization", bearer(token)), ("cookie", cookie)];
        ways.map(|(name, value)| (live(address, &[(name, &value)]), stream(address, name, &value), name, value))
    });
    write_with_mode(&directory.path().join("token"), ANOTHER, 0o600);
    daemon.signal("HUP");
    daemon.wait_for_log("other tokens are in use");

    for (socket, mut stream, name, value) in control {
        assert_eq!(farewell(socket), CloseCode::Policy, "{name}");
        // It ends in good order, with the last chunk.
        let mut rest = Vec::new();
        stream.read_to_end(&mut rest).expect("an orderly end");
        assert!(rest.ends_with(b"0\r\n\r\n"), "{name}");
        let again =
            format!("GET /api/v1/status HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n{name}: {value}\r\n\r\n");
        assert_eq!(super::client::exchange(address, &again).status, 401, "{name}");
    }
    for (mut socket, mut stream, name, value) in read {
        for _ in 0..20 {
            assert!(!matches!(socket.read().expect("it goes on"), Message::Close(_)), "{name}");
        }
        stream.read_exact(&mut [0; 100_000]).expect("it goes on");
        let again =
            format!("GET /api/v1/status HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n{name}: {value}\r\n\r\n");
        assert_eq!(super::client::exchange(address, &again).status, 200, "{name}");
    }
}

#[test]
fn who_logs_out_sees_nothing_more() {
    let directory = camera_recording(6);
    let (_daemon, address) = start(directory.path());
    let [ended, other] = [(); 2].map(|()| log_in(address, READ));
    let [(socket, mut stream), (mut other, _)] =
        [&ended, &other].map(|cookie| (live(address, &[("cookie", cookie)]), stream(address, "cookie", cookie)));
    let request =
        format!("DELETE /api/v1/session HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\nCookie: {ended}\r\n\r\n");
    assert_eq!(super::client::exchange(address, &request).status, 204);
    assert_eq!(farewell(socket), CloseCode::Policy);
    stream.read_to_end(&mut Vec::new()).expect("an orderly end");
    for _ in 0..20 {
        assert!(!matches!(other.read().expect("it goes on"), Message::Close(_)));
    }
}
