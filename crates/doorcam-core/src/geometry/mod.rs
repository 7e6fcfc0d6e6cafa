//! The doorway, biangular coordinates and the facet grid (paper: eq. 3, eq. 5, figure 6).
//!
//! Everything here is in the **door frame**: origin on the floor at the middle of the opening, in the plane of the
//! wall's hidden face; x to the right for someone on the visible side who faces the door, y into the hidden room, z up;
//! metres and radians.

mod biangular;
mod doorway;
mod grid;
mod leaf;
mod room_light;

pub use biangular::Biangular;
pub(crate) use doorway::unit_hint;
pub use doorway::{Doorway, Side};
pub use grid::{Facet, FacetGrid, GridSpec, Room};
pub use leaf::Leaf;
pub use room_light::{FoundLight, LightError, LightKind, RoomLight};

/// A point or vector on the floor plan, in metres: `[x, y]` in the door frame.
pub type Point = [f64; 2];

/// Why a doorway, room or grid cannot be used.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum GeometryError {
    /// A length or angle is out of range.
    #[error("{key} is {value}, expected {expected}")]
    OutOfRange {
        /// The configuration or recording key.
        key: &'static str,
        /// The value given.
        value: f64,
        /// The accepted range.
        expected: String,
    },
    /// The doorway does not fit into the wall of the room.
    #[error("doorway.width_m is {width_m}, wider than the room ({room_m} m, room.half_width_m = {half_width_m})")]
    WiderThanRoom {
        /// Width of the opening, in metres.
        width_m: f64,
        /// Width of the room, in metres.
        room_m: f64,
        /// Half of it, which is the key the user sets.
        half_width_m: f64,
    },
    /// No facet of the grid lies in the room.
    #[error("the reconstruction grid is empty: no facet lies inside the room (check [room] and [grid])")]
    EmptyGrid,
}
