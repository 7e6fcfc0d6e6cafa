//! `doorcam bench`: what it prints.

use std::collections::BTreeSet;

use crate::common::{grey_recording, manifest, run, stderr};

#[test]
fn bench_prints_one_object_with_just_the_promised_keys() {
    let dir = grey_recording(&manifest(), 5);
    let output = run(&["bench", dir.path().to_str().unwrap(), "--json"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let keys = |value: &serde_json::Value| value.as_object().unwrap().keys().cloned().collect::<BTreeSet<_>>();
    let set = |keys: &[&str]| keys.iter().map(|&k| k.to_owned()).collect::<BTreeSet<_>>();
    let stages = ["project_ms", "cold_ms", "warm_ms", "frame_ms"];
    assert_eq!(keys(&report), set(&[&stages[..], &["looking", "published_iteration_ms", "facets", "pixels"]].concat()));
    for stage in stages {
        assert_eq!(keys(&report[stage]), set(&["p50", "p99"]));
        let [p50, p99] = ["p50", "p99"].map(|q| report[stage][q].as_f64().unwrap());
        assert!(0.0 < p50 && p50 <= p99, "{stage}: {report}");
    }
    assert_eq!(keys(&report["published_iteration_ms"]), set(&["p50"]));
    assert!(report["published_iteration_ms"]["p50"].as_f64().unwrap() > 0.0);
    assert!(report["looking"].is_null(), "the recording shows only patches");
    assert_eq!(report["facets"], 230);
    // Two patches of 64 x 64 pixels, without the pixels at the feet of the edges.
    assert!((8000..2 * 64 * 64).contains(&report["pixels"].as_u64().unwrap()), "{report}");
}

#[test]
fn what_looking_at_the_whole_picture_costs_is_measured_in_one_run() {
    let dir = tempfile::tempdir().unwrap();
    let (scenario, recording) = (dir.path().join("small.toml"), dir.path().join("small"));
    let text = std::fs::read_to_string("crates/doorcam-engine/scenarios/one-person.toml").unwrap();
    let small = text.replacen("[camera]", "[camera]\nsize = [160, 90]", 1);
    std::fs::write(&scenario, small).unwrap();
    let (scenario, recording) = (scenario.to_str().unwrap(), recording.to_str().unwrap());
    let output = run(&["simulate", scenario, recording, "--frames", "60"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let output = run(&["bench", recording, "--json"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let [with, without, ratio] = ["with_ms", "without_ms", "ratio"].map(|key| report["looking"][key].as_f64().unwrap());
    assert!(with > 0.0 && without > 0.0 && (ratio - with / without).abs() < 1e-9, "{report}");
}

#[test]
fn the_table_has_a_line_for_each_stage_and_both_ratios() {
    let dir = grey_recording(&manifest(), 4);
    let output = run(&["bench", dir.path().to_str().unwrap(), "--preset", "published"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let table = String::from_utf8(output.stdout).unwrap();
    for line in
        ["project ", "cold solve ", "warm solve ", "whole frame ", "published iteration / cold", "iteration / warm"]
    {
        assert!(table.contains(line), "{line}: {table}");
    }
}

#[test]
fn a_recording_without_frames_to_solve_is_refused_by_name() {
    let dir = grey_recording(&manifest(), 2);
    let path = dir.path().to_str().unwrap();
    let output = run(&["bench", path]);
    assert_eq!(output.status.code(), Some(1));
    assert_eq!(stderr(&output).trim_end(), format!("doorcam: {path}: no frame after background_frames could be read"));
}
