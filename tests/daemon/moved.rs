//! A camera that is nudged, or turned away, while doorcam watches.

use std::path::Path;

use doorcam_core::calibration::Calibration;
use doorcam_engine::simulation::{FrameFormat, Scenario, Simulator, record_simulation};
use doorcam_source::RawImages;
use serde_json::Value;

use crate::common::Daemon;

const FRAMES: u64 = 90;
const BUMP: u64 = 45;

fn seen_by(aside_m: [f64; 2], roll_deg: f64) -> Simulator {
    let mut scenario = Scenario::load("empty-room").unwrap();
    scenario.background_s = 3.0;
    let camera = &mut scenario.camera;
    camera.look_at_m = [0, 1].map(|k| camera.look_at_m[k] + aside_m[k]);
    camera.roll_deg += roll_deg;
    camera.format = FrameFormat::Jpeg;
    Simulator::new(scenario, 1).unwrap()
}

/// A recording of an empty room whose camera is turned on the way.
fn recording(aside_m: [f64; 2], roll_deg: f64) -> (tempfile::TempDir, [Calibration; 2]) {
    let cameras = [seen_by([0.0; 2], 0.0), seen_by(aside_m, roll_deg)];
    let directory = tempfile::tempdir().unwrap();
    record_simulation(&cameras[0], directory.path(), FRAMES, || {}).unwrap();
    for number in BUMP..FRAMES {
        let RawImages::Camera(bytes) = cameras[1].frame(number).unwrap().images else { panic!("a JPEG") };
        let file = directory.path().join(format!("frames/{number:08}.jpg"));
        assert!(file.exists());
        std::fs::write(file, &*bytes).unwrap();
    }
    (directory, cameras.map(|camera| camera.manifest().calibration().unwrap()))
}

fn calibration(file: &Path) -> Calibration {
    serde_json::from_slice(&std::fs::read(file).unwrap()).unwrap()
}

/// The farthest that any point is from where it is in another calibration, in pixels.
fn farthest_px(one: &Calibration, other: &Calibration) -> f64 {
    let place = |floor_m| other.floor_points.iter().find(|point| point.floor_m == floor_m).map(|point| point.pixel);
    let distances = one.floor_points.iter().filter_map(|point| {
        let there = place(point.floor_m)?;
        Some((point.pixel[0] - there[0]).hypot(point.pixel[1] - there[1]))
    });
    distances.fold(0.0, f64::max)
}

fn metric(daemon: &Daemon, name: &str) -> String {
    let metrics = String::from_utf8(daemon.get("/metrics").1).unwrap();
    let line = metrics.lines().find(|line| line.starts_with(name)).unwrap_or_else(|| panic!("no {name}: {metrics}"));
    line.rsplit(' ').next().unwrap().to_owned()
}

#[test]
fn a_nudged_camera_is_followed_and_the_calibration_before_is_kept() {
    let (recording, [before, after]) = recording([0.006, 0.003], 0.2);
    assert!((3.0..9.0).contains(&farthest_px(&before, &after)), "{}", farthest_px(&before, &after));
    let kept = recording.path().join("calibration.json");
    std::fs::write(&kept, serde_json::to_vec(&before).unwrap()).unwrap();
    let source = format!("replay:{},rate=max", recording.path().display());
    let daemon = Daemon::start(&source, &["--calibration", kept.to_str().unwrap()]);
    let status = daemon
        .wait_for("the end", |status| status["source"]["state"] == "ended" && status["calibration_revision"] == 1);
    let moved = &status["camera_moved"];
    assert_eq!(moved["corrected"], true, "{status}");
    assert!(moved["shift_px"].as_f64().is_some_and(|shift| (2.0..10.0).contains(&shift)), "{moved}");
    let events = daemon.json("/api/v1/events");
    let told: Vec<_> =
        events["events"].as_array().unwrap().iter().map(|event| (&event["kind"], &event["track"])).collect();
    assert_eq!(told, [(&"camera_moved".into(), &0.into())], "nobody was there: {events}");
    let update = daemon.json("/api/v1/reconstruction");
    assert_eq!(update["camera_moved"]["corrected"], true, "{update}");
    assert!(update["facets"].as_array().unwrap().len() < 5, "the map goes on, and is empty: {update}");
    assert_eq!(metric(&daemon, "doorcam_camera_moved_total"), "1");
    assert_eq!(metric(&daemon, "doorcam_camera_shift_px"), "0");

    let previous = recording.path().join("calibration.previous.json");
    while !previous.exists() {
        // The one before is written before the new one.
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    daemon.wait_for("the new calibration on the disk", |_| farthest_px(&calibration(&kept), &before) > 0.5);
    assert_eq!(calibration(&previous), before);
    let error = farthest_px(&calibration(&kept), &after);
    assert!(error < 0.6, "{error:.2} px from where the camera looks");
    let shown = daemon.json("/api/v1/calibration");
    let shown: Calibration = serde_json::from_value(shown["calibration"].clone()).unwrap();
    assert!(farthest_px(&shown, &calibration(&kept)) < 1e-6);
}

#[test]
fn a_camera_that_was_turned_away_asks_for_its_points() {
    let (recording, [before, after]) = recording([0.0, 0.05], 1.0);
    let px = farthest_px(&before, &after);
    assert!(px > 20.0, "{px}");
    let daemon = Daemon::start(&format!("replay:{},loop", recording.path().display()), &[]);
    let misaligned = |status: &Value| status["watching"]["reason"] == "misaligned" && !status["camera_moved"].is_null();
    let status = daemon.wait_for("a camera that has moved", misaligned);
    let moved = &status["camera_moved"];
    assert_eq!((&status["state"], &moved["corrected"]), (&"misaligned".into(), &false.into()), "{status}");
    assert!(moved["shift_px"].as_f64().is_some_and(|shift| (shift - px).abs() < 0.3 * px), "{moved}, truly {px:.1}");
    assert!(moved["rotation_deg"].as_f64().is_some_and(|turn| (turn.abs() - 1.0).abs() < 0.8), "{moved}");
    assert!(daemon.log().contains("the camera has moved"), "{}", daemon.log());
    assert_ne!(metric(&daemon, "doorcam_camera_moved_total"), "0");
    let (answer, picture) = daemon.get("/api/v1/calibration/reference.jpg");
    assert_eq!((answer, &picture[..2]), (200, [0xff, 0xd8].as_slice()));
    let events = daemon.json("/api/v1/events");
    let told: Vec<_> =
        events["events"].as_array().unwrap().iter().map(|event| (&event["kind"], &event["track"])).collect();
    assert_eq!(told, [(&"camera_moved".into(), &0.into())], "nobody was there: {events}");
}
