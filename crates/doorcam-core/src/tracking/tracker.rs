use super::association::Association;
use super::filter::is_covariance;
use super::motion::Motion;
use super::person::Person;
use super::{Covariance, Detection, Track, TrackState};
use crate::geometry::{Point, Room};
use crate::scene::Rgb;

/// Two estimates of a place may be of one body while their squared Mahalanobis distance is below this: the 99 % quantile of
/// chi-square with 2 degrees of freedom.
const SAME_PLACE: f64 = 9.2103;

/// A detection may be of two people at once while it is at most this much better (log likelihood) for the one than the other.
const MEETING: f64 = 3.0;

/// What a tracker needs to know of a room and its users' wishes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackerSettings {
    /// Where people are.
    pub room: Room,
    /// They may also be this far outside of it, in metres.
    pub margin_m: f64,
    /// A person's radius, in metres: no two are nearer than twice that.
    pub body_radius_m: f64,
    /// For how long a person must be seen to be confirmed, in seconds.
    pub confirm_s: f64,
    /// For how long a confirmed person is followed without being seen, in seconds; above 0. One who was only just confirmed:
    /// for less.
    pub coast_s: f64,
    /// Confirmed people at once at most, and as many who are not confirmed yet.
    pub max_people: usize,
}

impl TrackerSettings {
    /// Whether a person can be there.
    pub fn holds(&self, point: Point) -> bool {
        self.holds_within(point, 0.0)
    }

    /// The same with so many metres more around.
    pub fn holds_within(&self, [x, y]: Point, more_m: f64) -> bool {
        let margin_m = self.margin_m + more_m;
        x.abs() <= self.room.half_width_m + margin_m && (-margin_m..=self.room.depth_m + margin_m).contains(&y)
    }
}

/// Where somebody is expected to be seen next.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prediction {
    /// The track's.
    pub id: u64,
    /// How sure it is that there is somebody.
    pub state: TrackState,
    /// In metres in the door frame.
    pub position: Point,
    /// Covariance of the position, in m².
    pub covariance: Covariance,
    /// Radiance against what is behind, relative to full scale, averaged over the last seconds.
    pub rgb: Rgb,
}

/// Follows people through detections: a Kalman filter each, one global assignment of detections to people a frame, and a
/// score (log likelihood ratio) of somebody being there (docs/tracking.md has the equations).
///
/// All of it goes by the frames' seconds, not by their number, and depends on nothing but what it was given. Once a scene's
/// number of people and detections was reached, a step needs no memory unless two people want the same detection.
#[derive(Debug, Clone)]
pub struct Tracker {
    settings: TrackerSettings,
    people: Vec<Person>,
    tracks: Vec<Track>,
    unseen_s: Vec<f64>,
    association: Association,
    next_id: u64,
    /// The last frame's seconds, as given.
    seconds: Option<f64>,
    /// Seconds that have passed, whatever the frames' clock did.
    now_s: f64,
}

impl Tracker {
    /// Nobody is there yet.
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

    /// Whom the frames so far show, the longest known first.
    pub fn tracks(&self) -> &[Track] {
        &self.tracks
    }

    /// For each of [`Tracker::tracks`], the seconds since the last detection.
    pub fn unseen_s(&self) -> &[f64] {
        &self.unseen_s
    }

    /// The last frame's seconds; none before the first one.
    pub fn seconds(&self) -> Option<f64> {
        self.seconds
    }

    /// Forgets everybody. Ids are not used again.
    pub fn reset(&mut self) {
        self.people.clear();
        self.seconds = None;
        self.report();
    }

    /// Takes the place of another tracker: its ids are not used again.
    pub fn continue_from(&mut self, other: &Self) {
        self.next_id = self.next_id.max(other.next_id);
    }

    /// Gives no ids below `next`.
    pub fn counting_from(mut self, next: u64) -> Self {
        self.next_id = self.next_id.max(next);
        self
    }

    /// Where those who are followed are expected at a frame's time, in seconds.
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
                rgb: track.rgb,
            }
        })
    }

    /// Takes in what the frame of that time shows. Detections that are not finite or whose covariance is none are ignored.
    ///
    /// A frame that is no later than the last one counts as of the same moment. Nobody is followed over a gap, or a jump
    /// back, of more than `coast_s`.
    pub fn step(&mut self, seconds: f64, detections: &[Detection]) {
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
        self.begin(detections);
        self.confirm();
        self.report();
    }

    /// Seconds from the last frame to one of that time; none if too much lies between.
    fn elapsed(&self, seconds: f64) -> Option<f64> {
        let elapsed = seconds - self.seconds.unwrap_or(seconds);
        // A time that is not finite is none: the frame is as of the last one's.
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
            // One detection of two people is evidence of one: the one who was seen last, or both would keep the other up.
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

    /// A person's detection, and who else may be in it: of those who go without one and were there a moment ago, whoever it
    /// fits best, if that is nearly as well.
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

    /// Begins to follow who is seen inside the room and is nobody that is followed already.
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

    /// Confirms who is evident, and drops who turns out to be where somebody else is.
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

    /// Whether bodies at these places would be in one another.
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
