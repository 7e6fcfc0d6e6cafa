//! Where frames come from, opened: one way from the words on the command line to a running source, whoever reads it.

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

/// What a source is.
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

/// What is fixed about a source.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct SourceInfo {
    /// As given on the command line.
    pub spec: String,
    /// What it is.
    pub kind: SourceKind,
    /// Its own words about itself, for people.
    pub notes: String,
    /// Frames a second that it should give.
    pub fps: f64,
}

/// Why a source cannot be read: one line that names it.
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
        /// Its name or file.
        scenario: String,
        /// What is wrong with it.
        reason: String,
    },
    /// This program has no part for it.
    #[error("{0}: this doorcam was built without cameras (feature v4l2)")]
    NoCameras(String),
}

/// A source that was found, before its first frame.
pub struct Feed {
    spec: String,
    opened: Opened,
    #[cfg_attr(not(feature = "v4l2"), expect(dead_code, reason = "only cameras give less"))]
    every_frame: bool,
}

enum Opened {
    Recording(Box<Recording>, ReplayOptions),
    Simulation(Box<Simulator>, LiveOptions),
    #[cfg(feature = "v4l2")]
    Camera(Camera),
}

#[cfg(feature = "v4l2")]
struct Camera {
    name: String,
    config: CameraConfig,
    locked: Arc<Locked>,
}

impl Feed {
    /// Finds a source. A recording's manifest and a scenario are read here; a camera is looked for once it is started, and again
    /// whenever it is gone.
    ///
    /// # Errors
    /// If a recording or a scenario cannot be read, or a camera is asked for that this program has no part for.
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
                // The exposure that an earlier run has locked, if it has.
                let controls = config.storage.directory().map(|directory| directory.join("controls.json"));
                let locked = Arc::new(Locked::new(controls));
                Opened::Camera(Camera { name: name.clone(), config: config.camera.clone(), locked })
            }
        };
        Ok(Self { spec: spec.text.clone(), opened, every_frame: false })
    }

    /// Gives every frame of one round rather than the newest one for ever, as a recording wants it.
    pub fn every_frame(mut self) -> Self {
        self.every_frame = true;
        if let Opened::Simulation(_, options) = &mut self.opened {
            options.once = true;
        }
        self
    }

    /// What it is.
    pub fn kind(&self) -> SourceKind {
        match &self.opened {
            Opened::Recording(..) => SourceKind::Replay,
            Opened::Simulation(..) => SourceKind::Simulate,
            #[cfg(feature = "v4l2")]
            Opened::Camera(_) => SourceKind::V4l2,
        }
    }

    /// What is fixed about it.
    pub fn info(&self) -> SourceInfo {
        let (notes, fps) = match &self.opened {
            Opened::Recording(recording, _) => (recording.manifest.notes.clone(), recording.manifest.fps),
            Opened::Simulation(simulator, _) => (simulator.manifest().notes.clone(), simulator.manifest().fps),
            #[cfg(feature = "v4l2")]
            Opened::Camera(camera) => (String::new(), camera.config.fps),
        };
        SourceInfo { spec: self.spec.clone(), kind: self.kind(), notes, fps }
    }

    /// The recording's directory, where it is one.
    pub fn recording(&self) -> Option<&Path> {
        match &self.opened {
            Opened::Recording(recording, _) => Some(&recording.path),
            _ => None,
        }
    }

    /// What a source that is no camera says of itself: its doorway, its calibration, which frames show the empty room.
    pub fn manifest(&self) -> Option<&Manifest> {
        match &self.opened {
            Opened::Recording(recording, _) => Some(&recording.manifest),
            Opened::Simulation(simulator, _) => Some(simulator.manifest()),
            #[cfg(feature = "v4l2")]
            Opened::Camera(_) => None,
        }
    }

    /// Takes this calibration in place of the source's own: a recording's manifest then says so, and a camera is asked for images
    /// of this size.
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

    /// In words, the camera's settings on which its pictures depend: those asked for, and those that were found and locked. None
    /// for what is no camera.
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

    /// Starts it: frames can be asked for.
    pub fn start(self) -> Box<dyn Source> {
        match self.opened {
            Opened::Recording(recording, options) => {
                Box::new(Replay::new(Arc::from(recording), options, SystemClock::default()))
            }
            Opened::Simulation(simulator, options) => {
                Box::new(LiveSimulation::new(Arc::from(simulator), options, SystemClock::default()))
            }
            #[cfg(feature = "v4l2")]
            Opened::Camera(camera) => start_camera(camera, self.every_frame),
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

/// Opens a recording and says which keys of its manifest mean nothing to this version.
///
/// # Errors
/// If there is none, or its manifest cannot be used.
pub fn open_recording(directory: &Path) -> Result<Recording, SourceError> {
    let recording = Recording::open(directory)?;
    for key in &recording.unknown_keys {
        tracing::warn!("{}: unknown key \"{key}\" is ignored", directory.join("recording.json").display());
    }
    Ok(recording)
}

/// A scenario, by name or file, ready to make frames.
///
/// # Errors
/// If there is no such scenario, or it cannot be simulated.
pub fn simulator(scenario: &str, seed: u64) -> Result<Simulator, FeedError> {
    let refused = |reason: String| FeedError::Simulation { scenario: scenario.into(), reason };
    Simulator::new(Scenario::load(scenario)?, seed).map_err(refused)
}
