//! Where frames come from: one trait, and a source for each place.

// What a user, a file or a device gives must never panic.
#![warn(clippy::unwrap_used, clippy::expect_used)]

pub mod camera;
mod clock;
pub mod files;
pub mod image;
pub mod import;
mod jpeg;
#[cfg_attr(not(feature = "v4l2"), allow(dead_code))]
mod pool;
pub mod recorder;
pub mod recording;
mod replay;
pub mod sensor;
pub mod truth;
#[cfg(feature = "v4l2")]
pub mod v4l2;

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

pub use clock::{Clock, ManualClock, SystemClock};
use jiff::Timestamp;
pub use replay::{Pace, Replay, ReplayOptions, load};
use sensor::SensorFormat;
use serde::Serialize;

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
    /// When it was captured, if the device tells; otherwise it counts as captured when it is handed over.
    pub time: Option<Timestamp>,
    /// What to call it in messages: a file name, or the camera's.
    pub name: Arc<str>,
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
    /// Nobody knows: a live camera's frame.
    Live,
}

/// The images of a frame. Bytes are shared, never copied, and a camera's buffers are used again once nobody holds them.
#[derive(Debug, Clone, PartialEq)]
pub enum RawImages {
    /// The camera's view, as a JPEG or PNG.
    Camera(Arc<Vec<u8>>),
    /// The camera's view, as the sensor's driver gives it.
    Sensor(SensorFormat, Arc<Vec<u8>>),
    /// Rectified patches, left then right.
    Patches([Arc<Vec<u8>>; 2]),
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
#[derive(Debug, Clone, PartialEq)]
pub enum SourceEvent {
    /// A frame.
    Frame(RawFrame),
    /// A frame that could not be had.
    Skipped(SkippedFrame),
    /// Frames that the camera made and nobody could fetch in time, or that it never finished.
    Lost(u64),
    /// Frames that arrived but were no longer the newest when they were looked at.
    Superseded(u64),
    /// How the source is doing now.
    Condition(Condition),
    /// Nothing yet: a chance to end.
    Nothing,
}

/// How a source is doing, in words for people and for programs.
#[derive(Debug, Clone, PartialEq)]
pub struct Condition {
    /// Where it stands.
    pub state: SourceState,
    /// Why, in one line; none while all is well.
    pub reason: Option<String>,
    /// What the device granted; none while it is not open, and for what is not a device.
    pub granted: Option<Granted>,
}

/// Where a source stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[serde(rename_all = "kebab-case")]
pub enum SourceState {
    /// Before the first frame.
    Opening,
    /// Frames come.
    Streaming,
    /// The device is there but gives no frames.
    Stalled,
    /// The device is gone.
    Lost,
    /// Waiting before the next attempt to open the device.
    BackingOff,
    /// There will be no more frames.
    Ended,
    /// The frame loop stopped on an error.
    Failed,
}

/// What a camera granted, which need not be what it was asked for.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct Granted {
    /// The device node in use.
    pub node: String,
    /// The camera's name for itself.
    pub card: String,
    /// Pixel format, as a FourCC.
    pub format: String,
    /// Width and height in pixels.
    #[cfg_attr(feature = "schema", schema(value_type = doorcam_core::schema::Size))]
    pub size: [usize; 2],
    /// Frames a second.
    pub fps: f64,
    /// Values of the controls that matter, by name.
    pub controls: BTreeMap<String, i64>,
    /// Controls that do not have the values that were asked for: one line each.
    pub mismatches: Vec<String>,
}

/// Anything that frames come from. Each runs on a thread of its own and blocks as it needs to.
pub trait Source: Send {
    /// Waits for what comes next, a live device for a fraction of a second; none when there will be no more.
    fn next(&mut self) -> Option<SourceEvent>;

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
