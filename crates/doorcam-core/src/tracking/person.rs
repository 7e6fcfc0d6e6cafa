use super::colour::Colour;
use super::filter::{Filter, Fit};
use super::motion::Motion;
use super::tracker::TrackerSettings;
use super::{Covariance, Detection, Track, TrackState};
use crate::geometry::Point;

/// Probability that a frame shows a person who is there. Low, because somebody in another person's shadow is missed for
/// a while.
const DETECTED: f64 = 0.55;
/// Rate of false detections and first sightings, per frame and m² of floor.
const UNEXPECTED_PER_M2: f64 = 0.02;
/// Frames less than this many seconds apart share errors of the map, so their evidence is weighted by time.
const INDEPENDENT_S: f64 = 0.1;
/// Squared Mahalanobis distance beyond which a detection is not this person's: the 99.9 % quantile of chi-square with 2
/// degrees of freedom.
const GATE: f64 = 13.8155;
/// Log likelihood ratio at which a person is confirmed.
const CONFIRMED_AT: f64 = 6.0;
/// Additional log likelihood ratio required of somebody who may be a second image of another person.
const DOUBT: f64 = 6.0;
/// Largest score. It limits how long a confirmed person can coast.
const SCORE_CAP: f64 = 12.0;
/// Score at which an unconfirmed person is given up.
const GIVEN_UP_AT: f64 = -2.0;
/// Fewest detections for confirmation.
const FEWEST: u32 = 3;
/// Seconds unseen after which a person is reported as coasting; one or two missed frames are not worth reporting.
const UNNOTED_S: f64 = 0.25;
/// About how long two people who pass each other are seen as one, in seconds.
const MEETING_S: f64 = 1.0;
/// A person noticed at most this many seconds ago may begin to be seen as one with another.
const NOTICED_S: f64 = 0.4;
/// Standard deviation of the position, in metres, above which a person is lost.
const LOST_AT_SD_M: f64 = 1.0;
/// The same for somebody who was seen to come in.
const KNOWN_LOST_AT_SD_M: f64 = 1.5;

/// How far a confirmed person may go beyond the area where tracks can begin, in metres.
const OUT_M: f64 = 0.2;
/// Tolerance in seconds, so that rounding of summed time differences does not cost or add a frame.
const ROUNDING_S: f64 = 1e-6;

/// A tracked person: position, colour, and the evidence that they are there.
#[derive(Debug, Clone, Copy)]
pub(super) struct Person {
    pub id: u64,
    pub filter: Filter,
    pub confirmed: bool,
    colour: Colour,
    /// Log likelihood ratio of a person to false alarms.
    score: f64,
    /// Score required for confirmation.
    needed: f64,
    detections: u32,
    first_s: f64,
    last_s: f64,
    /// When they were last seen, alone or as one with another.
    noticed_s: f64,
    /// Whether they were seen to come in, so that they are there until they are seen to leave.
    admitted: bool,
}

impl Person {
    /// A person seen for the first time, at `now_s` on the tracker's clock. A `doubtful` one needs more evidence.
    pub fn new(id: u64, seen: &Detection, doubtful: bool, now_s: f64) -> Self {
        Self {
            id,
            filter: Filter::at(seen.position, &seen.covariance, &Motion::WALKING),
            confirmed: false,
            colour: Colour::new(seen.rgb),
            score: 0.0,
            needed: CONFIRMED_AT + if doubtful { DOUBT } else { 0.0 },
            detections: 1,
            first_s: now_s,
            last_s: now_s,
            noticed_s: now_s,
            admitted: false,
        }
    }

    /// A person who was seen to come in.
    pub fn admitted(id: u64, position: Point, velocity: [f64; 2], covariance: &Covariance, now_s: f64) -> Self {
        let seen = Detection { position, covariance: *covariance, rgb: [f64::NAN; 3], significance: 0.0 };
        let mut person = Self::new(id, &seen, false, now_s);
        person.filter = Filter::walking(position, velocity, covariance);
        (person.confirmed, person.admitted, person.score) = (true, true, SCORE_CAP);
        person
    }

    /// Log likelihood ratio of the detection being this person to it being something else and the person going unseen;
    /// `None` beyond the gate.
    pub fn gain(&self, seen: &Detection) -> Option<f64> {
        let fit = self.filter.fit(seen.position, &seen.covariance).filter(|fit| fit.distance2 <= GATE)?;
        let detected = DETECTED * if self.confirmed { 1.0 } else { 1.0 / (1.0 + (-self.score).exp()) };
        let colour = self.colour.log_ratio(seen.rgb, seen.significance);
        Some((detected / (1.0 - detected)).ln() + fit.log_density - UNEXPECTED_PER_M2.ln() + colour)
    }

    /// Processes this person's detection, `seconds` after the last frame.
    ///
    /// `other` is somebody without a detection who may share this one; its colour then belongs to neither.
    pub fn see(&mut self, seen: &Detection, other: Option<&Filter>, seconds: f64, now_s: f64) {
        if let Some(Fit { log_density, .. }) = self.filter.fit(seen.position, &seen.covariance) {
            let evidence = (DETECTED / UNEXPECTED_PER_M2).ln() + log_density;
            self.score = (self.score + evidence * (seconds / INDEPENDENT_S).min(1.0)).min(SCORE_CAP);
        }
        match other {
            Some(other) => self.meet(seen, other, seconds, now_s),
            None => {
                self.colour.update(seen.rgb, seconds);
                self.filter.update(seen.position, &seen.covariance);
            }
        }
        self.detections += 1;
        self.last_s = now_s;
        self.noticed_s = now_s;
    }

    /// Processes a detection in which this person and another are seen as one, `seconds` after the last frame.
    pub fn meet(&mut self, seen: &Detection, other: &Filter, seconds: f64, now_s: f64) {
        self.noticed_s = now_s;
        // Where the detection lies between the two is the same error in every frame of a meeting. To treat it as white
        // noise, its variance is multiplied by the number of frames.
        let frames = (MEETING_S / seconds.max(MEETING_S / 100.0)).max(1.0);
        self.filter.update_shared(seen.position, &seen.covariance, other, frames);
    }

    /// Whether this person may share somebody else's detection, `seconds` after the last frame: if confirmed and
    /// noticed a moment ago, alone or with the other. Somebody lost for longer could be anywhere, and would be found in
    /// everyone.
    pub fn may_meet(&self, seconds: f64, now_s: f64) -> bool {
        self.confirmed && now_s - self.noticed_s <= seconds.max(NOTICED_S) + ROUNDING_S
    }

    /// Processes a frame, `seconds` after the last one, that does not show this person.
    pub fn miss(&mut self, seconds: f64, settings: &TrackerSettings) {
        self.score -= if self.confirmed {
            SCORE_CAP * seconds / settings.coast_s
        } else {
            -(1.0 - DETECTED).ln() * (seconds / INDEPENDENT_S).min(1.0)
        };
    }

    /// Whether there is enough evidence, over a long enough time, to confirm this person.
    pub fn is_evident(&self, settings: &TrackerSettings) -> bool {
        let long_s = settings.confirm_s * self.needed / CONFIRMED_AT;
        self.score >= self.needed && self.detections >= FEWEST && self.last_s - self.first_s >= long_s - ROUNDING_S
    }

    /// Whether to stop following.
    pub fn is_over(&self, now_s: f64, settings: &TrackerSettings) -> bool {
        let unseen_s = now_s - self.last_s;
        // A confirmed person may be seen a step beyond the walls, but nobody begins there.
        let gone =
            unseen_s > 0.0 && !settings.holds_within(self.filter.position(), if self.confirmed { OUT_M } else { 0.0 });
        let lost_at = if self.admitted { KNOWN_LOST_AT_SD_M } else { LOST_AT_SD_M };
        let lost = unseen_s > 0.0 && self.filter.position_sd_m() > lost_at;
        if self.admitted {
            return gone || lost;
        }
        let given_up = if self.confirmed { self.score <= 0.0 } else { self.score <= GIVEN_UP_AT };
        gone || lost || given_up || unseen_s >= settings.coast_s - ROUNDING_S
    }

    /// Forgets that they were seen to come in: they may have left unseen.
    pub fn doubt(&mut self) {
        self.admitted = false;
    }

    /// Whether they were seen to come in.
    pub fn is_known(&self) -> bool {
        self.admitted
    }

    /// Seconds since the last detection.
    pub fn unseen_s(&self, now_s: f64) -> f64 {
        now_s - self.last_s
    }

    /// State of the track.
    pub fn state(&self, now_s: f64) -> TrackState {
        match self.confirmed {
            false => TrackState::Tentative,
            true if self.unseen_s(now_s) > UNNOTED_S => TrackState::Coasting,
            true => TrackState::Confirmed,
        }
    }

    /// The track that updates report.
    pub fn track(&self, now_s: f64) -> Track {
        let [x_m, y_m] = self.filter.position();
        let [vx_m_s, vy_m_s] = self.filter.velocity();
        Track {
            id: self.id,
            state: self.state(now_s),
            x_m,
            y_m,
            vx_m_s,
            vy_m_s,
            covariance_m2: self.filter.position_covariance(),
            rgb: self.colour.rgb(),
            age_s: now_s - self.first_s,
        }
    }
}
