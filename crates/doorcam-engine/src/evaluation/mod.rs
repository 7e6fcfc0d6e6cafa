//! How well people are found: compares what updates report with where everybody really was.
//!
//! For each frame, [`Scorer`] assigns the reported people to the true ones ([`assign`]). [`Evaluation`] holds the
//! scored frames, and [`Evaluation::report`] calculates the figures that docs/evaluation.md defines.

mod figures;
mod gospa;
mod observed;
mod paths;
mod score;

pub use figures::{GospaParts, Report, ReportTiming};
pub use gospa::{CUTOFF_M, Gospa, assign, gospa};
pub use observed::{Estimate, Observed, ObservedError, StageTimes, read_updates};
pub use paths::{EstimatedPoint, Found, PersonPath, TrackPath, TruePoint};
pub use score::{Evaluation, FrameScore, Scorer, TargetScore, TruthProblem, Verdict};
