//! The optics, the inverse problem and the tracking of the doorway camera.

// What a user, a file or a device gives must never panic.
#![warn(clippy::unwrap_used, clippy::expect_used)]

pub mod bound;
pub mod calibration;
pub mod geometry;
pub mod image;
pub mod light;
pub mod optics;
pub mod quadrature;
pub mod scene;
#[cfg(feature = "schema")]
pub mod schema;
pub mod solver;
pub mod tracking;
pub mod transport;
