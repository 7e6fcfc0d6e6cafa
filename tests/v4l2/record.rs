//! Recordings of cameras.

use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use doorcam_source::recording::{Entry, Files, Recording};

use crate::common::{doorcam, run, stderr};
use crate::guest::{SMALL, Webcam, calibration, configured, hand_out, measured, only_inside, unless_frozen, vivid_is};

fn recorder(source: &str, camera: &str, size: [usize; 2], out: &Path, more: &[&str]) -> (Command, tempfile::TempDir) {
    let (kept, config) = configured(camera);
    let door = kept.path().join("door.json");
    std::fs::write(&door, calibration(size).to_string()).unwrap();
    let mut command = doorcam(&["record", "--source", source, "--empty-seconds", "2"]);
    command.arg("--calibration").arg(door).arg("--config").arg(config).arg(out).args(more);
    (command, kept)
}

/// Reconstructs on the host what the scenarios copied out of the virtual machine.
pub fn reconstruct_what_was_recorded(recordings: &Path) {
    for (name, broken) in [("vivid", 0), ("webcam", 1)] {
        let path = recordings.join(name);
        let recording = Recording::open(&path).unwrap();
        let watched = &recording.frames[recording.manifest.background_frames.unwrap()[1] as usize..];
        let skipped = missing(watched) + broken;
        let output = run(&["reconstruct", path.to_str().unwrap()]);
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(0), "{said}");
        let solved = String::from_utf8(output.stdout).unwrap().lines().count();
        assert_eq!(solved, watched.len() - skipped, "{name}: {said}");
        assert_eq!(said.contains("broken JPEG"), broken == 1, "{said}");
        assert!(skipped == 0 || said.contains("frames skipped"), "{said}");
    }
}

fn wait_for_file(file: &Path) {
    let deadline = Instant::now() + Duration::from_secs(600);
    while !file.exists() {
        assert!(Instant::now() < deadline, "waited in vain for {}", file.display());
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// Checks the summary of a recording with no missing frames.
fn lossless(output: &Output) -> Result<(), String> {
    let summary = last_line(output);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(output));
    assert!(summary.contains("0 skipped, 0 too fast for the disk"), "{summary}");
    if !summary.contains("; 0 lost") {
        return Err(summary);
    }
    measured(&summary);
    Ok(())
}

fn last_line(output: &Output) -> String {
    stderr(output).lines().last().unwrap_or_default().to_owned()
}

#[test]
#[ignore = "runs in the virtual machine"]
fn guest_record_every_frame_of_a_camera_or_count_it() {
    only_inside!();
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("vivid");
    let (mut command, _kept) = recorder("v4l2:/dev/video0", SMALL, [320, 180], &out, &["--seconds", "6"]);
    let output = command.output().unwrap();
    let summary = last_line(&output);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    assert!(summary.contains("0 skipped, 0 too fast for the disk"), "{summary}");
    // A busy host may freeze the virtual machine for longer than a frame takes; the driver then drops frames.
    let (_, lost) = summary.split_once("; ").unwrap();
    let lost: usize = lost.split(' ').next().unwrap().parse().unwrap();
    let recording = Recording::open(&out).unwrap();
    let (frames, missing) = (recording.frames.len(), missing(&recording.frames));
    // Frames that are lost at the very end have no entry.
    assert!(missing <= lost && frames <= 61 && frames + lost - missing >= 58, "{frames} {missing}: {summary}");
    assert_eq!(recording.manifest.size, Some([320, 180]));
    let [first, end] = recording.manifest.background_frames.unwrap();
    assert!(first == 0 && (19..=21).contains(&end) || lost > 0, "{end}");
    let apart = |w: &[Entry]| w[1].seconds - w[0].seconds;
    assert!(recording.frames.windows(2).all(|w| (apart(w) - 0.1).abs() < 0.09 || lost > 0 && apart(w) > 0.0));
    measured(&summary);
    hand_out(&out);
}

fn missing(frames: &[Entry]) -> usize {
    frames.iter().filter(|entry| matches!(entry.files, Files::Missing(_))).count()
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
    let (mut command, _kept) = recorder("v4l2:/dev/video0", SMALL, [320, 180], &out, &["--seconds", "60"]);
    let output = command.env("RUST_LOG", "error").output().unwrap();
    let said = stderr(&output);
    assert_eq!((output.status.code(), said.lines().count()), (Some(1), 1), "{said}");
    assert!(
        said.contains("no space left on the device (the ") && said.contains(" frames before that are safe in "),
        "{said}"
    );
    measured(said.trim());
    let recording = Recording::open(&out).unwrap();
    let there: Vec<_> = recording.frames.iter().filter(|e| !matches!(e.files, Files::Missing(_))).collect();
    assert!(said.contains(&format!("the {} frames", there.len())), "{said}");
    let files = std::fs::read_dir(out.join("frames")).unwrap().count();
    assert_eq!(files, there.len(), "no partly written file is left");
    for entry in there {
        let frame = doorcam_source::load(&recording, entry).unwrap();
        let doorcam_source::RawImages::Camera(bytes) = frame.images else { panic!() };
        doorcam_source::image::decode(&bytes).unwrap();
    }
    assert!(Command::new("umount").arg(&disk).status().unwrap().success());
}

#[test]
#[ignore = "runs in the virtual machine"]
fn guest_record_a_webcam_with_a_frame_cut_short() {
    only_inside!();
    let webcam = Webcam::plug_in();
    let camera = "size = [320, 240]\nfps = 10\nformats = [\"MJPG\"]";
    let source = format!("v4l2:{}", webcam.node);
    unless_frozen(|| {
        let dir = tempfile::tempdir().unwrap();
        let out = dir.path().join("webcam");
        // A number of frames, not of seconds: a slow machine must not end before the frame that is cut.
        let (mut command, _kept) = recorder(&source, camera, [320, 240], &out, &["--frames", "60"]);
        let child = command.stderr(Stdio::piped()).spawn().unwrap();
        // After the frames of the empty room.
        wait_for_file(&out.join("frames/00000030.jpg"));
        webcam.cut_a_frame();
        lossless(&child.wait_with_output().unwrap())?;
        hand_out(&out);
        Ok(())
    });
    webcam.unplug();
}

#[test]
#[ignore = "runs in the virtual machine"]
fn guest_record_refuses_another_size_than_the_calibrations() {
    only_inside!();
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("none");
    let (mut command, _kept) = recorder("v4l2:/dev/video0", "fps = 10", [330, 180], &out, &[]);
    let output = command.output().unwrap();
    assert_eq!(output.status.code(), Some(1));
    let said = last_line(&output);
    assert!(said.ends_with("size is [330, 180], but the camera gives 320 x 180 pixels"), "{said}");
    assert!(!out.exists());
}

#[test]
#[ignore = "runs in the virtual machine"]
fn guest_record_goes_on_when_the_camera_is_back() {
    only_inside!();
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("vivid");
    // A number of frames, not of seconds: a slow machine must not end before the camera goes.
    let (mut command, _kept) = recorder("v4l2:/dev/video0", SMALL, [320, 180], &out, &["--frames", "60"]);
    let child = command.stderr(Stdio::piped()).spawn().unwrap();
    wait_for_file(&out.join("frames/00000025.png"));
    vivid_is(false);
    std::thread::sleep(Duration::from_secs(1));
    vivid_is(true);
    let output = child.wait_with_output().unwrap();
    let said = stderr(&output);
    measured(&last_line(&output));
    assert_eq!(output.status.code(), Some(0), "{said}");
    assert!(said.contains("unplugged; waiting for it to come back"), "{said}");
    let recording = Recording::open(&out).unwrap();
    let pause = recording.frames.windows(2).map(|w| w[1].seconds - w[0].seconds).fold(0.0, f64::max);
    assert!(pause > 0.9, "the recording's clock goes on while the camera is away: {pause}");
    assert!(recording.frames.len() >= 60, "{}", recording.frames.len());
}

#[test]
#[ignore = "runs in the virtual machine"]
fn guest_record_ends_when_the_camera_comes_back_with_another_size() {
    only_inside!();
    let webcam = Webcam::plug_in();
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("webcam");
    let camera = "size = [320, 240]\nfps = 10\nformats = [\"MJPG\"]";
    let source = format!("v4l2:{}", webcam.node);
    let (mut command, _kept) = recorder(&source, camera, [320, 240], &out, &[]);
    let child = command.stderr(Stdio::piped()).spawn().unwrap();
    wait_for_file(&out.join("frames/00000005.jpg"));
    webcam.unplug();
    let webcam = Webcam::plug_in_with_size([160, 120]);
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(1));
    let said = last_line(&output);
    assert!(said.contains("the camera gives 160 x 120 pixels now, the recording has 320 x 240 ("), "{said}");
    let recording = Recording::open(&out).unwrap();
    assert!(recording.frames.len() > 5);
    webcam.unplug();
}
