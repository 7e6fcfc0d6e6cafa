use nalgebra::{Cholesky, DMatrix, DVector};

use super::BodyTable;
use super::place::Place;
use super::whitened::Whitened;
use crate::geometry::{Doorway, Room, Side};
use crate::light::{FanPair, PatchPair};
use crate::transport::{FloorView, PatchGrid};

/// Smooth changes of the walls' light: half waves from wall to wall, and the constant.
const MODES: usize = 30;
/// How strong the first of them may be: standard deviation, as a share of the floor's level.
const MODE_SHARE: f64 = 0.1;
/// The k-th may be k to the minus this of it: between what steps of light do (1) and what bends do (2).
const MODE_DECAY: f64 = 1.5;
/// How far beyond the walls that are known bodies may be, in metres: rooms are not measured to the centimetre.
const BEYOND_M: f64 = 0.2;
/// Height of the room, for these.
const ROOM_HEIGHT_M: f64 = 2.4;
/// Standard deviation of what may be of any strength, in units of what it is in full: more than it ever is.
const ANY_STRENGTH: f64 = 2.0;
/// Pixels of a fan's cell that one floor point stands for.
const GROUP: usize = 6;

/// What a likelihood is made of.
pub struct LikelihoodSpec<'a> {
    /// The doorway.
    pub doorway: &'a Doorway,
    /// The room.
    pub room: &'a Room,
    /// The patches.
    pub patch: &'a PatchGrid,
    /// How their pixels are gathered.
    pub fans: &'a FanPair,
    /// What bodies do to them.
    pub table: &'a BodyTable,
    /// Per side and pixel, one over the noise's standard deviation; 0 where there is none to be had.
    pub weights: &'a [Vec<f64>; 2],
    /// Per side, patterns over the pixels that may be in a difference at any strength, as strong as they could be at most.
    pub patterns: [Vec<Vec<f64>>; 2],
    /// Frames of the empty room, or none.
    pub empty: &'a [&'a PatchPair],
    /// The empty room's level, relative to full scale.
    pub level: f64,
}

/// Turns differences into numbers with independent noise of unit variance, and bodies into what they do to these.
#[derive(Debug, Clone)]
pub struct Likelihood {
    fans: FanPair,
    /// Per side, what whitens: of as many rows and columns as the fan has cells.
    whiten: [DMatrix<f32>; 2],
    pub(super) bodies: Whitened,
    /// The level of the empty room: the scale of radiances.
    pub(super) level: f64,
    walls: Room,
}

/// A difference, whitened.
#[derive(Debug, Clone)]
pub struct Measured {
    means: [DVector<f32>; 2],
    /// Per side and colour.
    pub(super) values: [[DVector<f32>; 3]; 2],
    /// Their squares' sum.
    pub(super) energy: f64,
    /// How many they are.
    pub(super) count: f64,
}

/// In how many directions noise of the empty room is more than white noise where there are no frames to tell: compression
/// and interpolation.
const COLOURED: f64 = 4.0;
/// Frames of the empty room from which on they tell.
const ENOUGH: usize = 4;

impl Likelihood {
    /// Builds what is needed for every frame. None if noise and patterns leave nothing.
    pub fn new(spec: &LikelihoodSpec<'_>) -> Option<Self> {
        let white = [whitening(spec, 0)?, whitening(spec, 1)?];
        let excess = excess(spec, &white).unwrap_or(COLOURED).max(1.0);
        let whiten = white.map(|matrix| (matrix / excess.sqrt()).map(|v| v as f32));
        let bodies = Whitened::new(spec.table, &whiten);
        Some(Self { fans: spec.fans.clone(), whiten, bodies, level: spec.level, walls: *spec.room })
    }

    /// The nearest place along the same azimuth that is in the room, as far as walls are known.
    pub(super) fn inside(&self, place: Place) -> Place {
        let place = BodyTable::clamp(place);
        let [x, y] = place.point();
        let room = &self.walls;
        let beyond = (x.abs() / (room.half_width_m + BEYOND_M)).max(y / (room.depth_m + BEYOND_M));
        BodyTable::clamp(Place { log_range: place.log_range - beyond.max(1.0).ln(), ..place })
    }

    /// Room for a frame.
    pub fn room(&self) -> Measured {
        let zeros = |s: usize| DVector::zeros(self.whiten[s].nrows());
        Measured {
            means: [zeros(0), zeros(1)],
            values: [0, 1].map(|s| [zeros(s), zeros(s), zeros(s)]),
            energy: 0.0,
            count: 3.0 * (self.whiten[0].nrows() + self.whiten[1].nrows()) as f64,
        }
    }

    /// Whitens a difference.
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

/// The variance of the empty room's own frames once they are whitened, which is 1 for white noise.
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

/// The inverse of the lower Cholesky factor of noise, patterns and smooth light of the walls, cell by cell.
fn whitening(spec: &LikelihoodSpec<'_>, s: usize) -> Option<DMatrix<f64>> {
    let fan = spec.fans.sides()[s];
    let weights = &spec.weights[s];
    // A mean of n values has 1/n² of their variances' sum; a pixel without a weight counts as one of the noisiest.
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

/// What smooth light of the walls does to each cell, mode by mode.
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
