//! Events in the life of a program that runs for months: it is stopped and continued, and its clock is set.

use std::path::{Path, PathBuf};
use std::time::Duration;

use crate::common::{Daemon, doorcam};
use jiff::{SignedDuration, Timestamp};
use serde_json::Value;

/// Somebody walks about in real time.
const SOURCE: &str = "simulate:tests/rooms/patient.toml";

fn solved(daemon: &Daemon) -> u64 {
    daemon.json("/api/v1/status")["frames"]["solved"].as_u64().expect("a number")
}

fn time(value: &Value) -> Timestamp {
    value.as_str().expect("a time").parse().expect("RFC 3339")
}

fn spans(daemon: &Daemon) -> Vec<(Timestamp, Timestamp)> {
    let page = daemon.json("/api/v1/occupancy?from=2000-01-01T00:00:00Z&to=2100-01-01T00:00:00Z");
    page["spans"].as_array().expect("spans").iter().map(|span| (time(&span["from"]), time(&span["to"]))).collect()
}

fn assert_well(daemon: &Daemon, what: &str) {
    let before = solved(daemon);
    daemon.wait_for(what, |s| {
        let fresh = s["state"] == "watching" && s["last_update"]["age_s"].as_f64() < Some(1.0);
        fresh && s["frames"]["solved"].as_u64() > Some(before + 5) && daemon.get("/readyz").0 == 200
    });
    assert!(!daemon.log().contains("panick"), "{}", daemon.log());
}

#[test]
fn who_was_stopped_goes_on_with_the_newest_and_does_not_pretend_to_have_watched() {
    let daemon = Daemon::start(SOURCE, &[]);
    daemon.wait_for("a map", |s| s["state"] == "watching");
    let mut socket = daemon.live();
    let begin = Timestamp::now();
    daemon.signal("STOP");
    std::thread::sleep(Duration::from_secs(7));
    daemon.signal("CONT");
    let end = Timestamp::now();
    assert_well(&daemon, "updates after the stop");
    // Its clients are still connected, and they get current updates, not those queued before the stop.
    let newest = loop {
        match socket.read().expect("the socket is still open") {
            tungstenite::Message::Text(text) => {
                let update: Value = serde_json::from_str(&text).expect("JSON");
                if time(&update["time"]) >= end {
                    break update;
                }
            }
            _ => continue,
        }
    };
    assert!(time(&newest["time"]) >= end);
    let (after, before) = (begin + SignedDuration::from_secs(1), end - SignedDuration::from_secs(1));
    let pretended: Vec<_> = spans(&daemon).into_iter().filter(|(from, to)| *from < before && *to > after).collect();
    assert_eq!(pretended, [], "stopped from {begin} to {end}");
}

/// A library that changes the clock that a program sees; prints a message if it is not installed.
pub(crate) fn clock() -> Option<PathBuf> {
    let places = ["x86_64", "aarch64", "arm"].map(|machine| {
        PathBuf::from(format!(
            "/usr/lib/{machine}-linux-gnu{}/faketime/libfaketimeMT.so.1",
            if machine == "arm" { "eabihf" } else { "" }
        ))
    });
    let found = places.into_iter().find(|place| place.exists());
    if found.is_none() {
        eprintln!("SKIPPED: no libfaketime here (Debian: libfaketime)");
    }
    found
}

pub(crate) fn set(file: &Path, seconds: i64) {
    // Atomically, because the program reads the file again and again.
    let next = file.with_extension("next");
    std::fs::write(&next, format!("{seconds:+}\n")).expect("writes");
    std::fs::rename(next, file).expect("renames");
}

#[test]
fn a_clock_that_is_set_forth_or_back_stops_nothing() {
    let Some(library) = clock() else { return };
    let directory = tempfile::tempdir().unwrap();
    let offset = directory.path().join("offset");
    set(&offset, 0);
    let config = directory.path().join("doorcam.toml");
    std::fs::write(&config, format!("[history]\nfile = {:?}\n", directory.path().join("history.sqlite"))).unwrap();
    let config = config.to_str().unwrap();
    let mut command = doorcam(&["serve", "--source", SOURCE, "--listen", "127.0.0.1:0", "--config", config]);
    command
        .env("LD_PRELOAD", library)
        .env("FAKETIME_TIMESTAMP_FILE", &offset)
        .env("FAKETIME_NO_CACHE", "1")
        .env("DONT_FAKE_MONOTONIC", "1");
    let mut daemon = Daemon::spawn(command);
    let somebody = |update: &Value| update["tracks"][0]["state"] == "confirmed";
    let track = daemon.wait_for_update("somebody", somebody)["tracks"][0]["id"].clone();
    let mut kept = spans(&daemon);
    for hours in [5, -5, 0] {
        set(&offset, 3600 * hours);
        let there = |daemon: &Daemon| {
            let ahead = time(&daemon.json("/api/v1/status")["time"]).duration_since(Timestamp::now()).as_secs();
            (ahead - 3600 * hours).abs() < 60
        };
        daemon.wait_for("its clock to be another", |_| there(&daemon));
        assert_well(&daemon, "updates with another clock");
        // Tracks continue, because tracking uses the frames' own time.
        let now = daemon.wait_for_update("somebody", somebody)["tracks"][0]["id"].clone();
        assert_eq!(now, track, "{hours} hours");
        // Earlier spans are kept, and no span is longer than real time.
        let now = spans(&daemon);
        assert!(now.len() > kept.len() && kept.iter().all(|(from, _)| now.iter().any(|(f, _)| f == from)), "{now:?}");
        assert!(now.iter().all(|(from, to)| to.duration_since(*from) < SignedDuration::from_mins(10)), "{now:?}");
        kept = now;
    }
    let status = daemon.json("/api/v1/status")["history"].clone();
    assert_eq!((&status["state"], &status["lost"]), (&"stored".into(), &0.into()));
    assert_eq!(daemon.terminate().1, Some(0));
}
