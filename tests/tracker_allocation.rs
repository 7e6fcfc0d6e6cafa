//! Following people allocates nothing once as many were followed before, unless two want the same detection.

use std::alloc::System;

use doorcam::geometry::Room;
use doorcam::tracking::{Detection, TrackState, Tracker, TrackerSettings};
use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};

#[global_allocator]
static COUNTING: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

fn allocations(mut f: impl FnMut()) -> usize {
    let region = Region::new(COUNTING);
    f();
    let change = region.change();
    change.allocations + change.reallocations
}

/// Four people on circles of their own; every second, a false alarm.
fn seen(k: usize) -> Vec<Detection> {
    let t = k as f64 / 15.0;
    let at = |position| {
        let covariance = [[0.004, 0.001], [0.001, 0.01]];
        Detection { position, covariance, rgb: [-0.02; 3], significance: 80.0 }
    };
    let person = |i: usize| at([-0.9 + 0.6 * i as f64 + 0.1 * t.cos(), 1.0 + 0.5 * (i % 2) as f64 + 0.1 * t.sin()]);
    (0..4).map(person).chain(k.is_multiple_of(15).then(|| at([1.0 - 0.02 * k as f64 % 2.0, 2.8]))).collect()
}

// The only test in this file: others beside it would be counted too.
#[test]
fn no_allocation_after_the_first_seconds() {
    assert!(allocations(|| drop(std::hint::black_box(vec![1, 2, 3]))) > 0, "the counter counts");
    let room = Room { half_width_m: 1.5, depth_m: 3.0 };
    let mut tracker = Tracker::new(TrackerSettings {
        room,
        margin_m: 0.2,
        body_radius_m: 0.2,
        confirm_s: 0.4,
        coast_s: 1.5,
        max_people: 8,
    });
    let frames: Vec<Vec<Detection>> = (0..180).map(seen).collect();
    let mut step = |k: usize| {
        tracker.step(k as f64 / 15.0, &frames[k]);
        assert!(tracker.predictions(k as f64 / 15.0 + 0.1).count() >= 4);
    };
    (0..60).for_each(&mut step);
    // The test runner's own thread may add some now and then.
    let fewest = (0..4).map(|round| allocations(|| (0..30).for_each(|k| step(60 + 30 * round + k)))).min();
    assert_eq!(fewest, Some(0));
    let confirmed = tracker.tracks().iter().filter(|t| t.state == TrackState::Confirmed).count();
    assert!(confirmed >= 4, "{confirmed}");
}
