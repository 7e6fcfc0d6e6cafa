//! Compares the refit, which uses only Gram products, with its definition on columns and measurements.

use crate::solver_problems::{Numbers, Problem};
use crate::testing::cases;
use doorcam_core::scene::Intensity;
use doorcam_core::solver::{Admissible, Correlations, Limits, Solution, Solver};
use nalgebra::{DMatrix, DVector};
use proptest::prelude::*;

fn refit(solver: &Solver, frame: &Correlations, solution: &Solution) -> Vec<f64> {
    let mut factors = Vec::new();
    solver.refit(frame, solution, &mut factors);
    factors
}

fn is_lit(i: &Intensity) -> bool {
    i.left != 0.0 || i.right != 0.0
}

/// Both patches in all colours stacked: what each facet adds (u_n, one column per facet), and y.
fn stacked(problem: &Problem, intensities: &[Intensity]) -> (DMatrix<f64>, DVector<f64>) {
    let pixels = problem.y[0][0].len();
    let part = |k: usize| (k / (3 * pixels), k / pixels % 3, k % pixels);
    let u = DMatrix::from_fn(6 * pixels, intensities.len(), |k, n| {
        let ((s, p, k), i) = (part(k), &intensities[n]);
        problem.columns[s][(k, n)] * [i.left, i.right][s] * i.colour[p]
    });
    let y = DVector::from_fn(6 * pixels, |k, _| {
        let (s, p, k) = part(k);
        problem.y[s][p][k]
    });
    (u, y)
}

/// ½ ‖y − Σ f_n u_n‖².
fn data(u: &DMatrix<f64>, y: &DVector<f64>, f: &[f64]) -> f64 {
    0.5 * (y - u * DVector::from_column_slice(f)).norm_squared()
}

/// The term that ties the factors together, written out.
fn ties(u: &DMatrix<f64>, f: &[f64]) -> f64 {
    let mut sum = 0.0;
    for m in 0..f.len() {
        for n in 0..m {
            let alike = u.column(n).dot(&u.column(m));
            sum += 0.5 * alike.abs() * (f[n] - 1.0 - alike.signum() * (f[m] - 1.0)).powi(2);
        }
    }
    sum
}

fn solved(problem: &Problem, share: f64) -> Solution {
    let solver = problem.solver();
    let lambda = share * solver.lambda_max(&problem.frame);
    solver.solve(&problem.frame, lambda, Limits::default(), None)
}

fn kind() -> impl Strategy<Value = Admissible> {
    prop::sample::select(vec![Admissible::Brighter, Admissible::EitherSign, Admissible::Signed])
}

proptest! {
    #![proptest_config(cases(1000))]

    /// For solutions, and for arbitrary maps: a solve that was cut short gives one that is not stationary.
    #[test]
    fn no_other_factors_are_better(
        seed in any::<u64>(), facets in 1usize..12, share in 0.02..0.9f64, kind in kind(), settled in any::<bool>(),
    ) {
        let problem = Problem::random(facets, 12, seed, |_| kind);
        let mut solution = solved(&problem, share);
        let mut numbers = Numbers::new(seed ^ 3);
        if !settled {
            solution.intensities.iter_mut().for_each(|i| *i = Problem::admissible(kind, &mut numbers));
        }
        let factors = refit(&problem.solver(), &problem.frame, &solution);
        let (u, y) = stacked(&problem, &solution.intensities);
        let objective = |f: &[f64]| data(&u, &y, f) + ties(&u, f);
        let ours = objective(&factors);
        let rounding = 1e-11 * y.norm_squared();
        prop_assert!(factors.iter().all(|&f| f >= 0.0));
        prop_assert!(data(&u, &y, &factors) <= data(&u, &y, &vec![1.0; facets]) + rounding, "the residual grew");
        for k in 0..40 {
            let size = 10f64.powi(1 - k % 5);
            let other: Vec<f64> = factors.iter().map(|f| (f + size * numbers.signed()).max(0.0)).collect();
            prop_assert!(objective(&other) >= ours - rounding, "{other:?} is better than {factors:?}");
        }
    }

    #[test]
    fn factors_are_between_one_and_what_a_facet_alone_would_take(
        seed in any::<u64>(), facets in 1usize..12, share in 0.02..0.9f64, kind in kind(),
    ) {
        let problem = Problem::random(facets, 12, seed, |_| kind);
        let solution = solved(&problem, share);
        let factors = refit(&problem.solver(), &problem.frame, &solution);
        let (u, y) = stacked(&problem, &solution.intensities);
        let residual = &y - &u * DVector::repeat(facets, 1.0);
        for (n, light) in solution.intensities.iter().enumerate() {
            let column = u.column(n);
            let alone = if is_lit(light) { 1.0 + column.dot(&residual) / column.norm_squared() } else { 1.0 };
            prop_assert!(factors[n] >= 1.0 - 1e-6, "facet {n}: {}", factors[n]);
            prop_assert!(factors[n] <= alone + 1e-6 * alone.abs(), "facet {n}: {} {alone}", factors[n]);
        }
    }

    /// With one facet: least squares in one unknown, and brute force over a fine lattice of factors.
    #[test]
    fn a_facet_alone_gets_its_least_squares_brightness(seed in any::<u64>(), share in 0.02..0.9f64, kind in kind()) {
        let problem = Problem::random(1, 12, seed, |_| kind);
        let solution = solved(&problem, share);
        // A facet that may only become brighter stays dark if the measurement only darkens.
        prop_assume!(is_lit(&solution.intensities[0]));
        let factor = refit(&problem.solver(), &problem.frame, &solution)[0];
        let (u, y) = stacked(&problem, &solution.intensities);
        let exact = u.column(0).dot(&y) / u.column(0).norm_squared();
        prop_assert!((factor - exact).abs() < 1e-9 * exact, "{factor} {exact}");
        let ours = data(&u, &y, &[factor]);
        for k in 0..=400 {
            prop_assert!(data(&u, &y, &[factor * f64::from(k) / 200.0]) >= ours * (1.0 - 1e-12));
        }
    }

    /// Two facets with the same column and colour, among others, however the light is divided between them.
    #[test]
    fn facets_that_cannot_be_told_apart_get_one_factor(
        seed in any::<u64>(), facets in 3usize..8, division in 0.01..0.99f64,
    ) {
        let mut numbers = Numbers::new(seed);
        let plain = Problem::random(facets, 12, seed, |_| Admissible::Signed);
        let columns = plain.columns.clone().map(|mut c| {
            let first = c.column(0).clone_owned();
            c.set_column(1, &first);
            c
        });
        let problem = Problem::new(columns, plain.y.clone(), plain.kinds.clone());
        let mut intensities: Vec<Intensity> =
            (0..facets).map(|_| Problem::admissible(Admissible::Signed, &mut numbers)).collect();
        let whole = intensities[0];
        let part = |share: f64| Intensity { left: share * whole.left, right: share * whole.right, ..whole };
        (intensities[0], intensities[1]) = (part(division), part(1.0 - division));
        let divided = Solution { intensities: intensities.clone(), ..Solution::default() };
        let factors = refit(&problem.solver(), &problem.frame, &divided);
        prop_assert!((factors[0] - factors[1]).abs() < 1e-9 * factors[0].max(1.0), "{factors:?}");
        // The same as for one facet with all of their light.
        (intensities[0], intensities[1]) = (whole, Intensity::default());
        let single = Solution { intensities, ..Solution::default() };
        let expected = refit(&problem.solver(), &problem.frame, &single);
        prop_assert!((factors[0] - expected[0]).abs() < 1e-9 * factors[0].max(1.0), "{factors:?} {expected:?}");
    }

    #[test]
    fn factors_do_not_scale_with_the_measurement(
        seed in any::<u64>(), facets in 1usize..12, share in 0.02..0.9f64, scale in -3..4i32,
    ) {
        // A power of two scales without rounding.
        let scale = f64::from(scale).exp2();
        let problem = Problem::random(facets, 12, seed, |_| Admissible::Signed);
        let solution = solved(&problem, share);
        let mut frame = problem.frame.clone();
        frame.rhs.iter_mut().flatten().flatten().for_each(|x| *x *= scale);
        frame.energy *= scale * scale;
        let mut scaled = solution.clone();
        scaled.intensities.iter_mut().for_each(|i| (i.left, i.right) = (scale * i.left, scale * i.right));
        let solver = problem.solver();
        prop_assert_eq!(refit(&solver, &frame, &scaled), refit(&solver, &problem.frame, &solution));
    }

    #[test]
    fn a_mirrored_problem_has_the_mirrored_factors(
        seed in any::<u64>(), facets in 1usize..12, share in 0.02..0.9f64,
    ) {
        let problem = Problem::random(facets, 12, seed, |_| Admissible::Signed);
        let solution = solved(&problem, share);
        let ours = refit(&problem.solver(), &problem.frame, &solution);
        // Left and right swapped, and the facets in the opposite order.
        let [left, right] =
            problem.columns.clone().map(|c| DMatrix::from_fn(12, facets, |k, n| c[(k, facets - 1 - n)]));
        let [y_left, y_right] = problem.y.clone();
        let mirrored = Problem::new([right, left], [y_right, y_left], problem.kinds.clone());
        let intensities = solution.intensities.iter().rev();
        let intensities = intensities.map(|&i| Intensity { left: i.right, right: i.left, ..i }).collect();
        let solution = Solution { intensities, ..Solution::default() };
        let theirs = refit(&mirrored.solver(), &mirrored.frame, &solution);
        for (ours, theirs) in ours.iter().zip(theirs.iter().rev()) {
            prop_assert!((ours - theirs).abs() < 1e-9 * ours, "{ours} {theirs}");
        }
    }
}

/// Plain least squares does what the ties prevent: for nearly equal columns it makes one factor many times the other.
#[test]
fn neighbours_stay_alike_where_least_squares_tears_them_apart() {
    let plain = Problem::random(2, 12, 5, |_| Admissible::Signed);
    let columns = plain.columns.clone().map(|mut c| {
        let near = c.column(0) + 0.02 * c.column(1);
        c.set_column(1, &near);
        c
    });
    let noise = |k: usize| if k.is_multiple_of(2) { 0.02 } else { -0.02 };
    let light = Intensity { left: 0.4, right: 0.4, colour: [0.6, 0.8, 0.0] };
    let y = [0, 1].map(|s| {
        [0, 1, 2].map(|p| {
            let both = (columns[s].column(0) + columns[s].column(1)) * (1.3 * light.left * light.colour[p]);
            DVector::from_fn(12, |k, _| both[k] + noise(k))
        })
    });
    let problem = Problem::new(columns, y, plain.kinds.clone());
    let solution = Solution { intensities: vec![light; 2], ..Solution::default() };
    let (u, y) = stacked(&problem, &solution.intensities);
    let least = (u.transpose() * &u).lu().solve(&(u.transpose() * &y)).unwrap();
    assert!((least[0] - least[1]).abs() > 0.5, "least squares keeps them alike, so this tests nothing: {least}");
    let factors = refit(&problem.solver(), &problem.frame, &solution);
    assert!(factors.iter().all(|f| (f - 1.3).abs() < 0.05), "{factors:?}");
}
