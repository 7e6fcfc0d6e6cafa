//! Reports that tell only in which direction somebody is.

use pathfinding::prelude::{Matrix, kuhn_munkres};

use super::Estimate;
use super::figures::CHI_SQUARE_95;
use doorcam_core::geometry::Point;

/// A direction's 95 % ellipse has semi-axes of at most these lengths across and along, in metres: a longer or wider
/// one tells nothing.
pub const DIRECTION_M: [f64; 2] = [0.25, 1.5];

impl Estimate {
    /// Semi-axes of the 95 % ellipse, in metres, the shorter one first; none if the covariance defines no ellipse.
    pub fn semi_axes_m(&self) -> Option<[f64; 2]> {
        let [[xx, xy], [_, yy]] = self.covariance;
        let (mean, spread) = ((xx + yy) / 2.0, ((xx - yy) / 2.0).hypot(xy));
        let axes = [mean - spread, mean + spread].map(|variance| (CHI_SQUARE_95 * variance).sqrt());
        axes.iter().all(|&axis| axis > 0.0 && axis.is_finite()).then_some(axes)
    }

    /// eᵀ P⁻¹ e for somebody who is really at `place`, with the error e and the covariance P; infinite if P is not
    /// positive definite.
    pub(super) fn nees(&self, place: Point) -> f64 {
        let Self { position, covariance: [[xx, xy], [_, yy]], .. } = self;
        let [x, y] = [position[0] - place[0], position[1] - place[1]];
        let determinant = xx * yy - xy * xy;
        if *xx > 0.0 && determinant > 0.0 {
            (yy * x * x - 2.0 * xy * x * y + xx * y * y) / determinant
        } else {
            f64::INFINITY
        }
    }

    /// Whether it tells a direction, so that somebody at `place` can be who is meant.
    fn points_at(&self, place: Point) -> bool {
        let narrow =
            self.semi_axes_m().is_some_and(|axes| axes.iter().zip(DIRECTION_M).all(|(axis, most)| *axis <= most));
        narrow && self.nees(place) <= CHI_SQUARE_95
    }
}

/// Somebody whom no report is near.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Alone {
    /// The true place, in metres in the door frame.
    pub place: Point,
    /// Whether they should have been found.
    pub counts: bool,
}

/// Assigns to people who have no report the reports without a partner whose ellipses hold them, one to one; returns for
/// each person the index of their report.
///
/// As many reports as possible have a person; among such assignments, as many people as possible are some who count,
/// and then the reports point at them as exactly as they can.
pub(super) fn assign_directions(people: &[Alone], reports: &[Estimate]) -> Vec<Option<usize>> {
    // Each of these outweighs any sum of the next for up to 256 people, the most in a frame of truth.json. Integers,
    // since the Hungarian algorithm needs a total order.
    const PAIR: i64 = 1 << 40;
    const COUNTS: i64 = 1 << 30;
    const EXACT: f64 = (1 << 20) as f64;
    let weight = |person: &Alone, report: &Estimate| {
        if !report.points_at(person.place) {
            return 0;
        }
        let exact = (EXACT * (1.0 - report.nees(person.place) / CHI_SQUARE_95)) as i64;
        PAIR + if person.counts { COUNTS } else { 0 } + exact
    };
    if people.is_empty() || reports.is_empty() {
        return vec![None; people.len()];
    }
    // The algorithm needs at least as many columns as rows: columns beyond the reports mean no partner.
    let columns = reports.len().max(people.len());
    let weights = Matrix::from_fn(people.len(), columns, |(row, column)| {
        reports.get(column).map_or(0, |report| weight(&people[row], report))
    });
    let (_, chosen) = kuhn_munkres(&weights);
    chosen.into_iter().enumerate().map(|(row, column)| (weights[(row, column)] > 0).then_some(column)).collect()
}

#[cfg(test)]
mod tests {
    use proptest::collection::vec;
    use proptest::prelude::*;

    use super::*;

    /// With semi-axes of these lengths, the second one turned by `angle` from y.
    fn report(position: Point, [across, along]: [f64; 2], angle: f64) -> Estimate {
        let [a, b] = [across, along].map(|axis| axis * axis / CHI_SQUARE_95);
        let (sin, cos) = angle.sin_cos();
        let [xx, xy, yy] = [cos * cos * a + sin * sin * b, sin * cos * (a - b), sin * sin * a + cos * cos * b];
        Estimate { id: None, position, covariance: [[xx, xy], [xy, yy]] }
    }

    #[test]
    fn the_axes_are_those_of_the_ellipse_however_it_is_turned() {
        for angle in [0.0, 0.4, 1.2, 2.0, 3.0] {
            let [short, long] = report([0.1, 2.0], [0.2, 1.1], angle).semi_axes_m().unwrap();
            assert!((short - 0.2).abs() < 1e-9 && (long - 1.1).abs() < 1e-9, "{angle}: {short} {long}");
        }
        for covariance in [[[0.0; 2]; 2], [[0.01, 0.02], [0.02, 0.01]], [[f64::NAN, 0.0], [0.0, 1.0]]] {
            assert_eq!(Estimate { id: None, position: [0.0; 2], covariance }.semi_axes_m(), None);
        }
    }

    #[test]
    fn a_direction_is_narrow_and_holds_somebody() {
        let here = [0.0, 2.0];
        let points = |across, along, offset: Point| {
            report([here[0] + offset[0], here[1] + offset[1]], [across, along], 0.0).points_at(here)
        };
        assert!(points(0.24, 1.49, [0.0, 1.4]));
        assert!(points(0.24, 1.49, [0.2, 0.5]));
        // Outside, though within the axes; too wide; too long.
        assert!(!points(0.24, 1.49, [0.2, 1.0]));
        assert!(!points(0.26, 1.49, [0.0, 0.6]));
        assert!(!points(0.24, 1.51, [0.0, 0.6]));
    }

    /// Pairs, people who count, and the sum of what they miss by, from trying every assignment: the best of all.
    fn by_brute_force(people: &[Alone], reports: &[Estimate], taken: &mut Vec<bool>) -> (usize, usize, f64) {
        let Some((first, rest)) = people.split_first() else { return (0, 0, 0.0) };
        let mut best = by_brute_force(rest, reports, taken);
        for k in 0..reports.len() {
            if !taken[k] && reports[k].points_at(first.place) {
                taken[k] = true;
                let (pairs, counting, exact) = by_brute_force(rest, reports, taken);
                let exact = exact + 1.0 - reports[k].nees(first.place) / CHI_SQUARE_95;
                let found = (pairs + 1, counting + usize::from(first.counts), exact);
                best = if found.partial_cmp(&best).is_some_and(|order| order.is_gt()) { found } else { best };
                taken[k] = false;
            }
        }
        best
    }

    fn people() -> impl Strategy<Value = Vec<Alone>> {
        vec(([-0.3..0.3, 0.5..3.0], any::<bool>()).prop_map(|(place, counts)| Alone { place, counts }), 0..5)
    }

    fn reports() -> impl Strategy<Value = Vec<Estimate>> {
        let one = ([-0.3..0.3, 0.5..3.0], [0.15..0.27, 0.5..1.6], -0.2..0.2);
        vec(one.prop_map(|(position, axes, angle)| report(position, axes, angle)), 0..5)
    }

    proptest! {
        #[test]
        fn it_is_the_best_of_all_assignments(people in people(), reports in reports()) {
            let chosen = assign_directions(&people, &reports);
            let pairs: Vec<_> = people.iter().zip(&chosen).filter_map(|(p, k)| Some((p, (*k)?))).collect();
            let mut taken: Vec<usize> = pairs.iter().map(|(_, k)| *k).collect();
            taken.sort_unstable();
            taken.dedup();
            prop_assert_eq!(taken.len(), pairs.len());
            prop_assert!(pairs.iter().all(|(person, k)| reports[*k].points_at(person.place)));
            let exact: f64 = pairs.iter().map(|(p, k)| 1.0 - reports[*k].nees(p.place) / CHI_SQUARE_95).sum();
            let best = by_brute_force(&people, &reports, &mut vec![false; reports.len()]);
            prop_assert_eq!((pairs.len(), pairs.iter().filter(|(p, _)| p.counts).count()), (best.0, best.1));
            prop_assert!((exact - best.2).abs() < 1e-4, "{exact} {}", best.2);
        }
    }
}
