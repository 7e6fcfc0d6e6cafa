//! Recordings of a running source, started and stopped over the API without delaying the frame loop.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::{fs, io};

use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::watch::Hub;
use doorcam_core::calibration::Calibration;
use doorcam_source::SourceState;
use doorcam_source::recorder::{RecordError, Recorder, RecordingLimits, RecordingPlan, RecordingStatus};
use doorcam_source::recording::{Layout, Manifest};

/// A request to record; every field is optional.
#[derive(Debug, Clone, PartialEq, Default, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields)]
pub struct RecordingWish {
    /// Name of its directory; by default the time at which it starts.
    pub name: Option<String>,
    /// Length in seconds; by default [`Recordings::SECONDS`].
    pub seconds: Option<f64>,
    /// Seconds from the first frame on in which the room is empty, 0 if it never is; by default
    /// [`Recordings::EMPTY_SECONDS`].
    pub empty_seconds: Option<f64>,
}

/// The answer to GET /api/v1/recording.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct RecordingReport {
    /// Whether a recording can be started now.
    pub possible: bool,
    /// Why none can be started.
    #[schema(required)]
    pub reason: Option<String>,
    /// The directory that holds a subdirectory for each recording; null if none is configured.
    #[schema(required, value_type = Option<String>)]
    pub directory: Option<PathBuf>,
    /// Longest recording, in seconds.
    pub most_seconds: f64,
    /// Largest recording, in bytes.
    pub most_bytes: u64,
    /// The recording in progress, or the last one; null before the first.
    #[schema(required)]
    pub recording: Option<RecordingStatus>,
}

/// Why a recording was not started or stopped.
#[derive(Debug, thiserror::Error)]
pub enum RecordingRefused {
    /// There is no directory for recordings.
    #[error("there is no place for recordings, expected --storage DIR, storage.directory or $HOME")]
    NoPlace,
    /// Another recording is in progress.
    #[error("a recording is under way already")]
    Busy,
    /// The source has ended.
    #[error("the source has ended: no frames will come to record")]
    Ended,
    /// The camera has no calibration, which a recording needs.
    #[error("the camera is not calibrated yet: a recording of it could not be replayed")]
    Uncalibrated,
    /// The camera's images differ in size from those that the calibration is for.
    #[error("the calibration is for {} x {} pixels, the camera gives {} x {}", .0[0], .0[1], .1[0], .1[1])]
    Size([usize; 2], [usize; 2]),
    /// The name cannot be used for a directory.
    #[error(
        "name is {0:?}, expected 1 to {LONGEST_NAME} letters, digits, spaces and -_. ({MOST_BYTES} bytes at most) with no . \
         at the start or end, and no name that Windows reserves"
    )]
    Name(String),
    /// The file system does not take the name.
    #[error("name is {name:?}, expected a shorter one: {} takes no longer path", directory.display())]
    Path {
        /// The name.
        name: String,
        /// Where the recording would be.
        directory: PathBuf,
    },
    /// A length is out of range.
    #[error("{0} is {1}, expected a number of seconds {2}")]
    Seconds(&'static str, f64, String),
    /// No recording is in progress.
    #[error("nothing is being recorded")]
    NotRecording,
    /// The recording cannot be written.
    #[error(transparent)]
    Write(#[from] RecordError),
}

const LONGEST_NAME: usize = 64;
/// Most bytes of a name: what most file systems take.
const MOST_BYTES: usize = 255;
/// Most recordings that begin in the same second and get a name from it.
const SAME_SECOND: usize = 100;

/// Records a running source, one recording at a time, each in its own directory.
pub struct Recordings {
    directory: Option<PathBuf>,
    /// The source's manifest; `None` for a camera, which has a calibration instead.
    manifest: Option<Manifest>,
    hub: Arc<Hub>,
    /// Held while a recording is started or stopped.
    changing: Mutex<()>,
}

impl Recordings {
    /// Default length of a recording, in seconds.
    pub const SECONDS: f64 = 60.0;
    /// Default time at the start that shows the empty room, in seconds.
    pub const EMPTY_SECONDS: f64 = 3.0;
    /// Longest recording, in seconds.
    pub const MOST_SECONDS: f64 = 3600.0;
    /// Largest recording, in bytes.
    pub const MOST_BYTES: u64 = 4_000_000_000;

    /// Recordings in `directory`, which is created with the first one. Sources other than cameras have a `manifest`.
    pub fn new(directory: Option<PathBuf>, manifest: Option<Manifest>, hub: Arc<Hub>) -> Self {
        Self { directory, manifest, hub, changing: Mutex::new(()) }
    }

    /// The current state, with the `calibration` in use.
    pub fn report(&self, calibration: Option<&Calibration>) -> RecordingReport {
        let reason = self.ready(calibration).err().map(|e| e.to_string());
        RecordingReport {
            possible: reason.is_none(),
            reason,
            directory: self.directory.clone(),
            most_seconds: Self::MOST_SECONDS,
            most_bytes: Self::MOST_BYTES,
            recording: self.hub.recording(),
        }
    }

    /// Starts a recording; `calibration` is the one in use.
    ///
    /// # Errors
    /// If nothing can be recorded now, `wish` is out of range, or the directory cannot be written.
    pub fn start(&self, wish: &RecordingWish, calibration: Option<&Calibration>) -> Result<(), RecordingRefused> {
        let _changing = self.changing.lock().unwrap_or_else(PoisonError::into_inner);
        let directory = self.ready(calibration)?;
        let empty = wish.empty_seconds.unwrap_or(Self::EMPTY_SECONDS);
        if !(0.0..Self::MOST_SECONDS).contains(&empty) {
            let range = format!("from 0 to below {}", Self::MOST_SECONDS);
            return Err(RecordingRefused::Seconds("empty_seconds", empty, range));
        }
        // The default length must leave time after a long empty room.
        let usual = if empty < Self::SECONDS { Self::SECONDS } else { (2.0 * empty).min(Self::MOST_SECONDS) };
        let seconds = wish.seconds.unwrap_or(usual);
        if !(seconds > empty && seconds <= Self::MOST_SECONDS) {
            let range = format!("above those of the empty room ({empty}) and at most {}", Self::MOST_SECONDS);
            return Err(RecordingRefused::Seconds("seconds", seconds, range));
        }
        let now = Timestamp::now();
        wish.name.as_deref().map(check_name).transpose()?;
        let plan = RecordingPlan {
            manifest: self.manifest(calibration, now)?,
            empty_seconds: (empty > 0.0).then_some(empty),
            calibrated: true,
            limits: RecordingLimits { seconds: Some(seconds), frames: None, bytes: Some(Self::MOST_BYTES) },
        };
        let place = make_place(directory, wish.name.as_deref(), now)?;
        let recorder = Recorder::start(&place, plan).inspect_err(|_| {
            // Only if nothing is in it.
            let _ = std::fs::remove_dir(&place);
        })?;
        tracing::info!("recording {seconds} s into {}", place.display());
        self.hub.tap().begin(recorder);
        Ok(())
    }

    /// Stops the recording in progress and waits until it is on disk.
    ///
    /// # Errors
    /// If nothing is being recorded.
    pub fn stop(&self) -> Result<(), RecordingRefused> {
        let _changing = self.changing.lock().unwrap_or_else(PoisonError::into_inner);
        if !self.hub.tap().is_recording() {
            return Err(RecordingRefused::NotRecording);
        }
        self.finish();
        Ok(())
    }

    /// Stops the recording in progress, if any, and waits until it is on disk.
    pub fn finish(&self) {
        if let Some(status) = self.hub.tap().end() {
            let (name, written) = (status.directory.display(), &status.written);
            tracing::info!("recorded {} frames in {:.1} s: {name}", written.frames, written.seconds);
        }
    }

    /// The directory, if a recording can be started now.
    fn ready(&self, calibration: Option<&Calibration>) -> Result<&Path, RecordingRefused> {
        let directory = self.directory.as_deref().ok_or(RecordingRefused::NoPlace)?;
        if matches!(self.hub.source_state(), SourceState::Ended | SourceState::Failed) {
            return Err(RecordingRefused::Ended);
        }
        if self.hub.tap().is_recording() {
            return Err(RecordingRefused::Busy);
        }
        match (&self.manifest, calibration, self.hub.size()) {
            (None, None, _) => Err(RecordingRefused::Uncalibrated),
            (None, Some(calibration), Some(size)) if calibration.size != size => {
                Err(RecordingRefused::Size(calibration.size, size))
            }
            _ => Ok(directory),
        }
    }

    fn manifest(&self, calibration: Option<&Calibration>, now: Timestamp) -> Result<Manifest, RecordingRefused> {
        let recorded = now.strftime("recorded %F %R UTC").to_string();
        let Some(of_source) = &self.manifest else {
            let calibration = calibration.ok_or(RecordingRefused::Uncalibrated)?;
            return Ok(Manifest::of_camera(calibration, self.hub.fps(), recorded));
        };
        let mut manifest = of_source.clone();
        if let Some(calibration) = calibration.filter(|_| manifest.layout == Layout::Camera) {
            manifest.set_calibration(calibration);
        }
        manifest.notes = if manifest.notes.is_empty() { recorded } else { format!("{} ({recorded})", manifest.notes) };
        // The frames that the source's manifest lists as empty room may not be among those recorded.
        manifest.background_frames = None;
        Ok(manifest)
    }
}

/// Makes the recording's own directory: of that name, or of the time if it has none.
fn make_place(directory: &Path, name: Option<&str>, now: Timestamp) -> Result<PathBuf, RecordingRefused> {
    let failed = |path: &Path, reason| RecordError::Write { path: path.to_owned(), reason };
    fs::create_dir_all(directory).map_err(|reason| failed(directory, reason))?;
    let time = now.strftime("%Y-%m-%d %H.%M.%S UTC").to_string();
    let names: Vec<String> = match name {
        Some(name) => vec![name.to_owned()],
        None => (1..SAME_SECOND).map(|k| if k == 1 { time.clone() } else { format!("{time} {k}") }).collect(),
    };
    for name in &names {
        let place = directory.join(name);
        match fs::create_dir(&place).map_err(|e| (e.kind(), e)) {
            Ok(()) => return Ok(place),
            Err((io::ErrorKind::AlreadyExists, _)) => {}
            Err((io::ErrorKind::InvalidFilename, _)) => {
                return Err(RecordingRefused::Path { name: name.clone(), directory: directory.to_owned() });
            }
            Err((_, reason)) => return Err(failed(&place, reason).into()),
        }
    }
    Err(RecordError::Exists(directory.join(name.unwrap_or(&time))).into())
}

/// Names that Windows, and so disks and shares that are used with it, does not take, with any extension.
fn is_reserved(name: &str) -> bool {
    let stem = name.split('.').next().unwrap_or_default().trim_end().to_ascii_uppercase();
    let numbered =
        |of: &str| stem.strip_prefix(of).is_some_and(|rest| rest.len() == 1 && rest.as_bytes()[0].is_ascii_digit());
    matches!(stem.as_str(), "CON" | "PRN" | "AUX" | "NUL") || numbered("COM") || numbered("LPT")
}

fn check_name(name: &str) -> Result<(), RecordingRefused> {
    let fits = |c: char| c.is_alphanumeric() || " -_.".contains(c);
    let fits = (1..=LONGEST_NAME).contains(&name.chars().count())
        && name.len() <= MOST_BYTES
        && name.chars().all(fits)
        && !name.starts_with('.')
        && !name.ends_with('.')
        && name.trim() == name
        && !is_reserved(name);
    if fits { Ok(()) } else { Err(RecordingRefused::Name(name.chars().take(2 * LONGEST_NAME).collect())) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_stays_in_its_directory() {
        for name in ["evening", "2026-11-25 22.37.01 UTC", "Tür_2", "寝室", "console", "com", "com10", &"x".repeat(64)]
        {
            check_name(name).unwrap();
        }
        let long = "𠀀".repeat(64);
        for name in ["", ".", "..", ".hidden", "a/b", "a\\b", "a\0", " a", "a ", "a.", &"x".repeat(65), &long, "a\nb"]
            .into_iter()
            .chain(["a\u{202e}b", "con", "NUL.txt", "Com1", "lpt9.a.b", "\u{1b}[2J", "=1", "\u{2028}"])
        {
            assert!(check_name(name).unwrap_err().to_string().contains("expected 1 to 64 letters"), "{name:?}");
        }
    }

    #[test]
    fn each_recording_gets_a_directory_of_its_own() {
        let directory = tempfile::tempdir().unwrap();
        let here = directory.path().join("recordings");
        let now = Timestamp::from_second(1_700_000_000).unwrap();
        let name = |name: Option<&str>| {
            let place = make_place(&here, name, now)?;
            Ok::<_, RecordingRefused>(place.file_name().unwrap().to_str().unwrap().to_owned())
        };
        assert_eq!(name(Some("evening")).unwrap(), "evening");
        fs::write(here.join("a file"), "").unwrap();
        for taken in ["evening", "a file"] {
            let refused = name(Some(taken)).unwrap_err();
            assert!(matches!(refused, RecordingRefused::Write(RecordError::Exists(_))), "{refused}");
        }
        for expected in ["2023-11-14 22.13.20 UTC", "2023-11-14 22.13.20 UTC 2", "2023-11-14 22.13.20 UTC 3"] {
            assert_eq!(name(None).unwrap(), expected);
        }
        let refused = make_place(&here, Some(&"𠀀".repeat(64)), now).unwrap_err();
        assert!(matches!(refused, RecordingRefused::Path { .. }), "{refused}");
    }
}
