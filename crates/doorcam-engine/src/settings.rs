//! The settings of an engine: plain values with the program's defaults.

use doorcam_core::geometry::{GridSpec, Leaf, Point, Room, RoomLight};
use doorcam_core::light::Averaging;
use doorcam_core::optics::{Lens, Transfer};
use doorcam_core::scene::Brightness;
use doorcam_core::solver::{Lambda, ModelKind};
use doorcam_core::tracking::likelihood::MOST_PEOPLE;
use doorcam_core::tracking::{Dwelling, TrackerSettings, Zone};
use doorcam_core::transport::Kernel;

/// Everything that decides how frames become updates, apart from the doorway and the camera. The caller is responsible
/// for the values: the engine only checks what depends on the doorway.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// How images become light on the patches.
    pub preprocessing: Preprocessing,
    /// Extent of the hidden room and its facets.
    pub grid: GridSpec,
    /// The floor patches.
    pub patch: PatchSettings,
    /// Falloff law of the light transport.
    pub kernel: Kernel,
    /// Height of the facets, in metres.
    pub facet_height_m: f64,
    /// The inverse problem.
    pub solver: SolverSettings,
    /// Threshold t of eq. 15, relative to the largest |c|.
    pub unified_threshold: f64,
    /// Which brightness the figures show.
    pub brightness: Brightness,
    /// Averaging of frames in time.
    pub averaging: AveragingSettings,
    /// How the picture of the empty room is learned and followed.
    pub background: BackgroundSettings,
    /// How people are followed.
    pub tracker: TrackerSettings,
    /// When somebody dwells.
    pub dwelling: Dwelling,
    /// Named parts of the room.
    pub zones: Vec<Zone>,
    /// Whether to tell who walks through the doorway.
    pub crossings: bool,
    /// Lens of cameras whose calibration has none.
    pub lens: Option<Lens>,
    /// Transfer function of cameras whose calibration has none.
    pub transfer: Transfer,
    /// How far a camera may move, in pixels, for the calibration to follow it; 0 for never.
    pub follow_px: f64,
    /// The door's leaf, for doorways whose calibration or recording has none.
    pub leaf: Option<Leaf>,
    /// Bright things of the room that are known.
    pub lights: Vec<RoomLight>,
}

/// How images become light on the patches.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Preprocessing {
    /// The transfer function is undone, JPEGs are decoded exactly, each pixel is the mean over its square of floor.
    Linear,
    /// As in the authors' program: codes are taken for light, JPEGs decoded to 8 bits, bicubic resampling, pixels on
    /// the patch's border.
    Published,
}

/// The floor patches.
#[derive(Debug, Clone, PartialEq)]
pub struct PatchSettings {
    /// Side of the square of floor that is used, in metres; smaller if a recording shows less.
    pub fov_m: f64,
    /// Pixels along each side.
    pub pixels: usize,
    /// Parts of the floor that do not count: two opposite corners each, in metres in the door frame.
    pub exclude: Vec<[Point; 2]>,
}

/// The inverse problem, eq. 13.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SolverSettings {
    /// Which changes a facet may show.
    pub model: ModelKind,
    /// The penalty's weight, λ.
    pub lambda: Lambda,
    /// Automatic λ: factor on what the empty room's noise reaches in one frame of a thousand.
    pub lambda_factor: f64,
    /// Automatic λ: at least this share of λ_max, the smallest λ with an empty map.
    pub lambda_share: f64,
    /// Maximum number of solver steps per frame.
    pub max_steps: usize,
}

/// Averaging of frames in time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AveragingSettings {
    /// Kind of average.
    pub mode: Averaging,
    /// Its time in seconds.
    pub time_s: f64,
}

/// How the picture of the empty room is learned and followed. Times are in seconds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BackgroundSettings {
    /// Stillness needed to learn the background at the start.
    pub learn_s: f64,
    /// Time after which the picture that came back most often is used, even without stillness.
    pub learn_max_s: f64,
    /// Stillness needed to learn it anew after a change of the light.
    pub relearn_s: f64,
    /// Time constant for following slow changes.
    pub adapt_s: f64,
    /// Time after which something that does not move becomes part of the room; 0 for never.
    pub absorb_s: f64,
    /// Time after which what lies still on a patch becomes part of its floor.
    pub cover_s: f64,
    /// Maximum time between two rebuilds of the problem.
    pub rebuild_s: f64,
    /// Sudden change of the light that makes the background be learned anew, as a share of the light.
    pub light_step: f64,
    /// Time between two saves.
    pub save_s: f64,
    /// Maximum age of a saved background that is used.
    pub keep_s: f64,
}

/// How far people are looked for in a room of which nobody has said how large it is.
const UNKNOWN_ROOM: Room = Room { half_width_m: 2.2, depth_m: 4.2 };

/// The part of the hidden side where people are looked for and followed, from the part that the map covers: the same,
/// unless that is the default. Then the walls may be farther away.
pub fn searched(mapped: Room) -> Room {
    if mapped == Room::default() { UNKNOWN_ROOM } else { mapped }
}

impl Default for Settings {
    fn default() -> Self {
        let grid = GridSpec::published();
        Self {
            preprocessing: Preprocessing::Linear,
            grid,
            patch: PatchSettings { fov_m: 0.3, pixels: 64, exclude: Vec::new() },
            kernel: Kernel::Radiometric,
            facet_height_m: 2.0,
            solver: SolverSettings {
                model: ModelKind::Signed,
                lambda: Lambda::Auto,
                lambda_factor: 1.0,
                lambda_share: 0.2,
                max_steps: 400,
            },
            unified_threshold: 0.07,
            brightness: Brightness::Measured,
            averaging: AveragingSettings { mode: Averaging::None, time_s: 0.5 },
            background: BackgroundSettings::default(),
            tracker: TrackerSettings {
                room: searched(grid.room),
                margin_m: 0.2,
                body_radius_m: 0.2,
                confirm_s: 0.4,
                coast_s: 1.5,
                max_people: MOST_PEOPLE,
            },
            dwelling: Dwelling { seconds: 10.0, radius_m: 0.4 },
            zones: Vec::new(),
            crossings: true,
            lens: None,
            transfer: Transfer::Srgb,
            follow_px: 10.0,
            leaf: None,
            lights: Vec::new(),
        }
    }
}

impl Default for BackgroundSettings {
    fn default() -> Self {
        Self {
            learn_s: 5.0,
            learn_max_s: 30.0,
            relearn_s: 2.0,
            adapt_s: 60.0,
            absorb_s: 1800.0,
            cover_s: 10.0,
            rebuild_s: 300.0,
            light_step: 0.02,
            save_s: 600.0,
            keep_s: 43_200.0,
        }
    }
}

impl Settings {
    /// The authors' program: its preprocessing, 0.15 m patches, kernel, model, grid and brightness; λ = 0.05.
    pub fn published() -> Self {
        let settings = Self::default();
        Self {
            preprocessing: Preprocessing::Published,
            patch: PatchSettings { fov_m: 0.15, ..settings.patch },
            kernel: Kernel::Published,
            solver: SolverSettings { model: ModelKind::Published, ..settings.solver },
            brightness: Brightness::Shrunk,
            ..settings
        }
    }
}
