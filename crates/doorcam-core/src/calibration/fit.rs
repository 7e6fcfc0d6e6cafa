//! Fits the camera to marked floor points and estimates how well they determine it.

use nalgebra::{Matrix2, Matrix3, SMatrix, SVector, Vector2, Vector3};

use crate::calibration::homography::{MOST_POINTS, normaliser};
use crate::calibration::{Camera, Homography, HomographyError, LensMap};
use crate::geometry::Point;
use crate::optics::FloorPoint;

/// The least-squares camera for a set of marked floor points. Distances are measured in pixels of the image as the
/// camera delivers it, lens distortion included, because that is the image in which points are marked.
#[derive(Debug, Clone, PartialEq)]
pub struct FloorFit {
    points: Vec<FloorPoint>,
    camera: Camera,
    residuals_px: Vec<Point>,
    parameters: Parameters,
    /// Inverse of the normal matrix: the parameters' covariance for a pixel error of 1.
    covariance: Matrix9,
}

type Matrix9 = SMatrix<f64, 9, 9>;
type Vector9 = SVector<f64, 9>;
/// Derivatives of a position with respect to the parameters.
type Jacobian = SMatrix<f64, 2, 9>;

/// Assumed pixel error of marked points where it cannot be estimated, that is with four points.
pub const ASSUMED_NOISE_PX: f64 = 1.0;

/// Limits of the pixel error used to judge a set of points. Nobody marks points better than the lower one, so residuals
/// that happen to be smaller do not make a weak set strong. Residuals above the upper one are not caused by where the
/// points lie.
const LEAST_NOISE_PX: f64 = 0.5;
const MOST_NOISE_PX: f64 = 2.0;

/// Relative error of the map's weakest direction from which a set of points counts as degenerate. The error is then no
/// longer small, and results of linearisation are meaningless.
const DEGENERATE: f64 = 0.1;

/// Smallest altitude, in pixel errors, of a triangle of points that does not count as a line. Noise alone turns a line
/// into a thin triangle, and the fit cannot tell the difference.
const CLEAR_OF_LINE: f64 = 6.0;

/// Largest acceptable pixel error in an image up to [`LIMIT_WIDTH`] pixels wide; it grows with the width beyond that.
const LIMIT_PX: f64 = 5.0;
const LIMIT_WIDTH: f64 = 1280.0;

/// Prior pixel error, and the number of residuals that the prior is worth.
const PRIOR_NOISE_PX: f64 = 1.5;
const PRIOR_RESIDUALS: f64 = 6.0;

/// Probability that a good point is taken for one that contradicts the others.
const FALSE_ALARM: f64 = 1e-3;

impl FloorFit {
    /// Fits a camera with this lens to the points. It does not check whether the points agree with each other; see
    /// [`Self::contradiction`].
    ///
    /// # Errors
    ///
    /// If there are too few or too many points, if a point is not finite or lies outside the lens's image circle, or if
    /// the points do not determine a camera that has them all in front of it and sees the floor from above.
    pub fn new(points: &[FloorPoint], lens: Option<&LensMap>) -> Result<Self, HomographyError> {
        let fit = Self::unjudged(points, lens)?;
        if fit.camera.homography().mirrored() {
            return Err(HomographyError::Mirrored);
        }
        // The weakest direction is the one with the largest variance.
        let variance = fit.covariance.symmetric_eigenvalues().max();
        let noise = fit.noise_px().unwrap_or(ASSUMED_NOISE_PX).clamp(LEAST_NOISE_PX, MOST_NOISE_PX);
        let pixels: Vec<Point> = points.iter().map(|p| p.pixel).collect();
        let fixed = variance.sqrt() * noise < DEGENERATE && general_position(&pixels, CLEAR_OF_LINE * noise);
        if fixed { Ok(fit) } else { Err(HomographyError::Degenerate) }
    }

    fn unjudged(points: &[FloorPoint], lens: Option<&LensMap>) -> Result<Self, HomographyError> {
        if points.len() > MOST_POINTS {
            return Err(HomographyError::TooMany(points.len()));
        }
        let pairs = points
            .iter()
            .enumerate()
            .map(|(k, p)| {
                if !p.pixel.iter().chain(&p.floor_m).all(|v| v.is_finite()) {
                    return Err(HomographyError::NotFinite(k + 1));
                }
                let ideal = lens.map_or(Some(p.pixel), |lens| lens.undistort(p.pixel));
                Ok((p.floor_m, ideal.ok_or(HomographyError::OutsideLens(k + 1))?))
            })
            .collect::<Result<Vec<_>, _>>()?;
        let start = Parameters::of(&Homography::fit(&pairs)?, &pairs)?;
        let (parameters, covariance) = refine(start, points, lens).ok_or(HomographyError::Degenerate)?;
        let camera = Camera::new(parameters.homography(points)?, lens.cloned());
        let residuals_px = points
            .iter()
            .map(|p| camera.project(p.floor_m).map(|q| [p.pixel[0] - q[0], p.pixel[1] - q[1]]))
            .collect::<Option<Vec<_>>>()
            .ok_or(HomographyError::Behind)?;
        Ok(Self { points: points.to_vec(), camera, residuals_px, parameters, covariance })
    }

    /// The camera.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// Per point: marked pixel minus the pixel where the camera sees the point.
    pub fn residuals_px(&self) -> &[Point] {
        &self.residuals_px
    }

    /// Per point: floor position of the marked pixel minus the point's position, in metres (door frame); `None` if the
    /// marked pixel is above the horizon.
    pub fn residuals_m(&self) -> Vec<Option<Point>> {
        let off = |p: &FloorPoint| {
            let floor = self.camera.floor(p.pixel)?;
            Some([floor[0] - p.floor_m[0], floor[1] - p.floor_m[1]])
        };
        self.points.iter().map(off).collect()
    }

    /// Estimated standard deviation of the marked points, per coordinate, in pixels: from 2n residuals with 8 fitted
    /// parameters. `None` with four points, which are always fitted exactly.
    pub fn noise_px(&self) -> Option<f64> {
        let freedom = self.freedom();
        (freedom > 0.0).then(|| (self.cost() / freedom).sqrt())
    }

    fn freedom(&self) -> f64 {
        (2 * self.points.len()) as f64 - 8.0
    }

    fn cost(&self) -> f64 {
        self.residuals_px.iter().map(|r| r[0] * r[0] + r[1] * r[1]).sum()
    }

    /// Covariance, in m² for a pixel error of 1, of the floor position that is really seen at the pixel where the
    /// fitted camera sees `floor`. `None` if `floor` is behind the camera.
    pub fn covariance_m2(&self, floor: Point) -> Option<Matrix2<f64>> {
        let seen = self.parameters.position(floor)?;
        let to_floor = seen.by_floor.try_inverse()?;
        let by_parameters = to_floor * seen.by_parameters;
        Some(by_parameters * self.covariance * by_parameters.transpose())
    }

    /// Covariance of the fitted image position of `floor`, in square pixels of the ideal image, for a pixel error of 1.
    fn covariance_px2(&self, floor: Point) -> Option<Matrix2<f64>> {
        let to_px = self.parameters.to_px * self.parameters.position(floor)?.by_parameters;
        Some(to_px * self.covariance * to_px.transpose())
    }

    /// Why the points cannot all be right, in images `width` pixels wide: one of them contradicts the others, or the
    /// residuals are too large to be marking errors. `None` if the points agree.
    pub fn contradiction(&self, width: usize) -> Option<HomographyError> {
        let limit_px = LIMIT_PX * (width as f64 / LIMIT_WIDTH).max(1.0);
        let noise_px = self.noise_px()?;
        let hopeless = noise_px > limit_px;
        if let Some(suspect) = Suspect::find(&self.points, self.camera.lens()) {
            // The others must agree, or they say nothing about the suspect.
            let explains = suspect.others_noise_px <= limit_px;
            if explains && (hopeless || suspect.surprise > surprising(suspect.freedom)) {
                return Some(HomographyError::Outlier { point: suspect.index + 1, miss_px: suspect.miss_px });
            }
        }
        hopeless.then(|| {
            let size = |r: &Point| r[0].hypot(r[1]);
            let worst = (0..self.points.len())
                .max_by(|&a, &b| size(&self.residuals_px[a]).total_cmp(&size(&self.residuals_px[b])))
                .unwrap_or(0);
            let residual_px = size(&self.residuals_px[worst]);
            HomographyError::Inconsistent { noise_px, limit_px, worst: worst + 1, residual_px }
        })
    }

    /// The point without which the others fit a camera, if there is one. For sets that [`Self::new`] refuses.
    pub fn culprit(points: &[FloorPoint], lens: Option<&LensMap>) -> Option<HomographyError> {
        let suspect = Suspect::find(points, lens).filter(|s| s.others_noise_px <= LIMIT_PX)?;
        Some(HomographyError::Outlier { point: suspect.index + 1, miss_px: suspect.miss_px })
    }
}

/// The point without which the others agree best.
struct Suspect {
    index: usize,
    /// Pixel error of the others, from their residuals.
    others_noise_px: f64,
    /// Distance from the marked pixel to where the others' camera sees the point; infinite if it is behind that camera.
    miss_px: f64,
    /// Squared miss relative to its predicted covariance (Mahalanobis): twice a variable of Fisher's F(2, freedom).
    surprise: f64,
    freedom: f64,
}

impl Suspect {
    /// `None` with fewer than six points: four of five always agree exactly. `None` too with so many that the search
    /// would take seconds.
    fn find(points: &[FloorPoint], lens: Option<&LensMap>) -> Option<Self> {
        let without = |index: usize| {
            let others: Vec<_> = points.iter().enumerate().filter(|&(k, _)| k != index).map(|(_, p)| *p).collect();
            FloorFit::new(&others, lens).ok().map(|fit| (index, fit))
        };
        if !(6..=MOST_POINTS).contains(&points.len()) {
            return None;
        }
        let (index, fit) = (0..points.len()).filter_map(without).min_by(|a, b| a.1.cost().total_cmp(&b.1.cost()))?;
        let others_noise_px = fit.noise_px()?;
        let freedom = fit.freedom() + PRIOR_RESIDUALS;
        let variance = (fit.cost() + PRIOR_RESIDUALS * PRIOR_NOISE_PX.powi(2)) / freedom;
        let FloorPoint { pixel, floor_m } = points[index];
        let miss = fit.camera.project(floor_m).map(|q| Vector2::new(pixel[0] - q[0], pixel[1] - q[1]));
        let surprise = miss.and_then(|miss| {
            let open = (Matrix2::identity() + fit.covariance_px2(floor_m)?) * variance;
            Some((miss.transpose() * open.try_inverse()? * miss)[0])
        });
        let (miss_px, surprise) = (miss.map_or(f64::INFINITY, |m| m.norm()), surprise.unwrap_or(f64::INFINITY));
        Some(Self { index, others_noise_px, miss_px, surprise, freedom })
    }
}

/// The value that twice a variable of F(2, freedom) exceeds with probability [`FALSE_ALARM`].
fn surprising(freedom: f64) -> f64 {
    freedom * (FALSE_ALARM.powf(-2.0 / freedom) - 1.0)
}

/// A homography between floor and pixel coordinates that are both centred and scaled to about 1, as nine numbers of
/// norm 1.
#[derive(Debug, Clone, PartialEq)]
struct Parameters {
    h: Vector9,
    from_floor: Matrix3<f64>,
    from_pixel: Matrix3<f64>,
    /// Pixels per unit of the scaled image.
    to_px: f64,
}

/// Position of a floor point in the scaled image, with its derivatives.
struct Position {
    at: Vector2<f64>,
    by_parameters: Jacobian,
    by_floor: Matrix2<f64>,
}

impl Parameters {
    fn of(homography: &Homography, pairs: &[(Point, Point)]) -> Result<Self, HomographyError> {
        let from_floor = normaliser(pairs.iter().map(|p| p.0)).ok_or(HomographyError::Degenerate)?;
        let from_pixel = normaliser(pairs.iter().map(|p| p.1)).ok_or(HomographyError::Degenerate)?;
        let to_floor = from_floor.try_inverse().ok_or(HomographyError::Degenerate)?;
        let matrix = from_pixel * homography.matrix() * to_floor;
        // Choose the sign that makes depth positive in front of the camera.
        let [x, y] = pairs[0].0;
        let sign = (homography.matrix() * Vector3::new(x, y, 1.0))[2].signum();
        let h = Vector9::from_fn(|k, _| sign * matrix[(k / 3, k % 3)]).normalize();
        Ok(Self { h, from_floor, from_pixel, to_px: 1.0 / from_pixel[(0, 0)] })
    }

    fn matrix(&self) -> Matrix3<f64> {
        Matrix3::from_fn(|i, j| self.h[3 * i + j])
    }

    fn homography(&self, seen: &[FloorPoint]) -> Result<Homography, HomographyError> {
        let to_pixel = self.from_pixel.try_inverse().ok_or(HomographyError::Degenerate)?;
        Homography::from_matrix(to_pixel * self.matrix() * self.from_floor, seen.iter().map(|p| p.floor_m))
    }

    /// `None` behind the camera.
    fn position(&self, floor: Point) -> Option<Position> {
        let matrix = self.matrix();
        let f = self.from_floor * Vector3::new(floor[0], floor[1], 1.0);
        let v = matrix * f;
        if v[2] <= 0.0 {
            return None;
        }
        let at = Vector2::new(v[0] / v[2], v[1] / v[2]);
        let by_parameters = Jacobian::from_fn(|c, k| match k / 3 {
            2 => -at[c] * f[k % 3] / v[2],
            row if row == c => f[k % 3] / v[2],
            _ => 0.0,
        });
        let scale = self.from_floor[(0, 0)];
        let by_floor = Matrix2::from_fn(|c, k| scale * (matrix[(c, k)] - at[c] * matrix[(2, k)]) / v[2]);
        Some(Position { at, by_parameters, by_floor })
    }

    /// Image position of a floor point, in pixels, and its derivatives; `None` if it is not seen.
    fn seen(&self, floor: Point, lens: Option<&LensMap>) -> Option<(Point, Jacobian)> {
        let position = self.position(floor)?;
        let offset = [self.from_pixel[(0, 2)], self.from_pixel[(1, 2)]];
        let ideal = [0, 1].map(|c| (position.at[c] - offset[c]) * self.to_px);
        let by_ideal = position.by_parameters * self.to_px;
        match lens {
            None => Some((ideal, by_ideal)),
            Some(lens) => {
                let [a, b] = lens.jacobian(ideal);
                Some((lens.distort(ideal)?, Matrix2::new(a[0], a[1], b[0], b[1]) * by_ideal))
            }
        }
    }

    /// Sum of squares, gradient and normal matrix; `None` if a point is not seen.
    fn normal(&self, points: &[FloorPoint], lens: Option<&LensMap>) -> Option<(f64, Vector9, Matrix9)> {
        let (mut cost, mut gradient, mut normal) = (0.0, Vector9::zeros(), Matrix9::zeros());
        for point in points {
            let (seen, jacobian) = self.seen(point.floor_m, lens)?;
            let r = Vector2::new(point.pixel[0] - seen[0], point.pixel[1] - seen[1]);
            cost += r.norm_squared();
            gradient += jacobian.transpose() * r;
            normal += jacobian.transpose() * jacobian;
        }
        // The scale of h has no effect, so the matrix would be singular. This term fixes the scale and leaves the
        // inverse in the other eight directions unchanged.
        normal += self.h * self.h.transpose() * (normal.trace() / 8.0);
        Some((cost, gradient, normal))
    }
}

/// Larger sets are thinned out to this many points for the search for four good ones.
const SEARCHED: usize = 16;

/// Whether there are four points of which every three form a triangle with altitudes of at least `least`.
fn general_position(points: &[Point], least: f64) -> bool {
    let step = points.len().div_ceil(SEARCHED).max(1);
    let p: Vec<Point> = points.iter().copied().step_by(step).collect();
    let clear = |i: usize, j: usize, k: usize| altitude([p[i], p[j], p[k]]) >= least;
    let n = p.len();
    (0..n).any(|i| {
        (i + 1..n).any(|j| {
            (j + 1..n)
                .filter(|&k| clear(i, j, k))
                .any(|k| (k + 1..n).any(|l| clear(i, j, l) && clear(i, k, l) && clear(j, k, l)))
        })
    })
}

/// The smallest altitude of a triangle.
fn altitude(corners: [Point; 3]) -> f64 {
    let [a, b, c] = corners.map(|p| Vector2::new(p[0], p[1]));
    let longest = (b - a).norm().max((c - b).norm()).max((a - c).norm());
    let (u, v) = (b - a, c - a);
    if longest > 0.0 { (u[0] * v[1] - u[1] * v[0]).abs() / longest } else { 0.0 }
}

/// Levenberg-Marquardt on the distances in the image. Returns the best parameters and their inverse normal matrix.
fn refine(start: Parameters, points: &[FloorPoint], lens: Option<&LensMap>) -> Option<(Parameters, Matrix9)> {
    let mut best = start;
    let (mut cost, mut gradient, mut normal) = best.normal(points, lens)?;
    let mut damping = 1e-4;
    for _ in 0..100 {
        let mut damped = normal;
        (0..9).for_each(|k| damped[(k, k)] *= 1.0 + damping);
        let step = damped.cholesky()?.solve(&gradient);
        let next = Parameters { h: (best.h + step).normalize(), ..best.clone() };
        match next.normal(points, lens).filter(|n| n.0 <= cost) {
            Some(better) => {
                let done = cost - better.0 <= 1e-12 * cost || step.norm() < 1e-12;
                best = next;
                (cost, gradient, normal) = better;
                damping *= 0.1;
                if done {
                    break;
                }
            }
            None if damping > 1e8 => break,
            None => damping *= 10.0,
        }
    }
    Some((best, normal.cholesky()?.inverse()))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::calibration::pinhole::Pinhole;
    use crate::optics::Lens;

    const FLOOR: [Point; 6] = [[-0.4, -0.1], [0.4, -0.1], [0.5, -0.5], [-0.45, -0.4], [0.1, -0.6], [-0.1, -0.25]];

    fn camera() -> Pinhole {
        Pinhole { at: [0.1, -1.3, 1.1], tilt: 0.8, turn: -0.1, roll: 0.05, focal: 480.0, centre: [319.5, 179.5] }
    }

    fn lens(k1: f64) -> LensMap {
        LensMap::new(&Lens { k1, k2: 0.03, focal_px: Some(480.0) }, [640, 360]).unwrap()
    }

    /// The points as a camera with a lens sees them, each marked with an offset `off`.
    fn marked(lens: Option<&LensMap>, off: [Point; 6]) -> Vec<FloorPoint> {
        let see = |floor_m| {
            let ideal = camera().see(floor_m).unwrap();
            lens.map_or(ideal, |lens| lens.distort(ideal).unwrap())
        };
        let mark = |(floor_m, off): (Point, Point)| {
            let seen = see(floor_m);
            FloorPoint { pixel: [seen[0] + off[0], seen[1] + off[1]], floor_m }
        };
        FLOOR.into_iter().zip(off).map(mark).collect()
    }

    fn offsets() -> impl Strategy<Value = [Point; 6]> {
        proptest::array::uniform6(proptest::array::uniform2(-1.0..1.0f64))
    }

    proptest! {
        #[test]
        fn a_camera_with_a_lens_is_found_from_exact_points(k1 in -0.2..0.2f64, x in -0.5..0.5f64, y in -0.5..-0.1f64) {
            let lens = lens(k1);
            let fit = FloorFit::new(&marked(Some(&lens), [[0.0; 2]; 6]), Some(&lens)).unwrap();
            let (ours, theirs) = (fit.camera().project([x, y]).unwrap(), lens.distort(camera().see([x, y]).unwrap()).unwrap());
            prop_assert!((ours[0] - theirs[0]).hypot(ours[1] - theirs[1]) < 1e-5);
            prop_assert!(fit.residuals_px().iter().flatten().all(|r| r.abs() < 1e-6));
            prop_assert_eq!(fit.contradiction(640), None);
        }

        #[test]
        fn no_camera_nearby_is_closer_to_the_points(off in offsets(), k1 in -0.2..0.2f64, change in proptest::array::uniform9(-1.0..1.0f64)) {
            let lens = lens(k1);
            let points = marked(Some(&lens), off);
            let fit = FloorFit::new(&points, Some(&lens)).unwrap();
            for step in [1e-2, 1e-3, 1e-4] {
                let h = fit.parameters.h + Vector9::from(change) * step;
                let other = Parameters { h, ..fit.parameters.clone() };
                let cost = other.normal(&points, Some(&lens)).map_or(f64::INFINITY, |n| n.0);
                prop_assert!(cost >= fit.cost() * (1.0 - 1e-9), "{cost} {}", fit.cost());
            }
        }

        #[test]
        fn in_pixels_half_as_large_everything_is_twice_as_many(off in offsets()) {
            let points = marked(None, off);
            let mut fine = points.clone();
            fine.iter_mut().for_each(|p| p.pixel = p.pixel.map(|v| 2.0 * v));
            let (fit, fine) = (FloorFit::new(&points, None).unwrap(), FloorFit::new(&fine, None).unwrap());
            for (a, b) in fit.residuals_px().iter().flatten().zip(fine.residuals_px().iter().flatten()) {
                prop_assert!((2.0 * a - b).abs() < 1e-4);
            }
            let (a, b) = (fit.covariance_m2([0.3, -0.3]).unwrap(), fine.covariance_m2([0.3, -0.3]).unwrap());
            prop_assert!((a / 4.0 - b).norm() < 1e-6 * a.norm());
        }
    }

    #[test]
    fn a_set_that_fits_no_camera_is_blamed_on_the_point_at_fault() {
        let mut points = marked(None, [[0.2, -0.1], [-0.3, 0.1], [0.1, 0.3], [0.0, -0.2], [0.3, 0.2], [-0.2, 0.1]]);
        // Centimetres entered as metres.
        points[3].floor_m[1] = -40.0;
        FloorFit::new(&points, None).expect_err("no camera");
        let error = FloorFit::culprit(&points, None).expect("one is at fault");
        assert!(error.to_string().starts_with("floor_points: point 4 is "), "{error}");
    }

    #[test]
    fn five_points_that_disagree_are_refused_without_a_name() {
        let mut points = marked(None, [[0.0; 2]; 6]);
        points.truncate(5);
        points[2].pixel[0] += 60.0;
        let error = FloorFit::new(&points, None).unwrap().contradiction(640).expect("they disagree");
        assert!(matches!(error, HomographyError::Inconsistent { noise_px, .. } if noise_px > LIMIT_PX), "{error}");
    }
}
