//! Recordings of its source that a running daemon makes.

use std::path::Path;

use crate::common::{Daemon, grey_recording, manifest};
use doorcam_source::recording::{Manifest, Recording};
use serde_json::{Value, json};

const PATH: &str = "/api/v1/recording";

/// A daemon that replays equal frames in a loop, with a storage directory for recordings.
fn daemon(storage: &Path, more: &[&str]) -> (tempfile::TempDir, Daemon) {
    let source = grey_recording(&manifest(), 6);
    let storage = storage.to_str().unwrap();
    let daemon =
        Daemon::start(&format!("replay:{},loop", source.path().display()), &[&["--storage", storage], more].concat());
    daemon.wait_for("frames", |status| status["frames"]["solved"].as_u64() > Some(0));
    (source, daemon)
}

fn detail(problem: &Value) -> &str {
    problem["detail"].as_str().unwrap_or_default()
}

#[test]
fn what_is_captured_becomes_a_recording_that_opens_and_replays() {
    let storage = tempfile::tempdir().unwrap();
    let (_source, daemon) = daemon(storage.path(), &[]);
    assert_eq!((&daemon.json(PATH)["possible"], &daemon.json(PATH)["recording"]), (&json!(true), &Value::Null));
    let wish = json!({"name": "evening", "seconds": 1.5, "empty_seconds": 0.5});
    let (code, begun) = daemon.send("POST", PATH, &wish);
    assert_eq!((code, &begun["recording"]["state"]), (201, &json!("recording")), "{begun}");
    // Only one at a time.
    let (code, problem) = daemon.send("POST", PATH, &json!({"name": "another"}));
    assert_eq!((code, detail(&problem)), (409, "a recording is under way already"));
    // It ends by itself.
    let status = daemon.wait_for("its end", |status| status["recording"]["state"] == "complete");
    let recording = &status["recording"];
    assert_eq!((&recording["ended"], &recording["overflowed"]), (&json!("seconds"), &json!(0)), "{recording}");
    let frames = recording["frames"].as_u64().unwrap();
    // Ten frames per second, for at most a second and a half.
    assert!((10..=15).contains(&frames), "{recording}");

    let directory = storage.path().join("recordings/evening");
    assert_eq!(recording["directory"], json!(directory));
    let opened = Recording::open(&directory).unwrap();
    assert_eq!(opened.frames.len() as u64, frames);
    let Manifest { background_frames, fov_m, notes, .. } = &opened.manifest;
    let [first, end] = background_frames.unwrap();
    assert!((4..=6).contains(&(end - first)), "half a second of an empty room: {first}..{end}");
    assert_eq!(*fov_m, manifest().fov_m);
    assert!(notes.starts_with("made by a test (recorded 20"), "{notes}");
    let again = Daemon::start(&format!("replay:{},loop", directory.display()), &[]);
    again.wait_for("a map", |status| status["state"] == "watching");

    let (code, problem) = daemon.send("POST", PATH, &wish);
    assert_eq!(code, 409);
    assert!(detail(&problem).contains("there is a recording already"), "{problem}");
}

#[test]
fn it_ends_when_it_is_told_to_and_when_the_daemon_ends() {
    let storage = tempfile::tempdir().unwrap();
    let (_source, mut daemon) = daemon(storage.path(), &[]);
    let (code, problem) = daemon.delete(PATH);
    assert_eq!((code, detail(&problem)), (404, "nothing is being recorded"));
    daemon.send("POST", PATH, &json!({"name": "one"}));
    daemon.wait_for("frames", |status| status["recording"]["frames"].as_u64() > Some(2));
    let (code, report) = daemon.delete(PATH);
    let recording = &report["recording"];
    assert_eq!((code, &recording["state"], &recording["ended"]), (200, &json!("complete"), &json!("stopped")));
    assert_eq!(report["possible"], true);
    let frames = Recording::open(&storage.path().join("recordings/one")).unwrap().frames.len();
    assert_eq!(recording["frames"], frames);

    let (code, _) = daemon.send("POST", PATH, &json!({"name": "two"}));
    assert_eq!(code, 201);
    daemon.wait_for("frames", |status| status["recording"]["frames"].as_u64() > Some(2));
    assert_eq!(daemon.terminate().1, Some(0));
    let two = Recording::open(&storage.path().join("recordings/two")).unwrap();
    assert!(two.frames.len() > 2 && two.manifest.background_frames.is_some());
}

#[test]
fn what_cannot_be_recorded_is_refused_with_the_key_and_what_was_expected() {
    let storage = tempfile::tempdir().unwrap();
    let (_source, daemon) = daemon(storage.path(), &[]);
    for name in ["", ".", "..", "a\nb", "\u{1b}[2J", "a\u{202e}b", "\0", "NUL", "com1.txt", "end.", "=1+1", "a/b"] {
        let (status, problem) = daemon.send("POST", PATH, &json!({"name": name}));
        assert!(status == 422 && detail(&problem).starts_with("name is "), "{name:?}: {problem}");
    }
    for long in ["x".repeat(65), "𠀀".repeat(64), "x".repeat(3_000)] {
        assert_eq!(daemon.send("POST", PATH, &json!({"name": long})).0, 422);
    }
    for (wish, code, words) in [
        (json!({"name": "../evening"}), 422, "name is \"../evening\", expected 1 to 64 letters"),
        (json!({"seconds": 0}), 422, "seconds is 0, expected a number of seconds above those of the empty room (3)"),
        (json!({"seconds": 3601}), 422, "and at most 3600"),
        (json!({"empty_seconds": -1}), 422, "empty_seconds is -1, expected a number of seconds from 0"),
        (json!({"second": 5}), 400, "unknown field `second`"),
        (json!({"seconds": "long"}), 400, "seconds: invalid type"),
    ] {
        let (status, problem) = daemon.send("POST", PATH, &wish);
        assert_eq!(status, code, "{wish}: {problem}");
        assert!(detail(&problem).contains(words), "{wish}: {problem}");
    }
    assert!(!storage.path().join("recordings").exists());
    // A name that exists, whatever it is that has it.
    std::fs::create_dir_all(storage.path().join("recordings/empty")).unwrap();
    std::fs::write(storage.path().join("recordings/file"), "").unwrap();
    std::os::unix::fs::symlink("nowhere", storage.path().join("recordings/link")).unwrap();
    for name in ["empty", "file", "link"] {
        let (status, problem) = daemon.send("POST", PATH, &json!({"name": name}));
        assert_eq!(status, 409, "{name}: {problem}");
    }
    std::fs::remove_dir_all(storage.path().join("recordings")).unwrap();
    // A directory that cannot be made.
    std::fs::write(storage.path().join("recordings"), "").unwrap();
    let (status, problem) = daemon.send("POST", PATH, &json!({}));
    assert_eq!(status, 500, "{problem}");
    assert!(detail(&problem).contains("recordings"), "{problem}");
}

#[test]
fn a_source_that_has_ended_gives_nothing_to_record() {
    let storage = tempfile::tempdir().unwrap();
    let source = grey_recording(&manifest(), 4);
    let arguments = ["--storage", storage.path().to_str().unwrap()];
    let daemon = Daemon::start(&format!("replay:{},rate=max", source.path().display()), &arguments);
    daemon.wait_for("the end", |status| status["source"]["state"] == "ended");
    let (code, problem) = daemon.send("POST", PATH, &json!({}));
    assert_eq!((code, detail(&problem)), (409, "the source has ended: no frames will come to record"));
    assert_eq!(daemon.json(PATH)["possible"], false);
}
