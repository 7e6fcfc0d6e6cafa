//! Frames for a doorway camera: from recordings and webcams, behind one trait.
//!
//! A [`Source`] delivers events: frames, and whatever else happens to a source, such as lost frames or an unplugged
//! camera. A [`RawFrame`] is not decoded yet, because a frame that a newer one replaces never needs to be. The crate
//! knows nothing of maps and people: `doorcam-engine` turns frames into those.
//!
//! # Modules
//!
//! Along the way of a frame:
//!
//! | Module | What it does |
//! |---|---|
//! | [`camera`] | a camera that may come and go: opened, its automatics locked, watched and opened again |
//! | `v4l2` | webcams through Linux's V4L2, behind [`camera`]'s traits (feature `v4l2`) |
//! | [`recording`] | recordings: a directory with a manifest and images; [`Replay`] makes a source of one |
//! | [`sensor`] | raw pixels as drivers deliver them (YUYV, NV12, RGB, grey) |
//! | [`image`] | decodes JPEG and PNG, JPEGs either to 8 bits or exactly, without rounding, to measure with |
//! | [`recorder`] | writes frames into a recording while they arrive |
//! | [`truth`] | where people really were in a recording |
//! | [`import`] | the data files of the paper's authors, as recordings |
//! | [`files`] | files that are read only if they are what they should be, and written completely or not at all |
//!
//! # Conventions
//!
//! - **Time.** A frame's `seconds` are on its source's own clock. They order frames and say how far apart they are, but
//!   are no time of day. Sources wait by a [`Clock`], so that tests need not.
//! - **Door frame.** Places in manifests and in the truth are in metres. The origin is on the floor at the middle of
//!   the opening, in the plane of the wall's hidden face. For someone on the visible side who faces the door, x points
//!   to the right, y into the hidden room and z up.
//! - **Pairs** of images are left then right, as seen by that person.
//! - **Light.** Images hold codes as the camera made them; the manifest's transfer function says what linear light they
//!   stand for.
//! - **Faults.** A frame that cannot be read is a [`SkippedFrame`], and the source goes on. Errors name the file and
//!   the key, and what was expected.
//!
//! # Features
//!
//! - `v4l2` (off by default): webcams. Needs Linux, and libclang to build.
//! - `schema` (off by default): OpenAPI schemas of the public types, with utoipa.
//!
//! # Example
//!
//! Makes a small recording of five frames, the first two of the empty room, and reads it back:
//!
//! ```
//! use std::sync::Arc;
//!
//! use doorcam_core::image::{Image, Samples};
//! use doorcam_source::image::{decode, encode_jpeg};
//! use doorcam_source::recording::Recording;
//! use doorcam_source::{Pace, Purpose, RawImages, Replay, ReplayOptions, Source, SourceEvent, SystemClock};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let directory = tempfile::tempdir()?;
//! let manifest = r#"{"fps": 10, "layout": "patches", "transfer": "srgb", "doorway": {"width_m": 0.9}, "fov_m": 0.3,
//!     "background_frames": [0, 2]}"#;
//! std::fs::write(directory.path().join("recording.json"), manifest)?;
//! std::fs::create_dir(directory.path().join("frames"))?;
//! let patch = Image { width: 64, height: 64, samples: Samples::Eight(vec![120; 3 * 64 * 64]) };
//! for name in (0..5).flat_map(|n| [format!("{n:08}_left.jpg"), format!("{n:08}_right.jpg")]) {
//!     std::fs::write(directory.path().join("frames").join(name), encode_jpeg(&patch, 90)?)?;
//! }
//!
//! let recording = Recording::open(directory.path())?;
//! let options = ReplayOptions { pace: Pace::Max, looped: false };
//! let mut source = Replay::new(Arc::new(recording), options, SystemClock::default());
//! let mut empty = 0;
//! while let Some(event) = source.next() {
//!     let SourceEvent::Frame(frame) = event else { continue };
//!     let RawImages::Patches([left, _]) = &frame.images else { continue };
//!     let left = decode(left)?;
//!     println!("{:.1} s: {} x {} pixels, {:?}", frame.seconds, left.width, left.height, frame.purpose);
//!     empty += usize::from(frame.purpose == Purpose::Background);
//! }
//! assert_eq!(empty, 2);
//! # Ok(())
//! # }
//! ```

// Input from users, files and devices must never cause a panic.
#![warn(clippy::unwrap_used, clippy::expect_used)]

mod bounded;
pub mod camera;
mod clock;
pub mod files;
pub mod image;
mod image_error;
pub mod import;
mod jpeg;
mod orientation;
#[cfg_attr(not(feature = "v4l2"), allow(dead_code))]
mod pool;
pub mod recorder;
pub mod recording;
mod replay;
pub mod sensor;
mod skipped;
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
pub use skipped::{SkipKind, SkipTally, SkippedFrame};

/// A frame as captured, not yet decoded: a frame that a newer one replaces need not be decoded.
#[derive(Debug, Clone, PartialEq)]
pub struct RawFrame {
    /// Number of the frame in its recording; none for a live camera.
    pub index: Option<u64>,
    /// What the frame is for.
    pub purpose: Purpose,
    /// Time of capture, in seconds on the source's clock.
    pub seconds: f64,
    /// The undecoded images.
    pub images: RawImages,
    /// Time of day of the capture, if the device reports it; otherwise the time of its hand-over counts.
    pub time: Option<Timestamp>,
    /// Its name in messages: the file's or the camera's.
    pub name: Arc<str>,
}

/// What a frame is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Purpose {
    /// It precedes the background frames and has no role.
    Before,
    /// It shows the empty room.
    Background,
    /// It is to be compared with the background.
    Watch,
    /// Unknown, as for every frame of a live camera.
    Live,
}

/// The images of a frame. Bytes are shared, not copied; a camera's buffers are reused once nobody holds them.
#[derive(Debug, Clone, PartialEq)]
pub enum RawImages {
    /// The camera's view, as a JPEG or PNG.
    Camera(Arc<Vec<u8>>),
    /// The camera's view, as raw pixels from its driver.
    Sensor(SensorFormat, Arc<Vec<u8>>),
    /// Rectified patches, left then right.
    Patches([Arc<Vec<u8>>; 2]),
}

/// What a source reports.
#[derive(Debug, Clone, PartialEq)]
pub enum SourceEvent {
    /// A frame.
    Frame(RawFrame),
    /// A frame that could not be read.
    Skipped(SkippedFrame),
    /// Number of frames that the camera made but that were not fetched in time, or that it never finished.
    Lost(u64),
    /// Number of frames that arrived but were no longer the newest when they were fetched.
    Superseded(u64),
    /// The source's condition has changed.
    Condition(Condition),
    /// Nothing yet: lets the caller check whether to stop.
    Nothing,
}

/// The condition of a source.
#[derive(Debug, Clone, PartialEq)]
pub struct Condition {
    /// Its state.
    pub state: SourceState,
    /// The reason for the state, in one line; none while all is well.
    pub reason: Option<String>,
    /// What the device granted; none while it is not open, and for sources that are not devices.
    pub granted: Option<Granted>,
}

/// The state of a source.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[serde(rename_all = "kebab-case")]
pub enum SourceState {
    /// Before the first frame.
    Opening,
    /// Frames are arriving.
    Streaming,
    /// The device is present but delivers no frames, or none that can be used.
    Stalled,
    /// The device is gone, or the files of the recording are.
    Lost,
    /// Waiting before the next attempt to open the device.
    BackingOff,
    /// There will be no more frames.
    Ended,
    /// The frame loop stopped on an error.
    Failed,
}

/// What a camera granted, which may differ from what was requested.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct Granted {
    /// The device node in use.
    pub node: String,
    /// The name that the camera reports.
    pub card: String,
    /// Pixel format, as a FourCC.
    pub format: String,
    /// Width and height in pixels.
    #[cfg_attr(feature = "schema", schema(value_type = doorcam_core::schema::Size))]
    pub size: [usize; 2],
    /// Frames a second.
    pub fps: f64,
    /// Values of the controls that doorcam manages, by name.
    pub controls: BTreeMap<String, i64>,
    /// One line for each control that does not have the requested value.
    pub mismatches: Vec<String>,
}

/// A source of frames. Each runs on its own thread and may block.
pub trait Source: Send {
    /// Waits for the next event, on a live device for at most a fraction of a second; none when there will be no more.
    fn next(&mut self) -> Option<SourceEvent>;

    /// Whether the frame that came last has to be solved, rather than dropped once there is a newer one.
    fn lossless(&self) -> bool {
        false
    }
}

/// Why a source cannot be opened.
#[derive(Debug, thiserror::Error)]
#[error("{path}: {reason}")]
pub struct SourceError {
    path: String,
    reason: String,
}

impl SourceError {
    /// An error about the file `path`; `reason` says what was expected of it.
    pub fn new(path: &Path, reason: impl Into<String>) -> Self {
        Self { path: files::shown(path), reason: reason.into() }
    }
}
