//! People who walk through the doorway, over REST and the live socket.

use crate::common::{Daemon, grey_recording, manifest};
use serde_json::{Value, json};

const PATH: &str = "/api/v1/crossings";

#[test]
fn how_many_are_inside_can_be_set_right_and_a_restart_knows_it() {
    let (directory, source) = (tempfile::tempdir().unwrap(), grey_recording(&manifest(), 6));
    let storage = directory.path().join("storage");
    let source = format!("replay:{},loop", source.path().display());
    let daemon = Daemon::start(&source, &["--storage", storage.to_str().unwrap()]);
    let before = daemon.json(PATH);
    let keys: Vec<&String> = before.as_object().unwrap().keys().collect();
    assert_eq!(keys, ["available", "back", "in", "inside", "last", "out", "reason", "since"]);
    assert_eq!((&before["inside"], &before["last"]), (&json!(0), &Value::Null));
    assert_eq!(before["available"].as_bool(), Some(before["reason"].is_null()), "{before}");
    let since: jiff::Timestamp = before["since"].as_str().unwrap().parse().unwrap();
    let day = jiff::Timestamp::now().duration_since(since).as_hours();
    assert!((0..25).contains(&day), "{before}");
    let (code, answer) = daemon.send("PUT", PATH, &json!({"inside": 3}));
    assert_eq!((code, &answer["inside"], &answer["in"]), (200, &json!(3), &json!(0)), "{answer}");
    let status = daemon.json("/api/v1/status");
    assert_eq!(status["crossings"]["inside"], 3);
    drop(daemon);
    let daemon = Daemon::start(&source, &["--storage", storage.to_str().unwrap(), "--no-history"]);
    assert_eq!(daemon.json(PATH)["inside"], 3, "after a restart");
}

#[test]
fn what_is_no_number_of_people_is_refused_with_the_range() {
    let source = grey_recording(&manifest(), 4);
    let daemon = Daemon::start(&format!("replay:{},loop", source.path().display()), &[]);
    for (body, code, words) in [
        (json!({"inside": -1}), 422, "inside is -1, expected a whole number from 0 to 1000"),
        (json!({"inside": 1001}), 422, "inside is 1001, expected a whole number from 0 to 1000"),
        (json!({"inside": 2.5}), 422, "inside is 2.5, expected a whole number from 0 to 1000"),
        (json!({"inside": "3"}), 400, "inside: invalid type: string"),
        (json!({"inside": null}), 400, "inside: invalid type: null"),
        (json!({}), 400, "missing field `inside`"),
        (json!({"inside": 1, "in": 2}), 400, "unknown field `in`"),
    ] {
        let (answered, problem) = daemon.send("PUT", PATH, &body);
        assert_eq!(answered, code, "{body}: {problem}");
        assert!(problem["detail"].as_str().unwrap().contains(words), "{body}: {problem}");
        assert_eq!(daemon.json(PATH)["inside"], 0);
    }
    for inside in [1000, 0] {
        assert_eq!(daemon.send("PUT", PATH, &json!({"inside": inside})).1["inside"], inside);
    }
}

#[test]
fn crossings_that_are_turned_off_say_so() {
    let (directory, source) = (tempfile::tempdir().unwrap(), grey_recording(&manifest(), 6));
    let config = directory.path().join("doorcam.toml");
    std::fs::write(&config, "[crossings]\nenabled = false\n").unwrap();
    let source = format!("replay:{},loop", source.path().display());
    let daemon = Daemon::start(&source, &["--config", config.to_str().unwrap()]);
    daemon.wait_for("a map", |status| status["state"] == "watching");
    let told = daemon.json(PATH);
    assert_eq!((&told["available"], &told["reason"]), (&json!(false), &json!("crossings.enabled is false")));
    let (_, metrics) = daemon.get("/metrics");
    let metrics = String::from_utf8(metrics).unwrap();
    assert!(metrics.contains("\ndoorcam_inside NaN\n"), "{metrics}");
    for direction in ["in", "out", "back"] {
        let line = format!("\ndoorcam_crossings_total{{direction=\"{direction}\"}} 0\n");
        assert!(metrics.contains(&line), "{line} {metrics}");
    }
}
