use nalgebra::{Cholesky, Matrix2, SMatrix, SVector, Vector2};

use super::body_table::BodyTable;
use super::linear::{Factor, R};
use super::place::Place;
use super::{Likelihood, MOST_PEOPLE, Measured};
use crate::scene::Rgb;

/// Unknowns of a body: azimuth, log range, log radius.
const SHAPE: usize = 3;
const P: usize = SHAPE * MOST_PEOPLE;
/// A light and its derivatives by these.
const WITH_SHAPE: usize = 1 + SHAPE;
/// Columns per person: the body's own light, and what it hides.
const EACH: usize = 2 * WITH_SHAPE;
/// The first column of what a body hides.
const HIDDEN: usize = WITH_SHAPE;
const COLUMNS: usize = EACH * MOST_PEOPLE;
/// Prior standard deviation of the part of a person's radiance that both edges share, in units of the empty room's
/// level.
const RADIANCE: f64 = 3.0;
/// Prior standard deviation of the part that is independent at each edge, in the same units.
const BETWEEN_EDGES: f64 = 0.5;
/// Prior standard deviation of the strength of what a person hides, which is 1 if the still room is as it seems. Lamps
/// may be above people's heads, and bodies have legs.
const HIDDEN_SD: f64 = 0.7;
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
    /// The significance at the left and at the right edge alone.
    pub by_edge: [f64; 2],
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
            by_edge: [0.0; 2],
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
    /// Per side and person: the effect of the body's own light on the measurement, and its derivatives.
    own: [Vec<[Vec<f32>; WITH_SHAPE]>; 2],
    /// The same per colour for what it hides.
    hidden: [[Vec<[Vec<f32>; WITH_SHAPE]>; 3]; 2],
    /// Per side and colour, the inner products of all of these with each other.
    products: Box<[[SMatrix<f64, COLUMNS, COLUMNS>; 3]; 2]>,
    /// Per side, their inner products with each colour of the measurement.
    measured: [SMatrix<f64, COLUMNS, 3>; 2],
}

/// A linear unknown.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Unknown {
    side: usize,
    person: usize,
    /// The column that it multiplies: the person's own light, or what they hide.
    column: usize,
}

/// The best linear unknowns of a colour for given places and radii.
#[derive(Debug, Clone, Copy)]
struct Linear {
    unknowns: [Unknown; R],
    count: usize,
    factor: Factor,
    values: [f64; R],
    /// What the people change in the misfit.
    explained: f64,
    /// Log of the volume of the posterior relative to the prior.
    volume: f64,
    /// Number of radiances among the unknowns.
    radiances: usize,
}

/// The best linear unknowns for given places and radii.
struct Fit {
    colours: [Linear; 3],
    /// Residual of the measurement, with the penalty of the priors on linear unknowns.
    misfit: f64,
    /// Penalty of the priors on places and radii.
    surprise: f64,
}

/// Who is included in a fit, per side.
type Present = [[bool; MOST_PEOPLE]; 2];

impl Linear {
    fn of(&self, side: usize, person: usize, column: usize) -> f64 {
        let wanted = Unknown { side, person, column: EACH * person + column };
        self.unknowns[..self.count].iter().position(|&u| u == wanted).map_or(0.0, |k| self.values[k])
    }
}

impl Refiner {
    pub fn new(likelihood: &Likelihood) -> Self {
        let bodies = |s: usize| {
            let zeros = || vec![0.0; likelihood.bodies.values(s)];
            (0..MOST_PEOPLE).map(|_| std::array::from_fn(|_| zeros())).collect::<Vec<_>>()
        };
        Self {
            own: [bodies(0), bodies(1)],
            hidden: [0, 1].map(|s| [0, 1, 2].map(|_| bodies(s))),
            products: Box::new([[SMatrix::zeros(); 3]; 2]),
            measured: [SMatrix::zeros(); 2],
        }
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
        self.describe(likelihood, &fit, people, noise);
        Left { misfit: fit.misfit, surprise: fit.surprise }
    }

    fn fit(&mut self, likelihood: &Likelihood, frame: &Measured, people: &[Candidate]) -> Fit {
        self.place(likelihood, frame, people);
        let present = [0, 1].map(|_| std::array::from_fn(|k| k < people.len()));
        let colours = [0, 1, 2].map(|c| self.linear(likelihood, c, people.len(), &present));
        let misfit = frame.energy - colours.iter().map(|linear| linear.explained).sum::<f64>();
        let surprise =
            people.iter().filter_map(|p| p.prior.map(|prior| (p.place.minus(prior.place), prior.information)));
        let surprise: f64 = surprise.map(|(away, information)| away.dot(&(information * away))).sum();
        let surprise = surprise + people.iter().map(|p| (p.widening / RADIUS_SPREAD).powi(2)).sum::<f64>();
        Fit { colours, misfit, surprise }
    }

    /// Computes the effects of people at their places, and all inner products.
    fn place(&mut self, likelihood: &Likelihood, frame: &Measured, people: &[Candidate]) {
        let count = people.len();
        let bodies = &likelihood.bodies;
        let colours = if bodies.knows_hidden() { 3 } else { 0 };
        for s in 0..2 {
            let trust = frame.trust[s];
            for (k, person) in people.iter().enumerate() {
                let at = BodyTable::stencil(person.place);
                bodies.body(s, &at, person.widening, self.own[s][k].each_mut().map(Vec::as_mut_slice));
                for c in 0..colours {
                    let out = self.hidden[s][c][k].each_mut().map(Vec::as_mut_slice);
                    bodies.hidden(s, c, &at, person.widening, out);
                }
            }
            for c in 0..3 {
                let (own, hidden) = (&self.own[s], &self.hidden[s][c]);
                let column = |n: usize| match n % EACH {
                    k if k < HIDDEN => own[n / EACH][k].as_slice(),
                    k => hidden[n / EACH][k - HIDDEN].as_slice(),
                };
                let values = frame.values[s][c].as_slice();
                for i in (0..EACH * count).filter(|i| colours > 0 || i % EACH < HIDDEN) {
                    for j in (0..=i).filter(|j| colours > 0 || j % EACH < HIDDEN) {
                        let shared = c > 0 && i % EACH < HIDDEN && j % EACH < HIDDEN;
                        let product = match shared {
                            true => self.products[s][0][(i, j)],
                            false => trust * dot(column(i), column(j)),
                        };
                        self.products[s][c][(i, j)] = product;
                        self.products[s][c][(j, i)] = product;
                    }
                    self.measured[s][(i, c)] = trust * dot(column(i), values);
                }
            }
        }
    }

    /// The best linear unknowns of a colour, with only the people who are `present`.
    fn linear(&self, likelihood: &Likelihood, c: usize, people: usize, present: &Present) -> Linear {
        let (together, apart) = ((RADIANCE * likelihood.level).powi(2), (BETWEEN_EDGES * likelihood.level).powi(2));
        let known = likelihood.bodies.knows_hidden();
        let mut unknowns = [Unknown::default(); R];
        let mut count = 0;
        let mut radiances = 0;
        let columns = if known { 2 } else { 1 };
        for kind in 0..columns {
            for (side, present) in present.iter().enumerate() {
                for person in (0..people).filter(|&person| present[person]) {
                    unknowns[count] = Unknown { side, person, column: EACH * person + kind * HIDDEN };
                    count += 1;
                    radiances += usize::from(kind == 0);
                }
            }
        }
        let mut information = SMatrix::<f64, R, R>::zeros();
        let mut right = [0.0; R];
        // Log of the determinant of the prior's information.
        let mut prior = 0.0;
        let mut explained = 0.0;
        for (i, a) in unknowns[..count].iter().enumerate() {
            let products = &self.products[a.side][c];
            right[i] = self.measured[a.side][(a.column, c)];
            if known {
                for k in (0..people).filter(|&k| present[a.side][k]) {
                    right[i] -= products[(a.column, EACH * k + HIDDEN)];
                }
            }
            for (j, b) in unknowns[..=i].iter().enumerate() {
                if a.side == b.side {
                    information[(i, j)] = products[(a.column, b.column)];
                }
            }
            if i >= radiances {
                information[(i, i)] += HIDDEN_SD.powi(-2);
                prior += HIDDEN_SD.powi(-2).ln();
                // The change of the energy when what they hide is taken out, once from each side of the product.
                explained += self.measured[a.side][(a.column, c)] + right[i];
            } else {
                // The inverse of [[v + d, v], [v, v + d]]; at an edge where somebody is not present, their radiance is 0.
                let determinant = apart * (2.0 * together + apart);
                information[(i, i)] += (together + apart) / determinant;
                prior -= 0.5 * determinant.ln();
                let other = Unknown { side: 1 - a.side, ..*a };
                if let Some(j) = unknowns[..i].iter().position(|&u| u == other) {
                    information[(i, j)] -= together / determinant;
                }
            }
        }
        let factor = Factor::new(information, count);
        let mut values = right;
        factor.solve(&mut values);
        explained += (0..count).map(|k| right[k] * values[k]).sum::<f64>();
        let volume = 0.5 * (prior - factor.log_determinant());
        Linear { unknowns, count, factor, values, explained, volume, radiances }
    }

    /// Hessian and negative gradient of half the objective, by azimuth, log range and log radius of each person.
    fn normal_equations(&self, fit: &Fit, people: &[Candidate], noise: f64) -> (Shapes, SVector<f64, P>) {
        let count = people.len();
        let mut hessian = Shapes::identity();
        hessian.view_mut((0, 0), (SHAPE * count, SHAPE * count)).fill(0.0);
        let mut gradient = SVector::zeros();
        for (c, linear) in fit.colours.iter().enumerate() {
            // Strengths of each person's own light and of what they hide.
            let mut strengths = [[[0.0; 2]; MOST_PEOPLE]; 2];
            if linear.count > linear.radiances {
                strengths.iter_mut().flatten().take(2 * MOST_PEOPLE).for_each(|strength| strength[1] = 1.0);
            }
            for (unknown, value) in linear.unknowns[..linear.count].iter().zip(linear.values) {
                strengths[unknown.side][unknown.person][(unknown.column % EACH) / HIDDEN] += value;
            }
            // Mixed derivatives by linear unknowns and shapes, one column for each shape.
            let mut mixed = [[0.0; R]; P];
            for (s, strengths) in strengths.iter().enumerate() {
                let products = &self.products[s][c];
                for (k, d) in (0..count).flat_map(|k| (0..SHAPE).map(move |d| (k, d))) {
                    let p = SHAPE * k + d;
                    let rows = [EACH * k + 1 + d, EACH * k + HIDDEN + 1 + d];
                    // The derivative of the model is the sum of these columns with these factors.
                    let factors = strengths[k];
                    for (row, factor) in rows.into_iter().zip(factors).filter(|(_, factor)| *factor != 0.0) {
                        let mut left = self.measured[s][(row, c)];
                        for j in 0..count {
                            for (kind, strength) in strengths[j].into_iter().enumerate() {
                                let of = EACH * j + kind * HIDDEN;
                                left -= strength * products[(row, of)];
                                for e in 0..SHAPE {
                                    hessian[(p, SHAPE * j + e)] +=
                                        factor * strength * products[(row, of + 1 + e)] / noise;
                                }
                            }
                        }
                        gradient[p] += factor * left / noise;
                        for (i, unknown) in linear.unknowns[..linear.count].iter().enumerate() {
                            if unknown.side == s {
                                mixed[p][i] += factor * products[(row, unknown.column)];
                            }
                        }
                    }
                }
            }
            for p in 0..SHAPE * count {
                let mut solved = mixed[p];
                linear.factor.solve(&mut solved);
                for (q, other) in mixed[..SHAPE * count].iter().enumerate() {
                    let product: f64 = (0..linear.count).map(|i| solved[i] * other[i]).sum();
                    hessian[(p, q)] -= product / noise;
                }
            }
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
    fn describe(&self, likelihood: &Likelihood, fit: &Fit, people: &mut [Candidate], noise: f64) {
        let count = people.len();
        let (hessian, _) = self.normal_equations(fit, people, noise);
        let places = (hessian + Shapes::identity() * 1e-6).try_inverse();
        for (k, person) in people.iter_mut().enumerate() {
            person.radiance = [0, 1].map(|s| [0, 1, 2].map(|c| self.contrast(fit, s, c, k)));
            let without = |sides: &[usize]| {
                let mut present: Present = [0, 1].map(|_| std::array::from_fn(|j| j < count));
                sides.iter().for_each(|&s| present[s][k] = false);
                let others = [0, 1, 2].map(|c| self.linear(likelihood, c, count, &present));
                let less = |c: usize| fit.colours[c].explained - others[c].explained;
                // A radiance's noise is that of the frame, whatever its prior is.
                let volume = |linear: &Linear| linear.volume + 0.5 * linear.radiances as f64 * noise.ln();
                let narrower = |c: usize| volume(&fit.colours[c]) - volume(&others[c]);
                let sum = |of: &dyn Fn(usize) -> f64| (0..3).map(of).sum::<f64>();
                (sum(&less) / noise, 2.0 * sum(&narrower))
            };
            let (significance, volume) = without(&[0, 1]);
            person.significance = significance;
            person.by_edge = [0, 1].map(|s| without(&[s]).0);
            // Volume of the posterior relative to the prior: the closer to the door, the smaller it is.
            person.evidence = significance + volume;
            let all = places.and_then(|p| p.fixed_view::<2, 2>(SHAPE * k, SHAPE * k).into_owned().try_inverse());
            let prior = person.prior.map_or(Matrix2::zeros(), |prior| prior.information);
            person.information = all.map_or(Matrix2::zeros(), |all| all - prior);
        }
    }

    /// How much brighter somebody is than what they hide: the radiance that alone would have the effect of both.
    fn contrast(&self, fit: &Fit, s: usize, c: usize, k: usize) -> f64 {
        let linear = &fit.colours[c];
        let own = EACH * k;
        let product = self.products[s][c][(own, own)];
        let hidden = match linear.count > linear.radiances && product > 0.0 {
            true => (1.0 + linear.of(s, k, HIDDEN)) * self.products[s][c][(own, own + HIDDEN)] / product,
            false => 0.0,
        };
        linear.of(s, k, 0) + hidden
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
