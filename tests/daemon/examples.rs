//! The client examples of docs/examples, run against the real program.

use std::path::PathBuf;
use std::process::{Command, Stdio};

use crate::common::{Daemon, grey_recording, manifest};

/// Whether a program is installed; prints a message if not.
fn there(program: &str) -> bool {
    let run = Command::new(program).arg("--version").stdout(Stdio::null()).stderr(Stdio::null()).status();
    let there = run.is_ok_and(|status| status.success());
    if !there {
        eprintln!("SKIPPED: no {program} here");
    }
    there
}

fn example(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("docs/examples").join(name)
}

fn daemon() -> (tempfile::TempDir, Daemon) {
    let dir = grey_recording(&manifest(), 6);
    let daemon = Daemon::start(&format!("replay:{},loop", dir.path().display()), &[]);
    daemon.wait_for("a map", |s| s["state"] == "watching");
    (dir, daemon)
}

/// The output of an example, which must succeed.
fn output(command: &mut Command) -> String {
    let output = command.stdin(Stdio::null()).output().expect("it starts");
    let said = String::from_utf8(output.stdout).expect("UTF-8");
    assert!(output.status.success(), "{said}\n{}", String::from_utf8_lossy(&output.stderr));
    said
}

/// Checks that the example printed the state and three updates with increasing numbers.
fn assert_updates(said: &str) {
    assert!(said.starts_with("doorcam "), "{said}");
    let numbers: Vec<u64> =
        said.lines().filter_map(|line| line.strip_prefix("update ")?.split(':').next()?.parse().ok()).collect();
    assert!(numbers.len() == 3 && numbers.is_sorted_by(|a, b| a < b), "{said}");
}

#[test]
fn curl_asks_for_json_and_pictures_and_not_twice_for_the_same() {
    if !there("curl") {
        return;
    }
    let (_recording, daemon) = daemon();
    let out = tempfile::tempdir().unwrap();
    let said = output(Command::new("sh").arg(example("curl.sh")).arg(&daemon.url).arg(out.path()));
    assert!(said.contains("\"uptime_s\"") && said.contains("\"tracks\"") && said.contains("\"events\""), "{said}");
    assert!(said.ends_with("geometry: 304\n"), "{said}");
    let picture = image::open(out.path().join("reconstruction.png")).expect("a picture");
    assert!(picture.width() > 100);
    let geometry = std::fs::read(out.path().join("geometry.json")).unwrap();
    let geometry: serde_json::Value = serde_json::from_slice(&geometry).expect("it is kept");
    assert_eq!(geometry["facets"].as_array().unwrap().len(), 230);
}

#[test]
fn python_follows_the_live_socket_with_its_standard_library() {
    if !there("python3") {
        return;
    }
    let (_recording, daemon) = daemon();
    assert_updates(&output(Command::new("python3").arg(example("people.py")).args([&daemon.url, "3"])));
}

#[test]
fn javascript_follows_the_live_socket() {
    if !there("node") {
        return;
    }
    // Older versions of Node.js have WebSocket only behind a flag, or not at all.
    let has_socket = |flags: &[&str]| {
        let check = Command::new("node")
            .args(flags)
            .args(["-e", "new WebSocket('ws://127.0.0.1:1').onerror = () => 0"])
            .output();
        check.is_ok_and(|output| output.status.success())
    };
    let flags: &[&str] = match (has_socket(&[]), has_socket(&["--experimental-websocket"])) {
        (true, _) => &[],
        (false, true) => &["--experimental-websocket"],
        _ => {
            eprintln!("SKIPPED: this node has no WebSocket");
            return;
        }
    };
    let (_recording, daemon) = daemon();
    assert_updates(&output(Command::new("node").args(flags).arg(example("people.mjs")).args([&daemon.url, "3"])));
}
