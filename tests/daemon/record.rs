//! The real program records recordings, which needs no camera; tests/v4l2 records cameras.

use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use crate::common::{doorcam, grey_recording, manifest, run, stderr};
use doorcam_source::recording::Recording;

fn record(source: &str, out: &Path, more: &[&str]) -> Output {
    doorcam(&["record", "--source", source]).arg(out).args(more).output().expect("the program starts")
}

/// The updates of `reconstruct` for a recording, without the times, which differ from run to run.
fn updates(recording: &Path) -> Vec<serde_json::Value> {
    let output = run(&["reconstruct", recording.to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let update = |line: &str| {
        let mut update: serde_json::Value = serde_json::from_str(line).unwrap();
        update.as_object_mut().unwrap().remove("timing_ms");
        update
    };
    String::from_utf8(output.stdout).unwrap().lines().map(update).collect()
}

#[test]
fn a_copy_of_a_recording_reconstructs_to_the_same() {
    let dir = grey_recording(&manifest(), 8);
    let image = image::RgbImage::from_fn(16, 16, |x, _| image::Rgb(if x < 8 { [120; 3] } else { [150, 120, 120] }));
    for index in 5..8 {
        std::fs::remove_file(dir.path().join(format!("frames/{index:08}_left.jpg"))).unwrap();
        image.save(dir.path().join(format!("frames/{index:08}_left.png"))).unwrap();
    }
    std::fs::remove_file(dir.path().join("frames/00000003_right.jpg")).unwrap();
    let out = tempfile::tempdir().unwrap();
    let copy = out.path().join("copy");
    let output = record(&format!("replay:{},rate=max", dir.path().display()), &copy, &[]);
    let said = stderr(&output);
    assert_eq!((output.status.code(), output.stdout.len()), (Some(0), 0), "{said}");
    assert!(said.contains("recorded 7 frames in 0.7 s") && said.contains("1 lost, 0 skipped, 0 too fast"), "{said}");
    let (original, copied) = (updates(dir.path()), updates(&copy));
    assert_eq!(original.len(), 5);
    assert!(!original[3]["facets"].as_array().unwrap().is_empty());
    assert_eq!(original, copied);
    assert_eq!(Recording::open(dir.path()).unwrap().manifest, Recording::open(&copy).unwrap().manifest);
}

#[test]
fn limits_end_it_and_nothing_is_written_over() {
    let dir = grey_recording(&manifest(), 8);
    let source = format!("replay:{},loop,rate=max", dir.path().display());
    let out = tempfile::tempdir().unwrap();
    for (k, (limit, frames)) in
        [("--frames=30", 30), ("--seconds=2.05", 21), ("--max-bytes=20kB", 0)].iter().enumerate()
    {
        let path = out.path().join(k.to_string());
        let output = record(&source, &path, &[limit]);
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        let recording = Recording::open(&path).unwrap();
        let expected = if *frames > 0 { *frames } else { recording.frames.len() };
        assert_eq!(recording.frames.len(), expected, "{limit}");
        let bytes =
            |p: &Path| std::fs::read_dir(p).unwrap().flatten().map(|e| e.metadata().unwrap().len()).sum::<u64>();
        assert!(bytes(&path.join("frames")) < 20_000 || *frames > 0);
    }
    let path = out.path().join("0");
    let output = record(&source, &path, &["--frames=1"]);
    assert_eq!(output.status.code(), Some(1));
    let expected =
        format!("doorcam: {}: there is a recording already; remove it or name another directory\n", path.display());
    assert_eq!(stderr(&output), expected);
    assert_eq!(Recording::open(&path).unwrap().frames.len(), 30);
}

#[test]
fn an_interrupt_completes_the_recording() {
    let dir = grey_recording(&manifest(), 8);
    let out = tempfile::tempdir().unwrap();
    let path = out.path().join("interrupted");
    let source = format!("replay:{},loop", dir.path().display());
    let child = doorcam(&["record", "--source", &source]).arg(&path).stderr(Stdio::piped()).spawn().unwrap();
    let deadline = Instant::now() + Duration::from_secs(30);
    while !path.join("frames/00000004_right.jpg").exists() {
        assert!(Instant::now() < deadline);
        std::thread::sleep(Duration::from_millis(10));
    }
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    let output = child.wait_with_output().unwrap();
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(0), "{said}");
    let frames = Recording::open(&path).unwrap().frames.len();
    assert!(said.contains(&format!("recorded {frames} frames")), "{said}");
}

#[test]
fn what_cannot_be_recorded_is_said_in_one_line() {
    let out = tempfile::tempdir().unwrap();
    let path = out.path().join("new");
    let failure = |source: &str, more: &[&str]| {
        let output = record(source, &path, more);
        let said = stderr(&output);
        assert_eq!((output.status.code(), said.lines().count()), (Some(1), 1), "{said}");
        assert!(!path.exists());
        said
    };
    let camera = "v4l2:/dev/no-such-camera";
    assert!(failure(camera, &[]).contains("give --calibration FILE, or --uncalibrated"));
    assert!(
        failure(camera, &["--uncalibrated", "--seconds=3"]).contains("leaves nothing after the 3 s of the empty room")
    );
    let calibration = out.path().join("door.json");
    let file = calibration.to_str().unwrap();
    assert!(failure(camera, &["--calibration", file]).contains("door.json: No such file"));
    std::fs::write(&calibration, r#"{"size": [640, 480], "doorway": {"width_m": "wide"}}"#).unwrap();
    assert!(failure(camera, &["--calibration", file]).contains("door.json: doorway.width_m: invalid type"));
    std::fs::write(&calibration, r#"{"size": [640, 480], "doorway": {"width_m": 0.9}}"#).unwrap();
    assert!(failure(camera, &["--calibration", file]).contains("door.json: floor_points"));
    let dir = grey_recording(&manifest(), 3);
    let replay = format!("replay:{}", dir.path().display());
    assert!(failure(&replay, &["--uncalibrated"]).contains("a recording has its own calibration"));
    for wrong in ["--seconds=0", "--frames=0", "--max-bytes=much"] {
        assert_eq!(record(&replay, &path, &[wrong]).status.code(), Some(2), "{wrong}");
    }
}

#[cfg(feature = "v4l2")]
#[test]
fn an_absent_camera_is_waited_for_and_then_given_up() {
    let out = tempfile::tempdir().unwrap();
    let path = out.path().join("new");
    let start = Instant::now();
    let output = record("v4l2:/dev/no-such-camera", &path, &["--uncalibrated"]);
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!((10..100).contains(&start.elapsed().as_secs()), "{:?}", start.elapsed());
    let last = said.lines().last().unwrap();
    assert!(last.starts_with("doorcam: gave up after 10 s: /dev/no-such-camera: no such camera"), "{said}");
    assert!(!path.exists());
}
