use std::sync::Arc;

use proptest::prelude::*;

use super::*;
use crate::Purpose;
use crate::recording::{Entry, Files, Layout, Recording};
use crate::sensor::{LumaMatrix, SensorFormat, SensorPixels};
use doorcam_core::geometry::Doorway;
use doorcam_core::optics::Transfer;

pub(in super::super) fn plan(limits: RecordingLimits) -> RecordingPlan {
    let point = |pixel, floor_m| doorcam_core::optics::FloorPoint { pixel, floor_m };
    let manifest = Manifest {
        fps: 10.0,
        layout: Layout::Camera,
        transfer: Transfer::Srgb,
        size: Some([2, 2]),
        doorway: Doorway { width_m: 0.9, wall_thickness_m: 0.1, height_m: None, leaf: None },
        floor_points: vec![
            point([0.0, 0.0], [-0.6, -0.1]),
            point([1.0, 0.0], [0.6, -0.1]),
            point([1.0, 1.0], [0.6, -0.5]),
            point([0.0, 1.0], [-0.6, -0.5]),
        ],
        lens: None,
        fov_m: None,
        background_frames: None,
        notes: "made by a test".into(),
    };
    RecordingPlan { manifest, empty_seconds: Some(0.5), calibrated: true, limits }
}

pub(in super::super) fn frame(seconds: f64, bytes: &[u8]) -> RawFrame {
    let images = RawImages::Camera(Arc::new(bytes.to_vec()));
    RawFrame { index: None, purpose: Purpose::Live, seconds, images, time: None, name: "camera".into() }
}

const JPEG: &[u8] = b"\xff\xd8 and so on";

fn seconds(recording: &Recording) -> Vec<(u64, f64)> {
    recording.frames.iter().map(|entry| (entry.index, entry.seconds)).collect()
}

#[test]
fn what_is_written_opens_at_any_moment() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("new/recording");
    let mut writer = RecordingWriter::create(&path, plan(RecordingLimits::default())).unwrap();
    for k in 0..9_u8 {
        let bytes = [JPEG, &[k]].concat();
        assert_eq!(writer.write(&frame(1000.0 + f64::from(k) * 0.125, &bytes)).unwrap(), None);
        // What remains if the program is killed here.
        let recording = Recording::open(&path).unwrap();
        assert_eq!(recording.frames.len(), usize::from(k) + 1);
        let Entry { index, seconds, files: Files::Camera(file) } = recording.frames.last().unwrap() else { panic!() };
        assert_eq!((*index, *seconds), (u64::from(k), f64::from(k) * 0.125));
        assert_eq!(fs::read(file).unwrap(), bytes);
    }
    // Frames 0 to 3 came within the half second of the empty room.
    let interrupted = Recording::open(&path).unwrap();
    assert_eq!(interrupted.manifest.background_frames, Some([0, 4]));
    let written = writer.finish().unwrap();
    let finished = Recording::open(&path).unwrap();
    assert_eq!(finished, interrupted);
    let on_disk = |directory: &Path| -> u64 {
        fs::read_dir(directory)
            .unwrap()
            .flatten()
            .filter(|e| e.path().is_file())
            .map(|e| e.metadata().unwrap().len())
            .sum()
    };
    assert_eq!(written.bytes, on_disk(&path) + on_disk(&path.join("frames")));
    assert_eq!((written.frames, written.seconds, written.skipped), (9, 1.0, 0));
}

#[test]
fn a_recording_is_never_written_over() {
    let dir = tempfile::tempdir().unwrap();
    let mut writer = RecordingWriter::create(dir.path(), plan(RecordingLimits::default())).unwrap();
    writer.write(&frame(0.0, JPEG)).unwrap();
    let refused = RecordingWriter::create(dir.path(), plan(RecordingLimits::default())).unwrap_err().to_string();
    let path = dir.path().display();
    assert_eq!(refused, format!("{path}: there is a recording already; remove it or name another directory"));
    // Frames alone are a recording that lost its manifest.
    fs::remove_file(dir.path().join("recording.json")).unwrap();
    fs::remove_file(dir.path().join("timestamps.csv")).unwrap();
    RecordingWriter::create(dir.path(), plan(RecordingLimits::default())).unwrap_err();
}

#[test]
fn limits_end_it() {
    let run = |limits: RecordingLimits| {
        let dir = tempfile::tempdir().unwrap();
        let mut writer = RecordingWriter::create(dir.path(), plan(limits)).unwrap();
        let end = (0..100).find_map(|k| writer.write(&frame(5.0 + f64::from(k) / 10.0, JPEG)).unwrap());
        (end, writer.finish().unwrap())
    };
    let (end, written) = run(RecordingLimits { seconds: Some(2.0), ..RecordingLimits::default() });
    assert_eq!((end, written.frames), (Some(End::Seconds), 20));
    let (end, written) = run(RecordingLimits { frames: Some(7), ..RecordingLimits::default() });
    assert_eq!((end, written.frames), (Some(End::Frames), 7));
    let (end, written) = run(RecordingLimits { bytes: Some(2000), ..RecordingLimits::default() });
    assert_eq!(end, Some(End::Bytes));
    assert!(written.bytes <= 2000 && written.bytes > 1950, "{}", written.bytes);
}

#[test]
fn what_is_missing_shows_as_missing() {
    let dir = tempfile::tempdir().unwrap();
    let mut writer = RecordingWriter::create(dir.path(), plan(RecordingLimits::default())).unwrap();
    writer.write(&frame(0.0, JPEG)).unwrap();
    writer.pass_over(2);
    writer.write(&frame(0.3, JPEG)).unwrap();
    // Raw pixels of another size, as after a change of format.
    let (pixels, matrix) = (SensorPixels::Grey, LumaMatrix::Bt601);
    let format = SensorFormat { pixels, width: 4, height: 2, stride: 4, full_range: true, matrix };
    let images = RawImages::Sensor(format, Arc::new(vec![0; 8]));
    writer.write(&RawFrame { images, ..frame(0.4, JPEG) }).unwrap();
    writer.write(&frame(0.5, JPEG)).unwrap();
    let written = writer.finish().unwrap();
    assert_eq!((written.frames, written.skipped), (3, 1));
    assert_eq!(written.last_skipped.unwrap(), "camera: has 4 x 2 pixels, the recording 2 x 2");
    let recording = Recording::open(dir.path()).unwrap();
    let missing: Vec<u64> =
        recording.frames.iter().filter(|e| matches!(e.files, Files::Missing(_))).map(|e| e.index).collect();
    assert_eq!((recording.frames.len(), missing), (6, vec![1, 2, 4]));
}

#[test]
fn a_recording_of_a_recording_keeps_its_numbers_and_times() {
    let dir = tempfile::tempdir().unwrap();
    let mut original = plan(RecordingLimits::default());
    (original.empty_seconds, original.manifest.background_frames) = (None, Some([3, 5]));
    let mut writer = RecordingWriter::create(dir.path(), original).unwrap();
    let round = [(3, 0.1 + 0.2), (4, 0.41), (7, 0.9)];
    for (index, seconds) in round.into_iter().chain(round) {
        writer.write(&RawFrame { index: Some(index), ..frame(seconds, JPEG) }).unwrap();
    }
    writer.finish().unwrap();
    let recording = Recording::open(dir.path()).unwrap();
    assert_eq!(recording.manifest.background_frames, Some([3, 5]));
    let mut times = seconds(&recording);
    times.retain(|&(index, _)| [3, 4, 7, 8, 9, 10].contains(&index));
    // The second round continues where the first one ended.
    assert_eq!(times[..4], [(3, 0.1 + 0.2), (4, 0.41), (7, 0.9), (8, 1.0)]);
    assert!((times[4].1 - 1.11).abs() < 1e-9 && (times[5].1 - 1.6).abs() < 1e-9, "{times:?}");
}

#[test]
fn a_write_error_names_the_file_and_leaves_the_frames_before_it() {
    let dir = tempfile::tempdir().unwrap();
    let mut writer = RecordingWriter::create(dir.path(), plan(RecordingLimits::default())).unwrap();
    writer.write(&frame(0.0, JPEG)).unwrap();
    let (frames, away) = (dir.path().join("frames"), dir.path().join("away"));
    fs::rename(&frames, &away).unwrap();
    let error = writer.write(&frame(0.1, JPEG)).unwrap_err().to_string();
    assert_eq!(error, format!("{}: no such file or directory", frames.join("00000001.jpg").display()));
    fs::rename(&away, &frames).unwrap();
    assert_eq!(seconds(&Recording::open(dir.path()).unwrap()), [(0, 0.0)]);
    assert_eq!(fs::read_to_string(dir.path().join("timestamps.csv")).unwrap(), "index,seconds\n0,0\n");
}

#[test]
fn without_a_calibration_it_opens_once_someone_puts_it_in() {
    let dir = tempfile::tempdir().unwrap();
    let mut uncalibrated = plan(RecordingLimits::default());
    uncalibrated.calibrated = false;
    let mut writer = RecordingWriter::create(dir.path(), uncalibrated).unwrap();
    writer.write(&frame(0.0, JPEG)).unwrap();
    writer.finish().unwrap();
    let refused = Recording::open(dir.path()).unwrap_err().to_string();
    assert!(refused.contains("doorway and floor_points"), "{refused}");
    let file = dir.path().join("recording.json");
    let mut manifest: serde_json::Value = serde_json::from_str(&fs::read_to_string(&file).unwrap()).unwrap();
    let calibration = serde_json::to_value(plan(RecordingLimits::default()).manifest).unwrap();
    for key in ["doorway", "floor_points"] {
        manifest[key] = calibration[key].clone();
    }
    fs::write(&file, manifest.to_string()).unwrap();
    assert_eq!(Recording::open(dir.path()).unwrap().manifest.background_frames, Some([0, 1]));
}

proptest! {
    /// A power cut may lose the end of any file: the recording still opens.
    #[test]
    fn half_a_file_of_times_is_read(cut in 0usize..200, background in 0u8..2) {
        let dir = tempfile::tempdir().unwrap();
        let mut plan = plan(RecordingLimits::default());
        plan.empty_seconds = (background == 1).then_some(0.5);
        let mut writer = RecordingWriter::create(dir.path(), plan).unwrap();
        for k in 0..12 {
            writer.write(&frame(f64::from(k) * 0.107, JPEG)).unwrap();
        }
        std::mem::forget(writer);
        let times = dir.path().join("timestamps.csv");
        let whole = fs::read(&times).unwrap();
        fs::write(&times, &whole[..cut.min(whole.len())]).unwrap();
        // And the frame that was being written.
        fs::write(dir.path().join("frames/.00000012.jpg.part"), b"\xff").unwrap();
        let recording = Recording::open(dir.path()).unwrap();
        prop_assert_eq!(recording.frames.len(), 12);
    }
}
