//! Tracking allocates nothing once as many people have been tracked before, unless two compete for the same detection.

use crate::allocations;
use doorcam_core::geometry::Room;
use doorcam_core::tracking::{Detection, TrackState, Tracker, TrackerSettings};

/// Four people, each on a circle of their own, and a false alarm every second.
fn seen(k: usize) -> Vec<Detection> {
    let t = k as f64 / 15.0;
    let at = |position| {
        let covariance = [[0.004, 0.001], [0.001, 0.01]];
        Detection { position, covariance, rgb: [-0.02; 3], significance: 80.0 }
    };
    let person = |i: usize| at([-0.9 + 0.6 * i as f64 + 0.1 * t.cos(), 1.0 + 0.5 * (i % 2) as f64 + 0.1 * t.sin()]);
    (0..4).map(person).chain(k.is_multiple_of(15).then(|| at([1.0 - 0.02 * k as f64 % 2.0, 2.8]))).collect()
}

pub fn check() {
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
    let fewest = (0..4).map(|round| allocations(|| (0..30).for_each(|k| step(60 + 30 * round + k)))).min();
    assert_eq!(fewest, Some(0));
    let confirmed = tracker.tracks().iter().filter(|t| t.state == TrackState::Confirmed).count();
    assert!(confirmed >= 4, "{confirmed}");
}
