//! The kernel's test driver: rates, formats, injected faults, unplugging.

use std::fs;
use std::process::Command;
use std::time::Duration;

use crate::common::{Daemon, doorcam, run};
use crate::guest::{
    SMALL, SOON_S, Watching, configured, hold, inject, measured, only_inside, set_control, unless_frozen, vivid_is,
};

const CAMERA: &str = "v4l2:/dev/video0";

#[test]
#[ignore = "runs in the virtual machine"]
fn guest_devices_lists_the_cameras() {
    only_inside!();
    let output = run(&["devices", "--json"]);
    assert_eq!(output.status.code(), Some(0));
    let cameras: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let camera = |node: &str| cameras.as_array().unwrap().iter().find(|c| c["node"] == node).unwrap().clone();
    for node in ["/dev/video0", "/dev/video1"] {
        let camera = camera(node);
        assert_eq!((&camera["driver"], &camera["error"]), (&"vivid".into(), &serde_json::Value::Null), "{camera}");
        let formats = camera["formats"].as_array().unwrap();
        let yuyv = formats.iter().find(|f| f["format"] == "YUYV").unwrap();
        assert!(yuyv["usable"] == true && yuyv["sizes"].as_array().unwrap().len() > 3, "{yuyv}");
        assert!(formats.iter().any(|f| f["usable"] == false));
        assert!(camera["controls"].as_array().unwrap().iter().any(|c| c["name"] == "Brightness" && c["value"] == 128));
    }
}

#[test]
#[ignore = "runs in the virtual machine"]
fn guest_every_frame_of_a_minute_is_captured() {
    only_inside!();
    let watching = Watching::streaming(CAMERA, SMALL);
    unless_frozen(|| {
        let before = watching.status();
        std::thread::sleep(Duration::from_secs(60));
        let after = watching.status();
        let at = |status: &serde_json::Value, path: &str| status.pointer(path).unwrap().as_f64().unwrap();
        let grew = |path: &str| at(&after, path) - at(&before, path);
        let granted = at(&after, "/source/granted/fps");
        assert_eq!((granted, grew("/frames/skipped")), (10.0, 0.0), "{after}");
        let (lost, dropped) = (grew("/frames/lost"), grew("/frames/dropped"));
        // Superseded frames were captured too.
        let rate = (grew("/frames/captured") + dropped) / grew("/uptime_s");
        let found =
            format!("{rate:.3} of {granted} frames per second over a minute, {lost} lost, {dropped} superseded");
        if lost > 0.0 {
            return Err(found);
        }
        measured(&found);
        assert!((rate / granted - 1.0).abs() < 0.01, "{after}");
        Ok(())
    });
}

#[test]
#[ignore = "runs in the virtual machine"]
fn guest_the_format_is_what_the_driver_really_grants() {
    only_inside!();
    for (asked, granted) in
        [("\"NV12\"", "NV12"), ("\"RGB3\"", "RGB3"), ("\"GREY\"", "GREY"), ("\"MJPG\", \"YUYV\"", "YUYV")]
    {
        let watching = Watching::streaming(CAMERA, &format!("{SMALL}\nformats = [{asked}]"));
        let status = watching.status();
        let got = &status["source"]["granted"];
        assert_eq!((&got["format"], &got["size"]), (&granted.into(), &serde_json::json!([320, 180])), "{status}");
        let (code, picture) = watching.daemon.get("/api/v1/frame.jpg");
        let picture = image::load_from_memory(&picture).unwrap();
        assert_eq!((code, picture.width(), picture.height()), (200, 320, 180), "{asked}");
    }
    // The driver answers a request for MJPG with YUYV.
    let watching = Watching::start(CAMERA, &format!("{SMALL}\nformats = [\"MJPG\"]"));
    let (_, status) = watching.until("backing-off");
    let error = status["source"]["error"].as_str().unwrap();
    assert!(error.starts_with("/dev/video0: the camera has none of the formats MJPG"), "{error}");
    assert_eq!(status["source"]["granted"], serde_json::Value::Null);
}

#[test]
#[ignore = "runs in the virtual machine"]
fn guest_lost_and_damaged_frames_are_counted() {
    only_inside!();
    let watching = Watching::streaming(CAMERA, SMALL);
    set_control("/dev/video0", inject::DROPPED_PERCENT, 30);
    let status = watching.daemon.wait_for("lost frames", |s| s["frames"]["lost"].as_u64().unwrap() >= 3);
    set_control("/dev/video0", inject::DROPPED_PERCENT, 0);
    assert_eq!(status["frames"]["skipped"], 0);
    set_control("/dev/video0", inject::DAMAGED_BUFFER, 1);
    let status = watching.daemon.wait_for("a damaged frame", |s| s["frames"]["skipped"] != 0);
    assert_eq!(status["frames"]["last_skipped"], "/dev/video0: the driver marks the frame as damaged");
    watching.until_frames();
    std::thread::sleep(Duration::from_secs(1));
    let status = watching.status();
    assert_eq!(
        (&status["frames"]["skipped"], &status["source"]["state"]),
        (&1.into(), &"streaming".into()),
        "{status}"
    );
    measured(&format!("{} of the deliberately dropped frames counted as lost, 1 damaged", status["frames"]["lost"]));
}

#[test]
#[ignore = "runs in the virtual machine"]
fn guest_a_camera_that_fails_is_opened_again() {
    only_inside!();
    let watching = Watching::streaming(CAMERA, SMALL);
    set_control("/dev/video0", inject::FATAL_ERROR, 1);
    let (told, status) = watching.until("backing-off");
    let resumed = told + watching.until_frames();
    measured(&format!("fatal error: reported after {told:.2} s, frames after {resumed:.2} s"));
    assert!(told < SOON_S && resumed < SOON_S, "{status}");
    // The same when the restart fails at first.
    set_control("/dev/video0", inject::STREAMON_ERROR, 1);
    set_control("/dev/video0", inject::FATAL_ERROR, 1);
    watching.until("backing-off");
    let resumed = watching.until_frames();
    measured(&format!("fatal error and a failed restart: frames after {resumed:.2} s"));
    assert!(resumed < SOON_S);
    // Disconnected for the driver, although its node still exists.
    set_control("/dev/video0", inject::DISCONNECT, 1);
    let (told, status) = watching.until("lost");
    measured(&format!("disconnected: reported after {told:.2} s"));
    assert!(told < SOON_S, "{status}");
    vivid_is(false);
    vivid_is(true);
    assert!(watching.until_frames() < SOON_S);
}

#[test]
#[ignore = "runs in the virtual machine"]
fn guest_fifty_times_unplugged_and_plugged_in() {
    only_inside!();
    let watching = Watching::streaming(CAMERA, SMALL);
    let (mut told, mut resumed, mut flat) = (Vec::new(), Vec::new(), Vec::new());
    for _ in 0..50 {
        vivid_is(false);
        let (after, status) = watching.until("lost");
        told.push(after);
        let error = status["source"]["error"].as_str().unwrap();
        assert!(error.contains("unplugged; waiting for it to come back"), "{error}");
        vivid_is(true);
        resumed.push(watching.until_frames());
        flat.push(watching.resources());
    }
    let most = |times: &[f64]| times.iter().copied().fold(0.0, f64::max);
    let mean = |times: &[f64]| times.iter().sum::<f64>() / times.len() as f64;
    let ([rss, files], [rss_end, files_end]) = (flat[9], flat[49]);
    measured(&format!(
        "50 times unplugged: reported after {:.2} s (at most {:.2}), frames {:.2} s after the return (at most {:.2}); \
        memory {rss} kB after 10 and {rss_end} kB after 50, descriptors {files} and {files_end}",
        mean(&told),
        most(&told),
        mean(&resumed),
        most(&resumed)
    ));
    assert!(most(&told) < SOON_S && most(&resumed) < SOON_S);
    assert!(files_end <= files + 1 && rss_end < rss + 2048, "{flat:?}");
}

#[test]
#[ignore = "runs in the virtual machine"]
fn guest_a_camera_in_use_is_waited_for() {
    only_inside!();
    let mut first = Watching::streaming(CAMERA, SMALL);
    let second = Watching::start(CAMERA, SMALL);
    let (told, status) = second.until("backing-off");
    let error = status["source"]["error"].as_str().unwrap();
    assert!(error.starts_with("/dev/video0: in use by another program"), "{error}");
    // Long enough for the retry interval to grow.
    std::thread::sleep(Duration::from_secs(5));
    first.daemon.terminate();
    let resumed = second.until_frames();
    measured(&format!("in use: reported after {told:.2} s, frames {resumed:.2} s after it was released"));
    assert!(told < SOON_S && resumed < SOON_S);
}

#[test]
#[ignore = "runs in the virtual machine"]
fn guest_who_may_not_open_it_is_told_the_group() {
    only_inside!();
    let permit = |mode: &str| {
        assert!(Command::new("chown").args(["root:video", "/dev/video0"]).status().unwrap().success());
        assert!(Command::new("chmod").args([mode, "/dev/video0"]).status().unwrap().success());
    };
    permit("0600");
    let (kept, config) = configured(SMALL);
    assert!(Command::new("chmod").args(["-R", "a+rwX"]).arg(kept.path()).status().unwrap().success());
    let program = doorcam::<&str>(&[]);
    let mut command = Command::new("setpriv");
    command.args(["--reuid=65534", "--regid=65534", "--clear-groups", "--"]).arg(program.get_program());
    command.args(["serve", "--source", CAMERA, "--listen", "127.0.0.1:0", "--config"]).arg(config);
    let daemon = Daemon::spawn(command);
    let status = daemon.wait_for("a refusal", |s| s["source"]["state"] == "backing-off");
    let error = "/dev/video0: permission denied; join the group video (sudo usermod -aG video USER) and log in again";
    assert_eq!(status["source"]["error"], error);
    permit("0666");
    daemon.wait_for("frames", |s| s["source"]["state"] == "streaming");
    permit("0600");
}

#[test]
#[ignore = "runs in the virtual machine"]
fn guest_a_camera_is_found_again_under_another_number() {
    only_inside!();
    let watching = Watching::streaming(CAMERA, SMALL);
    let held = hold("/dev/video0");
    vivid_is(false);
    watching.until("lost");
    vivid_is(true);
    let resumed = watching.until_frames();
    let node = watching.status()["source"]["granted"]["node"].as_str().unwrap().to_owned();
    measured(&format!("back as {node}: frames after {resumed:.2} s"));
    assert_ne!(node, "/dev/video0");
    assert!(resumed < SOON_S);
    let name = fs::read_to_string(format!("/sys/class/video4linux/{}/name", node.trim_start_matches("/dev/"))).unwrap();
    assert_eq!(name.trim(), "vivid-000-vid-cap");
    drop(watching);
    drop(held);
    vivid_is(false);
    vivid_is(true);
    assert!(fs::exists("/dev/video0").unwrap());
}
