use std::f64::consts::PI;
use std::sync::OnceLock;

use crate::{Preprocessing, Settings};
use doorcam_core::geometry::{Doorway, FacetGrid, GeometryError, Point, Room, RoomLight, Side};
use doorcam_core::light::FanPair;
use doorcam_core::scene::{Brightness, Neighbourhood};
use doorcam_core::solver::{Lambda, Limits, ModelKind};
use doorcam_core::tracking::likelihood::BodyTable;
use doorcam_core::transport::edge_foot_mask;
use doorcam_core::transport::{PastLeaf, PatchGrid, PixelLayout, Transport, TransportSpec};

/// Why a configuration and a doorway do not make a valid model.
#[derive(Debug, thiserror::Error)]
pub enum SetupError {
    /// Doorway, room and grid do not fit together.
    #[error(transparent)]
    Geometry(#[from] GeometryError),
    /// The calibration does not determine the camera.
    #[error(transparent)]
    Calibration(#[from] doorcam_core::calibration::CalibrationError),
    /// Too much of a patch is excluded.
    #[error("patch.exclude leaves {count} pixels of the {side} patch, expected at least {least}")]
    PatchExcluded {
        /// Which patch.
        side: &'static str,
        /// Pixels that count.
        count: usize,
        /// How many are needed.
        least: usize,
    },
    /// Too few pixels of a patch are left, though nothing is excluded or it makes no difference.
    #[error(
        "only {count} pixels of the {side} patch count, expected at least {least}: {seen} are seen, apart from those at \
         the foot of the edge, which never count (patch.pixels is {pixels})"
    )]
    PatchTooSmall {
        /// Which patch.
        side: &'static str,
        /// Pixels that count.
        count: usize,
        /// Pixels that are seen and not at the foot of the edge.
        seen: usize,
        /// How many are needed.
        least: usize,
        /// Pixels along a side of the patch.
        pixels: usize,
    },
}

/// Height of a person, in metres: accurate enough for anybody who stands.
pub(crate) const BODY_HEIGHT_M: f64 = 1.7;

/// With fewer pixels than this, facets cannot be told apart.
const LEAST_PIXELS: usize = 64;

/// Everything that is known before the first frame: geometry, transport, and the choices of the configuration.
/// Positions are in the door frame, in metres.
#[derive(Debug, Clone)]
pub struct Model {
    /// The doorway.
    pub doorway: Doorway,
    /// The facets of the map.
    pub grid: FacetGrid,
    /// The floor patches.
    pub patch: PatchGrid,
    /// How A_L and A_R (eq. 12) are calculated.
    pub transport: TransportSpec,
    /// Per side and pixel, row by row from the wall, whether the pixel counts: seen, not excluded and not at the foot
    /// of the edge.
    pub counted: [Vec<bool>; 2],
    /// Which changes a facet may show.
    pub kind: ModelKind,
    /// λ of eq. 13.
    pub lambda: Lambda,
    /// Automatic λ: factor on what the noise reaches.
    pub lambda_factor: f64,
    /// Automatic λ: smallest share of the frame's λ_max.
    pub lambda_share: f64,
    /// When the solver stops.
    pub limits: Limits,
    /// Which facets are neighbours.
    pub neighbourhood: Neighbourhood,
    /// The counted pixels, gathered by angle around the edges.
    pub fans: FanPair,
    /// A person's radius, in metres.
    pub body_radius_m: f64,
    /// Where people are looked for.
    pub searched: Room,
    /// How far outside it people may also be, in metres.
    pub margin_m: f64,
    /// Bright things of the room that are known.
    pub lights: Vec<RoomLight>,
    bodies: OnceLock<BodyTable>,
    /// t of eq. 15, relative to the largest |c|.
    pub unified_threshold: f64,
    /// Which brightness the figures show.
    pub brightness: Brightness,
}

impl Model {
    /// The patches that a configuration asks for, no larger than the side of floor that the source shows, in metres.
    pub fn patch_grid(settings: &Settings, shown_fov_m: Option<f64>) -> PatchGrid {
        PatchGrid {
            size: settings.patch.pixels,
            fov_m: shown_fov_m.map_or(settings.patch.fov_m, |shown| shown.min(settings.patch.fov_m)),
            layout: match settings.preprocessing {
                Preprocessing::Published => PixelLayout::EndsIncluded,
                Preprocessing::Linear => PixelLayout::Cells,
            },
        }
    }

    /// Builds the model of a doorway. `seen` tells, per side and pixel, what the source shows; `None` if all of it.
    ///
    /// # Errors
    ///
    /// If doorway, room and grid do not fit together, or if fewer than 64 pixels of a patch count.
    pub fn new(
        settings: &Settings,
        doorway: Doorway,
        patch: PatchGrid,
        seen: Option<[Vec<bool>; 2]>,
    ) -> Result<Self, SetupError> {
        let (grid, counted) = Self::layout(settings, &doorway, &patch, seen)?;
        let spec = TransportSpec { kernel: settings.kernel, facet_height_m: settings.facet_height_m, patch };
        let past_leaf = PastLeaf::new(&doorway, &patch);
        let step = PI / settings.grid.intervals as f64;
        let neighbourhood = Neighbourhood::new(&doorway, &grid, step, past_leaf.as_ref());
        Ok(Self {
            neighbourhood,
            fans: FanPair::new(&doorway, &patch, &counted),
            body_radius_m: settings.tracker.body_radius_m,
            searched: settings.tracker.room,
            margin_m: settings.tracker.margin_m,
            lights: settings.lights.clone(),
            bodies: OnceLock::new(),
            doorway,
            patch,
            transport: spec,
            counted,
            kind: settings.solver.model,
            lambda: settings.solver.lambda,
            lambda_factor: settings.solver.lambda_factor,
            lambda_share: settings.solver.lambda_share,
            limits: Limits { sweeps: settings.solver.max_steps, ..Limits::default() },
            unified_threshold: settings.unified_threshold,
            brightness: settings.brightness,
            grid,
        })
    }

    /// Checks what [`Self::new`] would refuse, without the work of building a model.
    ///
    /// # Errors
    ///
    /// As [`Self::new`].
    pub fn check(
        settings: &Settings,
        doorway: &Doorway,
        patch: &PatchGrid,
        seen: Option<[Vec<bool>; 2]>,
    ) -> Result<(), SetupError> {
        Self::layout(settings, doorway, patch, seen).map(drop)
    }

    /// The facets, and per side which pixels count.
    fn layout(
        settings: &Settings,
        doorway: &Doorway,
        patch: &PatchGrid,
        seen: Option<[Vec<bool>; 2]>,
    ) -> Result<(FacetGrid, [Vec<bool>; 2]), SetupError> {
        let grid = FacetGrid::new(doorway, &settings.grid)?;
        let foot = edge_foot_mask(patch);
        let excluded = |side: Side, k: usize| {
            let point = patch.point(doorway, side, k / patch.size, k % patch.size);
            settings.patch.exclude.iter().any(|corners| lies_between(corners, point))
        };
        let mut counted: [Vec<bool>; 2] = match seen {
            None => [foot.clone(), foot],
            Some(seen) => seen.map(|side| side.iter().zip(&foot).map(|(&s, &f)| s && f).collect()),
        };
        for (counted, side) in counted.iter_mut().zip(Side::BOTH) {
            let number = |counted: &[bool]| counted.iter().filter(|&&c| c).count();
            let seen = number(counted);
            counted.iter_mut().enumerate().for_each(|(k, counts)| *counts &= !excluded(side, k));
            let count = number(counted);
            let (side, least, pixels) = (side.name(), LEAST_PIXELS, patch.size);
            if seen < least {
                return Err(SetupError::PatchTooSmall { side, count, seen, least, pixels });
            }
            if count < least {
                return Err(SetupError::PatchExcluded { side, count, least });
            }
        }
        Ok((grid, counted))
    }

    /// A_L and A_R, calculated anew each time: they are by far the largest data here and only needed to build a
    /// problem.
    pub fn matrices(&self) -> Transport {
        Transport::new(&self.doorway, &self.grid.facets, &self.transport)
    }

    /// How people anywhere in the room change the patches; calculated on first use.
    pub fn bodies(&self) -> &BodyTable {
        self.bodies
            .get_or_init(|| BodyTable::new(&self.doorway, &self.patch, &self.fans, self.body_radius_m, BODY_HEIGHT_M))
    }

    /// Whether [`Self::bodies`] has been called.
    #[cfg(test)]
    pub(crate) fn knows_bodies(&self) -> bool {
        self.bodies.get().is_some()
    }
}

/// Whether a floor point lies in the rectangle with these opposite corners.
fn lies_between(corners: &[Point; 2], point: Point) -> bool {
    (0..2).all(|k| {
        let (a, b) = (corners[0][k], corners[1][k]);
        (a.min(b)..=a.max(b)).contains(&point[k])
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn too_few_pixels_are_blamed_on_what_takes_them() {
        let doorway = Doorway { width_m: 0.8, wall_thickness_m: 0.1, height_m: None, leaf: None };
        let mut settings = Settings::default();
        settings.patch.pixels = 32;
        let patch = Model::patch_grid(&settings, None);
        let error = |settings: &Settings, patch: PatchGrid, seen: Option<[Vec<bool>; 2]>| {
            Model::new(settings, doorway, patch, seen).map(drop).expect_err("too few").to_string()
        };
        // The camera sees only three rows, far from the edge's foot.
        let rows = |from: usize| (0..32 * 32).map(|k| k / 32 >= from).collect::<Vec<bool>>();
        let unseen = error(&settings, patch, Some([rows(0), rows(31)]));
        assert!(
            unseen.starts_with("only 32 pixels of the right patch count, expected at least 64: 32 are seen"),
            "{unseen}"
        );
        settings.patch.exclude = vec![[[9.0, -9.0], [-9.0, 0.0]]];
        let excluded = error(&settings, patch, Some([rows(0), rows(0)]));
        assert_eq!(excluded, "patch.exclude leaves 0 pixels of the left patch, expected at least 64");
        let both = error(&settings, patch, Some([rows(31), rows(0)]));
        assert!(both.starts_with("only 0 pixels of the left patch count, expected at least 64: 32 are seen"), "{both}");
        let small = error(&Settings::default(), PatchGrid { size: 6, ..patch }, None);
        assert!(small.contains("(patch.pixels is 6)"), "{small}");
    }

    #[test]
    fn excluded_floor_does_not_count() {
        let doorway = Doorway { width_m: 0.8, wall_thickness_m: 0.1, height_m: None, leaf: None };
        let mut settings = Settings::default();
        settings.patch.pixels = 32;
        let patch = Model::patch_grid(&settings, None);
        let whole = Model::new(&settings, doorway, patch, None).unwrap();
        // The half of the right patch that is farther from the wall: y below -0.25.
        settings.patch.exclude = vec![[[0.8, -0.25], [0.0, -9.0]]];
        let part = Model::new(&settings, doorway, patch, None).unwrap();
        assert_eq!(part.counted[0], whole.counted[0]);
        for k in 0..patch.pixels() {
            assert_eq!(part.counted[1][k], whole.counted[1][k] && k / 32 < 16, "row {}", k / 32);
        }
    }
}
