//! The history: events and occupancy, in an SQLite file that outlives the program.
//!
//! The frame loop hands over each update ([`History::take`]) and goes on; a separate thread writes twice a second.
//! While the file cannot be written, or is not where it was, the history is kept in memory. Queries read the file through
//! connections of their own, so that they wait neither for each other nor for the writer.

mod blocks;
mod bounds;
mod clock;
mod handle;
mod kept;
mod pages;
mod place;
mod query;
mod retention;
mod schema;
mod spans;
mod sparing;
mod store;
mod writer;

pub use bounds::Until;
pub use handle::{History, HistoryError, HistoryReport, Observation};
use jiff::Timestamp;
pub use kept::Kept;
pub use pages::{Cut, EventPage, EventQuery, Interval, IntervalPage, IntervalQuery, SpanPage, SpanQuery};
pub use retention::Retention;
pub use spans::Span;
pub use store::StoreError;

/// The next numbers to use. They continue from run to run, so that no number is used twice.
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
    /// The first numbers of a run that cannot know those used before: the seconds since 1970, more than earlier runs
    /// could have counted to.
    fn unknown(now: Timestamp) -> Self {
        let seconds = u64::try_from(now.as_second()).unwrap_or(0);
        Self { event: seconds, track: seconds, span: seconds }
    }
}
