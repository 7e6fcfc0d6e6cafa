//! The real webcam driver with a simulated webcam: JPEG, exposure, stalls, unplugging.

use std::time::Duration;

use serde_json::json;

use crate::common::run;
use crate::guest::{SOON_S, Watching, Webcam, calibration, control, hold, measured, only_inside};

const SMALL: &str = "size = [320, 240]\nfps = 10\nformats = [\"MJPG\"]";
/// Exposure mode (1 is manual) and exposure time (linux/v4l2-controls.h).
const EXPOSURE_AUTO: u32 = 0x009a_0901;
const EXPOSURE: u32 = 0x009a_0902;

fn source(webcam: &Webcam) -> String {
    format!("v4l2:{}", webcam.node)
}

#[test]
#[ignore = "runs in the virtual machine"]
fn guest_webcam_formats_are_granted_as_configured() {
    only_inside!();
    let webcam = Webcam::plug_in();
    let output = run(&["devices", "--json"]);
    let cameras: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let listed: Vec<_> = cameras.as_array().unwrap().iter().filter(|c| c["driver"] == "uvcvideo").collect();
    assert_eq!(listed.len(), 1, "the metadata node is not a camera: {cameras}");
    assert_eq!(
        (&listed[0]["node"], &listed[0]["card"]),
        (&webcam.node.as_str().into(), &"Simulated UVC camera: Simulated".into())
    );
    for (formats, granted) in [("\"MJPG\"", "MJPG"), ("\"YUYV\"", "YUYV"), ("\"GREY\", \"YUYV\", \"MJPG\"", "YUYV")] {
        let watching =
            Watching::streaming(&source(&webcam), &format!("size = [320, 240]\nfps = 10\nformats = [{formats}]"));
        let got = watching.status()["source"]["granted"].clone();
        assert_eq!((&got["format"], &got["size"], &got["fps"]), (&granted.into(), &json!([320, 240]), &10.0.into()));
        let (code, picture) = watching.daemon.get("/api/v1/frame.jpg");
        let picture = image::load_from_memory(&picture).unwrap();
        assert_eq!((code, picture.width(), picture.height()), (200, 320, 240), "{formats}");
    }
    webcam.unplug();
}

#[test]
#[ignore = "runs in the virtual machine"]
fn guest_webcam_exposure_is_locked_or_set() {
    only_inside!();
    let webcam = Webcam::plug_in();
    assert_ne!(control(&webcam.node, EXPOSURE_AUTO), 1, "it starts with automatic exposure");
    let watching = Watching::streaming(&source(&webcam), SMALL);
    let mut left = 100;
    while control(&webcam.node, EXPOSURE_AUTO) != 1 {
        assert!(left > 0, "automatic exposure is not switched off: {}", watching.status());
        left -= 1;
        std::thread::sleep(Duration::from_millis(100));
    }
    let found = control(&webcam.node, EXPOSURE);
    let granted = watching.status()["source"]["granted"].clone();
    assert_eq!((&granted["controls"]["exposure"], &granted["mismatches"]), (&found.into(), &json!([])), "{granted}");
    drop(watching);
    let watching = Watching::streaming(&source(&webcam), &format!("{SMALL}\nexposure = 321\ngain = 5000"));
    assert_eq!((control(&webcam.node, EXPOSURE_AUTO), control(&webcam.node, EXPOSURE)), (1, 321));
    let granted = watching.status()["source"]["granted"].clone();
    assert_eq!(granted["controls"]["exposure"], 321);
    // The camera's maximum gain is 100.
    let mismatches = granted["mismatches"].as_array().unwrap();
    assert!(mismatches.len() == 1 && mismatches[0].as_str().unwrap().starts_with("gain: asked for 5000"), "{granted}");
    drop(watching);
    webcam.unplug();
}

#[test]
#[ignore = "runs in the virtual machine"]
fn guest_webcam_that_stalls_is_told_and_resumed() {
    only_inside!();
    let webcam = Webcam::plug_in();
    let watching = Watching::streaming(&source(&webcam), SMALL);
    for pause in [0, 8] {
        webcam.stall_or_go_on();
        let (told, status) = watching.until("stalled");
        assert!(status["source"]["error"].as_str().unwrap().contains("no frame for"), "{status}");
        // Long enough for doorcam to close and reopen the camera, which does not help.
        std::thread::sleep(Duration::from_secs(pause));
        assert_eq!(watching.status()["source"]["state"], "stalled");
        webcam.stall_or_go_on();
        let resumed = watching.until_frames();
        measured(&format!("stalled: reported after {told:.2} s, frames {resumed:.2} s after the stall"));
        assert!(told < SOON_S && resumed < SOON_S);
    }
    drop(watching);
    webcam.unplug();
}

#[test]
#[ignore = "runs in the virtual machine"]
fn guest_webcam_is_found_again_under_another_number() {
    only_inside!();
    let webcam = Webcam::plug_in();
    let node = webcam.node.clone();
    let watching = Watching::streaming(&source(&webcam), &format!("{SMALL}\nexposure = 222"));
    let held = hold(&node);
    webcam.unplug();
    let (told, status) = watching.until("lost");
    assert!(status["source"]["error"].as_str().unwrap().contains("unplugged"), "{status}");
    let webcam = Webcam::plug_in();
    let resumed = watching.until_frames();
    measured(&format!(
        "{node} unplugged: reported after {told:.2} s; back as {}: frames after {resumed:.2} s",
        webcam.node
    ));
    assert!(told < SOON_S && resumed < SOON_S);
    assert_ne!(webcam.node, node);
    let granted = watching.status()["source"]["granted"].clone();
    assert_eq!(
        (&granted["node"], &granted["controls"]["exposure"]),
        (&webcam.node.as_str().into(), &222.into()),
        "{granted}"
    );
    webcam.unplug();
    watching.until("lost");
    // It comes back with fewer capabilities, and the status shows what it grants now.
    let webcam = Webcam::plug_in_with_size([160, 120]);
    watching.until_frames();
    assert_eq!(watching.status()["source"]["granted"]["size"], json!([160, 120]));
    drop((watching, held));
    webcam.unplug();
}

#[test]
#[ignore = "runs in the virtual machine"]
fn guest_webcam_frame_cut_short_is_one_skipped_frame() {
    only_inside!();
    let webcam = Webcam::plug_in();
    let watching = Watching::streaming(&source(&webcam), SMALL);
    let (code, answer) = watching.daemon.send("PUT", "/api/v1/calibration", &calibration([320, 240]));
    assert_eq!(code, 200, "{answer}");
    watching.daemon.wait_for("updates", |s| s["calibrated"] == true && s["frames"]["solved"].as_u64().unwrap() > 3);
    assert_eq!(watching.count("skipped"), 0);
    // On a busy host, the frame that was cut may be replaced by a newer one before anybody looks at it.
    let mut cut = 0;
    let status = loop {
        webcam.cut_a_frame();
        cut += 1;
        let captured = watching.count("captured");
        let status = watching.daemon.wait_for("later frames", |s| {
            s["frames"]["skipped"] != 0 || s["frames"]["captured"].as_u64().unwrap() > captured + 20
        });
        if status["frames"]["skipped"] != 0 {
            break status;
        }
        assert!(status["frames"]["dropped"].as_u64().unwrap() >= cut, "{cut} frames were cut: {status}");
    };
    let why = status["frames"]["last_skipped"].as_str().unwrap();
    assert!(why.starts_with(&webcam.node) && why.contains("broken JPEG"), "{why}");
    let solved = watching.count("solved");
    watching.daemon.wait_for("updates again", |s| s["frames"]["solved"].as_u64().unwrap() > solved + 5);
    let status = watching.status();
    let skipped = status["frames"]["skipped"].as_u64().unwrap();
    assert!((1..=cut).contains(&skipped), "{cut} frames were cut: {status}");
    assert_eq!(status["source"]["state"], "streaming");
    measured(&format!("truncated JPEG: {why}; {} frames per second solved", status["rate_hz"]["solved"]));
    drop(watching);
    webcam.unplug();
}
