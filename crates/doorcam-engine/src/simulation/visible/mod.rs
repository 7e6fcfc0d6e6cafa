//! The camera's own side: lamps that throw shadows, people who walk there and through the doorway, and things on the
//! floor.
//!
//! A person is made of [`Capsule`]s: feet, shanks, thighs, trunk, shoulders, arms and head, as their [`Pose`] says. A
//! pixel shows a capsule if its line of sight meets one before it meets wall or floor. A lamp's shadow is what capsules
//! hide of its sphere. Light that comes from everywhere is dimmed by the part of the sky that upright cylinders of the
//! same size cover.

mod body;
mod capsule;
mod gait;
mod lamp;
mod spec;
mod stage;

pub(super) use body::{Body, Looks};
pub(super) use gait::pose;
pub(super) use lamp::VisibleLamp;
pub use spec::{ObjectSpec, VisibleLampSpec, WallSpec};
pub(super) use stage::{Sight, Stage};
