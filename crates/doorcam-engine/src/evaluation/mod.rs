//! How well people are found: what updates report against where everybody really was.
//!
//! Frame by frame, [`Scorer`] assigns what is reported to who is there ([`assign`]); [`Evaluation`] has the frames, and
//! [`Evaluation::report`] the figures (docs/evaluation.md defines each).

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
