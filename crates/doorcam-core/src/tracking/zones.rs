use serde::{Deserialize, Serialize};

use crate::geometry::Point;

/// A zone is left only this far outside its border, in metres, so that somebody on the border does not keep entering
/// and leaving.
const BORDER_M: f64 = 0.15;
/// Smallest area of a zone, in m².
const SMALLEST_M2: f64 = 0.01;
/// Most corners of a zone.
const MOST_CORNERS: usize = 100;
/// Nearer to 0 than this, in metres, is no coordinate but an accident: far below what rounding leaves.
const TINIEST_M: f64 = 1e-30;

/// A named part of the room's floor: `[[zones]]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct Zone {
    /// Name of the zone.
    pub name: String,
    /// Identifies the zone to programs, also after it was renamed; none: not given one yet.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub id: Option<String>,
    /// Corners in order, clockwise or counterclockwise, in metres in the door frame.
    #[cfg_attr(feature = "schema", schema(value_type = Vec<crate::schema::Point>))]
    pub polygon_m: Vec<Point>,
}

/// Why a polygon is not a valid zone. Corners are counted from 1.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ZoneError {
    /// Too few or too many corners.
    #[error("has {0} points, expected 3 to {MOST_CORNERS}")]
    Count(usize),
    /// A coordinate is NaN, infinite, kilometres away, or next to 0 but not 0.
    #[error("has a point {0} that is not two numbers between -1000 and 1000 (metres)")]
    NotAPlace(usize),
    /// The same corner twice.
    #[error("has points {0} and {1} in the same place, expected each corner once")]
    Repeated(usize, usize),
    /// Sides that meet other than at their common corner.
    #[error("crosses or touches itself: the side after point {0} and the one after point {1} meet")]
    Crossing(usize, usize),
    /// Too small an area.
    #[error("encloses {0:.4} m2, expected at least {SMALLEST_M2} m2")]
    TooSmall(f64),
}

impl Zone {
    /// Checks that the polygon is simple and large enough.
    ///
    /// # Errors
    ///
    /// If the number of corners is out of range, a corner is not a valid place or repeated, the border meets itself, or
    /// the area is too small.
    pub fn check(&self) -> Result<(), ZoneError> {
        let corners = &self.polygon_m;
        let count = corners.len();
        if !(3..=MOST_CORNERS).contains(&count) {
            return Err(ZoneError::Count(count));
        }
        let is_a_place = |v: &f64| *v == 0.0 || (TINIEST_M..=1000.0).contains(&v.abs());
        if let Some(wrong) = corners.iter().position(|p| !p.iter().all(is_a_place)) {
            return Err(ZoneError::NotAPlace(wrong + 1));
        }
        for i in 0..count {
            if let Some(same) = (i + 1..count).find(|&j| corners[i] == corners[j]) {
                return Err(ZoneError::Repeated(i + 1, same + 1));
            }
        }
        for i in 0..count {
            for j in i + 1..count {
                let neighbours = j == i + 1 || (i == 0 && j == count - 1);
                let meet = if neighbours {
                    let (before, after) = if j == i + 1 { (i, j) } else { (j, i) };
                    folds_back(self.side(before), self.side(after))
                } else {
                    meet(self.side(i), self.side(j))
                };
                if meet {
                    return Err(ZoneError::Crossing(i + 1, j + 1));
                }
            }
        }
        let area = self.sides().map(|[a, b]| a[0] * b[1] - b[0] * a[1]).sum::<f64>().abs() / 2.0;
        if area < SMALLEST_M2 {
            return Err(ZoneError::TooSmall(area));
        }
        Ok(())
    }

    /// Whether a point is inside: a ray from it crosses the border an odd number of times.
    pub fn contains(&self, [x, y]: Point) -> bool {
        self.sides().fold(false, |inside, [a, b]| {
            // A corner belongs to one of its two sides only.
            let crosses = (a[1] > y) != (b[1] > y) && x < a[0] + (b[0] - a[0]) * (y - a[1]) / (b[1] - a[1]);
            inside != crosses
        })
    }

    /// Whether somebody at `point` is in the zone: inside, or in it `before` and still within 0.15 m of its border.
    pub fn holds(&self, point: Point, before: bool) -> bool {
        self.contains(point) || (before && self.border_m(point) <= BORDER_M)
    }

    /// Distance to the border, in metres.
    fn border_m(&self, [x, y]: Point) -> f64 {
        let distance = |[a, b]: [Point; 2]| {
            let along = [b[0] - a[0], b[1] - a[1]];
            let length2 = along[0] * along[0] + along[1] * along[1];
            let share = (((x - a[0]) * along[0] + (y - a[1]) * along[1]) / length2).clamp(0.0, 1.0);
            (x - a[0] - share * along[0]).hypot(y - a[1] - share * along[1])
        };
        self.sides().map(distance).fold(f64::INFINITY, f64::min)
    }

    fn side(&self, k: usize) -> [Point; 2] {
        [self.polygon_m[k], self.polygon_m[(k + 1) % self.polygon_m.len()]]
    }

    fn sides(&self) -> impl Iterator<Item = [Point; 2]> {
        (0..self.polygon_m.len()).map(|k| self.side(k))
    }
}

/// Twice the area of a triangle; positive if it turns left.
fn turn(a: Point, b: Point, c: Point) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// Whether two segments have a point in common.
fn meet([a, b]: [Point; 2], [c, d]: [Point; 2]) -> bool {
    let apart = |i: usize| a[i].max(b[i]) < c[i].min(d[i]) || c[i].max(d[i]) < a[i].min(b[i]);
    let beside = |p: f64, q: f64| (p > 0.0 && q > 0.0) || (p < 0.0 && q < 0.0);
    !apart(0) && !apart(1) && !beside(turn(a, b, c), turn(a, b, d)) && !beside(turn(c, d, a), turn(c, d, b))
}

/// Whether a side runs back over the previous one.
fn folds_back([a, b]: [Point; 2], [_, c]: [Point; 2]) -> bool {
    turn(a, b, c) == 0.0 && (a[0] - b[0]) * (c[0] - b[0]) + (a[1] - b[1]) * (c[1] - b[1]) > 0.0
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn zone(polygon_m: &[Point]) -> Zone {
        Zone { name: "bed".into(), id: None, polygon_m: polygon_m.to_vec() }
    }

    /// An L shape: the square [0, 2]² without [1, 2]².
    const L: [Point; 6] = [[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 1.0], [1.0, 2.0], [0.0, 2.0]];

    #[test]
    fn corners_that_enclose_nothing_or_twice_are_refused() {
        assert_eq!(zone(&L).check(), Ok(()));
        assert_eq!(zone(&L[..2]).check(), Err(ZoneError::Count(2)));
        assert_eq!(zone(&[[0.0, 0.0], [f64::NAN, 0.0], [1.0, 1.0]]).check(), Err(ZoneError::NotAPlace(2)));
        for odd in [1e9, -1000.1, 1e-300, -5e-324, f64::INFINITY, f64::MAX] {
            assert_eq!(zone(&[[0.0, 0.0], [1.0, 0.0], [1.0, odd]]).check(), Err(ZoneError::NotAPlace(3)), "{odd}");
        }
        assert_eq!(zone(&[[-0.0, 0.0], [1.0, 6e-17], [1.0, 1.0]]).check(), Ok(()), "as rounding leaves it");
        assert_eq!(zone(&[[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 0.0]]).check(), Err(ZoneError::Repeated(1, 4)));
        let bow = [[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0]];
        assert_eq!(zone(&bow).check(), Err(ZoneError::Crossing(1, 3)));
        let spike = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [1.0, 0.5], [0.0, 1.0]];
        assert_eq!(zone(&spike).check(), Err(ZoneError::Crossing(2, 3)));
        let touching = [[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [1.0, 0.0], [0.0, 2.0]];
        assert_eq!(zone(&touching).check(), Err(ZoneError::Crossing(1, 3)));
        assert!(matches!(zone(&[[0.0, 0.0], [0.1, 0.0], [0.0, 0.1]]).check(), Err(ZoneError::TooSmall(_))));
        assert!(matches!(zone(&[[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]]).check(), Err(ZoneError::Crossing(..))));
    }

    #[test]
    fn a_border_is_left_some_way_outside() {
        let zone = zone(&L);
        for (point, entering, staying) in [
            ([0.5, 1.5], true, true),
            ([1.1, 1.5], false, true),
            ([1.2, 1.5], false, false),
            ([-0.1, -0.1], false, true),
            ([-0.12, -0.12], false, false),
        ] {
            assert_eq!((zone.holds(point, false), zone.holds(point, true)), (entering, staying), "{point:?}");
        }
    }

    proptest! {
        #[test]
        fn a_point_is_inside_as_the_rectangles_say(x in -0.5..2.5_f64, y in -0.5..2.5_f64) {
            let inside = |x: f64, y: f64| (0.0..2.0).contains(&x) && (0.0..2.0).contains(&y) && !(x > 1.0 && y > 1.0);
            let mut backwards = L;
            backwards.reverse();
            prop_assert_eq!(zone(&L).contains([x, y]), inside(x, y));
            prop_assert_eq!(zone(&backwards).contains([x, y]), inside(x, y));
        }

        #[test]
        fn a_star_is_no_zone_and_its_points_in_order_are(angles in prop::collection::vec(0.1..1.0_f64, 5)) {
            // In order around the origin the corners form a simple polygon; taking every second one gives a pentagram.
            let sum: f64 = angles.iter().sum();
            let mut at = 0.0;
            let round: Vec<Point> = angles.iter().map(|a| {
                at += a / sum * std::f64::consts::TAU;
                [2.0 * at.cos(), 2.0 * at.sin()]
            }).collect();
            prop_assert_eq!(zone(&round).check(), Ok(()));
            let star: Vec<Point> = (0..5).map(|k| round[2 * k % 5]).collect();
            prop_assert!(matches!(zone(&star).check(), Err(ZoneError::Crossing(..))));
        }
    }
}
