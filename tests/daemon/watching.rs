//! Whether doorcam is watching: every place that says it says the same, and it changes with time alone.

use std::net::TcpStream;
use std::path::Path;
use std::time::{Duration, Instant};

use serde_json::Value;
use tungstenite::{Message, WebSocket};

use crate::common::{Daemon, JPEG, grey_recording, manifest};

const STATES: [&str; 6] = ["learning", "watching", "relearning", "stale", "obstructed", "misaligned"];

/// Asks every place, in a moment in which nothing changes, and checks that they agree.
fn agreed(daemon: &Daemon) -> Value {
    let deadline = Instant::now() + Duration::from_secs(60);
    loop {
        let before = daemon.json("/api/v1/status");
        let (ready, ready_body) = daemon.get("/readyz");
        let metrics = String::from_utf8(daemon.get("/metrics").1).unwrap();
        let [tracks, zones] = ["tracks", "zones"].map(|path| daemon.json(&format!("/api/v1/{path}")));
        let reconstruction = daemon.get("/api/v1/reconstruction");
        let first_live = (before["last_update"] != Value::Null).then(|| first_text(&mut daemon.live()));
        let after = daemon.json("/api/v1/status");
        let told = &before["watching"];
        if *told != after["watching"] {
            assert!(Instant::now() < deadline, "it never stays the same: {before} {after}");
            continue;
        }
        let (watching, state) = (told["watching"].as_bool().unwrap(), before["state"].as_str().unwrap());
        assert_eq!(watching, told["reason"].is_null(), "{told}");
        assert_eq!(watching, state == "watching", "{before}");
        assert!(told["since"].is_string() && told["until"].is_null(), "{told}");
        // While it learns, its updates are of now and say so. What covers the floor goes by itself.
        let learning = ["learning", "relearning", "obstructed"].contains(&told["reason"].as_str().unwrap_or_default());
        assert_eq!(ready, if watching || learning { 200 } else { 503 });
        let ready_body = String::from_utf8(ready_body).unwrap();
        assert_eq!(ready == 200 && ready_body != "ready\n", learning, "{ready_body}");
        if let Some(reason) = told["reason"].as_str().filter(|_| !learning) {
            let problem: Value = serde_json::from_str(&ready_body).unwrap();
            assert!(problem["detail"].as_str().unwrap().starts_with(&format!("{reason}: ")), "{problem}");
        }
        for name in STATES {
            let line = format!("doorcam_state{{state=\"{name}\"}} {}\n", u8::from(name == state));
            assert!(metrics.contains(&line), "{line} {metrics}");
        }
        assert_eq!(metrics.matches("doorcam_state{").count(), STATES.len(), "{metrics}");
        assert!(metrics.contains(&format!("\ndoorcam_watching {}\n", u8::from(watching))), "{metrics}");
        assert_eq!(metrics.contains("\ndoorcam_people NaN\n"), !watching, "{metrics}");
        assert_eq!((&tracks["state"], &zones["state"]), (&before["state"], &before["state"]));
        if reconstruction.0 == 200 {
            let update: Value = serde_json::from_slice(&reconstruction.1).unwrap();
            assert_eq!(update["state"], state, "an old update does not look like one of now");
        }
        if let Some(first) = first_live {
            let update: Value = serde_json::from_str(&first).unwrap();
            assert_eq!(update["state"], state, "nor on the live socket");
        }
        return before;
    }
}

/// The first message with text; a ping may come before it.
fn first_text(socket: &mut WebSocket<TcpStream>) -> String {
    loop {
        if let Message::Text(text) = socket.read().unwrap() {
            return text.to_string();
        }
    }
}

fn wait_until(daemon: &Daemon, reason: &str) -> Value {
    daemon.wait_for(reason, |status| status["watching"]["reason"].as_str().unwrap_or("") == reason);
    agreed(daemon)
}

fn break_frames(directory: &Path, frames: std::ops::Range<usize>) {
    for index in frames {
        std::fs::write(directory.join(format!("frames/{index:08}_left.jpg")), &JPEG[..100]).unwrap();
    }
}

#[test]
fn a_source_that_ends_is_not_watched_any_more() {
    let recording = grey_recording(&manifest(), 9);
    let daemon = Daemon::start(&format!("replay:{}", recording.path().display()), &[]);
    let status = wait_until(&daemon, "ended");
    assert_eq!((&status["state"], &status["source"]["state"]), (&"stale".into(), &"ended".into()));
    let again = agreed(&daemon);
    assert_eq!(status["watching"], again["watching"], "since the same moment, however often it is asked");
}

#[test]
fn a_source_without_a_background_failed_and_is_not_learning() {
    let recording = grey_recording(&manifest(), 9);
    break_frames(recording.path(), 0..2);
    let daemon = Daemon::start(&format!("replay:{},loop", recording.path().display()), &[]);
    let status = wait_until(&daemon, "failed");
    assert_eq!((&status["state"], &status["last_update"]), (&"stale".into(), &Value::Null));
}

#[test]
fn frames_that_stop_and_come_again_are_told_by_time_alone() {
    let recording = grey_recording(&manifest(), 45);
    break_frames(recording.path(), 5..45);
    let daemon = Daemon::start(&format!("replay:{},loop", recording.path().display()), &[]);
    daemon.wait_for("a map", |status| status["watching"]["watching"] == true);
    let stalled = daemon.wait_for("no map", |status| status["watching"]["watching"] == false);
    assert_eq!(stalled["state"], "stale", "{stalled}");
    agreed(&daemon);
    let again = daemon.wait_for("a map again", |status| {
        status["watching"]["watching"] == true && status["watching"]["since"] != stalled["watching"]["since"]
    });
    let since = |status: &Value| status["watching"]["since"].as_str().unwrap().to_owned();
    assert!(since(&again) > since(&stalled), "{again}");
    agreed(&daemon);
}

#[test]
fn a_loop_that_is_watched_says_so_everywhere() {
    let recording = grey_recording(&manifest(), 9);
    let daemon = Daemon::start(&format!("replay:{},loop", recording.path().display()), &[]);
    daemon.wait_for("a map", |status| status["watching"]["watching"] == true);
    assert_eq!(agreed(&daemon)["state"], "watching");
}
