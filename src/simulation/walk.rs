use crate::geometry::Point;

/// A smooth walk through waypoints that ends where it began.
///
/// Between waypoints the position is a cubic with the velocities (p_{k+1} − p_{k−1}) / (t_{k+1} − t_{k−1}) at the ends, so
/// that position and velocity are continuous, also from one round to the next.
#[derive(Debug, Clone, PartialEq)]
pub struct Walk {
    /// Time in seconds, rising from 0, and place in metres.
    pub waypoints: Vec<(f64, Point)>,
    /// Seconds until it begins again: above the last waypoint's time.
    pub period_s: f64,
}

impl Walk {
    /// Where the walker is at a time, in seconds; none for a walk without waypoints.
    pub fn at(&self, seconds: f64) -> Option<Point> {
        let count = self.waypoints.len() as isize;
        let time = seconds.rem_euclid(self.period_s);
        let next = self.waypoints.iter().position(|&(t, _)| t > time).unwrap_or(self.waypoints.len()) as isize;
        // Waypoints of the rounds before and after, at their times.
        let waypoint = |k: isize| {
            let (t, p) = *self.waypoints.get(k.rem_euclid(count) as usize)?;
            Some((t + self.period_s * k.div_euclid(count) as f64, p))
        };
        if count == 0 {
            return None;
        }
        let [before, from, to, after] =
            [waypoint(next - 2)?, waypoint(next - 1)?, waypoint(next)?, waypoint(next + 1)?];
        let span = to.0 - from.0;
        let u = (time - from.0) / span;
        let coordinate = |axis: usize| {
            let speed = |a: (f64, Point), b: (f64, Point)| (b.1[axis] - a.1[axis]) / (b.0 - a.0);
            let (m0, m1) = (span * speed(before, to), span * speed(from, after));
            let (p0, p1) = (from.1[axis], to.1[axis]);
            let (u2, u3) = (u * u, u * u * u);
            p0 * (2.0 * u3 - 3.0 * u2 + 1.0) + m0 * (u3 - 2.0 * u2 + u) + p1 * (3.0 * u2 - 2.0 * u3) + m1 * (u3 - u2)
        };
        Some([coordinate(0), coordinate(1)])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_walk_passes_its_waypoints_and_is_smooth_and_closed() {
        let walk = Walk {
            waypoints: vec![(0.0, [0.0, 1.0]), (2.0, [1.0, 2.0]), (5.0, [-1.0, 1.5]), (6.0, [-1.0, 1.0])],
            period_s: 8.0,
        };
        for &(t, p) in &walk.waypoints {
            for time in [t, t + 8.0, t - 8.0] {
                let at = walk.at(time).unwrap();
                assert!((at[0] - p[0]).hypot(at[1] - p[1]) < 1e-12);
            }
        }
        let velocity = |t: f64, h: f64| [0, 1].map(|i| (walk.at(t + h).unwrap()[i] - walk.at(t).unwrap()[i]) / h);
        for t in [0.0, 2.0, 5.0, 6.0] {
            let (before, after) = (velocity(t, -1e-6), velocity(t, 1e-6));
            assert!((0..2).all(|i| (before[i] - after[i]).abs() < 1e-4), "{t}: {before:?} {after:?}");
        }
        assert_eq!(Walk { waypoints: Vec::new(), period_s: 1.0 }.at(0.3), None);
    }
}
