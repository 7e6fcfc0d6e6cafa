//! A pinhole camera from first principles, for tests.

use crate::geometry::Point;

/// A camera at `at` (door frame, metres, z up) that faces the door, then turns right by `turn`, looks down by `tilt`
/// and rolls by `roll` (radians). `focal` and `centre` are in pixels.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Pinhole {
    pub(crate) at: [f64; 3],
    pub(crate) tilt: f64,
    pub(crate) turn: f64,
    pub(crate) roll: f64,
    pub(crate) focal: f64,
    pub(crate) centre: Point,
}

impl Pinhole {
    /// Image position of a floor point; `None` if it is behind the camera or nearly beside it.
    pub(crate) fn see(&self, floor: Point) -> Option<Point> {
        let (dx, dy, dz) = (floor[0] - self.at[0], floor[1] - self.at[1], -self.at[2]);
        let (right, ahead) = (dx * self.turn.cos() - dy * self.turn.sin(), dx * self.turn.sin() + dy * self.turn.cos());
        let depth = ahead * self.tilt.cos() - dz * self.tilt.sin();
        let down = -ahead * self.tilt.sin() - dz * self.tilt.cos();
        let (right, down) =
            (right * self.roll.cos() - down * self.roll.sin(), right * self.roll.sin() + down * self.roll.cos());
        (depth > 0.05)
            .then(|| [self.centre[0] + self.focal * right / depth, self.centre[1] + self.focal * down / depth])
    }
}
