//! The status: what the daemon tells of itself at one moment.

use doorcam_core::solver::ModelKind;
use doorcam_engine::{BackgroundReport, CameraMoved, State};
use doorcam_source::recorder::RecordingStatus;
use doorcam_source::{Granted, SourceState};
use jiff::Timestamp;
use serde::Serialize;
use utoipa::ToSchema;

use crate::config::Preset;
use crate::feed::SourceInfo;
use crate::watch::{CrossingsReport, Watching};

/// Counts of frames since the start.
#[derive(Debug, Clone, PartialEq, Default, Serialize, ToSchema)]
pub struct Frames {
    /// Frames that the source delivered.
    pub captured: u64,
    /// Frames that were turned into updates.
    pub solved: u64,
    /// Frames that a newer one replaced before they were solved.
    pub dropped: u64,
    /// Frames that the camera numbered but that never arrived.
    pub lost: u64,
    /// Frames that were missing or broken.
    pub skipped: u64,
    /// Frames that were lost to an internal error of doorcam.
    pub failed: u64,
    /// The last skipped frame: file and reason.
    #[schema(required)]
    pub last_skipped: Option<String>,
}

/// The state of the daemon, its source and its newest update.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct Status {
    /// Version of the program.
    pub version: &'static str,
    /// Whether the map can be trusted.
    pub state: State,
    /// Whether doorcam is watching, and if not, why.
    pub watching: Watching,
    /// The daemon's current time, for clients that compute the age of an update.
    pub time: Timestamp,
    /// Seconds since the start.
    pub uptime_s: f64,
    /// The model in use; null before there is a calibration.
    #[schema(value_type = Option<ModelKind>, required)]
    pub model: Option<&'static str>,
    /// The preset in use.
    #[schema(required)]
    pub preset: Option<Preset>,
    /// λ of eq. 13 in the newest update; 0 before there is a map.
    pub lambda: f64,
    /// Whether it is known where the camera sees the floor. Without that there is no map.
    pub calibrated: bool,
    /// Counts calibrations in this run; each update carries the number of its own.
    pub calibration_revision: u32,
    /// Counts changes of the zones in this run.
    pub zones_revision: u32,
    /// Who walked through the doorway, as `/crossings` tells it.
    pub crossings: CrossingsReport,
    /// Where frames come from.
    pub source: SourceStatus,
    /// Counts of frames.
    pub frames: Frames,
    /// Frames per second over the last seconds.
    pub rate_hz: Rates,
    /// The background that the newest update is compared with; null before the first update and if it is fixed.
    #[schema(required)]
    pub background: Option<BackgroundReport>,
    /// How the camera has moved since it was calibrated; null if it has not.
    #[schema(required)]
    pub camera_moved: Option<CameraMoved>,
    /// The newest update; null before the first.
    #[schema(required)]
    pub last_update: Option<LastUpdate>,
    /// The recording in progress, or the last one; null before the first.
    #[schema(required)]
    pub recording: Option<RecordingStatus>,
    /// Clients connected to the live socket.
    pub clients: usize,
}

/// The source and its current state.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct SourceStatus {
    /// What never changes during the run.
    #[serde(flatten)]
    pub info: SourceInfo,
    /// Its current state.
    pub state: SourceState,
    /// Why it is not streaming; null while it is.
    #[schema(required)]
    pub error: Option<String>,
    /// What the camera granted; null for other sources and while no camera is open.
    #[schema(required)]
    pub granted: Option<Granted>,
}

/// Frames per second.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, ToSchema)]
pub struct Rates {
    /// Delivered by the source.
    pub captured: f64,
    /// Turned into updates.
    pub solved: f64,
}

/// The newest update's number and age.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, ToSchema)]
pub struct LastUpdate {
    /// Its sequence number.
    pub sequence: u64,
    /// Seconds since it was published.
    pub age_s: f64,
}
