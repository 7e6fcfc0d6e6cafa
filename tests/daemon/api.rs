//! The parts of the API that other systems build on: errors, tags and streams of the real program.

use std::collections::BTreeSet;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::time::Duration;

use crate::common::{Daemon, camera_recording, grey_recording, manifest};
use serde_json::Value;
use ureq::http::{Request, Response};

/// The answer to a request with some headers.
fn ask(daemon: &Daemon, method: &str, path: &str, headers: &[(&str, &str)], body: Vec<u8>) -> Response<Vec<u8>> {
    let agent: ureq::Agent = ureq::Agent::config_builder()
        .http_status_as_error(false)
        .allow_non_standard_methods(true)
        .timeout_global(Some(Duration::from_secs(30)))
        .build()
        .into();
    let mut request = Request::builder().method(method).uri(format!("{}{path}", daemon.url));
    for (name, value) in headers {
        request = request.header(*name, *value);
    }
    let mut response = agent.run(request.body(body).unwrap()).expect("an answer");
    let mut body = Vec::new();
    response.body_mut().as_reader().read_to_end(&mut body).unwrap();
    response.map(|_| body)
}

fn header<'a>(response: &'a Response<Vec<u8>>, name: &str) -> &'a str {
    response.headers().get(name).map_or("", |value| value.to_str().unwrap())
}

/// Checks that an answer is a problem with its status, a title and a detail.
fn assert_problem(response: &Response<Vec<u8>>, status: u16, what: &str) {
    assert_eq!(
        (response.status().as_u16(), header(response, "content-type")),
        (status, "application/problem+json"),
        "{what}"
    );
    let problem: Value = serde_json::from_slice(response.body()).expect("JSON");
    assert_eq!(problem["status"], status, "{what}");
    assert!(
        problem["title"].is_string() && problem["detail"].as_str().is_some_and(|d| !d.is_empty()),
        "{what}: {problem}"
    );
}

fn looped(recording: &Path) -> Daemon {
    let daemon = Daemon::start(&format!("replay:{},loop", recording.display()), &[]);
    daemon.wait_for("a map", |s| s["state"] == "watching");
    daemon
}

#[test]
fn every_error_is_a_problem() {
    let dir = grey_recording(&manifest(), 4);
    let daemon = looped(dir.path());
    let document = daemon.json("/api/v1/openapi.json");
    // Every method that a route lacks is refused, and `allow` lists those that it has.
    for (path, operations) in document["paths"].as_object().unwrap() {
        let described: BTreeSet<String> = operations.as_object().unwrap().keys().map(|m| m.to_uppercase()).collect();
        let path = path.replace("{id}", "1");
        for method in ["GET", "PUT", "POST", "DELETE", "PATCH", "OPTIONS"] {
            if described.contains(method) {
                continue;
            }
            let response = ask(&daemon, method, &path, &[], Vec::new());
            assert_problem(&response, 405, &format!("{method} {path}"));
            let mut allowed: BTreeSet<String> =
                header(&response, "allow").split(',').map(|m| m.trim().to_owned()).collect();
            // A route with GET also allows HEAD.
            assert_eq!(allowed.remove("HEAD"), described.contains("GET"), "{path}");
            assert_eq!(allowed, described, "{path}");
        }
    }
    let response = ask(&daemon, "DELETE", "/", &[], Vec::new());
    assert_problem(&response, 405, "DELETE /");
    assert_eq!(header(&response, "allow"), "GET,HEAD");
    for path in ["/api/v1/nothing", "/api/v1", "/api/v2/status", "/nothing", "/api/v1/tracks/me", "/api/v1/tracks/-1"] {
        assert_problem(&ask(&daemon, "GET", path, &[], Vec::new()), 404, path);
    }
    for path in ["/api/v1/tracks/99999999999999999999999", "/api/v1/tracks/%ff", "/%00"] {
        assert_problem(&ask(&daemon, "GET", path, &[], Vec::new()), 404, path);
    }
    for query in ["events?limit=0", "events?limit=1001", "events?after=-1", "events?before=3", "stream.mjpg?fps=0"] {
        assert_problem(&ask(&daemon, "GET", &format!("/api/v1/{query}"), &[], Vec::new()), 400, query);
    }
    let response = ask(&daemon, "GET", "/api/v1/live", &[], Vec::new());
    assert_problem(&response, 426, "no WebSocket");
    assert_eq!(header(&response, "upgrade"), "websocket");
    for (method, path) in [("PUT", "/api/v1/calibration"), ("POST", "/api/v1/calibration/check")] {
        for body in ["", "{", "[]", "{\"size\": [1, -1]}", "\u{0}"] {
            assert_problem(&ask(&daemon, method, path, &[], body.into()), 400, body);
        }
        assert_problem(&ask(&daemon, method, path, &[], vec![b' '; 2 * 1024 * 1024 + 1]), 413, path);
    }
}

#[test]
fn what_changes_rarely_is_not_sent_twice() {
    let dir = camera_recording(4);
    let daemon = Daemon::start(&format!("replay:{}", dir.path().display()), &[]);
    // From here on nothing changes.
    daemon.wait_for("the end", |s| s["source"]["state"] == "ended");
    let tagged = ["geometry", "room", "calibration", "config", "zones", "openapi.json", "live.schema.json"];
    let pictures = ["frame.jpg", "difference.png", "reconstruction.png"];
    for path in tagged.iter().chain(&pictures).map(|name| format!("/api/v1/{name}")) {
        let first = ask(&daemon, "GET", &path, &[], Vec::new());
        assert_eq!((first.status().as_u16(), header(&first, "cache-control")), (200, "no-cache"), "{path}");
        let tag = header(&first, "etag");
        assert!(tag.len() > 4 && tag.starts_with("W/\""), "{path}: {tag}");
        let list = format!("\"other\", {tag}");
        let second = ask(&daemon, "GET", &path, &[("if-none-match", &list)], Vec::new());
        assert_eq!((second.status().as_u16(), header(&second, "etag"), second.body().len()), (304, tag, 0), "{path}");
        let other = ask(&daemon, "GET", &path, &[("if-none-match", "\"other\"")], Vec::new());
        assert_eq!((other.status().as_u16(), other.body()), (200, first.body()), "{path}");
    }
    for path in ["status", "reconstruction", "tracks", "events"].map(|name| format!("/api/v1/{name}")) {
        assert_eq!(header(&ask(&daemon, "GET", &path, &[], Vec::new()), "cache-control"), "no-store", "{path}");
    }
}

#[test]
fn a_picture_of_another_update_has_another_tag() {
    let dir = camera_recording(4);
    let daemon = looped(dir.path());
    for path in ["/api/v1/frame.jpg", "/api/v1/difference.png"] {
        let first = ask(&daemon, "GET", path, &[], Vec::new());
        let before = daemon.json("/api/v1/status")["last_update"]["sequence"].as_u64().unwrap();
        daemon.wait_for("another update", |s| s["last_update"]["sequence"].as_u64().unwrap() > before + 1);
        let second = ask(&daemon, "GET", path, &[("if-none-match", header(&first, "etag"))], Vec::new());
        assert_eq!(second.status(), 200);
        assert_ne!(header(&first, "etag"), header(&second, "etag"), "{path}");
    }
}

#[test]
fn the_configuration_in_use_is_told() {
    let dir = grey_recording(&manifest(), 4);
    let file = dir.path().join("doorcam.toml");
    std::fs::write(&file, "[room]\ndepth_m = 2.5\n").unwrap();
    let daemon = Daemon::start(&format!("replay:{}", dir.path().display()), &["--config", file.to_str().unwrap()]);
    let config = daemon.json("/api/v1/config");
    assert_eq!(config["room"]["depth_m"], 2.5);
    assert_eq!(config["solver"]["lambda"], "auto", "defaults are included");
}

/// A client's end of a stream of pictures.
struct Stream(BufReader<TcpStream>);

impl Stream {
    fn open(daemon: &Daemon, query: &str) -> Self {
        let address = daemon.url.trim_start_matches("http://");
        let mut socket = TcpStream::connect(address).unwrap();
        socket.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
        // HTTP/1.0, so that the body is not chunked.
        write!(socket, "GET /api/v1/stream.mjpg{query} HTTP/1.0\r\nHost: {address}\r\n\r\n").unwrap();
        let mut stream = Self(BufReader::new(socket));
        assert!(stream.line().contains(" 200 "));
        let headers = stream.headers();
        assert!(headers.contains("content-type: multipart/x-mixed-replace; boundary=frame\n"), "{headers}");
        assert!(headers.contains("cache-control: no-store\n"), "{headers}");
        assert_eq!(stream.line(), "--frame");
        stream
    }

    fn line(&mut self) -> String {
        let mut line = String::new();
        self.0.read_line(&mut line).unwrap();
        line.trim_end().to_owned()
    }

    fn headers(&mut self) -> String {
        let mut headers = String::new();
        loop {
            match self.line() {
                line if line.is_empty() => return headers,
                line => headers.extend([line.to_lowercase(), "\n".into()]),
            }
        }
    }

    /// The picture of a part and its capture time. The boundary after it must come without a further part, because
    /// browsers wait for it.
    fn part(&mut self) -> (image::DynamicImage, jiff::Timestamp) {
        let headers = self.headers();
        let value = |name: &str| headers.lines().find_map(|line| line.strip_prefix(name)).expect("a header").to_owned();
        assert_eq!(value("content-type: "), "image/jpeg");
        let mut picture = vec![0; value("content-length: ").parse().unwrap()];
        self.0.read_exact(&mut picture).unwrap();
        assert_eq!((self.line(), self.line()), (String::new(), "--frame".into()));
        (
            image::load_from_memory(&picture).expect("a JPEG"),
            value("x-captured: ").to_uppercase().parse().expect("RFC 3339"),
        )
    }
}

#[test]
fn the_camera_is_streamed_until_the_end() {
    let dir = camera_recording(6);
    let mut daemon = looped(dir.path());
    let mut streams = [Stream::open(&daemon, ""), Stream::open(&daemon, "?fps=100")];
    for stream in &mut streams {
        let parts: Vec<_> = (0..5).map(|_| stream.part()).collect();
        for ((first, captured), (second, later)) in parts.iter().zip(&parts[1..]) {
            assert!(later > captured && (first.width(), first.height()) == (640, 240));
            assert_ne!(first.as_bytes()[0], second.as_bytes()[0], "each frame has a different grey");
        }
    }
    let (took, code) = daemon.terminate();
    assert!(code == Some(0) && took < Duration::from_secs(60), "{took:?}");
    for mut stream in streams {
        // Parts on the way are delivered, and then the stream ends.
        let mut rest = Vec::new();
        stream.0.read_to_end(&mut rest).expect("an orderly end");
    }
}

#[test]
fn there_is_no_stream_of_patches() {
    let dir = grey_recording(&manifest(), 4);
    let daemon = looped(dir.path());
    assert_problem(&ask(&daemon, "GET", "/api/v1/stream.mjpg", &[], Vec::new()), 404, "patches");
}

/// Number of open sockets of a process.
fn sockets(pid: u32) -> usize {
    let open = std::fs::read_dir(format!("/proc/{pid}/fd")).expect("its files").flatten();
    open.filter(|f| std::fs::read_link(f.path()).is_ok_and(|target| target.to_string_lossy().starts_with("socket:")))
        .count()
}

#[test]
fn a_client_that_leaves_its_stream_is_forgotten() {
    let dir = camera_recording(6);
    let daemon = looped(dir.path());
    let mut streams: Vec<_> = (0..8).map(|_| Stream::open(&daemon, "")).collect();
    for stream in &mut streams {
        stream.part();
    }
    let open = sockets(daemon.id());
    drop(streams);
    // All eight are closed, but the status request itself uses one.
    daemon.wait_for("their sockets to be closed", |_| sockets(daemon.id()) + 7 <= open);
}
