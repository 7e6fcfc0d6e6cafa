//! The way of a frame: from encoded images to an update that says what changed in the hidden room and who is there.

// What a user, a file or a device gives must never panic.
#![warn(clippy::unwrap_used, clippy::expect_used)]

mod assembly;
mod background;
mod bench;
mod engine;
pub mod evaluation;
#[cfg(feature = "figures")]
pub mod figures;
mod model;
mod people;
mod problem;
mod published_iteration;
mod reader;
mod reconstructor;
mod settings;
#[cfg(feature = "simulation")]
pub mod simulation;
mod texture_reach;
mod update;

pub use assembly::Assembly;
pub use background::Work;
pub use bench::{BENCH_FRAMES, BenchError, BenchReport, Median, Quantiles, bench};
pub use engine::{Engine, StepError};
pub use model::{Model, SetupError};
pub use people::People;
pub use problem::Problem;
pub use published_iteration::PublishedIteration;
pub use reader::{FrameReader, ReadTimes};
pub use reconstructor::{Reconstruction, Reconstructor};
pub use settings::{AveragingSettings, BackgroundSettings, PatchSettings, Preprocessing, Settings, SolverSettings};
pub use update::{BackgroundReport, FacetReport, Published, SolutionReport, State, Timing, Update, Watched};
