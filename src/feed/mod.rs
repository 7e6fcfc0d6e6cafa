//! Turns a source's name on the command line into a running source.

mod spec;

use std::path::Path;
use std::sync::Arc;

use doorcam_core::calibration::Calibration;
use doorcam_engine::simulation::{LiveOptions, LiveSimulation, Scenario, ScenarioError, Simulator};
#[cfg(feature = "v4l2")]
use doorcam_source::camera::Locked;
use doorcam_source::recording::{Manifest, Recording};
use doorcam_source::{Replay, ReplayOptions, Source, SourceError, SystemClock};
use serde::Serialize;
use utoipa::ToSchema;

pub use self::spec::{Place, Simulated, SourceSpec};
#[cfg(feature = "v4l2")]
use crate::config::CameraConfig;
use crate::config::Config;

/// The kind of a source.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum SourceKind {
    /// A camera on a V4L2 driver.
    V4l2,
    /// A recording.
    Replay,
    /// A simulated doorway.
    Simulate,
}

/// What never changes about a source.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct SourceInfo {
    /// As given on the command line.
    pub spec: String,
    /// Its kind.
    pub kind: SourceKind,
    /// The source's own description, as free text.
    pub notes: String,
    /// Nominal frames per second.
    pub fps: f64,
}

/// Why a source cannot be opened. Displays as one line that names the source.
#[derive(Debug, thiserror::Error)]
pub enum FeedError {
    /// The recording cannot be used.
    #[error(transparent)]
    Recording(#[from] SourceError),
    /// There is no such scenario, or it cannot be read.
    #[error(transparent)]
    Scenario(#[from] ScenarioError),
    /// The scenario describes no doorway that can be simulated.
    #[error("{scenario}: {reason}")]
    Simulation {
        /// The scenario's name or file.
        scenario: String,
        /// What is wrong with it.
        reason: String,
    },
    /// This build has no support for cameras.
    #[error("{0}: this doorcam was built without cameras (feature v4l2)")]
    NoCameras(String),
}

/// A source that has been found but not started.
pub struct Feed {
    spec: String,
    opened: Opened,
    every_frame: bool,
}

enum Opened {
    Recording(Box<Recording>, ReplayOptions),
    Simulation(Box<Simulator>, LiveOptions),
    #[cfg(feature = "v4l2")]
    Camera(Box<Camera>),
}

#[cfg(feature = "v4l2")]
struct Camera {
    name: String,
    config: CameraConfig,
    locked: Arc<Locked>,
}

impl Feed {
    /// Finds a source. A recording's manifest and a scenario are read here. A camera is only looked for after the
    /// start, and again whenever it disappears.
    ///
    /// # Errors
    /// If a recording or a scenario cannot be read, or the build does not support cameras and one is requested.
    #[cfg_attr(not(feature = "v4l2"), expect(unused_variables, reason = "only cameras are configured"))]
    pub fn open(spec: &SourceSpec, config: &Config) -> Result<Self, FeedError> {
        let opened = match &spec.place {
            Place::Replay(directory, options) => Opened::Recording(Box::new(open_recording(directory)?), *options),
            Place::Simulate(Simulated { scenario, seed, pace, once }) => {
                let simulator = simulator(scenario, *seed)?;
                Opened::Simulation(Box::new(simulator), LiveOptions { pace: *pace, once: *once })
            }
            #[cfg(not(feature = "v4l2"))]
            Place::Camera(_) => return Err(FeedError::NoCameras(spec.text.clone())),
            #[cfg(feature = "v4l2")]
            Place::Camera(name) => {
                // Holds the exposure that an earlier run locked, if any.
                let controls = config.storage.directory().map(|directory| directory.join("controls.json"));
                let locked = Arc::new(Locked::new(controls));
                Opened::Camera(Box::new(Camera { name: name.clone(), config: config.camera.clone(), locked }))
            }
        };
        Ok(Self { spec: spec.text.clone(), opened, every_frame: false })
    }

    /// Delivers every frame of a single pass, as recording needs, instead of the newest frame forever.
    pub fn every_frame(mut self) -> Self {
        self.every_frame = true;
        if let Opened::Simulation(_, options) = &mut self.opened {
            options.once = true;
        }
        self
    }

    /// Its kind.
    pub fn kind(&self) -> SourceKind {
        match &self.opened {
            Opened::Recording(..) => SourceKind::Replay,
            Opened::Simulation(..) => SourceKind::Simulate,
            #[cfg(feature = "v4l2")]
            Opened::Camera(_) => SourceKind::V4l2,
        }
    }

    /// What never changes about it.
    pub fn info(&self) -> SourceInfo {
        let (notes, fps) = match &self.opened {
            Opened::Recording(recording, _) => (recording.manifest.notes.clone(), recording.manifest.fps),
            Opened::Simulation(simulator, _) => (simulator.manifest().notes.clone(), simulator.manifest().fps),
            #[cfg(feature = "v4l2")]
            Opened::Camera(camera) => (String::new(), camera.config.fps),
        };
        SourceInfo { spec: self.spec.clone(), kind: self.kind(), notes, fps }
    }

    /// The recording's directory, if the source is a recording.
    pub fn recording(&self) -> Option<&Path> {
        match &self.opened {
            Opened::Recording(recording, _) => Some(&recording.path),
            _ => None,
        }
    }

    /// The manifest of a recording or simulation: doorway, calibration, frames of the empty room. `None` for a camera.
    pub fn manifest(&self) -> Option<&Manifest> {
        match &self.opened {
            Opened::Recording(recording, _) => Some(&recording.manifest),
            Opened::Simulation(simulator, _) => Some(simulator.manifest()),
            #[cfg(feature = "v4l2")]
            Opened::Camera(_) => None,
        }
    }

    /// Applies a calibration: it replaces the one in a recording's manifest, and a camera is asked for images of its
    /// size. A simulation ignores it.
    pub fn use_calibration(&mut self, calibration: &Calibration) {
        match &mut self.opened {
            Opened::Recording(recording, _) => recording.manifest.set_calibration(calibration),
            #[cfg(feature = "v4l2")]
            Opened::Camera(camera) => {
                camera.config.size = calibration.size.map(|side| u32::try_from(side).unwrap_or(u32::MAX));
            }
            Opened::Simulation(..) => {}
        }
    }

    /// The camera settings that its images depend on, as text: those requested and those found and locked. `None` for
    /// other sources.
    pub fn camera_settings(&self) -> Option<Box<dyn Fn() -> String + Send + Sync>> {
        match &self.opened {
            Opened::Recording(..) | Opened::Simulation(..) => None,
            #[cfg(feature = "v4l2")]
            Opened::Camera(camera) => {
                let (controls, locked) = (camera.config.options().controls, Arc::clone(&camera.locked));
                Some(Box::new(move || format!("{controls:?}; {}", locked.words())))
            }
        }
    }

    /// Starts the source.
    pub fn start(self) -> Box<dyn Source> {
        match self.opened {
            Opened::Recording(recording, options) => {
                Box::new(Replay::new(Arc::from(recording), options, SystemClock::default()))
            }
            Opened::Simulation(simulator, options) => {
                Box::new(LiveSimulation::new(Arc::from(simulator), options, SystemClock::default()))
            }
            #[cfg(feature = "v4l2")]
            Opened::Camera(camera) => start_camera(*camera, self.every_frame),
        }
    }
}

#[cfg(feature = "v4l2")]
fn start_camera(camera: Camera, every_frame: bool) -> Box<dyn Source> {
    use doorcam_source::camera::{CameraOptions, Supervisor};
    use doorcam_source::v4l2::V4l2Camera;

    let options = CameraOptions { newest_only: !every_frame, ..camera.config.options() };
    let device = V4l2Camera::new(&camera.name, options, camera.locked);
    Box::new(Supervisor::new(device, SystemClock::default(), u64::from(std::process::id())))
}

/// Opens a recording and logs what a user should know about it, such as manifest keys that this version does not know,
/// files that are left out and frames that are missing.
///
/// # Errors
/// If there is no recording or its manifest cannot be used.
pub fn open_recording(directory: &Path) -> Result<Recording, SourceError> {
    let recording = Recording::open(directory)?;
    for key in &recording.unknown_keys {
        tracing::warn!("{}: unknown key \"{key}\" is ignored", directory.join("recording.json").display());
    }
    recording.notes.iter().for_each(|note| tracing::warn!("{note}"));
    Ok(recording)
}

/// A simulator of a scenario, given by name or file.
///
/// # Errors
/// If there is no such scenario or it cannot be simulated.
pub fn simulator(scenario: &str, seed: u64) -> Result<Simulator, FeedError> {
    simulator_of(Scenario::varied(scenario, seed)?, scenario, seed)
}

/// The same as [`simulator()`] with a camera that nobody bumps, to compare with.
///
/// # Errors
/// As [`simulator()`].
pub fn simulator_without_bumps(scenario: &str, seed: u64) -> Result<Simulator, FeedError> {
    let mut still = Scenario::varied(scenario, seed)?;
    still.camera.bump.clear();
    simulator_of(still, scenario, seed)
}

fn simulator_of(scenario: Scenario, name: &str, seed: u64) -> Result<Simulator, FeedError> {
    let refused = |reason: String| FeedError::Simulation { scenario: name.into(), reason };
    Simulator::new(scenario, seed).map_err(refused)
}

/// A simulator of the room of a seed, with so many people.
///
/// # Errors
///
/// If there cannot be so many.
pub fn random_room(seed: u64, people: usize) -> Result<Simulator, FeedError> {
    let refused = |reason: String| FeedError::Simulation { scenario: "random".into(), reason };
    Simulator::new(Scenario::random(seed, Some(people))?, seed).map_err(refused)
}
