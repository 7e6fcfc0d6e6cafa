use nalgebra::{Matrix2, Matrix2x4, Matrix4, Vector2, Vector4};

use super::Covariance;
use super::motion::Motion;
use crate::geometry::Point;

/// A Kalman filter for one person: mean and covariance of (x, y, vx, vy), in m and m/s in the door frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Filter {
    state: Vector4<f64>,
    covariance: Matrix4<f64>,
}

/// Error of a velocity that was seen, in m/s.
const VELOCITY_M_S: f64 = 0.3;

/// How well a position fits a filter's expectation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Fit {
    /// Squared Mahalanobis distance; chi-square distributed with 2 degrees of freedom.
    pub distance2: f64,
    /// Natural log of the probability density, per m².
    pub log_density: f64,
}

impl Filter {
    /// A person seen once, with the velocity distribution of `motion`.
    pub fn at(position: Point, covariance: &Covariance, motion: &Motion) -> Self {
        let mut all = Matrix4::identity() * motion.speed_m_s.powi(2);
        all.fixed_view_mut::<2, 2>(0, 0).copy_from(&matrix(covariance));
        Self { state: Vector4::new(position[0], position[1], 0.0, 0.0), covariance: all }
    }

    /// A person seen walking, with an error of [`VELOCITY_M_S`] in each direction.
    pub fn walking(position: Point, velocity: [f64; 2], covariance: &Covariance) -> Self {
        let mut filter = Self::at(position, covariance, &Motion { speed_m_s: VELOCITY_M_S, ..Motion::WALKING });
        (filter.state[2], filter.state[3]) = (velocity[0], velocity[1]);
        filter
    }

    /// Predicts the state `seconds` later.
    pub fn predict(&mut self, seconds: f64, motion: &Motion) {
        let (transition, noise) = motion.over(seconds);
        self.state = transition * self.state;
        self.covariance = transition * self.covariance * transition.transpose() + noise;
    }

    /// Updates with a measured position and its covariance (Joseph form, which keeps the covariance positive). Does
    /// nothing if the sum of the two covariances is singular.
    pub fn update(&mut self, position: Point, covariance: &Covariance) {
        let measured = matrix(covariance);
        let Some(inverse) = (self.position_block() + measured).try_inverse() else { return };
        let gain = self.covariance.fixed_columns::<2>(0) * inverse;
        self.state += gain * (Vector2::from(position) - self.state.fixed_rows::<2>(0));
        let kept = Matrix4::identity() - gain * Matrix2x4::identity();
        let updated = kept * self.covariance * kept.transpose() + gain * measured * gain.transpose();
        self.covariance = 0.5 * (updated + updated.transpose());
    }

    /// Updates with a position that is uniformly distributed between this person and `other`: their midpoint plus an
    /// error along the line through them, of variance `frames` · distance² / 12. Solved for this person, the midpoint z
    /// = (x + x')/2 gives x = 2z − x'.
    pub fn update_shared(&mut self, position: Point, covariance: &Covariance, other: &Self, frames: f64) {
        let middle = Vector2::from(position);
        let away = (self.state - other.state).fixed_rows::<2>(0).into_owned();
        let place = 2.0 * middle - other.state.fixed_rows::<2>(0);
        let doubt = matrix(covariance) + away * away.transpose() * (frames / 12.0);
        let all = 4.0 * doubt + other.position_block();
        self.update([place[0], place[1]], &[[all[(0, 0)], all[(0, 1)]], [all[(1, 0)], all[(1, 1)]]]);
    }

    /// How well a position with its covariance fits; `None` if the sum of the two covariances is singular.
    pub fn fit(&self, position: Point, covariance: &Covariance) -> Option<Fit> {
        let spread = self.position_block() + matrix(covariance);
        let away = Vector2::from(position) - self.state.fixed_rows::<2>(0);
        let determinant = spread.determinant();
        let distance2 = away.dot(&(spread.try_inverse()? * away));
        let log_density = -0.5 * distance2 - std::f64::consts::TAU.ln() - 0.5 * determinant.ln();
        (determinant > 0.0 && log_density.is_finite()).then_some(Fit { distance2, log_density })
    }

    pub fn position(&self) -> Point {
        [self.state[0], self.state[1]]
    }

    pub fn velocity(&self) -> [f64; 2] {
        [self.state[2], self.state[3]]
    }

    /// Covariance of the position, in m².
    pub fn position_covariance(&self) -> Covariance {
        let p = &self.covariance;
        [[p[(0, 0)], p[(0, 1)]], [p[(1, 0)], p[(1, 1)]]]
    }

    /// The largest standard deviation of the position in any direction, in metres.
    pub fn position_sd_m(&self) -> f64 {
        let [[xx, xy], [_, yy]] = self.position_covariance();
        (0.5 * (xx + yy) + (0.5 * (xx - yy)).hypot(xy)).max(0.0).sqrt()
    }

    fn position_block(&self) -> Matrix2<f64> {
        self.covariance.fixed_view::<2, 2>(0, 0).into_owned()
    }
}

/// Whether a matrix can be the covariance of a position: finite, symmetric and positive.
pub(super) fn is_covariance(covariance: &Covariance) -> bool {
    let [[xx, xy], [yx, yy]] = *covariance;
    [xx, xy, yx, yy].iter().all(|v| v.is_finite())
        && (xy - yx).abs() <= 1e-9 * (xx.abs() + yy.abs())
        && xx > 0.0
        && yy > 0.0
        && xx * yy - xy * yx > 0.0
}

fn matrix(covariance: &Covariance) -> Matrix2<f64> {
    let [[xx, xy], [yx, yy]] = *covariance;
    Matrix2::new(xx, xy, yx, yy)
}

#[cfg(test)]
mod tests {
    use nalgebra::DMatrix;
    use proptest::prelude::*;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    use super::*;

    const R: Covariance = [[0.04, 0.03], [0.03, 0.09]];

    #[test]
    fn steps_equal_the_textbook_formulas() {
        let motion = Motion::WALKING;
        let mut filter = Filter::at([0.3, 1.2], &R, &motion);
        let h = DMatrix::from_row_slice(2, 4, &[1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0]);
        let r = DMatrix::from_row_slice(2, 2, &[0.04, 0.03, 0.03, 0.09]);
        let mut x = DMatrix::from_column_slice(4, 1, &[0.3, 1.2, 0.0, 0.0]);
        let mut p = DMatrix::from_diagonal_element(4, 4, 0.49);
        p.view_mut((0, 0), (2, 2)).copy_from(&r);
        for (dt, z) in [(0.1, [0.35, 1.1]), (0.27, [0.2, 1.3]), (0.0, [0.25, 1.2]), (1.0, [-0.4, 1.9])] {
            filter.predict(dt, &motion);
            let (f, q) = motion.over(dt);
            let (f, q) =
                (DMatrix::from_iterator(4, 4, f.iter().copied()), DMatrix::from_iterator(4, 4, q.iter().copied()));
            x = &f * x;
            p = &f * p * f.transpose() + q;
            let s = &h * &p * h.transpose() + &r;
            let y = DMatrix::from_column_slice(2, 1, &z) - &h * &x;
            let inverse = s.clone().try_inverse().unwrap();
            let fit = filter.fit(z, &R).unwrap();
            let distance2 = (y.transpose() * &inverse * &y)[(0, 0)];
            let density = (-0.5 * distance2).exp() / (std::f64::consts::TAU * s.determinant().sqrt());
            assert!((fit.distance2 - distance2).abs() < 1e-10 && (fit.log_density - density.ln()).abs() < 1e-10);
            let k = &p * h.transpose() * inverse;
            x += &k * y;
            p = (DMatrix::identity(4, 4) - k * &h) * p;
            filter.update(z, &R);
            assert!((0..4).all(|i| (filter.state[i] - x[i]).abs() < 1e-12));
            assert!((0..16).all(|i| (filter.covariance[i] - p[i]).abs() < 1e-12));
        }
    }

    #[test]
    fn measurements_of_a_moment_are_averaged_by_their_weights() {
        let mut filter = Filter::at([0.0, 0.0], &[[0.01, 0.0], [0.0, 0.04]], &Motion::WALKING);
        filter.update([1.0, 1.0], &[[0.03, 0.0], [0.0, 0.04]]);
        let ([x, y], p) = (filter.position(), filter.position_covariance());
        assert!((x - 0.25).abs() < 1e-14 && (y - 0.5).abs() < 1e-14);
        assert!((p[0][0] - 0.0075).abs() < 1e-14 && (p[1][1] - 0.02).abs() < 1e-14);
        assert!((filter.position_sd_m() - 0.02_f64.sqrt()).abs() < 1e-14);
    }

    #[test]
    fn a_shared_position_moves_the_middle_of_two_there() {
        // Two equally uncertain people along x; the detection is exact and beside the line through them.
        let motion = Motion::WALKING;
        let wide = [[0.04, 0.0], [0.0, 0.04]];
        let (left, right) = (Filter::at([-0.3, 1.0], &wide, &motion), Filter::at([0.3, 1.0], &wide, &motion));
        let (mut a, mut b) = (left, right);
        a.update_shared([0.0, 1.1], &[[1e-9, 0.0], [0.0, 1e-9]], &right, 15.0);
        b.update_shared([0.0, 1.1], &[[1e-9, 0.0], [0.0, 1e-9]], &left, 15.0);
        for (filter, x) in [(a, -0.3), (b, 0.3)] {
            assert!((filter.position()[0] - x).abs() < 1e-12 && (filter.position()[1] - 1.1).abs() < 1e-6);
        }
        // Off the middle, but on the line through them: they hardly move.
        let mut a = left;
        a.update_shared([0.2, 1.0], &[[1e-9, 0.0], [0.0, 1e-9]], &right, 15.0);
        assert!((a.position()[0] + 0.3).abs() < 0.02 && a.position()[1] == 1.0);
        // Joint estimate of both from an exact midpoint: half of each covariance remains.
        let mut a = left;
        a.update_shared([0.0, 1.1], &[[1e-9, 0.0], [0.0, 1e-9]], &right, 0.0);
        assert!((a.position_covariance()[1][1] - 0.02).abs() < 1e-6);
    }

    #[test]
    fn errors_are_as_large_as_it_says() {
        // NEES: squared errors in units of the covariance, 4 on average, over walks drawn from the model itself.
        let motion = Motion::WALKING;
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let normal = |rng: &mut ChaCha8Rng| -> f64 { StandardNormal.sample(rng) };
        let draw = |rng: &mut ChaCha8Rng, root: Matrix4<f64>| root * Vector4::from_fn(|_, _| normal(rng));
        let noise_root = matrix(&R).cholesky().unwrap().l();
        let (mut sum, mut inside, mut count) = (0.0, 0, 0);
        for _ in 0..1500 {
            let mut truth =
                Vector4::new(0.4, 1.5, motion.speed_m_s * normal(&mut rng), motion.speed_m_s * normal(&mut rng));
            let mut filter: Option<Filter> = None;
            for step in 0..12 {
                let dt = if step % 3 == 0 { 0.3 } else { 0.07 };
                let (f, q) = motion.over(dt);
                truth = f * truth + draw(&mut rng, q.cholesky().unwrap().l());
                let noise = noise_root * Vector2::from_fn(|_, _| normal(&mut rng));
                let z = [truth[0] + noise[0], truth[1] + noise[1]];
                match &mut filter {
                    None => filter = Some(Filter::at(z, &R, &motion)),
                    Some(filter) => {
                        filter.predict(dt, &motion);
                        filter.update(z, &R);
                    }
                }
            }
            let filter = filter.unwrap();
            let error = truth - filter.state;
            sum += error.dot(&(filter.covariance.try_inverse().unwrap() * error));
            let place = error.fixed_rows::<2>(0).into_owned();
            inside += usize::from(place.dot(&(filter.position_block().try_inverse().unwrap() * place)) < 5.991);
            count += 1;
        }
        // Over 1500 walks, the standard deviation of the mean is √8/√1500 = 0.073, that of the share 0.0056.
        let (nees, share) = (sum / count as f64, inside as f64 / count as f64);
        assert!((nees - 4.0).abs() < 0.3, "{nees}");
        assert!((share - 0.95).abs() < 0.025, "{share}");
    }

    #[test]
    fn what_is_no_covariance_is_told() {
        assert!(is_covariance(&R));
        for wrong in [
            [[0.0, 0.0], [0.0, 1.0]],
            [[1.0, 1.0], [1.0, 1.0]],
            [[1.0, 0.5], [-0.5, 1.0]],
            [[f64::NAN, 0.0], [0.0, 1.0]],
            [[f64::INFINITY, 0.0], [0.0, 1.0]],
            [[-1.0, 0.0], [0.0, -1.0]],
        ] {
            assert!(!is_covariance(&wrong), "{wrong:?}");
        }
    }

    proptest! {
        #[test]
        fn covariances_stay_positive_and_fits_finite(
            steps in prop::collection::vec((0.0..2.0_f64, -3.0..3.0_f64, 0.0..3.0_f64, 1e-6..1.0_f64, -0.999..0.999_f64), 1..40),
        ) {
            let motion = Motion::WALKING;
            let mut filter = Filter::at([0.0, 1.0], &R, &motion);
            for (dt, x, y, sd, correlation) in steps {
                let r = [[sd * sd, correlation * sd * 0.1], [correlation * sd * 0.1, 0.01]];
                filter.predict(dt, &motion);
                let fit = filter.fit([x, y], &r);
                prop_assert!(fit.is_some_and(|f| f.distance2 >= 0.0));
                filter.update([x, y], &r);
                prop_assert!(is_covariance(&filter.position_covariance()), "{:?}", filter.position_covariance());
                prop_assert!(filter.covariance.symmetric_eigenvalues().min() > -1e-12);
            }
        }
    }
}
