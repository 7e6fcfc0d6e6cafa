//! What is done for every frame allocates nothing once it was done before.

mod jpeg;
mod solver;
#[path = "../../../doorcam-core/tests/solver_problems/mod.rs"]
mod solver_problems;
mod tracker;

use std::alloc::System;

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
    (0..4).map(once).min().unwrap_or(0)
}

// One test: two at a time would count each other's.
#[test]
fn nothing_is_allocated_after_the_first_frames() {
    assert!(allocations(|| drop(std::hint::black_box(vec![1, 2, 3]))) > 0, "the counter counts");
    jpeg::check();
    solver::check();
    tracker::check();
}
