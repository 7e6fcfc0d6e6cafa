//! A room of self-luminous surfaces, evaluated directly: the plainest scene there is, for tests and `doorcam bench`.
//!
//! Walls are segments, people are vertical cylinders anywhere, and each floor point integrates over azimuth what it sees
//! through the opening ([`direct`]). There are no lamps, no shadows but those of the opening and of people in front of
//! something, and no light that bounces: a person adds light where in most real rooms one takes light away. For such rooms
//! there is [`super::Simulator`].

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
