use std::collections::VecDeque;

use super::Sighting;
use crate::geometry::{Doorway, Point};
use crate::tracking::{Direction, Filter, Motion};

/// A sighting belongs to a walker whose expected place is at most this far away, in metres.
const GATE_M: f64 = 0.9;
/// Somebody unseen for this long, in seconds, has left the picture.
const GONE_S: f64 = 0.7;
/// Sightings after which a walker counts.
const FEWEST: usize = 3;
/// Sightings that are kept: seconds at any rate at which the picture is looked at.
const KEPT: usize = 48;
/// How far beyond y = 0 somebody must be seen to have crossed it, in metres.
const BEYOND_M: f64 = 0.04;
/// How near to the wall's visible face somebody has come to the threshold, in metres.
const THRESHOLD_M: f64 = 0.12;
/// How far from their nearest point somebody has turned around, in metres.
const BACK_M: f64 = 0.3;
/// Sightings this long before and after a crossing tell its time, in seconds.
const AROUND_S: f64 = 0.7;
/// Two people do not turn around at one place within so many metres and seconds: there is no room for both.
const ONE_PLACE_M: f64 = 0.4;
const ONE_PLACE_S: f64 = 0.6;
/// Speeds of people who walk, in m/s.
const SPEED_M_S: std::ops::RangeInclusive<f64> = 0.1..=3.0;
/// Most walkers at once.
const MOST: usize = 6;

/// Somebody who went through the doorway, or turned around on its threshold.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Crossing {
    /// Number of the walker.
    pub walker: u64,
    /// Which way.
    pub direction: Direction,
    /// When the body's axis passed y = 0, or was nearest to it, in seconds on the pictures' clock.
    pub seconds: f64,
    /// Where along the threshold, x in metres.
    pub x_m: f64,
    /// Speed across the threshold, in m/s.
    pub speed_m_s: f64,
}

/// Somebody in the picture.
#[derive(Debug, Clone)]
pub struct Walker {
    /// Number, in the order of their coming into the picture.
    pub id: u64,
    filter: Filter,
    sightings: VecDeque<(f64, Point)>,
    seen: usize,
    last_s: f64,
    newest: Option<Sighting>,
    /// Whether they came, or last crossed, from the hidden side.
    hidden: bool,
    /// The place nearest to y = 0 since then, and when.
    nearest: Option<(f64, Point)>,
    /// Whether they may turn around: who has just crossed has to go away first.
    approaching: bool,
}

impl Walker {
    /// Whether they have been seen often enough to be somebody.
    pub fn is_somebody(&self) -> bool {
        self.seen >= FEWEST
    }

    /// Whether they came from the hidden room, or have gone into it.
    pub fn is_of_the_room(&self) -> bool {
        self.hidden
    }

    /// Expected place, in metres in the door frame.
    pub fn position(&self) -> Point {
        self.filter.position()
    }

    /// Velocity, in m/s.
    pub fn velocity(&self) -> [f64; 2] {
        self.filter.velocity()
    }

    /// Where the newest picture shows them; none if it does not.
    pub fn sighting(&self) -> Option<Sighting> {
        self.newest
    }
}

/// Follows who is seen at the threshold, and tells who crosses it.
#[derive(Debug, Clone)]
pub struct Walkers {
    half_width_m: f64,
    face_m: f64,
    all: Vec<Walker>,
    next: u64,
    last_s: Option<f64>,
    crossings: Vec<Crossing>,
    /// The last one who turned around.
    turned: Option<Crossing>,
}

impl Walkers {
    /// Nobody yet.
    pub fn new(doorway: &Doorway) -> Self {
        Self {
            half_width_m: doorway.half_width(),
            face_m: -doorway.wall_thickness_m,
            all: Vec::with_capacity(MOST),
            next: 0,
            last_s: None,
            crossings: Vec::with_capacity(MOST),
            turned: None,
        }
    }

    /// Who is in the picture.
    pub fn all(&self) -> &[Walker] {
        &self.all
    }

    /// Processes what a picture shows; `seconds` is its time. Returns the crossings that have become certain.
    pub fn step(&mut self, seconds: f64, sightings: &[Sighting]) -> &[Crossing] {
        self.crossings.clear();
        let elapsed = seconds - self.last_s.replace(seconds).unwrap_or(seconds);
        if !(0.0..=2.0 * GONE_S).contains(&elapsed) {
            self.all.clear();
        }
        for walker in &mut self.all {
            walker.filter.predict(elapsed.max(0.0), &Motion::WALKING);
            walker.newest = None;
        }
        for sighting in sightings {
            let [x, y] = sighting.position;
            let away = |walker: &Walker| (walker.position()[0] - x).hypot(walker.position()[1] - y);
            let free = |k: &usize| self.all[*k].newest.is_none() && away(&self.all[*k]) < GATE_M;
            let nearest = (0..self.all.len()).filter(free);
            match nearest.min_by(|&a, &b| away(&self.all[a]).total_cmp(&away(&self.all[b]))) {
                Some(k) => self.all[k].see(seconds, sighting),
                None if self.all.len() < MOST => self.begin(seconds, sighting),
                None => {}
            }
        }
        let Self { all, crossings, half_width_m, face_m, turned, .. } = self;
        for walker in all.iter_mut().filter(|walker| walker.is_somebody()) {
            let gone = seconds - walker.last_s > GONE_S;
            let Some(crossing) = walker.crossing(*half_width_m, *face_m, gone) else { continue };
            if crossing.direction == Direction::Back {
                // A body that was taken for two for a moment has turned around once.
                let again = turned.is_some_and(|last| {
                    (crossing.seconds - last.seconds).abs() < ONE_PLACE_S
                        && (crossing.x_m - last.x_m).abs() < ONE_PLACE_M
                });
                *turned = Some(crossing);
                if again {
                    continue;
                }
            }
            crossings.push(crossing);
        }
        all.retain(|walker| seconds - walker.last_s <= GONE_S);
        &self.crossings
    }

    fn begin(&mut self, seconds: f64, sighting: &Sighting) {
        let filter = Filter::at(sighting.position, &sighting.covariance, &Motion::WALKING);
        let mut walker = Walker {
            id: self.next,
            filter,
            sightings: VecDeque::with_capacity(KEPT),
            seen: 0,
            last_s: seconds,
            newest: None,
            hidden: sighting.position[1] > self.face_m + 0.5 * THRESHOLD_M,
            nearest: None,
            approaching: true,
        };
        walker.see(seconds, sighting);
        self.next += 1;
        self.all.push(walker);
    }
}

impl Walker {
    fn see(&mut self, seconds: f64, sighting: &Sighting) {
        self.filter.update(sighting.position, &sighting.covariance);
        if self.sightings.len() == KEPT {
            self.sightings.pop_front();
        }
        self.sightings.push_back((seconds, sighting.position));
        self.seen += 1;
        self.last_s = seconds;
        self.newest = Some(*sighting);
        let nearer = |(_, place): &(f64, Point)| self.filter.position()[1].abs() < place[1].abs();
        if self.nearest.as_ref().is_none_or(nearer) {
            self.nearest = Some((seconds, self.filter.position()));
        }
    }

    /// A crossing that is certain by now. `gone`: they are no longer in the picture.
    fn crossing(&mut self, half_width_m: f64, face_m: f64, gone: bool) -> Option<Crossing> {
        let [x, y] = self.position();
        let [_, vy] = self.velocity();
        let inward = if self.hidden { -1.0 } else { 1.0 };
        // The visible side ends at the wall's face, but the picture shows little of what is behind it.
        let beyond = inward * y > BEYOND_M || (gone && inward * y > -BEYOND_M && inward * vy > 0.2);
        if beyond && x.abs() < half_width_m + 0.2 {
            let direction = if self.hidden { Direction::Out } else { Direction::In };
            let crossing = self.passage(direction);
            self.hidden = !self.hidden;
            self.nearest = None;
            self.approaching = false;
            return crossing;
        }
        if !self.approaching {
            self.approaching = -inward * y > BACK_M;
            self.nearest = None;
            return None;
        }
        let (seconds, place) = self.nearest?;
        let near = place[0].abs() < half_width_m + 0.1 && inward * place[1] > -near_m(self.hidden, face_m);
        let turned = inward * (place[1] - y) > BACK_M || (gone && inward * vy < 0.0);
        if near && turned {
            self.nearest = None;
            let speed_m_s = self.velocity()[1].abs();
            return Some(Crossing { walker: self.id, direction: Direction::Back, seconds, x_m: place[0], speed_m_s });
        }
        None
    }

    /// When and how fast the axis passed y = 0: a straight line through the sightings around it.
    fn passage(&self, direction: Direction) -> Option<Crossing> {
        let signed = if direction == Direction::In { 1.0 } else { -1.0 };
        let first = self.sightings.iter().rposition(|(_, [_, y])| signed * y < 0.0);
        let (near_s, _) = *self.sightings.get(first.unwrap_or(0))?;
        let around = || self.sightings.iter().filter(|(t, _)| (t - near_s).abs() <= AROUND_S);
        let count = around().count() as f64;
        let mean = |value: fn(&(f64, Point)) -> f64| around().map(value).sum::<f64>() / count;
        let (t0, x0, y0) = (mean(|s| s.0), mean(|s| s.1[0]), mean(|s| s.1[1]));
        let spread: f64 = around().map(|s| (s.0 - t0).powi(2)).sum();
        let slope = around().map(|s| (s.0 - t0) * (s.1[1] - y0)).sum::<f64>() / spread.max(1e-9);
        let straight = spread > 1e-6 && SPEED_M_S.contains(&(signed * slope));
        let seconds = if straight { (t0 - y0 / slope).clamp(near_s - AROUND_S, near_s + AROUND_S) } else { near_s };
        let speed_m_s = if straight { slope.abs() } else { self.velocity()[1].abs() };
        Some(Crossing { walker: self.id, direction, seconds, x_m: x0, speed_m_s })
    }
}

/// How far from y = 0 somebody is at the threshold who came from the hidden side, or from the visible one, in metres.
fn near_m(hidden: bool, face_m: f64) -> f64 {
    if hidden { 0.05 } else { THRESHOLD_M - face_m }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DOORWAY: Doorway = Doorway { width_m: 0.9, wall_thickness_m: 0.12, height_m: None, leaf: None };

    /// What is told of somebody on this path, in steps of 0.2 s, who is seen while y is between −1.2 and 0.3.
    fn told(path: impl Fn(f64) -> Point) -> Vec<(Direction, f64)> {
        let mut walkers = Walkers::new(&DOORWAY);
        let mut all = Vec::new();
        for k in 0..60 {
            let t = 0.2 * f64::from(k);
            let position = path(t);
            let seen = (-1.2..0.3).contains(&position[1]);
            let sighting = Sighting { position, covariance: [[0.01, 0.0], [0.0, 0.01]], cells: 200 };
            let crossings = walkers.step(t, if seen { std::slice::from_ref(&sighting) } else { &[] });
            all.extend(crossings.iter().map(|c| (c.direction, c.seconds)));
        }
        all
    }

    #[test]
    fn who_walks_through_is_told_once_with_direction_and_time() {
        for speed in [0.4, 0.8, 1.4] {
            let crossing_s = 2.0 / speed;
            let walk_in = told(|t| [0.1, -2.0 + speed * t]);
            assert!(walk_in.len() == 1 && walk_in[0].0 == Direction::In, "{speed}: {walk_in:?}");
            assert!((walk_in[0].1 - crossing_s).abs() < 0.15, "{speed}: {walk_in:?}");
            let walk_out = told(|t| [0.1, 2.0 - speed * t]);
            assert!(walk_out.len() == 1 && walk_out[0].0 == Direction::Out, "{speed}: {walk_out:?}");
            assert!((walk_out[0].1 - crossing_s).abs() < 0.2, "{speed}: {walk_out:?}");
        }
    }

    #[test]
    fn who_turns_around_on_the_threshold_has_been_there_and_who_passes_has_not() {
        let turned = told(|t| [0.0, -0.08 - 0.7 * (t - 4.0).abs()]);
        assert!(turned.len() == 1 && turned[0].0 == Direction::Back, "{turned:?}");
        assert!((turned[0].1 - 4.0).abs() < 0.4, "{turned:?}");
        for distance in [0.3, 0.8, 1.0] {
            let passed = told(|t| [-3.0 + 0.9 * t, -0.12 - distance]);
            assert_eq!(passed, [], "{distance}");
        }
        assert_eq!(told(|t| [0.9 * t - 3.0, 1.5]), []);
    }

    #[test]
    fn who_comes_in_and_goes_out_again_is_told_twice() {
        let both = told(|t| [0.0, 1.0 - 0.7 * (t - 5.0).abs()]);
        let directions: Vec<_> = both.iter().map(|c| c.0).collect();
        assert_eq!(directions, [Direction::In, Direction::Out]);
    }

    #[test]
    fn who_is_taken_for_two_turns_around_once() {
        let mut walkers = Walkers::new(&DOORWAY);
        let mut turned = 0;
        for k in 0..60 {
            let t = 0.2 * f64::from(k);
            let y = -0.08 - 0.7 * (t - 4.0).abs();
            let sighting = |position| Sighting { position, covariance: [[0.01, 0.0], [0.0, 0.01]], cells: 200 };
            let both = [sighting([0.0, y]), sighting([0.2, y - 0.05])];
            turned += walkers.step(t, if y > -1.2 { &both } else { &[] }).len();
        }
        assert_eq!(turned, 1);
    }
}
