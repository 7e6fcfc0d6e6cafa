//! The way of a frame through a doorway camera: from encoded images to an update that says what changed in the hidden
//! room and who is there.
//!
//! An [`Engine`] does all of it, live and offline alike: [`Engine::step`] takes a frame and returns what is known after
//! it. An [`Assembly`] puts an engine together from [`Settings`], for a recording or for a calibrated camera. The
//! mathematics is in `doorcam-core`, and frames come from `doorcam-source`. The engine reads no configuration file,
//! captures nothing and serves nothing; the program `doorcam` does that around it.
//!
//! # Along the way of a frame
//!
//! | Part | What it does |
//! |---|---|
//! | [`Settings`], [`Assembly`], [`Engine`] | what is wanted, put together, at work |
//! | [`FrameReader`] | decodes a frame and rectifies it into two patches of floor in linear light |
//! | [`Model`] | what is known before the first frame: doorway, facets, transport, pixels that count |
//! | [`Problem`] | the inverse problem (eq. 13) for one picture of the empty room |
//! | [`Reconstructor`] | from two patches to a map of what changed ([`Reconstruction`]) |
//! | [`People`] | from what a frame shows of people to tracks and events |
//! | [`Update`], [`Published`] | the result; the result with its JSON and what pictures need |
//!
//! The empty room is either given by a recording's first frames or learned and followed ([`Assembly::rolling`]).
//!
//! | Besides | What it does |
//! |---|---|
//! | [`evaluation`] | compares updates with where people really were |
//! | [`bench()`] | how long each stage takes; [`PublishedIteration`] is the authors' iteration, for comparison |
//! | `simulation` | a simulated doorway with lamps, people and a camera, whose truth is known |
//! | `figures` | maps, differences and bounds as SVG and PNG |
//!
//! # Conventions
//!
//! - **Door frame.** The origin is on the floor at the middle of the opening, in the plane of the wall's hidden face.
//!   For someone on the visible side who faces the door, x points to the right, y into the hidden room and z up.
//! - **Units.** Lengths are in metres and angles in radians. Where a name ends in a unit, that is it: `_m_s`, `_ms`.
//! - **Light** is linear, and 1 is the camera's full scale. Changes are against the empty room, negative where it
//!   became darker.
//! - **Time** is that of the frames, never the number of frames, so that a lost frame costs no more than itself.
//!
//! # Features
//!
//! - `simulation` (on by default): the module `simulation`.
//! - `figures` (on by default): the module `figures`.
//! - `schema` (off by default): OpenAPI schemas of the public types, with utoipa.
//!
//! # Example
//!
//! Three seconds of a simulated room: after one second somebody comes in. The engine gets what a camera would see.
//!
#![cfg_attr(feature = "simulation", doc = "```")]
#![cfg_attr(not(feature = "simulation"), doc = "```ignore")]
//! use doorcam_engine::simulation::{Scenario, Simulator};
//! use doorcam_engine::{Assembly, Settings};
//! use jiff::Timestamp;
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let mut scenario = Scenario::load("one-person")?;
//! scenario.background_s = 1.0;
//! let simulator = Simulator::new(scenario, 1)?;
//! let mut settings = Settings::default();
//! settings.patch.pixels = 32; // Half of the default: enough here, and faster to set up.
//! let mut engine = Assembly::new(settings).for_recording(simulator.manifest())?;
//! # let mut last = Vec::new();
//! for number in 0..30 {
//!     let published = engine.step(&simulator.frame(number)?, Timestamp::UNIX_EPOCH)?;
//!     for track in &published.update.tracks {
//!         println!("frame {number}: person {} is at x {:.2} m, y {:.2} m", track.id, track.x_m, track.y_m);
//!     }
//! #   last = published.update.tracks;
//! }
//! # // As is true.
//! # let truth = simulator.truth(29).targets;
//! # assert_eq!((last.len(), truth.len()), (1, 1));
//! # let error = (last[0].x_m - truth[0].x_m).hypot(last[0].y_m - truth[0].y_m);
//! # assert!(error < 0.2, "{last:?} {truth:?}");
//! # Ok(())
//! # }
//! ```

// Input from users, files or devices must never cause a panic.
#![warn(clippy::unwrap_used, clippy::expect_used)]

mod alignment;
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
mod put_down;
mod reader;
mod reconstructor;
mod settings;
#[cfg(feature = "simulation")]
pub mod simulation;
#[cfg(test)]
mod testing;
mod texture_reach;
mod update;
mod validity;
mod visible_side;

pub use alignment::CameraMoved;
pub use assembly::Assembly;
pub use background::Work;
pub use bench::{BENCH_FRAMES, BenchError, BenchReport, Looking, Median, Quantiles, bench};
pub use engine::{Engine, StepError};
pub use model::{Model, SetupError};
pub use people::People;
pub use problem::Problem;
pub use published_iteration::PublishedIteration;
pub use reader::{FrameReader, ReadTimes};
pub use reconstructor::{Reconstruction, Reconstructor};
pub use settings::{
    AveragingSettings, BackgroundSettings, PatchSettings, Preprocessing, Settings, SolverSettings, searched,
};
pub use update::{
    BackgroundReport, FacetReport, PatchView, Published, SolutionReport, State, Timing, Update, ViewReport, ViewState,
    Watched,
};
