//! Frames averaged over time: fainter people show, an empty room shows nothing, and nothing is averaged across a
//! change.

use crate::live_room::{Camera, change, lit, person, scenario, settings, states};
use doorcam_core::light::Averaging;
use doorcam_engine::Settings;
use doorcam_engine::simulation::luminous::direct::Cylinder;
use doorcam_engine::{Published, State};
use doorcam_source::Purpose;

const MODES: [(Averaging, f64); 3] = [(Averaging::None, 0.0), (Averaging::Boxcar, 0.5), (Averaging::Exponential, 0.5)];

fn averaging(mode: Averaging, time_s: f64) -> Settings {
    let mut settings = settings();
    settings.averaging.mode = mode;
    if mode != Averaging::None {
        settings.averaging.time_s = time_s;
    }
    settings
}

fn learned(camera: &mut Camera) {
    for _ in 0..400 {
        let light = camera.renderer.empty().clone();
        if camera.see(&light).update.state == State::Watching {
            return;
        }
    }
    panic!("never learned");
}

fn noise_lambda(updates: &[Published]) -> f64 {
    let mut all: Vec<f64> = updates.iter().map(|u| u.update.solution.lambda).collect();
    all.sort_by(f64::total_cmp);
    all[all.len() / 2]
}

/// A busy or slow machine works on a frame every one or two seconds, unevenly.
#[test]
fn the_empty_room_is_learned_from_few_uneven_frames() {
    for slowest_s in [0.4, 1.0, 2.0, 4.0] {
        for (mode, time_s) in MODES {
            let mut camera = Camera::new(&scenario(0.4, 2.0), &averaging(mode, time_s), 10.0);
            let light = camera.renderer.empty().clone();
            let mut seconds = 0.0;
            let learned = (0..60_u64).find(|k| {
                camera.frame = k + 1;
                seconds += slowest_s * (0.5 + 0.5 * (k * 37 % 60) as f64 / 59.0);
                camera.see_at(&light, seconds, Purpose::Live).update.state == State::Watching
            });
            assert!(learned.is_some(), "{mode:?}: not learned from 60 frames up to {slowest_s} s apart");
        }
    }
}

/// The least share by which a person must be darker than the wall behind to show in every frame of 1.5 s.
fn faintest(camera: &mut Camera) -> f64 {
    let (dark, empty) = (camera.renderer.render(vec![person([0.2, 1.6])]), camera.renderer.empty().clone());
    let mut strength = 0.02;
    loop {
        let mut values = dark.left.data().iter().chain(dark.right.data());
        let faint = blend(&empty, &mut values, strength);
        let updates = camera.look(&faint, 3.0);
        let late = &updates[updates.len() / 2..];
        // Seen in every frame, so that the background does not follow it either.
        if late.iter().all(|u| lit(u) > 0) {
            camera.empty(4.0);
            return strength;
        }
        camera.empty(2.0);
        strength *= 1.2;
        assert!(strength < 4.0);
    }
}

fn blend<'a>(
    empty: &doorcam_core::light::PatchPair,
    dark: &mut impl Iterator<Item = &'a f32>,
    share: f64,
) -> doorcam_core::light::PatchPair {
    change(empty, |_, _, v| v + share as f32 * (dark.next().copied().unwrap_or(v) - v))
}

#[test]
fn averages_show_fainter_people_and_nothing_in_an_empty_room() {
    let mut found = Vec::new();
    for (mode, time_s) in MODES {
        let mut camera = Camera::new(&scenario(0.4, 2.0), &averaging(mode, time_s), 10.0);
        learned(&mut camera);
        let empty = camera.empty(200.0);
        let wrong = empty.iter().filter(|u| lit(u) > 0).count();
        // In units of the noise: a smaller value means that less light is needed.
        let lambda = noise_lambda(&empty);
        let least = faintest(&mut camera);
        eprintln!(
            "{mode:?}: λ {lambda:.2}, {wrong} of {} empty frames show something; least person {least:.3}",
            empty.len()
        );
        assert!(wrong <= 4, "{mode:?}: {wrong}");
        found.push(least);
    }
    // Averaging five frames lowers the noise by a factor of 2.2. Measuring it, and the penalty based on the
    // measurement, cost a part of this.
    assert!(found[1] < 0.65 * found[0] && found[2] < 0.65 * found[0], "{found:?}");
}

#[test]
fn a_recordings_own_empty_frames_serve_averages_too() {
    for (mode, time_s) in MODES {
        let mut camera = Camera::new(&scenario(0.4, 2.0), &averaging(mode, time_s), 10.0);
        let empty = camera.renderer.empty().clone();
        for _ in 0..80 {
            assert_eq!(camera.see_as(&empty, Purpose::Background).update.state, State::Learning);
        }
        let updates: Vec<_> = (0..300).map(|_| camera.see_as(&empty, Purpose::Watch)).collect();
        let wrong = updates.iter().filter(|u| lit(u) > 0).count();
        eprintln!("{mode:?}: {wrong} of {} empty frames show something", updates.len());
        assert!(wrong <= 3, "{mode:?}: {wrong}");
        let there = camera.renderer.render(vec![person([0.2, 1.3])]);
        assert!((0..5).any(|_| lit(&camera.see_as(&there, Purpose::Watch)) > 0));
    }
    // A single frame, from which no full average can be made.
    let mut camera = Camera::new(&scenario(0.4, 2.0), &averaging(Averaging::Boxcar, 0.5), 10.0);
    let empty = camera.renderer.empty().clone();
    camera.see_as(&empty, Purpose::Background);
    assert_eq!(camera.see_as(&empty, Purpose::Watch).update.state, State::Watching);
}

#[test]
fn a_change_of_light_and_a_gap_are_not_averaged_over() {
    for (mode, time_s) in [(Averaging::Boxcar, 1.0), (Averaging::Exponential, 0.7)] {
        let mut camera = Camera::new(&scenario(0.4, 2.0), &averaging(mode, time_s), 10.0);
        learned(&mut camera);
        // Somebody who has left during a gap is gone at once.
        let there = camera.renderer.render(vec![Cylinder { radius_m: 0.25, ..person([0.1, 1.0]) }]);
        assert!(lit(camera.look(&there, 3.0).last().unwrap()) > 0, "{mode:?}");
        camera.frame += 30;
        assert_eq!(lit(&camera.empty(0.1)[0]), 0, "{mode:?}");
        // Averages that are not full yet are noisy, and λ takes that into account.
        assert!(camera.empty(3.0).iter().all(|u| lit(u) == 0), "{mode:?}");
        let brighter = change(camera.renderer.empty(), |_, _, v| 1.2 * v);
        let updates = camera.look(&brighter, 20.0);
        let states = states(&updates);
        let noticed = states.iter().position(|s| *s == State::Relearning).expect("noticed");
        let back = noticed + states[noticed..].iter().position(|s| *s == State::Watching).expect("back");
        eprintln!("{mode:?} over {time_s} s: noticed after {noticed} frames, back after {back}");
        assert!(noticed <= 6 && back <= 130, "{mode:?}: {noticed} {back}");
        assert!(updates.iter().all(|u| lit(u) == 0), "{mode:?}");
    }
}
