//! The Cramér-Rao bound of the actual camera: live over the room, and as the yardstick of an evaluation.

use std::path::Path;

use crate::common::{Daemon, grey_recording, manifest, run, stderr};
use doorcam_engine::simulation::luminous::{Scenario, write_recording};
use serde_json::Value;

fn recording(dir: &Path) -> String {
    let path = dir.join("room");
    write_recording(&Scenario::demo(), &path, 60, 1, || {}).unwrap();
    path.to_str().unwrap().to_owned()
}

#[test]
fn the_measured_noise_becomes_a_map_of_the_room() {
    let dir = tempfile::tempdir().unwrap();
    let daemon = Daemon::start(&format!("replay:{},loop", recording(dir.path())), &[]);
    daemon.wait_for("a map", |status| status["state"] == "watching");
    let map = daemon.json("/api/v1/uncertainty");
    let geometry = daemon.json("/api/v1/geometry");
    assert_eq!(map["calibration"], geometry["calibration"]);
    assert_eq!(map["threshold_m"], 0.5);
    let axis = |key: &str| -> Vec<f64> { serde_json::from_value(map[key].clone()).unwrap() };
    let (x, y) = (axis("x_m"), axis("y_m"));
    let errors: Vec<Vec<Option<f64>>> = serde_json::from_value(map["error_m"].clone()).unwrap();
    assert_eq!((errors.len(), errors[0].len()), (y.len(), x.len()));
    let half = geometry["room"]["half_width_m"].as_f64().unwrap();
    assert!(x.iter().all(|v| v.abs() < half) && y.iter().all(|v| *v > 0.0));
    // Straight ahead, the error is small near the door and grows with every step.
    let ahead = x.iter().position(|v| v.abs() < 0.1).unwrap();
    let along: Vec<f64> = (0..y.len()).filter(|&k| y[k] > 0.8).map(|k| errors[k][ahead].unwrap()).collect();
    assert!(along[0] > 0.0 && along[0] < 0.2 && along.windows(2).all(|pair| pair[1] > pair[0]), "{along:?}");
    // It is computed once per background.
    assert_eq!(daemon.json("/api/v1/uncertainty"), map);
}

#[test]
fn without_a_background_there_is_no_map_and_the_answer_says_why() {
    let dir = grey_recording(&manifest(), 3);
    let daemon = Daemon::start(&format!("replay:{}", dir.path().display()), &["--preset", "published"]);
    daemon.wait_for("an update", |status| status["last_update"].is_object());
    let (status, body) = daemon.get("/api/v1/uncertainty");
    assert_eq!(status, 404);
    assert!(String::from_utf8(body).unwrap().contains("noise is not known"));
}

#[test]
fn an_evaluation_tells_what_could_have_been_attained() {
    let dir = tempfile::tempdir().unwrap();
    let path = recording(dir.path());
    for more in [&[][..], &["--detections"]] {
        let output = run(&[&["evaluate", "--json", &path], more].concat());
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        let figures: Value = serde_json::from_slice(&output.stdout).unwrap();
        let number = |key: &str| figures[key].as_f64().unwrap_or_else(|| panic!("{key} of {figures}"));
        let (bound, rmse) = (number("bound_m"), number("rmse_m"));
        assert!(bound > 0.0 && bound < 1.1 * rmse, "the RMSE cannot be much below the bound: {figures}");
        assert!((number("efficiency") * rmse / bound - 1.0).abs() < 1e-9, "{figures}");
    }
    let output = run(&["evaluate", "--json", "--preset", "published", &path]);
    let figures: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((&figures["bound_m"], &figures["efficiency"]), (&Value::Null, &Value::Null), "{figures}");
}
