use nalgebra::{Matrix2, Vector2};

use crate::geometry::Point;

/// A place in polar coordinates around the middle of the doorway (door frame): azimuth in radians, 0 straight into the
/// hidden room and positive to the right, and the log of the distance in metres. What a patch says about a person is
/// nearly Gaussian in these coordinates, with much more uncertainty in the second.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Place {
    pub azimuth: f64,
    pub log_range: f64,
}

impl Place {
    pub fn from_point([x, y]: Point) -> Self {
        Self { azimuth: x.atan2(y), log_range: x.hypot(y).max(f64::MIN_POSITIVE).ln() }
    }

    pub fn point(self) -> Point {
        let (sine, cosine) = self.azimuth.sin_cos();
        let range = self.log_range.exp();
        [range * sine, range * cosine]
    }

    /// ∂(x, y) / ∂(azimuth, log range).
    pub fn jacobian(self) -> Matrix2<f64> {
        let [x, y] = self.point();
        Matrix2::new(y, x, -x, y)
    }

    pub fn minus(self, other: Self) -> Vector2<f64> {
        Vector2::new(self.azimuth - other.azimuth, self.log_range - other.log_range)
    }

    pub fn plus(self, step: Vector2<f64>) -> Self {
        Self { azimuth: self.azimuth + step[0], log_range: self.log_range + step[1] }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn places_are_points_and_their_derivatives(x in -3.0..3.0f64, y in 0.05..5.0f64) {
            let place = Place::from_point([x, y]);
            let near = |a: Point, b: Point, by: f64| (a[0] - b[0]).hypot(a[1] - b[1]) < by;
            prop_assert!(near(place.point(), [x, y], 1e-12 * x.hypot(y)));
            for (k, step) in [Vector2::new(1e-6, 0.0), Vector2::new(0.0, 1e-6)].into_iter().enumerate() {
                let moved = place.plus(step);
                let expected = place.jacobian().column(k) * 1e-6;
                prop_assert!(near(moved.point(), [x + expected[0], y + expected[1]], 1e-10));
                prop_assert!((moved.minus(place) - step).norm() < 1e-14);
            }
        }
    }
}
