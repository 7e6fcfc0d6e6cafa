//! Radial lens distortion and its inverse.

use std::ops::RangeInclusive;

use crate::geometry::Point;
use crate::optics::Lens;

/// Coefficients that a lens can have: far more than fisheyes have, for focal lengths that are given too large.
const COEFFICIENT: RangeInclusive<f64> = -1e3..=1e3;

/// Focal lengths that a lens can have, in pixels.
const FOCAL_PX: RangeInclusive<f64> = 1.0..=1e6;

/// A distortion that cannot be inverted. The message names the key and says what was expected.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LensError {
    /// A coefficient that no lens has.
    #[error("lens.{key} is {value}, expected {} to {}", COEFFICIENT.start(), COEFFICIENT.end())]
    Coefficient {
        /// The key.
        key: &'static str,
        /// The value.
        value: f64,
    },
    /// A focal length that no lens has.
    #[error("lens.focal_px is {0}, expected {least} to {most} pixels", least = FOCAL_PX.start(), most = FOCAL_PX.end())]
    Focal(f64),
    /// The distortion folds back within the image: two ideal positions would be seen at the same pixel.
    #[error(
        "lens.k1 = {k1}, lens.k2 = {k2} fold the image back {reach_px:.0} pixels from its centre, expected a \
         distortion that does not fold before the corners ({corner_px:.0} pixels)"
    )]
    TurnsBack {
        /// Coefficient of r².
        k1: f64,
        /// Coefficient of r⁴.
        k2: f64,
        /// Distance from the centre, in pixels, at which the distortion folds back.
        reach_px: f64,
        /// Distance of the image's corners from its centre, in pixels.
        corner_px: f64,
    },
}

/// Maps ideal (pinhole) image positions to those seen through a lens, in pixels, and back. The formula is that of
/// [`Lens`].
#[derive(Debug, Clone, PartialEq)]
pub struct LensMap {
    centre: Point,
    focal: f64,
    k1: f64,
    k2: f64,
    /// Ideal radius, in focal lengths, up to which the seen radius grows.
    reach: f64,
}

impl LensMap {
    /// The lens map for images of `size` (width, height) in pixels.
    ///
    /// # Errors
    ///
    /// If a coefficient or the focal length is out of range, or the distortion folds back within the image.
    pub fn new(lens: &Lens, size: [usize; 2]) -> Result<Self, LensError> {
        let Lens { k1, k2, focal_px } = *lens;
        for (key, value) in [("k1", k1), ("k2", k2)] {
            if !COEFFICIENT.contains(&value) {
                return Err(LensError::Coefficient { key, value });
            }
        }
        let [width, height] = size.map(|n| n as f64);
        let focal = focal_px.unwrap_or(width);
        if !FOCAL_PX.contains(&focal) {
            return Err(LensError::Focal(focal));
        }
        let centre = [(width - 1.0) / 2.0, (height - 1.0) / 2.0];
        let map = Self { centre, focal, k1, k2, reach: reach(k1, k2) };
        let corner = (width / 2.0).hypot(height / 2.0) / focal;
        if map.reach.is_finite() && map.seen_radius(map.reach) <= corner {
            let (reach_px, corner_px) = (map.seen_radius(map.reach) * focal, corner * focal);
            return Err(LensError::TurnsBack { k1, k2, reach_px, corner_px });
        }
        Ok(map)
    }

    /// Where an ideal position is seen, in pixels; `None` beyond the radius at which the distortion folds back.
    pub fn distort(&self, ideal: Point) -> Option<Point> {
        let x = self.relative(ideal);
        let r2 = x[0] * x[0] + x[1] * x[1];
        (r2.sqrt() <= self.reach).then(|| {
            let stretch = 1.0 + r2 * (self.k1 + r2 * self.k2);
            self.absolute(x.map(|c| c * stretch))
        })
    }

    /// Ideal position of a seen position, in pixels; `None` outside the lens's image circle.
    pub fn undistort(&self, seen: Point) -> Option<Point> {
        let x = self.relative(seen);
        let radius = x[0].hypot(x[1]);
        if radius == 0.0 {
            return Some(seen);
        }
        let ideal = self.ideal_radius(radius)?;
        Some(self.absolute(x.map(|c| c * ideal / radius)))
    }

    /// Derivatives of [`Self::distort`]: one row per seen coordinate, one column per ideal coordinate.
    pub fn jacobian(&self, ideal: Point) -> [[f64; 2]; 2] {
        let [x, y] = self.relative(ideal);
        let r2 = x * x + y * y;
        let stretch = 1.0 + r2 * (self.k1 + r2 * self.k2);
        let slope = 2.0 * (self.k1 + 2.0 * r2 * self.k2);
        [[stretch + x * x * slope, x * y * slope], [x * y * slope, stretch + y * y * slope]]
    }

    /// Seen radius of an ideal radius, both in focal lengths.
    fn seen_radius(&self, r: f64) -> f64 {
        let r2 = r * r;
        r * (1.0 + r2 * (self.k1 + r2 * self.k2))
    }

    /// Inverse of [`Self::seen_radius`] below `reach`, by Newton's method safeguarded with bisection.
    fn ideal_radius(&self, seen: f64) -> Option<f64> {
        if !seen.is_finite() {
            return None;
        }
        let (mut low, mut high) = (0.0, self.reach);
        if high.is_infinite() {
            high = seen.max(1.0);
            while self.seen_radius(high) < seen {
                high *= 2.0;
            }
        } else if self.seen_radius(high) < seen {
            return None;
        }
        let mut r = seen.min(high);
        for _ in 0..100 {
            let error = self.seen_radius(r) - seen;
            if error.abs() <= 1e-15 * seen {
                break;
            }
            if error > 0.0 {
                high = r
            } else {
                low = r
            }
            let r2 = r * r;
            let newton = r - error / (1.0 + r2 * (3.0 * self.k1 + 5.0 * self.k2 * r2));
            r = if newton > low && newton < high { newton } else { (low + high) / 2.0 };
        }
        Some(r)
    }

    fn relative(&self, p: Point) -> Point {
        [(p[0] - self.centre[0]) / self.focal, (p[1] - self.centre[1]) / self.focal]
    }

    fn absolute(&self, x: Point) -> Point {
        [self.centre[0] + x[0] * self.focal, self.centre[1] + x[1] * self.focal]
    }
}

/// The radius at which r (1 + k1 r² + k2 r⁴) stops growing: the first positive root of 1 + 3 k1 s + 5 k2 s², s = r²;
/// infinite if there is none.
fn reach(k1: f64, k2: f64) -> f64 {
    let (a, b) = (5.0 * k2, 3.0 * k1);
    let discriminant = b * b - 4.0 * a;
    if discriminant < 0.0 {
        return f64::INFINITY;
    }
    // This form of the quadratic formula avoids cancellation and covers k2 = 0.
    let q = -(b + discriminant.sqrt().copysign(b)) / 2.0;
    let roots = [1.0 / q, if a == 0.0 { f64::INFINITY } else { q / a }];
    roots.into_iter().filter(|s| *s > 0.0).fold(f64::INFINITY, f64::min).sqrt()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const SIZE: [usize; 2] = [640, 360];

    fn map(k1: f64, k2: f64) -> Result<LensMap, LensError> {
        LensMap::new(&Lens { k1, k2, focal_px: Some(500.0) }, SIZE)
    }

    #[test]
    fn a_position_is_seen_where_opencvs_formula_has_it() {
        let lens = map(-0.2, 0.03).unwrap();
        // x = (0.3, -0.1), r² = 0.1: 1 - 0.02 + 0.0003.
        let seen = lens.distort([319.5 + 150.0, 179.5 - 50.0]).unwrap();
        let expected = [319.5 + 150.0 * 0.9803, 179.5 - 50.0 * 0.9803];
        assert!((seen[0] - expected[0]).abs() < 1e-9 && (seen[1] - expected[1]).abs() < 1e-9, "{seen:?}");
    }

    #[test]
    fn without_a_focal_length_it_is_the_images_width() {
        let lens = |focal_px| LensMap::new(&Lens { k1: -0.1, k2: 0.0, focal_px }, SIZE).unwrap();
        assert_eq!(lens(None), lens(Some(640.0)));
    }

    #[test]
    fn a_distortion_that_turns_back_within_the_image_is_refused() {
        // r (1 - r²) folds back at r = 0.577, which is seen at 0.385, 192 pixels from the centre.
        let error = map(-1.0, 0.0).expect_err("refused");
        assert_eq!(
            error.to_string(),
            "lens.k1 = -1, lens.k2 = 0 fold the image back 192 pixels from its centre, expected a distortion that does \
             not fold before the corners (367 pixels)"
        );
        map(0.5, -2.0).expect_err("folds back");
        map(f64::NAN, 0.0).expect_err("not a number");
        LensMap::new(&Lens { k1: 0.0, k2: 0.0, focal_px: Some(0.0) }, SIZE).expect_err("no focal length");
    }

    proptest! {
        #[test]
        fn undistorting_undoes_distorting(k1 in -0.6..0.6f64, k2 in -0.3..0.6f64, u in -0.5..639.5f64, v in -0.5..359.5f64) {
            if let Ok(lens) = map(k1, k2) {
                let ideal = lens.undistort([u, v]).expect("every image position has an ideal position");
                let seen = lens.distort(ideal).expect("which is seen");
                prop_assert!((seen[0] - u).hypot(seen[1] - v) < 1e-6, "{seen:?}");
            }
        }

        #[test]
        fn the_jacobian_is_that_of_small_steps(k1 in -0.3..0.3f64, k2 in -0.1..0.3f64, u in 0.0..639.0f64, v in 0.0..359.0f64) {
            let Ok(lens) = map(k1, k2) else { return Ok(()) };
            let jacobian = lens.jacobian([u, v]);
            let step = 1e-4;
            for (k, d) in [[step, 0.0], [0.0, step]].into_iter().enumerate() {
                let (Some(a), Some(b)) = (lens.distort([u - d[0], v - d[1]]), lens.distort([u + d[0], v + d[1]])) else {
                    return Ok(());
                };
                for c in 0..2 {
                    prop_assert!(((b[c] - a[c]) / (2.0 * step) - jacobian[c][k]).abs() < 1e-5);
                }
            }
        }

        #[test]
        fn whatever_is_accepted_grows_up_to_the_corners(k1 in -3.0..3.0f64, k2 in -3.0..3.0f64) {
            let radii = || (0..2000).map(|k| f64::from(k) * 1e-3);
            let seen = |r: f64| r * (1.0 + k1 * r * r + k2 * r.powi(4));
            // The corner is 367.2 pixels away: 0.7344 focal lengths. If the radius falls before that, the image folds.
            let fold = radii().find(|&r| seen(r + 1e-3) <= seen(r));
            let folded = fold.is_some_and(|r| seen(r) < 0.7344 - 2e-3);
            let grows = fold.is_none_or(|r| seen(r) > 0.7344 + 2e-3);
            match map(k1, k2) {
                Ok(_) => prop_assert!(!folded),
                Err(_) => prop_assert!(!grows),
            }
        }
    }
}
