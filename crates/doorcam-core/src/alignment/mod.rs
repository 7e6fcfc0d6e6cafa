//! Whether the camera still looks where it looked when it was calibrated.
//!
//! A small grey [`Overview`] of the empty room is kept as the [`Reference`]. [`Reference::compare`] finds the
//! [`Motion`] that takes it to the present picture. It goes by small cells with edges in them, each with a contrast of
//! its own, so that lamps may change, and asks how many of them agree, so that people may cover some.

mod coarse;
mod filtered;
mod fine;
mod motion;
mod overview;
mod reference;
#[cfg(test)]
mod tests;

pub use motion::Motion;
pub use overview::Overview;
pub use reference::{Match, Reference};
