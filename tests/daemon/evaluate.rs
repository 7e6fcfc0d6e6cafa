//! `doorcam evaluate`: what it prints and draws.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use crate::common::{camera_recording, doorcam, grey_recording, manifest, run, stderr};
use serde_json::{Value, json};

/// The keys of the JSON report that users rely on.
const PROMISED: [&str; 13] = [
    "recording",
    "frames",
    "scored_frames",
    "targets",
    "detected",
    "missed",
    "false",
    "mean_error_m",
    "rmse_m",
    "p95_error_m",
    "gospa_m",
    "id_switches",
    "timing_ms",
];
const MORE: [&str; 12] = [
    "gospa",
    "people",
    "missed_share",
    "tracks",
    "false_tracks",
    "ellipse_share",
    "median_nees",
    "bound_m",
    "efficiency",
    "crossings",
    "unwatched",
    "directions",
];

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// A grey recording of six frames with a truth: two frames of the empty room, then one person from frame 2 on.
fn with_truth() -> tempfile::TempDir {
    let dir = grey_recording(&manifest(), 6);
    let frame = |index: u64| {
        let targets = if index < 2 { json!([]) } else { json!([{"id": 1, "x_m": 0.1 * index as f64, "y_m": 1.2}]) };
        json!({"index": index, "t": 0.1 * index as f64, "targets": targets})
    };
    let truth = json!({"frames": (0..6).map(frame).collect::<Vec<_>>()});
    std::fs::write(dir.path().join("truth.json"), truth.to_string()).unwrap();
    dir
}

/// Writes a file of updates with a confirmed track `off` metres from the truth.
fn updates(dir: &Path, off: f64) -> PathBuf {
    let line = |index: u64| {
        let track = json!({
            "id": 5, "state": "confirmed", "x_m": 0.1 * index as f64 + off, "y_m": 1.2,
            "covariance_m2": [[0.01, 0.0], [0.0, 0.01]]
        });
        json!({"frame": index, "tracks": [track]}).to_string() + "\n"
    };
    let path = dir.join("updates.jsonl");
    std::fs::write(&path, (0..6).map(line).collect::<String>()).unwrap();
    path
}

fn keys(value: &Value) -> BTreeSet<&str> {
    value.as_object().unwrap().keys().map(String::as_str).collect()
}

fn failure<S: AsRef<std::ffi::OsStr> + std::fmt::Debug>(arguments: &[S]) -> String {
    let output = doorcam(arguments).env("RUST_LOG", "error").output().expect("starts");
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(1), "{arguments:?}: {said}");
    assert_eq!(said.lines().count(), 1, "{said}");
    said.trim_end().to_owned()
}

#[test]
fn a_simulated_recording_gives_the_promised_object() {
    let dir = tempfile::tempdir().unwrap();
    let walk = dir.path().join("walk");
    assert_eq!(run(&["demo", "--only-record", text(&walk)]).status.code(), Some(0));
    // Nobody goes through the doorway there; what did not happen cannot be told.
    let truth = walk.join("truth.json");
    let mut known: Value = serde_json::from_slice(&std::fs::read(&truth).unwrap()).unwrap();
    known["crossings"] = json!([{"t": 6.0, "direction": "out"}]);
    std::fs::write(&truth, known.to_string()).unwrap();
    let output = run(&["evaluate", text(&walk), "--json", "--by-person"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let lines = String::from_utf8(output.stdout).unwrap();
    assert_eq!(lines.lines().count(), 1);
    let report: Value = serde_json::from_str(&lines).unwrap();
    let expected: BTreeSet<&str> = PROMISED.into_iter().chain(MORE).chain(["by_person", "by_distance"]).collect();
    assert_eq!(keys(&report), expected);
    assert_eq!(report["crossings"], json!({"right": 0, "missed": 1, "false": 0}));
    assert_eq!((&report["unwatched"], &report["directions"]), (&json!(0), &json!(0)));
    let rows = |key: &str| report[key].as_array().unwrap().clone();
    assert_eq!(rows("by_person").len(), report["people"].as_u64().unwrap() as usize);
    for key in ["by_person", "by_distance"] {
        for count in ["targets", "detected", "missed", "directions"] {
            let sum: u64 = rows(key).iter().map(|row| row[count].as_u64().unwrap()).sum();
            assert_eq!(sum, report[count].as_u64().unwrap(), "{key} {count}: {report}");
        }
    }
    let number = |key: &str| report[key].as_u64().unwrap();
    assert_eq!(report["recording"], text(&walk));
    let manifest: Value = serde_json::from_slice(&std::fs::read(walk.join("recording.json")).unwrap()).unwrap();
    let empty = manifest["background_frames"][1].as_u64().unwrap();
    assert!(empty > 0 && number("frames") == number("scored_frames") + empty, "{report} {empty}");
    assert_eq!(number("targets"), number("detected") + number("missed"));
    assert!(number("targets") > 100, "{report}");
    for stage in ["solve", "total"] {
        let [p50, p99] = ["p50", "p99"].map(|q| report["timing_ms"][stage][q].as_f64().unwrap());
        assert!(0.0 < p50 && p50 <= p99, "{stage}: {report}");
    }
}

#[test]
fn updates_from_a_file_are_scored_and_drawn() {
    let dir = with_truth();
    let path = text(dir.path());
    let file = updates(dir.path(), 0.3);
    let pictures = dir.path().join("pictures");
    let arguments = ["evaluate", path, "--updates", text(&file), "--settle", "0", "--output", text(&pictures)];
    let output = run(&arguments);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let table = String::from_utf8(output.stdout).unwrap();
    let cells: Vec<&str> = table.lines().last().unwrap().split_whitespace().skip(1).collect();
    // e² / σ² = 9 > 5.991: outside the ellipse.
    let expected = ["4", "4", "0.300", "0.300", "0.300", "–", "–", "0.0", "0", "0", "0", "0.0", "0.300", "–"];
    assert_eq!(cells, [&expected[..], &["0", "0", "0,", "0,", "0"]].concat());
    let name = dir.path().file_name().unwrap().to_str().unwrap();
    let svg = std::fs::read_to_string(pictures.join(format!("evaluation_{name}.svg"))).unwrap();
    assert!(svg.contains("track 5") && svg.contains("mean 0.300 m"));
    assert!(std::fs::read(pictures.join(format!("evaluation_{name}.png"))).unwrap().starts_with(b"\x89PNG"));
    // With the default of one second to settle, no target counts.
    let output = run(&["evaluate", path, "--updates", text(&file), "--json"]);
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(
        (&report["targets"], &report["mean_error_m"], &report["timing_ms"]),
        (&json!(0), &Value::Null, &Value::Null)
    );
    assert_eq!(report["scored_frames"], 4);
}

/// Updates of a program that has no map of frames 2 and 3, knows only a direction in frame 4, and tells two crossings.
fn hand_made_updates(dir: &Path, clock: &str) -> PathBuf {
    let event = |kind: &str, time: &str| json!({"kind": kind, "time": time.replace("CLOCK", clock), "track": 5});
    let line = |index: u64, state: &str, y_m: f64, events: Value| {
        let track = json!({
            "id": 5, "state": "confirmed", "x_m": 0.1 * index as f64, "y_m": y_m,
            "covariance_m2": [[0.009, 0.0], [0.0, 0.35]]
        });
        let time = format!("{clock}.{index}Z");
        json!({"frame": index, "time": time, "state": state, "tracks": [track], "events": events}).to_string() + "\n"
    };
    let lines = [
        line(1, "learning", 1.2, json!([])),
        line(2, "obstructed", 1.2, json!([event("cross_in", "CLOCK.2Z")])),
        line(3, "relearning", 1.2, json!([event("enter", "CLOCK.1Z")])),
        line(4, "watching", 2.3, json!([])),
        line(5, "watching", 1.3, json!([event("cross_out", "CLOCK.4Z")])),
    ];
    let path = dir.join("made.jsonl");
    std::fs::write(&path, lines.concat()).unwrap();
    path
}

#[test]
fn unwatched_frames_directions_and_crossings_are_told_in_json_in_the_table_and_in_the_picture() {
    let dir = with_truth();
    let path = text(dir.path());
    let truth = dir.path().join("truth.json");
    let mut known: Value = serde_json::from_slice(&std::fs::read(&truth).unwrap()).unwrap();
    known["crossings"] = json!([{"t": 0.31, "direction": "in"}, {"t": 0.6, "direction": "back"}]);
    std::fs::write(&truth, known.to_string()).unwrap();
    // By the recording's own clock, and live, where the time is the time of day.
    for clock in ["1970-01-01T00:00:00", "2026-11-29T12:34:56"] {
        let file = hand_made_updates(dir.path(), clock);
        let arguments = ["evaluate", path, "--updates", text(&file), "--settle", "0", "--json"];
        let output = run(&arguments);
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        let report: Value = serde_json::from_slice(&output.stdout).unwrap();
        assert_eq!(report["crossings"], json!({"right": 1, "missed": 1, "false": 1}), "{report}");
        let counts = ["scored_frames", "unwatched", "targets", "detected", "missed", "directions", "false"];
        assert_eq!(counts.map(|key| report[key].as_u64().unwrap()), [4, 2, 3, 1, 2, 1, 0], "{report}");
        assert!(report.get("by_person").is_none() && report.get("by_distance").is_none());
    }
    let file = text(&dir.path().join("made.jsonl")).to_owned();
    let pictures = dir.path().join("pictures");
    let output =
        run(&["evaluate", path, "--updates", &file, "--settle", "0", "--by-person", "--output", text(&pictures)]);
    let table = String::from_utf8(output.stdout).unwrap();
    let lines: Vec<Vec<&str>> = table.lines().map(|line| line.split_whitespace().collect()).collect();
    assert_eq!(lines[2][15..], ["2", "1", "1,", "1,", "1"], "{table}");
    assert_eq!(
        lines[6..],
        [
            vec!["person", "1", "3", "1", "2", "1", "0.100", "100.0"],
            vec!["1", "to", "2", "m", "3", "1", "2", "1", "0.100", "100.0"]
        ],
        "{table}"
    );
    let name = dir.path().file_name().unwrap().to_str().unwrap();
    let svg = std::fs::read_to_string(pictures.join(format!("evaluation_{name}.svg"))).unwrap();
    assert!(svg.contains("doorcam-crossings"), "{svg}");
    // Without crossings in the truth, nobody crossed.
    known.as_object_mut().unwrap().remove("crossings");
    std::fs::write(&truth, known.to_string()).unwrap();
    let output = run(&["evaluate", path, "--updates", &file, "--json"]);
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(report["crossings"], json!({"right": 0, "missed": 0, "false": 2}), "{report}");
}

#[test]
fn a_frame_whose_floor_is_hidden_has_an_update_and_is_scored() {
    let dir = camera_recording(8);
    // Somebody holds a hand before the lens.
    let dark = image::RgbImage::from_pixel(640, 240, image::Rgb([2; 3]));
    for index in [4, 5] {
        dark.save(dir.path().join(format!("frames/{index:08}.jpg"))).unwrap();
    }
    std::fs::write(dir.path().join("frames/00000006.jpg"), "no picture").unwrap();
    let output = run(&["reconstruct", text(dir.path())]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let updates = dir.path().join("updates.jsonl");
    std::fs::write(&updates, &output.stdout).unwrap();
    let lines = String::from_utf8(output.stdout).unwrap();
    let updates_of: Vec<Value> = lines.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let frames: Vec<u64> = updates_of.iter().map(|update| update["frame"].as_u64().unwrap()).collect();
    assert_eq!(frames, [2, 3, 4, 5, 7]);
    let unwatched = updates_of.iter().filter(|update| update["state"] != "watching").collect::<Vec<_>>();
    assert!(unwatched.iter().all(|update| update["facets"] == json!([])), "{unwatched:?}");
    let frame = |index: u64| json!({"index": index, "t": 0.1 * index as f64, "targets": []});
    let truth = json!({"frames": (0..8).map(frame).collect::<Vec<_>>()});
    std::fs::write(dir.path().join("truth.json"), truth.to_string()).unwrap();
    // Scored from the printed updates as from the recording itself.
    for from in [vec![], vec!["--updates", text(&updates)]] {
        let output = run(&[&["evaluate", text(dir.path()), "--json"][..], &from].concat());
        let report: Value = serde_json::from_slice(&output.stdout).unwrap();
        let expected = [json!(5), json!(unwatched.len())];
        assert_eq!([&report["scored_frames"], &report["unwatched"]], [&expected[0], &expected[1]], "{report}");
    }
}

#[test]
fn several_recordings_are_a_line_each_and_what_was_done_before_an_error_is_shown() {
    let (one, two) = (with_truth(), with_truth());
    let bare = grey_recording(&manifest(), 4);
    let output = run(&["evaluate", text(one.path()), text(two.path()), "--json", "--detections"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let recordings: Vec<Value> = String::from_utf8(output.stdout)
        .unwrap()
        .lines()
        .map(|line| serde_json::from_str::<Value>(line).unwrap()["recording"].clone())
        .collect();
    assert_eq!(recordings, [text(one.path()), text(two.path())]);
    let output = run(&["evaluate", text(one.path()), text(bare.path())]);
    assert_eq!(output.status.code(), Some(1));
    assert_eq!(String::from_utf8(output.stdout).unwrap().lines().count(), 3);
}

#[test]
fn what_cannot_be_scored_is_named() {
    let bare = grey_recording(&manifest(), 4);
    let path = text(bare.path());
    let truth = bare.path().join("truth.json");
    let expected =
        format!("doorcam: {path}/truth.json: no such file, expected the true places of everybody (docs/recordings.md)");
    assert_eq!(failure(&["evaluate", path]), expected);
    std::fs::write(&truth, r#"{"frames": [{"index": 1, "t": 0.1, "targets": []}]}"#).unwrap();
    assert!(
        failure(&["evaluate", path])
            .ends_with("truth.json: no frame after background_frames (index 2 or more), so nothing to score")
    );
    std::fs::write(&truth, r#"{"frames": [{"index": "two"}]}"#).unwrap();
    assert!(failure(&["evaluate", path]).contains("truth.json: frames[0].index: invalid type"));
    let twice = json!({"id": 3, "x_m": 0.0, "y_m": 1.0});
    let twice = json!({"frames": [{"index": 2, "t": 0.2, "targets": [twice, twice]}]});
    std::fs::write(&truth, twice.to_string()).unwrap();
    assert_eq!(
        failure(&["evaluate", path]),
        format!("doorcam: {path}/truth.json: frames: index 2 has two targets with id 3, expected each target once")
    );
    let dir = with_truth();
    let path = text(dir.path());
    let file = dir.path().join("updates.jsonl");
    assert!(failure(&["evaluate", path, "--updates", text(&file)]).contains("updates.jsonl: "));
    std::fs::write(&file, "{\"frame\": 2, \"tracks\": 3}\n").unwrap();
    let said = failure(&["evaluate", path, "--updates", text(&file)]);
    assert!(said.contains("updates.jsonl: line 1: tracks: invalid type"), "{said}");
    std::fs::write(&file, "{\"frame\": 99, \"tracks\": []}\n").unwrap();
    let said = failure(&["evaluate", path, "--updates", text(&file)]);
    assert!(said.contains("updates.jsonl: no update of a frame that"), "{said}");
    let said = failure(&["evaluate", path, path, "--output", text(&dir.path().join("out"))]);
    assert!(said.contains("have the same name"), "{said}");
}

#[test]
fn wrong_usage_is_status_2() {
    for arguments in [
        vec!["evaluate"],
        vec!["evaluate", "x", "--settle", "-1"],
        vec!["evaluate", "x", "--updates", "u", "--detections"],
        vec!["evaluate", "x", "y", "--updates", "u"],
    ] {
        assert_eq!(run(&arguments).status.code(), Some(2), "{arguments:?}");
    }
}
