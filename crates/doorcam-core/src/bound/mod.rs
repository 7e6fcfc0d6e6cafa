//! How well a hidden target can be located at best: the Cramér-Rao bound (paper, section 3, eq. 6 to 11).
//!
//! No unbiased estimate from the same pixels has a smaller variance. The bound is computed for a point on the floor, as
//! in the paper, and for a person, with the four ways of measuring that the paper's figure 5 compares.

mod information;
mod nuisance;
mod person;
mod pixel_light;
mod plan;
mod plotted;
mod point;
mod quadrature;
mod room;
mod sample;

#[cfg(test)]
mod tests;

pub use person::PersonSetup;
pub use plan::Choice;
pub use plotted::plotted_angles;
pub use point::{Bound, Setup, SetupError, Strategy, place_of};
pub use room::{RoomBound, UncertaintyMap};
pub use sample::sample_measurement;
