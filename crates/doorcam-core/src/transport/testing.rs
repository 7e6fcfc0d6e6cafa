//! Doors that stand open, for tests.

use nalgebra::{Matrix2, Vector2};
use proptest::prelude::*;

use crate::geometry::{Doorway, Leaf, Point, Side};

/// Doorways with and without a leaf.
pub fn leaf() -> impl Strategy<Value = Option<Leaf>> {
    let hinge = prop_oneof![Just(Side::Left), Just(Side::Right)];
    let leaf = (hinge, 5.0..180.0f64, 0.3..1.2f64);
    prop::option::of(leaf.prop_map(|(hinge, angle_deg, width_m)| Leaf { hinge, angle_deg, width_m }))
}

/// Whether the way from `pixel` to `point` meets a doorway's leaf, seen from above: where the two lines cross is between
/// both ends of each.
pub fn meets_leaf(doorway: &Doorway, pixel: Point, point: Point) -> bool {
    let Some([hinge, free]) = doorway.leaf_ends() else { return false };
    let way = Vector2::new(point[0] - pixel[0], point[1] - pixel[1]);
    let leaf = Vector2::new(free[0] - hinge[0], free[1] - hinge[1]);
    let start = Vector2::new(hinge[0] - pixel[0], hinge[1] - pixel[1]);
    let crossing = Matrix2::from_columns(&[way, -leaf]).try_inverse().map(|inverse| inverse * start);
    crossing.is_some_and(|at| at.iter().all(|share| *share > 0.0 && *share < 1.0))
}
