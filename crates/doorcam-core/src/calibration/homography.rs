//! The projective map from the floor to the camera's ideal image.

use nalgebra::{DMatrix, Matrix3, Vector3};

use crate::geometry::Point;

/// Largest number of floor points accepted. Nobody marks that many by hand.
pub const MOST_POINTS: usize = 64;

/// Why floor points do not determine the floor. Points are counted from 1.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum HomographyError {
    /// Not enough points.
    #[error("floor_points has {0} points, expected at least 4, no 3 of those 4 on one line")]
    TooFew(usize),
    /// So many points that the search for one at fault would take seconds.
    #[error("floor_points has {0} points, expected at most {MOST_POINTS}")]
    TooMany(usize),
    /// A coordinate is NaN or infinite.
    #[error("floor_points: point {0} has a coordinate that is not a finite number")]
    NotFinite(usize),
    /// A pixel outside the lens's image circle.
    #[error("floor_points: point {0} is outside the lens's image circle")]
    OutsideLens(usize),
    /// Too many points on or near one line, to within the marking error.
    #[error("floor_points do not fix the floor: expected at least 4 apart, no 3 of those 4 near one line")]
    Degenerate,
    /// The camera would have to look at the floor from below.
    #[error(
        "floor_points show the floor mirrored: expected x to the right for someone who faces the door, y into the \
         hidden room, u to the right, v down"
    )]
    Mirrored,
    /// No camera has all points in front of it.
    #[error("floor_points fit no camera that has them all in front of it: is a pixel or a floor_m mistyped?")]
    Behind,
    /// One point contradicts the others.
    #[error(
        "floor_points: point {point} is {miss_px:.0} pixels from where the others put it: is its pixel or floor_m \
         mistyped?"
    )]
    Outlier {
        /// Number of the point.
        point: usize,
        /// Distance between the marked pixel and where the camera that fits the others sees the point.
        miss_px: f64,
    },
    /// The points contradict each other, and it is not clear which one is at fault.
    #[error(
        "floor_points disagree by {noise_px:.0} pixels, expected at most {limit_px:.0}: is a pixel or a floor_m \
         mistyped? (point {worst} is farthest off, by {residual_px:.0} pixels; with more points it would be clearer)"
    )]
    Inconsistent {
        /// Pixel error estimated from the residuals.
        noise_px: f64,
        /// Largest acceptable pixel error of points marked by hand.
        limit_px: f64,
        /// Number of the point with the largest residual.
        worst: usize,
        /// The largest residual.
        residual_px: f64,
    },
}

/// The projective map from the floor (metres, door frame) to the image of a camera without distortion (pixels).
#[derive(Debug, Clone, PartialEq)]
pub struct Homography {
    matrix: Matrix3<f64>,
    inverse: Matrix3<f64>,
    /// Sign, 1 or −1, that makes the third coordinate positive in front of the camera.
    front: f64,
}

impl Homography {
    /// Fits the map to (floor, pixel) pairs by the normalised direct linear transformation (Hartley and Zisserman,
    /// Multiple View Geometry, algorithm 4.2). It is exact for four points, and the starting point of
    /// [`FloorFit`](super::FloorFit) for more.
    ///
    /// # Errors
    ///
    /// If there are fewer than four points, a coordinate is not finite, or the points do not determine a map with all
    /// of them in front of the camera.
    pub fn fit(points: &[(Point, Point)]) -> Result<Self, HomographyError> {
        if let Some(k) = points.iter().position(|(p, q)| p.iter().chain(q).any(|v| !v.is_finite())) {
            return Err(HomographyError::NotFinite(k + 1));
        }
        if points.len() < 4 {
            return Err(HomographyError::TooFew(points.len()));
        }
        let floor_norm = normaliser(points.iter().map(|p| p.0)).ok_or(HomographyError::Degenerate)?;
        let pixel_norm = normaliser(points.iter().map(|p| p.1)).ok_or(HomographyError::Degenerate)?;
        let mut rows = DMatrix::<f64>::zeros(2 * points.len().max(5), 9);
        for (k, (floor, pixel)) in points.iter().enumerate() {
            let f = floor_norm * Vector3::new(floor[0], floor[1], 1.0);
            let p = pixel_norm * Vector3::new(pixel[0], pixel[1], 1.0);
            for j in 0..3 {
                rows[(2 * k, 3 + j)] = -f[j];
                rows[(2 * k, 6 + j)] = p[1] * f[j];
                rows[(2 * k + 1, j)] = f[j];
                rows[(2 * k + 1, 6 + j)] = -p[0] * f[j];
            }
        }
        let svd = rows.svd(false, true);
        let rows_t = svd.v_t.ok_or(HomographyError::Degenerate)?;
        let mut order: Vec<usize> = (0..9).collect();
        order.sort_by(|&a, &b| svd.singular_values[a].total_cmp(&svd.singular_values[b]));
        // One null direction is the map; a second one means that the points do not determine it.
        if svd.singular_values[order[1]] < 1e-6 * svd.singular_values[order[8]] {
            return Err(HomographyError::Degenerate);
        }
        let h = rows_t.row(order[0]);
        let normalised = Matrix3::from_fn(|i, j| h[3 * i + j]);
        let inverse = pixel_norm.try_inverse().ok_or(HomographyError::Degenerate)?;
        Self::from_matrix(inverse * normalised * floor_norm, points.iter().map(|p| p.0))
    }

    /// The map with this matrix, for a camera that has the floor points `seen` in front of it.
    pub(super) fn from_matrix(
        matrix: Matrix3<f64>,
        mut seen: impl Iterator<Item = Point>,
    ) -> Result<Self, HomographyError> {
        let depth = |p: Point| (matrix * Vector3::new(p[0], p[1], 1.0))[2];
        let front = seen.next().map_or(1.0, |p| depth(p).signum());
        if seen.any(|floor| front * depth(floor) <= 0.0) {
            return Err(HomographyError::Behind);
        }
        let inverse = matrix.try_inverse().ok_or(HomographyError::Degenerate)?;
        Ok(Self { matrix, inverse, front })
    }

    /// Image position of a floor point; `None` if it is not in front of the camera.
    pub fn project(&self, floor: Point) -> Option<Point> {
        let v = self.matrix * Vector3::new(floor[0], floor[1], 1.0) * self.front;
        (v[2] > 0.0).then(|| [v[0] / v[2], v[1] / v[2]])
    }

    /// Floor point at an image position; `None` at and above the horizon.
    pub fn floor(&self, pixel: Point) -> Option<Point> {
        let v = self.inverse * Vector3::new(pixel[0], pixel[1], 1.0) * self.front;
        (v[2] > 0.0).then(|| [v[0] / v[2], v[1] / v[2]])
    }

    /// Whether the map shows the floor from below: it then preserves orientation, although v points down in the image.
    pub fn mirrored(&self) -> bool {
        self.matrix.determinant() * self.front > 0.0
    }

    /// The matrix, with arbitrary scale.
    pub(crate) fn matrix(&self) -> &Matrix3<f64> {
        &self.matrix
    }
}

/// Similarity that moves points to mean 0 and mean distance √2 from it; `None` if they coincide.
pub(super) fn normaliser(points: impl Iterator<Item = Point> + Clone) -> Option<Matrix3<f64>> {
    let n = points.clone().count() as f64;
    let mean = points.clone().fold([0.0, 0.0], |m, p| [m[0] + p[0] / n, m[1] + p[1] / n]);
    let spread = points.map(|p| (p[0] - mean[0]).hypot(p[1] - mean[1])).sum::<f64>() / n;
    let s = std::f64::consts::SQRT_2 / spread;
    (spread > 0.0 && s.is_finite()).then(|| Matrix3::new(s, 0.0, -s * mean[0], 0.0, s, -s * mean[1], 0.0, 0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::calibration::pinhole::Pinhole;

    proptest! {
        #[test]
        fn a_camera_is_found_from_exact_points(
            tilt in 0.2..1.4f64, turn in -0.6..0.6f64, height in 0.5..2.5f64, focal in 200.0..900.0f64,
        ) {
            let camera = Pinhole { at: [0.0, -1.2, height], tilt, turn, roll: 0.0, focal, centre: [320.0, 240.0] };
            let floor = [[-0.4, 0.0], [0.4, 0.0], [-0.4, -0.3], [0.4, -0.3], [0.0, -0.15]];
            let points: Option<Vec<_>> = floor.iter().map(|&f| camera.see(f).map(|p| (f, p))).collect();
            prop_assume!(points.is_some());
            let homography = Homography::fit(&points.unwrap()).unwrap();
            prop_assert!(!homography.mirrored());
            for probe in [[0.1, -0.1], [-0.55, -0.25], [0.5, -0.02]] {
                let (ours, theirs) = (homography.project(probe), camera.see(probe));
                if let Some(theirs) = theirs {
                    let ours = ours.unwrap();
                    prop_assert!((ours[0] - theirs[0]).hypot(ours[1] - theirs[1]) < 1e-5, "{ours:?} {theirs:?}");
                    let back = homography.floor(ours).unwrap();
                    prop_assert!((back[0] - probe[0]).hypot(back[1] - probe[1]) < 1e-9);
                }
            }
        }
    }

    #[test]
    fn points_that_leave_the_map_open_are_refused() {
        let pixels = [[0.0, 0.0], [10.0, 1.0], [20.0, 2.0], [30.0, 3.0], [40.0, 4.0]];
        let line = |n: usize| (0..n).map(|k| ([0.1 * k as f64, 0.0], pixels[k])).collect::<Vec<_>>();
        assert_eq!(Homography::fit(&line(5)), Err(HomographyError::Degenerate));
        assert_eq!(Homography::fit(&line(3)), Err(HomographyError::TooFew(3)));
        let mut three_on_a_line = line(4);
        three_on_a_line[3] = ([0.1, -0.3], [5.0, 90.0]);
        assert_eq!(Homography::fit(&three_on_a_line), Err(HomographyError::Degenerate));
        let mut same = line(4);
        same.iter_mut().for_each(|p| *p = ([0.0, 0.0], [5.0, 5.0]));
        assert_eq!(Homography::fit(&same), Err(HomographyError::Degenerate));
    }

    #[test]
    fn what_is_above_the_horizon_is_nowhere_on_the_floor() {
        let camera =
            Pinhole { at: [0.0, -1.2, 1.0], tilt: 0.4, turn: 0.0, roll: 0.0, focal: 500.0, centre: [320.0, 180.0] };
        let floor = [[-0.4, 0.0], [0.4, 0.0], [-0.4, -0.3], [0.4, -0.3]];
        let homography = Homography::fit(&floor.map(|f| (f, camera.see(f).unwrap()))).unwrap();
        // The horizon is 500 tan(0.4) = 211 pixels above the centre.
        assert!(homography.floor([320.0, 180.0 - 210.0]).is_some_and(|p| p[1] > 100.0));
        assert_eq!(homography.floor([320.0, 180.0 - 213.0]), None);
        assert_eq!(homography.project([0.0, -2.0]), None, "behind the camera");
    }
}
