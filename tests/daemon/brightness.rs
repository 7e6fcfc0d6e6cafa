//! The brightness that figures show: measured by default, shrunk to match the paper's figures. Updates have both.

use crate::common;
use std::path::Path;

use doorcam::config::{Config, Preset};
use doorcam_core::scene::Brightness;
use doorcam_core::transport::PatchGrid;
use doorcam_engine::simulation::luminous::{Scenario, write_recording};
use doorcam_engine::{Assembly, Published};
use doorcam_source::recording::Recording;
use jiff::Timestamp;

/// The first seconds of the demo at a low frame rate: somebody comes in.
fn recording(directory: &Path) -> Recording {
    let demo = Scenario::demo();
    let patch = PatchGrid { size: 32, ..demo.patch };
    let scenario = Scenario { fps: 2.0, background_frames: 6, patch, ..demo };
    write_recording(&scenario, directory, 12, 1, || ()).unwrap();
    Recording::open(directory).unwrap()
}

/// The frames in which something changed.
fn maps(config: &Config, recording: &Recording) -> Vec<Published> {
    let assembly = Assembly::new(config.settings()).cold_starts().without_people();
    let mut engine = assembly.for_recording(&recording.manifest).unwrap();
    let frames = recording.frames.iter();
    let published = frames
        .map(|entry| engine.step(&doorcam_source::load(recording, entry).unwrap(), Timestamp::UNIX_EPOCH).unwrap());
    published.filter(|p| !p.update.facets.is_empty()).collect()
}

#[test]
fn figures_show_the_brightness_that_is_asked_for_and_updates_have_both() {
    let directory = tempfile::tempdir().unwrap();
    let recording = recording(directory.path());
    // A coarse grid is sufficient and fast.
    let mut measured = Config::default();
    measured.grid.angular_step_deg = 6.0;
    let mut shrunk = measured.clone();
    shrunk.scene.brightness = Brightness::Shrunk;
    let published = Config::default().with_preset(Some(Preset::Published));
    let mut facets = Vec::new();
    for (config, refitted) in [(measured, true), (shrunk, false), (published, false)] {
        let maps = maps(&config, &recording);
        assert!(maps.len() >= 4, "{} maps", maps.len());
        assert!(maps.iter().flat_map(|m| &m.update.facets).any(|f| f.refit > 1.1), "no shrinkage to undo");
        for map in &maps {
            let scene = map.scene.as_ref().unwrap();
            for facet in &map.update.facets {
                let n = facet.index;
                let factor = if refitted { facet.refit } else { 1.0 };
                let views =
                    [(scene.left[n], facet.left), (scene.right[n], facet.right), (scene.unified[n], facet.unified)];
                for (shown, reported) in views {
                    for (shown, reported) in shown.into_iter().zip(reported) {
                        let expected = f64::from(factor * reported);
                        assert!((shown - expected).abs() <= 1e-6 * expected.abs(), "facet {n}: {shown} {expected}");
                    }
                }
            }
        }
        facets.push(maps.into_iter().map(|m| m.update.facets).collect::<Vec<_>>());
    }
    assert_eq!(facets[0], facets[1], "updates do not depend on what figures show");
}

#[test]
fn captions_say_which_brightness_a_figure_shows() {
    let directory = tempfile::tempdir().unwrap();
    let path = |name: &str| directory.path().join(name).to_str().unwrap().to_owned();
    recording(&directory.path().join("recording"));
    std::fs::write(path("shrunk.toml"), "[scene]\nbrightness = \"shrunk\"\n").unwrap();
    let measured = "measured brightness";
    let shrunk = "brightness as shrunk by the penalty";
    let config = path("shrunk.toml");
    for (name, options, words) in [
        ("plain", vec![], measured),
        ("config", vec!["--config", &config], shrunk),
        ("preset", vec!["--preset", "published"], shrunk),
    ] {
        let (recording, output) = (path("recording"), path(name));
        let arguments = [vec!["reconstruct", &recording, "--frames", "11", "--output", &output], options].concat();
        let run = common::run(&arguments);
        assert!(run.status.success(), "{}", common::stderr(&run));
        let svg = std::fs::read_to_string(format!("{output}/reconstruction_00000011.svg")).unwrap();
        for candidate in [measured, shrunk] {
            assert_eq!(svg.contains(candidate), candidate == words, "{name}: {candidate}");
        }
    }
}
