use nalgebra::{Matrix2, Vector2};

use crate::geometry::{Doorway, Point, Side};

/// Standard deviation of the body model's error, in radians at each edge that sees somebody.
const ANGLE_ERROR: f64 = 0.006;
/// The same in a room with lamps or windows that the floor sees, where the borders of windows are not quite where the
/// model has them. From simulated rooms.
const ANGLE_ERROR_WHEN_BRIGHT: f64 = 0.013;
/// Standard deviation of the distance between a body's axis and what the floor sees of it, in metres in each direction:
/// legs and arms swing, and one side is lit. From simulated rooms.
const BODY_ERROR_M: f64 = 0.02;
/// Standard deviation of the error along the line of sight of somebody whom the leaf hides from one edge, as a share of
/// their distance: what tells it is the width and the fading of an outline, and people differ.
const ALONE_ERROR: f64 = 0.2;

/// Covariance, in m², of the error that the model of a body and its room adds to a person's place. `sees` says whether the
/// left and the right edge see them, `bright` whether the floor sees windows or lamps. `unexplained` is the variance of what
/// the model leaves of the frame, relative to noise: where it is 4, shadows and reflections that the model does not have
/// are there, and move places about twice as far as otherwise.
pub(super) fn model_error(
    doorway: &Doorway,
    point: Point,
    sees: [bool; 2],
    bright: bool,
    unexplained: f64,
) -> Matrix2<f64> {
    let angle_error = if bright { ANGLE_ERROR_WHEN_BRIGHT } else { ANGLE_ERROR };
    let of_angles = match sees {
        [true, false] => seen_past_one_edge(doorway, Side::Left, point, angle_error),
        [false, true] => seen_past_one_edge(doorway, Side::Right, point, angle_error),
        _ => seen_past_both_edges(doorway, point, angle_error),
    };
    (of_angles + Matrix2::identity() * BODY_ERROR_M.powi(2)) * unexplained.max(1.0)
}

/// Covariance of a place, in m², whose angles at the two edges have independent errors of `angle_error`.
fn seen_past_both_edges(doorway: &Doorway, [x, y]: Point, angle_error: f64) -> Matrix2<f64> {
    let half = doorway.half_width();
    // ∂(α1, α2) / ∂(x, y).
    let (r1, r2) = ((x + half).powi(2) + y * y, (half - x).powi(2) + y * y);
    let angles = Matrix2::new(-y / r1, (x + half) / r1, y / r2, (half - x) / r2);
    let places = angles.try_inverse().unwrap_or_else(Matrix2::identity);
    places * places.transpose() * angle_error.powi(2)
}

/// The same for somebody whom only the edge of one side sees: the angle's error across its line of sight, [`ALONE_ERROR`]
/// along it.
fn seen_past_one_edge(doorway: &Doorway, side: Side, [x, y]: Point, angle_error: f64) -> Matrix2<f64> {
    let [edge_x, edge_y] = doorway.edge(side);
    let sight = Vector2::new(x - edge_x, y - edge_y);
    let across = Vector2::new(-sight[1], sight[0]);
    sight * sight.transpose() * ALONE_ERROR.powi(2) + across * across.transpose() * angle_error.powi(2)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::geometry::Biangular;

    const DOOR: Doorway = Doorway { width_m: 0.8, wall_thickness_m: 0.0, height_m: None, leaf: None };

    #[test]
    fn what_is_left_unexplained_widens_every_error() {
        for sees in [[true, true], [true, false], [false, true]] {
            for bright in [false, true] {
                let error = |unexplained: f64| model_error(&DOOR, [0.4, 2.0], sees, bright, unexplained);
                assert_eq!(error(1.0), error(0.3), "noise cannot be less than it is");
                let left = error(9.0) - 9.0 * error(1.0);
                assert!(left.amax() < 1e-12, "{left}");
            }
        }
    }

    #[test]
    fn a_body_is_no_point_however_near_it_is() {
        let near = model_error(&DOOR, [0.0, 0.3], [true, true], false, 1.0);
        assert!(near.symmetric_eigenvalues().min() > BODY_ERROR_M.powi(2), "{near}");
        // Far away, angles are what matters: along the line of sight their error grows with the square of the distance.
        let along = |y: f64| model_error(&DOOR, [0.0, y], [true, true], false, 1.0)[(1, 1)].sqrt();
        assert!((along(4.0) / along(2.0) - 4.0).abs() < 0.8, "{} {}", along(4.0), along(2.0));
    }

    proptest! {
        #[test]
        fn errors_of_angles_move_places(x in -1.5..1.5f64, y in 0.5..3.0f64, w in 0.4..1.0f64) {
            let door = Doorway { width_m: w, wall_thickness_m: 0.0, height_m: None, leaf: None };
            let Biangular { alpha1, alpha2 } = Biangular::from_point(&door, [x, y]);
            let moved = |a: f64, b: f64| Biangular { alpha1: alpha1 + a, alpha2: alpha2 + b }.to_point(&door);
            let h = 1e-6;
            let columns = [(h, 0.0), (0.0, h)].map(|(a, b)| {
                let [px, py] = moved(a, b);
                [(px - x) / h, (py - y) / h]
            });
            let error = seen_past_both_edges(&door, [x, y], ANGLE_ERROR);
            for (i, j) in [(0, 0), (0, 1), (1, 1)] {
                let literal = ANGLE_ERROR.powi(2) * columns.iter().map(|c| c[i] * c[j]).sum::<f64>();
                prop_assert!((error[(i, j)] - literal).abs() < 1e-3 * error.trace(), "{literal} {error}");
            }
        }
    }
}
