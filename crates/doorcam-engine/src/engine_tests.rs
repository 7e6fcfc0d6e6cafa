#![cfg(feature = "simulation")]

use super::*;
use crate::simulation::{Scenario, Simulator};
use crate::{Assembly, Settings};

/// A doorway with nobody in the room, seen by a camera whose line of sight is turned by so many metres on the floor.
fn seen_by(aside_m: f64) -> Simulator {
    let mut scenario = Scenario::load("one-person").unwrap();
    scenario.background_s = 3.0;
    scenario.person.clear();
    scenario.camera.look_at_m[0] += aside_m;
    Simulator::new(scenario, 1).unwrap()
}

#[test]
fn frames_do_not_wait_for_what_is_set_up_for_a_camera_that_was_nudged() {
    let (before, after) = (seen_by(0.0), seen_by(0.008));
    let mut settings = Settings::default();
    settings.patch.pixels = 32;
    let assembly = Assembly::new(settings).without_people().rolling(Work::InPlace);
    let mut engine = assembly.for_recording(before.manifest()).unwrap();
    let step = |engine: &mut Engine, number: u64| {
        let frame = if number < 45 { &before } else { &after }.frame(number).unwrap();
        engine.step(&frame, Timestamp::UNIX_EPOCH).unwrap().update
    };
    for number in 0..45 {
        step(&mut engine, number);
    }
    engine.parts.plan = engine.parts.plan.clone().rolling(Work::Aside);
    let noticed = (45..100).find(|&number| {
        let update = step(&mut engine, number);
        // The frame in which it is noticed is done before what it started is looked at.
        assert!(engine.take_followed().is_none() && update.camera_moved.is_none());
        engine.moving.is_some()
    });
    let mut number = noticed.expect("noticed");
    let patience = Instant::now() + Duration::from_secs(120);
    let followed = loop {
        number += 1;
        let update = step(&mut engine, number.min(99));
        if let Some(followed) = engine.take_followed() {
            assert!(update.camera_moved.is_some_and(|moved| moved.corrected));
            break followed;
        }
        assert!(update.facets.is_empty() && update.state == State::Misaligned, "no map until then");
        assert!(Instant::now() < patience, "never followed");
    };
    let pixels = |calibration: &Calibration| calibration.floor_points.iter().map(|p| p.pixel).collect::<Vec<_>>();
    let there = pixels(&after.manifest().calibration().unwrap());
    for (now, there) in pixels(&followed).iter().zip(there) {
        assert!((now[0] - there[0]).hypot(now[1] - there[1]) < 0.6, "{now:?} {there:?}");
    }
    assert!(engine.moving.is_none());
}

/// What is put down shades the patch and the floor beside the wall. Neither may keep people from being found for long.
#[test]
fn whoever_walks_in_the_room_after_a_bag_was_put_down_is_followed() {
    let simulator = Simulator::new(Scenario::load("bag").unwrap(), 1).unwrap();
    let mut engine = Assembly::new(Settings::default()).for_recording(simulator.manifest()).unwrap();
    let (mut there, mut followed) = (0, 0);
    for number in (0..simulator.scenario().frames()).step_by(2) {
        let Ok(published) = engine.step(&simulator.frame(number).unwrap(), Timestamp::UNIX_EPOCH) else { continue };
        let update = published.update;
        if let [target] = simulator.truth(number).targets[..] {
            let near = |x_m: f64, y_m: f64| (x_m - target.x_m).hypot(y_m - target.y_m) < 0.5;
            there += 1;
            followed += usize::from(update.tracks.iter().any(|track| near(track.x_m, track.y_m)));
        } else {
            assert!(update.tracks.iter().all(|track| track.state != TrackState::Confirmed), "frame {number}");
        }
    }
    assert!(there > 50 && 2 * followed > there, "{followed} of {there}");
}
