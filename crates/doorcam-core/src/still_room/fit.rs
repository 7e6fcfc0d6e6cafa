use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::surfaces::Surfaces;
use super::{StillRoom, bright, least_squares};
use crate::geometry::{Doorway, Room, RoomLight, Side};
use crate::light::{FanPair, Floor, PatchPair};
use crate::scene::Rgb;
use crate::transport::{FloorView, PatchGrid};

/// Assumed error of the model in a cell, relative to the floor's level: walls are not where they are thought to be, and
/// the visible side's light is not quite even.
const MODEL_ERROR: f64 = 0.004;
/// Patterns of the visible side's light on a patch: even, and slopes along x and y.
const VISIBLE: usize = 3;
/// Standard deviation of the slopes across a patch, relative to the floor's level.
const SLOPE: f64 = 0.02;
/// Standard deviation of the difference between neighbouring pieces, relative to the mean radiance.
const BETWEEN: f64 = 0.3;
/// Larger differences, at the borders of lamps and windows, count less: their information falls with this power of their
/// square. With 1, their number alone would count; with 0, borders would be blurred.
const BORDERS: f64 = 0.8;
/// Standard deviation of each piece's radiance, relative to the mean.
const EACH: f64 = 10.0;
/// How often cells that fit badly, and borders between pieces, are weighed anew.
const ROUNDS: usize = 6;
/// A residual of this many typical ones counts half.
const OUTLYING: f64 = 2.5;
/// Most pixels of a cell that one floor point stands for.
const GROUP: usize = 8;
/// Share of the floor's light that comes from the hidden room in the first guess.
const GUESSED_SHARE: f64 = 0.5;

/// Inputs of [`StillRoom::fit`].
pub struct Empty<'a> {
    /// The doorway.
    pub doorway: &'a Doorway,
    /// Where the walls are, roughly: only directions matter much.
    pub room: Room,
    /// Lights that are known to be there. Those that are lit have the place and size that they are said to have; their
    /// strength is found.
    pub lights: &'a [RoomLight],
    /// The patches.
    pub patch: &'a PatchGrid,
    /// Cells into which the patches' pixels are grouped.
    pub fans: &'a FanPair,
    /// The picture of the empty floor in linear light.
    pub picture: &'a PatchPair,
    /// The floor's texture.
    pub floors: &'a [Floor; 2],
}

impl StillRoom {
    /// Explains the picture of the empty floor by light from the room's surfaces and from the visible side. `None` if
    /// there is no light.
    pub fn fit(empty: &Empty<'_>) -> Option<Self> {
        let surfaces = Surfaces::new(empty.room, empty.lights);
        let pieces = surfaces.pieces();
        let matrix = matrix(empty, &surfaces);
        let light: Vec<[f64; 3]> = (0..2).flat_map(|s| cells_of(empty, s)).collect();
        let level = light.iter().flatten().sum::<f64>() / (3 * light.len()).max(1) as f64;
        let seen = matrix.columns(0, pieces).sum() / light.len().max(1) as f64;
        if !(level > 0.0 && seen > 0.0) {
            return None;
        }
        let mean = GUESSED_SHARE * level / seen;
        let neighbours = surfaces.neighbours();
        let bounded: Vec<bool> =
            (0..matrix.ncols()).map(|k| k < pieces || (k - pieces).is_multiple_of(VISIBLE)).collect();
        let observed = [0, 1, 2].map(|c| DVector::from_iterator(light.len(), light.iter().map(|rgb| rgb[c])));
        let grey = (&observed[0] + &observed[1] + &observed[2]) / 3.0;
        let pull = (EACH * mean).powi(-2) * mean;
        let solve = |weighed: &Weighed, observed: &DVector<f64>, start: &DVector<f64>| {
            let mut gradient = weighed.rows.tr_mul(observed);
            (0..pieces).for_each(|k| gradient[k] += pull);
            least_squares::minimise(&weighed.hessian, &gradient, &bounded, start)
        };
        // Which cells and borders to trust is found in grey.
        let mut values = DVector::from_fn(matrix.ncols(), |k, _| if k < pieces { mean } else { level });
        let mut weights = DVector::from_element(light.len(), (MODEL_ERROR * level).powi(-2));
        let mut ties = vec![(BETWEEN * mean).powi(-2); neighbours.len()];
        let mut left = DVector::zeros(light.len());
        let mut weighed = None;
        for _ in 0..ROUNDS {
            let with = Weighed::new(&matrix, &weights, &neighbours, &ties, pieces, [mean, level]);
            values = solve(&with, &grey, &values)?;
            weighed = Some(with);
            left = &grey - &matrix * &values;
            let mut sizes: Vec<f64> = left.iter().map(|left: &f64| left.abs()).collect();
            let middle = sizes.len() / 2;
            let typical = *sizes.select_nth_unstable_by(middle, f64::total_cmp).1;
            let usual = (1.4826 * typical).max(MODEL_ERROR * level);
            weights = left.map(|left| usual.powi(-2) / (1.0 + (left / (OUTLYING * usual)).powi(2)));
            for (&(a, b), information) in neighbours.iter().zip(&mut ties) {
                let sd2 = (BETWEEN * mean).powi(2);
                *information = (1.0 + (values[a] - values[b]).powi(2) / sd2).powf(-BORDERS) / sd2;
            }
        }
        let weighed = weighed?;
        let colours: Vec<DVector<f64>> =
            observed.par_iter().filter_map(|observed| solve(&weighed, observed, &values)).collect();
        let [red, green, blue] = &colours[..] else { return None };
        let values = [red, green, blue];
        if !values.iter().all(|values| values.iter().all(|v| v.is_finite())) {
            return None;
        }
        let radiance = (0..pieces).map(|k| [0, 1, 2].map(|c| values[c][k])).collect();
        let mut still = Self {
            surfaces,
            radiance,
            excess: Vec::new(),
            visible: [0, 1].map(|s| [0, 1, 2].map(|c| values[c][pieces + s * VISIBLE])),
            misfit: (left.norm_squared() / light.len() as f64).sqrt() / level,
            bright_share: 0.0,
            all_bright_share: 0.0,
        };
        let mut excess = bright::excess(&still.surfaces, &still.radiance);
        let share = |excess: &[Rgb]| {
            let grey = |k: usize| excess.get(k).map_or(0.0, |rgb| rgb.iter().sum::<f64>() / 3.0);
            (&matrix * DVector::from_fn(matrix.ncols(), |k, _| grey(k))).mean() / level
        };
        still.all_bright_share = share(&excess);
        excess[still.surfaces.of_walls()..still.surfaces.of_room()].fill([0.0; 3]);
        still.bright_share = share(&excess);
        still.excess = excess;
        Some(still)
    }
}

/// The least-squares problem with cells and borders weighed.
struct Weighed {
    rows: DMatrix<f64>,
    hessian: DMatrix<f64>,
}

impl Weighed {
    fn new(
        matrix: &DMatrix<f64>,
        weights: &DVector<f64>,
        neighbours: &[(usize, usize)],
        ties: &[f64],
        pieces: usize,
        [mean, level]: [f64; 2],
    ) -> Self {
        let mut rows = matrix.clone();
        rows.row_iter_mut().zip(weights.iter()).for_each(|(mut row, &weight)| row *= weight);
        let mut hessian = rows.tr_mul(matrix);
        for (&(a, b), information) in neighbours.iter().zip(ties) {
            hessian[(a, a)] += information;
            hessian[(b, b)] += information;
            hessian[(a, b)] -= information;
            hessian[(b, a)] -= information;
        }
        (0..pieces).for_each(|k| hessian[(k, k)] += (EACH * mean).powi(-2));
        for side in [pieces, pieces + VISIBLE] {
            hessian[(side, side)] += (10.0 * level).powi(-2);
            (1..VISIBLE).for_each(|j| hessian[(side + j, side + j)] += (SLOPE * level).powi(-2));
        }
        Self { rows, hessian }
    }
}

/// Light on each cell of both sides per unit of each unknown.
fn matrix(empty: &Empty<'_>, surfaces: &Surfaces) -> DMatrix<f64> {
    let pieces = surfaces.pieces();
    let unknowns = pieces + 2 * VISIBLE;
    let sides = [0, 1].map(|s| {
        let fan = empty.fans.sides()[s];
        let points = empty.patch.points(empty.doorway, Side::BOTH[s]);
        let [foot, _] = empty.doorway.edge(Side::BOTH[s]);
        let cells: Vec<_> = fan.groups(&points, GROUP).into_iter().zip(fan.counts()).collect();
        let row = |(group, &n): (Vec<([f64; 2], f64)>, &u32)| {
            let mut row = vec![0.0; unknowns];
            for (point, weight) in group {
                let weight = weight / f64::from(n);
                let view = FloorView::new(empty.doorway, point);
                surfaces.look(empty.doorway, &view, |look| row[look.piece] += weight * look.light);
                let across = (point[0] - foot) / empty.patch.fov_m;
                let away = (-empty.doorway.wall_thickness_m - point[1]) / empty.patch.fov_m - 0.5;
                for (j, value) in [1.0, across, away].into_iter().enumerate() {
                    row[pieces + s * VISIBLE + j] += weight * value;
                }
            }
            row
        };
        cells.into_par_iter().map(row).collect::<Vec<_>>()
    });
    let rows: Vec<f64> = sides.into_iter().flatten().flatten().collect();
    DMatrix::from_row_slice(rows.len() / unknowns, unknowns, &rows)
}

/// Light on each cell of a side, without the floor's texture.
fn cells_of(empty: &Empty<'_>, s: usize) -> Vec<[f64; 3]> {
    let fan = empty.fans.sides()[s];
    let patch = empty.picture.side(Side::BOTH[s]);
    let albedo = fan.means(|k| empty.floors[s].albedo[k]);
    let colours = [0, 1, 2].map(|c| fan.means(|k| f64::from(patch.plane(c)[k])));
    (0..fan.len()).map(|k| [0, 1, 2].map(|c| colours[c][k] / albedo[k].max(f64::MIN_POSITIVE))).collect()
}
