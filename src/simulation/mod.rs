//! A doorway whose truth is known: recordings made by evaluating eq. 2 directly, not by the reconstruction's own matrix.
//!
//! The reconstruction knows flat facets on a grid. Here the hidden room is continuous: walls are segments, people are
//! vertical cylinders anywhere, and each floor point integrates over azimuth what it sees through the opening
//! ([`direct`]). What shows and how it moves is a [`Scenario`]; [`write_recording`] makes a recording of it, noise and
//! truth included.
//!
//! All surfaces are self-luminous. There are no lamps, no shadows but those of the opening and of people in front of
//! something, and no light that bounces: a person adds light where in most real rooms one takes light away.

pub mod direct;
mod quadrature;
mod recording;
mod renderer;
mod scenario;
mod sensor;
mod walk;

pub use quadrature::Quadrature;
pub use recording::{SimulationError, write_recording};
pub use renderer::Renderer;
pub use scenario::{Person, Scenario};
pub use sensor::Sensor;
pub use walk::Walk;
