use super::super::Walk;
use doorcam_core::geometry::Point;

/// Half of a step, in metres: how far before and behind the body's axis a foot is put down.
const HALF_STEP_M: f64 = 0.28;
/// From this speed on, in metres a second, steps have their whole length.
const WHOLE_STEPS_M_S: f64 = 0.8;
/// Time over which direction and speed are measured, in seconds.
const OVER_S: f64 = 0.1;
/// Somebody slower than this, in metres a second, stands and looks where they last walked to.
const STANDS_M_S: f64 = 0.08;
/// How far back that is looked for, in steps of `OVER_S`.
const LOOK_BACK: usize = 60;

/// How somebody stands at one moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::simulation) struct Pose {
    /// The body's axis.
    pub(in crate::simulation) at: Point,
    /// Where they look to: a unit vector.
    pub(super) ahead: Point,
    /// How far each foot, left and right, is before the axis and above the floor, in metres.
    pub(super) feet: [[f64; 2]; 2],
}

/// A walk's pose at a time in seconds; none while nobody is there.
pub(in crate::simulation) fn pose(walk: &Walk, seconds: f64) -> Option<Pose> {
    let at = walk.at(seconds)?;
    let velocity = |t: f64| -> Point {
        let (a, b) = (walk.at(t - OVER_S / 2.0).unwrap_or(at), walk.at(t + OVER_S / 2.0).unwrap_or(at));
        [(b[0] - a[0]) / OVER_S, (b[1] - a[1]) / OVER_S]
    };
    let speed = velocity(seconds);
    let fast = |v: &Point| v[0].hypot(v[1]) > STANDS_M_S;
    let around = (0..LOOK_BACK).map(|k| k as f64 * OVER_S);
    let heading = around
        .clone()
        .map(|back| velocity(seconds - back))
        .find(fast)
        .or_else(|| around.map(|on| velocity(seconds + on)).find(fast));
    let ahead = heading.map_or([0.0, 1.0], |v| v.map(|d| d / v[0].hypot(v[1])));
    let reach = HALF_STEP_M * (speed[0].hypot(speed[1]) / WHOLE_STEPS_M_S).min(1.0);
    let turn = walk.length(seconds) / (4.0 * HALF_STEP_M);
    Some(Pose { at, ahead, feet: [foot(turn, reach), foot(turn + 0.5, reach)] })
}

/// A foot's place before the axis and above the floor. In the first half of a turn it stands while the body passes over
/// it, in the second it swings forward.
fn foot(turn: f64, reach: f64) -> [f64; 2] {
    let phase = 2.0 * turn.rem_euclid(1.0);
    if phase < 1.0 {
        return [reach * (1.0 - 2.0 * phase), 0.0];
    }
    let swing = phase - 1.0;
    let smooth = swing * swing * (3.0 - 2.0 * swing);
    [reach * (2.0 * smooth - 1.0), 0.25 * reach * (std::f64::consts::PI * swing).sin()]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The foot that bears the body does not slide, one of them always does, and both go on without a jump.
    #[test]
    fn feet_stand_while_the_body_passes_over_them() {
        let walk = Walk { waypoints: vec![(0.0, [0.2, -3.0]), (1.5, [0.2, -1.5]), (4.0, [0.2, 1.0])], period_s: None };
        let place = |t: f64, k: usize| {
            let pose = pose(&walk, t).unwrap();
            [pose.at[1] + pose.feet[k][0] * pose.ahead[1], pose.feet[k][1]]
        };
        let mut standing = 0;
        for step in 0..90 {
            let t = 1.0 + f64::from(step) * 0.01;
            let mut moved = [0.0; 2];
            for (k, moved) in moved.iter_mut().enumerate() {
                let (now, next) = (place(t, k), place(t + 0.01, k));
                *moved = (next[0] - now[0]).abs();
                assert!(*moved < 0.05 && now[1] >= 0.0 && now[1] < 0.1, "{t}: {now:?} {next:?}");
            }
            standing += i32::from(moved[0].min(moved[1]) < 1.5e-3);
        }
        assert!(standing > 70, "{standing} of 90");
    }

    #[test]
    fn who_stands_looks_where_they_went_and_has_their_feet_below_them() {
        let waypoints = vec![(0.0, [0.0, -2.0]), (2.0, [0.0, -0.5]), (4.0, [0.0, -0.5]), (6.0, [0.0, -2.0])];
        let walk = Walk { waypoints, period_s: None };
        let standing = pose(&walk, 3.0).unwrap();
        assert_eq!((standing.ahead, standing.feet), ([0.0, 1.0], [[0.0; 2]; 2]));
        assert_eq!(pose(&walk, 5.0).unwrap().ahead, [0.0, -1.0]);
        assert_eq!(pose(&walk, 7.0), None);
        let nobody_moves = Walk { waypoints: vec![(0.0, [1.0, -1.0])], period_s: None };
        assert_eq!(pose(&nobody_moves, 0.0).unwrap().ahead, [0.0, 1.0]);
    }
}
