//! A change of the light, or what looks like one, does not leave the room unwatched for long.

use crate::live_room::{Camera, change, lit, person, rooms, scenario, settings, states};
use crate::reference;
use doorcam_engine::Settings;
use doorcam_engine::{Assembly, Published, State, Work};
use doorcam_source::Purpose;
use doorcam_source::recording::Recording;
use jiff::Timestamp;

/// People who appear in one frame look like a switch. They are watched all the same, and by the same numbers.
#[test]
fn a_looped_recording_is_watched() {
    let Some(path) = reference::data("rendered/D2") else { return };
    let recording = Recording::open(&path).unwrap();
    let mut engine =
        Assembly::new(Settings::default()).rolling(Work::InPlace).for_recording(&recording.manifest).unwrap();
    let (mut blind, mut frames) = (0, 0);
    for round in 0..3 {
        let mut doubted = false;
        let mut people = Vec::new();
        for entry in &recording.frames {
            let frame = doorcam_source::load(&recording, entry).unwrap();
            let given = frame.purpose == Purpose::Background;
            let update = engine.step(&frame, Timestamp::UNIX_EPOCH).unwrap().update;
            if given && round == 0 {
                continue;
            }
            frames += 1;
            blind += usize::from(update.state != State::Watching);
            let learning = update.background.is_some_and(|background| background.progress.is_some());
            doubted |= learning && update.state == State::Watching;
            if !given {
                people.extend(update.tracks.iter().map(|track| track.id));
            }
        }
        people.sort_unstable();
        people.dedup();
        assert_eq!(doubted, round > 0, "round {round}");
        assert_eq!(people.len(), 2, "round {round}: {people:?}");
    }
    eprintln!("D2 looped: blind in {blind} of {frames} frames");
    assert!(10 * blind <= frames, "{blind} of {frames}");
}

/// Whoever appears in one frame and then stands still is not taken for the new light.
#[test]
fn who_appears_at_once_and_stands_still_is_not_learned() {
    let mut doubted = 0;
    for (room, scenario) in rooms() {
        for place in [[-0.2, 0.4], [0.1, 0.8], [0.4, 1.4]] {
            let mut camera = Camera::new(&scenario, &settings(), 10.0);
            camera.empty(8.0);
            let there = camera.renderer.render(vec![person(place)]);
            let standing = camera.look(&there, 8.0);
            let learning = |u: &&Published| u.update.background.is_some_and(|b| b.progress.is_some());
            let doubts = standing.iter().filter(learning).count();
            doubted += usize::from(doubts > 0);
            let shown = standing.iter().filter(|u| u.update.state == State::Watching && lit(u) > 0).count();
            eprintln!("{room}, {place:?}: shown in {shown} of {} frames, {doubts} of them doubted", standing.len());
            assert_eq!(shown, standing.len(), "{room}, {place:?}");
            assert!(camera.empty(5.0).iter().all(|u| lit(u) == 0 && u.update.state == State::Watching), "{room}");
        }
    }
    assert!(doubted > 0, "nobody looked like a switch");
}

fn first(updates: &[Published], state: State) -> Option<f64> {
    states(updates).iter().position(|s| *s == state).map(|k| k as f64 / 10.0)
}

#[test]
fn a_first_picture_in_the_new_light_is_used_until_it_is_learned() {
    let mut settings = settings();
    settings.background.relearn_s = 6.0;
    let scenario = scenario(0.4, 2.0);
    let mut camera = Camera::new(&scenario, &settings, 10.0);
    camera.empty(8.0);
    let dark = change(camera.renderer.empty(), |_, _, v| 0.7 * v);
    let updates = camera.look(&dark, 5.5);
    let noticed = first(&updates, State::Relearning).expect("noticed");
    let from = (10.0 * noticed) as usize;
    let watching = noticed + first(&updates[from..], State::Watching).expect("watching");
    eprintln!("noticed after {noticed} s, watching with a first picture after {watching} s");
    assert!((noticed + 2.5..noticed + 4.0).contains(&watching), "{watching}");
    let then = &updates[(10.0 * watching).round() as usize..];
    assert!(then.iter().all(|u| u.update.state == State::Watching && lit(u) == 0));
    assert!(then.iter().all(|u| u.update.background.unwrap().progress.is_some()), "it is still being learned");
    // Somebody who comes in meanwhile is seen.
    let there = change(&camera.renderer.render(vec![person([0.2, 1.3])]), |_, _, v| 0.7 * v);
    assert!(lit(&camera.see(&there)) > 0);
    // The old light comes back: so does its background.
    let back = camera.empty(2.0);
    assert!(states(&back)[4..].iter().all(|s| *s == State::Watching), "{:?}", states(&back));
    let after = back.last().unwrap().update.background.unwrap();
    assert!(after.progress.is_none() && after.age_s.is_some_and(|age| age > 5.0), "{after:?}");
}
