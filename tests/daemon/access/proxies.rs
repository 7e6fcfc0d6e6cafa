//! The examples of proxies in docs/security.md, run as they stand there: everything works through them.

use std::io::Read;
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use super::client::{Answer, CONTROL, READ, bearer, connect, exchange};
use crate::common::{Daemon, doorcam};

const DOCS: &str = include_str!("../../../docs/security.md");
/// Whoever uses the proxy calls it by this name.
const NAME: &str = "door.example";

/// The examples in a language.
fn examples(language: &str) -> Vec<&'static str> {
    let begin = format!("```{language}\n");
    let blocks: Vec<_> = DOCS.split(begin.as_str()).skip(1).map(|rest| rest.split("```").next().unwrap()).collect();
    assert!(!blocks.is_empty(), "docs/security.md has examples for {language}");
    blocks
}

/// An example with some of its text replaced.
fn adapted(example: &str, replaced: &[(&str, String)]) -> String {
    replaced.iter().fold(example.to_owned(), |text, (from, to)| {
        assert!(text.contains(from), "{from}: {text}");
        text.replace(from, to)
    })
}

/// The program with this name; says so if it is not installed.
fn program(name: &str) -> Option<PathBuf> {
    // Debian installs daemons outside the usual search path.
    let path = std::env::var_os("PATH").unwrap_or_default();
    let places = std::env::split_paths(&path).chain([PathBuf::from("/usr/sbin")]);
    let found = places.map(|place| place.join(name)).find(|file| file.is_file());
    if found.is_none() {
        eprintln!("SKIPPED: {name} is not installed");
    }
    found
}

/// A doorcam with people in its room, both tokens and the configuration that docs/security.md gives for a proxy.
fn start(directory: &Path) -> Daemon {
    let config = examples("toml").into_iter().find(|block| block.contains("trusted_proxies")).expect("a configuration");
    let file = directory.join("doorcam.toml");
    std::fs::write(&file, config).unwrap();
    let source = "simulate:tests/rooms/busy.toml,rate=max";
    let mut command = doorcam(&["serve", "--source", source, "--listen", "127.0.0.1:0", "--no-history", "--config"]);
    command.arg(file).envs([("DOORCAM_TOKEN", CONTROL), ("DOORCAM_READ_TOKEN", READ)]);
    Daemon::spawn(command)
}

/// A proxy that runs; it is ended when dropped.
struct Proxy {
    child: Child,
    port: u16,
    /// The path below which it has doorcam.
    base: &'static str,
}

impl Drop for Proxy {
    fn drop(&mut self) {
        // Asked to end, nginx ends its workers as well.
        let asked = Command::new("kill").arg(self.child.id().to_string()).status();
        if !asked.is_ok_and(|status| status.success()) {
            let _ = self.child.kill();
        }
        let _ = self.child.wait();
    }
}

/// A port that is free now.
fn free_port() -> u16 {
    TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port()
}

impl Proxy {
    fn start(mut command: Command, port: u16, base: &'static str) -> Self {
        let child =
            command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().expect("it starts");
        let mut proxy = Self { child, port, base };
        let deadline = Instant::now() + Duration::from_secs(60);
        while TcpStream::connect(proxy.address()).is_err() {
            if proxy.child.try_wait().unwrap().is_some() {
                let mut said = String::new();
                proxy.child.stderr.take().unwrap().read_to_string(&mut said).unwrap();
                panic!("the proxy has ended: {said}");
            }
            assert!(Instant::now() < deadline, "the proxy does not listen");
            std::thread::sleep(Duration::from_millis(20));
        }
        let stderr = proxy.child.stderr.take().unwrap();
        std::thread::spawn(move || std::io::copy(&mut { stderr }, &mut std::io::sink()));
        proxy
    }

    fn nginx(nginx: &Path, example: &str, base: &'static str, doorcam: &str, directory: &Path) -> Self {
        let port = free_port();
        let example = adapted(
            example,
            &[("listen 80;", format!("listen 127.0.0.1:{port};")), ("127.0.0.1:8080", doorcam.into())],
        );
        let places: String = ["client_body", "proxy", "fastcgi", "uwsgi", "scgi"]
            .map(|kind| format!("{kind}_temp_path {}/{kind};\n", directory.display()))
            .concat();
        let file = directory.join("nginx.conf");
        // Root's workers would be those of an account that cannot use the directory.
        let text = format!(
            "user root;\ndaemon off;\npid {0}/nginx.pid;\nerror_log stderr;\nevents {{}}\n\
             http {{\naccess_log off;\n{places}{example}}}\n",
            directory.display()
        );
        std::fs::write(&file, text).unwrap();
        let mut command = Command::new(nginx);
        command.args(["-e", "stderr", "-p"]).arg(directory).arg("-c").arg(file);
        Self::start(command, port, base)
    }

    fn caddy(caddy: &Path, example: &str, base: &'static str, doorcam: &str, directory: &Path) -> Self {
        let port = free_port();
        // Without a certificate, which it would ask an authority for.
        let site = format!("http://{NAME}:{port} {{\n    bind 127.0.0.1");
        let example = adapted(example, &[("door.example {", site), ("127.0.0.1:8080", doorcam.into())]);
        let file = directory.join("Caddyfile");
        std::fs::write(&file, format!("{{\n    admin off\n}}\n{example}")).unwrap();
        let mut command = Command::new(caddy);
        command.args(["run", "--adapter", "caddyfile", "--config"]).arg(file).env("HOME", directory);
        command.env_remove("XDG_DATA_HOME").env_remove("XDG_CONFIG_HOME");
        Self::start(command, port, base)
    }

    fn address(&self) -> SocketAddr {
        SocketAddr::from(([127, 0, 0, 1], self.port))
    }

    /// The page's origin, as its browser sends it.
    fn origin(&self) -> String {
        format!("http://{NAME}:{}", self.port)
    }

    fn send(&self, method: &str, path: &str, headers: &[(&str, &str)], body: &str) -> Answer {
        let mut request = format!("{method} {}{path} HTTP/1.1\r\nHost: {NAME}:{}\r\n", self.base, self.port);
        request.push_str(&format!("Connection: close\r\nContent-Length: {}\r\n", body.len()));
        headers.iter().for_each(|(name, value)| request.push_str(&format!("{name}: {value}\r\n")));
        exchange(self.address(), &format!("{request}\r\n{body}"))
    }

    fn get(&self, path: &str, headers: &[(&str, &str)]) -> Answer {
        self.send("GET", path, headers, "")
    }

    /// Everything that the page and programs do.
    fn check(&self) {
        let (origin, read) = (self.origin(), bearer(READ));
        let read = ("Authorization", read.as_str());
        let page = self.get("/", &[]);
        assert!(page.status == 200 && page.body.contains("<script type=\"module\" src=\"app.js\">"), "{page:?}");
        assert_eq!((self.get("/app.js", &[]).status, self.get("/map/map.js", &[]).status), (200, 200));
        assert_eq!((self.get("/api/v1/status", &[]).status, self.get("/api/v1/status", &[read]).status), (401, 200));
        assert_eq!(self.get("/metrics", &[read]).status, 200);

        // The page logs in, is told nothing that would keep it from working, and changes something.
        let login = json!({ "token": CONTROL }).to_string();
        let foreign = self.send("POST", "/api/v1/session", &[("Origin", "http://evil.example")], &login);
        assert_eq!(foreign.status, 403);
        let begun = self.send("POST", "/api/v1/session", &[("Origin", &origin)], &login);
        assert_eq!(begun.status, 200, "{begun:?}");
        let cookie = begun.header("set-cookie").expect("a cookie").split(';').next().unwrap();
        let cookie = ("Cookie", cookie);
        let session = self.get(&format!("/api/v1/session?origin={origin}"), &[cookie]);
        let session: Value = serde_json::from_str(&session.body).unwrap();
        assert_eq!((&session["scope"], &session["refusal"]), (&json!("control"), &Value::Null));
        let reset = self.send("POST", "/api/v1/background/reset", &[cookie, ("Origin", &origin)], "");
        assert_eq!(reset.status, 202, "{reset:?}");

        self.check_socket(cookie, &origin);
        self.check_stream(read);
        self.check_link(read);
        if !self.base.is_empty() {
            let moved = exchange(
                self.address(),
                &format!("GET {} HTTP/1.1\r\nHost: {NAME}:{}\r\nConnection: close\r\n\r\n", self.base, self.port),
            );
            assert!((300..400).contains(&moved.status), "{moved:?}");
            assert!(moved.header("location").unwrap().ends_with(&format!("{}/", self.base)), "{moved:?}");
        }
    }

    fn check_socket(&self, (_, cookie): (&str, &str), origin: &str) {
        let open = |origin: &str| {
            let url = format!("ws://{NAME}:{}{}/api/v1/live", self.port, self.base);
            let request = tungstenite::ClientRequestBuilder::new(url.parse().unwrap())
                .with_header("Origin", origin)
                .with_header("Cookie", cookie);
            tungstenite::client(request, connect(self.address())).ok().map(|(socket, _)| socket)
        };
        let mut socket = open(origin).expect("the socket of the page");
        let update = loop {
            if let tungstenite::Message::Text(text) = socket.read().expect("a message") {
                break serde_json::from_str::<Value>(&text).expect("an update");
            }
        };
        assert!(update["sequence"].is_u64());
        // The page of another port is another one.
        assert!(open("http://door.example").is_none() && open("http://evil.example").is_none());
    }

    /// Pictures come as they are taken, not when the proxy has gathered many.
    fn check_stream(&self, (name, value): (&str, &str)) {
        use std::io::Write;

        let mut stream = connect(self.address());
        let (base, port) = (self.base, self.port);
        let head =
            format!("GET {base}/api/v1/stream.mjpg?fps=2 HTTP/1.1\r\nHost: {NAME}:{port}\r\n{name}: {value}\r\n\r\n");
        stream.write_all(head.as_bytes()).unwrap();
        let mut seen = Vec::new();
        while String::from_utf8_lossy(&seen).matches("X-Captured: ").count() < 3 {
            let mut more = [0; 65_536];
            let got = stream.read(&mut more).expect("the stream goes on");
            assert!(got > 0, "{}", String::from_utf8_lossy(&seen));
            seen.extend_from_slice(&more[..got]);
        }
        assert!(seen.starts_with(b"HTTP/1.1 200"));
    }

    /// The address of the next page leads there.
    fn check_link(&self, read: (&str, &str)) {
        let first = self.get("/api/v1/events?from=2000-01-01T00%3A00%3A00Z&limit=1", &[read]);
        let link = first.header("link").expect("another page");
        let next = link.strip_prefix('<').and_then(|link| link.split('>').next()).unwrap();
        let second = self.get(&format!("/api/v1/{next}"), &[read]);
        let number = |answer: &Answer| {
            let page: Value = serde_json::from_str(&answer.body).unwrap();
            page["events"][0]["sequence"].as_u64().unwrap()
        };
        assert_eq!((second.status, number(&second)), (200, number(&first) + 1));
    }
}

/// Where an example has doorcam.
fn base(example: &str) -> &'static str {
    if example.contains("/door") { "/door" } else { "" }
}

fn run(name: &str, language: &str, proxy: fn(&Path, &str, &'static str, &str, &Path) -> Proxy) {
    let examples = examples(language);
    assert_eq!(examples.iter().map(|example| base(example)).collect::<Vec<_>>(), ["", "/door"]);
    let Some(program) = program(name) else { return };
    let directory = tempfile::tempdir().unwrap();
    let daemon = start(directory.path());
    let doorcam = daemon.url.trim_start_matches("http://");
    let enough = |proxy: &Proxy| {
        let page = proxy.get("/api/v1/events?limit=3", &[("Authorization", &bearer(READ))]);
        let page: Value = serde_json::from_str(&page.body).unwrap_or_default();
        page["events"].as_array().is_some_and(|events| events.len() == 3)
    };
    for example in examples {
        let place = tempfile::tempdir().unwrap();
        let proxy = proxy(&program, example, base(example), doorcam, place.path());
        let deadline = Instant::now() + Duration::from_secs(120);
        while !enough(&proxy) {
            assert!(Instant::now() < deadline, "there are no events: {}", daemon.log());
            std::thread::sleep(Duration::from_millis(50));
        }
        proxy.check();
    }
    let log = daemon.log();
    // What other sites wanted is told, and nothing else went wrong.
    assert!(log.contains("pages at http://evil.example may not do this"), "{log}");
}

#[test]
fn the_examples_for_nginx_work() {
    run("nginx", "nginx", Proxy::nginx);
}

#[test]
fn the_examples_for_caddy_work() {
    run("caddy", "caddyfile", Proxy::caddy);
}
