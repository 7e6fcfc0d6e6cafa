//! Keys of a scenario that describe an ordinary room.

use serde::{Deserialize, Serialize};

use super::super::scenario::WallName;
use doorcam_core::geometry::Side;
use doorcam_core::scene::Rgb;

/// `[[window]]`: a rectangle of sky in a wall.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct WindowSpec {
    /// The wall.
    pub wall: WallName,
    /// Extent along the wall: x on the back wall, y on a side wall.
    pub along_m: [f64; 2],
    /// Extent above the floor.
    pub up_m: [f64; 2],
    /// Radiance, the same in all directions.
    pub sky: Rgb,
    /// The sun that shines through it; none if it does not.
    #[serde(default)]
    pub sun: Option<SunSpec>,
    /// Times and the level of sky and sun from then on; 1 applies before the first.
    #[serde(default)]
    pub switch: Vec<(f64, f64)>,
}

/// `[window.sun]`
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct SunSpec {
    /// Direction towards the sun, of any length.
    pub towards: [f64; 3],
    /// Irradiance of a surface that faces it.
    pub rgb: Rgb,
}

/// `[[television]]`: a screen on a wall whose light changes from cut to cut.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct TelevisionSpec {
    /// The wall.
    pub wall: WallName,
    /// Extent along the wall: x on the back wall, y on a side wall.
    pub along_m: [f64; 2],
    /// Extent above the floor.
    pub up_m: [f64; 2],
    /// Mean radiance.
    pub rgb: Rgb,
    /// By how much of itself its light is above or below that, at most.
    #[serde(default = "usual_flicker")]
    pub flicker: f64,
}

/// `[leaf]`: the leaf of the door, which stands open into the room.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct LeafSpec {
    /// The edge of the opening at which it hangs, at the hidden face.
    pub hinge: Side,
    /// How far it is open: 0 is shut, 90 is straight into the room.
    pub angle_deg: f64,
    /// Its width.
    pub width_m: f64,
    /// Its height.
    #[serde(default = "usual_leaf_height")]
    pub height_m: f64,
    /// Its albedo.
    #[serde(default = "usual_leaf")]
    pub albedo: Rgb,
}

/// `[[furniture]]`: a box.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct FurnitureSpec {
    /// Extent along x.
    pub x_m: [f64; 2],
    /// Extent along y.
    pub y_m: [f64; 2],
    /// Extent above the floor.
    pub up_m: [f64; 2],
    /// Its albedo.
    pub albedo: Rgb,
}

/// Where a rectangular panel shines to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum LampFacing {
    /// Straight down.
    #[default]
    Down,
    /// To the left.
    Left,
    /// To the right.
    Right,
    /// Towards the back wall.
    Back,
    /// Towards the doorway.
    Front,
}

fn usual_flicker() -> f64 {
    0.6
}
fn usual_leaf_height() -> f64 {
    1.98
}
fn usual_leaf() -> Rgb {
    [0.62, 0.60, 0.55]
}
