//! How connections to a broker end: by doorcam, by its death, or by the broker.

use std::io::{Read, Write};
use std::net::TcpListener;
use std::path::Path;
use std::process::Command;
use std::sync::mpsc::channel;
use std::time::{Duration, Instant};

use serde_json::Value;

use super::{LONG, SOURCE, Subscriber, broker, config, free_port, installed};
use crate::common::Daemon;

/// What the broker's log says about a client's last connection, once that has come to `end`.
fn log_of(client: &str, file: &Path, end: &str) -> Vec<String> {
    let deadline = Instant::now() + LONG;
    loop {
        let log = std::fs::read(file).unwrap_or_default();
        let log = String::from_utf8_lossy(&log);
        let lines: Vec<String> = log.lines().filter(|line| line.contains(client)).map(String::from).collect();
        let begun = lines.iter().rposition(|line| line.contains("New client connected")).unwrap_or_default();
        if lines[begun..].iter().any(|line| line.contains(end)) {
            return lines[begun..].to_vec();
        }
        assert!(Instant::now() < deadline, "waited in vain for {end:?} in the broker's log:\n{log}");
        std::thread::sleep(Duration::from_millis(20));
    }
}

#[test]
fn a_farewell_is_doorcams_own_message_and_a_last_will_the_brokers() {
    if !installed() {
        return;
    }
    let (directory, port) = (tempfile::tempdir().unwrap(), free_port());
    let log = directory.path().join("broker.log");
    let logging = format!("allow_anonymous true\nlog_dest file {}\nlog_type all\n", log.display());
    let _broker = broker(directory.path(), port, &logging);
    let config = config(directory.path(), port, "");
    // "offline" from doorcam itself: a message of seven bytes that the broker receives.
    let farewell = |line: &String| {
        line.contains("Received PUBLISH from") && line.contains("'doorcam/hall/availability', ... (7 bytes)")
    };
    let start = || {
        let daemon = Daemon::start(SOURCE, &["--config", &config]);
        let is_connected = |status: &Value| status["publish"]["mqtt"]["state"] == "connected";
        let status = daemon.wait_for("the connection", is_connected);
        let subscriber = Subscriber::new(port, &[]);
        subscriber.wait_for("availability", |topic, payload| topic.ends_with("/availability") && payload == "online");
        (daemon, subscriber, status["publish"]["mqtt"]["client_id"].as_str().unwrap().to_owned())
    };
    let wait_offline = |subscriber: &Subscriber| {
        subscriber.wait_for("the end", |topic, payload| (topic, payload) == ("doorcam/hall/availability", "offline"));
    };

    let (mut daemon, subscriber, client) = start();
    assert_eq!(daemon.terminate().1, Some(0));
    wait_offline(&subscriber);
    let lines = log_of(&client, &log, "Received DISCONNECT from");
    let said = lines.iter().position(farewell).unwrap_or_else(|| panic!("no farewell: {lines:#?}"));
    let left = lines.iter().position(|line| line.contains("Received DISCONNECT from")).unwrap();
    // The broker drops the will of a client that takes its leave.
    assert!(said < left, "{lines:#?}");

    // A killed doorcam says nothing: its will is published all the same.
    let (daemon, subscriber, client) = start();
    assert!(Command::new("kill").args(["-KILL", &daemon.id().to_string()]).status().unwrap().success());
    wait_offline(&subscriber);
    let lines = log_of(&client, &log, "closed its connection");
    assert!(!lines.iter().any(|line| farewell(line) || line.contains("Received DISCONNECT from")), "{lines:#?}");
}

#[test]
fn a_copied_storage_directory_is_told_by_its_pattern() {
    if !installed() {
        return;
    }
    let (directory, port) = (tempfile::tempdir().unwrap(), free_port());
    let _broker = broker(directory.path(), port, "allow_anonymous true\n");
    let config = config(directory.path(), port, "");
    let start = |storage: &str| {
        let storage = directory.path().join(storage);
        std::fs::create_dir(&storage).unwrap();
        std::fs::write(storage.join("client-id"), "0123456789abcdef\n").unwrap();
        Daemon::start(SOURCE, &["--config", &config, "--storage", storage.to_str().unwrap()])
    };
    let daemons = [start("one"), start("copy")];
    let warning = |status: &Value| status["publish"]["mqtt"]["warning"].as_str().unwrap_or_default().to_owned();
    for daemon in &daemons {
        let status = daemon.wait_for("the warning", |status| warning(status).contains("another client may have"));
        assert!(warning(&status).contains("\"doorcam-hall-0123456789abcdef\""), "{status}");
    }
}

#[test]
fn a_broker_that_takes_connections_and_ends_them_is_left_in_peace() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = listener.local_addr().unwrap().port();
    let (tell, connected) = channel();
    std::thread::spawn(move || {
        for stream in listener.incoming() {
            let mut stream = stream.unwrap();
            // Whatever it says to begin with, it is welcome: CONNACK.
            if stream.read(&mut [0; 1024]).is_ok_and(|read| read > 0) && stream.write_all(&[0x20, 2, 0, 0]).is_ok() {
                let _ = tell.send(Instant::now());
            }
        }
    });
    let directory = tempfile::tempdir().unwrap();
    let daemon = Daemon::start(SOURCE, &["--config", &config(directory.path(), port, "")]);
    let times: Vec<Instant> = (0..6).map(|_| connected.recv_timeout(LONG).expect("a connection")).collect();
    // Half of 0.5, 1, 2, 4 and 8 s at least; a busy machine only makes it longer.
    for (k, pair) in times.windows(2).enumerate() {
        let least = Duration::from_millis(250 << k);
        assert!(pair[1] - pair[0] >= least, "{k}: {:?}", pair[1] - pair[0]);
    }
    let status = daemon.wait_for("the warning", |status| status["publish"]["mqtt"]["warning"].is_string());
    assert!(status["publish"]["mqtt"]["warning"].as_str().unwrap().contains("ends each connection"), "{status}");
    let lines = |words: &str| daemon.log().matches(words).count();
    assert_eq!((lines("connected, publishing"), lines("ends each connection")), (1, 1), "{}", daemon.log());
    assert!(lines("trying again") <= 2, "{}", daemon.log());
}
