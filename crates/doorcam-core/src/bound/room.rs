//! The bound for an actual camera over the room, from its still picture and its noise.

use nalgebra::{DMatrix, Matrix2, Matrix3, Vector3};
use rayon::prelude::*;

use super::information::covariance;
use super::nuisance::Patterns;
use super::person::{Aperture, PersonSetup};
use super::point::Strategy;
use crate::geometry::{Doorway, Point, Room, Side};
use crate::light::Sensing;
use crate::scene::Rgb;
use crate::transport::{FloorView, PatchGrid};

/// How well a person can be located at best from one frame of a camera. The person's strength in each colour is
/// unknown, and in each patch and colour the still picture (gain) and even light (from the visible side) may be present
/// at any strength.
#[derive(Debug, Clone)]
pub struct RoomBound {
    aperture: Aperture,
    radius_m: f64,
    /// Per patch, the view of each block of pixels and one over the block's noise.
    views: [Vec<(FloorView, f64)>; 2],
    /// Per colour and patch.
    patterns: [[Patterns; 2]; 3],
    usual: Rgb,
}

/// Where in a room a person can be located, and how exactly.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct UncertaintyMap {
    /// Centres of the cells along x, in metres in the door frame.
    pub x_m: Vec<f64>,
    /// Centres of the cells along y, in metres in the door frame.
    pub y_m: Vec<f64>,
    /// Per y and x, the smallest possible root mean square distance from the true place, in metres; none where the
    /// pixels do not determine the place.
    pub error_m: Vec<Vec<Option<f64>>>,
}

/// Approximate size of a map's cells, in metres.
const CELL_M: f64 = 0.1;
/// Largest number of cells along a side of a map.
const MOST_CELLS: f64 = 40.0;
/// Side of the blocks into which pixels are merged; a person's penumbra is much wider.
const BLOCK: usize = 2;

impl RoomBound {
    /// The bound for a person of this radius, in metres. `patch` must describe the patches that `sensing` is for.
    pub fn new(doorway: &Doorway, patch: &PatchGrid, radius_m: f64, sensing: &Sensing) -> Self {
        let aperture = Aperture::new(doorway, Strategy::Doorway);
        let blocks = [0, 1].map(|s| blocks(doorway, patch, Side::BOTH[s], sensing));
        let views = blocks.each_ref().map(|blocks| blocks.iter().map(|b| (aperture.view(b.point), b.weight)).collect());
        let of = |colour: usize, blocks: &[Block]| {
            let even = blocks.iter().map(|b| b.weight).collect();
            let still = blocks.iter().map(|b| b.weight * b.still[colour]).collect();
            Patterns::new(&[even, still])
        };
        let patterns = [0, 1, 2].map(|colour| blocks.each_ref().map(|blocks| of(colour, blocks)));
        let usual = usual_strength(&aperture, &views, &blocks);
        Self { aperture, radius_m, views, patterns, usual }
    }

    /// The change of radiance that an average person makes, by [`PersonSetup::USUAL`]: darker than a room that provides
    /// part of the floor's light.
    pub fn usual_strength(&self) -> Rgb {
        self.usual
    }

    /// The smallest possible covariance, in m², of the place of a person whose axis is at `place` (metres in the door
    /// frame) and who changes the radiance by `strength`; none where the pixels do not determine the place.
    pub fn covariance(&self, place: Point, strength: Rgb) -> Option<[[f64; 2]; 2]> {
        let gradients = self.views.each_ref().map(|views| {
            let gradient = |(view, weight): &(FloorView, f64)| {
                *weight * self.aperture.person(view, self.radius_m, PersonSetup::USUAL.height_m, place)
            };
            views.iter().map(gradient).collect::<Vec<Vector3<f64>>>()
        });
        let mut information = Matrix2::zeros();
        for (patterns, strength) in self.patterns.iter().zip(strength) {
            let both = patterns.iter().zip(&gradients).map(|(patterns, gradients)| patterns.information(gradients));
            information += strength * strength * beside_strength(&both.sum::<Matrix3<f64>>());
        }
        let found = covariance(&DMatrix::from_column_slice(2, 2, information.as_slice()))?;
        let rows = [0, 1].map(|i| [0, 1].map(|j| found[(i, j)]));
        rows.iter().flatten().all(|v| v.is_finite()).then_some(rows)
    }

    /// The map of a room for a person of the usual strength.
    pub fn map(&self, room: &Room) -> UncertaintyMap {
        let cells = |length: f64| (length / CELL_M).round().clamp(1.0, MOST_CELLS) as usize;
        let middles = |from: f64, length: f64| -> Vec<f64> {
            let n = cells(length);
            (0..n).map(|k| from + (k as f64 + 0.5) * length / n as f64).collect()
        };
        let x_m = middles(-room.half_width_m, 2.0 * room.half_width_m);
        let y_m = middles(0.0, room.depth_m);
        let error = |x: f64, y: f64| {
            let [[xx, _], [_, yy]] = self.covariance([x, y], self.usual)?;
            Some((xx + yy).sqrt())
        };
        let error_m = y_m.par_iter().map(|&y| x_m.iter().map(|&x| error(x, y)).collect()).collect();
        UncertaintyMap { x_m, y_m, error_m }
    }
}

/// Several pixels merged.
struct Block {
    point: Point,
    still: Rgb,
    /// One over the noise of the block's mean, the pixels weighted by 1 / σ².
    weight: f64,
}

fn blocks(doorway: &Doorway, patch: &PatchGrid, side: Side, sensing: &Sensing) -> Vec<Block> {
    let weights = match side {
        Side::Left => &sensing.weights[0],
        Side::Right => &sensing.weights[1],
    };
    let still = sensing.still.side(side);
    let along = patch.size.div_ceil(BLOCK);
    // Sums of 1 / σ², and of positions and levels times that.
    let mut sums = vec![[0.0; 6]; along * along];
    for (k, point) in patch.points(doorway, side).into_iter().enumerate() {
        let share = weights[k] * weights[k];
        let sum = &mut sums[k / patch.size / BLOCK * along + k % patch.size / BLOCK];
        let [r, g, b] = [0, 1, 2].map(|colour| f64::from(still.plane(colour)[k]));
        for (sum, value) in sum.iter_mut().zip([1.0, point[0], point[1], r, g, b]) {
            *sum += share * value;
        }
    }
    let block = |[all, x, y, r, g, b]: [f64; 6]| Block {
        point: [x / all, y / all],
        still: [r, g, b].map(|v| v / all),
        weight: all.sqrt(),
    };
    sums.into_iter().filter(|sum| sum[0] > 0.0).map(block).collect()
}

fn usual_strength(aperture: &Aperture, views: &[Vec<(FloorView, f64)>; 2], blocks: &[Vec<Block>; 2]) -> Rgb {
    let room: f64 = views.iter().flatten().map(|(view, _)| aperture.room(view)).sum();
    let PersonSetup { contrast, visible_share, .. } = PersonSetup::USUAL;
    [0, 1, 2].map(|colour| {
        let floor: f64 = blocks.iter().flatten().map(|block| block.still[colour]).sum();
        if room > 0.0 { contrast * (1.0 - visible_share) * floor / room } else { 0.0 }
    })
}

/// Information on the place when the strength is unknown: the Schur complement.
fn beside_strength(all: &Matrix3<f64>) -> Matrix2<f64> {
    let place = all.fixed_view::<2, 2>(1, 1);
    if all[(0, 0)] <= 0.0 {
        return Matrix2::zeros();
    }
    let with = all.fixed_view::<2, 1>(1, 0);
    place - with * with.transpose() / all[(0, 0)]
}

#[cfg(test)]
mod tests {
    use super::super::Setup;
    use super::*;
    use crate::geometry::Leaf;
    use crate::light::PatchPair;
    use crate::transport::PixelLayout;

    /// The still picture and noise of a [`PersonSetup`], each colour at its own level.
    fn sensing(setup: &PersonSetup, levels: Rgb, patch: &PatchGrid) -> Sensing {
        let aperture = Aperture::new(&setup.measured.doorway, Strategy::Doorway);
        let mut still = PatchPair::zeros(patch.size);
        for side in Side::BOTH {
            let points = patch.points(&setup.measured.doorway, side);
            let room: Vec<f64> = points.into_iter().map(|point| aperture.room(&aperture.view(point))).collect();
            let mean = room.iter().sum::<f64>() / room.len() as f64;
            for (colour, level) in levels.into_iter().enumerate() {
                let plane = still.side_mut(side).plane_mut(colour);
                plane.iter_mut().zip(&room).for_each(|(v, r)| *v = (level * (0.5 * r / mean + 0.5)) as f32);
            }
        }
        let weight = 1.0 / setup.measured.noise;
        Sensing { still, weights: [vec![weight; patch.pixels()], vec![weight; patch.pixels()]] }
    }

    fn patch(setup: &PersonSetup) -> PatchGrid {
        PatchGrid { size: setup.measured.pixels, fov_m: setup.measured.patch_m, layout: PixelLayout::Cells }
    }

    #[test]
    fn one_colour_is_the_bound_of_planning_and_three_know_more() {
        let setup = PersonSetup::USUAL;
        let Setup { doorway, .. } = setup.measured;
        for place in [[0.0, 2.0], [0.7, 1.3], [-1.2, 0.8]] {
            let of = |levels: Rgb| {
                let room = RoomBound::new(&doorway, &patch(&setup), 0.2, &sensing(&setup, levels, &patch(&setup)));
                let [[xx, _], [_, yy]] = room.covariance(place, room.usual_strength()).unwrap();
                (xx + yy).sqrt()
            };
            let planned = setup.bound(Strategy::Doorway, place).error_m();
            let [one, three] = [of([1.0, 0.0, 0.0]), of([1.0; 3])];
            assert!((one / planned - 1.0).abs() < 0.05, "{place:?}: {one} {planned}");
            assert!((three * 3.0_f64.sqrt() / one - 1.0).abs() < 1e-6, "{three} {one}");
        }
    }

    #[test]
    fn the_leaf_and_the_lintel_take_information_away() {
        let setup = PersonSetup::USUAL;
        let open = setup.measured.doorway;
        let leaf = Some(Leaf { hinge: Side::Left, angle_deg: 98.0, width_m: 0.84 });
        let error = |doorway: Doorway, place: Point| {
            let setup = PersonSetup { measured: Setup { doorway, ..setup.measured }, ..setup };
            let seen = sensing(&setup, [0.3; 3], &patch(&setup));
            let bound = RoomBound::new(&doorway, &patch(&setup), 0.2, &seen);
            bound.covariance(place, [0.05; 3]).map_or(f64::INFINITY, |[[xx, _], [_, yy]]| (xx + yy).sqrt())
        };
        let with = Doorway { leaf, ..open };
        let [behind, beside] = [[-1.2, 1.5], [1.2, 1.5]];
        assert!((error(open, behind) / error(open, beside) - 1.0).abs() < 1e-3, "the room is symmetric");
        assert!(error(with, behind) > 2.0 * error(open, behind), "{} {}", error(with, behind), error(open, behind));
        assert!(error(with, beside) < 1.1 * error(open, beside), "{} {}", error(with, beside), error(open, beside));
        // A lintel that cuts off all but the feet.
        assert!(error(Doorway { height_m: Some(0.05), ..open }, beside) > 1.2 * error(open, beside));
    }

    #[test]
    fn the_map_is_of_the_room_and_knows_what_is_not_seen() {
        let setup = PersonSetup::USUAL;
        let room = Room { half_width_m: 1.5, depth_m: 3.0 };
        let seen = sensing(&setup, [0.3; 3], &patch(&setup));
        let bound = RoomBound::new(&setup.measured.doorway, &patch(&setup), 0.2, &seen);
        let map = bound.map(&room);
        assert_eq!((map.x_m.len(), map.y_m.len(), map.error_m.len(), map.error_m[0].len()), (30, 30, 30, 30));
        assert!((map.x_m[0] + 1.45).abs() < 1e-9 && (map.y_m[29] - 2.95).abs() < 1e-9);
        let at = |row: usize, column: usize| map.error_m[row][column].unwrap();
        assert!(at(10, 15) < at(20, 15) && at(20, 15) < at(29, 15), "farther away is less exact");
        assert!((at(12, 3) / at(12, 26) - 1.0).abs() < 1e-3, "the room is symmetric");
        // Close to the wall beside the door, a thick wall hides a person from both patches.
        assert!(map.error_m[0][0].is_none_or(|error| error > 1.0), "{:?}", map.error_m[0][0]);
        // Pixels that do not count say nothing.
        let blind = Sensing { weights: seen.weights.map(|w| vec![0.0; w.len()]), ..seen };
        let nothing = RoomBound::new(&setup.measured.doorway, &patch(&setup), 0.2, &blind).map(&room);
        assert!(nothing.error_m.iter().flatten().all(Option::is_none));
    }
}
