//! Keys of a scenario that describe what is on the visible side.

use serde::Deserialize;

use doorcam_core::scene::Rgb;

/// `[[visible.lamp]]`: a lamp of the visible side, which throws shadows.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VisibleLampSpec {
    /// Its centre.
    pub at_m: [f64; 3],
    /// Its radius: determines how soft shadows are.
    pub radius_m: f64,
    /// Its part of the visible side's light on the floor beside the edges.
    pub share: f64,
}

/// `[[object]]`: a bag that lies on the floor of the visible side.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObjectSpec {
    /// Its middle.
    pub at_m: [f64; 2],
    /// Its length.
    #[serde(default = "usual_length")]
    pub length_m: f64,
    /// Its height and width.
    #[serde(default = "usual_thickness")]
    pub thickness_m: f64,
    /// Angle of its length to the wall, in degrees.
    #[serde(default)]
    pub turn_deg: f64,
    /// Its albedo.
    pub albedo: Rgb,
    /// When it is put there, in seconds.
    pub from_s: f64,
    /// When it is taken away; none if it stays.
    #[serde(default)]
    pub until_s: Option<f64>,
}

/// `[wall]`: the doorway's wall, seen from the visible side.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct WallSpec {
    /// Mean albedo.
    pub albedo: Rgb,
    /// Standard deviation of its speckle, relative to the albedo.
    pub speckle: f64,
    /// Size of a speckle.
    pub grain_m: f64,
}

impl Default for WallSpec {
    fn default() -> Self {
        Self { albedo: [0.52, 0.50, 0.47], speckle: 0.0, grain_m: 0.01 }
    }
}

fn usual_length() -> f64 {
    0.4
}
fn usual_thickness() -> f64 {
    0.22
}
