//! Whether doorcam is watching, and if not, why: the one place that the status, `/readyz`, `/metrics`, MQTT and the page
//! ask. It depends on the time as well as on what happened, so it is computed when somebody asks.

use std::fmt::Write;
use std::time::{Duration, Instant};

use jiff::{SignedDuration, Timestamp};
use serde::Serialize;
use utoipa::ToSchema;

use doorcam_engine::State;
use doorcam_source::SourceState;

/// How long frames may come without an update before this is a fault: setting up an engine takes a few seconds.
const FIRST: Duration = Duration::from_secs(10);

/// Why doorcam is not watching.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Reason {
    /// The source is being opened.
    Opening,
    /// The camera, or the recording, is gone or cannot be opened.
    NoCamera,
    /// Nobody has said yet where the camera sees the floor.
    Uncalibrated,
    /// The empty room is being learned.
    Learning,
    /// The light changed or a reset was requested: the empty room is being learned anew.
    Relearning,
    /// Both patches are covered or lit by something on the camera's own side.
    Obstructed,
    /// The camera has moved since it was calibrated.
    Misaligned,
    /// No new update for some time, although the source is there.
    Stale,
    /// The source has no more frames.
    Ended,
    /// The source or the frame loop stopped on an error.
    Failed,
}

impl Reason {
    /// The name used in JSON and elsewhere.
    pub fn name(self) -> &'static str {
        match self {
            Self::Opening => "opening",
            Self::NoCamera => "no-camera",
            Self::Uncalibrated => "uncalibrated",
            Self::Learning => "learning",
            Self::Relearning => "relearning",
            Self::Obstructed => "obstructed",
            Self::Misaligned => "misaligned",
            Self::Stale => "stale",
            Self::Ended => "ended",
            Self::Failed => "failed",
        }
    }

    /// Whether it passes by itself within seconds: the updates are of now and say that they have no map, and nothing
    /// needs to be started anew.
    pub fn passes(self) -> bool {
        matches!(self, Self::Learning | Self::Relearning | Self::Obstructed)
    }

    /// The reason in words.
    pub fn words(self) -> &'static str {
        match self {
            Self::Opening => "the source is being opened",
            Self::NoCamera => "the camera is gone or cannot be opened",
            Self::Uncalibrated => "the camera is not calibrated",
            Self::Learning => "the empty room is being learned",
            Self::Relearning => "the empty room is being learned anew",
            Self::Obstructed => "something on the camera's own side covers the floor before the door",
            Self::Misaligned => "the camera has moved since it was calibrated",
            Self::Stale => "no new frames",
            Self::Ended => "the source has no more frames",
            Self::Failed => "the source failed",
        }
    }
}

/// Whether doorcam is watching: whether the newest map and its people are those of now.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, ToSchema)]
pub struct Watching {
    /// Whether it is. If not, nothing is known about the room, not even that nobody is in it.
    pub watching: bool,
    /// Why not; null while it is watching.
    #[schema(required)]
    pub reason: Option<Reason>,
    /// Since when this is so, RFC 3339.
    pub since: Timestamp,
    /// When it will end, RFC 3339; null if that is not known.
    #[schema(required)]
    pub until: Option<Timestamp>,
    /// The same in the words of an update's `state`.
    #[serde(skip)]
    pub state: State,
}

impl Watching {
    /// The gauges of this and of the number of `people` for `/metrics`, in the text format of Prometheus. They are all of
    /// one moment, so that exactly one state is 1 however many ask at once.
    pub(super) fn exposition(&self, people: usize) -> String {
        let mut text = String::from("# HELP doorcam_state 1 for the state of the map\n# TYPE doorcam_state gauge\n");
        for state in State::ALL {
            // Writing to a string cannot fail.
            let _ = writeln!(text, "doorcam_state{{state=\"{}\"}} {}", state.name(), u8::from(state == self.state));
        }
        let _ = write!(
            text,
            "\n# HELP doorcam_watching 1 while the map and its people are those of now\n# TYPE doorcam_watching gauge\n\
             doorcam_watching {}\n\n\
             # HELP doorcam_people People being tracked, confirmed or coasting; NaN while not watching\n\
             # TYPE doorcam_people gauge\ndoorcam_people {}\n\n",
            u8::from(self.watching),
            if self.watching { people as f64 } else { f64::NAN }
        );
        text
    }
}

/// A moment by both clocks: the monotonic one measures ages, the wall clock is shown.
#[derive(Debug, Clone, Copy)]
struct Moment {
    at: Instant,
    time: Timestamp,
}

impl Moment {
    fn later(self, by: Duration) -> Self {
        // Fails only if the wall clock is thousands of years off.
        let time = SignedDuration::try_from(by).ok().and_then(|by| self.time.checked_add(by).ok());
        Self { at: self.at + by, time: time.unwrap_or(self.time) }
    }

    fn or_later(self, other: Self) -> Self {
        if other.at > self.at { other } else { self }
    }
}

/// The newest update.
#[derive(Debug, Clone, Copy)]
struct Newest {
    state: State,
    published: Moment,
    /// Since when updates have come in this state without a gap.
    since: Moment,
}

/// What the frame loop and the source have said, from which [`Watching`] follows.
#[derive(Debug, Clone)]
pub(super) struct Observed {
    stale_after: Duration,
    source: SourceState,
    source_since: Moment,
    calibrated: Option<Moment>,
    newest: Option<Newest>,
}

impl Observed {
    /// Nothing yet, at `now`. An update older than `stale_after` does not show the present.
    pub(super) fn new(stale_after: Duration, calibrated: bool, now: Instant, time: Timestamp) -> Self {
        let start = Moment { at: now, time };
        let calibrated = calibrated.then_some(start);
        Self { stale_after, source: SourceState::Opening, source_since: start, calibrated, newest: None }
    }

    /// There is an update in this state.
    pub(super) fn updated(&mut self, state: State, now: Instant, time: Timestamp) {
        let published = Moment { at: now, time };
        let since = self.newest.filter(|newest| newest.state == state && !self.is_old(newest, now));
        self.newest = Some(Newest { state, published, since: since.map_or(published, |newest| newest.since) });
    }

    /// The source is in this state.
    pub(super) fn source_is(&mut self, state: SourceState, now: Instant, time: Timestamp) {
        if self.source != state {
            (self.source, self.source_since) = (state, Moment { at: now, time });
        }
    }

    /// There is a calibration.
    pub(super) fn calibrated(&mut self, now: Instant, time: Timestamp) {
        self.calibrated.get_or_insert(Moment { at: now, time });
    }

    /// What follows at `now`.
    pub(super) fn watching(&self, now: Instant) -> Watching {
        match self.newest {
            Some(newest) if !self.is_old(&newest, now) => {
                let reason = match newest.state {
                    State::Watching => None,
                    State::Learning => Some(Reason::Learning),
                    State::Relearning => Some(Reason::Relearning),
                    State::Obstructed => Some(Reason::Obstructed),
                    State::Misaligned => Some(Reason::Misaligned),
                    State::Stale => Some(Reason::Stale),
                };
                said(reason, newest.since, newest.state)
            }
            newest => {
                let (reason, since) = self.without_update(now);
                // The last update was good for a while, whatever the source did then.
                let since = newest.map_or(since, |newest| since.or_later(newest.published.later(self.stale_after)));
                let first = matches!(reason, Reason::Opening | Reason::Uncalibrated | Reason::Learning);
                let state = if first && newest.is_none() { State::Learning } else { State::Stale };
                said(Some(reason), since, state)
            }
        }
    }

    fn is_old(&self, newest: &Newest, now: Instant) -> bool {
        now.saturating_duration_since(newest.published.at) > self.stale_after
    }

    /// Why there is no update of now, and since when that reason holds.
    fn without_update(&self, now: Instant) -> (Reason, Moment) {
        let source = self.source_since;
        let Some(calibrated) = self.calibrated else {
            let reason = of_source(self.source).unwrap_or(Reason::Uncalibrated);
            return (reason, source);
        };
        if let Some(reason) = of_source(self.source) {
            return (reason, source);
        }
        let begun = source.or_later(calibrated);
        if self.newest.is_some() {
            return (Reason::Stale, begun);
        }
        if now.saturating_duration_since(begun.at) < FIRST {
            (Reason::Learning, begun)
        } else {
            (Reason::Stale, begun.later(FIRST))
        }
    }
}

/// Why a source in this state gives no frames; `None` if it should.
fn of_source(state: SourceState) -> Option<Reason> {
    match state {
        SourceState::Streaming => None,
        SourceState::Opening => Some(Reason::Opening),
        SourceState::Stalled => Some(Reason::Stale),
        SourceState::Lost | SourceState::BackingOff => Some(Reason::NoCamera),
        SourceState::Ended => Some(Reason::Ended),
        SourceState::Failed => Some(Reason::Failed),
    }
}

fn said(reason: Option<Reason>, since: Moment, state: State) -> Watching {
    Watching { watching: reason.is_none(), reason, since: since.time, until: None, state }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STALE: Duration = Duration::from_secs(2);

    /// A clock that is set by hand, and what was observed so far.
    struct Run {
        start: Instant,
        observed: Observed,
    }

    impl Run {
        fn new(calibrated: bool) -> Self {
            let start = Instant::now();
            Self { start, observed: Observed::new(STALE, calibrated, start, Timestamp::UNIX_EPOCH) }
        }

        fn at(&self, seconds: f64) -> (Instant, Timestamp) {
            let after = Duration::from_secs_f64(seconds);
            (self.start + after, Timestamp::UNIX_EPOCH + after)
        }

        fn source(&mut self, seconds: f64, state: SourceState) {
            let (now, time) = self.at(seconds);
            self.observed.source_is(state, now, time);
        }

        fn update(&mut self, seconds: f64, state: State) {
            let (now, time) = self.at(seconds);
            self.observed.updated(state, now, time);
        }

        /// Reason (empty: watching), since when in seconds, and state.
        fn ask(&self, seconds: f64) -> (&'static str, f64, State) {
            let told = self.observed.watching(self.at(seconds).0);
            assert_eq!(told.watching, told.reason.is_none());
            assert_eq!(told.watching, told.state == State::Watching, "the state says the same");
            (told.reason.map_or("", Reason::name), told.since.as_millisecond() as f64 / 1e3, told.state)
        }
    }

    #[test]
    fn time_alone_makes_it_stale_and_frames_make_it_watch_again() {
        let mut run = Run::new(true);
        assert_eq!(run.ask(0.5), ("opening", 0.0, State::Learning));
        run.source(1.0, SourceState::Streaming);
        assert_eq!(run.ask(1.5), ("learning", 1.0, State::Learning));
        run.update(2.0, State::Learning);
        assert_eq!(run.ask(2.1), ("learning", 2.0, State::Learning));
        for tick in 30..60 {
            run.update(f64::from(tick) / 10.0, State::Watching);
        }
        assert_eq!(run.ask(6.0), ("", 3.0, State::Watching));
        assert_eq!(run.ask(7.9), ("", 3.0, State::Watching), "two seconds are not stale yet");
        assert_eq!(run.ask(8.0), ("stale", 7.9, State::Stale));
        assert_eq!(run.ask(600.0), ("stale", 7.9, State::Stale));
        run.update(601.0, State::Watching);
        assert_eq!(run.ask(601.1), ("", 601.0, State::Watching), "since it watches again");
        run.update(602.0, State::Relearning);
        assert_eq!(run.ask(602.5), ("relearning", 602.0, State::Relearning));
    }

    #[test]
    fn the_source_says_why_there_are_no_updates() {
        for (state, reason) in [
            (SourceState::Stalled, "stale"),
            (SourceState::Lost, "no-camera"),
            (SourceState::BackingOff, "no-camera"),
            (SourceState::Ended, "ended"),
            (SourceState::Failed, "failed"),
            (SourceState::Opening, "opening"),
        ] {
            let mut run = Run::new(true);
            run.source(0.0, SourceState::Streaming);
            run.update(1.0, State::Watching);
            run.source(1.5, state);
            assert_eq!(run.ask(2.0).0, "", "the newest update is still of now");
            assert_eq!(run.ask(4.0), (reason, 3.0, State::Stale), "since the update is old, not before");
            run.source(5.0, SourceState::Streaming);
            run.source(6.0, state);
            assert_eq!(run.ask(7.0), (reason, 6.0, State::Stale));
        }
    }

    #[test]
    fn a_source_that_fails_before_its_first_update_is_not_learning() {
        for (state, reason) in [(SourceState::Failed, "failed"), (SourceState::Ended, "ended")] {
            let mut run = Run::new(true);
            run.source(0.0, SourceState::Streaming);
            run.source(1.0, state);
            assert_eq!(run.ask(1.0), (reason, 1.0, State::Stale));
        }
        let mut run = Run::new(true);
        run.source(0.5, SourceState::Streaming);
        assert_eq!(run.ask(60.0), ("stale", 10.5, State::Stale), "frames come, but no update ever does");
    }

    #[test]
    fn a_camera_without_a_calibration_is_not_learning() {
        let mut run = Run::new(false);
        run.source(1.0, SourceState::Streaming);
        assert_eq!(run.ask(60.0), ("uncalibrated", 1.0, State::Learning));
        let (now, time) = run.at(61.0);
        run.observed.calibrated(now, time);
        assert_eq!(run.ask(62.0), ("learning", 61.0, State::Learning));
        run.source(63.0, SourceState::Lost);
        assert_eq!(run.ask(64.0), ("no-camera", 63.0, State::Stale));
    }

    #[test]
    fn what_the_updates_say_is_told_as_the_reason_and_only_some_of_it_passes() {
        for (state, reason, passes) in [
            (State::Learning, "learning", true),
            (State::Relearning, "relearning", true),
            (State::Obstructed, "obstructed", true),
            (State::Misaligned, "misaligned", false),
            (State::Stale, "stale", false),
        ] {
            let mut run = Run::new(true);
            run.update(1.0, state);
            assert_eq!(run.ask(1.5), (reason, 1.0, state));
            assert_eq!(run.observed.watching(run.at(1.5).0).reason.map(Reason::passes), Some(passes), "{reason}");
            run.update(2.0, State::Watching);
            assert_eq!(run.ask(2.5), ("", 2.0, State::Watching));
        }
        assert!(
            ![Reason::NoCamera, Reason::Uncalibrated, Reason::Ended, Reason::Failed].into_iter().any(Reason::passes)
        );
    }

    #[test]
    fn exactly_one_state_is_1() {
        let mut run = Run::new(true);
        run.update(1.0, State::Watching);
        for (seconds, state, watching, people) in [(1.5, "watching", 1, "2"), (9.0, "stale", 0, "NaN")] {
            let text = run.observed.watching(run.at(seconds).0).exposition(2);
            assert!(text.contains(&format!("\ndoorcam_people {people}\n")), "{text}");
            let ones: Vec<&str> =
                text.lines().filter(|l| l.starts_with("doorcam_state{") && l.ends_with(" 1")).collect();
            assert_eq!(ones, [format!("doorcam_state{{state=\"{state}\"}} 1")]);
            assert!(text.contains(&format!("\ndoorcam_watching {watching}\n")), "{text}");
        }
    }
}
