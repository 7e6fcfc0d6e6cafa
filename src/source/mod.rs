//! Where frames come from: one trait, and a source for each place.

mod clock;
pub mod image;
pub mod recording;
mod replay;

use std::path::Path;
use std::sync::Arc;

pub use clock::{Clock, ManualClock, SystemClock};
pub use replay::{Pace, Replay, ReplayOptions, load};

/// A frame as it was captured, not yet decoded: what is replaced by a newer frame need not be decoded at all.
#[derive(Debug, Clone, PartialEq)]
pub struct RawFrame {
    /// Number of the frame in its recording; none for a live camera.
    pub index: Option<u64>,
    /// What it is for.
    pub purpose: Purpose,
    /// Time of capture, in seconds on the source's clock.
    pub seconds: f64,
    /// The encoded images.
    pub images: RawImages,
    /// What to call it in messages: a file name.
    pub name: String,
}

/// What a frame is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Purpose {
    /// It comes before the background: nothing yet.
    Before,
    /// It shows the empty room.
    Background,
    /// It is to be compared with the background.
    Watch,
}

/// The encoded images of a frame.
#[derive(Debug, Clone, PartialEq)]
pub enum RawImages {
    /// The camera's view.
    Camera(Arc<[u8]>),
    /// Rectified patches, left then right.
    Patches([Arc<[u8]>; 2]),
}

/// A frame that could not be had; the next one may well be fine.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{name}: {reason}")]
pub struct SkippedFrame {
    /// The file or device.
    pub name: String,
    /// What was wrong with it.
    pub reason: String,
}

/// What a source says next.
pub type NextFrame = Result<RawFrame, SkippedFrame>;

/// Anything that frames come from. Each runs on a thread of its own and blocks as it needs to.
pub trait Source: Send {
    /// Waits for the next frame; none when there will be no more.
    fn next_frame(&mut self) -> Option<NextFrame>;

    /// Whether every frame must be solved, as fast as that goes, rather than the newest one.
    fn lossless(&self) -> bool {
        false
    }
}

/// A source that cannot be opened.
#[derive(Debug, thiserror::Error)]
#[error("{path}: {reason}")]
pub struct SourceError {
    path: String,
    reason: String,
}

impl SourceError {
    /// Names the file at fault and what was expected of it.
    pub fn new(path: &Path, reason: impl Into<String>) -> Self {
        Self { path: path.display().to_string(), reason: reason.into() }
    }
}
