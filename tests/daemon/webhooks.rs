//! Events posted to webhooks: signed, tried again, given up.

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::Duration;

use crate::common::{Daemon, run, stderr};
use serde_json::Value;

const SECRET: &str = "a secret that nobody guesses";
const LONG: Duration = Duration::from_secs(60);

/// A received POST.
struct Posted {
    path: String,
    headers: BTreeMap<String, String>,
    body: String,
}

/// Starts a receiver that answers its first requests with `answers`, and further ones with 204.
fn receiver(answers: &'static [&'static str]) -> (u16, Receiver<Posted>) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = listener.local_addr().unwrap().port();
    let (tell, posted) = channel();
    std::thread::spawn(move || {
        for (k, stream) in listener.incoming().enumerate() {
            let mut stream = stream.unwrap();
            let mut reader = BufReader::new(stream.try_clone().unwrap());
            let mut line = String::new();
            reader.read_line(&mut line).unwrap();
            let path = line.split(' ').nth(1).unwrap_or_default().to_owned();
            assert!(line.starts_with("POST "), "{line}");
            let mut headers = BTreeMap::new();
            loop {
                line.clear();
                reader.read_line(&mut line).unwrap();
                let Some((name, value)) = line.trim_end().split_once(": ") else { break };
                headers.insert(name.to_ascii_lowercase(), value.to_owned());
            }
            let mut body = vec![0; headers["content-length"].parse().unwrap()];
            reader.read_exact(&mut body).unwrap();
            let answer = answers.get(k).unwrap_or(&"204 No Content");
            write!(stream, "HTTP/1.1 {answer}\r\ncontent-length: 0\r\nconnection: close\r\n\r\n").unwrap();
            if tell.send(Posted { path, headers, body: String::from_utf8(body).unwrap() }).is_err() {
                return;
            }
        }
    });
    (port, posted)
}

/// A file with the secret and a mode.
fn secret_file(directory: &Path, mode: u32) -> PathBuf {
    let file = directory.join("secret");
    std::fs::write(&file, format!("{SECRET}\n")).unwrap();
    std::fs::set_permissions(&file, std::fs::Permissions::from_mode(mode)).unwrap();
    file
}

/// A receiver that reads each request and then does as it likes with the connection.
fn odd_receiver(answer: impl Fn(TcpStream) + Send + Sync + Copy + 'static) -> (u16, Receiver<()>) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = listener.local_addr().unwrap().port();
    let (tell, asked) = channel();
    std::thread::spawn(move || {
        for stream in listener.incoming() {
            let mut stream = stream.unwrap();
            let _ = stream.read(&mut [0; 65_536]);
            if tell.send(()).is_err() {
                return;
            }
            std::thread::spawn(move || answer(stream));
        }
    });
    (port, asked)
}

/// HMAC-SHA256 as computed by another program.
fn openssl(text: &str) -> String {
    let mut child = Command::new("openssl")
        .args(["dgst", "-sha256", "-hmac", SECRET])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("openssl (Debian: openssl)");
    child.stdin.take().unwrap().write_all(text.as_bytes()).unwrap();
    let output = String::from_utf8(child.wait_with_output().unwrap().stdout).unwrap();
    output.split_whitespace().last().unwrap().to_owned()
}

#[test]
fn events_are_posted_signed_and_tried_again_until_they_are_accepted() {
    let directory = tempfile::tempdir().unwrap();
    let (port, posted) = receiver(&["503 Service Unavailable", "500 Internal Server Error"]);
    let (gone, given_up) = receiver(&["410 Gone"; 100]);
    let secret = secret_file(directory.path(), 0o600);
    let file = directory.path().join("doorcam.toml");
    let hook = |port: u16, events: &str| {
        format!(
            "[[webhooks]]\nurl = \"http://127.0.0.1:{port}/hook/t0ken?key=k3y\"\nevents = {events}\n\
             secret_file = {secret:?}\n"
        )
    };
    let hooks = format!("[site]\nid = \"hall\"\n{}{}", hook(port, "[\"enter\"]"), hook(gone, "[]"));
    std::fs::write(&file, hooks).unwrap();
    let daemon = Daemon::start("simulate:tests/rooms/busy.toml,rate=max", &["--config", file.to_str().unwrap()]);

    let attempts: Vec<Posted> = (0..4).map(|_| posted.recv_timeout(LONG).expect("a request")).collect();
    let events: Vec<Value> = attempts.iter().map(|posted| serde_json::from_str(&posted.body).unwrap()).collect();
    for Posted { path, headers, body } in &attempts {
        assert_eq!((path.as_str(), headers["content-type"].as_str()), ("/hook/t0ken?key=k3y", "application/json"));
        let signature = format!("sha256={}", openssl(&format!("{}.{body}", headers["x-doorcam-timestamp"])));
        assert_eq!(headers["x-doorcam-signature"], signature);
    }
    // The first event fails twice and is then accepted; only then comes the next one.
    let delivery = |k: usize| attempts[k].headers["x-doorcam-delivery"].as_str();
    assert_eq!((delivery(0), &events[0]), (delivery(2), &events[2]));
    assert_eq!(delivery(0), delivery(1));
    assert_ne!(delivery(2), delivery(3));
    assert!(events.iter().all(|event| event["event"]["kind"] == "enter" && event["site"] == "hall"), "{events:?}");
    let sequence = events[0]["event"]["sequence"].as_u64().unwrap();
    assert_eq!(delivery(0), format!("hall-{sequence}"));
    let known = daemon.json("/api/v1/events?from=2000-01-01T00:00:00Z&kind=enter&limit=1");
    assert_eq!(known["events"][0]["sequence"], sequence);

    // An event that a receiver rejects for good is not sent again.
    let first: Value = serde_json::from_str(&given_up.recv_timeout(LONG).expect("a request").body).unwrap();
    let second: Value = serde_json::from_str(&given_up.recv_timeout(LONG).expect("a request").body).unwrap();
    assert!(second["event"]["sequence"].as_u64() > first["event"]["sequence"].as_u64());
    let status = daemon.wait_for("the counts", |status| {
        let hooks = &status["publish"]["webhooks"];
        hooks[0]["delivered"].as_u64() >= Some(2) && hooks[1]["dead"].as_u64() >= Some(2)
    });
    let hooks = &status["publish"]["webhooks"];
    assert_eq!((&hooks[0]["retried"], &hooks[0]["dead"], &hooks[1]["delivered"]), (&2.into(), &0.into(), &0.into()));
    assert_eq!(hooks[1]["error"], "it answered 410 Gone");
    assert_eq!(hooks[0]["url"], format!("http://127.0.0.1:{port}/..."));
    let said = status.to_string();
    assert!(!said.contains(SECRET) && !said.contains("t0ken") && !said.contains("k3y"), "{said}");
    let (_, metrics) = daemon.get("/metrics");
    let metrics = String::from_utf8(metrics).unwrap();
    assert!(metrics.contains("doorcam_webhook_retried_total{webhook=\"1\"} 2"), "{metrics}");
    assert!(metrics.contains("doorcam_webhook_dead_total{webhook=\"2\"}"), "{metrics}");
}

#[test]
fn receivers_that_redirect_flood_or_hang_are_told_and_hold_nobody_up() {
    let directory = tempfile::tempdir().unwrap();
    let secret = secret_file(directory.path(), 0o640);
    let (elsewhere, followed) = odd_receiver(|_| {});
    let target = format!("HTTP/1.1 307 Temporary Redirect\r\nlocation: http://127.0.0.1:{elsewhere}/\r\n");
    let target: &'static str = Box::leak(target.into_boxed_str());
    let (redirects, _asked) = odd_receiver(move |mut stream| {
        let _ = write!(stream, "{target}content-length: 0\r\nconnection: close\r\n\r\n");
    });
    // An answer without end, of which only the head matters.
    let (floods, _asked) = odd_receiver(|mut stream| {
        let _ = write!(stream, "HTTP/1.1 200 OK\r\n\r\n");
        while stream.write_all(&[b'x'; 65_536]).is_ok() {}
    });
    let (garbles, _asked) = odd_receiver(|mut stream| {
        let _ = stream.write_all(b"HTTP/1.1 \x1b[31m\n\nhello\r\n\r\n");
    });
    // One that never answers, and one that never stops beginning to.
    let (hangs, _asked) = odd_receiver(|stream| {
        let _ = stream.peek(&mut [0; 1]);
        std::thread::sleep(LONG);
    });
    let (drips, _asked) = odd_receiver(|mut stream| {
        let _ = write!(stream, "HTTP/1.1 200 OK\r\n");
        while write!(stream, "x: y\r\n").is_ok() {
            std::thread::sleep(Duration::from_millis(100));
        }
    });
    let hooks = [redirects, floods, garbles, hangs, drips]
        .map(|port| format!("[[webhooks]]\nurl = \"http://127.0.0.1:{port}/t0ken\"\nsecret_file = {secret:?}\n"));
    let file = directory.path().join("doorcam.toml");
    std::fs::write(&file, hooks.concat()).unwrap();
    let mut daemon = Daemon::start("simulate:tests/rooms/busy.toml,rate=max", &["--config", file.to_str().unwrap()]);
    let status = daemon.wait_for("all of them", |status| {
        let hooks = status["publish"]["webhooks"].as_array().unwrap();
        let failed = |hook: usize| hooks[hook]["error"].is_string();
        hooks[1]["delivered"].as_u64() > Some(1) && [0, 2, 3, 4].into_iter().all(failed)
    });
    let error = |hook: usize| status["publish"]["webhooks"][hook]["error"].as_str().unwrap();
    assert!(error(0).contains("307") && error(0).contains("not followed"), "{status}");
    assert!(status["publish"]["webhooks"][0]["dead"].as_u64() > Some(0), "{status}");
    assert!(followed.try_recv().is_err(), "the secret's holder is the one that was configured");
    for hook in [2, 3, 4] {
        assert!(!error(hook).contains(['\n', '\u{1b}']) && error(hook).len() < 200, "{status}");
    }
    for hook in [3, 4] {
        assert!(error(hook).contains("timeout"), "{status}");
    }
    let log = daemon.log();
    assert_eq!(log.matches("webhook http").count(), 4, "one line each: {log}");
    assert!(!log.contains("t0ken"), "{log}");
    assert_eq!(daemon.terminate().1, Some(0));
}

#[test]
fn a_secret_that_others_can_read_is_refused() {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("doorcam.toml");
    let secret = directory.path().join("secret");
    let hook = format!("[[webhooks]]\nurl = \"http://127.0.0.1:9/\"\nsecret_file = {secret:?}\n");
    std::fs::write(&file, hook).unwrap();
    let refusal = || {
        let source = "simulate:tests/rooms/busy.toml";
        let output = run(&["serve", "--source", source, "--config", file.to_str().unwrap(), "--listen", "127.0.0.1:0"]);
        let said = stderr(&output);
        assert_eq!((output.status.code(), said.lines().count()), (Some(1), 1), "{said}");
        said
    };
    for mode in [0o666, 0o644, 0o604, 0o660] {
        secret_file(directory.path(), mode);
        let expected = format!("webhooks.secret_file: {}: its mode {mode:o} lets others at", secret.display());
        assert!(refusal().contains(&expected), "{}", refusal());
    }
    secret_file(directory.path(), 0o600);
    std::fs::write(&secret, "").unwrap();
    assert!(refusal().contains("it is empty, expected a secret"), "{}", refusal());
    std::fs::write(&secret, [0xff, 0xfe]).unwrap();
    assert!(refusal().contains("it is not UTF-8"), "{}", refusal());
    std::fs::File::create(&secret).unwrap().set_len(1 << 40).unwrap();
    assert!(refusal().contains("is larger than 64 kB"), "{}", refusal());
    std::fs::remove_file(&secret).unwrap();
    assert!(Command::new("mkfifo").arg(&secret).status().unwrap().success());
    assert!(refusal().contains("is a FIFO, expected a file with a token or a key"), "{}", refusal());
}
