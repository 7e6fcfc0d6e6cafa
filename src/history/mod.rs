//! What happened, kept: events and occupancy in an SQLite file that outlives the program.
//!
//! The frame loop hands over what each update says ([`History::take`]) and goes on; a thread of its own writes it down twice a
//! second. Where the file cannot be written, memory takes its place until it can.

mod kept;
mod query;
mod retention;
mod schema;
mod spans;
mod store;
mod writer;

use jiff::Timestamp;
pub use kept::Kept;
pub use query::{EventPage, EventQuery, Interval, IntervalPage, IntervalQuery, SpanPage, SpanQuery};
pub use retention::Retention;
pub use spans::Span;
pub use store::StoreError;
pub use writer::{History, HistoryError, HistoryReport, Observation};

/// The numbers that come next: they go on from run to run, so that each means one thing for ever.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Numbers {
    /// Of events.
    pub event: u64,
    /// Of tracks.
    pub track: u64,
    /// Of spans of occupancy.
    pub span: u64,
}

impl Numbers {
    /// The first ones of a run that cannot know those of the runs before: seconds of the clock, more than could have been counted
    /// since 1970.
    fn unknown(now: Timestamp) -> Self {
        let seconds = u64::try_from(now.as_second()).unwrap_or(0);
        Self { event: seconds, track: seconds, span: seconds }
    }
}
