//! Who walked through the doorway: how many since midnight, and an estimate of how many are inside. The one place that
//! counts, for REST, the live socket, the status, MQTT, `/metrics` and the page.

use std::ops::Range;

use jiff::Timestamp;
use jiff::tz::TimeZone;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::watch::Reason;
use doorcam_core::tracking::{Direction, Event};

/// Most people that the estimate of how many are inside can be set to, or count up to: more than any room that one
/// doorway leads to. A count that nobody set right for months must not grow without bound.
pub const MOST_INSIDE: u32 = 1000;

/// Who walked through the doorway.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct CrossingsReport {
    /// Whether people who walk through are seen and counted now.
    pub available: bool,
    /// Why not; null while they are.
    #[schema(required)]
    pub reason: Option<String>,
    /// Estimate of how many are inside: as it was last set, and those who came in since less those who went out, but at
    /// least as many as are followed in the room. As old as `available` is false.
    #[schema(maximum = 1000)]
    pub inside: u32,
    /// The midnight, local time, since which they are counted, RFC 3339.
    pub since: Timestamp,
    /// How many came in since then.
    #[serde(rename = "in")]
    pub came_in: u64,
    /// How many went out since then.
    pub out: u64,
    /// How many turned around on the threshold since then.
    pub back: u64,
    /// The newest crossing, also of a day before; null before the first.
    #[schema(required)]
    pub last: Option<Event>,
}

impl CrossingsReport {
    /// The gauge for `/metrics`, in the text format of Prometheus.
    pub(super) fn exposition(&self) -> String {
        let inside = if self.available { f64::from(self.inside) } else { f64::NAN };
        format!(
            "# HELP doorcam_inside Estimate of how many people are inside; NaN while nobody who walks through is seen\n\
             # TYPE doorcam_inside gauge\ndoorcam_inside {inside}\n\n"
        )
    }
}

/// What is counted, and kept between runs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Tally {
    inside: u32,
    since: Timestamp,
    #[serde(rename = "in")]
    came_in: u64,
    out: u64,
    back: u64,
    last: Option<Event>,
    /// All crossings up to here are in it.
    until: Timestamp,
}

impl Tally {
    fn new(since: Timestamp) -> Self {
        Self { inside: 0, since, came_in: 0, out: 0, back: 0, last: None, until: since }
    }

    /// The same with another estimate, set at `now`.
    pub(super) fn with_inside(&self, inside: u32, now: Timestamp) -> Self {
        Self { inside, until: self.until.max(now), ..self.clone() }
    }

    /// Checks what a file has.
    pub(super) fn check(&self) -> Result<(), String> {
        if self.inside > MOST_INSIDE {
            return Err(format!("inside is {}, expected 0 to {MOST_INSIDE}", self.inside));
        }
        Ok(())
    }

    /// Where to read crossings from that may not be in it, if its day began at `midnight`.
    pub(super) fn reread_from(&self, midnight: Timestamp) -> Timestamp {
        if self.since == midnight { self.until } else { self.until.min(midnight) }
    }

    /// Counts from another midnight on.
    fn begin_day(&mut self, since: Timestamp) {
        if self.since != since {
            (self.since, self.came_in, self.out, self.back) = (since, 0, 0, 0);
        }
    }

    fn count(&mut self, direction: Direction) {
        match direction {
            Direction::In => self.came_in += 1,
            Direction::Out => self.out += 1,
            Direction::Back => self.back += 1,
        }
    }

    /// Takes somebody who crossed into the estimate. Nobody leaves an empty room: who went out had come in unseen.
    fn walk(&mut self, direction: Direction, event: &Event) {
        self.inside = match direction {
            Direction::In => (self.inside + 1).min(MOST_INSIDE),
            Direction::Out => self.inside.saturating_sub(1),
            Direction::Back => self.inside,
        };
        self.until = self.until.max(event.time);
        self.last = Some(event.clone());
    }
}

/// Counts people who walk through.
#[derive(Debug)]
pub(super) struct Crossings {
    zone: TimeZone,
    /// The day that it is, from midnight to midnight.
    today: Range<Timestamp>,
    tally: Tally,
    /// How many were followed in the room when there was last a map.
    seen: u32,
}

impl Crossings {
    /// Nobody has crossed yet.
    pub(super) fn new(zone: TimeZone, now: Timestamp) -> Self {
        let today = day(now, &zone).unwrap_or(now..now);
        Self { zone, tally: Tally::new(today.start), today, seen: 0 }
    }

    /// The midnight since which people are counted at `now`.
    pub(super) fn midnight(&mut self, now: Timestamp) -> Timestamp {
        if !self.today.contains(&now) {
            // It fails only for times thousands of years away.
            self.today = day(now, &self.zone).unwrap_or(now..now);
        }
        self.today.start
    }

    /// Goes on from an earlier run, with the `crossings` that are kept from [`Tally::reread_from`] on, in their order.
    pub(super) fn go_on(&mut self, kept: Option<Tally>, crossings: &[Event], now: Timestamp) {
        let midnight = self.midnight(now);
        let before = kept.unwrap_or_else(|| Tally::new(midnight));
        self.tally = before.clone();
        self.tally.begin_day(midnight);
        for event in crossings {
            let Some(direction) = event.kind.direction() else { continue };
            let is_new = event.time > before.until;
            // The file may be of a day before, or of another time zone.
            if event.time >= midnight && (is_new || before.since != midnight) {
                self.tally.count(direction);
            }
            if is_new {
                self.tally.walk(direction, event);
            }
        }
    }

    /// Counts an event. Returns the direction if it is a crossing.
    pub(super) fn take(&mut self, event: &Event, now: Timestamp) -> Option<Direction> {
        let direction = event.kind.direction()?;
        let midnight = self.midnight(now);
        self.tally.begin_day(midnight);
        if event.time >= midnight {
            self.tally.count(direction);
        }
        self.tally.walk(direction, event);
        Some(direction)
    }

    /// Takes how many are followed in the room: they are inside, whether or not they were seen to come in. Returns
    /// whether that changes the estimate.
    pub(super) fn see(&mut self, people: usize) -> bool {
        let before = self.inside();
        self.seen = u32::try_from(people).unwrap_or(MOST_INSIDE).min(MOST_INSIDE);
        self.inside() != before
    }

    /// The estimate of how many are inside. It is not taken into the tally: who has come by another way may leave by it.
    fn inside(&self) -> u32 {
        self.tally.inside.max(self.seen)
    }

    /// Sets the estimate right.
    pub(super) fn set_inside(&mut self, inside: u32, now: Timestamp) {
        self.tally = self.tally.with_inside(inside, now);
    }

    /// What is counted at `now`.
    pub(super) fn tally(&mut self, now: Timestamp) -> &Tally {
        let midnight = self.midnight(now);
        self.tally.begin_day(midnight);
        &self.tally
    }

    /// What is known at `now`. `unavailable` says why people are not counted, if they are not.
    pub(super) fn report(&mut self, unavailable: Option<String>, now: Timestamp) -> CrossingsReport {
        let Tally { since, came_in, out, back, last, .. } = self.tally(now).clone();
        CrossingsReport {
            available: unavailable.is_none(),
            reason: unavailable,
            inside: self.inside(),
            since,
            came_in,
            out,
            back,
            last,
        }
    }
}

/// Why people who walk through are not seen now; none if they are. `never` says why this camera cannot show them.
pub(super) fn why_not(enabled: bool, never: Option<String>, not_watching: Option<Reason>) -> Option<String> {
    if !enabled {
        return Some("crossings.enabled is false".into());
    }
    // The whole picture shows who walks through, whatever is known of the room.
    let sees = [Reason::Obstructed, Reason::Learning, Reason::Relearning];
    let now = not_watching.filter(|reason| !sees.contains(reason));
    never.or_else(|| now.map(|reason| format!("not watching: {}", reason.words())))
}

/// The day of this moment, from midnight to midnight.
fn day(now: Timestamp, zone: &TimeZone) -> Option<Range<Timestamp>> {
    let now = now.to_zoned(zone.clone());
    let begin = now.start_of_day().ok()?;
    let end = now.tomorrow().and_then(|tomorrow| tomorrow.start_of_day()).ok()?;
    Some(begin.timestamp()..end.timestamp())
}

#[cfg(test)]
#[path = "crossings_tests.rs"]
pub(super) mod tests;
