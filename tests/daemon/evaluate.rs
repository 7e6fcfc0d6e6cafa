//! `doorcam evaluate`: what it prints and draws.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use crate::common::{doorcam, grey_recording, manifest, run, stderr};
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
const MORE: [&str; 9] = [
    "gospa",
    "people",
    "missed_share",
    "tracks",
    "false_tracks",
    "ellipse_share",
    "median_nees",
    "bound_m",
    "efficiency",
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
    let output = run(&["evaluate", text(&walk), "--json"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let lines = String::from_utf8(output.stdout).unwrap();
    assert_eq!(lines.lines().count(), 1);
    let report: Value = serde_json::from_str(&lines).unwrap();
    let expected: BTreeSet<&str> = PROMISED.into_iter().chain(MORE).collect();
    assert_eq!(keys(&report), expected);
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
    assert_eq!(cells, ["4", "4", "0.300", "0.300", "0.300", "–", "–", "0.0", "0", "0", "0", "0.0", "0.300", "–"]);
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
