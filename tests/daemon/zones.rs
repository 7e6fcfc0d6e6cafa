//! Zones that are drawn while the daemon runs.

use std::path::Path;

use crate::common::{Daemon, grey_recording, manifest, run, stderr};
use doorcam_engine::simulation::luminous::{Scenario, write_recording};
use serde_json::{Value, json};

const PATH: &str = "/api/v1/zones";

fn names(answer: &Value) -> Vec<&str> {
    answer["zones"].as_array().unwrap().iter().map(|zone| zone["name"].as_str().unwrap()).collect()
}

fn config(directory: &Path) -> String {
    let file = directory.join("doorcam.toml");
    std::fs::write(&file, "[[zones]]\nname = \"bed\"\npolygon_m = [[-1, 1], [1, 1], [1, 2]]\n").unwrap();
    file.to_str().unwrap().into()
}

#[test]
fn drawn_zones_are_used_kept_and_forgotten() {
    let directory = tempfile::tempdir().unwrap();
    let source = grey_recording(&manifest(), 6);
    let (config, storage) = (config(directory.path()), directory.path().join("storage"));
    let arguments = ["--config", &config, "--storage", storage.to_str().unwrap()];
    let source = format!("replay:{},loop", source.path().display());
    let desk = json!({"name": "desk", "polygon_m": [[0.0, 1.0], [1.0, 1.0], [1.0, 2.0], [0.0, 2.0]]});
    {
        let daemon = Daemon::start(&source, &arguments);
        let before = daemon.json(PATH);
        assert_eq!((names(&before), &before["origin"]), (vec!["bed"], &json!("config")));
        let (code, answer) = daemon.send("PUT", PATH, &json!({"zones": [desk]}));
        assert_eq!((code, names(&answer), &answer["origin"]), (200, vec!["desk"], &json!("saved")), "{answer}");
        let geometry = daemon.json("/api/v1/geometry");
        assert_eq!(geometry["zones"], json!([desk]));
        let status = daemon.json("/api/v1/status");
        assert_eq!((&status["zones_revision"], &geometry["zones_revision"]), (&json!(1), &json!(1)));
        // Updates count people in the new ones.
        daemon.wait_for("an update of the new zones", |_| {
            daemon.json("/api/v1/reconstruction")["zones"] == json!([{"name": "desk", "people": 0, "tracks": []}])
        });
    }
    let daemon = Daemon::start(&source, &arguments);
    let kept = daemon.json(PATH);
    assert_eq!((names(&kept), &kept["origin"]), (vec!["desk"], &json!("saved")), "after a restart");
    let (code, answer) = daemon.delete(PATH);
    assert_eq!((code, names(&answer), &answer["origin"]), (200, vec!["bed"], &json!("config")));
    assert!(!storage.join("zones.json").exists());
}

#[test]
fn what_is_no_zone_is_refused_and_nothing_changes() {
    let directory = tempfile::tempdir().unwrap();
    let source = grey_recording(&manifest(), 4);
    // Without a storage directory of its own, a replay does not save its zones.
    let daemon =
        Daemon::start(&format!("replay:{},loop", source.path().display()), &["--config", &config(directory.path())]);
    let square = [[0, 1], [1, 1], [1, 2], [0, 2]];
    for (zones, code, words) in [
        (json!([{"name": "a", "polygon_m": [[0, 1], [1, 1]]}]), 422, "polygon_m of \"a\" has 2 points, expected 3"),
        (json!([{"name": " ", "polygon_m": square}]), 422, "the name of zone 1 is"),
        (json!([{"name": "a", "polygon_m": square}, {"name": "a", "polygon_m": square}]), 422, "two are named \"a\""),
        (json!([{"name": "a", "polygon_m": [[0, 1], [1, 2], [1, 1], [0, 2]]}]), 422, "crosses or touches itself"),
        (json!([{"name": "a"}]), 400, "zones[0]: missing field `polygon_m`"),
    ] {
        let (status, problem) = daemon.send("PUT", PATH, &json!({"zones": zones}));
        assert_eq!(status, code, "{problem}");
        assert!(problem["detail"].as_str().unwrap().contains(words), "{problem}");
    }
    assert_eq!(daemon.json("/api/v1/status")["zones_revision"], 0);
    let (_, answer) = daemon.send("PUT", PATH, &json!({"zones": [{"name": "a", "polygon_m": square}]}));
    assert_eq!((names(&answer), &answer["origin"]), (vec!["a"], &json!("run")));
}

#[test]
fn people_are_counted_in_zones_that_are_drawn_while_they_walk() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("room");
    write_recording(&Scenario::demo(), &path, 120, 1, || {}).unwrap();
    let daemon = Daemon::start(&format!("replay:{},loop", path.display()), &[]);
    daemon.wait_for("people", |_| {
        daemon.json("/api/v1/tracks")["tracks"].as_array().unwrap().iter().any(|track| track["state"] == "confirmed")
    });
    let room = json!({"name": "room", "polygon_m": [[-3, -0.5], [3, -0.5], [3, 4], [-3, 4]]});
    let (code, _) = daemon.send("PUT", PATH, &json!({"zones": [room]}));
    assert_eq!(code, 200);
    daemon.wait_for("somebody in the room", |_| daemon.json(PATH)["zones"][0]["people"].as_u64() > Some(0));
    let events = daemon.json("/api/v1/events");
    let entered = |event: &Value| event["kind"] == "zone_enter" && event["zone"] == "room";
    assert!(events["events"].as_array().unwrap().iter().any(entered), "{events}");
}

#[test]
fn a_file_that_holds_no_zones_is_named() {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("zones.json");
    std::fs::write(&file, "{\"zones\": [{\"name\": \"a\", \"polygon_m\": [[0, 0], [1, 1], [0, 0]]}]}").unwrap();
    let source = grey_recording(&manifest(), 4);
    let source = format!("replay:{}", source.path().display());
    let storage = directory.path().to_str().unwrap();
    let output = run(&["serve", "--source", &source, "--listen", "127.0.0.1:0", "--storage", storage]);
    assert_eq!(output.status.code(), Some(1));
    let said = stderr(&output);
    assert!(said.contains("zones.json") && said.contains("points 1 and 3 in the same place"), "{said}");
}
