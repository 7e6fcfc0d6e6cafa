//! What can be asked of the history, and its answers.

use jiff::{SignedDuration, Timestamp};
use serde::Serialize;
use utoipa::ToSchema;

use super::Span;
use doorcam_core::tracking::{Event, EventKind};

/// Selects events.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct EventQuery {
    /// Only events with larger numbers than this.
    pub after: Option<u64>,
    /// Only events at or after this time.
    pub from: Option<Timestamp>,
    /// Only events before this time.
    pub to: Option<Timestamp>,
    /// Only events of these kinds; empty for all kinds.
    pub kinds: Vec<EventKind>,
    /// Only events of this track.
    pub track: Option<u64>,
    /// Only events of this zone.
    pub zone: Option<String>,
    /// At most this many.
    pub limit: usize,
}

/// Some of the kept events.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct EventPage {
    /// The events that match, in the order of their numbers.
    pub events: Vec<Event>,
    /// Number of the oldest event that is kept; null if none is kept.
    #[schema(required)]
    pub oldest: Option<u64>,
    /// Number of the newest event; null if none is kept.
    #[schema(required)]
    pub newest: Option<u64>,
    /// `after` of the next page; null if there are no more events.
    #[schema(required)]
    pub next: Option<u64>,
}

/// Selects spans.
#[derive(Debug, Clone, PartialEq)]
pub struct SpanQuery {
    /// Only spans with larger numbers than this.
    pub after: Option<u64>,
    /// Only spans that end after this time.
    pub from: Timestamp,
    /// Only spans that begin before this time.
    pub to: Timestamp,
    /// Only spans of this zone; `None` for those of the whole room.
    pub zone: Option<String>,
    /// At most this many.
    pub limit: usize,
}

/// Some of the kept spans.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct SpanPage {
    /// The spans that match, in the order in which they began.
    pub spans: Vec<Span>,
    /// `after` of the next page; null if there are no more spans.
    #[schema(required)]
    pub next: Option<u64>,
}

/// The intervals over which occupancy is summed up.
#[derive(Debug, Clone, PartialEq)]
pub struct IntervalQuery {
    /// Where the first interval begins.
    pub from: Timestamp,
    /// Where the last interval ends.
    pub to: Timestamp,
    /// Length of each interval; the last may be shorter.
    pub step: SignedDuration,
    /// The zone; `None` for the whole room.
    pub zone: Option<String>,
    /// At most this many intervals.
    pub limit: usize,
}

impl IntervalQuery {
    /// `from` of the next page; `None` if there are no more intervals.
    pub fn next(&self) -> Option<Timestamp> {
        let length = i32::try_from(self.limit).ok().and_then(|limit| self.step.checked_mul(limit))?;
        self.from.checked_add(length).ok().filter(|next| *next < self.to)
    }
}

/// Occupancy over an interval.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct Interval {
    /// Where it begins, RFC 3339.
    pub from: Timestamp,
    /// Where it ends.
    pub to: Timestamp,
    /// Most people at once; null if none of it was watched.
    #[schema(required)]
    pub most: Option<usize>,
    /// Mean number of people over the time that was watched; null if none of it was.
    #[schema(required)]
    pub mean: Option<f64>,
    /// Seconds with somebody there.
    pub occupied_s: f64,
    /// Seconds that were watched.
    pub watched_s: f64,
}

/// Some intervals.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct IntervalPage {
    /// The intervals, in their order.
    pub intervals: Vec<Interval>,
    /// `from` of the next page; null if there are no more intervals.
    #[schema(required)]
    pub next: Option<Timestamp>,
}

/// Where a page of events or spans begins and ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Cut {
    /// Numbers of the first and of the last row; `None` if there is none.
    pub ends: Option<[u64; 2]>,
    /// `after` of the next page; `None` if this is the last.
    pub next: Option<u64>,
}

impl Cut {
    /// Of numbers in their order, of which the last one may be beyond the limit.
    pub(super) fn of(numbers: impl Iterator<Item = u64>, limit: usize) -> Self {
        let (mut ends, mut next) = (None, None);
        for (k, number) in numbers.enumerate() {
            if k == limit {
                next = ends.map(|[_, last]: [u64; 2]| last);
                break;
            }
            ends = Some([ends.map_or(number, |[first, _]| first), number]);
        }
        Self { ends, next }
    }
}
