//! What the program asks of its process: open files, permissions, and lines that are its own.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use crate::common::{Daemon, doorcam, grey_recording, manifest, stderr};
use serde_json::json;

/// `doorcam serve` of a replayed recording in a shell that first runs a command.
fn after(first: &str, source: &str, more: &[&str]) -> Command {
    let mut command = Command::new("sh");
    command.args(["-c", &format!("{first} && exec \"$0\" \"$@\""), env!("CARGO_BIN_EXE_doorcam")]);
    command.args(["serve", "--source", source, "--listen", "127.0.0.1:0"]).args(more);
    command.stdin(Stdio::null()).env_remove("DOORCAM_TOKEN").env_remove("DOORCAM_READ_TOKEN");
    command
}

#[test]
fn with_too_few_open_files_it_says_so_in_one_line_or_runs() {
    let recording = grey_recording(&manifest(), 6);
    let source = format!("replay:{},loop", recording.path().display());
    let storage = tempfile::tempdir().unwrap();
    let (mut refused, mut ran) = (0, 0);
    for limit in (3..64).step_by(3).chain([50, 51, 52, 53, 64]) {
        let mut command =
            after(&format!("ulimit -n {limit}"), &source, &["--storage", storage.path().to_str().unwrap()]);
        let mut child = command.stderr(Stdio::piped()).spawn().unwrap();
        let (mut said, mut runs) = (Vec::new(), false);
        for line in BufReader::new(child.stderr.take().unwrap()).lines().map_while(Result::ok) {
            if line.contains("the page is at") {
                runs = true;
                break;
            }
            said.push(line);
        }
        assert!(!said.iter().any(|line| line.contains("panicked")), "{limit}: {said:?}");
        if runs {
            ran += 1;
            child.kill().unwrap();
        }
        // The shell and the dynamic loader need some as well, and have words of their own.
        if child.wait().unwrap().code() == Some(1) {
            refused += 1;
            assert!(said.len() == 1 && said[0].contains(&format!("the limit of {limit} open files")), "{said:?}");
        }
    }
    assert!(refused > 10 && ran >= 1, "{refused} refused, {ran} ran");
}

#[test]
fn a_low_limit_is_raised_and_connections_are_fewer_where_it_cannot_be() {
    let recording = grey_recording(&manifest(), 6);
    let source = format!("replay:{},loop", recording.path().display());
    let open_files = |daemon: &Daemon| {
        let limits = std::fs::read_to_string(format!("/proc/{}/limits", daemon.id())).unwrap();
        let line = limits.lines().find(|line| line.starts_with("Max open files")).unwrap().to_owned();
        line.split_whitespace().nth(3).unwrap().parse::<u64>().unwrap()
    };
    let daemon = Daemon::spawn(after("ulimit -Sn 40", &source, &[]));
    assert!(open_files(&daemon) > 40);
    let daemon = Daemon::spawn(after("ulimit -n 80", &source, &[]));
    assert_eq!(open_files(&daemon), 80);
    assert!(
        daemon.log().contains("server.max_connections is 512, the limit of open files leaves 32"),
        "{}",
        daemon.log()
    );
    // Whoever takes all connections takes no files from anybody else, and gives them back.
    let connect = || TcpStream::connect(daemon.url.trim_start_matches("http://"));
    let held: Vec<_> = (0..60).filter_map(|_| connect().ok()).collect();
    daemon.wait_for_log("watching");
    drop(held);
    let answered = || {
        let mut answer = String::new();
        let mut stream = connect().ok()?;
        stream.write_all(b"GET /livez HTTP/1.0\r\nHost: localhost\r\n\r\n").ok()?;
        stream.read_to_string(&mut answer).ok()?;
        answer.contains("alive").then_some(())
    };
    let deadline = Instant::now() + Duration::from_secs(60);
    while answered().is_none() {
        assert!(Instant::now() < deadline, "{}", daemon.log());
    }
    assert!(!daemon.log().contains("cannot accept"), "{}", daemon.log());
}

fn below(directory: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(directory).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            below(&path, found);
        }
        found.push(path);
    }
}

#[test]
fn what_it_keeps_and_records_is_for_its_owner_only() {
    let directory = tempfile::tempdir().unwrap();
    let recording = grey_recording(&manifest(), 6);
    let source = format!("replay:{},loop", recording.path().display());
    let (storage, config) = (directory.path().join("storage"), directory.path().join("doorcam.toml"));
    std::fs::write(&config, format!("[history]\nfile = {:?}\n", storage.join("past/history.sqlite"))).unwrap();
    let more = ["--storage", storage.to_str().unwrap(), "--config", config.to_str().unwrap()];
    let mut daemon = Daemon::spawn(after("umask 022", &source, &more));
    let zones = json!({"zones": [{"name": "bed", "polygon_m": [[0.0, 0.5], [1.0, 0.5], [1.0, 1.0]]}]});
    assert_eq!(daemon.send("PUT", "/api/v1/zones", &zones).0, 200);
    assert_eq!(daemon.send("POST", "/api/v1/recording", &json!({"name": "evening"})).0, 201);
    daemon.wait_for("frames", |status| status["recording"]["frames"].as_u64() > Some(1));
    let check = || {
        let mut found = vec![storage.clone()];
        below(&storage, &mut found);
        for path in &found {
            let mode = path.metadata().unwrap().permissions().mode();
            assert_eq!(mode & 0o077, 0, "{}: {mode:o}", path.display());
        }
        found
    };
    check();
    assert_eq!(daemon.terminate().1, Some(0));
    let found = check();
    for name in ["history.sqlite", "history.sqlite-lock", "zones.json", "recording.json", "timestamps.csv", "frames"] {
        assert!(found.iter().any(|path| path.ends_with(name)), "{name}: {found:?}");
    }
    let out = directory.path().join("copy");
    let mut command = doorcam(&["record", "--source", &format!("replay:{}", recording.path().display())]);
    let output = command.arg(&out).output().unwrap();
    assert!(output.status.success(), "{}", stderr(&output));
    assert_eq!(out.metadata().unwrap().permissions().mode() & 0o077, 0);
}

/// A name that would add a line of its own, clear a terminal, and hide what follows.
const FORGED: &str = "x\n2026-01-01T00:00:00Z ERROR forged\r\u{1b}[2J\u{9b}3m\u{2028}\u{202e}y";

fn assert_plain(text: &str) {
    let odd = |c: char| c != '\n' && (c.is_control() || ('\u{2028}'..='\u{202e}').contains(&c));
    assert!(!text.contains(odd), "{text:?}");
    assert!(!text.lines().any(|line| line.starts_with("2026-01-01") || line.starts_with('y')), "{text:?}");
}

#[test]
fn names_from_outside_forge_no_line_of_the_log_and_no_error() {
    let directory = tempfile::tempdir().unwrap();
    let place = directory.path().join(FORGED);
    let recording = grey_recording(&manifest(), 6);
    std::fs::rename(recording.path(), &place).unwrap();
    let source = format!("replay:{},loop", place.display());
    std::fs::write(place.join("frames/00000003_left.jpg"), "no image").unwrap();
    let storage = directory.path().join(format!("{FORGED}2"));
    for format in ["text", "json"] {
        let mut daemon = Daemon::start(&source, &["--log", format, "--storage", storage.to_str().unwrap()]);
        // It is followed by the end of a JSON object.
        daemon.url = daemon.url.trim_end_matches("\"}").to_owned();
        daemon.wait_for("a skipped frame", |status| status["frames"]["skipped"].as_u64() > Some(0));
        assert_eq!(daemon.send("POST", "/api/v1/recording", &json!({})).0, 201);
        daemon.wait_for_log("recording 60 s into");
        let name = json!({"name": FORGED});
        assert_eq!(daemon.send("POST", "/api/v1/recording", &name).0 / 100, 4);
        let zones = json!({"zones": [{"name": FORGED, "polygon_m": [[0.0, 0.5], [1.0, 0.5], [1.0, 1.0]]}]});
        assert_eq!(daemon.send("PUT", "/api/v1/zones", &zones).0, 422);
        assert_eq!(daemon.terminate().1, Some(0));
        let log = daemon.log();
        assert_plain(&log);
        assert!(log.contains("ERROR forged"), "it is told, within a line: {log}");
        if format == "json" {
            for line in log.lines() {
                serde_json::from_str::<serde_json::Value>(line).unwrap_or_else(|e| panic!("{e}: {line}"));
            }
        }
    }
    for arguments in [["reconstruct", FORGED], ["evaluate", FORGED], ["check-config", FORGED]] {
        let output = doorcam(&arguments).output().unwrap();
        let said = stderr(&output);
        assert_eq!((output.status.code(), said.lines().count()), (Some(1), 1), "{said:?}");
        assert_plain(&said);
    }
}
