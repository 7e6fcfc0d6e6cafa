//! A solve with a workspace that was used before allocates nothing.

mod solver_problems;

use std::alloc::System;

use doorcam::solver::{Admissible, Limits, Solution, Start};
use solver_problems::Problem;
use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};

#[global_allocator]
static COUNTING: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

/// Allocations, at least: the test runner's own thread may add some now and then, so the fewest of a few runs count.
fn allocations(mut f: impl FnMut()) -> usize {
    let once = |_| {
        let region = Region::new(COUNTING);
        f();
        let change = region.change();
        change.allocations + change.reallocations
    };
    (0..3).map(once).min().unwrap_or(0)
}

// The only test in this file: others beside it would be counted too.
#[test]
fn no_allocation_after_the_first_solve() {
    assert!(allocations(|| drop(std::hint::black_box(vec![1, 2, 3]))) > 0, "the counter counts");
    for kind in [Admissible::Brighter, Admissible::EitherSign, Admissible::Signed] {
        let problem = Problem::random(60, 40, 7, |_| kind);
        let solver = problem.solver();
        let mut workspace = solver.workspace();
        let mut solution = Solution::default();
        let lambda = 0.05 * solver.lambda_max(&problem.frame);
        let mut solve = |share: f64, start: Start| {
            solver.solve_into(&problem.frame, share * lambda, Limits::default(), start, &mut workspace, &mut solution);
            assert!(solution.intensities.iter().any(|i| i.left != 0.0));
        };
        solve(1.0, Start::Empty);
        assert_eq!(allocations(|| solve(1.0, Start::Empty)), 0, "{kind:?}, again");
        assert_eq!(allocations(|| solve(2.0, Start::Previous)), 0, "{kind:?}, warm");
        assert_eq!(allocations(|| solve(1.5, Start::Previous)), 0, "{kind:?}, warm");
    }
}
