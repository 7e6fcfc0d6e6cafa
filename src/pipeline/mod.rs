//! The frame loop: from a source's frames to updates that everyone shares.
//!
//! One thread captures, one solves; between them is a slot for the newest frame ([`Mailbox`]). Each solved frame becomes
//! one immutable [`Published`] update, serialised once, in the [`Hub`].

mod background;
mod calibration_store;
mod calibrator;
mod engine;
mod frames;
mod hub;
mod mailbox;
mod meters;
mod model;
mod people;
mod problem;
mod recent;
mod reconstructor;
mod recordings;
mod run;
mod setup;
mod tap;
mod texture_reach;
mod update;
mod zones;

pub use background::{BackgroundStore, Work};
pub use calibration_store::{CalibrationStore, StoreError};
pub use calibrator::{CalibrationRefused, CalibrationReport, Calibrator, Keeping};
pub use engine::{Engine, StepError};
pub use frames::{FrameReader, ReadTimes};
pub use hub::{Hub, Published, Seen, SourceInfo, Status, Watched};
pub use mailbox::{Mailbox, Taken};
pub use model::{Model, SetupError};
pub use people::People;
pub use problem::Problem;
pub use recent::{PathPoint, TrackHistory};
pub use reconstructor::{Reconstruction, Reconstructor};
pub use recordings::{RecordingRefused, RecordingReport, RecordingWish, Recordings};
pub use run::{Command, Control, Running, start};
pub use setup::Setup;
pub use update::{BackgroundReport, FacetReport, State, Timing, Update};
pub use zones::{ZoneKeeper, ZoneOrigin, ZonesRefused};
