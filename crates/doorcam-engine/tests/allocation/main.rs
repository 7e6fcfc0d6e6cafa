//! Per-frame work allocates nothing once it has been done before.

mod jpeg;
mod solver;
#[path = "../../../doorcam-core/tests/solver_problems/mod.rs"]
mod solver_problems;
mod tracker;
mod visible;

use std::alloc::System;

use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};

#[global_allocator]
static COUNTING: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

/// Fewest allocations of a few runs, since the test runner's own thread may add some now and then.
fn allocations(mut f: impl FnMut()) -> usize {
    let once = |_| {
        let region = Region::new(COUNTING);
        f();
        let change = region.change();
        change.allocations + change.reallocations
    };
    (0..4).map(once).min().unwrap_or(0)
}

// A single test: two at a time would count each other's allocations.
#[test]
fn nothing_is_allocated_after_the_first_frames() {
    assert!(allocations(|| drop(std::hint::black_box(vec![1, 2, 3]))) > 0, "the counter counts");
    jpeg::check();
    solver::check();
    tracker::check();
    visible::check();
}
