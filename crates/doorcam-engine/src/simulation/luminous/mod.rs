//! A room of self-luminous surfaces, evaluated directly: the simplest scene there is, for tests and `doorcam bench`.
//!
//! Walls are segments, people are vertical cylinders anywhere, and each floor point integrates over azimuth what it
//! sees through the opening ([`direct`]). There are no lamps, no shadows except those of the opening and of people in
//! front of something, and no bounces: a person adds light, while in most real rooms people take light away. For such
//! rooms, use [`super::Simulator`].

pub mod direct;
mod recording;
mod renderer;
mod scenario;
mod sensor;

pub use recording::write_recording;
pub use renderer::Renderer;
pub use scenario::{Person, Scenario};
pub use sensor::Sensor;

use super::{SimulationError, Walk};
