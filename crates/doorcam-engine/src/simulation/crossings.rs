use super::Walk;
use doorcam_core::geometry::Doorway;
use doorcam_core::tracking::Direction;
use doorcam_source::truth::TrueCrossing;

/// Seconds between the times at which a walk is looked at; in between, crossings are found to the microsecond.
const STEP_S: f64 = 0.02;
/// A walk is looked at no more often than this: days of it, with longer steps if it goes on for years.
const MOST_STEPS: f64 = 2e7;
/// Who comes nearer to the wall's visible face than this, in metres, within the width of the opening, and goes back
/// again, has turned around on the threshold.
const THRESHOLD_M: f64 = 0.15;

/// Where a walk passes the hidden face of the wall in the doorway, or turns around before it, until a time in seconds.
///
/// In and out are when y passes 0. Back is when y is largest, for somebody who comes from the visible side and goes
/// back to it.
pub(super) fn crossings(walk: &Walk, doorway: &Doorway, until: f64) -> Vec<TrueCrossing> {
    let until = until.max(0.0);
    let step = STEP_S.max(until / MOST_STEPS);
    let times = |k: u64| (k as f64 * step).min(until);
    let count = (until / step).ceil() as u64;
    let mut found = Vec::new();
    // When and how far somebody who comes from the visible side was in the doorway, at most.
    let mut deepest: Option<(f64, f64)> = None;
    let from_visible = |deepest: &mut Option<(f64, f64)>, found: &mut Vec<TrueCrossing>| {
        if let Some((t, _)) = deepest.take() {
            found.push(TrueCrossing { t, direction: Direction::Back });
        }
    };
    let in_doorway =
        |[x, y]: [f64; 2]| y < 0.0 && y > -doorway.wall_thickness_m - THRESHOLD_M && x.abs() < doorway.half_width();
    for k in 0..count {
        let (t, next) = (times(k), times(k + 1));
        let (Some(a), Some(b)) = (walk.at(t), walk.at(next)) else {
            deepest = None;
            continue;
        };
        if (a[1] < 0.0) != (b[1] < 0.0) {
            let direction = if a[1] < 0.0 { Direction::In } else { Direction::Out };
            found.push(TrueCrossing { t: passes(walk, t, next), direction });
            deepest = None;
        } else if in_doorway(b) && (in_doorway(a) && deepest.is_some() || !in_doorway(a)) {
            if deepest.is_none_or(|(_, y)| b[1] > y) {
                deepest = Some((next, b[1]));
            }
        } else if !in_doorway(b) {
            from_visible(&mut deepest, &mut found);
        }
    }
    found
}

/// When y passes 0 between two times, by halving.
fn passes(walk: &Walk, mut from: f64, mut to: f64) -> f64 {
    let outside = |t: f64| walk.at(t).is_some_and(|[_, y]| y < 0.0);
    let before = outside(from);
    while to - from > 1e-6 {
        let middle = (from + to) / 2.0;
        if outside(middle) == before { from = middle } else { to = middle }
    }
    (from + to) / 2.0
}

#[cfg(test)]
mod tests {
    use super::*;

    const DOORWAY: Doorway = Doorway { width_m: 0.9, wall_thickness_m: 0.1, height_m: None, leaf: None };

    fn of(waypoints: &[(f64, [f64; 2])]) -> Vec<(Direction, f64)> {
        let walk = Walk { waypoints: waypoints.to_vec(), period_s: None };
        let found = crossings(&walk, &DOORWAY, 20.0);
        found
            .into_iter()
            .map(|c| {
                // Whatever the direction, the path says so.
                let y = |t: f64| walk.at(t).unwrap()[1];
                match c.direction {
                    Direction::In => assert!(y(c.t - 0.001) < 0.0 && y(c.t + 0.001) > 0.0),
                    Direction::Out => assert!(y(c.t - 0.001) > 0.0 && y(c.t + 0.001) < 0.0),
                    Direction::Back => assert!(y(c.t) >= y(c.t - 0.05) && y(c.t) >= y(c.t + 0.05)),
                }
                (c.direction, c.t)
            })
            .collect()
    }

    #[test]
    fn who_walks_in_and_out_crosses_twice_when_the_path_passes_the_hidden_face() {
        let found =
            of(&[(0.0, [0.1, -2.0]), (2.0, [0.0, 0.5]), (4.0, [0.0, 1.0]), (6.0, [0.2, 0.4]), (8.0, [0.0, -2.0])]);
        assert_eq!(found.iter().map(|c| c.0).collect::<Vec<_>>(), [Direction::In, Direction::Out]);
        // A straight way at constant speed passes 0 where it says.
        let walk: Vec<_> = (0..=20).map(|k| (f64::from(k) * 0.5, [0.0, -3.0 + 0.4 * f64::from(k)])).collect();
        let straight = of(&walk);
        assert!(straight.len() == 1 && (straight[0].1 - 3.75).abs() < 1e-3, "{straight:?}");
    }

    #[test]
    fn who_turns_around_on_the_threshold_crosses_back_and_who_passes_does_not() {
        let back = of(&[(0.0, [0.0, -2.0]), (2.0, [0.1, -0.06]), (4.0, [0.0, -2.0])]);
        assert!(back.len() == 1 && back[0].0 == Direction::Back && (back[0].1 - 2.0).abs() < 0.1, "{back:?}");
        assert_eq!(of(&[(0.0, [-2.0, -0.41]), (4.0, [2.0, -0.41])]), []);
        // Beside the opening nobody is on the threshold, however near to the wall.
        assert_eq!(of(&[(0.0, [1.0, -2.0]), (2.0, [0.8, -0.2]), (4.0, [1.0, -2.0])]), []);
        // Who comes out turns nowhere, and neither does who goes out and in again at once.
        let out = of(&[(0.0, [0.0, 1.0]), (2.0, [0.0, -0.05]), (4.0, [0.0, 1.0])]);
        assert_eq!(out.iter().map(|c| c.0).collect::<Vec<_>>(), [Direction::Out, Direction::In]);
        assert_eq!(of(&[(0.0, [0.0, 1.0]), (3.0, [0.0, -2.0])]).len(), 1);
    }
}
