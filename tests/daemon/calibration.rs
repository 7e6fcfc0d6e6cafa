//! The real program is calibrated over REST while it runs, and keeps the calibration.

use crate::common;
use std::path::Path;

use crate::common::{Daemon, grey_recording, manifest};
use doorcam_core::geometry::Doorway;
use doorcam_core::optics::{FloorPoint, Transfer};
use doorcam_source::recording::{Layout, Manifest};
use serde_json::{Value, json};

const DOORWAY: Doorway = Doorway { width_m: 0.8, wall_thickness_m: 0.1, height_m: None, leaf: None };

/// A camera that looks straight down at 400 pixels per metre of floor, with the door line at row 40.
fn overhead([x, y]: [f64; 2]) -> [f64; 2] {
    [320.0 + 400.0 * x, 40.0 - 400.0 * (y + 0.1)]
}

fn floor_points(see: impl Fn([f64; 2]) -> [f64; 2]) -> Vec<FloorPoint> {
    let floor = [[-0.4, -0.1], [0.4, -0.1], [-0.4, -0.4], [0.4, -0.4], [0.0, -0.3]];
    floor.map(|floor_m| FloorPoint { pixel: see(floor_m), floor_m }).to_vec()
}

/// A camera's recording of a floor of uniform grey.
fn camera_recording() -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    let manifest = Manifest {
        layout: Layout::Camera,
        transfer: Transfer::Srgb,
        size: Some([640, 240]),
        doorway: DOORWAY,
        floor_points: floor_points(overhead),
        fov_m: None,
        ..manifest()
    };
    manifest.write(dir.path()).unwrap();
    std::fs::create_dir(dir.path().join("frames")).unwrap();
    for index in 0..6 {
        let image = image::RgbImage::from_pixel(640, 240, image::Rgb([120; 3]));
        image.save(dir.path().join(format!("frames/{index:08}.png"))).unwrap();
    }
    dir
}

fn daemon(recording: &Path, more: &[&str]) -> Daemon {
    Daemon::start(&format!("replay:{},loop", recording.display()), more)
}

/// The calibration in use, with its points as `see` maps them to the image.
fn moved(daemon: &Daemon, see: impl Fn([f64; 2]) -> [f64; 2]) -> Value {
    let mut calibration = daemon.json("/api/v1/calibration")["calibration"].clone();
    calibration["floor_points"] = json!(floor_points(see));
    calibration
}

fn shifted([x, y]: [f64; 2]) -> [f64; 2] {
    let [u, v] = overhead([x, y]);
    [u + 8.0, v + 5.0]
}

#[test]
fn a_calibration_is_checked_used_kept_and_taken_back() {
    let recording = camera_recording();
    let file = recording.path().join("kept/calibration.json");
    let arguments = ["--calibration", file.to_str().unwrap()];
    let running = daemon(recording.path(), &arguments);
    let first = running.json("/api/v1/calibration");
    assert_eq!(
        (&first["editable"], &first["size"], &first["previous"]),
        (&json!(true), &json!([640, 240]), &json!(false))
    );
    assert_eq!(first["check"]["ok"], true, "{first}");

    // Checking changes nothing.
    let wanted = moved(&running, shifted);
    let (status, check) = running.send("POST", "/api/v1/calibration/check", &wanted);
    assert_eq!((status, &check["ok"]), (200, &json!(true)), "{check}");
    let at = |check: &Value| {
        check["overlay"]["edges"][0].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).sum::<f64>()
    };
    assert!((at(&check) - at(&first["check"]) - 13.0).abs() < 1e-6, "the overlay follows: {check}");
    assert_eq!(running.json("/api/v1/calibration"), first);
    assert!(!file.exists());

    // It is used from one of the next frames on, and these say so.
    let (status, saved) = running.send("PUT", "/api/v1/calibration", &wanted);
    assert_eq!((status, &saved["calibration"]["floor_points"]), (200, &wanted["floor_points"]), "{saved}");
    running.wait_for("an update of the new calibration", |status| status["calibration_revision"] == 1);
    assert_eq!(running.json("/api/v1/geometry")["calibration"], 1);
    running.wait_for("updates", |s| s["last_update"]["sequence"].as_u64() > Some(3));
    assert_eq!(running.json("/api/v1/reconstruction")["calibration"], 1);

    // Saving another one keeps this one as the previous, which can be restored.
    let next = moved(&running, |p| overhead(p).map(|v| v + 1.0));
    let (status, saved) = running.send("PUT", "/api/v1/calibration", &next);
    assert_eq!((status, &saved["previous"]), (200, &json!(true)));
    let (status, back) = running.send("POST", "/api/v1/calibration/previous", &Value::Null);
    assert_eq!((status, &back["calibration"]["floor_points"]), (200, &wanted["floor_points"]));

    // It survives a restart.
    drop(running);
    let again = daemon(recording.path(), &arguments);
    assert_eq!(again.json("/api/v1/calibration")["calibration"]["floor_points"], wanted["floor_points"]);
}

#[test]
fn what_does_not_fit_is_refused_in_words_and_the_one_in_use_stays() {
    let recording = camera_recording();
    let file = recording.path().join("calibration.json");
    let running = daemon(recording.path(), &["--calibration", file.to_str().unwrap()]);
    let before = running.json("/api/v1/calibration");
    let line = moved(&running, |[x, _]| [320.0 + 400.0 * x, 100.0]);
    let (status, problem) = running.send("PUT", "/api/v1/calibration", &line);
    assert_eq!(status, 422, "{problem}");
    assert!(problem["detail"].as_str().unwrap().contains("floor_points"), "{problem}");
    let mut other = before["calibration"].clone();
    other["doorway"]["width_m"] = json!(-1);
    let (status, problem) = running.send("PUT", "/api/v1/calibration", &other);
    assert!(status == 422 && problem["detail"].as_str().unwrap().contains("width_m"), "{status} {problem}");
    let mut other = before["calibration"].clone();
    other["doorway"]["width_m"] = json!("wide");
    let (status, problem) = running.send("PUT", "/api/v1/calibration", &other);
    assert_eq!(status, 400);
    assert!(problem["detail"].as_str().unwrap().starts_with("doorway.width_m: invalid type"), "{problem}");
    let points = floor_points(overhead);
    let mut many = before["calibration"].clone();
    many["floor_points"] = json!(points.iter().cycle().take(10_000).collect::<Vec<_>>());
    let (status, check) = running.send("POST", "/api/v1/calibration/check", &many);
    assert_eq!((status, &check["errors"]), (200, &json!(["floor_points has 10000 points, expected at most 64"])));
    // The wrong one of 64 points is found fast enough to check while somebody drags.
    let spread = |k: usize| [-0.6 + 0.02 * k as f64, -0.12 - 0.08 * (k % 5) as f64];
    let at = |k: usize| FloorPoint { pixel: overhead(spread(k)), floor_m: spread(k) };
    let mut right: Vec<FloorPoint> = (0..64).map(at).collect();
    right[20].pixel[0] += 40.0;
    many["floor_points"] = json!(right);
    let (status, check) = running.send("POST", "/api/v1/calibration/check", &many);
    let error = check["errors"][0].as_str().unwrap();
    assert!(status == 200 && error.starts_with("floor_points: point 21 is 40 pixels"), "{check}");
    let (status, problem) = running.send("POST", "/api/v1/calibration/previous", &Value::Null);
    assert_eq!((status, &problem["detail"]), (404, &json!("there is no previous calibration")));
    assert_eq!(running.json("/api/v1/calibration"), before);
    assert!(!file.exists());
}

#[test]
fn a_recording_keeps_its_own_calibration_unless_a_file_is_named() {
    let recording = camera_recording();
    let running = daemon(recording.path(), &[]);
    let report = running.json("/api/v1/calibration");
    assert_eq!(report["editable"], false);
    assert!(report["reason"].as_str().unwrap().contains("--calibration FILE"), "{report}");
    let (status, _) = running.send("PUT", "/api/v1/calibration", &report["calibration"]);
    assert_eq!(status, 409);
    let (status, body) = running.get("/api/v1/frame.jpg");
    assert!(status == 200 && body.starts_with(b"\x89PNG"));

    let patches = grey_recording(&manifest(), 6);
    let running = daemon(patches.path(), &[]);
    let report = running.json("/api/v1/calibration");
    assert_eq!((&report["editable"], &report["calibration"]), (&json!(false), &Value::Null));
    running.wait_for("a frame", |s| s["frames"]["captured"].as_u64() > Some(0));
    assert_eq!(running.get("/api/v1/frame.jpg").0, 404);
}

#[test]
fn a_broken_calibration_file_is_named() {
    let recording = camera_recording();
    let file = recording.path().join("calibration.json");
    std::fs::write(&file, "{\"size\": [640").unwrap();
    let source = format!("replay:{}", recording.path().display());
    let arguments = ["serve", "--source", &source, "--listen", "127.0.0.1:0", "--calibration", file.to_str().unwrap()];
    let output = common::run(&arguments);
    assert_eq!(output.status.code(), Some(1));
    let said = common::stderr(&output);
    assert!(said.contains("calibration.json: is not a calibration: ") && said.lines().count() == 1, "{said}");
}
