//! How well people are found: compares what updates report with where everybody really was.
//!
//! For each frame, [`Scorer`] assigns the reported people to the true ones ([`assign`]). [`Evaluation`] holds the
//! scored frames, and [`Evaluation::report`] calculates the figures that docs/evaluation.md defines.

mod crossings;
mod directions;
mod figures;
mod gospa;
mod observed;
mod paths;
mod rows;
mod score;

pub use crossings::{CROSSING_WITHIN_S, CrossingCounts, CrossingScore, CrossingVerdict};
pub use directions::DIRECTION_M;
pub use figures::{GospaParts, Report, ReportTiming};
pub use gospa::{CUTOFF_M, Gospa, assign, gospa};
pub use observed::{Estimate, Observed, ObservedError, ReportedCrossing, StageTimes, read_updates};
pub use paths::{EstimatedPoint, Found, PersonPath, TrackPath, TruePoint};
pub use rows::{DistanceRow, PersonRow, RowFigures};
pub use score::{Evaluation, FrameScore, Scorer, TargetScore, TruthProblem, Verdict};
