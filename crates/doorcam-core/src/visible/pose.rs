use nalgebra::{Matrix3, Vector3};

use crate::calibration::{Camera, LensMap};
use crate::geometry::Point;

/// The focal length is looked for between these multiples of the picture's width, in this many steps.
const FOCAL: std::ops::RangeInclusive<f64> = 0.35..=3.5;
const STEPS: usize = 120;
/// The usual focal length of a webcam as a multiple of the width, and the standard deviation of its logarithm.
const USUAL: f64 = 0.9;
const SPREAD: f64 = 0.4;
/// Standard deviation with which marked points show that the floor's axes are equally long and at right angles.
const MARKED: f64 = 0.005;

/// Where the camera is and how it looks, from the floor that it sees. Needed for what stands above the floor.
#[derive(Debug, Clone, PartialEq)]
pub struct Pose {
    /// Door frame to camera frame (x right, y down, z ahead).
    rotation: Matrix3<f64>,
    /// The camera's place in the door frame, in metres.
    at: Vector3<f64>,
    focal_px: f64,
    centre: Point,
    lens: Option<LensMap>,
}

impl Pose {
    /// The pose of a calibrated camera with pictures of `size` (width, height) in pixels. The floor alone fixes the
    /// focal length f only if the camera does not look straight down: with H = K [r1 r2 t], r1 and r2 have to be equally
    /// long and at right angles (Zhang 2000, eq. 3 and 4). It is weighed against what webcams usually have. `None` if the
    /// camera would be under the floor.
    pub fn of(camera: &Camera, size: [usize; 2]) -> Option<Self> {
        let [width, height] = size.map(|n| n as f64);
        let centre = [0.5 * (width - 1.0), 0.5 * (height - 1.0)];
        let columns = floor_to_image(camera)?;
        let cost = |focal_px: f64| {
            let [r1, r2, _] = rays(&columns, focal_px, centre);
            let (one, two) = (r1.norm(), r2.norm());
            let (ratio, angle) = ((one / two).ln(), r1.dot(&r2) / (one * two));
            (ratio / MARKED).powi(2) + (angle / MARKED).powi(2) + ((focal_px / (USUAL * width)).ln() / SPREAD).powi(2)
        };
        let (least, most) = (FOCAL.start().ln(), FOCAL.end().ln());
        let focal = |k: usize| width * (least + (most - least) * k as f64 / (STEPS - 1) as f64).exp();
        let focal_px = (0..STEPS).map(focal).min_by(|a, b| cost(*a).total_cmp(&cost(*b)))?;
        let [r1, r2, t] = rays(&columns, focal_px, centre);
        let scale = (r1.norm() * r2.norm()).sqrt();
        // The nearest rotation to the two measured columns.
        let svd = Matrix3::from_columns(&[r1 / scale, r2 / scale, (r1 / scale).cross(&(r2 / scale))]).svd(true, true);
        let rotation = svd.u? * svd.v_t?;
        let at = -rotation.transpose() * t / scale;
        (at[2] > 0.0 && at.iter().all(|v| v.is_finite())).then(|| Self {
            rotation,
            at,
            focal_px,
            centre,
            lens: camera.lens().cloned(),
        })
    }

    /// The camera's place in the door frame, in metres.
    pub fn at(&self) -> [f64; 3] {
        self.at.into()
    }

    /// Focal length in pixels.
    pub fn focal_px(&self) -> f64 {
        self.focal_px
    }

    /// Where the picture shows a point of the door frame (metres), and how many pixels a metre is there; `None` if it is
    /// behind the camera or outside the lens's image circle.
    pub fn project(&self, point: [f64; 3]) -> Option<(Point, f64)> {
        let seen = self.rotation * (Vector3::from(point) - self.at);
        if seen[2] < NEAREST_M {
            return None;
        }
        let scale = self.focal_px / seen[2];
        let ideal = [self.centre[0] + scale * seen[0], self.centre[1] + scale * seen[1]];
        let pixel = self.lens.as_ref().map_or(Some(ideal), |lens| lens.distort(ideal))?;
        Some((pixel, scale))
    }
}

/// What is nearer to the camera than this, in metres, is not projected.
const NEAREST_M: f64 = 0.08;

/// The homography's columns, scaled so that the floor is in front of the camera.
fn floor_to_image(camera: &Camera) -> Option<[Vector3<f64>; 3]> {
    let matrix = camera.homography().matrix();
    let origin = matrix * Vector3::new(0.0, -0.5, 1.0);
    camera.homography().project([0.0, -0.5])?;
    let matrix = matrix * origin[2].signum();
    Some([0, 1, 2].map(|k| matrix.column(k).into_owned()))
}

/// K⁻¹ times the columns.
fn rays(columns: &[Vector3<f64>; 3], focal_px: f64, [u, v]: Point) -> [Vector3<f64>; 3] {
    columns.map(|c| Vector3::new((c[0] - u * c[2]) / focal_px, (c[1] - v * c[2]) / focal_px, c[2]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::Homography;
    use crate::calibration::pinhole::Pinhole;

    #[test]
    fn the_pose_of_a_pinhole_camera_is_found_and_shows_what_stands_above_the_floor() {
        for (tilt, focal) in [(0.6, 560.0), (1.0, 480.0), (1.3, 700.0)] {
            let pinhole = Pinhole { at: [0.1, -1.2, 1.6], tilt, turn: -0.1, roll: 0.04, focal, centre: [319.5, 179.5] };
            let floor: Vec<_> = [[-0.5, -0.1], [0.5, -0.1], [0.6, -0.6], [-0.6, -0.6]].into();
            let points: Vec<_> = floor.iter().map(|&p| (p, pinhole.see(p).unwrap())).collect();
            let camera = Camera::new(Homography::fit(&points).unwrap(), None);
            let pose = Pose::of(&camera, [640, 360]).unwrap();
            assert!((pose.focal_px() / focal - 1.0).abs() < 0.06, "{tilt}: {}", pose.focal_px());
            let away: f64 = pose.at().iter().zip(pinhole.at).map(|(a, b)| (a - b).powi(2)).sum();
            assert!(away.sqrt() < 0.1, "{tilt}: {:?}", pose.at());
            // On the floor it agrees with the calibration; a metre above it with the pinhole that is a metre lower.
            let lower = Pinhole { at: [0.1, -1.2, 0.6], ..pinhole };
            for [x, y] in [[0.0, 0.2], [-0.3, -0.3]] {
                let (pixel, _) = pose.project([x, y, 0.0]).unwrap();
                let seen = camera.project([x, y]).unwrap();
                assert!((pixel[0] - seen[0]).hypot(pixel[1] - seen[1]) < 3.0, "{pixel:?} {seen:?}");
                if let (Some((pixel, _)), Some(seen)) = (pose.project([x, y, 1.0]), lower.see([x, y])) {
                    let miss = (pixel[0] - seen[0]).hypot(pixel[1] - seen[1]);
                    assert!(miss < 0.08 * focal, "{pixel:?} {seen:?}");
                }
            }
        }
    }
}
