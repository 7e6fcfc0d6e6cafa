use super::{Doorway, Point};

/// Biangular coordinates (α1, α2) of a point of the floor plan: the inner angles, in radians, of the triangle left
/// edge, right edge, point (paper, section 2.2).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Biangular {
    /// α1, the angle at the left edge, measured from the opening.
    pub alpha1: f64,
    /// α2, the angle at the right edge.
    pub alpha2: f64,
}

impl Biangular {
    /// α1 = atan2(y, x + W/2), α2 = atan2(y, W/2 − x).
    pub fn from_point(doorway: &Doorway, [x, y]: Point) -> Self {
        let half = doorway.half_width();
        Self { alpha1: y.atan2(x + half), alpha2: y.atan2(half - x) }
    }

    /// The point with these angles, in metres in the door frame: y (cot α1 + cot α2) = W. y is infinite or negative
    /// where the two rays do not meet in the hidden room (α1 + α2 >= π).
    pub fn to_point(self, doorway: &Doorway) -> Point {
        let (cot1, cot2) = (self.alpha1.tan().recip(), self.alpha2.tan().recip());
        let y = doorway.width_m / (cot1 + cot2);
        // A ray along the wall has an infinite cotangent; x then follows from the other angle.
        let x = if cot2.abs() < cot1.abs() { doorway.half_width() - y * cot2 } else { y * cot1 - doorway.half_width() };
        [x, y]
    }

    /// γ = π − α1 − α2, the angle that the doorway subtends at the point, in radians.
    pub fn gamma(self) -> f64 {
        std::f64::consts::PI - self.alpha1 - self.alpha2
    }

    /// (ρ1, ρ2), the floor distances from the left and the right edge, in metres, by the law of sines (eq. 5).
    pub fn ranges(self, doorway: &Doorway) -> (f64, f64) {
        let scale = doorway.width_m / self.gamma().sin();
        (scale * self.alpha2.sin(), scale * self.alpha1.sin())
    }
}

/// Squared floor distance between a floor point at range `r` and angle `theta` from the wall and a hidden point at
/// range `rho` and angle `alpha`, both measured at one edge (eq. 3).
#[cfg(test)]
fn squared_distance(r: f64, theta: f64, rho: f64, alpha: f64) -> f64 {
    r * r + rho * rho - 2.0 * r * rho * (std::f64::consts::PI - theta + alpha).cos()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn doorway(width_m: f64) -> Doorway {
        Doorway { width_m, wall_thickness_m: 0.0, height_m: None, leaf: None }
    }

    proptest! {
        #[test]
        fn point_to_angles_and_back(w in 0.3..3.0, x in -4.0..4.0, y in 0.05..6.0) {
            let door = doorway(w);
            let angles = Biangular::from_point(&door, [x, y]);
            let [bx, by] = angles.to_point(&door);
            prop_assert!((bx - x).abs() < 1e-9 * (1.0 + x.abs()), "{bx} {x}");
            prop_assert!((by - y).abs() < 1e-9 * (1.0 + y), "{by} {y}");
        }

        #[test]
        fn ranges_are_the_distances_to_the_edges(w in 0.3..3.0, x in -4.0..4.0, y in 0.05..6.0) {
            let door = doorway(w);
            let (rho1, rho2) = Biangular::from_point(&door, [x, y]).ranges(&door);
            prop_assert!((rho1 - (x + w / 2.0).hypot(y)).abs() < 1e-9 * rho1);
            prop_assert!((rho2 - (x - w / 2.0).hypot(y)).abs() < 1e-9 * rho2);
        }

        /// Eq. 3 uses angles at the left edge: θ from the wall on the visible side, α from the opening on the hidden
        /// side. It must equal the plain distance on the floor plan.
        #[test]
        fn equation_3_is_the_distance_on_the_floor(
            w in 0.3..3.0, x in -3.0..3.0, y in 0.05..4.0, r in 0.01..0.4f64, turn in 0.0..1.0f64,
        ) {
            let theta = turn * std::f64::consts::PI;
            let door = doorway(w);
            // θ is measured away from the wall, which lies on the -x side of the left edge.
            let floor = [-w / 2.0 - r * theta.cos(), -r * theta.sin()];
            let angles = Biangular::from_point(&door, [x, y]);
            let literal = squared_distance(r, theta, angles.ranges(&door).0, angles.alpha1);
            let plain = (floor[0] - x).powi(2) + (floor[1] - y).powi(2);
            prop_assert!((literal - plain).abs() < 1e-9 * plain, "{literal} {plain}");
        }

        /// Past the left edge, a floor point at angle θ from the wall sees exactly the hidden points with α1 < θ.
        #[test]
        fn alpha1_decides_what_a_floor_point_sees_past_the_left_edge(
            x in -3.0..3.0, y in 0.05..4.0, r in 0.01..0.2f64, theta in 0.01..3.13f64,
        ) {
            let door = doorway(0.8);
            let alpha1 = Biangular::from_point(&door, [x, y]).alpha1;
            prop_assume!((alpha1 - theta).abs() > 1e-6);
            let floor = [-0.4 - r * theta.cos(), -r * theta.sin()];
            let crossing = floor[0] + (x - floor[0]) * (-floor[1]) / (y - floor[1]);
            prop_assert_eq!(crossing > -0.4, alpha1 < theta);
        }
    }
}
