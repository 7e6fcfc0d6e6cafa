use super::super::writer::tests::{frame, plan};
use super::*;
use crate::recording::Recording;

const JPEG: &[u8] = b"\xff\xd8 and so on";

fn wait(recorder: &Recorder) -> RecordingStatus {
    let start = Instant::now();
    while matches!(recorder.status().state, RecordingState::Recording | RecordingState::Finishing) {
        assert!(start.elapsed() < Duration::from_secs(100), "{:?}", recorder.status());
        std::thread::sleep(Duration::from_millis(5));
    }
    recorder.status()
}

#[test]
fn frames_are_written_until_it_is_stopped() {
    let dir = tempfile::tempdir().unwrap();
    let mut recorder = Recorder::start(dir.path(), plan(RecordingLimits::default())).unwrap();
    for k in 0..20 {
        if k == 5 {
            recorder.lost(3);
        }
        assert!(recorder.offer(&frame(f64::from(k) / 10.0, JPEG)));
    }
    let status = recorder.stop();
    assert_eq!((status.state, status.ended, status.error), (RecordingState::Complete, Some(End::Stopped), None));
    assert_eq!((status.written.frames, status.lost, status.overflowed), (20, 3, 0));
    assert!(!recorder.offer(&frame(9.0, JPEG)) && !recorder.put(&frame(9.0, JPEG)));
    let recording = Recording::open(dir.path()).unwrap();
    assert_eq!((recording.frames.len(), recording.manifest.background_frames), (23, Some([0, 8])));
}

#[test]
fn it_ends_at_its_limit_even_if_no_frame_comes() {
    let dir = tempfile::tempdir().unwrap();
    let limits = RecordingLimits { seconds: Some(0.2), ..RecordingLimits::default() };
    let recorder = Recorder::start(dir.path(), plan(limits)).unwrap();
    assert!(recorder.offer(&frame(0.0, JPEG)));
    let status = wait(&recorder);
    assert_eq!((status.ended, status.written.frames), (Some(End::Seconds), 1));
    assert!(!recorder.offer(&frame(0.1, JPEG)));
}

#[test]
fn an_error_ends_it_and_nothing_else() {
    let dir = tempfile::tempdir().unwrap();
    let mut recorder = Recorder::start(dir.path(), plan(RecordingLimits::default())).unwrap();
    recorder.put(&frame(0.0, JPEG));
    while recorder.status().written.frames < 1 {
        std::thread::yield_now();
    }
    let (frames, away) = (dir.path().join("frames"), dir.path().join("away"));
    std::fs::rename(&frames, &away).unwrap();
    recorder.offer(&frame(0.1, JPEG));
    let status = wait(&recorder);
    assert_eq!((status.state, status.ended), (RecordingState::Failed, None));
    assert!(status.error.unwrap().ends_with("frames/00000001.jpg: no such file or directory"));
    assert!(!recorder.offer(&frame(0.2, JPEG)));
    assert_eq!(recorder.stop().written.frames, 1);
    std::fs::rename(&away, &frames).unwrap();
    assert_eq!(Recording::open(dir.path()).unwrap().frames.len(), 1);
}

#[test]
fn what_does_not_fit_is_counted_and_missing() {
    let dir = tempfile::tempdir().unwrap();
    let mut recorder = Recorder::start(dir.path(), plan(RecordingLimits::default())).unwrap();
    // Raw pixels take longer to encode than to offer.
    let (pixels, matrix) = (crate::sensor::SensorPixels::Rgb24, crate::sensor::LumaMatrix::Bt601);
    let (width, height) = (2, 2);
    let format = crate::sensor::SensorFormat { pixels, width, height, stride: 6, full_range: true, matrix };
    let bytes = Arc::new(vec![7; QUEUE_BYTES / 8]);
    let raw = |seconds| RawFrame { images: RawImages::Sensor(format, Arc::clone(&bytes)), ..frame(seconds, JPEG) };
    for k in 0..400 {
        assert!(recorder.offer(&raw(f64::from(k))));
    }
    let status = recorder.stop();
    assert!(status.overflowed > 0, "{status:?}");
    assert_eq!(status.written.frames + status.overflowed, 400);
    let recording = Recording::open(dir.path()).unwrap();
    // Frames that overflowed after the last one written leave no gap.
    let frames = recording.frames.len() as u64;
    assert!(frames >= status.written.frames && frames <= 400);
}
