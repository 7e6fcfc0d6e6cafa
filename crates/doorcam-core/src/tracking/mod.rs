//! Finds and tracks people, and reports what they do.
//!
//! A [`Detection`] is what one frame says about a person; a [`Track`] is what all frames so far say. A [`Tracker`]
//! turns detections into tracks, and [`Events`] turns tracks into events.

mod association;
mod colour;
mod detection;
mod event_kind;
mod events;
mod filter;
pub mod likelihood;
mod motion;
mod person;
mod track;
mod tracker;
#[cfg(test)]
mod tracker_tests;
mod zones;

pub use detection::Detection;
pub use event_kind::{Direction, EventKind, ExitReason, Through};
pub use events::{Dwelling, Event, Events, Occupancy};
pub(crate) use filter::Filter;
pub(crate) use motion::Motion;
pub use track::{Covariance, Track, TrackState};
pub use tracker::{Prediction, Tracker, TrackerSettings};
pub use zones::{Zone, ZoneError};
