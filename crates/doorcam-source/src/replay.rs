use std::collections::VecDeque;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use super::recording::{Entry, Files, Recording};
use super::{Clock, Condition, Purpose, RawFrame, RawImages, SkipKind, SkippedFrame, Source, SourceEvent, SourceState};
use crate::files;
use crate::orientation::Orientation;

/// How fast a recording is replayed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pace {
    /// At the times of the recording, except for frames of the empty room at its beginning: in the first round, they
    /// come as fast as they can be learned.
    Recorded,
    /// Every frame, as fast as they can be solved.
    Max,
}

/// How to replay.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ReplayOptions {
    /// How fast.
    pub pace: Pace,
    /// Whether to start over at the end.
    pub looped: bool,
}

/// Replays the frames of a recording from its files.
pub struct Replay<C> {
    recording: Arc<Recording>,
    options: ReplayOptions,
    clock: C,
    next: usize,
    /// Time on the clock at which this round's frame at `begin_s` is due.
    round_start: Duration,
    /// Seconds from the recording's first frame to the first one that is paced.
    begin_s: f64,
    /// Whether all frames so far were of the empty room. Frames that are only learned from are not paced.
    learning: bool,
    /// Whether this is the first round, in which frames of the empty room are learned from.
    first_round: bool,
    /// Whether the last frame was one that is learned from.
    given: bool,
    /// Frames in a row that were not there or could not be read.
    failed: usize,
    /// Those of them that should have been there.
    unread: usize,
    /// Why frames no longer come, once that has been told.
    lost: Option<String>,
    /// Events that arose together with the one returned last.
    pending: VecDeque<SourceEvent>,
}

/// So many frames in a row that cannot be read mean that the place they are in is at fault.
const LOST: usize = 5;

/// While no file can be read: shortest and longest time between two attempts, in seconds. Frames that cannot be read
/// take no time by themselves.
const ATTEMPT_S: [f64; 2] = [0.05, 1.0];

impl<C: Clock> Replay<C> {
    /// Starts now, at the first frame.
    pub fn new(recording: Arc<Recording>, options: ReplayOptions, clock: C) -> Self {
        let round_start = clock.now();
        Self {
            recording,
            options,
            clock,
            next: 0,
            round_start,
            begin_s: 0.0,
            learning: true,
            first_round: true,
            given: false,
            failed: 0,
            unread: 0,
            lost: None,
            pending: VecDeque::new(),
        }
    }

    /// Time from the first frame to one period after the last.
    fn round_length(&self) -> f64 {
        let frames = &self.recording.frames;
        let span = frames.last().map_or(0.0, |e| e.seconds) - frames.first().map_or(0.0, |e| e.seconds);
        span.max(0.0) + 1.0 / self.recording.manifest.fps
    }

    /// Takes note of a frame that was read or could not be. Waits if none can be.
    fn report(&mut self, frame: Result<RawFrame, SkippedFrame>) -> SourceEvent {
        match frame {
            Ok(frame) => {
                (self.failed, self.unread) = (0, 0);
                if self.lost.take().is_none() {
                    return SourceEvent::Frame(frame);
                }
                self.pending.push_back(SourceEvent::Frame(frame));
                condition(SourceState::Streaming, None)
            }
            Err(skipped) => {
                self.failed += 1;
                self.unread += usize::from(skipped.kind != SkipKind::Absent);
                // Of numbers without a file there may be many, but not a whole round.
                if self.unread >= LOST || self.failed >= self.recording.frames.len() {
                    if self.lost.is_none() {
                        let reason = self.why_lost(&skipped);
                        self.lost = Some(reason.clone());
                        self.pending.push_back(condition(SourceState::Lost, Some(reason)));
                    }
                    let wait = (1.0 / self.recording.manifest.fps).clamp(ATTEMPT_S[0], ATTEMPT_S[1]);
                    self.clock.wait_until(self.clock.now() + Duration::from_secs_f64(wait));
                }
                SourceEvent::Skipped(skipped)
            }
        }
    }

    fn why_lost(&self, last: &SkippedFrame) -> String {
        let folder = self.recording.path.join("frames");
        match std::fs::read_dir(&folder) {
            Err(e) => format!("{}: {}", files::shown(&folder), files::words(&e)),
            Ok(_) => format!("{}: no frame can be read any more ({last})", files::shown(&self.recording.path)),
        }
    }
}

fn condition(state: SourceState, reason: Option<String>) -> SourceEvent {
    SourceEvent::Condition(Condition { state, reason, granted: None })
}

impl<C: Clock> Source for Replay<C> {
    fn next(&mut self) -> Option<SourceEvent> {
        if let Some(event) = self.pending.pop_front() {
            return Some(event);
        }
        if self.next == self.recording.frames.len() {
            if !self.options.looped {
                // An end with frames that could not be read is not the recording's end.
                return self.lost.take().map(|reason| condition(SourceState::Failed, Some(reason)));
            }
            self.next = 0;
            (self.first_round, self.learning) = (false, false);
            self.round_start += Duration::from_secs_f64((self.round_length() - self.begin_s).max(0.0));
            self.begin_s = 0.0;
        }
        let entry = &self.recording.frames[self.next];
        self.next += 1;
        let first = self.recording.frames[0].seconds;
        let offset = (entry.seconds - first).max(0.0);
        let frame = load(&self.recording, entry);
        let purpose = self.recording.purpose(entry.index);
        self.given = self.first_round && purpose == Purpose::Background;
        if self.learning && purpose != Purpose::Background {
            self.learning = false;
            (self.round_start, self.begin_s) = (self.clock.now(), offset);
        }
        if self.options.pace == Pace::Recorded && !self.learning {
            self.clock.wait_until(self.round_start + Duration::from_secs_f64((offset - self.begin_s).max(0.0)));
        }
        Some(self.report(frame))
    }

    fn lossless(&self) -> bool {
        self.options.pace == Pace::Max || self.given
    }
}

/// Reads a frame's image files.
///
/// # Errors
/// If a file is missing from the sequence or cannot be read.
pub fn load(recording: &Recording, entry: &Entry) -> Result<RawFrame, SkippedFrame> {
    let relative = |path: &Path| files::shown(path.strip_prefix(&recording.path).unwrap_or(path));
    let read = |path: &Path| -> Result<Arc<Vec<u8>>, SkippedFrame> {
        let bytes = files::read(path, recording.image_kind());
        let mut bytes = bytes.map_err(|e| SkippedFrame::unread(relative(path), &e))?;
        let (orientation, expected) = (Orientation::of(&bytes), recording.orientation);
        if orientation != expected {
            let reason = format!("EXIF orientation {orientation}, expected {expected} as the first image has");
            return Err(SkippedFrame::new(relative(path), SkipKind::Unfit, reason));
        }
        if orientation != Orientation::default() {
            // Whoever is shown the frame must see it as it is measured.
            Orientation::reset(&mut bytes);
        }
        Ok(Arc::new(bytes))
    };
    let (images, name) = match &entry.files {
        Files::Camera(path) => (RawImages::Camera(read(path)?), relative(path)),
        Files::Patches(left, right) => (RawImages::Patches([read(left)?, read(right)?]), relative(left)),
        Files::Missing(path) => {
            return Err(SkippedFrame::new(relative(path), SkipKind::Absent, "missing from the sequence"));
        }
    };
    Ok(RawFrame {
        index: Some(entry.index),
        purpose: recording.purpose(entry.index),
        seconds: entry.seconds,
        images,
        time: None,
        name: name.into(),
    })
}

#[cfg(test)]
mod tests {
    use super::super::ManualClock;
    use super::*;

    fn recording() -> (tempfile::TempDir, Arc<Recording>) {
        let dir = tempfile::tempdir().unwrap();
        std::fs::write(
            dir.path().join("recording.json"),
            r#"{"fps": 4, "layout": "patches", "transfer": "linear", "doorway": {"width_m": 0.9}, "fov_m": 0.15,
                "background_frames": [0, 1]}"#,
        )
        .unwrap();
        std::fs::create_dir(dir.path().join("frames")).unwrap();
        for (k, side) in [(0, "left"), (0, "right"), (1, "left"), (2, "left"), (2, "right")] {
            std::fs::write(dir.path().join(format!("frames/{k:08}_{side}.png")), [k as u8]).unwrap();
        }
        let recording = Recording::open(dir.path()).unwrap();
        (dir, Arc::new(recording))
    }

    #[test]
    fn frames_come_at_their_times_round_after_round_and_missing_ones_are_named() {
        let (_dir, recording) = recording();
        let clock = ManualClock::default();
        clock.advance(Duration::from_secs(100));
        let options = ReplayOptions { pace: Pace::Recorded, looped: true };
        let mut replay = Replay::new(recording, options, clock.clone());
        let mut seen = Vec::new();
        for _ in 0..5 {
            let index = match replay.next().unwrap() {
                SourceEvent::Frame(frame) => Ok((frame.index, frame.purpose)),
                SourceEvent::Skipped(skipped) => Err(skipped.to_string()),
                other => panic!("{other:?}"),
            };
            seen.push((clock.now().as_millis() - 100_000, index));
        }
        let missing = Err("frames/00000001_right.png: missing from the sequence".to_owned());
        assert_eq!(
            seen,
            [
                (0, Ok((Some(0), Purpose::Background))),
                // Frames that are only learned from are not paced; the recording's time starts after them.
                (0, missing.clone()),
                (250, Ok((Some(2), Purpose::Watch))),
                (500, Ok((Some(0), Purpose::Background))),
                (750, missing),
            ]
        );
    }

    #[test]
    fn frames_that_vanish_are_told_once_tried_at_the_rate_and_come_back() {
        for pace in [Pace::Recorded, Pace::Max] {
            let (dir, recording) = recording();
            let (frames, away) = (dir.path().join("frames"), dir.path().join("away"));
            let clock = ManualClock::default();
            let mut replay = Replay::new(recording, ReplayOptions { pace, looped: true }, clock.clone());
            let mut next = || replay.next().unwrap();
            assert!(matches!(next(), SourceEvent::Frame(_)));
            std::fs::rename(&frames, &away).unwrap();
            let (mut told, mut skipped) = (Vec::new(), 0_usize);
            let before = clock.now();
            for _ in 0..60 {
                match next() {
                    SourceEvent::Skipped(frame) => skipped += usize::from(frame.kind == SkipKind::Gone),
                    SourceEvent::Condition(condition) => told.push(condition),
                    other => panic!("{other:?}"),
                }
            }
            let [Condition { state: SourceState::Lost, reason: Some(reason), .. }] = &told[..] else {
                panic!("{told:?}")
            };
            assert_eq!(*reason, format!("{}: no such file or directory", frames.display()));
            // A file a frame interval, though two of three frames would not take one at full speed.
            assert!(clock.now() - before >= Duration::from_millis(250 * (skipped - LOST) as u64), "{pace:?}");

            std::fs::rename(&away, &frames).unwrap();
            let back = std::iter::repeat_with(next).find(|event| !matches!(event, SourceEvent::Skipped(_))).unwrap();
            assert_eq!(back, condition(SourceState::Streaming, None));
        }
    }

    #[test]
    fn a_recording_without_any_whole_frame_is_not_read_over_and_over_at_full_speed() {
        let (dir, _) = recording();
        for name in ["00000000_right.png", "00000002_right.png"] {
            std::fs::remove_file(dir.path().join("frames").join(name)).unwrap();
        }
        let recording = Arc::new(Recording::open(dir.path()).unwrap());
        let clock = ManualClock::default();
        let options = ReplayOptions { pace: Pace::Max, looped: true };
        let mut replay = Replay::new(recording, options, clock.clone());
        let lost = std::iter::from_fn(|| replay.next()).take(100).filter(|e| matches!(e, SourceEvent::Condition(_)));
        assert_eq!(lost.count(), 1);
        assert!(clock.now() > Duration::from_secs(20), "{:?}", clock.now());
    }

    #[test]
    fn an_end_without_frames_is_a_failure() {
        let (dir, recording) = recording();
        std::fs::remove_dir_all(dir.path().join("frames")).unwrap();
        std::fs::create_dir(dir.path().join("frames")).unwrap();
        let mut twice = (*recording).clone();
        twice.frames.extend_from_within(..);
        twice.frames.extend_from_within(..);
        let options = ReplayOptions { pace: Pace::Max, looped: false };
        let mut replay = Replay::new(Arc::new(twice), options, ManualClock::default());
        let last = std::iter::from_fn(|| replay.next()).last();
        let Some(SourceEvent::Condition(Condition { state: SourceState::Failed, reason: Some(reason), .. })) = last
        else {
            panic!("{last:?}")
        };
        assert!(reason.contains("no frame can be read any more (frames/0000000"), "{reason}");
    }

    #[test]
    fn what_is_no_file_is_skipped_and_named() {
        let (dir, recording) = recording();
        let file = dir.path().join("frames/00000000_left.png");
        let reason = |replace: &dyn Fn(&Path)| {
            let _ = std::fs::remove_file(&file);
            replace(&file);
            let skipped = load(&recording, &recording.frames[0]).expect_err("no image");
            assert_eq!(skipped.kind, SkipKind::Unreadable);
            skipped.to_string()
        };
        let link = |to: &'static str| move |file: &Path| std::os::unix::fs::symlink(to, file).unwrap();
        let name = "frames/00000000_left.png";
        assert_eq!(reason(&link("/dev/zero")), format!("{name}: is a device, expected a file with an image"));
        assert_eq!(reason(&link("/")), format!("{name}: is a directory, expected a file with an image"));
        let sparse = |file: &Path| std::fs::File::create(file).unwrap().set_len(100 << 30).unwrap();
        assert_eq!(reason(&sparse), format!("{name}: is larger than 256 MB, expected an image"));
    }

    #[test]
    fn images_that_are_turned_differently_are_skipped_and_none_is_shown_turned() {
        let grey = include_bytes!("testdata/grey16.jpg");
        let (dir, _) = recording();
        let tagged = |name: &str, value| {
            let image = crate::orientation::tagged(grey, value, true);
            std::fs::write(dir.path().join("frames").join(name), image).unwrap();
        };
        ["00000000_left.png", "00000000_right.png", "00000002_left.png"].iter().for_each(|name| tagged(name, 3));
        tagged("00000002_right.png", 6);
        let recording = Recording::open(dir.path()).unwrap();
        assert!(
            recording.notes.iter().any(|note| note.contains("00000000_left.png: tagged to be turned")),
            "{recording:?}"
        );
        let frame = load(&recording, &recording.frames[0]).unwrap();
        let RawImages::Patches([left, _]) = frame.images else { panic!() };
        assert_eq!(Orientation::of(&left), Orientation::default());
        let skipped = load(&recording, recording.frames.last().unwrap()).expect_err("turned otherwise");
        let expected = "frames/00000002_right.png: EXIF orientation 6, expected 3 as the first image has";
        assert_eq!((skipped.to_string().as_str(), skipped.kind), (expected, SkipKind::Unfit));
    }

    #[test]
    fn a_late_reader_is_not_made_later() {
        let (_dir, recording) = recording();
        let clock = ManualClock::default();
        let mut replay = Replay::new(recording, ReplayOptions { pace: Pace::Recorded, looped: true }, clock.clone());
        replay.next();
        // The first frame that is not only learned from.
        replay.next();
        clock.advance(Duration::from_millis(400));
        replay.next();
        assert_eq!(clock.now().as_millis(), 400);
        // The next round continues at the recording's times.
        replay.next();
        assert_eq!(clock.now().as_millis(), 500);
    }
}
