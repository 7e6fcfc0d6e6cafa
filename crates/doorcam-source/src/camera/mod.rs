//! Cameras that may come and go: opened, supervised and reopened for as long as the program runs.
//!
//! The driver is behind two small traits, [`Opener`] and [`Session`], so that tests can simulate any camera.

mod backoff;
#[cfg_attr(not(feature = "v4l2"), allow(dead_code))]
pub(super) mod controls;
mod locked;
#[cfg_attr(not(feature = "v4l2"), allow(dead_code))]
pub(super) mod negotiation;
mod supervisor;

use std::time::Duration;

pub use backoff::Backoff;
pub use controls::{ControlSettings, Setting};
pub use locked::Locked;
pub use negotiation::{PixelFormat, Wish};
pub use supervisor::Supervisor;

use super::{Granted, RawFrame, SkippedFrame};

/// What is requested of a camera.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraOptions {
    /// Formats, size and rate.
    pub wish: Wish,
    /// Exposure, gain, white balance and the like.
    pub controls: ControlSettings,
    /// Whether frames that are no longer the newest when they are fetched are dropped.
    pub newest_only: bool,
}

/// A camera that can be opened, repeatedly.
pub trait Opener: Send {
    /// An open camera.
    type Session: Session;

    /// Opens the camera, negotiates a format and starts streaming.
    ///
    /// # Errors
    /// If the camera is absent or cannot be used now.
    fn open(&mut self) -> Result<Self::Session, Fault>;

    /// The camera's name in messages.
    fn name(&self) -> &str;
}

/// An open, streaming camera.
pub trait Session: Send {
    /// What the camera granted.
    fn granted(&self) -> &Granted;

    /// Waits at most `wait` for a frame; none if none arrived.
    ///
    /// # Errors
    /// If the camera is gone or has failed.
    fn next(&mut self, wait: Duration) -> Result<Option<Capture>, Fault>;

    /// Checks that the controls still have the requested values, and sets those that do not; true if what
    /// [`Session::granted`] returns has changed.
    ///
    /// # Errors
    /// If the camera is gone or has failed.
    fn recheck(&mut self) -> Result<bool, Fault>;
}

/// A frame as fetched from the driver.
#[derive(Debug, Clone, PartialEq)]
pub struct Capture {
    /// The newest frame, or why it is unusable.
    pub frame: Result<RawFrame, SkippedFrame>,
    /// Number of frames that the camera made before this one, by its numbering, but that never arrived.
    pub lost: u64,
    /// Number of frames that arrived before this one but were no longer the newest when they were fetched.
    pub superseded: u64,
}

/// Why a camera delivers no frames, in one line that says what can be done about it.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{reason}")]
pub struct Fault {
    /// Whether the camera is there at all.
    pub kind: FaultKind,
    /// In words.
    pub reason: String,
}

/// Whether the camera is there at all.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FaultKind {
    /// It is not: unplugged, or not plugged in yet.
    Absent,
    /// It is, but cannot be used now.
    Unusable,
}

impl Fault {
    /// The camera is not there.
    pub fn absent(reason: impl Into<String>) -> Self {
        Self { kind: FaultKind::Absent, reason: reason.into() }
    }

    /// The camera cannot be used now.
    pub fn unusable(reason: impl Into<String>) -> Self {
        Self { kind: FaultKind::Unusable, reason: reason.into() }
    }
}
