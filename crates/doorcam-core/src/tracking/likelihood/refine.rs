use nalgebra::{Cholesky, Const, Matrix2, SMatrix, SVector, Vector2};

use super::body_table::BodyTable;
use super::place::Place;
use super::{Likelihood, MOST_PEOPLE, Measured};
use crate::scene::Rgb;

/// Radiances per colour: one at each edge (left, right) per person.
const R: usize = 2 * MOST_PEOPLE;
/// Unknowns of a body: azimuth, log range, log radius.
const SHAPE: usize = 3;
const P: usize = SHAPE * MOST_PEOPLE;
/// Columns per person: the body and its derivatives.
const EACH: usize = 1 + SHAPE;
const COLUMNS: usize = EACH * MOST_PEOPLE;
/// Prior standard deviation of the part of a person's radiance that both edges share, in units of the empty room's
/// level.
const RADIANCE: f64 = 3.0;
/// Prior standard deviation of the part that is independent at each edge, in the same units.
const BETWEEN_EDGES: f64 = 0.5;
/// Most steps of a refinement.
const STEPS: usize = 5;
/// Largest step in azimuth (radians), in the log of the distance and in the log of the radius.
const LONGEST: [f64; SHAPE] = [0.1, 0.15, 0.1];
/// Prior standard deviation of the log of a person's radius.
const RADIUS_SPREAD: f64 = 0.07;
/// Refinement stops after a step shorter than this.
const SHORTEST: f64 = 1e-3;

/// Refinement stops after a step that gains less than this, in twice the log likelihood.
const LEAST_GAIN: f64 = 0.02;

type Radiances = SMatrix<f64, R, R>;
type Shapes = SMatrix<f64, P, P>;

/// Where somebody is expected: a place and the inverse of its covariance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Prior {
    pub place: Place,
    /// Whether somebody is known to be there.
    pub known: bool,
    pub information: Matrix2<f64>,
}

/// A person in one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Candidate {
    pub place: Place,
    /// Log of the radius, relative to the expected one.
    pub widening: f64,
    pub prior: Option<Prior>,
    /// Radiance at the left and the right edge.
    pub radiance: [Rgb; 2],
    /// How much better the measurement is explained with this person than without, in units of the noise variance.
    pub significance: f64,
    /// The significance at one edge alone, the one that shows this person less.
    pub weaker: f64,
    /// Twice the log of the evidence for this person: the significance less what free radiances would gain by chance.
    pub evidence: f64,
    /// Inverse covariance of the place from the measurement alone, given the others.
    pub information: Matrix2<f64>,
}

impl Candidate {
    pub fn at(place: Place, prior: Option<Prior>) -> Self {
        let place = BodyTable::clamp(place);
        Self {
            place,
            widening: 0.0,
            prior,
            radiance: [[0.0; 3]; 2],
            significance: 0.0,
            weaker: 0.0,
            evidence: 0.0,
            information: Matrix2::zeros(),
        }
    }
}

/// What people leave unexplained.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Left {
    /// Of the measurement: a sum of squares, in units of the noise variance.
    pub misfit: f64,
    /// Of the priors on places and radii: a squared Mahalanobis distance.
    pub surprise: f64,
}

impl Left {
    /// Twice the negative log likelihood for a given noise variance.
    pub fn cost(&self, noise: f64) -> f64 {
        self.misfit / noise + self.surprise
    }
}

/// Workspace for refining people in a frame.
#[derive(Debug, Clone)]
pub(super) struct Refiner {
    /// Per side and person: the effect of the body on the measurement, and its derivatives.
    bodies: [Vec<[Vec<f32>; EACH]>; 2],
    /// Per side, the inner products of all of these with each other.
    products: [SMatrix<f64, COLUMNS, COLUMNS>; 2],
    /// Per side, their inner products with each colour of the measurement.
    measured: [SMatrix<f64, COLUMNS, 3>; 2],
}

/// The best radiances for given places and radii.
struct Fit {
    /// Cholesky factor of their inverse covariance.
    radiances: Cholesky<f64, Const<R>>,
    /// Per colour: at the left edge for each person, then at the right edge.
    radiance: [SVector<f64, R>; 3],
    /// Prior variances of the radiances: the part shared by both edges, and the part independent at each.
    prior: (f64, f64),
    /// Residual of the measurement, with the penalty of the priors on radiances.
    misfit: f64,
    /// Penalty of the priors on places and radii.
    surprise: f64,
}

impl Refiner {
    pub fn new(likelihood: &Likelihood) -> Self {
        let bodies = |s: usize| {
            let zeros = || vec![0.0; likelihood.bodies.values(s)];
            (0..MOST_PEOPLE).map(|_| std::array::from_fn(|_| zeros())).collect()
        };
        Self { bodies: [bodies(0), bodies(1)], products: [SMatrix::zeros(); 2], measured: [SMatrix::zeros(); 2] }
    }

    /// Moves all people at once to where they explain a measurement best: Gauss-Newton steps on places and radii, with
    /// the radiances that are optimal for them (Kaufman's variable projection) and Levenberg-Marquardt damping. Returns
    /// what is left unexplained.
    pub fn refine(&mut self, likelihood: &Likelihood, frame: &Measured, people: &mut [Candidate]) -> Left {
        if people.is_empty() {
            return Left { misfit: frame.energy, surprise: 0.0 };
        }
        let mut fit = self.fit(likelihood, frame, people);
        let mut damping = 1e-3;
        for _ in 0..STEPS {
            let noise = (fit.misfit / frame.count).max(1.0);
            let (mut hessian, gradient) = self.normal_equations(&fit, people, noise);
            let objective = |fit: &Fit| fit.misfit / noise + fit.surprise;
            let before = objective(&fit);
            let held: [Candidate; MOST_PEOPLE] = std::array::from_fn(|k| people[k.min(people.len() - 1)]);
            for k in 0..SHAPE * people.len() {
                hessian[(k, k)] = hessian[(k, k)] * (1.0 + damping) + 1e-6;
            }
            let Some(factor) = Cholesky::new(hessian) else { break };
            let step = factor.solve(&gradient);
            if step.iter().any(|v| !v.is_finite()) {
                break;
            }
            let mut longest = 0.0_f64;
            for (k, person) in people.iter_mut().enumerate() {
                let [a, r, w] = [0, 1, 2].map(|j| step[SHAPE * k + j].clamp(-LONGEST[j], LONGEST[j]));
                longest = longest.max(a.abs()).max(r.abs());
                person.place = likelihood.inside(person.place.plus(Vector2::new(a, r)));
                person.widening = (person.widening + w).clamp(-3.0 * RADIUS_SPREAD, 3.0 * RADIUS_SPREAD);
            }
            let next = self.fit(likelihood, frame, people);
            let gained = before - objective(&next);
            if gained >= 0.0 {
                fit = next;
                damping = (damping * 0.2_f64).max(1e-4);
                if longest < SHORTEST || gained < LEAST_GAIN {
                    break;
                }
            } else {
                people.copy_from_slice(&held[..people.len()]);
                damping *= 20.0;
                fit = self.fit(likelihood, frame, people);
            }
        }
        let noise = (fit.misfit / frame.count).max(1.0);
        self.describe(&fit, people, noise);
        Left { misfit: fit.misfit, surprise: fit.surprise }
    }

    fn fit(&mut self, likelihood: &Likelihood, frame: &Measured, people: &[Candidate]) -> Fit {
        let count = people.len();
        for s in 0..2 {
            for (person, [value, by_azimuth, by_range, by_radius]) in people.iter().zip(&mut self.bodies[s]) {
                let out = [value, by_azimuth, by_range, by_radius].map(Vec::as_mut_slice);
                likelihood.bodies.body(s, person.place, person.widening, out);
            }
            let columns = |k: usize| self.bodies[s][k / EACH][k % EACH].as_slice();
            for i in 0..EACH * count {
                for j in 0..=i {
                    let product = frame.trust[s] * dot(columns(i), columns(j));
                    self.products[s][(i, j)] = product;
                    self.products[s][(j, i)] = product;
                }
                for c in 0..3 {
                    self.measured[s][(i, c)] = frame.trust[s] * dot(columns(i), frame.values[s][c].as_slice());
                }
            }
        }
        // Unused unknowns get an identity block.
        let mut information = Radiances::identity();
        let (together, apart) = ((RADIANCE * likelihood.level).powi(2), (BETWEEN_EDGES * likelihood.level).powi(2));
        // The inverse of [[v + d, v], [v, v + d]].
        let of_one = (together + apart) / (apart * (2.0 * together + apart));
        let of_both = -together / (apart * (2.0 * together + apart));
        for s in 0..2 {
            for i in 0..count {
                for j in 0..count {
                    information[(s * count + i, s * count + j)] = self.products[s][(EACH * i, EACH * j)];
                }
                information[(s * count + i, s * count + i)] += of_one;
                information[(s * count + i, (1 - s) * count + i)] = of_both;
            }
        }
        // A Gram matrix plus a prior is positive definite; the scaled identity is a fallback against rounding.
        let radiances = Cholesky::new(information).or_else(|| Cholesky::new(Radiances::identity() * 1e12));
        let radiances = radiances.unwrap_or_else(|| Cholesky::pack_dirty(Radiances::identity()));
        let mut misfit = frame.energy;
        let radiance = [0, 1, 2].map(|c| {
            let mut right = SVector::zeros();
            for s in 0..2 {
                (0..count).for_each(|k| right[s * count + k] = self.measured[s][(EACH * k, c)]);
            }
            let solved = radiances.solve(&right);
            misfit -= right.dot(&solved);
            solved
        });
        let surprise =
            people.iter().filter_map(|p| p.prior.map(|prior| (p.place.minus(prior.place), prior.information)));
        let surprise: f64 = surprise.map(|(away, information)| away.dot(&(information * away))).sum();
        let surprise = surprise + people.iter().map(|p| (p.widening / RADIUS_SPREAD).powi(2)).sum::<f64>();
        Fit { radiances, radiance, prior: (together, apart), misfit, surprise }
    }

    /// Hessian and negative gradient of half the objective, by azimuth, log range and log radius of each person.
    fn normal_equations(&self, fit: &Fit, people: &[Candidate], noise: f64) -> (Shapes, SVector<f64, P>) {
        let count = people.len();
        let mut hessian = Shapes::identity();
        hessian.view_mut((0, 0), (SHAPE * count, SHAPE * count)).fill(0.0);
        let mut gradient = SVector::zeros();
        for c in 0..3 {
            // Mixed derivatives by radiances and shapes.
            let mut mixed = SMatrix::<f64, R, P>::zeros();
            for s in 0..2 {
                let radiance = |k: usize| fit.radiance[c][s * count + k];
                for (k, d) in (0..count).flat_map(|k| (0..SHAPE).map(move |d| (k, d))) {
                    let (row, p) = (EACH * k + 1 + d, SHAPE * k + d);
                    let mut left = self.measured[s][(row, c)];
                    for j in 0..count {
                        left -= radiance(j) * self.products[s][(row, EACH * j)];
                        mixed[(s * count + j, p)] = radiance(k) * self.products[s][(row, EACH * j)];
                        for e in 0..SHAPE {
                            hessian[(p, SHAPE * j + e)] +=
                                radiance(k) * radiance(j) * self.products[s][(row, EACH * j + 1 + e)] / noise;
                        }
                    }
                    gradient[p] += radiance(k) * left / noise;
                }
            }
            hessian -= mixed.transpose() * fit.radiances.solve(&mixed) / noise;
        }
        for (k, person) in people.iter().enumerate() {
            let radius = SHAPE * k + 2;
            gradient[radius] -= person.widening / RADIUS_SPREAD.powi(2);
            hessian[(radius, radius)] += RADIUS_SPREAD.powi(-2);
            if let Some(prior) = &person.prior {
                let pull = prior.information * prior.place.minus(person.place);
                for i in 0..2 {
                    gradient[SHAPE * k + i] += pull[i];
                    (0..2).for_each(|j| hessian[(SHAPE * k + i, SHAPE * k + j)] += prior.information[(i, j)]);
                }
            }
        }
        (hessian, gradient)
    }

    /// Fills in the results for each person at the best fit.
    fn describe(&self, fit: &Fit, people: &mut [Candidate], noise: f64) {
        let count = people.len();
        let covariance = fit.radiances.inverse();
        let (together, apart) = fit.prior;
        let prior_determinant = apart * (2.0 * together + apart);
        let (hessian, _) = self.normal_equations(fit, people, noise);
        let places = (hessian + Shapes::identity() * 1e-6).try_inverse();
        for (k, person) in people.iter_mut().enumerate() {
            let both = [k, count + k];
            person.radiance = both.map(|r| [0, 1, 2].map(|c| fit.radiance[c][r]));
            let block = Matrix2::from_fn(|i, j| covariance[(both[i], both[j])]);
            person.significance = block.try_inverse().map_or(0.0, |inverse| {
                let of = |c: usize| Vector2::from_fn(|i, _| fit.radiance[c][both[i]]);
                (0..3).map(|c| of(c).dot(&(inverse * of(c)))).sum::<f64>() / noise
            });
            let by_edge = |s: usize| person.radiance[s].iter().map(|r| r * r).sum::<f64>() / (noise * block[(s, s)]);
            person.weaker = by_edge(0).min(by_edge(1));
            // Volume of the prior relative to the posterior, for three colours: the closer to the door, the smaller the
            // posterior.
            person.evidence = person.significance
                - 3.0 * (prior_determinant / (noise * block).determinant().max(f64::MIN_POSITIVE)).ln();
            let all = places.and_then(|p| p.fixed_view::<2, 2>(SHAPE * k, SHAPE * k).into_owned().try_inverse());
            let prior = person.prior.map_or(Matrix2::zeros(), |prior| prior.information);
            person.information = all.map_or(Matrix2::zeros(), |all| all - prior);
        }
    }
}

/// Dot product in eight partial sums, which the compiler keeps in one register.
fn dot(a: &[f32], b: &[f32]) -> f64 {
    let mut sums = [0.0_f32; 8];
    let (left, right) = (a.chunks_exact(8), b.chunks_exact(8));
    let rest: f32 = left.remainder().iter().zip(right.remainder()).map(|(x, y)| x * y).sum();
    for (x, y) in left.zip(right) {
        (0..8).for_each(|k| sums[k] += x[k] * y[k]);
    }
    f64::from(rest + sums.iter().sum::<f32>())
}
