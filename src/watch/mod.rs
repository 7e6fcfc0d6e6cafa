//! The frame loop: turns a source's frames into updates that all readers share.
//!
//! One thread captures and one solves; between them is a slot for the newest frame ([`Mailbox`]). Each solved frame
//! becomes one immutable update ([`doorcam_engine::Published`]), serialised once and handed to the [`Hub`].

mod calibration_store;
mod calibrator;
mod crossing_keeper;
mod crossings;
mod hub;
mod mailbox;
mod meters;
mod rate;
mod recent;
mod recordings;
mod run;
mod skips;
mod status;
mod tap;
mod watching;
mod zone_ids;
mod zones;

pub use calibration_store::{CalibrationStore, StoreError};
pub use calibrator::{CalibrationRefused, CalibrationReport, Calibrator, Keeping, Precondition};
pub use crossing_keeper::{CrossingKeeper, InsideRefused};
pub use crossings::{CrossingsReport, MOST_INSIDE};
pub use hub::{CapturedImages, Hub};
pub use mailbox::{Mailbox, Put, Taken};
pub use recent::{PathPoint, TrackHistory};
pub use recordings::{RecordingRefused, RecordingReport, RecordingWish, Recordings};
pub use run::{Command, Control, Running, start};
pub use status::Status;
pub use watching::{Reason, Watching};
pub use zone_ids::ZoneIds;
pub use zones::{ZoneKeeper, ZoneOrigin, ZonesRefused};
