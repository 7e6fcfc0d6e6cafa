//! Lamps and exposure steps make the background be learned anew; people do not.

use crate::live_room::{Camera, change, lamp, lit, person, rooms, settings, states};
use crate::reference;
use doorcam_core::light::PatchPair;
use doorcam_engine::Settings;
use doorcam_engine::simulation::luminous::{Renderer, Scenario};
use doorcam_engine::{Assembly, State, Work};
use doorcam_source::Purpose;
use doorcam_source::recording::Recording;
use jiff::Timestamp;

/// The same room with its lamp on.
fn lamp_renderer(scenario: &Scenario) -> Renderer {
    let mut scenario = scenario.clone();
    scenario.visible_light = scenario.visible_light.map(|v| 1.2 * v);
    scenario.walls.iter_mut().for_each(|wall| wall.radiance = wall.radiance.map(|v| 1.4 * v));
    Renderer::new(&scenario)
}

/// The same room with a hidden lamp at the left that is `factor` times as bright.
fn hidden_lamp(scenario: &Scenario, factor: f64) -> PatchPair {
    let mut scenario = scenario.clone();
    let of_lamp = [1.0, 0.7, 0.5, 0.5, 0.4];
    let walls = scenario.walls.iter_mut().zip(of_lamp);
    walls.for_each(|(wall, share)| wall.radiance = wall.radiance.map(|v| v * (1.0 + (factor - 1.0) * share)));
    Renderer::new(&scenario).empty().clone()
}

/// Changes of the light that must be noticed.
fn changes(scenario: &Scenario, light: &PatchPair) -> Vec<(String, PatchPair)> {
    let mut all = Vec::new();
    for factor in [0.3, 2.5] {
        all.push((format!("hidden lamp x{factor}"), hidden_lamp(scenario, factor)));
    }
    for gain in [0.7, 1.3] {
        all.push((format!("exposure x{gain}"), change(light, |_, _, v| gain * v)));
    }
    for (name, place) in [("ceiling", [0.5, -1.5, 2.4]), ("desk", [1.0, -0.8, 1.0]), ("far", [-3.0, -3.0, 2.4])] {
        for share in [-0.15, 0.15] {
            all.push((format!("visible {name} {share:+}"), lamp(scenario, light, place, share)));
        }
    }
    all
}

#[test]
fn a_lamp_or_an_exposure_step_is_relearned_within_seconds() {
    let (mut slowest_notice, mut slowest_back) = (0.0_f64, 0.0_f64);
    for ((room, scenario), fps) in rooms().into_iter().zip([5.0, 15.0]) {
        {
            let empty = Renderer::new(&scenario).empty().clone();
            for (what, after) in changes(&scenario, &empty) {
                let mut camera = Camera::new(&scenario, &settings(), fps);
                camera.empty(8.0);
                let updates = camera.look(&after, 8.0);
                let states = states(&updates);
                let name = format!("{room}, {fps} fps, {what}");
                let seconds = |frame: Option<usize>| frame.map(|k| k as f64 / fps);
                let noticed = seconds(states.iter().position(|s| *s == State::Relearning));
                let first = states.iter().position(|s| *s == State::Relearning).unwrap_or(0);
                let back = seconds(states[first..].iter().position(|s| *s == State::Watching).map(|k| k + first));
                let shown = updates.iter().filter(|u| u.update.state == State::Watching && lit(u) > 0).count();
                eprintln!("{name}: noticed after {noticed:?} s, watching again after {back:?} s, {shown} false maps");
                let noticed = noticed.unwrap_or_else(|| panic!("{name}: not noticed"));
                let back = back.unwrap_or_else(|| panic!("{name}: never back"));
                (slowest_notice, slowest_back) = (slowest_notice.max(noticed), slowest_back.max(back));
                assert!(noticed <= 1.0 && back <= 5.0, "{name}: {noticed} {back}");
                let relearning = updates.iter().filter(|u| u.update.state == State::Relearning);
                assert!(relearning.map(lit).all(|n| n == 0), "{name}: a map while it is learned");
                let last = &updates[updates.len() - fps as usize..];
                assert!(last.iter().all(|u| u.update.state == State::Watching && lit(u) == 0), "{name}");
                // Somebody who comes in then is seen.
                let there = camera.renderer.render(vec![person([0.2, 1.3])]);
                let there = change(&there, |side, k, v| {
                    let (p, k) = ((0..3).find(|&p| there.side(side).plane(p)[k] == v).unwrap_or(0), k);
                    v + after.side(side).plane(p)[k] - empty.side(side).plane(p)[k]
                });
                assert!(lit(&camera.see(&there)) > 0, "{name}");
            }
        }
    }
    eprintln!("slowest: noticed after {slowest_notice:.2} s, watching again after {slowest_back:.2} s");
}

#[test]
fn people_are_no_change_of_the_light() {
    for (room, scenario) in rooms() {
        for fps in [4.0, 15.0] {
            let mut camera = Camera::new(&scenario, &settings(), fps);
            camera.empty(13.0);
            let mut updates = Vec::new();
            // In at the side, close past the door with a stop there, and out; slowly and in a hurry.
            for speed in [0.8, 2.0] {
                updates.extend(camera.walk([-1.4, 1.5], [0.0, 0.4], speed));
                let there = camera.renderer.render(vec![person([0.0, 0.4])]);
                updates.extend(camera.look(&there, 3.0));
                updates.extend(camera.walk([0.0, 0.4], [1.4, 1.0], speed));
                updates.extend(camera.empty(2.0));
            }
            // Two people come, stand close to the door, and leave at a run.
            let there = |x: f64| vec![person([-0.35 - x, 0.6]), person([0.3 + x, 0.7])];
            let steps = (1.2 / 2.0 * fps) as usize;
            let ways = [(0..=steps).rev().collect::<Vec<_>>(), vec![0; 4 * fps as usize], (0..=steps).collect()];
            for k in ways.concat() {
                let light = camera.renderer.render(there(2.0 * k as f64 / fps));
                updates.push(camera.see(&light));
            }
            let false_alarms = states(&updates).iter().filter(|s| **s != State::Watching).count();
            eprintln!("{room}, {fps} fps: {false_alarms} of {} frames not watching", updates.len());
            assert_eq!(false_alarms, 0, "{room}, {fps} fps");
            assert!(camera.empty(3.0).iter().all(|u| lit(u) == 0 && u.update.state == State::Watching));
        }
    }
}

#[test]
fn a_lamp_is_noticed_while_somebody_walks_and_they_are_not_learned() {
    for (room, scenario) in rooms() {
        let mut camera = Camera::new(&scenario, &settings(), 10.0);
        camera.empty(8.0);
        let (before, after) = (camera.renderer.clone(), lamp_renderer(&scenario));
        let at = |t: f64| vec![person([-0.8 + 0.5 * t, 1.2 + 0.1 * t])];
        let mut updates = Vec::new();
        for k in 0..40 {
            let renderer = if k < 10 { &before } else { &after };
            let light = renderer.render(at(0.1 * k as f64));
            updates.push(camera.see(&light));
        }
        let noticed = states(&updates).iter().position(|s| *s == State::Relearning).expect("noticed");
        assert!((10..=20).contains(&noticed), "{room}: frame {noticed}");
        // They have gone, and nobody was learned.
        camera.renderer = after;
        let then = camera.empty(6.0);
        let watching = states(&then).iter().position(|s| *s == State::Watching).expect("watching");
        eprintln!(
            "{room}: noticed {:.1} s after the switch, watching {:.1} s after they left",
            0.1 * (noticed - 10) as f64,
            0.1 * watching as f64
        );
        assert!(watching <= 30 && then[watching..].iter().all(|u| lit(u) == 0), "{room}: {watching}");
    }
}

#[test]
fn light_that_comes_back_has_its_background_back() {
    for (room, scenario) in rooms() {
        let mut camera = Camera::new(&scenario, &settings(), 10.0);
        let empty = camera.renderer.empty().clone();
        camera.empty(8.0);
        let dark = change(&empty, |_, _, v| 0.6 * v);
        let flash = camera.look(&dark, 1.0);
        assert_eq!(flash.last().unwrap().update.state, State::Relearning, "{room}");
        let back = states(&camera.empty(2.0));
        let watching = back.iter().position(|s| *s == State::Watching).expect("watching");
        assert!(watching <= 4, "{room}: {watching} frames");
        assert!(back[watching..].iter().all(|s| *s == State::Watching), "{room}");
    }
}

#[test]
fn a_lamp_that_comes_up_slowly_is_noticed_too() {
    for (room, scenario) in rooms() {
        let before = Renderer::new(&scenario).empty().clone();
        let desk = lamp(&scenario, &before, [1.0, -0.8, 1.0], 0.3);
        let louder = change(&before, |_, _, v| 1.25 * v);
        for (what, after) in [("desk lamp", desk), ("exposure", louder)] {
            let mut camera = Camera::new(&scenario, &settings(), 10.0);
            camera.empty(8.0);
            let mut updates = Vec::new();
            // Within two seconds.
            for k in 0..100 {
                let share = (k as f32 / 20.0).min(1.0);
                let mut end = after.left.data().iter().chain(after.right.data());
                let light = change(&before, |_, _, v| v + share * (end.next().copied().unwrap_or(v) - v));
                updates.push(camera.see(&light));
            }
            let noticed = states(&updates).iter().position(|s| *s == State::Relearning);
            eprintln!("{room}, {what} within 2 s: noticed after {noticed:?} frames");
            assert!(noticed.is_some_and(|frame| frame < 60), "{room}, {what}");
            assert!(updates.last().is_some_and(|u| u.update.state == State::Watching && lit(u) == 0), "{room}, {what}");
        }
    }
}

#[test]
fn rendered_recordings_are_learned_like_a_cameras_frames() {
    for name in ["D1", "D2", "D3"] {
        let Some(path) = reference::data(&format!("rendered/{name}")) else { continue };
        let recording = Recording::open(&path).unwrap();
        let mut settings = Settings::default();
        settings.background.learn_s = 2.4;
        let assembly = Assembly::new(settings).without_people().rolling(Work::InPlace);
        let mut engine = assembly.for_recording(&recording.manifest).unwrap();
        let empty = recording.frames.iter().filter(|e| recording.purpose(e.index) == Purpose::Background);
        let mut watched = 0;
        for entry in empty {
            let frame = doorcam_source::load(&recording, entry).unwrap();
            let frame = doorcam_source::RawFrame { purpose: Purpose::Live, ..frame };
            let update = engine.step(&frame, Timestamp::UNIX_EPOCH).unwrap();
            assert!(update.update.facets.is_empty(), "{name}, frame {}", entry.index);
            watched += usize::from(update.update.state == State::Watching);
        }
        eprintln!("{name}: learned from compressed frames, then {watched} empty ones watched");
        assert!(watched > 0, "{name}");
    }
}

#[test]
fn rendered_recordings_never_trigger() {
    for name in ["D1", "D2", "D3"] {
        let Some(path) = reference::data(&format!("rendered/{name}")) else { continue };
        let recording = Recording::open(&path).unwrap();
        let settings = Settings::default();
        let assembly = Assembly::new(settings).without_people().rolling(Work::InPlace);
        let mut engine = assembly.for_recording(&recording.manifest).unwrap();
        let mut counts = [0; 2];
        for entry in &recording.frames {
            let frame = doorcam_source::load(&recording, entry).unwrap();
            let given = frame.purpose == Purpose::Background;
            let update = engine.step(&frame, Timestamp::UNIX_EPOCH).unwrap().update;
            let expected = if given { State::Learning } else { State::Watching };
            assert_eq!(update.state, expected, "{name}, frame {}", entry.index);
            counts[usize::from(given)] += 1;
        }
        eprintln!("{name}: {} frames watched", counts[0]);
        assert!(counts[0] > 40 && counts[1] > 0);
    }
}
