//! What the hidden room looks like while nobody is in it: what a person there hides.
//!
//! The empty floor's penumbra is the integral of the room's light over azimuth and elevation, at both edges. It is
//! explained as the light of pieces of the walls and of the ceiling, plus light from the visible side
//! ([`StillRoom::fit`]). A person takes away what lies behind their outline, up to their own height ([`Seen::hidden`]).

mod bright;
#[cfg(test)]
mod described_tests;
mod fit;
mod least_squares;
mod seen;
mod surfaces;
#[cfg(test)]
pub(crate) mod tests;

pub use bright::{BrightThing, Place};
pub use fit::Empty;
pub use seen::Seen;

use crate::geometry::{Doorway, FoundLight};
use crate::scene::Rgb;
use crate::transport::FloorView;
use surfaces::Surfaces;

/// Least share of the floor's light that comes from windows and lamps on the walls in a room that has some. Walls beside
/// hidden lamps are far below it.
const LEAST_BRIGHT_SHARE: f64 = 0.05;
/// Least part of the light of all bright things that comes from those on the walls, in such a room. It is less where lamps
/// hang from the ceiling, and what the fit takes for light of the walls belongs to them.
const LEAST_PART_OF_BRIGHT: f64 = 0.25;

/// The still room: radiance of its walls and its ceiling.
#[derive(Debug, Clone, PartialEq)]
pub struct StillRoom {
    surfaces: Surfaces,
    /// Per piece.
    radiance: Vec<Rgb>,
    /// Per piece of the walls, the part of its radiance by which it is brighter than usual; 0 on the ceiling.
    excess: Vec<Rgb>,
    /// Light of the visible side on each patch.
    visible: [Rgb; 2],
    /// Root mean square of what is left unexplained, relative to the floor's level.
    misfit: f64,
    /// Share of the floor's light that comes from bright things on the walls.
    bright_share: f64,
    /// The same of those on the ceiling, too.
    all_bright_share: f64,
}

impl StillRoom {
    /// What a floor point sees of the bright things on the walls. Those on the ceiling are not among them: how far away
    /// they are is known too badly to tell whether they are seen over somebody's head.
    pub fn seen(&self, doorway: &Doorway, view: &FloorView) -> Seen {
        Seen::new(doorway, &self.surfaces, &self.excess, view)
    }

    /// Light of the visible side on the left and the right patch, relative to full scale.
    pub fn visible(&self) -> [Rgb; 2] {
        self.visible
    }

    /// Root mean square of the part of the empty picture that is not explained, relative to its level.
    pub fn misfit(&self) -> f64 {
        self.misfit
    }

    /// Share of the floor's light that comes from bright things on the walls.
    pub fn bright_share(&self) -> f64 {
        self.bright_share
    }

    /// Whether there is enough of it that what people hide is more than a change of their own radiance.
    pub fn is_bright(&self) -> bool {
        self.bright_share > LEAST_BRIGHT_SHARE && self.bright_share > LEAST_PART_OF_BRIGHT * self.all_bright_share
    }

    /// What is brighter than the walls around it, the one with the most light first.
    pub fn bright_things(&self) -> Vec<BrightThing> {
        bright::find(&self.surfaces, &self.radiance)
    }

    /// The same, on the floor plan in the door frame.
    pub fn found(&self) -> Vec<FoundLight> {
        self.bright_things().iter().map(|thing| thing.in_room(self.surfaces.room())).collect()
    }
}
