use pathfinding::prelude::{Matrix, kuhn_munkres};

use doorcam_core::geometry::Point;

/// Cutoff c, in metres: an estimate further away is somebody else. A missed target or false estimate costs c²/2.
pub const CUTOFF_M: f64 = 0.5;

/// Assigns estimates to targets one to one; returns for each target the index of its estimate.
///
/// Minimises Σ d² over the pairs plus c²/2 for each target or estimate without a partner, with c = `cutoff` in metres,
/// so that no pair is `cutoff` or further apart. A place that is not finite has no partner.
pub fn assign(targets: &[Point], estimates: &[Point], cutoff: f64) -> Vec<Option<usize>> {
    // A pair saves c² − d² compared with leaving both unassigned. As an integer, since the Hungarian algorithm needs a
    // total order.
    const UNIT: f64 = (1_u64 << 40) as f64;
    let saved = |target: Point, estimate: Point| {
        let share = 1.0 - squared(target, estimate) / (cutoff * cutoff);
        if share > 0.0 { (share * UNIT).round() as i64 } else { 0 }
    };
    // The algorithm needs at least as many columns as rows: columns beyond the estimates mean no partner.
    let columns = estimates.len().max(targets.len());
    let weights = Matrix::from_fn(targets.len(), columns, |(row, column)| {
        estimates.get(column).map_or(0, |&estimate| saved(targets[row], estimate))
    });
    let (_, chosen) = kuhn_munkres(&weights);
    chosen.into_iter().enumerate().map(|(row, column)| (weights[(row, column)] > 0).then_some(column)).collect()
}

/// The parts of one frame's squared GOSPA distance, in m².
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Gospa {
    /// Σ d² over the pairs.
    pub localisation_m2: f64,
    /// c²/2 for each target without an estimate.
    pub missed_m2: f64,
    /// c²/2 for each estimate without a target.
    pub false_m2: f64,
}

impl Gospa {
    /// From the squared errors of the pairs, in m², and the numbers of targets and estimates without a partner.
    pub fn new(squared_errors: impl IntoIterator<Item = f64>, missed: usize, strays: usize, cutoff: f64) -> Self {
        let alone = cutoff * cutoff / 2.0;
        Self {
            localisation_m2: squared_errors.into_iter().sum(),
            missed_m2: alone * missed as f64,
            false_m2: alone * strays as f64,
        }
    }

    /// The distance, in metres.
    pub fn distance_m(&self) -> f64 {
        (self.localisation_m2 + self.missed_m2 + self.false_m2).sqrt()
    }
}

/// The GOSPA distance between targets and estimates with p = 2, α = 2 and c = `cutoff` metres (Rahmathullah,
/// García-Fernández, Svensson, "Generalized optimal sub-pattern assignment metric", FUSION 2017, proposition 1):
///
/// min over partial assignments γ of ( Σ_{(i,j)∈γ} d(x_i, y_j)² + c²/2 (|X| + |Y| − 2|γ|) )^{1/2}
pub fn gospa(targets: &[Point], estimates: &[Point], cutoff: f64) -> Gospa {
    let pairs = assign(targets, estimates, cutoff);
    let errors: Vec<f64> =
        targets.iter().zip(&pairs).filter_map(|(&t, pair)| Some(squared(t, estimates[(*pair)?]))).collect();
    Gospa::new(errors.iter().copied(), targets.len() - errors.len(), estimates.len() - errors.len(), cutoff)
}

/// Squared distance, in m².
pub(super) fn squared(a: Point, b: Point) -> f64 {
    (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2)
}

#[cfg(test)]
mod tests {
    use proptest::collection::vec;
    use proptest::prelude::*;

    use super::*;

    /// The same distance from trying every partial assignment, with the power p = 2 written out.
    fn by_brute_force(targets: &[Point], estimates: &[Point], c: f64) -> f64 {
        fn least(targets: &[Point], estimates: &[Point], taken: &mut Vec<bool>, c: f64) -> f64 {
            let Some((first, rest)) = targets.split_first() else {
                return c.powi(2) / 2.0 * taken.iter().filter(|taken| !**taken).count() as f64;
            };
            let mut best = c.powi(2) / 2.0 + least(rest, estimates, taken, c);
            for k in 0..estimates.len() {
                if !taken[k] {
                    taken[k] = true;
                    let d = (first[0] - estimates[k][0]).hypot(first[1] - estimates[k][1]);
                    best = best.min(d.powi(2) + least(rest, estimates, taken, c));
                    taken[k] = false;
                }
            }
            best
        }
        least(targets, estimates, &mut vec![false; estimates.len()], c).sqrt()
    }

    fn places() -> impl Strategy<Value = Vec<Point>> {
        // A small room, so that pairs within and beyond the cutoff are both common.
        vec([-0.8..0.8, 0.0..1.6], 0..5)
    }

    proptest! {
        #[test]
        fn it_is_the_least_over_all_partial_assignments(x in places(), y in places(), c in 0.1..1.5) {
            let found = gospa(&x, &y, c).distance_m();
            let expected = by_brute_force(&x, &y, c);
            prop_assert!((found - expected).abs() < 1e-5, "{found} {expected}");
        }

        #[test]
        fn it_is_a_distance(x in places(), y in places(), z in places()) {
            let d = |a: &[Point], b: &[Point]| gospa(a, b, CUTOFF_M).distance_m();
            prop_assert_eq!(d(&x, &x), 0.0);
            prop_assert!((d(&x, &y) - d(&y, &x)).abs() < 1e-6);
            prop_assert!(d(&x, &z) <= d(&x, &y) + d(&y, &z) + 1e-6);
        }

        #[test]
        fn a_mirrored_room_has_the_mirrored_assignment(x in places(), y in places()) {
            let mirrored = |places: &[Point]| places.iter().map(|[x, y]| [-x, *y]).collect::<Vec<_>>();
            prop_assert_eq!(assign(&x, &y, CUTOFF_M), assign(&mirrored(&x), &mirrored(&y), CUTOFF_M));
        }

        #[test]
        fn pairs_are_one_to_one_and_within_the_cutoff(x in places(), y in places()) {
            let pairs = assign(&x, &y, CUTOFF_M);
            let mut taken: Vec<usize> = pairs.iter().flatten().copied().collect();
            prop_assert!(pairs.iter().zip(&x).all(|(p, &x)| p.is_none_or(|k| squared(x, y[k]) < CUTOFF_M.powi(2))));
            taken.sort_unstable();
            let count = taken.len();
            taken.dedup();
            prop_assert_eq!(taken.len(), count);
        }
    }

    #[test]
    fn its_parts_are_those_of_the_paper() {
        // One 0.3 m off, one missed, two made up: 0.09, 0.125 and 0.25.
        let parts = gospa(&[[0.0, 1.0], [1.0, 2.0]], &[[0.3, 1.0], [-1.0, 1.0], [-1.0, 2.0]], 0.5);
        assert!((parts.localisation_m2 - 0.09).abs() < 1e-12);
        assert_eq!([parts.missed_m2, parts.false_m2], [0.125, 0.25]);
        assert!((parts.distance_m() - 0.465f64.sqrt()).abs() < 1e-12);
        // Two pairs beat the one with distance 0: 0.3² + 0.3² < 0 + 2 c²/2.
        let pairs = assign(&[[0.0, 1.0], [0.3, 1.0]], &[[0.3, 1.0], [0.6, 1.0]], 0.5);
        assert_eq!(pairs, [Some(0), Some(1)]);
    }

    #[test]
    fn a_place_that_is_none_has_no_partner() {
        assert_eq!(assign(&[[0.0, 1.0]], &[[f64::NAN, 1.0], [f64::INFINITY, 1.0]], 0.5), [None]);
        assert_eq!(assign(&[[0.0, 1.0]], &[], 0.5), [None]);
        assert_eq!(assign(&[], &[[0.0, 1.0]], 0.5), []);
        assert_eq!(gospa(&[], &[], 0.5), Gospa::default());
    }
}
