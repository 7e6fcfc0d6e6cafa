//! From a camera's frames to a map, and across a restart.

use std::time::Instant;

use serde_json::Value;

use crate::common::Daemon;
use crate::guest::{SMALL, calibration, configured, measured, only_inside, set_control};

/// Text that vivid draws into its image (drivers/media/test-drivers/vivid/vivid-ctrls.c). 2 is none: a static image.
const OSD_TEXT_MODE: u32 = 0x00f0_f001;

#[test]
#[ignore = "runs in the virtual machine"]
fn guest_a_calibrated_camera_makes_a_map_and_goes_on_after_a_restart() {
    only_inside!();
    set_control("/dev/video0", OSD_TEXT_MODE, 2);
    let (kept, config) = configured(SMALL);
    let start = || Daemon::start("v4l2:/dev/video0", &["--config", config.to_str().unwrap()]);
    let watching = |s: &Value| s["state"] == "watching";

    let mut daemon = start();
    let status = daemon.wait_for("frames", |s| s["frames"]["captured"] != 0);
    assert_eq!((&status["calibrated"], &status["last_update"]), (&false.into(), &Value::Null), "{status}");
    assert_eq!(daemon.get("/api/v1/geometry").0, 404);
    let began = Instant::now();
    let (code, answer) = daemon.send("PUT", "/api/v1/calibration", &calibration([320, 180]));
    assert_eq!((code, &answer["check"]["ok"]), (200, &true.into()), "{answer}");
    daemon.wait_for("a map", watching);
    measured(&format!("calibrated and watching after {:.1} s", began.elapsed().as_secs_f64()));
    let update = daemon.json("/api/v1/reconstruction");
    assert!(update["facets"].as_array().unwrap().is_empty(), "nothing moves: {update}");

    // It learns again on request.
    assert_eq!(daemon.send("POST", "/api/v1/background/reset", &Value::Null).0, 202);
    daemon.wait_for("relearning", |s| s["state"] == "relearning");
    daemon.wait_for("a map again", watching);
    daemon.terminate();

    let files = std::fs::read_dir(kept.path().join("kept")).unwrap();
    let mut files: Vec<String> = files.map(|f| f.unwrap().file_name().into_string().unwrap()).collect();
    // The reference picture of the alignment comes when it has seen enough, on a slow machine before this.
    files.retain(|file| file != "reference.bin");
    files.sort();
    assert_eq!(files, ["background.bin", "calibration.json", "controls.json", "history.sqlite", "history.sqlite-lock"]);
    let began = Instant::now();
    let daemon = start();
    let status = daemon.wait_for("the first update", |s| !s["last_update"].is_null());
    measured(&format!("restarted and watching after {:.1} s", began.elapsed().as_secs_f64()));
    assert_eq!((&status["state"], &status["calibrated"]), (&"watching".into(), &true.into()), "{status}");
    set_control("/dev/video0", OSD_TEXT_MODE, 0);
}
