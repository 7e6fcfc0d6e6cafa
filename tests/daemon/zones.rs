//! Zones that are drawn while the daemon runs.

use std::collections::BTreeMap;
use std::path::Path;

use crate::common::{Daemon, grey_recording, manifest, run, stderr};
use doorcam_engine::simulation::luminous::{Scenario, write_recording};
use serde_json::{Value, json};

const PATH: &str = "/api/v1/zones";

fn names(answer: &Value) -> Vec<&str> {
    answer["zones"].as_array().unwrap().iter().map(|zone| zone["name"].as_str().unwrap()).collect()
}

/// A zone with an id.
fn zone(name: &str, id: &str) -> Value {
    json!({"name": name, "id": id, "polygon_m": [[0, 1], [1, 1], [1, 2], [0, 2]]})
}

/// A zone without one.
fn drawn(name: &str) -> Value {
    json!({"name": name, "polygon_m": [[0, 1], [1, 1], [1, 2], [0, 2]]})
}

/// The id of each zone, by its name.
fn ids(answer: &Value) -> BTreeMap<String, String> {
    let zones = answer["zones"].as_array().unwrap_or_else(|| panic!("{answer}")).iter();
    zones.map(|zone| (zone["name"].as_str().unwrap().into(), zone["id"].as_str().unwrap().into())).collect()
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
        let mut known = desk.clone();
        known["id"] = "desk".into();
        assert_eq!(geometry["zones"], json!([known]));
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
        (json!([{"name": "a", "id": 1, "polygon_m": square}]), 400, "zones[0].id: invalid type"),
        (json!([{"name": "a", "id": "", "polygon_m": square}]), 422, "the id of \"a\" is \"\", expected 1 to 64 of"),
        (json!([{"name": "a", "id": "Спальня", "polygon_m": square}]), 422, "the id of \"a\" is"),
        (json!([{"name": "a", "id": "x".repeat(65), "polygon_m": square}]), 422, "the id of \"a\" is"),
        (json!([zone("a", "x"), zone("b", "x")]), 422, "two have the id \"x\""),
        (json!([{"name": "Ж".repeat(41), "polygon_m": square}]), 422, "expected 1 to 40 characters"),
        (json!([{"name": "a\nb", "polygon_m": square}]), 422, "expected characters that can be seen"),
        (json!([{"name": "a", "polygon_m": [[0, 1], [1e9, 1], [1, 2]]}]), 422, "a point 2 that is not two numbers"),
        (json!([{"name": "a", "polygon_m": [[1e-300, 1], [1, 1], [1, 2]]}]), 422, "a point 1 that is not two numbers"),
        (json!([{"name": "a", "polygon_m": [[0, 1], [1, 1], [1, 1e-300], [2, 2]]}]), 422, "a point 3 that is not two"),
        (json!([{"name": "a", "polygon_m": [[0, 1], [1e-3, 1], [0, 1.001]]}]), 422, "expected at least 0.01 m2"),
        (json!([{"name": "a", "polygon_m": vec![[0, 1]; 3_000]}]), 422, "has 3000 points, expected 3 to 100"),
        (json!((0..33).map(|k| zone(&format!("z{k}"), &format!("z{k}"))).collect::<Vec<_>>()), 422, "there are 33"),
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

#[test]
fn a_drawn_zone_keeps_its_id_and_no_other_one_ever_gets_it() {
    let directory = tempfile::tempdir().unwrap();
    let recording = grey_recording(&manifest(), 6);
    let source = format!("replay:{},loop", recording.path().display());
    let storage = directory.path().join("storage");
    let arguments = ["--storage", storage.to_str().unwrap()];
    let put = |daemon: &Daemon, zones: &[Value]| {
        let (code, answer) = daemon.send("PUT", PATH, &json!({"zones": zones}));
        assert_eq!(code, 200, "{answer}");
        assert_eq!(ids(&answer), ids(&daemon.json(PATH)));
        ids(&answer)
    };
    let first = {
        let daemon = Daemon::start(&source, &arguments);
        put(&daemon, &[drawn("Спальня"), drawn("Кабинет"), drawn("Desk")])
    };
    assert_eq!(first["Desk"], "desk");
    assert!(first["Спальня"].starts_with("zone-") && first["Кабинет"].starts_with("zone-"), "{first:?}");
    let daemon = Daemon::start(&source, &arguments);
    assert_eq!(ids(&daemon.json(PATH)), first, "after a restart");
    // One is removed, one is renamed with its id, one comes without its id.
    let second = put(&daemon, &[zone("Table", "desk"), drawn("Кабинет")]);
    assert_eq!(second, BTreeMap::from([("Table".into(), "desk".into()), ("Кабинет".into(), first["Кабинет"].clone())]));
    // Another zone gets no id that was there before, not even under the same name, and not after all are gone either.
    assert_eq!(daemon.delete(PATH).0, 200);
    let third = put(&daemon, &[drawn("Спальня"), drawn("Desk"), drawn("Table"), drawn("Гостиная")]);
    for id in third.values() {
        assert!(!first.values().chain(second.values()).any(|before| before == id), "{first:?} {third:?}");
    }
    let (code, problem) = daemon.send("PUT", PATH, &json!({"zones": [zone("Sofa", "desk")]}));
    assert_eq!(code, 422);
    assert!(problem["detail"].as_str().unwrap().contains("was that of \"Table\", which was removed"), "{problem}");
    assert_eq!(ids(&daemon.json(PATH)), third, "nothing has changed");
    // The removed one itself may come back.
    assert_eq!(put(&daemon, &[zone("Table", "desk")])["Table"], "desk");
}

#[test]
fn saved_zones_of_before_there_were_ids_are_taken_over() {
    let directory = tempfile::tempdir().unwrap();
    let recording = grey_recording(&manifest(), 6);
    let saved = json!({"zones": [drawn("Bed 1"), drawn("Спальня")]});
    std::fs::write(directory.path().join("zones.json"), saved.to_string()).unwrap();
    let source = format!("replay:{},loop", recording.path().display());
    let arguments = ["--storage", directory.path().to_str().unwrap()];
    let before = ids(&Daemon::start(&source, &arguments).json(PATH));
    assert_eq!(before["Bed 1"], "bed_1");
    assert!(before["Спальня"].starts_with("zone-"), "{before:?}");
    let daemon = Daemon::start(&source, &arguments);
    assert_eq!(ids(&daemon.json(PATH)), before);
    let (_, answer) = daemon.send("PUT", PATH, &json!({"zones": [drawn("Спальня")]}));
    assert_eq!(ids(&answer)["Спальня"], before["Спальня"]);
}

#[test]
fn configured_zones_have_the_ids_of_their_names_whatever_else_there_is() {
    let directory = tempfile::tempdir().unwrap();
    let recording = grey_recording(&manifest(), 6);
    let source = format!("replay:{},loop", recording.path().display());
    let file = directory.path().join("doorcam.toml");
    let configure = |names: &[&str]| {
        let zone = |name: &&str| format!("[[zones]]\nname = \"{name}\"\npolygon_m = [[-1, 1], [1, 1], [1, 2]]\n");
        std::fs::write(&file, names.iter().map(zone).collect::<String>()).unwrap();
    };
    let storage = directory.path().join("storage");
    let arguments = ["--config", file.to_str().unwrap(), "--storage", storage.to_str().unwrap()];
    configure(&["Спальня", "Кабинет", "a b", "a_b", "Near, left"]);
    let daemon = Daemon::start(&source, &arguments);
    let before = ids(&daemon.json(PATH));
    assert_eq!(before["Near, left"], "near__left");
    // Removed while it runs, and then in another order while it does not.
    configure(&["Кабинет", "a_b"]);
    daemon.signal("HUP");
    daemon.wait_for("the other zones", |status| status["zones_revision"] == 1);
    let fewer = ids(&daemon.json(PATH));
    assert_eq!(fewer.len(), 2);
    assert!(fewer.iter().all(|(name, id)| before[name] == *id), "{before:?} {fewer:?}");
    drop(daemon);
    configure(&["a_b", "Near, left", "a b", "Кабинет", "Спальня"]);
    assert_eq!(ids(&Daemon::start(&source, &arguments).json(PATH)), before);
}
