use serde::{Deserialize, Serialize};

use crate::geometry::Point;

/// How the picture of a camera that moved differs from the one before: what was seen at a pixel is seen at another one.
///
/// A camera that is turned a little moves its picture as a whole; the farther it is turned, the more the picture's far
/// parts grow or shrink (`tilt`).
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Motion {
    /// The pixel about which it turns, the middle of the picture.
    pub centre_px: Point,
    /// Where that pixel went: to the right and down, in pixels.
    pub shift_px: Point,
    /// Clockwise rotation, as seen in the picture, in radians.
    pub rotation: f64,
    /// Growth of the picture per pixel to the right and down.
    pub tilt_per_px: Point,
}

impl Motion {
    /// No motion.
    pub fn none(centre_px: Point) -> Self {
        Self { centre_px, ..Self::default() }
    }

    /// Where what was seen at `pixel` is seen now.
    pub fn apply(&self, pixel: Point) -> Point {
        let [x, y] = [pixel[0] - self.centre_px[0], pixel[1] - self.centre_px[1]];
        let (sin, cos) = self.rotation.sin_cos();
        let grown = 1.0 + self.tilt_per_px[0] * x + self.tilt_per_px[1] * y;
        let turned = [cos * x - sin * y, sin * x + cos * y];
        [0, 1].map(|k| self.centre_px[k] + self.shift_px[k] + grown * turned[k])
    }

    /// The farthest that any of these pixels has moved since `before`, another motion from the same picture.
    pub fn farthest_px(&self, before: &Self, pixels: &[Point]) -> f64 {
        let moved = |&pixel: &Point| {
            let (now, then) = (self.apply(pixel), before.apply(pixel));
            (now[0] - then[0]).hypot(now[1] - then[1])
        };
        pixels.iter().map(moved).fold(0.0, f64::max)
    }

    /// The same motion of a picture reduced by `scale`.
    pub(super) fn reduced(&self, scale: usize, centre_px: Point) -> Self {
        let scale = scale as f64;
        Self {
            centre_px,
            shift_px: self.shift_px.map(|v| v / scale),
            rotation: self.rotation,
            tilt_per_px: self.tilt_per_px.map(|v| v * scale),
        }
    }

    /// The same motion of the picture of which this one's is a reduction by `scale`.
    pub(super) fn enlarged(&self, scale: usize, centre_px: Point) -> Self {
        let scale = scale as f64;
        Self {
            centre_px,
            shift_px: self.shift_px.map(|v| v * scale),
            rotation: self.rotation,
            tilt_per_px: self.tilt_per_px.map(|v| v / scale),
        }
    }
}
