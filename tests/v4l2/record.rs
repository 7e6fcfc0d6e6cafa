//! Recordings of cameras.

use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use doorcam::source::recording::Recording;

use crate::common::{doorcam, run, stderr};
use crate::guest::{SMALL, Webcam, config, measured, only_inside};

/// A camera that looks down on a doorway, whatever it really sees.
fn calibration(size: [usize; 2]) -> serde_json::Value {
    let [w, h] = size.map(|n| n as f64);
    let point = |u: f64, v: f64, x: f64, y: f64| serde_json::json!({"pixel": [u * w, v * h], "floor_m": [x, y]});
    serde_json::json!({
        "size": size,
        "doorway": {"width_m": 0.6, "wall_thickness_m": 0.1, "height_m": null},
        "floor_points": [
            point(0.1, 0.1, -0.5, -0.1), point(0.9, 0.1, 0.5, -0.1), point(0.9, 0.9, 0.5, -0.45), point(0.1, 0.9, -0.5, -0.45),
        ],
    })
}

fn recorder(
    source: &str,
    camera: &str,
    size: [usize; 2],
    out: &Path,
    more: &[&str],
) -> (Command, [tempfile::NamedTempFile; 2]) {
    let door = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(door.path(), calibration(size).to_string()).unwrap();
    let config = config(camera);
    let mut command = doorcam(&["record", "--source", source, "--empty-seconds", "2"]);
    command.arg("--calibration").arg(door.path()).arg("--config").arg(config.path()).arg(out).args(more);
    (command, [door, config])
}

/// Frames that `reconstruct` solves, and what it says.
fn reconstructed(recording: &Path) -> (usize, String) {
    let output = run(&["reconstruct", recording.to_str().unwrap()]);
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(0), "{said}");
    (String::from_utf8(output.stdout).unwrap().lines().count(), said)
}

fn last_line(output: &Output) -> String {
    stderr(output).lines().last().unwrap_or_default().to_owned()
}

#[test]
#[ignore = "runs in the virtual machine"]
fn guest_record_a_camera_without_loss() {
    only_inside!();
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("vivid");
    let (mut command, _files) = recorder("v4l2:/dev/video0", SMALL, [320, 180], &out, &["--seconds", "6"]);
    let output = command.output().unwrap();
    let summary = last_line(&output);
    measured(&summary);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    assert!(summary.contains("0 lost, 0 skipped, 0 too fast for the disk"), "{summary}");
    let recording = Recording::open(&out).unwrap();
    let frames = recording.frames.len();
    assert!((59..=61).contains(&frames), "{frames}");
    assert_eq!(recording.manifest.size, Some([320, 180]));
    let [first, end] = recording.manifest.background_frames.unwrap();
    assert!(first == 0 && (19..=21).contains(&end), "{end}");
    assert!(recording.frames.windows(2).all(|w| (w[1].seconds - w[0].seconds - 0.1).abs() < 0.09));
    let (solved, said) = reconstructed(&out);
    assert_eq!(solved, frames - end as usize, "{said}");
}

#[test]
#[ignore = "runs in the virtual machine"]
fn guest_record_until_the_disk_is_full() {
    only_inside!();
    let dir = tempfile::tempdir().unwrap();
    let disk = dir.path().join("disk");
    std::fs::create_dir(&disk).unwrap();
    let mount = Command::new("mount").args(["-t", "tmpfs", "-o", "size=2m", "tmpfs"]).arg(&disk).status().unwrap();
    assert!(mount.success());
    let out = disk.join("recording");
    let (mut command, _files) = recorder("v4l2:/dev/video0", SMALL, [320, 180], &out, &["--seconds", "60"]);
    let output = command.env("RUST_LOG", "error").output().unwrap();
    let said = stderr(&output);
    assert_eq!((output.status.code(), said.lines().count()), (Some(1), 1), "{said}");
    assert!(
        said.contains("no space left on the device (the ") && said.contains(" frames before that are safe in "),
        "{said}"
    );
    measured(said.trim());
    let recording = Recording::open(&out).unwrap();
    assert!(said.contains(&format!("the {} frames", recording.frames.len())), "{said}");
    let files = std::fs::read_dir(out.join("frames")).unwrap().count();
    assert_eq!(files, recording.frames.len(), "nothing half written is left");
    for entry in &recording.frames {
        let frame = doorcam::source::load(&recording, entry).unwrap();
        let doorcam::source::RawImages::Camera(bytes) = frame.images else { panic!() };
        doorcam::source::image::Image::decode(&bytes).unwrap();
    }
    assert!(Command::new("umount").arg(&disk).status().unwrap().success());
}

#[test]
#[ignore = "runs in the virtual machine"]
fn guest_record_a_webcam_with_a_frame_cut_short() {
    only_inside!();
    let webcam = Webcam::plug_in();
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("webcam");
    let camera = "size = [320, 240]\nfps = 10\nformats = [\"MJPG\"]";
    let source = format!("v4l2:{}", webcam.node);
    let (mut command, _files) = recorder(&source, camera, [320, 240], &out, &["--seconds", "6"]);
    let child = command.stderr(Stdio::piped()).spawn().unwrap();
    let deadline = Instant::now() + Duration::from_secs(60);
    // Behind the empty room.
    while !out.join("frames/00000030.jpg").exists() {
        assert!(Instant::now() < deadline);
        std::thread::sleep(Duration::from_millis(20));
    }
    webcam.cut_a_frame();
    let output = child.wait_with_output().unwrap();
    let summary = last_line(&output);
    measured(&summary);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    assert!(summary.contains("0 lost, 0 skipped, 0 too fast for the disk"), "{summary}");
    let frames = Recording::open(&out).unwrap().frames.len();
    let background = Recording::open(&out).unwrap().manifest.background_frames.unwrap()[1] as usize;
    let (solved, said) = reconstructed(&out);
    assert_eq!(solved, frames - background - 1, "exactly one frame is skipped: {said}");
    assert!(said.contains("1 frames skipped") && said.contains("broken JPEG"), "{said}");
    webcam.unplug();
}

#[test]
#[ignore = "runs in the virtual machine"]
fn guest_record_says_why_there_is_no_camera() {
    only_inside!();
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("none");
    let (mut command, _files) = recorder("v4l2:/dev/video7", SMALL, [320, 180], &out, &[]);
    let output = command.output().unwrap();
    assert_eq!(output.status.code(), Some(1));
    let said = last_line(&output);
    assert!(
        said.starts_with("doorcam: gave up after 10 s: /dev/video7: no such camera; there is /dev/video0"),
        "{said}"
    );
    // A size that the camera does not have.
    let (mut command, _files) = recorder("v4l2:/dev/video0", "fps = 10", [330, 180], &out, &[]);
    let output = command.output().unwrap();
    assert_eq!(output.status.code(), Some(1));
    let said = last_line(&output);
    assert!(said.ends_with("size is [330, 180], but the camera gives 320 x 180 pixels"), "{said}");
    assert!(!out.exists());
}
