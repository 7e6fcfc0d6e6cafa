use std::sync::Arc;
use std::time::Duration;

use super::recording::{Entry, Files, Recording};
use super::{Clock, Purpose, RawFrame, RawImages, SkippedFrame, Source, SourceEvent};

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
}

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
        }
    }

    /// Time from the first frame to one period after the last.
    fn round_length(&self) -> f64 {
        let frames = &self.recording.frames;
        let span = frames.last().map_or(0.0, |e| e.seconds) - frames.first().map_or(0.0, |e| e.seconds);
        span.max(0.0) + 1.0 / self.recording.manifest.fps
    }
}

impl<C: Clock> Source for Replay<C> {
    fn next(&mut self) -> Option<SourceEvent> {
        if self.next == self.recording.frames.len() {
            if !self.options.looped {
                return None;
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
        Some(frame.map_or_else(SourceEvent::Skipped, SourceEvent::Frame))
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
    let relative = |path: &std::path::Path| path.strip_prefix(&recording.path).unwrap_or(path).display().to_string();
    let read = |path: &std::path::Path| -> Result<Arc<Vec<u8>>, SkippedFrame> {
        std::fs::read(path).map(Arc::new).map_err(|e| SkippedFrame { name: relative(path), reason: e.to_string() })
    };
    let (images, name) = match &entry.files {
        Files::Camera(path) => (RawImages::Camera(read(path)?), relative(path)),
        Files::Patches(left, right) => (RawImages::Patches([read(left)?, read(right)?]), relative(left)),
        Files::Missing(path) => {
            return Err(SkippedFrame { name: relative(path), reason: "missing from the sequence".into() });
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
