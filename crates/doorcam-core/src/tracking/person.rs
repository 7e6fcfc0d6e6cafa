use super::colour::Colour;
use super::filter::{Filter, Fit};
use super::motion::Motion;
use super::tracker::TrackerSettings;
use super::{Detection, Track, TrackState};

/// Probability that one frame shows a person who is there. Kept low: who stands in another's shadow is missed for a while.
const DETECTED: f64 = 0.55;
/// False detections, and people seen for the first time, a frame and m² of floor.
const UNEXPECTED_PER_M2: f64 = 0.02;
/// Frames closer than this many seconds say partly the same, as they share the map's errors; evidence counts by time.
const INDEPENDENT_S: f64 = 0.1;
/// A position as far from the expected one is somebody else's: the 99.9 % quantile of chi-square with 2 degrees of freedom.
const GATE: f64 = 13.8155;
/// Log likelihood ratio at which somebody is there.
const CONFIRMED_AT: f64 = 6.0;
/// As much more is asked of who may be a second image of another.
const DOUBT: f64 = 6.0;
/// Evidence beyond this does not count: it is what a confirmed person's coasting uses up.
const SCORE_CAP: f64 = 12.0;
/// Who may be a false alarm is given up at this score.
const GIVEN_UP_AT: f64 = -2.0;
/// Detections without which nobody is confirmed.
const FEWEST: u32 = 3;
/// Unseen for this many seconds, a person is said to coast; one or two missed frames are nothing to tell.
const UNNOTED_S: f64 = 0.25;
/// Two people who pass one another are seen as one for about this long, in seconds.
const MEETING_S: f64 = 1.0;
/// Who was noticed this many seconds ago may begin to be seen as one with somebody else.
const NOTICED_S: f64 = 0.4;
/// A person who may be anywhere within this many metres (one standard deviation) is lost.
const LOST_AT_SD_M: f64 = 1.0;

/// Who is followed may be this far beyond where people begin to be, in metres.
const OUT_M: f64 = 0.2;
/// Times are sums of differences of the frames' times: rounding must not cost or add a frame.
const ROUNDING_S: f64 = 1e-6;

/// Somebody who is followed: where, what colour, and the evidence that they are there.
#[derive(Debug, Clone, Copy)]
pub(super) struct Person {
    pub id: u64,
    pub filter: Filter,
    pub confirmed: bool,
    colour: Colour,
    /// Log likelihood ratio of somebody to false alarms.
    score: f64,
    needed: f64,
    detections: u32,
    first_s: f64,
    last_s: f64,
    /// When they were last seen, by themselves or as one with another.
    noticed_s: f64,
}

impl Person {
    /// Seen for the first time, at a time of the tracker's clock. One who is `doubtful` has to show more.
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
        }
    }

    /// Log of how much more likely it is that the detection is of this person than that it is something else and the person
    /// went unseen; none beyond the gate.
    pub fn gain(&self, seen: &Detection) -> Option<f64> {
        let fit = self.filter.fit(seen.position, &seen.covariance).filter(|fit| fit.distance2 <= GATE)?;
        let detected = DETECTED * if self.confirmed { 1.0 } else { 1.0 / (1.0 + (-self.score).exp()) };
        let colour = self.colour.log_ratio(seen.rgb, seen.significance);
        Some((detected / (1.0 - detected)).ln() + fit.log_density - UNEXPECTED_PER_M2.ln() + colour)
    }

    /// Takes the detection in, `seconds` after the last frame.
    ///
    /// With `other`, somebody who goes without a detection and may be in this one: it is then of neither's colour.
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

    /// Takes in that this person and another one are seen as one, `seconds` after the last frame.
    pub fn meet(&mut self, seen: &Detection, other: &Filter, seconds: f64, now_s: f64) {
        self.noticed_s = now_s;
        // Where between them the detection is does not change from frame to frame: as white noise, that has as many times the
        // variance as there are frames in a meeting.
        let frames = (MEETING_S / seconds.max(MEETING_S / 100.0)).max(1.0);
        self.filter.update_shared(seen.position, &seen.covariance, other, frames);
    }

    /// Whether they may be in somebody else's detection, `seconds` after the last frame: a confirmed person who was seen there a
    /// moment ago, by themselves or with the other. Who has long been lost may be anywhere, and is not to be found in everyone.
    pub fn may_meet(&self, seconds: f64, now_s: f64) -> bool {
        self.confirmed && now_s - self.noticed_s <= seconds.max(NOTICED_S) + ROUNDING_S
    }

    /// Takes in that a frame, `seconds` after the last one, does not show them.
    pub fn miss(&mut self, seconds: f64, settings: &TrackerSettings) {
        self.score -= if self.confirmed {
            SCORE_CAP * seconds / settings.coast_s
        } else {
            -(1.0 - DETECTED).ln() * (seconds / INDEPENDENT_S).min(1.0)
        };
    }

    /// Whether there is evidence enough that somebody is there, from long enough.
    pub fn is_evident(&self, settings: &TrackerSettings) -> bool {
        let long_s = settings.confirm_s * self.needed / CONFIRMED_AT;
        self.score >= self.needed && self.detections >= FEWEST && self.last_s - self.first_s >= long_s - ROUNDING_S
    }

    /// Whether to stop following.
    pub fn is_over(&self, now_s: f64, settings: &TrackerSettings) -> bool {
        let unseen_s = now_s - self.last_s;
        // Who was there may well be seen to go a step beyond the walls; nobody begins there.
        let gone =
            unseen_s > 0.0 && !settings.holds_within(self.filter.position(), if self.confirmed { OUT_M } else { 0.0 });
        let lost = unseen_s > 0.0 && self.filter.position_sd_m() > LOST_AT_SD_M;
        let given_up = if self.confirmed { self.score <= 0.0 } else { self.score <= GIVEN_UP_AT };
        gone || lost || given_up || unseen_s >= settings.coast_s - ROUNDING_S
    }

    /// Seconds since the last detection.
    pub fn unseen_s(&self, now_s: f64) -> f64 {
        now_s - self.last_s
    }

    /// How sure they are.
    pub fn state(&self, now_s: f64) -> TrackState {
        match self.confirmed {
            false => TrackState::Tentative,
            true if self.unseen_s(now_s) > UNNOTED_S => TrackState::Coasting,
            true => TrackState::Confirmed,
        }
    }

    /// As updates report them.
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
