//! What is known of the hidden room: where people are looked for, the door's leaf and the lights.

use doorcam_core::geometry::{Leaf, Side};
use serde_json::json;

use crate::common::{Daemon, grey_recording, manifest, run, stderr};

const DESCRIBED: &str = "[doorway.leaf]\nhinge = \"left\"\nangle_deg = 98\nwidth_m = 0.3\n\n[room]\n\
    lights = [{ kind = \"window\", from_m = [-0.2, 2.9], to_m = [1.0, 2.9], height_m = [0.9, 2.1] },\n\
    { kind = \"screen\", from_m = [1.4, 1.0], to_m = [1.4, 1.8], height_m = [0.6, 1.2], on = false }]\n";

#[test]
fn the_room_is_told_as_it_is_described() {
    let dir = grey_recording(&manifest(), 3);
    let config = dir.path().join("doorcam.toml");
    std::fs::write(&config, DESCRIBED).unwrap();
    let source = format!("replay:{}", dir.path().display());
    let daemon = Daemon::start(&source, &["--config", config.to_str().unwrap()]);
    let room = daemon.json("/api/v1/room");
    assert_eq!(room["mapped"], json!({ "half_width_m": 1.5, "depth_m": 3.0 }));
    assert_eq!(room["searched"], json!({ "half_width_m": 2.2, "depth_m": 4.2 }));
    assert_eq!(room["margin_m"], 0.2);
    let leaf = json!({ "hinge": "left", "angle_deg": 98.0, "width_m": 0.3 });
    assert_eq!(room["leaf"], leaf);
    let window =
        json!({ "kind": "window", "from_m": [-0.2, 2.9], "to_m": [1.0, 2.9], "height_m": [0.9, 2.1], "on": true });
    assert_eq!(room["lights"][0], window);
    assert_eq!((&room["lights"][1]["kind"], &room["lights"][1]["on"]), (&json!("screen"), &json!(false)));
    assert_eq!(room["found"], json!([]));
    let geometry = daemon.json("/api/v1/geometry");
    assert_eq!((&geometry["doorway"]["leaf"], &geometry["searched"]), (&leaf, &room["searched"]));
    assert_eq!(geometry["calibration"], room["calibration"]);
}

#[test]
fn a_recording_knows_its_own_leaf_and_a_room_that_is_given_is_searched_as_it_is() {
    let mut manifest = manifest();
    let own = json!({ "hinge": "right", "angle_deg": 75.0, "width_m": 0.4 });
    manifest.doorway.leaf = Some(Leaf { hinge: Side::Right, angle_deg: 75.0, width_m: 0.4 });
    let dir = grey_recording(&manifest, 3);
    let config = dir.path().join("doorcam.toml");
    let [before, _] = DESCRIBED.split_once("lights").map(<[&str; 2]>::from).unwrap();
    let text = format!("{before}depth_m = 2.5\n");
    std::fs::write(&config, text).unwrap();
    let source = format!("replay:{}", dir.path().display());
    let daemon = Daemon::start(&source, &["--config", config.to_str().unwrap()]);
    let room = daemon.json("/api/v1/room");
    assert_eq!((&room["leaf"], &room["lights"]), (&own, &json!([])));
    assert_eq!((&room["searched"], &room["mapped"]["depth_m"]), (&room["mapped"], &json!(2.5)));
}

#[test]
fn a_room_that_cannot_be_is_named_in_one_line() {
    let dir = tempfile::tempdir().unwrap();
    let config = dir.path().join("doorcam.toml");
    let check = |text: String| {
        std::fs::write(&config, text).unwrap();
        let output = run(&["check-config", config.to_str().unwrap()]);
        (output.status.code(), stderr(&output))
    };
    assert_eq!(check(DESCRIBED.into()).0, Some(0));
    let (code, said) = check(DESCRIBED.replace("98", "270"));
    assert!(
        code == Some(1) && said.contains("doorcam.toml: doorway.leaf.angle_deg is 270, expected 5 to 180"),
        "{said}"
    );
    let (code, said) = check(DESCRIBED.replace("[0.6, 1.2]", "[60, 120]"));
    assert!(code == Some(1) && said.contains("room.lights: light 2 has height_m [60.0, 120.0], expected"), "{said}");
    assert_eq!(said.trim_end().lines().count(), 1, "{said}");
    let mut manifest = manifest();
    manifest.doorway.leaf = Some(Leaf { hinge: Side::Left, angle_deg: -8.0, width_m: 0.8 });
    let recording = grey_recording(&manifest, 3);
    let output = run(&["reconstruct", recording.path().to_str().unwrap()]);
    let said = stderr(&output);
    assert!(said.contains("recording.json: doorway.leaf.angle_deg is -8, expected 5 to 180 degrees"), "{said}");
    assert_eq!((output.status.code(), said.trim_end().lines().count()), (Some(1), 1), "{said}");
}
