//! From the floor to the camera's image.

use nalgebra::{DMatrix, Matrix3, Vector3};

use crate::geometry::Point;

/// Why floor points do not tell where the floor is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum HomographyError {
    /// Fewer than four points, or too many of them on one line.
    #[error("floor_points do not fix the floor: at least 4 are needed, no 3 of those 4 on one line")]
    Degenerate,
    /// A coordinate is NaN or infinite.
    #[error("floor_points have a coordinate that is not a finite number")]
    NotFinite,
}

/// The projective map from the floor plan (metres, door frame) to the image (pixels).
#[derive(Debug, Clone, PartialEq)]
pub struct Homography {
    matrix: Matrix3<f64>,
    inverse: Matrix3<f64>,
    /// 1 or −1, so that points in front of the camera have a positive third coordinate.
    front: f64,
}

impl Homography {
    /// The least-squares map through (floor, pixel) pairs: normalised direct linear transformation (Hartley and Zisserman,
    /// Multiple View Geometry, algorithm 4.2).
    pub fn fit(points: &[(Point, Point)]) -> Result<Self, HomographyError> {
        if points.iter().any(|(p, q)| p.iter().chain(q).any(|v| !v.is_finite())) {
            return Err(HomographyError::NotFinite);
        }
        if points.len() < 4 {
            return Err(HomographyError::Degenerate);
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
        // One null direction is the map; a second one means that the points leave it open.
        if svd.singular_values[order[1]] < 1e-6 * svd.singular_values[order[8]] {
            return Err(HomographyError::Degenerate);
        }
        let h = rows_t.row(order[0]);
        let normalised = Matrix3::from_fn(|i, j| h[3 * i + j]);
        let inverse = pixel_norm.try_inverse().ok_or(HomographyError::Degenerate)?;
        let matrix = inverse * normalised * floor_norm;
        let depth = |p: &Point| (matrix * Vector3::new(p[0], p[1], 1.0))[2];
        let front = depth(&points[0].0).signum();
        if points.iter().any(|(floor, _)| front * depth(floor) <= 0.0) {
            return Err(HomographyError::Degenerate);
        }
        let inverse = matrix.try_inverse().ok_or(HomographyError::Degenerate)?;
        Ok(Self { matrix, inverse, front })
    }

    /// Where a floor position is in the image; none if it is not in front of the camera.
    pub fn project(&self, floor: Point) -> Option<Point> {
        let v = self.matrix * Vector3::new(floor[0], floor[1], 1.0) * self.front;
        (v[2] > 0.0).then(|| [v[0] / v[2], v[1] / v[2]])
    }

    /// The floor position at an image position; none at and above the horizon.
    pub fn floor(&self, pixel: Point) -> Option<Point> {
        let v = self.inverse * Vector3::new(pixel[0], pixel[1], 1.0) * self.front;
        (v[2] > 0.0).then(|| [v[0] / v[2], v[1] / v[2]])
    }
}

/// Moves points to mean 0 and mean distance √2; none if they coincide.
fn normaliser(points: impl Iterator<Item = Point> + Clone) -> Option<Matrix3<f64>> {
    let n = points.clone().count() as f64;
    let mean = points.clone().fold([0.0, 0.0], |m, p| [m[0] + p[0] / n, m[1] + p[1] / n]);
    let spread = points.map(|p| (p[0] - mean[0]).hypot(p[1] - mean[1])).sum::<f64>() / n;
    let s = std::f64::consts::SQRT_2 / spread;
    (spread > 0.0).then(|| Matrix3::new(s, 0.0, -s * mean[0], 0.0, s, -s * mean[1], 0.0, 0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn a_camera_is_found_from_exact_points(
            tilt in 0.2..1.4f64, turn in -0.6..0.6f64, height in 0.5..2.5f64, focal in 200.0..900.0f64,
        ) {
            // A pinhole at (0, -1.2, height), looking down at the door by `tilt`, turned by `turn`.
            let see = |p: Point| {
                let (dx, dy, dz) = (p[0], p[1] + 1.2, -height);
                let (dx, dy) = (dx * turn.cos() - dy * turn.sin(), dx * turn.sin() + dy * turn.cos());
                let (forward, down) = (dy * tilt.cos() - dz * tilt.sin(), -dy * tilt.sin() - dz * tilt.cos());
                (forward > 0.05).then(|| [320.0 + focal * dx / forward, 240.0 + focal * down / forward])
            };
            let floor = [[-0.4, 0.0], [0.4, 0.0], [-0.4, -0.3], [0.4, -0.3], [0.0, -0.15]];
            let points: Option<Vec<_>> = floor.iter().map(|&f| see(f).map(|p| (f, p))).collect();
            prop_assume!(points.is_some());
            let homography = Homography::fit(&points.unwrap()).unwrap();
            for probe in [[0.1, -0.1], [-0.55, -0.25], [0.5, -0.02]] {
                let (ours, theirs) = (homography.project(probe), see(probe));
                if let Some(theirs) = theirs {
                    let ours = ours.unwrap();
                    prop_assert!((ours[0] - theirs[0]).hypot(ours[1] - theirs[1]) < 1e-5, "{ours:?} {theirs:?}");
                }
            }
        }
    }

    #[test]
    fn points_that_leave_the_map_open_are_refused() {
        let pixels = [[0.0, 0.0], [10.0, 1.0], [20.0, 2.0], [30.0, 3.0], [40.0, 4.0]];
        let line = |n: usize| (0..n).map(|k| ([0.1 * k as f64, 0.0], pixels[k])).collect::<Vec<_>>();
        assert_eq!(Homography::fit(&line(5)), Err(HomographyError::Degenerate));
        assert_eq!(Homography::fit(&line(3)), Err(HomographyError::Degenerate));
        let mut three_on_a_line = line(4);
        three_on_a_line[3] = ([0.1, -0.3], [5.0, 90.0]);
        assert_eq!(Homography::fit(&three_on_a_line), Err(HomographyError::Degenerate));
        let mut same = line(4);
        same.iter_mut().for_each(|p| *p = ([0.0, 0.0], [5.0, 5.0]));
        assert_eq!(Homography::fit(&same), Err(HomographyError::Degenerate));
    }
}
