use nalgebra::{Cholesky, DMatrix, DVector};

use super::BodyTable;
use super::hidden_light::HiddenLight;
use super::place::Place;
use super::whitened::Whitened;
use crate::geometry::{Doorway, Room, Side};
use crate::light::{FanPair, PatchPair};
use crate::still_room::StillRoom;
use crate::transport::{FloorView, PastLeaf, PatchGrid};

/// Number of modes for smooth changes of the walls' light: half waves from wall to wall, and a constant.
const MODES: usize = 30;
/// Standard deviation of the first mode, as a share of the floor's level.
const MODE_SHARE: f64 = 0.1;
/// The k-th mode has a standard deviation of k^(−this) times the first: between steps of light (1) and bends (2).
const MODE_DECAY: f64 = 1.5;
/// How far beyond the known walls bodies may be, in metres, because rooms are not measured to the centimetre.
const BEYOND_M: f64 = 0.2;
/// Height of the walls for the modes of their light, in metres.
const ROOM_HEIGHT_M: f64 = 2.4;
/// Prior standard deviation of nuisance patterns, in units of their largest strength. Large enough not to restrain
/// them.
const ANY_STRENGTH: f64 = 2.0;
/// Most pixels of a fan's cell that one floor point stands for.
const GROUP: usize = 6;

/// Inputs of [`Likelihood::new`].
pub struct LikelihoodSpec<'a> {
    /// The doorway.
    pub doorway: &'a Doorway,
    /// The hidden room, for the light of its walls.
    pub room: &'a Room,
    /// Where people may be.
    pub searched: &'a Room,
    /// The patches.
    pub patch: &'a PatchGrid,
    /// Cells into which the patches' pixels are grouped.
    pub fans: &'a FanPair,
    /// Effect of bodies on these cells.
    pub table: &'a BodyTable,
    /// Per side and pixel, the inverse standard deviation of the noise; 0 where it is not known.
    pub weights: &'a [Vec<f64>; 2],
    /// Per side, nuisance patterns over the pixels, in linear light at their largest possible strength.
    pub patterns: [Vec<Vec<f64>>; 2],
    /// Frames of the empty room; may be empty.
    pub empty: &'a [&'a PatchPair],
    /// Mean light of the empty room on the floor, relative to full scale.
    pub level: f64,
    /// What the room looks like while nobody is in it, if that is known.
    pub still: Option<&'a StillRoom>,
    /// Radius and height of a person, in metres, as in the table.
    pub body: [f64; 2],
}

/// Whitens differences (to numbers with independent noise of unit variance), and bodies likewise.
#[derive(Debug, Clone)]
pub struct Likelihood {
    fans: FanPair,
    /// Per side, the whitening matrix (cells of the fan x cells of the fan).
    whiten: [DMatrix<f32>; 2],
    pub(super) bodies: Whitened,
    /// Light level of the empty room, the scale of radiances.
    pub(super) level: f64,
    /// Whether it is known what people hide of bright things in the room.
    pub(super) bright: bool,
    walls: Room,
    leaf: Option<PastLeaf>,
}

/// A whitened difference.
#[derive(Debug, Clone)]
pub struct Measured {
    means: [DVector<f32>; 2],
    /// Whitened values per side and colour.
    pub(super) values: [[DVector<f32>; 3]; 2],
    /// Sum of the squared values.
    pub(super) energy: f64,
    /// Number of values.
    pub(super) count: f64,
    /// Per side, the share of the usual information that the frame has. Energy and products are multiplied by it.
    pub(super) trust: [f64; 2],
}

impl Measured {
    /// Takes only a share of each side's information for granted.
    pub(super) fn trust(&mut self, trust: [f64; 2]) {
        self.trust = trust;
        let energy = |s: usize| self.values[s].iter().map(|v| f64::from(v.norm_squared())).sum::<f64>();
        self.energy = trust[0] * energy(0) + trust[1] * energy(1);
        self.count =
            3.0 * (0..2).map(|s| if trust[s] > 0.0 { self.values[s][0].len() as f64 } else { 0.0 }).sum::<f64>();
    }

    /// Whether both sides say something.
    pub(super) fn shows_both(&self) -> bool {
        self.trust.iter().all(|&trust| trust > 0.0)
    }
}

/// Assumed variance of the empty room's noise after whitening, where there are too few frames to measure it. More than
/// 1, because compression and interpolation correlate neighbouring pixels.
const COLOURED: f64 = 4.0;
/// Fewest frames of the empty room from which that variance is measured.
const ENOUGH: usize = 4;

impl Likelihood {
    /// Precomputes what is needed for every frame. `None` if the covariance of the cells is singular.
    pub fn new(spec: &LikelihoodSpec<'_>) -> Option<Self> {
        let white = [whitening(spec, 0)?, whitening(spec, 1)?];
        let excess = excess(spec, &white).unwrap_or(COLOURED).max(1.0);
        let whiten = white.map(|matrix| (matrix / excess.sqrt()).map(|v| v as f32));
        let [radius_m, height_m] = spec.body;
        let still = spec.still.filter(|still| still.is_bright());
        let hidden =
            still.map(|still| HiddenLight::new(spec.doorway, spec.patch, spec.fans, still, radius_m, height_m));
        let bodies = Whitened::new(spec.table, hidden.as_ref(), &whiten);
        let bright = still.is_some();
        let leaf = PastLeaf::new(spec.doorway, spec.patch);
        Some(Self { fans: spec.fans.clone(), whiten, bodies, level: spec.level, bright, walls: *spec.searched, leaf })
    }

    /// Whether the left and the right patch see somebody at a place past the door's leaf.
    pub(super) fn sees(&self, place: Place) -> [bool; 2] {
        self.leaf.as_ref().map_or([true; 2], |leaf| leaf.sees(place.point()))
    }

    /// The nearest place at the same azimuth that is inside the room, with a tolerance for its walls.
    pub(super) fn inside(&self, place: Place) -> Place {
        let place = BodyTable::clamp(place);
        let [x, y] = place.point();
        let room = &self.walls;
        let beyond = (x.abs() / (room.half_width_m + BEYOND_M)).max(y / (room.depth_m + BEYOND_M));
        BodyTable::clamp(Place { log_range: place.log_range - beyond.max(1.0).ln(), ..place })
    }

    /// A workspace for [`Self::measure`].
    pub fn room(&self) -> Measured {
        let zeros = |s: usize| DVector::zeros(self.whiten[s].nrows());
        Measured {
            means: [zeros(0), zeros(1)],
            values: [0, 1].map(|s| [zeros(s), zeros(s), zeros(s)]),
            energy: 0.0,
            count: 3.0 * (self.whiten[0].nrows() + self.whiten[1].nrows()) as f64,
            trust: [1.0; 2],
        }
    }

    /// Whitens a difference into `out`.
    pub fn measure(&self, difference: &PatchPair, out: &mut Measured) {
        out.energy = 0.0;
        for (s, (fan, patch)) in self.fans.with(difference).into_iter().enumerate() {
            for c in 0..3 {
                fan.means_into(patch.plane(c), out.means[s].as_mut_slice());
                out.values[s][c].gemv(1.0, &self.whiten[s], &out.means[s], 0.0);
                out.energy += f64::from(out.values[s][c].norm_squared());
            }
        }
    }
}

/// Variance of the empty room's frames after whitening, which is 1 for white noise; `None` with too few frames.
fn excess(spec: &LikelihoodSpec<'_>, whiten: &[DMatrix<f64>; 2]) -> Option<f64> {
    let frames = spec.empty;
    if frames.len() < ENOUGH {
        return None;
    }
    let mut energy = 0.0;
    for (s, fan) in spec.fans.sides().into_iter().enumerate() {
        for c in 0..3 {
            let cells = |frame: &&PatchPair| {
                let plane = frame.side(Side::BOTH[s]).plane(c);
                DVector::from_vec(fan.means(|k| f64::from(plane[k])))
            };
            let mut cells = DMatrix::from_columns(&frames.iter().map(cells).collect::<Vec<_>>());
            let mean = cells.column_mean();
            cells.column_iter_mut().for_each(|mut cells| cells -= &mean);
            energy += (&whiten[s] * cells).norm_squared();
        }
    }
    let count = 3 * (whiten[0].nrows() + whiten[1].nrows());
    Some(energy / (count * (frames.len() - 1)) as f64)
}

/// Inverse of the lower Cholesky factor of the cells' covariance: noise, nuisance patterns and smooth light of the
/// walls.
fn whitening(spec: &LikelihoodSpec<'_>, s: usize) -> Option<DMatrix<f64>> {
    let fan = spec.fans.sides()[s];
    let weights = &spec.weights[s];
    // The variance of a mean of n values is 1/n² of the sum of theirs. A pixel without a weight counts as the noisiest.
    let least = weights.iter().copied().filter(|&w| w > 0.0).fold(f64::INFINITY, f64::min);
    let variance = |k: usize| weights[k].max(least).powi(-2);
    let noise: Vec<f64> = (fan.means(variance).into_iter().zip(fan.counts())).map(|(v, &n)| v / f64::from(n)).collect();
    let mut covariance = DMatrix::from_diagonal(&DVector::from_vec(noise));
    let mut add = |cells: DVector<f64>, variance: f64| covariance.ger(variance, &cells, &cells, 1.0);
    for pattern in &spec.patterns[s] {
        add(DVector::from_vec(fan.means(|k| pattern[k])), ANY_STRENGTH.powi(2));
    }
    for (k, mode) in wall_modes(spec, s).into_iter().enumerate() {
        add(mode, (MODE_SHARE * spec.level / (k.max(1) as f64).powf(MODE_DECAY)).powi(2));
    }
    let lower = Cholesky::new(covariance)?.unpack();
    let identity = DMatrix::identity(fan.len(), fan.len());
    let inverse = lower.solve_lower_triangular(&identity)?;
    inverse.iter().all(|v| v.is_finite()).then_some(inverse)
}

/// Effect of each mode of the walls' light on each cell.
fn wall_modes(spec: &LikelihoodSpec<'_>, s: usize) -> Vec<DVector<f64>> {
    let fan = spec.fans.sides()[s];
    let mut modes = vec![DVector::zeros(fan.len()); MODES];
    let mut light = [0.0; MODES];
    let points = spec.patch.points(spec.doorway, Side::BOTH[s]);
    for (cell, (group, &n)) in fan.groups(&points, GROUP).into_iter().zip(fan.counts()).enumerate() {
        for (point, weight) in group {
            FloorView::new(spec.doorway, point).walls(spec.doorway, spec.room, ROOM_HEIGHT_M, &mut light);
            modes.iter_mut().zip(light).for_each(|(mode, light)| mode[cell] += weight * light / f64::from(n));
        }
    }
    modes
}
