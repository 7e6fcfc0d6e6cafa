use doorcam_core::geometry::Point;

/// A smooth walk through waypoints, either repeated or single.
///
/// Between waypoints the position is a cubic with velocities (p_{k+1} − p_{k−1}) / (t_{k+1} − t_{k−1}) at the ends, so
/// that position and velocity are continuous, also from one round to the next. A single walk begins and ends at rest,
/// and two equal waypoints are a pause.
#[derive(Debug, Clone, PartialEq)]
pub struct Walk {
    /// Times in seconds, rising, and positions in metres. A repeated walk begins at time 0.
    pub waypoints: Vec<(f64, Point)>,
    /// Seconds after which it repeats, more than the last waypoint's time; none for a single walk.
    pub period_s: Option<f64>,
}

impl Walk {
    /// Position at a time in seconds; none before and after a single walk, and for a walk without waypoints.
    pub fn at(&self, seconds: f64) -> Option<Point> {
        let count = self.waypoints.len() as isize;
        let (&(first, _), &(last, _)) = (self.waypoints.first()?, self.waypoints.last()?);
        let time = match self.period_s {
            Some(period) => seconds.rem_euclid(period),
            None if (first..=last).contains(&seconds) => seconds,
            None => return None,
        };
        // Includes the waypoints of the previous and next rounds; beyond the ends of a single walk, repeats its ends.
        let waypoint = |k: isize| match self.period_s {
            Some(period) => {
                let (t, p) = *self.waypoints.get(k.rem_euclid(count) as usize)?;
                Some((t + period * k.div_euclid(count) as f64, p))
            }
            None => self.waypoints.get(k.clamp(0, count - 1) as usize).copied(),
        };
        let next = self.waypoints.iter().position(|&(t, _)| t > time).unwrap_or(self.waypoints.len()) as isize;
        let [before, from, to, after] =
            [waypoint(next - 2)?, waypoint(next - 1)?, waypoint(next)?, waypoint(next + 1)?];
        let span = to.0 - from.0;
        if span <= 0.0 {
            return Some(from.1);
        }
        let u = (time - from.0) / span;
        let coordinate = |axis: usize| {
            let speed = |a: (f64, Point), b: (f64, Point), here: (f64, Point)| {
                // At rest at the ends of a single walk and in its pauses.
                let at_rest =
                    self.period_s.is_none() && (a.0 == here.0 || b.0 == here.0 || a.1 == here.1 || b.1 == here.1);
                if at_rest { 0.0 } else { (b.1[axis] - a.1[axis]) / (b.0 - a.0) }
            };
            let (m0, m1) = (span * speed(before, to, from), span * speed(from, after, to));
            let (p0, p1) = (from.1[axis], to.1[axis]);
            let (u2, u3) = (u * u, u * u * u);
            p0 * (2.0 * u3 - 3.0 * u2 + 1.0) + m0 * (u3 - 2.0 * u2 + u) + p1 * (3.0 * u2 - 2.0 * u3) + m1 * (u3 - u2)
        };
        Some([coordinate(0), coordinate(1)])
    }

    /// Length of the way from the first waypoint to where somebody is at a time in seconds, in metres. A repeated walk
    /// begins anew with each round.
    pub(super) fn length(&self, seconds: f64) -> f64 {
        let Some(&(first, _)) = self.waypoints.first() else { return 0.0 };
        let seconds = self.period_s.map_or(seconds, |period| seconds.rem_euclid(period));
        let ends = self.waypoints.iter().skip(1).map(|&(t, _)| t).take_while(|&t| t < seconds).chain([seconds]);
        let mut from = first;
        let mut length = 0.0;
        for to in ends {
            let step = (to - from) / CHORDS as f64;
            let place = |k: usize| self.at(from + k as f64 * step);
            for k in 0..CHORDS {
                if let (Some(a), Some(b)) = (place(k), place(k + 1)) {
                    length += (b[0] - a[0]).hypot(b[1] - a[1]);
                }
            }
            from = to;
        }
        length
    }
}

/// Chords as which the way between two waypoints is measured.
const CHORDS: usize = 12;

#[cfg(test)]
mod tests {
    use super::*;

    const PLACES: [(f64, Point); 4] = [(0.0, [0.0, 1.0]), (2.0, [1.0, 2.0]), (5.0, [-1.0, 1.5]), (6.0, [-1.0, 1.0])];

    fn is_smooth_at(walk: &Walk, times: &[f64]) {
        let velocity = |t: f64, h: f64| [0, 1].map(|i| (walk.at(t + h).unwrap()[i] - walk.at(t).unwrap()[i]) / h);
        for &t in times {
            let (before, after) = (velocity(t, -1e-6), velocity(t, 1e-6));
            assert!((0..2).all(|i| (before[i] - after[i]).abs() < 1e-4), "{t}: {before:?} {after:?}");
        }
    }

    #[test]
    fn a_walk_passes_its_waypoints_and_is_smooth_and_closed() {
        let walk = Walk { waypoints: PLACES.to_vec(), period_s: Some(8.0) };
        for &(t, p) in &walk.waypoints {
            for time in [t, t + 8.0, t - 8.0] {
                let at = walk.at(time).unwrap();
                assert!((at[0] - p[0]).hypot(at[1] - p[1]) < 1e-12);
            }
        }
        is_smooth_at(&walk, &[0.0, 2.0, 5.0, 6.0]);
        assert_eq!(Walk { waypoints: Vec::new(), period_s: Some(1.0) }.at(0.3), None);
    }

    #[test]
    fn the_length_of_a_way_is_that_of_a_chain_along_it() {
        for period_s in [None, Some(8.0)] {
            let walk = Walk { waypoints: PLACES.to_vec(), period_s };
            let chain = |to: f64| {
                let place = |k: i32| walk.at(to * f64::from(k) / 5000.0).unwrap();
                (0..5000).map(|k| (place(k + 1)[0] - place(k)[0]).hypot(place(k + 1)[1] - place(k)[1])).sum::<f64>()
            };
            for t in [0.0, 0.7, 2.0, 4.5, 6.0] {
                assert!((walk.length(t) - chain(t)).abs() < 0.01, "{t}: {} {}", walk.length(t), chain(t));
            }
        }
    }

    #[test]
    fn a_walk_that_is_gone_once_has_a_beginning_an_end_and_pauses() {
        let mut waypoints = PLACES.to_vec();
        waypoints.insert(2, (4.0, [1.0, 2.0]));
        let walk = Walk { waypoints, period_s: None };
        assert_eq!((walk.at(-0.01), walk.at(6.01)), (None, None));
        assert_eq!((walk.at(0.0), walk.at(6.0)), (Some([0.0, 1.0]), Some([-1.0, 1.0])));
        assert_eq!(walk.at(2.7), Some([1.0, 2.0]));
        is_smooth_at(&walk, &[2.0, 4.0, 5.0]);
        let slow = walk.at(0.001).unwrap();
        assert!(slow[0].hypot(slow[1] - 1.0) < 1e-5, "{slow:?}");
    }
}
