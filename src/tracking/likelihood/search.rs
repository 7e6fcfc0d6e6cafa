use nalgebra::Matrix2;

use super::place::Place;
use super::refine::{Candidate, Left, Prior, Refiner};
use super::{Likelihood, MOST_PEOPLE, Measured};
use crate::geometry::{Doorway, Point};
use crate::measurement::PatchPair;
use crate::tracking::{Covariance, Detection, Prediction};

/// Evidence (twice a log likelihood ratio) that it takes to believe in somebody who was not expected.
const NEW: f64 = 30.0;
/// Of what the most evident person explains, the share that another one must explain: less may be that person's shadow and
/// light, which are not in the model.
const NEW_SHARE: f64 = 0.05;
/// The same for somebody beside that person, and how near that is, in metres.
const BESIDE_SHARE: f64 = 0.3;
const BESIDE_M: f64 = 0.7;
/// How much brighter or darker than what is behind people are at least, as a share of the floor's level: what is fainter
/// and still shows is near the door, and noise there.
const LEAST_CONTRAST: f64 = 0.15;
/// Evidence that it takes to believe that somebody who was expected is there.
const EXPECTED: f64 = 0.0;
/// Seeds that are tried, the strongest first.
const TRIED: usize = 5;
/// What a model of a body is off, in radians at each edge, standard deviation.
const ANGLE_ERROR: f64 = 0.012;
/// For how long it stays off in the same way, in seconds.
const ERROR_LASTS_S: f64 = 0.8;

/// Where the map shows something.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seed {
    /// Its middle, in metres in the door frame.
    pub position: Point,
    /// How strong it is, in any unit.
    pub strength: f64,
}

/// Finds people in one frame after another.
#[derive(Debug, Clone)]
pub struct Finder {
    doorway: Doorway,
    likelihood: Likelihood,
    refiner: Refiner,
    frame: Measured,
    body_radius_m: f64,
    people: Vec<Candidate>,
    trial: Vec<Candidate>,
    found: Vec<Detection>,
}

impl Finder {
    /// People of a radius, in metres, by what a likelihood says.
    pub fn new(doorway: Doorway, likelihood: Likelihood, body_radius_m: f64) -> Self {
        Self {
            doorway,
            refiner: Refiner::new(&likelihood),
            frame: likelihood.room(),
            body_radius_m,
            people: Vec::with_capacity(MOST_PEOPLE),
            trial: Vec::with_capacity(MOST_PEOPLE),
            found: Vec::with_capacity(MOST_PEOPLE),
            likelihood,
        }
    }

    /// Whom a difference shows, `elapsed_s` after the frame before: of those who are expected, whoever is still there, and of
    /// the seeds (strongest first) those that nobody else explains.
    pub fn find(
        &mut self,
        difference: &PatchPair,
        expected: impl Iterator<Item = Prediction>,
        seeds: &[Seed],
        elapsed_s: f64,
    ) -> &[Detection] {
        self.likelihood.measure(difference, &mut self.frame);
        self.people.clear();
        for prediction in expected.take(MOST_PEOPLE) {
            self.people.extend(prior(&prediction).map(|prior| Candidate::at(prior.place, Some(prior))));
        }
        let mut left = self.refiner.refine(&self.likelihood, &self.frame, &mut self.people);
        left = self.prune(left);
        for seed in seeds.iter().take(TRIED) {
            left = self.consider(seed, left);
        }
        let sluggish = (ERROR_LASTS_S / elapsed_s.max(1e-3)).max(1.0);
        self.found.clear();
        let Self { found, people, doorway, .. } = self;
        found.extend(people.iter().filter_map(|person| detection(doorway, person, sluggish)));
        found.sort_by(|a, b| b.significance.total_cmp(&a.significance));
        &self.found
    }

    /// Drops who is not there, one after the other.
    fn prune(&mut self, mut left: Left) -> Left {
        loop {
            let weakest = (self.people.iter().enumerate()).min_by(|a, b| a.1.evidence.total_cmp(&b.1.evidence));
            let Some((k, weakest)) = weakest else { return left };
            let crowded = self.crowded();
            let dropped = if weakest.evidence < EXPECTED { Some(k) } else { crowded };
            let Some(k) = dropped else { return left };
            self.people.remove(k);
            left = self.refiner.refine(&self.likelihood, &self.frame, &mut self.people);
        }
    }

    /// The less evident of two who would be in one another.
    fn crowded(&self) -> Option<usize> {
        let people = &self.people;
        let touch = |i: usize, j: usize| distance(people[i].place, people[j].place) < 1.5 * self.body_radius_m;
        let pairs = (0..people.len()).flat_map(|i| (0..i).map(move |j| (i, j)));
        let (i, j) = pairs.into_iter().find(|&(i, j)| touch(i, j))?;
        Some(if people[i].significance < people[j].significance { i } else { j })
    }

    /// Sees whether a seed explains the measurement better: as the place of somebody who was found elsewhere, or else as one
    /// more person.
    fn consider(&mut self, seed: &Seed, left: Left) -> Left {
        let place = Place::from_point(seed.position);
        let touching = 1.5 * self.body_radius_m;
        if self.people.iter().any(near_in(place, touching)) {
            return left;
        }
        let left = self.move_somebody(place, left).unwrap_or(left);
        if self.people.len() == MOST_PEOPLE || self.people.iter().any(near_in(place, touching)) {
            return left;
        }
        self.keep_aside();
        self.people.push(Candidate::at(place, None));
        let with = self.refiner.refine(&self.likelihood, &self.frame, &mut self.people);
        let new = self.people[self.people.len() - 1];
        let explained = |person: &Candidate| {
            let share = if distance(person.place, new.place) < BESIDE_M { BESIDE_SHARE } else { NEW_SHARE };
            new.significance < share * person.significance
        };
        let contrast = new.radiance.iter().flatten().map(|r| r * r).sum::<f64>() / 6.0;
        let faint = contrast < (LEAST_CONTRAST * self.likelihood.level).powi(2);
        if faint || new.evidence < NEW || self.people.iter().any(explained) || self.crowded().is_some() {
            std::mem::swap(&mut self.people, &mut self.trial);
            return left;
        }
        self.prune(with)
    }

    /// Whether the person nearest in azimuth explains more at a place than where they are now.
    fn move_somebody(&mut self, place: Place, left: Left) -> Option<Left> {
        let away = |person: &Candidate| (person.place.azimuth - place.azimuth).abs();
        let (k, _) = (self.people.iter().enumerate()).min_by(|a, b| away(a.1).total_cmp(&away(b.1)))?;
        self.keep_aside();
        self.people[k] = Candidate::at(place, self.people[k].prior);
        let moved = self.refiner.refine(&self.likelihood, &self.frame, &mut self.people);
        let noise = (left.misfit.min(moved.misfit) / self.frame.count).max(1.0);
        if moved.cost(noise) < left.cost(noise) - 1e-6 {
            return Some(moved);
        }
        std::mem::swap(&mut self.people, &mut self.trial);
        None
    }

    fn keep_aside(&mut self) {
        self.trial.clear();
        self.trial.extend_from_slice(&self.people);
    }
}

fn near_in(place: Place, by: f64) -> impl Fn(&Candidate) -> bool {
    move |person| distance(person.place, place) < by
}

fn distance(a: Place, b: Place) -> f64 {
    let (a, b) = (a.point(), b.point());
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// A prediction in polar coordinates; none if its covariance has no inverse.
fn prior(prediction: &Prediction) -> Option<Prior> {
    let [[xx, xy], [yx, yy]] = prediction.covariance;
    let place = Place::from_point(prediction.position);
    let jacobian = place.jacobian();
    let information = jacobian.transpose() * Matrix2::new(xx, xy, yx, yy).try_inverse()? * jacobian;
    (jacobian.iter().chain(&information).all(|v| v.is_finite()) && place.log_range > -3.0)
        .then_some(Prior { place, information })
}

/// What a frame alone says about a person: with the prior that led there taken out again.
fn detection(doorway: &Doorway, person: &Candidate, sluggish: f64) -> Option<Detection> {
    // However little a frame tells, it is not nothing: whoever was found is within some metres.
    let information = person.information + Matrix2::identity() * 0.1;
    let covariance = information.try_inverse().filter(|c| c[(0, 0)] > 0.0 && c.determinant() > 0.0)?;
    let pull = person.prior.map_or_else(Default::default, |p| p.information * person.place.minus(p.place));
    let jacobian = person.place.jacobian();
    let offset = jacobian * covariance * pull;
    let [x, y] = person.place.point();
    let errors = model_error(doorway, [x, y]) * sluggish;
    let all = jacobian * covariance * jacobian.transpose() + errors;
    let covariance: Covariance = [[all[(0, 0)], all[(0, 1)]], [all[(0, 1)], all[(1, 1)]]];
    let rgb = [0, 1, 2].map(|c| 0.5 * (person.radiance[0][c] + person.radiance[1][c]));
    let position = [x + offset[0], y + offset[1]];
    Some(Detection { position, covariance, rgb, significance: person.significance })
}

/// Covariance of a place whose angles at both edges are off by [`ANGLE_ERROR`], independently.
fn model_error(doorway: &Doorway, [x, y]: Point) -> Matrix2<f64> {
    let half = doorway.half_width();
    // ∂(α1, α2) / ∂(x, y).
    let (r1, r2) = ((x + half).powi(2) + y * y, (half - x).powi(2) + y * y);
    let angles = Matrix2::new(-y / r1, (x + half) / r1, y / r2, (half - x) / r2);
    let places = angles.try_inverse().unwrap_or_else(Matrix2::identity);
    places * places.transpose() * ANGLE_ERROR.powi(2)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::geometry::Biangular;

    proptest! {
        #[test]
        fn a_model_error_is_that_of_angles(x in -1.5..1.5f64, y in 0.5..3.0f64, w in 0.4..1.0f64) {
            let door = Doorway { width_m: w, wall_thickness_m: 0.0, height_m: None };
            let Biangular { alpha1, alpha2 } = Biangular::from_point(&door, [x, y]);
            let moved = |a: f64, b: f64| Biangular { alpha1: alpha1 + a, alpha2: alpha2 + b }.to_point(&door);
            let h = 1e-6;
            let columns = [(h, 0.0), (0.0, h)].map(|(a, b)| {
                let [px, py] = moved(a, b);
                [(px - x) / h, (py - y) / h]
            });
            let error = model_error(&door, [x, y]);
            for (i, j) in [(0, 0), (0, 1), (1, 1)] {
                let literal = ANGLE_ERROR.powi(2) * columns.iter().map(|c| c[i] * c[j]).sum::<f64>();
                prop_assert!((error[(i, j)] - literal).abs() < 1e-3 * error.trace(), "{literal} {error}");
            }
        }
    }
}
