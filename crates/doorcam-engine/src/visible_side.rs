use doorcam_core::calibration::Camera;
use doorcam_core::geometry::{Doorway, Point, Side};
use doorcam_core::light::Usable;
use doorcam_core::transport::PatchGrid;
use doorcam_core::visible::{
    Cells, Crossing, Grid, Pose, Sighting, Silhouettes, StillScene, Thumbnail, Walker, Walkers,
};

/// Seconds between two looks at the whole picture: enough to follow somebody who walks, and cheap.
const LOOK_S: f64 = 0.15;
/// Most people who are looked for in one picture.
const MOST_WALKERS: usize = 3;
/// Covered cells from which somebody or something is there.
const SOMETHING: usize = 8;
/// Share of the places before the threshold at which a body has to be in the picture.
const LEAST_COVERAGE: f64 = 0.5;
/// The floor beside an edge that the hidden room hardly lights: distance from the edge along the wall, in metres, and how
/// steep the line from the edge's foot is at most.
const CORNER_M: std::ops::Range<f64> = 0.1..0.7;
const CORNER_SLOPE: f64 = 0.577;
const FEWEST_IN_CORNER: usize = 12;
/// How much that floor's light differs from usual, as a logarithm, if something on the visible side shades it: on one
/// side, or on one more than on the other. People in the room hardly reach it, and exposure and slow changes of the light
/// change both sides alike: in path-traced recordings by up to 0.06.
const SHADE: f32 = 0.08;
const SHADE_ON_ONE: f32 = 0.04;
/// What lasts longer than this, in seconds, is no shadow of somebody who passes, and what does not change for as long is that
/// of something that was put down.
const SHADOW_S: f64 = 10.0;
/// How much that floor's light may change, as a logarithm, while it counts as unchanged.
const STEADY: f32 = 0.02;
/// How long after the last sign of somebody on the visible side their shadow may still be there, in seconds.
const CALM_S: f64 = 1.0;

/// Looks at the camera's own side: what covers the floor there, and who goes through the doorway.
#[derive(Debug, Clone)]
pub(crate) struct VisibleSide {
    thumbnail: Thumbnail,
    scene: StillScene,
    covered: Cells,
    silhouettes: Silhouettes,
    walkers: Walkers,
    sightings: Vec<Sighting>,
    crossings: Vec<Crossing>,
    /// Per side and pixel of the patches, the cell that shows it.
    cells: [Vec<Option<usize>>; 2],
    /// What was covered when it was last looked at.
    covered_before: Cells,
    /// Cells of the floor beside each edge that the hidden room hardly lights.
    corners: [Vec<usize>; 2],
    looked_s: Option<f64>,
    busy_s: Option<f64>,
    /// When the visible side's light was last seen to differ from usual, and since when it has.
    shaded_s: Option<f64>,
    since_s: Option<f64>,
    /// The light of the corners, as logarithms, and since when it has been so.
    steady: Option<([f32; 2], f64)>,
}

impl VisibleSide {
    /// What a camera with pictures of `size` (width, height) sees around a doorway.
    ///
    /// # Errors
    /// In words, why people who walk through cannot be told.
    pub(crate) fn new(
        camera: &Camera,
        size: [usize; 2],
        doorway: &Doorway,
        patch: &PatchGrid,
    ) -> Result<Self, &'static str> {
        let grid = Grid::new(size);
        let pose = Pose::of(camera, size).ok_or("the calibration does not tell where the camera is")?;
        let silhouettes = Silhouettes::new(&pose, grid, doorway);
        if silhouettes.coverage(doorway) < LEAST_COVERAGE {
            return Err("the picture shows too little of the threshold and the floor before it");
        }
        let cells = Side::BOTH.map(|side| {
            let cell = |k: usize| {
                let point = patch.point(doorway, side, k / patch.size, k % patch.size);
                camera.project(point).and_then(|pixel| grid.at(pixel))
            };
            (0..patch.pixels()).map(cell).collect()
        });
        let corner = |side: Side| {
            let sign = if side == Side::Left { -1.0 } else { 1.0 };
            let beside = move |[x, y]: Point| {
                let (out, ahead) = (sign * x - doorway.half_width(), -doorway.wall_thickness_m - y);
                CORNER_M.contains(&out) && ahead > 0.03 && ahead < CORNER_SLOPE * out
            };
            let floor = |cell: &usize| camera.floor(grid.centre(*cell)).is_some_and(beside);
            (0..grid.len()).filter(floor).collect()
        };
        Ok(Self {
            covered_before: Cells::new(grid.len()),
            corners: Side::BOTH.map(corner),
            shaded_s: None,
            since_s: None,
            steady: None,
            thumbnail: Thumbnail::new(grid),
            scene: StillScene::new(grid),
            covered: Cells::new(grid.len()),
            silhouettes,
            walkers: Walkers::new(doorway),
            sightings: Vec::with_capacity(MOST_WALKERS),
            crossings: Vec::new(),
            cells,
            looked_s: None,
            busy_s: None,
        })
    }

    /// Whether it is time for another look, which needs the whole picture.
    pub(crate) fn is_due(&self, seconds: f64) -> bool {
        self.looked_s.is_none_or(|last| !(0.0..LOOK_S - 1e-6).contains(&(seconds - last)))
    }

    /// The picture to fill for a look.
    pub(crate) fn picture(&mut self) -> &mut Thumbnail {
        &mut self.thumbnail
    }

    /// Looks at the picture that was filled. `learning`: the empty room is being learned, so nobody should be there.
    pub(crate) fn look(&mut self, seconds: f64, learning: bool) {
        let step_s = self.looked_s.replace(seconds).map_or(0.0, |last| (seconds - last).clamp(0.0, 1.0));
        if learning {
            self.scene.learn(&self.thumbnail);
            self.covered.clear();
            return;
        }
        // A shadow that passes must not become a part of the scene.
        let shadow = self.since_s.is_some_and(|since| (0.0..SHADOW_S).contains(&(seconds - since)));
        self.covered_before.copy_from(&self.covered);
        self.scene.compare(&self.thumbnail, step_s, !shadow, &mut self.covered);
        self.silhouettes.find(&self.covered, MOST_WALKERS, &mut self.sightings);
        self.crossings.clear();
        self.crossings.extend_from_slice(self.walkers.step(seconds, &self.sightings));
        // What lies still disturbs nothing but the pixels that it covers.
        let somebody = self.walkers.all().iter().any(Walker::is_somebody);
        if somebody || self.covered.different(&self.covered_before) >= SOMETHING {
            self.busy_s = Some(seconds);
        }
        let steady_s = self.steady_s(seconds);
        if !self.is_shaded() {
            self.since_s = None;
        } else if steady_s >= SHADOW_S && !self.is_busy(seconds) {
            // From now on, the light beside a bag that lies there is the usual one.
            self.corners.iter().flatten().for_each(|&cell| self.scene.accept(cell));
            self.since_s = None;
        } else {
            self.since_s.get_or_insert(seconds);
            self.shaded_s = Some(seconds);
        }
    }

    /// For how long the floor beside the edges has been lit as it is, in seconds.
    fn steady_s(&mut self, seconds: f64) -> f64 {
        let light = self.corners.each_ref().map(|cells| self.scene.light(cells));
        let same = |then: &[f32; 2]| then.iter().zip(light).all(|(then, now)| (then - now).abs() <= STEADY);
        match self.steady {
            Some((then, since)) if same(&then) && seconds >= since => seconds - since,
            _ => {
                self.steady = Some((light, seconds));
                0.0
            }
        }
    }

    /// Whether the floor beside the edges, which people in the room hardly light or darken, is lit otherwise than usual.
    /// A change that both corners share may be one of the camera's exposure.
    fn is_shaded(&self) -> bool {
        let [left, right] = self.corners.each_ref().map(|cells| {
            let tells = cells.len() >= FEWEST_IN_CORNER;
            tells.then(|| self.scene.lighter(cells))
        });
        let apart = left.zip(right).is_some_and(|(left, right)| (left - right).abs() > SHADE_ON_ONE);
        apart || [left, right].into_iter().flatten().any(|lighter| lighter.abs() > SHADE)
    }

    /// What has become certain since it was last asked for.
    pub(crate) fn take_crossings(&mut self) -> Vec<Crossing> {
        std::mem::take(&mut self.crossings)
    }

    /// Who is there.
    pub(crate) fn walkers(&self) -> &Walkers {
        &self.walkers
    }

    /// Whether the newest look shows somebody, or something of the size of a body.
    pub(crate) fn is_someone_there(&self) -> bool {
        !self.sightings.is_empty()
    }

    /// Whether somebody at a place (m, door frame) would be in the picture, and is not.
    pub(crate) fn is_absent(&self, place: Point) -> bool {
        self.silhouettes.is_absent(place, &self.covered)
    }

    /// Takes what covers these pixels of the patches for a part of the scene.
    pub(crate) fn accept(&mut self, pixels: &Usable) {
        for (side, cells) in Side::BOTH.into_iter().zip(&self.cells) {
            let learned = cells.iter().zip(pixels.side(side)).filter(|(_, learned)| **learned);
            learned.filter_map(|(cell, _)| *cell).for_each(|cell| self.scene.accept(cell));
        }
    }

    /// Something on the visible side disturbs the patches at this time.
    pub(crate) fn disturb(&mut self, seconds: f64) {
        self.busy_s = Some(seconds);
    }

    /// Whether somebody is on the visible side, or has been a moment ago.
    pub(crate) fn is_busy(&self, seconds: f64) -> bool {
        self.busy_s.is_some_and(|last| (0.0..CALM_S).contains(&(seconds - last)))
    }

    /// Whether somebody on the visible side may look like somebody in the room: they are there, or their shadow is.
    pub(crate) fn is_doubtful(&self, seconds: f64) -> bool {
        let shaded = self.shaded_s.is_some_and(|last| (0.0..CALM_S).contains(&(seconds - last)));
        shaded || self.is_busy(seconds)
    }

    /// Takes out the pixels of the patches that the newest look shows covered.
    pub(crate) fn mask(&self, usable: &mut Usable) {
        for (side, cells) in Side::BOTH.into_iter().zip(&self.cells) {
            for (usable, cell) in usable.side_mut(side).iter_mut().zip(cells) {
                *usable &= !cell.is_some_and(|cell| self.covered.has(cell));
            }
        }
    }
}
