use std::borrow::Cow;
use std::fs;
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::encoding::{EncodedFrame, encode};
use super::files::{Lines, sync, sync_below, write_whole};
use super::{End, RecordError, RecordingLimits};
use crate::recording::Manifest;
use crate::{RawFrame, RawImages, SkipKind, SkippedFrame};

/// What to record.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordingPlan {
    /// The manifest.
    pub manifest: Manifest,
    /// How long the room is empty, in seconds from the first frame: those frames become the manifest's
    /// `background_frames`. None keeps the manifest's own.
    pub empty_seconds: Option<f64>,
    /// Whether the camera is calibrated. If not, the manifest's `doorway` and `floor_points` are left out, and the
    /// recording does not open until they are added.
    pub calibrated: bool,
    /// When it ends by itself.
    pub limits: RecordingLimits,
}

/// What has been written so far.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct Written {
    /// Number of frames.
    pub frames: u64,
    /// Seconds from the first frame to the last.
    pub seconds: f64,
    /// Bytes of all files together.
    pub bytes: u64,
    /// Frames that arrived but were not images, or not of the recording's size.
    pub skipped: u64,
    /// The last of these: its source and the reason.
    pub last_skipped: Option<String>,
}

/// Writes frames into a recording's directory.
///
/// The manifest is written first, then for each frame its time and its images: at any moment the directory is a
/// recording of the frames so far, whatever happens to the writer.
#[derive(Debug)]
pub struct RecordingWriter {
    directory: PathBuf,
    plan: RecordingPlan,
    times: Lines,
    /// Number of the next frame.
    next: u64,
    /// Number and time of the first frame.
    first: Option<(u64, f64)>,
    /// Time of the last frame.
    last: Option<f64>,
    /// Seconds added to the frames' own times.
    shift: f64,
    /// Whether `background_frames` is final.
    background_known: bool,
    manifest_bytes: u64,
    frame_bytes: u64,
    written: Written,
}

impl RecordingWriter {
    /// Begins a recording in a directory without one, creating it if needed.
    ///
    /// # Errors
    /// If the directory has a recording, or part of one, or cannot be written.
    pub fn create(directory: &Path, mut plan: RecordingPlan) -> Result<Self, RecordError> {
        Self::check_free(directory)?;
        let frames = directory.join("frames");
        fs::create_dir_all(&frames).map_err(RecordError::write(&frames))?;
        if let Some(seconds) = plan.empty_seconds {
            // The number expected at the nominal rate; the true number replaces it once it is known.
            let planned = (seconds * plan.manifest.fps).round().max(1.0) as u64;
            plan.manifest.background_frames = Some([0, planned]);
        }
        let manifest_bytes = write_manifest(directory, &plan)?;
        let times = directory.join("timestamps.csv");
        let times = Lines::create(&times, "index,seconds").map_err(RecordError::write(&times))?;
        sync(directory).map_err(RecordError::write(directory))?;
        let background_known = plan.empty_seconds.is_none();
        let mut writer = Self {
            directory: directory.to_owned(),
            plan,
            times,
            next: 0,
            first: None,
            last: None,
            shift: 0.0,
            background_known,
            manifest_bytes,
            frame_bytes: 0,
            written: Written::default(),
        };
        writer.written.bytes = writer.bytes();
        Ok(writer)
    }

    /// Checks that a recording can begin in a directory.
    ///
    /// # Errors
    /// If the directory already has a recording, or part of one.
    pub fn check_free(directory: &Path) -> Result<(), RecordError> {
        let frames = directory.join("frames");
        let some = fs::read_dir(&frames).is_ok_and(|mut listing| listing.next().is_some());
        if some || ["recording.json", "timestamps.csv"].iter().any(|name| directory.join(name).exists()) {
            return Err(RecordError::Exists(directory.to_owned()));
        }
        Ok(())
    }

    /// What has been written so far.
    pub fn written(&self) -> &Written {
        &self.written
    }

    /// Skips `count` frame numbers, for frames that never arrived or could not be taken: readers of the recording find
    /// them missing.
    pub fn pass_over(&mut self, count: u64) {
        self.next = self.next.saturating_add(count);
    }

    /// Writes a frame, and returns the limit that ends the recording if it is reached. A frame beyond the limit of
    /// seconds or bytes is not written; one that is not an image of the recording's size is only counted.
    ///
    /// # Errors
    /// If a file cannot be written. Nothing more can be written then; the frames before it remain.
    pub fn write(&mut self, frame: &RawFrame) -> Result<Option<End>, RecordError> {
        // The copy of a recording keeps its frame numbers; when a loop starts over, they continue upwards.
        let number = frame.index.map_or(self.next, |index| index.max(self.next));
        let encoded = match self.fitting(frame) {
            Ok(encoded) => encoded,
            Err(skipped) => {
                self.next = number + 1;
                self.written.skipped += 1;
                self.written.last_skipped = Some(skipped.to_string());
                return Ok(None);
            }
        };
        let seconds = self.seconds(frame);
        let (first, start) = *self.first.get_or_insert((number, seconds));
        let line = format!("{number},{seconds}");
        let bytes = encoded.iter().map(|(_, bytes)| bytes.len() as u64).sum::<u64>();
        let limits = self.plan.limits;
        if limits.seconds.is_some_and(|limit| seconds - start >= limit) {
            return Ok(Some(End::Seconds));
        }
        if limits.bytes.is_some_and(|limit| self.bytes() + bytes + line.len() as u64 + 1 > limit) {
            return Ok(Some(End::Bytes));
        }
        if let Some(empty) = self.plan.empty_seconds.filter(|_| !self.background_known)
            && seconds - start >= empty
        {
            self.background_is([first, number.max(first + 1)])?;
        }
        self.put(number, &line, &encoded)?;
        self.next = number + 1;
        self.last = Some(seconds);
        self.frame_bytes += bytes;
        self.written.frames += 1;
        self.written.seconds = seconds - start;
        self.written.bytes = self.bytes();
        Ok(limits.frames.is_some_and(|limit| self.written.frames >= limit).then_some(End::Frames))
    }

    /// Completes the manifest and waits until the whole recording is on the disk.
    ///
    /// # Errors
    /// If the manifest cannot be written, or the files cannot be synced.
    pub fn finish(mut self) -> Result<Written, RecordError> {
        if !self.background_known
            && let Some((first, _)) = self.first
        {
            self.background_is([first, self.next])?;
        }
        sync_below(&self.directory).map_err(RecordError::write(&self.directory))?;
        Ok(self.written)
    }

    fn fitting<'a>(&self, frame: &'a RawFrame) -> Result<EncodedFrame<'a>, SkippedFrame> {
        let unfit = |reason: String| SkippedFrame::new(&*frame.name, SkipKind::Unfit, reason);
        if let (RawImages::Sensor(format, _), Some([width, height])) = (&frame.images, self.plan.manifest.size)
            && [format.width, format.height] != [width, height]
        {
            let [w, h] = [format.width, format.height];
            return Err(unfit(format!("has {w} x {h} pixels, the recording {width} x {height}")));
        }
        encode(frame).map_err(|e| SkippedFrame::undecoded(&*frame.name, &e))
    }

    /// A frame's time in the recording: a camera's counts from its first frame, a recording's is kept. Where it would
    /// go back, because a loop starts over or a clock was set, it continues one frame period after the last frame.
    fn seconds(&mut self, frame: &RawFrame) -> f64 {
        if self.first.is_none() && frame.index.is_none() {
            self.shift = -frame.seconds;
        }
        let seconds = frame.seconds + self.shift;
        let seconds = if frame.index.is_none() { (seconds * 1e6).round() / 1e6 } else { seconds };
        match self.last.filter(|&last| seconds <= last) {
            None => seconds,
            Some(last) => {
                let next = last + 1.0 / self.plan.manifest.fps;
                self.shift += next - seconds;
                next
            }
        }
    }

    fn background_is(&mut self, frames: [u64; 2]) -> Result<(), RecordError> {
        self.background_known = true;
        if self.plan.manifest.background_frames != Some(frames) {
            self.plan.manifest.background_frames = Some(frames);
            self.manifest_bytes = write_manifest(&self.directory, &self.plan)?;
        }
        Ok(())
    }

    /// Writes a frame's time, then its images: a time without a frame is ignored, a frame without its time would get a
    /// wrong one.
    fn put(&mut self, number: u64, line: &str, encoded: &[(String, Cow<'_, [u8]>)]) -> Result<(), RecordError> {
        let before = self.times.length();
        self.times.add(line).map_err(RecordError::write(&self.directory.join("timestamps.csv")))?;
        for (suffix, bytes) in encoded {
            let path = self.directory.join("frames").join(format!("{number:08}{suffix}"));
            if let Err(reason) = write_whole(&path, bytes) {
                self.times.cut(before);
                // A left patch without its right one is not a frame.
                for (suffix, _) in encoded {
                    let _ = fs::remove_file(self.directory.join("frames").join(format!("{number:08}{suffix}")));
                }
                return Err(RecordError::Write { path, reason });
            }
        }
        Ok(())
    }

    fn bytes(&self) -> u64 {
        self.manifest_bytes + self.times.length() + self.frame_bytes
    }
}

/// Writes `recording.json` such that it survives a power cut; returns its length in bytes.
fn write_manifest(directory: &Path, plan: &RecordingPlan) -> Result<u64, RecordError> {
    let path = directory.join("recording.json");
    let text = || {
        let mut value = serde_json::to_value(&plan.manifest)?;
        if let Some(keys) = value.as_object_mut().filter(|_| !plan.calibrated) {
            keys.remove("doorway");
            keys.remove("floor_points");
        }
        serde_json::to_string_pretty(&value)
    };
    let text = text().map_err(|e| RecordError::Write { path: path.clone(), reason: e.into() })? + "\n";
    crate::files::replace(&path, text.as_bytes()).map_err(RecordError::write(&path))?;
    Ok(text.len() as u64)
}

#[cfg(test)]
#[path = "writer_tests.rs"]
pub(super) mod tests;
