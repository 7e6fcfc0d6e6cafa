//! The real program replays a recording; REST and WebSocket clients read it.

use crate::common;
use std::time::Duration;

use crate::common::{Daemon, grey_recording, manifest};
use serde_json::Value;

/// A recording with `frames` frames, the last third of which has a brighter right half in its left patch.
fn recording(frames: usize) -> tempfile::TempDir {
    let dir = grey_recording(&manifest(), frames);
    for index in 2 * frames / 3..frames {
        std::fs::remove_file(dir.path().join(format!("frames/{index:08}_left.jpg"))).unwrap();
        // The grey of the JPEG is 120.
        let image = image::RgbImage::from_fn(16, 16, |x, _| image::Rgb(if x < 8 { [120; 3] } else { [150, 120, 120] }));
        image.save(dir.path().join(format!("frames/{index:08}_left.png"))).unwrap();
    }
    dir
}

fn next(socket: &mut tungstenite::WebSocket<std::net::TcpStream>) -> Result<Value, Option<u16>> {
    loop {
        match socket.read().expect("a message") {
            tungstenite::Message::Text(text) => return Ok(serde_json::from_str(&text).expect("JSON")),
            tungstenite::Message::Close(frame) => return Err(frame.map(|f| f.code.into())),
            _ => {}
        }
    }
}

#[test]
fn updates_come_live_and_are_the_same_everywhere() {
    let dir = recording(9);
    let daemon = Daemon::start(&format!("replay:{},loop", dir.path().display()), &[]);
    let mut socket = daemon.live();
    let mut last = None;
    let mut frames = Vec::new();
    let mut lit = None;
    for _ in 0..25 {
        let update = next(&mut socket).expect("an update");
        let sequence = update["sequence"].as_u64().unwrap();
        assert!(last.is_none_or(|l| sequence > l), "{sequence} after {last:?}");
        last = Some(sequence);
        frames.push(update["frame"].as_u64().unwrap());
        for key in ["version", "time", "state", "solution", "model", "illumination", "facets", "tracks", "timing_ms"] {
            assert!(!update[key].is_null(), "{key}: {update}");
        }
        assert_eq!(update["gain"].is_null(), update["state"] == "learning", "{update}");
        let changed = update["frame"].as_u64().unwrap() >= 6;
        let facets = update["facets"].as_array().unwrap();
        assert_eq!(changed, !facets.is_empty(), "{update}");
        if changed {
            lit = Some(update);
        }
    }
    assert!(frames.windows(2).any(|w| w[1] < w[0]), "the recording begins again: {frames:?}");
    // The change is red and seen only from the left edge: the right half of the left patch sees more of the room.
    let lit = lit.expect("a frame with the change");
    for facet in lit["facets"].as_array().unwrap() {
        let rgb = |side: &str| serde_json::from_value::<[f64; 3]>(facet[side].clone()).unwrap();
        assert!(
            rgb("left")[0].abs() >= rgb("left")[1].abs() && rgb("left")[0].abs() >= rgb("left")[2].abs(),
            "{facet}"
        );
        assert_eq!(rgb("unified"), [0.0; 3], "{facet}");
    }
    // REST gives the same object as the socket.
    for _ in 0..50 {
        let live = next(&mut socket).expect("an update");
        let rest = daemon.json("/api/v1/reconstruction");
        if rest["sequence"] == live["sequence"] {
            assert_eq!(rest, live);
            return;
        }
    }
    panic!("REST and the live socket never had the same update");
}

#[test]
fn status_geometry_and_pictures_are_served() {
    let dir = recording(9);
    let daemon = Daemon::start(&format!("replay:{},loop", dir.path().display()), &[]);
    daemon.wait_for("a map", |s| s["state"] == "watching");
    let status = daemon.json("/api/v1/status");
    assert_eq!(status["source"]["notes"], "made by a test");
    assert_eq!(status["source"]["state"], "streaming");
    assert_eq!(status["model"], "signed");
    let geometry = daemon.json("/api/v1/geometry");
    assert_eq!(geometry["facets"].as_array().unwrap().len(), 230);
    assert_eq!(geometry["foreground"].as_array().unwrap().len(), 230);
    assert_eq!(geometry["doorway"]["width_m"], 0.508);
    assert_eq!(geometry["patch"]["fov_m"], 0.15, "no larger than what the recording shows");
    for picture in ["reconstruction.png", "difference.png"] {
        let (code, png) = daemon.get(&format!("/api/v1/{picture}"));
        assert_eq!(code, 200);
        let image = image::load_from_memory(&png).expect("a PNG");
        assert!(image.width() > 100 && image.height() > 100, "{picture}");
    }
    let none = serde_json::json!([]);
    assert_eq!((&daemon.json("/api/v1/tracks")["tracks"], &daemon.json("/api/v1/zones")["zones"]), (&none, &none));
    assert_eq!(daemon.json("/api/v1/events?after=3&limit=5")["events"], none);
    for (path, expected) in [("tracks/1", 404), ("tracks/me", 404), ("events?limit=0", 400), ("events?after=x", 400)] {
        let (code, problem) = daemon.get(&format!("/api/v1/{path}"));
        let problem: Value = serde_json::from_slice(&problem).unwrap();
        assert_eq!((code, problem["status"].as_u64()), (expected, Some(u64::from(expected))), "{path}");
    }
    assert_eq!(daemon.get("/livez").0, 200);
    assert_eq!(daemon.get("/readyz").0, 200);
    let (code, page) = daemon.get("/");
    assert!(code == 200 && String::from_utf8(page).unwrap().contains("<title>"));
    let (code, problem) = daemon.get("/api/v1/nothing");
    assert_eq!((code, serde_json::from_slice::<Value>(&problem).unwrap()["status"].as_u64()), (404, Some(404)));
}

#[test]
fn broken_frames_are_skipped_and_counted_and_the_end_is_told() {
    let dir = recording(9);
    std::fs::write(dir.path().join("frames/00000004_left.jpg"), &common::JPEG[..100]).unwrap();
    std::fs::remove_file(dir.path().join("frames/00000005_right.jpg")).unwrap();
    let daemon = Daemon::start(&format!("replay:{},rate=max", dir.path().display()), &[]);
    let status = daemon.wait_for("the end", |s| s["source"]["state"] == "ended");
    assert_eq!(status["frames"]["skipped"], 2);
    assert_eq!(status["frames"]["solved"], 7, "at rate=max every other frame is solved");
    assert_eq!(status["frames"]["dropped"], 0);
    assert!(status["frames"]["last_skipped"].as_str().unwrap().starts_with("frames/0000000"), "{status}");
    // The last map stays, but is not shown as live.
    assert_eq!(daemon.json("/api/v1/reconstruction")["frame"], 8);
    daemon.wait_for("stale", |s| s["state"] == "stale");
    assert_eq!(daemon.get("/readyz").0, 503);
}

#[test]
fn a_recording_whose_background_is_broken_fails_and_says_so() {
    let dir = recording(9);
    for index in 0..2 {
        std::fs::write(dir.path().join(format!("frames/{index:08}_left.jpg")), b"").unwrap();
    }
    let daemon = Daemon::start(&format!("replay:{},loop", dir.path().display()), &[]);
    let status = daemon.wait_for("the failure", |s| s["source"]["state"] == "failed");
    assert!(
        status["source"]["error"].as_str().unwrap().contains("no frame of the empty room could be read"),
        "{status}"
    );
    assert_eq!(daemon.get("/api/v1/reconstruction").0, 404);
}

#[test]
fn a_background_in_the_middle_of_a_recording_is_waited_for() {
    let mut manifest = manifest();
    manifest.background_frames = Some([3, 5]);
    let dir = grey_recording(&manifest, 8);
    let daemon = Daemon::start(&format!("replay:{},rate=max", dir.path().display()), &[]);
    let status = daemon.wait_for("the end", |s| s["source"]["state"] == "ended");
    assert_eq!(status["frames"]["solved"], 8);
    assert_eq!(daemon.json("/api/v1/reconstruction")["frame"], 7);
}

#[test]
fn it_ends_when_asked_and_tells_its_clients() {
    let dir = recording(9);
    let mut daemon = Daemon::start(&format!("replay:{},loop", dir.path().display()), &[]);
    let listeners: Vec<_> = (0..8)
        .map(|_| {
            let mut socket = daemon.live();
            next(&mut socket).expect("an update");
            std::thread::spawn(move || {
                loop {
                    if let Err(code) = next(&mut socket) {
                        return code;
                    }
                }
            })
        })
        .collect();
    let (took, code) = daemon.terminate();
    assert_eq!(code, Some(0));
    assert!(took < Duration::from_secs(60), "{took:?}");
    for listener in listeners {
        assert_eq!(listener.join().unwrap(), Some(1001));
    }
}

#[test]
fn a_client_that_does_not_listen_does_not_hold_up_the_end() {
    let dir = recording(9);
    let mut daemon = Daemon::start(&format!("replay:{},loop", dir.path().display()), &[]);
    let mut mute = daemon.live();
    next(&mut mute).expect("an update");
    let (took, code) = daemon.terminate();
    assert_eq!(code, Some(0));
    assert!(took < Duration::from_secs(60), "{took:?}");
}

#[test]
fn figures_are_there_for_prometheus() {
    let dir = recording(9);
    let daemon = Daemon::start(&format!("replay:{}", dir.path().display()), &[]);
    daemon.wait_for("the end", |s| s["source"]["state"] == "ended");
    let (status, body) = daemon.get("/metrics");
    let text = String::from_utf8(body).expect("UTF-8");
    assert_eq!(status, 200);
    let value = |name: &str| -> f64 {
        let line = text.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(' '));
        line.unwrap_or_else(|| panic!("{name} in {text}")).parse().expect("a number")
    };
    assert_eq!(value("doorcam_frames_captured_total"), 9.0);
    assert_eq!(value("doorcam_frames_lost_total"), 0.0);
    assert_eq!(value("doorcam_source_state{state=\"ended\"}"), 1.0);
    assert_eq!(value("doorcam_source_state{state=\"streaming\"}"), 0.0);
    let states = ["learning", "watching", "relearning", "stale", "obstructed", "misaligned"];
    assert_eq!(states.map(|state| value(&format!("doorcam_state{{state=\"{state}\"}}"))).iter().sum::<f64>(), 1.0);
    assert_eq!(value("doorcam_stage_seconds_count{stage=\"solve\"}"), value("doorcam_frames_solved_total"));
}
