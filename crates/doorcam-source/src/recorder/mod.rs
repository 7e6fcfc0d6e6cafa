//! Writes recordings (docs/recordings.md) while their frames arrive.
//!
//! [`RecordingWriter`] writes frames to files one by one; [`Recorder`] does so on its own thread, so that the source of
//! the frames never waits for a disk. Whatever ends either of them, what was written opens as a recording.

mod encoding;
mod files;
mod queue;
mod writer;

use std::io;
use std::path::{Path, PathBuf};

pub use queue::{Recorder, RecordingState, RecordingStatus};
use serde::Serialize;
pub use writer::{RecordingPlan, RecordingWriter, Written};

/// Limits at which a recording ends by itself. None is no limit.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct RecordingLimits {
    /// Seconds from the first frame, by the frames' own times.
    pub seconds: Option<f64>,
    /// Number of frames.
    pub frames: Option<u64>,
    /// Bytes of all files together.
    pub bytes: Option<u64>,
}

/// Why a recording ended without an error.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[serde(rename_all = "kebab-case")]
pub enum End {
    /// It was stopped, or there were no more frames.
    Stopped,
    /// It reached [`RecordingLimits::seconds`].
    Seconds,
    /// It reached [`RecordingLimits::frames`].
    Frames,
    /// It reached [`RecordingLimits::bytes`].
    Bytes,
}

/// Why a recording cannot be written, or cannot go on.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// The directory already has a recording.
    #[error("{0}: there is a recording already; remove it or name another directory")]
    Exists(PathBuf),
    /// A file cannot be written.
    #[error("{path}: {}", words(reason))]
    Write {
        /// The file or directory.
        path: PathBuf,
        /// The operating system's reason.
        reason: io::Error,
    },
    /// The writing thread cannot be started.
    #[error("cannot start the recording's thread: {0}")]
    Thread(io::Error),
}

impl RecordError {
    fn write(path: &Path) -> impl Fn(io::Error) -> Self {
        move |reason| Self::Write { path: path.to_owned(), reason }
    }
}

/// An I/O error in words; without the operating system's error number where it is a usual one.
fn words(error: &io::Error) -> String {
    match error.kind() {
        io::ErrorKind::StorageFull => "no space left on the device".into(),
        io::ErrorKind::QuotaExceeded => "the disk quota is used up".into(),
        io::ErrorKind::PermissionDenied => "permission denied".into(),
        io::ErrorKind::NotFound => "no such file or directory".into(),
        io::ErrorKind::ReadOnlyFilesystem => "the file system is read-only".into(),
        _ => error.to_string(),
    }
}
