//! People, from what changed in one frame to who is where.
//!
//! A [`Detection`] is what one frame says about somebody; a [`Track`] is what all frames so far say.

mod detection;
mod track;

pub use detection::Detection;
pub use track::{Covariance, Track, TrackState};
