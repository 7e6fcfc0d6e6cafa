//! The real program simulates doorways: recordings with truth, live sources, and errors about wrong input.

use std::path::Path;

use crate::common::{Daemon, doorcam, run, stderr};
use doorcam_core::scene::Rgb;
use doorcam_source::recording::{Layout, Recording};
use doorcam_source::truth::Truth;

/// A short scenario: a person in black stands on the left.
const QUICK: &str = r#"
description = "somebody on the left"
fps = 10
background_s = 2
duration_s = 4
[doorway]
width_m = 0.8
[room]
half_width_m = 1.5
depth_m = 3.0
ceiling_m = 2.4
[room.albedo]
left = [0.6, 0.6, 0.6]
back = [0.7, 0.7, 0.7]
right = [0.6, 0.6, 0.6]
front = [0.6, 0.6, 0.6]
floor = [0.3, 0.3, 0.3]
ceiling = [0.8, 0.8, 0.8]
[[lamp]]
kind = "bulb"
at_m = [1.2, 0.15, 2.2]
radius_m = 0.1
rgb = [1, 1, 1]
[[person]]
clothes = [0.03, 0.03, 0.03]
walk = [[0.5, -0.5, 1.0], [2, -0.5, 1.01]]
[visible]
share = 0.4
[camera]
at_m = [0.05, -0.75, 1.3]
look_at_m = [0.0, -0.2]
field_of_view_deg = 50
size = [320, 180]
"#;

fn quick(dir: &Path, from: &str, to: &str) -> String {
    let file = dir.join("quick.toml");
    assert!(QUICK.contains(from));
    std::fs::write(&file, QUICK.replacen(from, to, 1)).unwrap();
    file.to_str().unwrap().to_owned()
}

fn simulate(scenario: &str, out: &Path, more: &[&str]) {
    let output = doorcam(&["simulate", scenario]).arg(out).args(more).output().unwrap();
    assert_eq!((output.status.code(), output.stdout.len()), (Some(0), 0), "{}", stderr(&output));
}

fn failure(arguments: &[&str]) -> String {
    let output = doorcam(arguments).env("RUST_LOG", "error").output().unwrap();
    let said = stderr(&output);
    assert_eq!((output.status.code(), said.lines().count(), output.stdout.len()), (Some(1), 1, 0), "{said}");
    said.trim_end().to_owned()
}

#[test]
fn a_recording_reconstructs_to_somebody_where_the_truth_says() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    simulate(&quick(dir.path(), "fps = 10", "fps = 10"), &out, &[]);
    let recording = Recording::open(&out).unwrap();
    assert!(recording.unknown_keys.is_empty());
    let manifest = &recording.manifest;
    assert_eq!(
        (recording.frames.len(), manifest.background_frames, manifest.layout),
        (40, Some([0, 20]), Layout::Camera)
    );
    assert!(manifest.floor_points.len() >= 6 && manifest.notes.starts_with("Simulated: somebody on the left. Seed 1."));
    assert_eq!((recording.frames[39].index, recording.frames[39].seconds), (39, 3.9));
    let truth = Truth::of_recording(&out).unwrap().unwrap();
    let people: Vec<usize> = truth.frames.iter().map(|frame| frame.targets.len()).collect();
    assert_eq!(people, [vec![0; 25], vec![1; 15]].concat());
    let target = truth.frames[30].targets[0];
    assert_eq!((target.id, target.radius_m, target.rgb), (1, 0.2, [0.03; 3]));

    let output = run(&["reconstruct", out.to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let updates: Vec<serde_json::Value> =
        String::from_utf8(output.stdout).unwrap().lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    // The unified change of a frame, summed: none before the person comes, then darker.
    let sum = |frame: u64| {
        let update = updates.iter().find(|u| u["frame"] == frame).unwrap();
        let facets = update["facets"].as_array().unwrap().iter();
        let unified = facets.map(|f| serde_json::from_value::<Rgb>(f["unified"].clone()).unwrap().iter().sum::<f64>());
        unified.sum::<f64>()
    };
    assert_eq!(sum(22), 0.0);
    assert!((27..39).all(|frame| sum(frame) < 0.0), "{:?}", (27..39).map(sum).collect::<Vec<_>>());
}

#[test]
fn the_same_seed_gives_the_same_files() {
    let dir = tempfile::tempdir().unwrap();
    let scenario = quick(dir.path(), "fps = 10", "fps = 10");
    let files = |name: &str, seed: &str| {
        let out = dir.path().join(name);
        simulate(&scenario, &out, &["--seed", seed, "--frames", "45"]);
        let mut files = Vec::new();
        for entry in std::fs::read_dir(out.join("frames")).unwrap() {
            files.push(entry.unwrap().path());
        }
        files.sort();
        assert_eq!(files.len(), 45, "after its end a scenario begins again");
        files.extend(["recording.json", "timestamps.csv", "truth.json"].map(|name| out.join(name)));
        files.into_iter().map(|file| std::fs::read(file).unwrap()).collect::<Vec<_>>()
    };
    let (first, again, other) = (files("a", "7"), files("b", "7"), files("c", "8"));
    assert!(first == again);
    assert!(first.iter().zip(&other).take(45).all(|(a, b)| a != b));
    assert!(first[0] != first[40], "the noise differs between rounds");
}

#[test]
fn without_its_bumps_a_recording_is_the_same_until_the_first_one() {
    let dir = tempfile::tempdir().unwrap();
    let scenario = quick(dir.path(), "[camera]", "[camera]\nbump = [[0.5, 12, 0, 0]]");
    let [bumped, still] = ["bumped", "still"].map(|name| dir.path().join(name));
    simulate(&scenario, &bumped, &["--frames", "30"]);
    simulate(&scenario, &still, &["--frames", "30", "--without-bumps"]);
    let truth = |out: &Path| -> serde_json::Value {
        serde_json::from_slice(&std::fs::read(out.join("truth.json")).unwrap()).unwrap()
    };
    assert_eq!(truth(&bumped)["bumps"].as_array().map(Vec::len), Some(1));
    assert!(truth(&still)["bumps"].as_array().is_none_or(Vec::is_empty));
    assert_eq!(truth(&bumped)["frames"], truth(&still)["frames"]);
    let frames = |out: &Path| {
        let mut files: Vec<_> =
            std::fs::read_dir(out.join("frames")).unwrap().map(|file| file.unwrap().path()).collect();
        files.sort();
        files.into_iter().map(|file| std::fs::read(file).unwrap()).collect::<Vec<_>>()
    };
    let (bumped, still) = (frames(&bumped), frames(&still));
    assert!(bumped[..15] == still[..15], "the same noise");
    assert!(bumped[29] != still[29]);
}

#[test]
fn a_simulation_is_recorded_like_a_camera() {
    let dir = tempfile::tempdir().unwrap();
    let scenario = quick(dir.path(), "[camera]", "[camera]\nformat = \"rgb\"");
    let out = dir.path().join("out");
    let source = format!("simulate:{scenario},rate=max,seed=3");
    let output = doorcam(&["record", "--source", &source]).arg(&out).output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    assert!(stderr(&output).contains("recorded 40 frames in 3.9 s"), "{}", stderr(&output));
    let recorded = Recording::open(&out).unwrap();
    assert_eq!((recorded.frames.len(), recorded.manifest.background_frames), (40, Some([0, 20])));
    assert!(out.join("frames/00000007.png").exists(), "raw pixels become PNGs");
}

#[test]
fn a_simulation_is_watched_live() {
    let dir = tempfile::tempdir().unwrap();
    let daemon = Daemon::start(&format!("simulate:{}", quick(dir.path(), "fps = 10", "fps = 10")), &[]);
    let status = daemon.wait_for("frames that are watched", |status| status["state"] == "watching");
    assert_eq!(status["source"]["kind"], "simulate");
    let (code, jpeg) = daemon.get("/api/v1/frame.jpg");
    assert_eq!((code, &jpeg[..2]), (200, &[0xff, 0xd8][..]));
}

#[test]
fn wrong_scenarios_are_one_line_that_names_file_and_key() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    let out = out.to_str().unwrap();
    let unknown = failure(&["simulate", "two-crosing", out]);
    assert!(
        unknown.contains("two-crosing: unknown scenario, expected bag, bump, busy-doorway, empty-room,"),
        "{unknown}"
    );
    let file = quick(dir.path(), "share = 0.4", "share = 1.4");
    let said = failure(&["simulate", &file, out]);
    assert_eq!(said, format!("doorcam: {file}: visible.share is 1.4, expected a share from 0 to 0.99"));
    let file = quick(dir.path(), "share = 0.4", "sharing = 0.4");
    let said = failure(&["serve", "--source", &format!("simulate:{file}")]);
    assert!(said.starts_with(&format!("doorcam: {file}: line 28: unknown field `sharing`, expected")), "{said}");
    let file = quick(dir.path(), "look_at_m = [0.0, -0.2]", "look_at_m = [0.0, -3.0]");
    let said = failure(&["simulate", &file, out]);
    assert!(said.starts_with(&format!("doorcam: {file}: camera sees 0 of the 10 marks")), "{said}");
    assert!(!Path::new(out).exists());
    let file = quick(dir.path(), "fps = 10", "fps = 10");
    simulate(&file, Path::new(out), &["--frames", "1"]);
    let said = failure(&["simulate", &file, out]);
    assert_eq!(said, format!("doorcam: {out}: there is a recording already; remove it or name another directory"));
    for arguments in [&["simulate"][..], &["simulate", &file], &["serve", "--source", "simulate:x,seed=-1"]] {
        assert_eq!(run(arguments).status.code(), Some(2), "{arguments:?}");
    }
}

#[test]
fn the_list_has_each_scenario_in_a_line() {
    let output = run(&["simulate", "--list"]);
    assert_eq!(output.status.code(), Some(0));
    let list = String::from_utf8(output.stdout).unwrap();
    assert_eq!(list.lines().count(), 14);
    assert!(list.lines().any(|line| line.starts_with("two-crossing ") && line.contains("cross twice")), "{list}");
}

/// Of random rooms, with the people asked for; the truth tells what is in them.
#[test]
fn random_rooms_are_recorded_with_what_is_in_them() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    simulate("random", &out, &["--seed", "1002", "--people", "2", "--frames", "40"]);
    let recording = Recording::open(&out).unwrap();
    assert_eq!((recording.frames.len(), recording.manifest.background_frames), (40, Some([0, 25])));
    assert!(recording.manifest.notes.starts_with("Simulated: 2 people in an ordinary room, "));
    let truth: serde_json::Value =
        serde_json::from_slice(&std::fs::read(out.join("truth.json")).unwrap()).expect("truth.json");
    let room = &truth["room"];
    assert_eq!(room["people"].as_array().unwrap().len(), 2, "{room}");
    assert!(room["light_seen"].is_boolean() && room["people"][1]["limbs"].is_boolean(), "{room}");
    let lights = ["lamps", "windows", "televisions"].map(|kind| room[kind].as_array().unwrap().len());
    assert!(lights.iter().sum::<usize>() >= 1, "{room}");
    assert!(Truth::of_recording(&out).unwrap().is_some());

    let said = failure(&["simulate", "two-crossing", dir.path().join("no").to_str().unwrap(), "--people", "2"]);
    let expected = "--people 2: only the scenario random has as many people as one likes, not two-crossing";
    assert!(said.ends_with(expected), "{said}");
}
