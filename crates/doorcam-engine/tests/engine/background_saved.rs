//! A saved background is used again after a restart, as long as it is valid.

use crate::live_room::{Camera, change, lit, person, scenario, settings, states};
use doorcam_engine::State;

#[test]
fn a_restart_watches_at_once_where_nothing_has_changed() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("background");
    let (scenario, settings) = (scenario(0.4, 2.0), settings());
    let start = |words: &str| Camera::with_store(&scenario, &settings, 10.0, Some((&path, words)));

    let mut camera = start("exposure 10 ms");
    camera.empty(30.0);
    // Dropping the camera saves the background.
    drop(camera);
    assert!(path.exists());

    let mut camera = start("exposure 10 ms");
    let there = camera.renderer.render(vec![person([0.2, 1.3])]);
    assert!(lit(&camera.see(&there)) > 0, "the first frame has a map");
    assert!(camera.empty(5.0).iter().all(|u| lit(u) == 0 && u.update.state == State::Watching));
    // While the background is being learned anew, nothing is worth saving.
    let before = std::fs::read(&path).unwrap();
    camera.engine.reset_background();
    camera.empty(0.5);
    drop(camera);
    assert_eq!(std::fs::read(&path).unwrap(), before);

    // Another exposure setting, another light, a damaged file.
    assert_eq!(start("exposure 20 ms").empty(0.1)[0].update.state, State::Learning);
    let mut camera = start("exposure 10 ms");
    let brighter = change(camera.renderer.empty(), |_, _, v| 1.25 * v);
    let updates = camera.look(&brighter, 5.0);
    let relearning = states(&updates).iter().position(|s| *s == State::Relearning).expect("noticed");
    assert!(relearning <= 5, "{relearning} frames");
    assert!(updates[40..].iter().all(|u| lit(u) == 0 && u.update.state == State::Watching));
    drop(camera);
    std::fs::write(&path, &before[..before.len() / 2]).unwrap();
    assert_eq!(start("exposure 10 ms").empty(0.1)[0].update.state, State::Learning);
}

#[test]
fn it_is_saved_every_few_minutes() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("background");
    let mut settings = settings();
    settings.background.save_s = 20.0;
    let mut camera = Camera::with_store(&scenario(0.4, 2.0), &settings, 2.0, Some((&path, "")));
    let learned = states(&camera.empty(10.0)).iter().position(|s| *s == State::Watching).expect("watching");
    let mut until = 0;
    while !path.exists() {
        camera.empty(0.5);
        until += 1;
        assert!(until < 100);
    }
    let seconds = (20 + until - learned) as f64 / 2.0;
    assert!((19.0..22.0).contains(&seconds), "{seconds}");
}

#[test]
fn a_place_that_cannot_be_written_is_no_reason_to_stop() {
    let mut camera =
        Camera::with_store(&scenario(0.4, 2.0), &settings(), 2.0, Some(("/nonexistent/background".as_ref(), "")));
    assert_eq!(camera.empty(12.0).last().unwrap().update.state, State::Watching);
    camera.engine.save_background();
}
