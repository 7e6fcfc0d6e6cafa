use nalgebra::DMatrix;
use rayon::prelude::*;

use super::body_table::BodyTable;
use crate::geometry::{Doorway, Side};
use crate::light::FanPair;
use crate::still_room::{Seen, StillRoom};
use crate::transport::{Body, FloorView, PatchGrid};

/// Most pixels of a fan's cell that one floor point stands for.
const GROUP: usize = 14;

/// Change of the mean light of each cell by what a body hides of a still room, per side and colour, a column for each
/// place of a [`BodyTable`]; and the derivatives by the log of the radius.
pub(super) struct HiddenLight {
    pub columns: [[DMatrix<f32>; 3]; 2],
    pub by_radius: [[DMatrix<f32>; 3]; 2],
}

impl HiddenLight {
    pub fn new(
        doorway: &Doorway,
        patch: &PatchGrid,
        fans: &FanPair,
        still: &StillRoom,
        radius_m: f64,
        height_m: f64,
    ) -> Self {
        let sides = [0, 1].map(|s| Self::side(doorway, patch, fans, still, [radius_m, height_m], s));
        let [(left, left_by), (right, right_by)] = sides;
        Self { columns: [left, right], by_radius: [left_by, right_by] }
    }

    fn side(
        doorway: &Doorway,
        patch: &PatchGrid,
        fans: &FanPair,
        still: &StillRoom,
        [radius_m, height_m]: [f64; 2],
        s: usize,
    ) -> ([DMatrix<f32>; 3], [DMatrix<f32>; 3]) {
        let fan = fans.sides()[s];
        let points = patch.points(doorway, Side::BOTH[s]);
        let cells: Vec<Vec<(Seen, f64)>> = (fan.groups(&points, GROUP).into_par_iter())
            .zip(fan.counts())
            .map(|(cell, &n)| {
                let seen = |(point, weight): (_, f64)| {
                    (still.seen(doorway, &FloorView::new(doorway, point)), weight / f64::from(n))
                };
                cell.into_iter().map(seen).collect()
            })
            .collect();
        let rows = cells.len().max(1);
        // Colours of a place one below the other, then those of the wider body.
        let mut all = DMatrix::<f32>::zeros(6 * rows, BodyTable::PLACES);
        all.as_mut_slice().par_chunks_mut(6 * rows).enumerate().for_each(|(node, column)| {
            let centre = BodyTable::place(node).point();
            let bodies = [radius_m, radius_m * BodyTable::RADIUS_STEP.exp()];
            let bodies = bodies.map(|radius_m| Body { centre, radius_m, height_m });
            for (k, cell) in cells.iter().enumerate() {
                for (wide, body) in bodies.iter().enumerate() {
                    let mut light = [0.0; 3];
                    for (seen, weight) in cell {
                        let hidden = seen.hidden(body);
                        (0..3).for_each(|c| light[c] -= weight * hidden[c]);
                    }
                    (0..3).for_each(|c| column[(3 * wide + c) * rows + k] = light[c] as f32);
                }
            }
        });
        let part = |k: usize| all.rows(k * rows, rows).into_owned();
        let columns = [0, 1, 2].map(part);
        let by_radius = [0, 1, 2].map(|c| (part(3 + c) - &columns[c]) / BodyTable::RADIUS_STEP as f32);
        (columns, by_radius)
    }
}
