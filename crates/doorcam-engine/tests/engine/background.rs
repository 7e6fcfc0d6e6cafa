//! The rolling background over minutes of a simulated room: who stays on the map, what leaves it, and how the light may
//! change.

use crate::live_room;
use crate::live_room::{Camera, lit, person, rooms, scenario, settings, states};
use doorcam_engine::simulation::luminous::direct::Cylinder;
use doorcam_engine::simulation::luminous::{Renderer, Scenario};
use doorcam_engine::{FacetReport, Published, State};

fn share_lit(updates: &[Published]) -> f64 {
    updates.iter().filter(|u| lit(u) > 0).count() as f64 / updates.len() as f64
}

#[test]
fn who_walks_through_at_the_start_is_not_in_the_background() {
    for (what, scenario) in rooms() {
        let mut camera = Camera::new(&scenario, &settings(), 10.0);
        let start = camera.walk([-1.3, 1.2], [1.3, 1.0], 0.8);
        assert!(start.iter().all(|u| u.update.state == State::Learning && lit(u) == 0));
        let progress: Vec<f64> = start.iter().map(|u| u.update.background.unwrap().progress.unwrap()).collect();
        assert!(progress.windows(2).all(|w| w[1] >= w[0]), "{progress:?}");
        let then = camera.empty(10.0);
        let began = states(&then).iter().position(|s| *s == State::Watching).expect("watching") as f64 / 10.0;
        eprintln!("{what}: watching {began} s after somebody left");
        assert!((4.0..7.0).contains(&began), "{what}: {began}");
        let empty = camera.empty(10.0);
        assert_eq!(share_lit(&empty), 0.0, "{what}");
        let light = camera.renderer.render(vec![person([0.1, 1.3])]);
        assert!(lit(&camera.see(&light)) > 0, "{what}");
    }
}

#[test]
fn who_stands_still_for_ten_minutes_stays_on_the_map() {
    let mut camera = Camera::new(&scenario(0.4, 2.0), &settings(), 4.0);
    camera.empty(60.0);
    let there = camera.renderer.render(vec![person([0.2, 1.3])]);
    let standing = camera.look(&there, 600.0);
    assert!(standing.iter().all(|u| u.update.state == State::Watching));
    let shown = share_lit(&standing);
    let measured = |f: &FacetReport| f64::from(f.refit * (f.left[1] + f.right[1]));
    let strength = |u: &Published| u.update.facets.iter().map(measured).sum::<f64>();
    let mean = |all: &[Published]| all.iter().map(strength).sum::<f64>() / all.len() as f64;
    let (first, last) = (mean(&standing[..100]), mean(&standing[standing.len() - 100..]));
    eprintln!("shown in {:.1} % of frames; signal after ten minutes {:.3} of the first", 100.0 * shown, last / first);
    assert!(shown > 0.999 && (0.95..1.05).contains(&(last / first)), "{shown} {first} {last}");
    // Nothing of them stays behind.
    assert_eq!(share_lit(&camera.empty(20.0)), 0.0);
}

#[test]
fn a_moved_chair_is_absorbed_in_time_and_at_once_when_asked() {
    let mut settings = settings();
    settings.background.absorb_s = 60.0;
    let mut camera = Camera::new(&scenario(0.4, 2.0), &settings, 4.0);
    camera.empty(15.0);
    let chair = Cylinder { height_m: 0.9, radius_m: 0.25, ..person([-0.4, 1.1]) };
    let moved = camera.renderer.render(vec![chair]);
    assert_eq!(share_lit(&camera.look(&moved, 20.0)), 1.0);
    // Somebody passes and hides it for a while.
    for k in 0..40 {
        let light = camera.renderer.render(vec![chair, person([-1.0 + 0.05 * k as f64, 1.8])]);
        camera.see(&light);
    }
    let then = camera.look(&moved, 60.0);
    let gone = then.iter().position(|u| lit(u) == 0).expect("absorbed") as f64 / 4.0;
    eprintln!("absorbed after {} s", 30.0 + gone);
    assert!((36.0..44.0).contains(&gone), "{gone}");
    assert!(then[(4.0 * gone) as usize + 8..].iter().all(|u| lit(u) == 0 && u.update.state == State::Watching));
    // It goes back, and this time a reset is requested.
    let back = camera.empty(5.0);
    assert!(share_lit(&back) > 0.9);
    camera.engine.reset_background();
    let after = camera.empty(6.0);
    let states = states(&after);
    assert_eq!(states[0], State::Relearning);
    let watching = states.iter().position(|s| *s == State::Watching).expect("watching") as f64 / 4.0;
    assert!(watching <= 3.0, "{watching}");
    assert_eq!(share_lit(&after), 0.0);
}

#[test]
fn what_a_loop_shows_again_and_again_is_not_absorbed() {
    let mut settings = settings();
    settings.background.absorb_s = 10.0;
    let mut camera = Camera::new(&scenario(0.4, 2.0), &settings, 1.0);
    camera.empty(20.0);
    let there = camera.renderer.render(vec![person([0.2, 1.3])]);
    for _ in 0..40 {
        camera.frame = 0;
        camera.empty(1.0);
        assert!(lit(&camera.see(&there)) > 0);
    }
}

/// The same room with its walls lit differently, by a lamp at the left that is `factor` times as bright.
fn other_lamp(scenario: &Scenario, factor: f64) -> Renderer {
    let mut scenario = scenario.clone();
    let of_lamp = [1.0, 0.7, 0.2, 0.4, 0.2];
    let walls = scenario.walls.iter_mut().zip(of_lamp);
    walls.for_each(|(wall, share)| wall.radiance = wall.radiance.map(|v| v * (1.0 + (factor - 1.0) * share)));
    Renderer::new(&scenario)
}

#[test]
fn a_lamp_that_drifts_slowly_is_followed() {
    let scenario = scenario(0.4, 2.0);
    let mut camera = Camera::new(&scenario, &settings(), 2.0);
    camera.empty(15.0);
    let (from, to) = (camera.renderer.empty().clone(), other_lamp(&scenario, 2.0).empty().clone());
    let (mut shown, mut frames) = (0, 0);
    // Twice as bright within an hour.
    for k in 0..7200 {
        let share = k as f32 / 7200.0;
        let light = live_room::change(&from, |side, pixel, v| {
            let channel = |p: usize| (from.side(side).plane(p)[pixel], to.side(side).plane(p)[pixel]);
            let (_, end) = (0..3).map(channel).find(|&(x, _)| x == v).unwrap_or((v, v));
            v + share * (end - v)
        });
        let update = camera.see(&light);
        assert!(k < 30 || update.update.state == State::Watching, "frame {k}");
        shown += usize::from(lit(&update) > 0);
        frames += 1;
    }
    eprintln!("a lamp that becomes twice as bright in an hour: {shown} of {frames} frames show something");
    assert!(f64::from(u32::try_from(shown).unwrap()) < 0.01 * f64::from(frames));
}

/// Offline, and for the first map online: the mean of the frames that a recording names, and the problem built from it.
#[test]
fn given_frames_are_the_background_to_the_last_bit() {
    use std::sync::Arc;

    use doorcam_core::light::{Background, PatchPair};
    use doorcam_core::solver::{Solution, Start};
    use doorcam_engine::{FrameReader, Model, Problem, Work};
    use doorcam_source::Purpose;
    use jiff::Timestamp;

    let (scenario, settings) = (scenario(0.4, 2.0), settings());
    let renderer = Renderer::new(&scenario);
    let frames: Vec<_> = (0..40)
        .map(|k| {
            let (purpose, people) = match k {
                0..10 => (Purpose::Background, vec![]),
                _ => (Purpose::Watch, if k % 4 < 2 { vec![person([0.2, 1.3])] } else { vec![] }),
            };
            let seconds = 60.0 * k as f64;
            live_room::raw_frame(&scenario.sensor, &renderer.render(people), k, seconds, purpose)
        })
        .collect();

    let manifest = live_room::manifest(scenario.doorway, scenario.patch.fov_m);
    let mut reader = FrameReader::for_recording(&settings, &manifest).unwrap();
    let model = Arc::new(Model::new(&settings, scenario.doorway, reader.patch(), reader.seen()).unwrap());
    let mut background = Background::new(live_room::SIZE);
    let (mut pair, mut difference) = (PatchPair::zeros(live_room::SIZE), PatchPair::zeros(live_room::SIZE));
    let mut problem = None;
    let offline = live_room::offline(&settings);
    let mut fixed = offline.for_recording(&manifest).unwrap();
    let mut rolling = offline.rolling(Work::InPlace).for_recording(&manifest).unwrap();
    for (k, frame) in frames.iter().enumerate() {
        reader.read(frame, &mut pair).unwrap();
        let found = fixed.step(frame, Timestamp::UNIX_EPOCH).unwrap().update;
        let online = rolling.step(frame, Timestamp::UNIX_EPOCH).unwrap().update;
        assert!(found.background.is_none() && online.background.is_some());
        if frame.purpose == Purpose::Background {
            background.learn(&pair);
            continue;
        }
        background.difference(&pair, &mut difference);
        let problem = problem.get_or_insert_with(|| Problem::new(&model, &background, &difference));
        let mut correlations = problem.projection.correlations();
        problem.projection.project(&difference, &mut correlations).unwrap();
        let lambda = problem.lambda(&correlations, problem.solver.lambda_max(&correlations));
        let (mut workspace, mut solution) = (problem.solver.workspace(), Solution::default());
        let limits = model.limits;
        problem.solver.solve_into(&correlations, lambda, limits, Start::Empty, &mut workspace, &mut solution);
        assert_eq!((found.solution.lambda, found.solution.data), (solution.lambda, solution.data), "frame {k}");
        assert_eq!(found.solution.penalty, solution.penalty, "frame {k}");
        if k == 10 {
            assert_eq!((online.solution, online.facets), (found.solution, found.facets));
        }
    }
}

/// Prints what following the background costs per frame, and that rebuilding the problem does not delay frames:
/// `cargo test --release -p doorcam-engine --test engine -- --ignored --nocapture cost`
#[test]
#[ignore = "a measurement"]
fn cost_of_a_frame() {
    use doorcam_core::transport::PatchGrid;
    use doorcam_engine::Settings;
    use doorcam_engine::Work;
    use doorcam_source::Purpose;
    use jiff::Timestamp;

    let mut scenario = scenario(0.4, 2.0);
    scenario.patch = PatchGrid { size: 64, ..scenario.patch };
    let settings = Settings::default();
    let renderer = Renderer::new(&scenario);
    let there = renderer.render(vec![person([0.2, 1.3])]);
    let manifest = live_room::manifest(scenario.doorway, scenario.patch.fov_m);
    let offline = live_room::offline(&settings);
    let mut restless = settings.clone();
    restless.background.rebuild_s = 5.0;
    let restless = live_room::offline(&restless);
    let engines = [
        ("fixed", offline.clone()),
        ("rolling", offline.rolling(Work::Aside)),
        ("rolling, set up anew every 5 s aside", restless.clone().rolling(Work::Aside)),
        ("the same in place", restless.rolling(Work::InPlace)),
    ]
    .map(|(what, assembly)| (what, assembly.for_recording(&manifest).unwrap()));
    for (what, mut engine) in engines {
        for (who, light) in [("nobody", renderer.empty()), ("somebody", &there)] {
            let mut times = Vec::new();
            for k in 0..1000 {
                let purpose = if k < 20 { Purpose::Background } else { Purpose::Watch };
                let light = if k < 100 { renderer.empty() } else { light };
                let frame = live_room::raw_frame(&scenario.sensor, light, k, 0.1 * k as f64, purpose);
                let start = std::time::Instant::now();
                engine.step(&frame, Timestamp::UNIX_EPOCH).unwrap();
                if k >= 100 {
                    times.push(start.elapsed().as_secs_f64() * 1e3);
                }
            }
            times.sort_by(f64::total_cmp);
            let at = |share: f64| times[(share * (times.len() - 1) as f64) as usize];
            eprintln!(
                "{what}, {who}: least {:.2} ms, p10 {:.2} ms, p50 {:.2} ms, p99 {:.2} ms, most {:.1} ms",
                at(0.0),
                at(0.1),
                at(0.5),
                at(0.99),
                at(1.0)
            );
        }
    }
}
