//! People, from what changed in one frame to who is where.
//!
//! A [`Detection`] is what one frame says about somebody; a [`Track`] is what all frames so far say. A [`Tracker`] makes
//! tracks from detections.

mod association;
mod colour;
mod detection;
mod filter;
mod motion;
mod person;
mod track;
mod tracker;
#[cfg(test)]
mod tracker_tests;

pub use detection::Detection;
pub use track::{Covariance, Track, TrackState};
pub use tracker::{Prediction, Tracker, TrackerSettings};
