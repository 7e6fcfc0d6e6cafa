use std::sync::Arc;
use std::time::Instant;

use jiff::Timestamp;
use serde::Serialize;

use crate::{CameraMoved, Model, Reconstruction};
use doorcam_core::alignment::Overview;
use doorcam_core::light::{PatchPair, Sensing};
use doorcam_core::scene::{Rgb, Scene};
#[cfg(feature = "schema")]
use doorcam_core::solver::ModelKind;
use doorcam_core::still_room::StillRoom;
use doorcam_core::tracking::{Detection, Event, Occupancy, Track, TrackState};

/// Whether the map can be trusted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[serde(rename_all = "lowercase")]
pub enum State {
    /// The empty room is being learned: no map yet.
    Learning,
    /// The map is current.
    Watching,
    /// The light changed or a reset was requested; the background is being learned anew, and no other one explains the
    /// frame.
    Relearning,
    /// No new frame for some time: the map is outdated.
    Stale,
    /// Both patches are covered or lit by something on the camera's own side: no map.
    Obstructed,
    /// The camera has moved: the patches are no longer where the calibration says. No map.
    Misaligned,
}

impl State {
    /// Every state.
    pub const ALL: [Self; 6] =
        [Self::Learning, Self::Watching, Self::Relearning, Self::Stale, Self::Obstructed, Self::Misaligned];

    /// The name used in JSON and elsewhere.
    pub fn name(self) -> &'static str {
        match self {
            Self::Learning => "learning",
            Self::Watching => "watching",
            Self::Relearning => "relearning",
            Self::Stale => "stale",
            Self::Obstructed => "obstructed",
            Self::Misaligned => "misaligned",
        }
    }
}

/// How much of a patch still shows the floor, lit as the hidden room can light it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[serde(rename_all = "lowercase")]
pub enum ViewState {
    /// All of it, or nearly.
    Clear,
    /// A part; the rest goes on measuring.
    Partial,
    /// Too little to measure with.
    Blocked,
}

impl ViewState {
    /// Every state.
    pub const ALL: [Self; 3] = [Self::Clear, Self::Partial, Self::Blocked];

    /// The name used in JSON and elsewhere.
    pub fn name(self) -> &'static str {
        match self {
            Self::Clear => "clear",
            Self::Partial => "partial",
            Self::Blocked => "blocked",
        }
    }
}

/// What one patch contributes to a frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct PatchView {
    /// Whether the patch can be used.
    pub state: ViewState,
    /// Share of its pixels that are used, 0 to 1.
    pub used: f64,
}

impl PatchView {
    /// A patch with nothing in the way.
    pub const CLEAR: Self = Self { state: ViewState::Clear, used: 1.0 };
}

/// What both patches contribute to a frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct ViewReport {
    /// The patch at the left edge.
    pub left: PatchView,
    /// The patch at the right edge.
    pub right: PatchView,
}

impl ViewReport {
    /// Both patches with nothing in the way.
    pub const CLEAR: Self = Self { left: PatchView::CLEAR, right: PatchView::CLEAR };
}

/// What is known after one frame: one line of `doorcam reconstruct`, one message of the live socket. Light is linear,
/// relative to full scale; negative means darker than the background.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct Update {
    /// Version of this format.
    pub version: u32,
    /// Counts updates of this run, from 0.
    pub sequence: u64,
    /// Time of capture, RFC 3339. For a recording reconstructed offline, its own clock from 1970-01-01T00:00:00Z.
    pub time: Timestamp,
    /// The frame's number in its recording.
    #[cfg_attr(feature = "schema", schema(required))]
    pub frame: Option<u64>,
    /// Whether the map can be trusted.
    pub state: State,
    /// Number of the calibration in use. When it changes, the geometry may have changed.
    pub calibration: u32,
    /// How the map was found.
    pub solution: SolutionReport,
    /// Which signs the map may have: `signed` or `published`.
    #[cfg_attr(feature = "schema", schema(value_type = ModelKind))]
    pub model: &'static str,
    /// How much of each patch can be used.
    pub view: ViewReport,
    /// Change of the visible side's light, b of eq. 12.
    pub illumination: Illumination,
    /// Per patch, the factor on each colour's picture of the empty room in this frame, apart from what the facets
    /// explain: exposure, flicker and anything else that scales all of the floor's light alike. None while the empty
    /// room is learned, and with the published model, which has no gain.
    #[cfg_attr(feature = "schema", schema(required))]
    pub gain: Option<Gain>,
    /// The state of the background if it is followed over time; left out if it is fixed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub background: Option<BackgroundReport>,
    /// How the camera has moved since it was calibrated; left out if it has not.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub camera_moved: Option<CameraMoved>,
    /// The facets that changed.
    pub facets: Vec<FacetReport>,
    /// People; empty while the room is learned.
    pub tracks: Vec<Track>,
    /// What people have done since the previous update; left out if nothing.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub events: Vec<Event>,
    /// Who is in which zone; left out if no zones are configured.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub zones: Vec<Occupancy>,
    /// Where the time went.
    pub timing_ms: Timing,
}

/// How the map was found.
#[derive(Debug, Clone, PartialEq, Serialize, Default)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct SolutionReport {
    /// λ of eq. 13.
    pub lambda: f64,
    /// Value of eq. 13.
    pub objective: f64,
    /// Its data term.
    pub data: f64,
    /// Its penalty.
    pub penalty: f64,
    /// A proven lower bound on the objective.
    pub bound: f64,
    /// The largest violation of a first-order condition, as a share of λ: 0 at a stationary point.
    pub residual: f64,
    /// Number of sweeps over the facets and of Newton steps.
    pub iterations: usize,
    /// Whether the limit on iterations ended it, with the best point so far.
    pub capped: bool,
    /// Whether it started from the previous frame's map.
    pub warm: bool,
}

/// b of eq. 12 at each patch.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Default)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct Illumination {
    /// At the left patch.
    #[cfg_attr(feature = "schema", schema(value_type = doorcam_core::schema::Rgb))]
    pub left: Rgb,
    /// At the right patch.
    #[cfg_attr(feature = "schema", schema(value_type = doorcam_core::schema::Rgb))]
    pub right: Rgb,
}

/// Factors on the background's own picture at each patch.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct Gain {
    /// At the left patch.
    #[cfg_attr(feature = "schema", schema(value_type = doorcam_core::schema::Rgb))]
    pub left: Rgb,
    /// At the right patch.
    #[cfg_attr(feature = "schema", schema(value_type = doorcam_core::schema::Rgb))]
    pub right: Rgb,
}

/// The background that frames are compared with, or that is being learned.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct BackgroundReport {
    /// Number of frames in the mean, as the equivalent number of frames of equal weight.
    pub frames: u64,
    /// Seconds since it was learned; none while it is being learned.
    #[cfg_attr(feature = "schema", schema(required))]
    pub age_s: Option<f64>,
    /// Share of the learning time in a still room that has passed, 0 to 1; stays 1 while waiting for the room to be
    /// still. None once the background is learned. A map may be shown meanwhile, if the light only seemed to change.
    #[cfg_attr(feature = "schema", schema(required))]
    pub progress: Option<f64>,
}

/// One facet's change.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct FacetReport {
    /// Index in the grid.
    pub index: usize,
    /// Change of its radiance seen from the left edge.
    #[cfg_attr(feature = "schema", schema(value_type = doorcam_core::schema::Rgb))]
    pub left: [f32; 3],
    /// Change of its radiance seen from the right edge.
    #[cfg_attr(feature = "schema", schema(value_type = doorcam_core::schema::Rgb))]
    pub right: [f32; 3],
    /// Its colour in the unified map.
    #[cfg_attr(feature = "schema", schema(value_type = doorcam_core::schema::Rgb))]
    pub unified: [f32; 3],
    /// The factor by which a least-squares refit multiplies this facet's light: brightness without the penalty's
    /// shrinkage.
    pub refit: f32,
    /// Whether a second light of another colour or left-right balance would improve the fit here: one colour for both
    /// views then fits badly.
    pub wants_second: bool,
}

/// Milliseconds spent on each stage of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Default)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct Timing {
    /// Decoding the images.
    pub decode: f64,
    /// Rectifying them.
    pub rectify: f64,
    /// Subtracting the background.
    pub background: f64,
    /// Calculating Aᵀy.
    pub project: f64,
    /// Solving eq. 13.
    pub solve: f64,
    /// Detecting and tracking people.
    pub track: f64,
    /// From the encoded frame to the update.
    pub total: f64,
}

impl Update {
    /// An update without a map, while the empty room is learned.
    pub fn learning(model: &Model, sequence: u64, time: Timestamp, frame: Option<u64>, timing_ms: Timing) -> Self {
        Self::blank(model.kind.name(), sequence, time, frame, timing_ms)
    }

    /// Number of people who are followed; who is not confirmed yet does not count.
    pub fn people(&self) -> usize {
        self.tracks.iter().filter(|track| track.state != TrackState::Tentative).count()
    }

    /// An update without a map, for a model of this name.
    pub fn blank(model: &'static str, sequence: u64, time: Timestamp, frame: Option<u64>, timing_ms: Timing) -> Self {
        Self {
            version: 1,
            sequence,
            time,
            frame,
            state: State::Learning,
            calibration: 0,
            solution: SolutionReport::default(),
            model,
            view: ViewReport::CLEAR,
            illumination: Illumination::default(),
            gain: None,
            background: None,
            camera_moved: None,
            facets: Vec::new(),
            tracks: Vec::new(),
            events: Vec::new(),
            zones: Vec::new(),
            timing_ms,
        }
    }

    /// The update of a reconstructed frame.
    pub fn watching(
        model: &Model,
        sequence: u64,
        time: Timestamp,
        frame: Option<u64>,
        reconstruction: &Reconstruction,
        timing_ms: Timing,
    ) -> Self {
        let solution = &reconstruction.solution;
        let [left, right] = reconstruction.illumination;
        Self {
            state: State::Watching,
            calibration: 0,
            solution: SolutionReport {
                lambda: solution.lambda,
                objective: solution.objective(),
                data: solution.data,
                penalty: solution.penalty,
                bound: solution.bound,
                residual: solution.residual,
                iterations: solution.sweeps,
                capped: solution.capped,
                warm: solution.warm,
            },
            illumination: Illumination { left, right },
            gain: reconstruction.gain.map(|[left, right]| Gain { left, right }),
            facets: facets(reconstruction),
            ..Self::learning(model, sequence, time, frame, timing_ms)
        }
    }
}

fn facets(reconstruction: &Reconstruction) -> Vec<FacetReport> {
    let Reconstruction { scene, solution, refit, .. } = reconstruction;
    let single = |rgb: Rgb| rgb.map(|v| v as f32);
    scene
        .nonzero()
        .map(|n| FacetReport {
            index: n,
            left: single(scene.left[n]),
            right: single(scene.right[n]),
            unified: single(scene.unified[n]),
            refit: refit[n] as f32,
            wants_second: solution.wants_second.get(n).copied().unwrap_or(false),
        })
        .collect()
}

/// An update as it is shared by all clients: made once, never changed.
#[derive(Debug)]
pub struct Published {
    /// The update.
    pub update: Update,
    /// The update as JSON text, serialised once for all clients.
    pub json: Arc<str>,
    /// Views and unified map in the brightness that the figures show; none while learning.
    pub scene: Option<Scene>,
    /// The difference measurement (eq. 4), for pictures; none while learning.
    pub difference: Option<PatchPair>,
    /// The patches of this frame, in linear light.
    pub patches: Option<PatchPair>,
    /// The people that this frame shows by itself.
    pub detections: Vec<Detection>,
    /// What the pixels can measure; none while learning, and with the published model.
    pub sensing: Option<Arc<Sensing>>,
    /// What the room looks like while it is empty, as its light on the floor tells; none while learning, with the
    /// published model, and in the dark.
    pub still: Option<Arc<StillRoom>>,
    /// The picture of the empty room that tells whether the camera has moved; none before it is taken.
    pub reference: Option<Arc<Overview>>,
    /// When it was published.
    pub at: Instant,
}

impl Published {
    /// Serialises an update once for all clients.
    pub fn new(update: Update, scene: Option<Scene>, difference: Option<PatchPair>) -> Self {
        // Serialisation only fails for maps whose keys are not strings, and an update has none.
        let json = serde_json::to_string(&update).unwrap_or_default().into();
        Self {
            update,
            json,
            scene,
            difference,
            patches: None,
            detections: Vec::new(),
            sensing: None,
            still: None,
            reference: None,
            at: Instant::now(),
        }
    }
}

/// What the updates describe: a model, and the calibration it was made for.
#[derive(Debug, Clone)]
pub struct Watched {
    /// The model.
    pub model: Arc<Model>,
    /// Number of the calibration in this run.
    pub calibration: u32,
    /// Why people who walk through the doorway are not told; none if they are.
    pub no_crossings: Option<String>,
}
