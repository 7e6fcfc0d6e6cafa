//! Writing recordings (DESIGN: the recording contract) while their frames come.
//!
//! [`RecordingWriter`] puts frames in files, one after the other; [`Recorder`] does so on a thread of its own, so that whoever
//! has the frames never waits for a disk. Whatever ends either of them, what was written stays a recording that opens.

mod encoding;
mod files;
mod queue;
mod writer;

use std::io;
use std::path::{Path, PathBuf};

pub use queue::{Recorder, RecordingState, RecordingStatus};
use serde::Serialize;
pub use writer::{RecordingPlan, RecordingWriter, Written};

/// When a recording ends by itself. What is none does not end it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct RecordingLimits {
    /// Seconds from the first frame on, by the frames' own times.
    pub seconds: Option<f64>,
    /// Frames.
    pub frames: Option<u64>,
    /// Bytes of all files together.
    pub bytes: Option<u64>,
}

/// Why a recording ended without an error.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[serde(rename_all = "kebab-case")]
pub enum End {
    /// Someone said so, or there were no more frames.
    Stopped,
    /// [`RecordingLimits::seconds`].
    Seconds,
    /// [`RecordingLimits::frames`].
    Frames,
    /// [`RecordingLimits::bytes`].
    Bytes,
}

/// Why a recording cannot be written, or not any further.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// The directory has a recording already.
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

/// An I/O error without the operating system's number, with what to do about it.
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
