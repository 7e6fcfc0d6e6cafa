use nalgebra::Matrix2;

use super::model_error::model_error;
use super::place::Place;
use super::refine::{Candidate, Left, Prior, Refiner};
use super::{Likelihood, MOST_PEOPLE, Measured};
use crate::geometry::{Doorway, Point, Side};
use crate::light::PatchPair;
use crate::tracking::{Covariance, Detection, Prediction};

/// Least evidence (twice a log likelihood ratio) for a person who was not expected.
const NEW: f64 = 32.0;
/// Least significance of a new person relative to that of each other person. Less may be the other's shadow or
/// reflected light, which the model does not contain.
const SHARE: f64 = 0.1;
/// The same in a room with lamps or windows that the floor sees: there a person's shadow and what is not quite right in
/// the picture of the room explain more.
const SHARE_WHEN_BRIGHT: f64 = 0.3;
/// Least contrast of a person with what is behind, relative to the floor's level. Fainter candidates that still show
/// are noise near the door.
const LEAST_CONTRAST: f64 = 0.1;
/// Least significance at each edge by itself, unless the door's leaf hides the place from it. What only one of two edges
/// shows may be anything along a line.
const EACH_EDGE: f64 = 12.0;
/// Share of the last three limits that an expected person must reach.
const KEPT: f64 = 0.9;
/// Least evidence for somebody who is known to be there, and the share of the last three limits.
const KNOWN: f64 = -24.0;
const KNOWN_KEPT: f64 = 0.2;
/// Most seeds that are tried, strongest first.
const TRIED: usize = 3;
/// Largest difference in azimuth, in radians, at which a seed may be a person already found, at another distance.
/// Distance is the least certain coordinate.
const ALONG: f64 = 0.5;
/// Where else somebody is tried whom only one edge sees, as multiples of their distance from it.
const OTHER_RANGES: [f64; 2] = [1.3, 0.77];
/// How long the errors of the model of a body and its room stay the same, in seconds.
const ERROR_LASTS_S: f64 = 0.8;

/// Finds people in successive frames.
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
    /// A finder for people with the given radius, in metres.
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

    /// Finds the people in a difference, `elapsed_s` seconds after the previous frame: those of the `expected` people
    /// who are still there, and people at those of the `seeds` that nobody else explains. Seeds are the centres of what
    /// the map shows, in metres in the door frame, strongest first. Detections come with the most significant first.
    pub fn find(
        &mut self,
        difference: &PatchPair,
        expected: impl Iterator<Item = Prediction>,
        seeds: &[Point],
        elapsed_s: f64,
    ) -> &[Detection] {
        self.find_with(difference, [1.0; 2], expected, seeds, elapsed_s)
    }

    /// Like [`Self::find`], in a frame whose patches have only a share `trust` of their usual information (left, right):
    /// less than 1 if a part is covered or noisier than usual, 0 if a patch says nothing. Nobody new is found with one
    /// patch alone.
    pub fn find_with(
        &mut self,
        difference: &PatchPair,
        trust: [f64; 2],
        expected: impl Iterator<Item = Prediction>,
        seeds: &[Point],
        elapsed_s: f64,
    ) -> &[Detection] {
        self.likelihood.measure(difference, &mut self.frame);
        self.frame.trust(trust);
        self.people.clear();
        for prediction in expected.take(MOST_PEOPLE) {
            self.people.extend(prior(&prediction).map(|prior| Candidate::at(prior.place, Some(prior))));
        }
        let mut left = self.refiner.refine(&self.likelihood, &self.frame, &mut self.people);
        left = self.prune(left);
        let tried = if self.frame.shows_both() { TRIED } else { 0 };
        for &seed in seeds.iter().take(tried) {
            left = self.consider(Place::from_point(seed), left);
            for place in self.other_ranges(seed).into_iter().flatten() {
                left = self.move_somebody(place, left).unwrap_or(left);
            }
        }
        let sluggish = (ERROR_LASTS_S / elapsed_s.max(1e-3)).max(1.0);
        let unexplained = left.misfit / self.frame.count;
        self.found.clear();
        let Self { found, people, doorway, likelihood, .. } = self;
        found.extend(people.iter().filter_map(|person| {
            let (point, sees) = (person.place.point(), likelihood.sees(person.place));
            let errors = model_error(doorway, point, sees, likelihood.bright, unexplained);
            detection(person, errors * sluggish)
        }));
        found.sort_by(|a, b| b.significance.total_cmp(&a.significance));
        &self.found
    }

    /// Places in the same direction, if the leaf hides a place from one edge: the map does not know how far away somebody
    /// is who is seen past the other edge only, and their outline fits at several ranges.
    fn other_ranges(&self, at: Point) -> [Option<Place>; 2] {
        let edge = match self.likelihood.sees(Place::from_point(at)) {
            [true, false] => self.doorway.edge(Side::Left),
            [false, true] => self.doorway.edge(Side::Right),
            _ => return [None; 2],
        };
        OTHER_RANGES.map(|factor| Some(Place::from_point([0, 1].map(|k| edge[k] + factor * (at[k] - edge[k])))))
    }

    /// Drops people who are not credible, one at a time.
    fn prune(&mut self, mut left: Left) -> Left {
        loop {
            let known = |k: usize| self.people[k].prior.is_some_and(|prior| prior.known);
            let doubtful = |k: &usize| {
                if known(*k) { !self.is_credible(*k, KNOWN, KNOWN_KEPT) } else { !self.is_credible(*k, 0.0, KEPT) }
            };
            let weakest = (0..self.people.len())
                .filter(doubtful)
                .min_by(|&a, &b| self.people[a].evidence.total_cmp(&self.people[b].evidence));
            let Some(k) = weakest.or_else(|| self.crowded()) else { return left };
            self.people.remove(k);
            left = self.refiner.refine(&self.likelihood, &self.frame, &mut self.people);
        }
    }

    /// Whether somebody is there, rather than noise or an effect of another person: evidence of at least `least`, and
    /// contrast and significance of at least `strict` times the limits for a new person.
    fn is_credible(&self, k: usize, least: f64, strict: f64) -> bool {
        let person = &self.people[k];
        let contrast =
            (0..3).map(|c| (0.5 * (person.radiance[0][c] + person.radiance[1][c])).powi(2)).sum::<f64>() / 3.0;
        let least_contrast = strict * LEAST_CONTRAST * self.likelihood.level;
        let share = if self.likelihood.bright { SHARE_WHEN_BRIGHT } else { SHARE };
        let explained = |other: &Candidate| person.significance < strict * share * other.significance;
        let in_wall = {
            let [x, y] = person.place.point();
            y < 0.5 * self.body_radius_m && x.abs() > self.doorway.half_width()
        };
        !in_wall
            && person.evidence >= least
            && self.each_edge(person) >= strict * EACH_EDGE * f64::from(u8::from(self.frame.shows_both()))
            && contrast >= least_contrast * least_contrast
            && !self.people.iter().any(explained)
    }

    /// The significance at that edge which shows somebody least, among those that the leaf does not hide them from. Nobody
    /// whom it hides from both is found.
    fn each_edge(&self, person: &Candidate) -> f64 {
        match self.likelihood.sees(person.place) {
            [true, false] => person.by_edge[0],
            [false, true] => person.by_edge[1],
            _ => person.by_edge[0].min(person.by_edge[1]),
        }
    }

    /// The less significant of two people who would overlap.
    fn crowded(&self) -> Option<usize> {
        let people = &self.people;
        let touch = |i: usize, j: usize| distance(people[i].place, people[j].place) < 1.5 * self.body_radius_m;
        let pairs = (0..people.len()).flat_map(|i| (0..i).map(move |j| (i, j)));
        let (i, j) = pairs.into_iter().find(|&(i, j)| touch(i, j))?;
        Some(if people[i].significance < people[j].significance { i } else { j })
    }

    /// Tries whether somebody at a place explains the measurement better: a person found elsewhere, or else one more
    /// person.
    fn consider(&mut self, place: Place, left: Left) -> Left {
        // Bodies side by side are at least this far apart; closer seeds belong to the same body.
        let touching = 2.2 * self.body_radius_m;
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
        if !self.is_credible(self.people.len() - 1, NEW, 1.0) || self.crowded().is_some() {
            std::mem::swap(&mut self.people, &mut self.trial);
            return left;
        }
        self.prune(with)
    }

    /// Moves the person nearest in azimuth to a place if they explain more there than where they are now.
    fn move_somebody(&mut self, place: Place, left: Left) -> Option<Left> {
        let away = |person: &Candidate| (person.place.azimuth - place.azimuth).abs();
        let nearest = (self.people.iter().enumerate()).min_by(|a, b| away(a.1).total_cmp(&away(b.1)));
        let (k, _) = nearest.filter(|(_, person)| away(person) < ALONG)?;
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

/// A prediction in polar coordinates; `None` if its covariance is singular or it is too close to the doorway.
fn prior(prediction: &Prediction) -> Option<Prior> {
    let [[xx, xy], [yx, yy]] = prediction.covariance;
    let place = Place::from_point(prediction.position);
    let jacobian = place.jacobian();
    let information = jacobian.transpose() * Matrix2::new(xx, xy, yx, yy).try_inverse()? * jacobian;
    (jacobian.iter().chain(&information).all(|v| v.is_finite()) && place.log_range > -3.0).then_some(Prior {
        place,
        information,
        known: prediction.known,
    })
}

/// The detection that the frame alone supports: the prior with which the person was found is removed again. The model
/// has errors of its own, whose covariance is added.
fn detection(person: &Candidate, errors: Matrix2<f64>) -> Option<Detection> {
    // Keeps the uncertainty to some metres, however little the frame tells.
    let information = person.information + Matrix2::identity() * 0.1;
    let covariance = information.try_inverse().filter(|c| c[(0, 0)] > 0.0 && c.determinant() > 0.0)?;
    let pull = person.prior.map_or_else(Default::default, |p| p.information * person.place.minus(p.place));
    let jacobian = person.place.jacobian();
    let offset = jacobian * covariance * pull;
    let [x, y] = person.place.point();
    let all = jacobian * covariance * jacobian.transpose() + errors;
    let covariance: Covariance = [[all[(0, 0)], all[(0, 1)]], [all[(0, 1)], all[(1, 1)]]];
    let rgb = [0, 1, 2].map(|c| 0.5 * (person.radiance[0][c] + person.radiance[1][c]));
    let position = [x + offset[0], y + offset[1]];
    Some(Detection { position, covariance, rgb, significance: person.significance })
}
