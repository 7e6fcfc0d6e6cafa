//! People on the camera's own side: simulated walkers, passers-by, and a path-traced recording of somebody who walks in
//! and out under the camera. `scripts/acceptance visible` measures hundreds of them.

use std::path::Path;

use serde_json::Value;

use super::people::{doorcam, evaluate};
use crate::common::Daemon;

/// Simulates a scenario with this seed into `out`.
fn simulate(scenario: &str, seed: u64, out: &Path) {
    doorcam(&["simulate", scenario, out.to_str().unwrap(), "--seed", &seed.to_string()]);
}

fn simulated(scenario: &str, seed: u64) -> Value {
    let directory = tempfile::tempdir().unwrap();
    let out = directory.path().join("recording");
    simulate(scenario, seed, &out);
    evaluate(&out)
}

fn count(figures: &Value, pointer: &str) -> u64 {
    figures.pointer(pointer).and_then(Value::as_u64).unwrap_or_else(|| panic!("{pointer} of {figures}"))
}

#[test]
fn who_walks_through_the_doorway_is_told_with_direction_and_time() {
    let figures: Vec<Value> = (1..=6).map(|seed| simulated("walk-through", seed)).collect();
    let sum = |pointer: &str| figures.iter().map(|figures| count(figures, pointer)).sum::<u64>();
    assert_eq!((sum("/crossings/missed"), sum("/crossings/false")), (0, 0), "{figures:?}");
    assert!(sum("/crossings/right") >= 6, "{figures:?}");
}

#[test]
fn who_passes_the_doorway_neither_crosses_it_nor_is_in_the_room() {
    for seed in 1..=4 {
        let figures = simulated("pass-by", seed);
        let told = ["right", "missed", "false"].map(|key| count(&figures, &format!("/crossings/{key}")));
        assert_eq!((told, count(&figures, "/false_tracks")), ([0; 3], 0), "seed {seed}: {figures}");
    }
}

/// Rendered by other software: in at 7.1 s, out at 15.25 s, past a ceiling lamp of the camera's own side.
#[test]
fn who_walks_in_and_out_under_a_rendered_camera_is_followed_from_door_to_door() {
    let data = std::env::var_os("DOORCAM_DATA").unwrap_or_else(|| "../shared/data".into());
    let recording = Path::new(&data).join("rendered/D6");
    if !recording.is_dir() {
        eprintln!("skipped: no {}", recording.display());
        return;
    }
    let figures = evaluate(&recording);
    let told = ["right", "missed", "false"].map(|key| count(&figures, &format!("/crossings/{key}")));
    assert_eq!(told, [2, 0, 0], "{figures}");
    assert_eq!((count(&figures, "/false_tracks"), count(&figures, "/tracks")), (0, 1), "{figures}");
    assert!(figures["missed_share"].as_f64().unwrap() < 0.3, "{figures}");
}

#[test]
fn the_daemon_counts_who_walks_in_and_out_again() {
    let directory = tempfile::tempdir().unwrap();
    let out = directory.path().join("recording");
    // Somebody walks in and out again.
    simulate("walk-through", 3, &out);
    // As fast as it goes, no frame is left out, however busy the machine is.
    let daemon = Daemon::start(&format!("replay:{},rate=max", out.display()), &[]);
    daemon.wait_for("the end", |status| status["source"]["state"] == "ended");
    let counted = |status: &Value| status["crossings"]["out"] == 1;
    let status = daemon.wait_for("somebody who goes out", counted);
    let crossings = &status["crossings"];
    assert_eq!((&crossings["in"], &crossings["inside"]), (&1.into(), &0.into()), "{crossings}");
    let events = daemon.json("/api/v1/events?kind=cross_in,cross_out");
    let events = events["events"].as_array().unwrap();
    let kinds: Vec<&str> = events.iter().map(|event| event["kind"].as_str().unwrap()).collect();
    assert_eq!(kinds, ["cross_in", "cross_out"]);
    assert!(events.iter().all(|event| event["speed_m_s"].as_f64().is_some_and(|speed| speed > 0.3)), "{events:?}");
}
