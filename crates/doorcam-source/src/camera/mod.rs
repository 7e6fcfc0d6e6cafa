//! A camera that comes and goes: opened, watched over, and opened again for as long as the program runs.
//!
//! What a driver does is behind two small traits, so that tests can put a camera in that does whatever they need.

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

/// What a camera is asked for.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraOptions {
    /// Formats, size and rate.
    pub wish: Wish,
    /// Exposure, gain, white balance and the like.
    pub controls: ControlSettings,
    /// Whether frames that are older than the newest one at the time they are looked at are left out.
    pub newest_only: bool,
}

/// What can be opened to give frames, again and again.
pub trait Opener: Send {
    /// An open camera.
    type Session: Session;

    /// Opens it, agrees on a format and starts the frames.
    fn open(&mut self) -> Result<Self::Session, Fault>;

    /// What to call it.
    fn name(&self) -> &str;
}

/// An open camera whose frames come.
pub trait Session: Send {
    /// What the camera granted.
    fn granted(&self) -> &Granted;

    /// Waits at most `wait` for a frame; none if there was none.
    fn next(&mut self, wait: Duration) -> Result<Option<Capture>, Fault>;

    /// Looks whether the controls still have the values that were asked for, and puts them right; true if what
    /// [`Session::granted`] says has changed.
    fn recheck(&mut self) -> Result<bool, Fault>;
}

/// What the driver handed over at one time.
#[derive(Debug, Clone, PartialEq)]
pub struct Capture {
    /// The newest frame, or why it is no frame.
    pub frame: Result<RawFrame, SkippedFrame>,
    /// Frames that the camera made before this one and that never arrived, by its numbering.
    pub lost: u64,
    /// Frames that arrived but were older than this one when they were looked at.
    pub superseded: u64,
}

/// Why a camera gives no frames: one line that says what can be done about it.
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
    /// It is, and cannot be used now.
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
