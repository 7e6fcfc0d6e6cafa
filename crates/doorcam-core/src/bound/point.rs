use nalgebra::{DMatrix, Matrix2, Matrix3, Vector3};

use super::information::covariance;
use super::pixel_light::{PixelLight, patch_light};
use crate::geometry::{Biangular, Doorway, Point, Side};

/// One of the four ways to measure that figure 5 of the paper compares.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Strategy {
    /// The left patch, with nothing that casts a shadow on it.
    SinglePatch,
    /// The left patch with its edge, as if the wall ended there.
    SingleCorner,
    /// Both patches, with nothing that casts a shadow on them.
    DoublePatch,
    /// Both patches, each with its edge.
    Doorway,
}

impl Strategy {
    /// All four, in the order of the figure.
    pub const ALL: [Strategy; 4] =
        [Strategy::SinglePatch, Strategy::SingleCorner, Strategy::DoublePatch, Strategy::Doorway];

    /// The word used in tables and files.
    pub fn name(self) -> &'static str {
        match self {
            Strategy::SinglePatch => "single-patch",
            Strategy::SingleCorner => "single-corner",
            Strategy::DoublePatch => "double-patch",
            Strategy::Doorway => "doorway",
        }
    }

    /// Whether edges block light.
    pub fn has_edge(self) -> bool {
        matches!(self, Strategy::SingleCorner | Strategy::Doorway)
    }

    /// The patches that are measured.
    pub fn sides(self) -> &'static [Side] {
        match self {
            Strategy::SinglePatch | Strategy::SingleCorner => &Side::BOTH[..1],
            Strategy::DoublePatch | Strategy::Doorway => &Side::BOTH,
        }
    }
}

/// What is measured, and how well: patches beside a doorway, their pixels and the noise of each.
///
/// The target is a point of brightness c_s = 1 on the hidden floor; the bound depends only on noise / c_s. A pixel's
/// value is the integral of eq. 9 or 10 over its area in m², and `noise` has the same unit. As in those equations, each
/// patch sees only past its own edge; the other edge would block light only from targets almost in line with the wall.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Setup {
    /// The doorway. Its lintel does not matter, since the target is on the floor; its leaf is left out.
    pub doorway: Doorway,
    /// Side of a patch, in metres.
    pub patch_m: f64,
    /// Pixels along each side of a patch: √M.
    pub pixels: usize,
    /// σ, the standard deviation of a pixel.
    pub noise: f64,
}

/// Why a bound cannot be computed.
#[derive(Debug, thiserror::Error, PartialEq)]
#[error("{key} is {value}, expected {expected}")]
pub struct SetupError {
    /// The value at fault: door, wall, patch, pixels, noise, ...
    pub key: &'static str,
    /// The value given.
    pub value: f64,
    /// The accepted range.
    pub expected: String,
}

/// Checks that a value is in its range.
pub(super) fn within(
    key: &'static str,
    value: f64,
    range: std::ops::RangeInclusive<f64>,
    unit: &str,
) -> Result<(), SetupError> {
    if range.contains(&value) {
        return Ok(());
    }
    Err(SetupError { key, value, expected: format!("{unit} from {} to {}", range.start(), range.end()) })
}

impl Setup {
    /// The setup of figure 5: edges 1 m apart in a thin wall, patches of 0.2 m, 125 x 125 pixels.
    ///
    /// The paper does not state its noise. With this value, its description of the figure holds, and the signal of a
    /// target 1 m away is 2.6 times a pixel's noise.
    pub const PUBLISHED: Setup = Setup {
        doorway: Doorway { width_m: 1.0, wall_thickness_m: 0.0, height_m: None, leaf: None },
        patch_m: 0.2,
        pixels: 125,
        noise: 1e-6,
    };

    /// Largest number of pixels along a side of a patch.
    pub const MOST_PIXELS: usize = 1000;

    /// Checks that all values are in range.
    ///
    /// # Errors
    ///
    /// If a value is out of range; the error names it.
    pub fn validate(&self) -> Result<(), SetupError> {
        within("door", self.doorway.width_m, 0.01..=100.0, "metres")?;
        within("wall", self.doorway.wall_thickness_m, 0.0..=10.0, "metres")?;
        within("patch", self.patch_m, 0.001..=10.0, "metres")?;
        within("pixels", self.pixels as f64, 1.0..=Self::MOST_PIXELS as f64, "pixels along a side")?;
        if self.noise.is_finite() && self.noise > 0.0 {
            return Ok(());
        }
        Err(SetupError { key: "noise", value: self.noise, expected: "a number above 0".into() })
    }

    /// The bound of one strategy for a target at a point with y > 0, in metres in the door frame.
    pub fn bound(&self, strategy: Strategy, target: Point) -> Bound {
        let light = |&side: &Side| patch_light(self, side, strategy.has_edge(), target);
        let information = strategy.sides().iter().map(|side| information(&light(side))).sum();
        Bound::new(&self.doorway, target, &information).scaled(self.noise)
    }

    /// The bounds of all strategies, in the order of [`Strategy::ALL`].
    pub fn bounds(&self, target: Point) -> [Bound; 4] {
        let of = |edge| Side::BOTH.map(|side| information(&patch_light(self, side, edge, target)));
        let (free, cut) = (of(false), of(true));
        let sums = [free[0], cut[0], free[0] + free[1], cut[0] + cut[1]];
        sums.map(|information| Bound::new(&self.doorway, target, &information).scaled(self.noise))
    }
}

/// Fisher information on (c_s, x, y) in one patch with unit noise: ∇Iᵀ∇I.
fn information(pixels: &[PixelLight]) -> Matrix3<f64> {
    let mut sum = Matrix3::zeros();
    for &PixelLight { light, by } in pixels {
        let gradient = Vector3::new(light, by[0], by[1]);
        sum.ger(1.0, &gradient, &gradient, 1.0);
    }
    sum
}

/// The smallest standard deviations and covariance of an unbiased estimate (eq. 11); infinite for what the pixels
/// cannot determine.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bound {
    /// √CRB(c_s), for a brightness of 1.
    pub sd_c: f64,
    /// √CRB(φ1), in radians.
    pub sd_phi1: f64,
    /// √CRB(φ2), in radians.
    pub sd_phi2: f64,
    /// Covariance of (x, y), in m², in the door frame.
    pub covariance_m2: [[f64; 2]; 2],
}

impl Bound {
    /// From the Fisher information on (c, x, y).
    pub(super) fn new(doorway: &Doorway, target: Point, information: &Matrix3<f64>) -> Self {
        let all = DMatrix::from_column_slice(3, 3, information.as_slice());
        let Some(covariance) = covariance(&all) else { return Self::UNOBSERVABLE };
        let place = Matrix2::from_fn(|i, j| covariance[(i + 1, j + 1)]);
        let turn = angles_by_place(doorway, target);
        let angles = turn * place * turn.transpose();
        Self {
            sd_c: covariance[(0, 0)].sqrt(),
            sd_phi1: angles[(0, 0)].max(0.0).sqrt(),
            sd_phi2: angles[(1, 1)].max(0.0).sqrt(),
            covariance_m2: [[place[(0, 0)], place[(0, 1)]], [place[(1, 0)], place[(1, 1)]]],
        }
    }

    /// For a target that the pixels do not determine.
    const UNOBSERVABLE: Bound = Bound {
        sd_c: f64::INFINITY,
        sd_phi1: f64::INFINITY,
        sd_phi2: f64::INFINITY,
        covariance_m2: [[f64::INFINITY, 0.0], [0.0, f64::INFINITY]],
    };

    /// The bound for `noise` times the noise.
    fn scaled(self, noise: f64) -> Self {
        Self {
            sd_c: noise * self.sd_c,
            sd_phi1: noise * self.sd_phi1,
            sd_phi2: noise * self.sd_phi2,
            covariance_m2: self.covariance_m2.map(|row| row.map(|v| noise * noise * v)),
        }
    }

    /// Root of the mean squared distance from the true place, in metres: √(var x + var y).
    pub fn error_m(&self) -> f64 {
        (self.covariance_m2[0][0] + self.covariance_m2[1][1]).sqrt()
    }
}

/// ∂(φ1, φ2) / ∂(x, y): each angle changes by the movement across its ray, divided by the range.
fn angles_by_place(doorway: &Doorway, [x, y]: Point) -> Matrix2<f64> {
    let (along1, along2) = (x + doorway.half_width(), doorway.half_width() - x);
    let (squared1, squared2) = (along1 * along1 + y * y, along2 * along2 + y * y);
    Matrix2::new(-y / squared1, along1 / squared1, y / squared2, along2 / squared2)
}

/// The place, in metres in the door frame, with the angles (φ1, φ2); none if the rays do not meet in the hidden room.
pub fn place_of(doorway: &Doorway, angles: Biangular) -> Option<Point> {
    let inside = |a: f64| a > 0.0 && a < std::f64::consts::PI;
    let place = angles.to_point(doorway);
    let meets = inside(angles.alpha1) && inside(angles.alpha2) && angles.gamma() > 0.0;
    (meets && place.iter().all(|v| v.is_finite()) && place[1] > 0.0).then_some(place)
}
