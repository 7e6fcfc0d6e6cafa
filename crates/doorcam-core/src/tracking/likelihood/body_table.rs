use nalgebra::DMatrix;
use rayon::prelude::*;

use super::columns::Columns;
use super::place::Place;
use crate::geometry::{Doorway, Side};
use crate::light::FanPair;
use crate::transport::{Body, FloorView, PatchGrid};

/// Number of azimuths, from wall to wall.
const AZIMUTHS: usize = 73;
/// Number of distances.
const RANGES: usize = 48;
/// Log of the nearest distance, 0.25 m.
const NEAREST: f64 = -1.386_294_361_119_890_6;
/// Step of the log of the distance: 7 %.
const RANGE_STEP: f64 = 0.07;
/// Step of the azimuth: 2.5 degrees.
const AZIMUTH_STEP: f64 = std::f64::consts::PI / (AZIMUTHS - 1) as f64;
/// Most pixels of a fan's cell that one floor point stands for.
const GROUP: usize = 4;

/// Change of the mean light of each cell of both fans by a body of unit radiance, for a table of places all over the
/// hidden room, interpolated with cubics in between.
#[derive(Debug, Clone)]
pub struct BodyTable {
    /// Per side, one column of cells for each place; places are ordered by distance, then azimuth.
    pub(super) columns: [Columns; 2],
    /// Derivatives of `columns` by the log of the radius.
    pub(super) by_radius: [Columns; 2],
}

/// Columns with their weights for the value and for its derivatives by azimuth and log range.
pub(super) type Stencil = [(usize, [f32; 3]); 16];

impl BodyTable {
    /// Number of places.
    pub(super) const PLACES: usize = AZIMUTHS * RANGES;
    /// Step of the log of the radius, for the finite difference by which a derivative by the radius is computed.
    pub(super) const RADIUS_STEP: f64 = 0.1;

    /// Computes the table for a body's radius and height, in metres. Places are evaluated in parallel.
    pub fn new(doorway: &Doorway, patch: &PatchGrid, fans: &FanPair, radius_m: f64, height_m: f64) -> Self {
        let columns = |radius_m: f64, s: usize| {
            let side = Side::BOTH[s];
            let fan = fans.sides()[s];
            let cells: Vec<Vec<(FloorView, f64)>> = (fan.groups(&patch.points(doorway, side), GROUP).into_iter())
                .map(|cell| cell.into_iter().map(|(point, n)| (FloorView::new(doorway, point), n)).collect())
                .collect();
            let mut columns = DMatrix::<f32>::zeros(cells.len(), Self::PLACES);
            columns.as_mut_slice().par_chunks_mut(cells.len().max(1)).enumerate().for_each(|(node, column)| {
                let body = Body { centre: Self::place(node).point(), radius_m, height_m };
                for ((value, cell), &n) in column.iter_mut().zip(&cells).zip(fan.counts()) {
                    let sum: f64 = cell.iter().map(|(view, weight)| weight * view.body(doorway, &body)).sum();
                    *value = (sum / f64::from(n)) as f32;
                }
            });
            columns
        };
        let table = [0, 1].map(|s| columns(radius_m, s));
        let by_radius = [0, 1].map(|s| {
            let wider = columns(radius_m * Self::RADIUS_STEP.exp(), s);
            Columns::new(&((wider - &table[s]) / Self::RADIUS_STEP as f32))
        });
        Self { columns: table.each_ref().map(Columns::new), by_radius }
    }

    /// The place of a column.
    pub(super) fn place(number: usize) -> Place {
        Place {
            azimuth: (number % AZIMUTHS) as f64 * AZIMUTH_STEP - std::f64::consts::FRAC_PI_2,
            log_range: NEAREST + (number / AZIMUTHS) as f64 * RANGE_STEP,
        }
    }

    /// The nearest place that has all the neighbours needed for interpolation.
    pub(super) fn clamp(place: Place) -> Place {
        let inner = |value: f64, from: f64, step: f64, count: usize| {
            value.clamp(from + step, from + step * ((count - 2) as f64 - 1e-9))
        };
        Place {
            azimuth: inner(place.azimuth, -std::f64::consts::FRAC_PI_2, AZIMUTH_STEP, AZIMUTHS),
            log_range: inner(place.log_range, NEAREST, RANGE_STEP, RANGES),
        }
    }

    /// The 16 columns around a place, as indices, with their weights for the value and for its derivatives by azimuth
    /// and log range.
    pub(super) fn stencil(at: Place) -> Stencil {
        let at = Self::clamp(at);
        let (column, across) = cubic((at.azimuth + std::f64::consts::FRAC_PI_2) / AZIMUTH_STEP);
        let (row, along) = cubic((at.log_range - NEAREST) / RANGE_STEP);
        std::array::from_fn(|k| {
            let (i, j) = (k / 4, k % 4);
            let [a, da] = across[j];
            let [r, dr] = along[i];
            let weights = [a * r, da / AZIMUTH_STEP * r, a * dr / RANGE_STEP];
            ((row - 1 + i) * AZIMUTHS + column - 1 + j, weights.map(|w| w as f32))
        })
    }
}

/// Catmull-Rom cubic: the node before `t`, and weights and their derivatives for the four nodes around `t`.
fn cubic(t: f64) -> (usize, [[f64; 2]; 4]) {
    // At the table's edge, rounding may put `t` just below the first node that has a neighbour before it.
    let t = t.max(1.0);
    let node = t.floor();
    let u = t - node;
    let (u2, u3) = (u * u, u * u * u);
    let weights = [
        [0.5 * (-u3 + 2.0 * u2 - u), 0.5 * (-3.0 * u2 + 4.0 * u - 1.0)],
        [0.5 * (3.0 * u3 - 5.0 * u2 + 2.0), 0.5 * (9.0 * u2 - 10.0 * u)],
        [0.5 * (-3.0 * u3 + 4.0 * u2 + u), 0.5 * (-9.0 * u2 + 8.0 * u + 1.0)],
        [0.5 * (u3 - u2), 0.5 * (3.0 * u2 - 2.0 * u)],
    ];
    (node as usize, weights)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn cubics_are_exact_for_parabolas_and_know_their_slope(t in 1.0..40.0f64, a in -2.0..2.0f64, b in -2.0..2.0f64) {
            let (node, weights) = cubic(t);
            let f = |x: f64| 1.0 + a * x + b * x * x;
            let sum = |d: usize| (0..4).map(|k| weights[k][d] * f((node + k) as f64 - 1.0)).sum::<f64>();
            prop_assert!((sum(0) - f(t)).abs() < 1e-9 && (sum(1) - (a + 2.0 * b * t)).abs() < 1e-9);
        }
    }

    #[test]
    fn stencils_stay_in_the_table_in_its_corners_and_beyond() {
        let corners = [-9.0, 9.0].map(|log_range| [-9.0, 9.0].map(|azimuth| Place { azimuth, log_range }));
        for corner in corners.into_iter().flatten() {
            let place = BodyTable::clamp(corner);
            let stencil = BodyTable::stencil(corner);
            // Four consecutive columns in each of four consecutive rows.
            let first = stencil[0].0;
            for (k, (number, _)) in stencil.iter().enumerate() {
                assert_eq!(*number, first + k / 4 * AZIMUTHS + k % 4, "{corner:?}");
                assert!(*number < AZIMUTHS * RANGES && first % AZIMUTHS + 3 < AZIMUTHS, "{corner:?}: {number}");
            }
            let mean = |of: fn(Place) -> f64| -> f64 {
                stencil.iter().map(|&(number, [w, ..])| f64::from(w) * of(BodyTable::place(number))).sum()
            };
            assert!((mean(|p| p.azimuth) - place.azimuth).abs() < 1e-5, "{corner:?}");
            assert!((mean(|p| p.log_range) - place.log_range).abs() < 1e-5, "{corner:?}");
        }
    }
}
