//! Ordinary rooms: windows and their sun, lamps and panels that the floor sees, televisions, furniture, the door's leaf,
//! people with legs and arms, and glossy floors.
//!
//! [`OrdinaryLight`] does for scenarios that have any of these what [`super::light`] does for the others, from the same
//! floor points. Everything that a floor point sees is a matter of azimuth and elevation: an upright cylinder, box or
//! window covers an interval of elevations in each azimuth, and what is nearer hides what is farther. Sources are seen
//! as what they are, exactly; walls, ceiling and furniture in texels, whose light is exchanged with all others in the
//! empty room.

mod check;
mod column;
mod gloss;
mod light;
mod person;
mod radiosity;
mod shell;
mod solid;
mod source;
mod spec;
mod truth;

pub(super) use check::check;
pub(super) use light::OrdinaryLight;
pub(super) use person::Person;
pub use spec::{FurnitureSpec, LampFacing, LeafSpec, SunSpec, TelevisionSpec, WindowSpec};
pub(super) use truth::TrueRoom;
