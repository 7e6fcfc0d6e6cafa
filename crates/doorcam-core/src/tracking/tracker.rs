use super::association::Association;
use super::filter::is_covariance;
use super::motion::Motion;
use super::person::Person;
use super::{Covariance, Detection, Track, TrackState};
use crate::geometry::{Point, Room};
use crate::scene::Rgb;

/// Squared Mahalanobis distance below which two estimates of a place may be of the same body: the 99 % quantile of
/// chi-square with 2 degrees of freedom.
const SAME_PLACE: f64 = 9.2103;

/// Largest difference in log likelihood between two people at which a detection may be of both.
const MEETING: f64 = 3.0;

/// Settings of a [`Tracker`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackerSettings {
    /// The part of the hidden side where people are.
    pub room: Room,
    /// How far outside the room people may also be, in metres.
    pub margin_m: f64,
    /// Radius of a person, in metres. No two people are closer than twice this.
    pub body_radius_m: f64,
    /// How long a person must be seen to be confirmed, in seconds.
    pub confirm_s: f64,
    /// How long a confirmed person is followed without being seen, in seconds; above 0. Shorter for somebody only just
    /// confirmed.
    pub coast_s: f64,
    /// Most people confirmed at once, and most people not yet confirmed.
    pub max_people: usize,
}

impl TrackerSettings {
    /// Whether a person can be at `point` (m, door frame).
    pub fn holds(&self, point: Point) -> bool {
        self.holds_within(point, 0.0)
    }

    /// Like [`Self::holds`], with a margin that is `more_m` metres wider.
    pub fn holds_within(&self, [x, y]: Point, more_m: f64) -> bool {
        let margin_m = self.margin_m + more_m;
        x.abs() <= self.room.half_width_m + margin_m && (-margin_m..=self.room.depth_m + margin_m).contains(&y)
    }
}

/// Where somebody is expected to be seen next.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prediction {
    /// Id of the track.
    pub id: u64,
    /// How sure the track is.
    pub state: TrackState,
    /// Expected position, in metres in the door frame.
    pub position: Point,
    /// Covariance of the position, in m².
    pub covariance: Covariance,
    /// Whether they were seen to come in, and not to leave: then they are there, however faint.
    pub known: bool,
    /// Radiance relative to what is behind the body, as a share of full scale, averaged over the last seconds.
    pub rgb: Rgb,
}

/// Tracks people from detections: a Kalman filter per person, one global assignment of detections to people per frame,
/// and a score (log likelihood ratio) that somebody is there. docs/tracking.md has the equations.
///
/// Everything depends on the times of the frames, not on their number, and is deterministic. Once the largest number of
/// people and detections has been reached, a step allocates nothing unless two people want the same detection.
#[derive(Debug, Clone)]
pub struct Tracker {
    settings: TrackerSettings,
    people: Vec<Person>,
    tracks: Vec<Track>,
    unseen_s: Vec<f64>,
    association: Association,
    next_id: u64,
    /// Time of the last frame, as given.
    seconds: Option<f64>,
    /// The tracker's clock: seconds that have passed, whatever the frames' clock did.
    now_s: f64,
}

impl Tracker {
    /// A tracker that follows nobody yet.
    pub fn new(settings: TrackerSettings) -> Self {
        Self {
            settings,
            people: Vec::with_capacity(2 * settings.max_people + 1),
            tracks: Vec::with_capacity(2 * settings.max_people + 1),
            unseen_s: Vec::with_capacity(2 * settings.max_people + 1),
            association: Association::default(),
            next_id: 1,
            seconds: None,
            now_s: 0.0,
        }
    }

    /// The tracks after the last frame, oldest first.
    pub fn tracks(&self) -> &[Track] {
        &self.tracks
    }

    /// For each of [`Tracker::tracks`], the seconds since the last detection.
    pub fn unseen_s(&self) -> &[f64] {
        &self.unseen_s
    }

    /// Time of the last frame, in seconds; `None` before the first one.
    pub fn seconds(&self) -> Option<f64> {
        self.seconds
    }

    /// Drops all tracks. Ids are not reused.
    pub fn reset(&mut self) {
        self.people.clear();
        self.seconds = None;
        self.report();
    }

    /// Replaces another tracker: its ids are not reused.
    pub fn continue_from(&mut self, other: &Self) {
        self.next_id = self.next_id.max(other.next_id);
    }

    /// Assigns no ids below `next`.
    pub fn counting_from(mut self, next: u64) -> Self {
        self.next_id = self.next_id.max(next);
        self
    }

    /// Where tracked people are expected at a frame's time, in seconds.
    pub fn predictions(&self, seconds: f64) -> impl Iterator<Item = Prediction> + '_ {
        let elapsed = self.elapsed(seconds).unwrap_or(0.0);
        self.people.iter().zip(&self.tracks).map(move |(person, track)| {
            let mut filter = person.filter;
            filter.predict(elapsed, &Motion::WALKING);
            Prediction {
                id: person.id,
                state: track.state,
                position: filter.position(),
                covariance: filter.position_covariance(),
                known: person.is_known(),
                rgb: track.rgb,
            }
        })
    }

    /// Processes the detections of a frame. Detections that are not finite or have no valid covariance are ignored.
    ///
    /// A frame that is not later than the last one counts as simultaneous with it. All tracks end at a gap, or a jump
    /// back in time, of more than `coast_s`.
    pub fn step(&mut self, seconds: f64, detections: &[Detection]) {
        self.step_with(seconds, detections, true);
    }

    /// Like [`Self::step`]; without `newcomers`, nobody new is followed, and who is not confirmed yet is dropped. That is
    /// for frames in which something else than the room may look like people.
    pub fn step_with(&mut self, seconds: f64, detections: &[Detection], newcomers: bool) {
        let elapsed = self.elapsed(seconds).unwrap_or_else(|| {
            self.people.clear();
            0.0
        });
        if seconds.is_finite() {
            self.seconds = Some(seconds);
        }
        self.now_s += elapsed;
        for person in &mut self.people {
            person.filter.predict(elapsed, &Motion::WALKING);
        }
        self.associate(detections);
        self.update(elapsed, detections);
        if newcomers {
            self.begin(detections);
        } else {
            self.people.retain(|person| person.confirmed);
        }
        self.confirm();
        self.report();
    }

    /// Follows somebody who is known to be there, such as one who was seen to come in, from now on: confirmed, with
    /// position (m) and velocity (m/s) in the door frame. Returns their id.
    pub fn admit(&mut self, position: Point, velocity: [f64; 2], covariance: &Covariance) -> u64 {
        let id = self.number();
        self.people.push(Person::admitted(id, position, velocity, covariance, self.now_s));
        self.report();
        id
    }

    /// Stops following somebody who was seen to leave.
    pub fn dismiss(&mut self, id: u64) {
        self.people.retain(|person| person.id != id);
        self.report();
    }

    /// Takes it for possible that those who were seen to come in are no longer there.
    pub fn doubt_all(&mut self) {
        self.people.iter_mut().for_each(Person::doubt);
    }

    /// Like [`Self::doubt_all`], for one of them.
    pub fn doubt(&mut self, id: u64) {
        self.people.iter_mut().filter(|person| person.id == id).for_each(Person::doubt);
    }

    /// A number for somebody who is not followed; it is not used again.
    pub fn number(&mut self) -> u64 {
        self.next_id += 1;
        self.next_id - 1
    }

    /// Seconds from the last frame to one at that time; `None` if they are too far apart.
    fn elapsed(&self, seconds: f64) -> Option<f64> {
        let elapsed = seconds - self.seconds.unwrap_or(seconds);
        // A frame whose time is not finite counts as simultaneous with the last one.
        (!elapsed.is_finite() || elapsed.abs() <= self.settings.coast_s + 1e-6)
            .then_some(if elapsed > 0.0 && elapsed.is_finite() { elapsed } else { 0.0 })
    }

    fn associate(&mut self, detections: &[Detection]) {
        self.association.clear(self.people.len(), detections.len());
        for (i, person) in self.people.iter().enumerate() {
            for (j, detection) in detections.iter().enumerate().filter(|(_, d)| is_usable(d)) {
                if let Some(gain) = person.gain(detection) {
                    self.association.set(i, j, gain);
                }
            }
        }
        self.association.solve();
    }

    fn update(&mut self, elapsed: f64, detections: &[Detection]) {
        for i in 0..self.people.len() {
            // A detection shared by two people is evidence for only one of them, the one who was seen last. Otherwise
            // the two would keep each other alive.
            if let Some((_, k)) = self.meeting(i, elapsed)
                && self.people[k].unseen_s(self.now_s) < self.people[i].unseen_s(self.now_s)
            {
                self.association.hand_over(i, k);
            }
        }
        for i in 0..self.people.len() {
            let met = self.meeting(i, elapsed);
            let Self { people, association, settings, now_s, .. } = self;
            match (association.partners()[i], met) {
                (None, _) => people[i].miss(elapsed, settings),
                (Some(j), None) => people[i].see(&detections[j], None, elapsed, *now_s),
                (Some(j), Some((_, k))) => {
                    let (mine, others) = (people[i].filter, people[k].filter);
                    people[i].see(&detections[j], Some(&others), elapsed, *now_s);
                    people[k].meet(&detections[j], &mine, elapsed, *now_s);
                }
            }
        }
        let Self { people, settings, now_s, .. } = self;
        people.retain(|person| !person.is_over(*now_s, settings));
    }

    /// The person's detection and another person who may share it: among those without a detection who were noticed a
    /// moment ago, the one it fits best, if it fits nearly as well.
    fn meeting(&self, i: usize, elapsed: f64) -> Option<(usize, usize)> {
        let Self { people, association, now_s, .. } = self;
        let partners = association.partners();
        let j = partners[i]?;
        let gain = |k: usize| association.gain(k, j);
        let other = (0..people.len())
            .filter(|&k| partners[k].is_none() && people[k].may_meet(elapsed, *now_s))
            .filter(|&k| gain(k) > (gain(i) - MEETING).max(0.0))
            .reduce(|a, b| if gain(b) > gain(a) { b } else { a })?;
        people[i].confirmed.then_some((j, other))
    }

    /// Starts tracks for detections inside the room that belong to nobody tracked so far.
    fn begin(&mut self, detections: &[Detection]) {
        for (j, detection) in detections.iter().enumerate() {
            if self.association.is_taken(j) || !is_usable(detection) || !self.settings.holds(detection.position) {
                continue;
            }
            let tentative = self.people.iter().filter(|p| !p.confirmed).count();
            let beside = |person: &Person| self.touch(person.filter.position(), detection.position);
            if tentative >= self.settings.max_people || self.people.iter().any(beside) {
                continue;
            }
            let doubtful = self.people.iter().any(|person| {
                let fit = person.filter.fit(detection.position, &detection.covariance);
                person.confirmed && fit.is_some_and(|fit| fit.distance2 < SAME_PLACE)
            });
            self.people.push(Person::new(self.next_id, detection, doubtful, self.now_s));
            self.next_id += 1;
        }
    }

    /// Confirms people with enough evidence, and drops unconfirmed people who overlap a confirmed one.
    fn confirm(&mut self) {
        let mut confirmed = self.people.iter().filter(|p| p.confirmed).count();
        for i in 0..self.people.len() {
            let person = &self.people[i];
            if !person.confirmed && confirmed < self.settings.max_people && person.is_evident(&self.settings) {
                self.people[i].confirmed = true;
                confirmed += 1;
            }
        }
        let mut i = 0;
        while i < self.people.len() {
            let Person { filter, confirmed, .. } = &self.people[i];
            let another = |(k, other): (usize, &Person)| {
                k != i && other.confirmed && self.touch(filter.position(), other.filter.position())
            };
            if !confirmed && self.people.iter().enumerate().any(another) {
                self.people.remove(i);
            } else {
                i += 1;
            }
        }
    }

    /// Whether bodies at these places would overlap.
    fn touch(&self, a: Point, b: Point) -> bool {
        (a[0] - b[0]).hypot(a[1] - b[1]) < 2.0 * self.settings.body_radius_m
    }

    fn report(&mut self) {
        self.tracks.clear();
        self.unseen_s.clear();
        for person in &self.people {
            self.tracks.push(person.track(self.now_s));
            self.unseen_s.push(person.unseen_s(self.now_s));
        }
    }
}

fn is_usable(detection: &Detection) -> bool {
    detection.position.iter().all(|v| v.is_finite()) && is_covariance(&detection.covariance)
}
