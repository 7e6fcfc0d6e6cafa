//! The authors' measurements, imported and reconstructed by the program, compared with their objective and figures.

use std::path::Path;

use crate::common::{data, run, stderr};
use serde_json::Value;

fn json(path: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(path).expect("readable")).expect("JSON")
}

/// Imports the scenes whose files are there. Without the authors' files, it prints a message and returns none.
fn imported() -> Option<tempfile::TempDir> {
    let source = data("DoorwayCameraCode")?;
    let out = tempfile::tempdir().expect("temporary directory");
    let output = run(&["import", "doorway-camera-code", source.to_str()?, out.path().to_str()?]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    Some(out)
}

/// The update of an imported scene's frame with the published preset and λ.
fn update(recording: &Path, lambda: f64) -> Value {
    let lambda = lambda.to_string();
    let arguments = ["reconstruct", recording.to_str().expect("UTF-8"), "--preset", "published", "--lambda", &lambda];
    let output = run(&arguments);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let lines = String::from_utf8(output.stdout).expect("UTF-8");
    assert_eq!(lines.lines().count(), 1);
    serde_json::from_str(&lines).expect("an update")
}

fn rgb(value: &Value) -> [f64; 3] {
    serde_json::from_value(value.clone()).expect("three numbers")
}

fn norm(rgb: [f64; 3]) -> f64 {
    rgb.iter().map(|v| v * v).sum::<f64>().sqrt()
}

/// Index and colour of the strongest of some facets.
fn strongest(facets: impl Iterator<Item = (usize, [f64; 3])>) -> (usize, [f64; 3]) {
    facets.max_by(|a, b| norm(a.1).total_cmp(&norm(b.1))).expect("a facet is lit")
}

/// Whether two facets of the published grid are the same or touch in biangular coordinates: within one 4° cell in both.
fn neighbours(grid: &Value, a: usize, b: usize) -> bool {
    let angles = |n: usize| {
        let ends: [[f64; 2]; 2] = serde_json::from_value(grid["facets"][n].clone()).expect("a facet");
        let [x, y] = [0, 1].map(|k| (ends[0][k] + ends[1][k]) / 2.0);
        [y.atan2(x + 0.254), y.atan2(0.254 - x)].map(f64::to_degrees)
    };
    angles(a).iter().zip(angles(b)).all(|(p, q)| (p - q).abs() < 6.0)
}

/// Scenes whose objective is not reached: the descent ends in another optimum, at this ratio (docs/published.md).
const NOT_REACHED: [(&str, f64); 1] = [("syn-2", 1.032)];

#[test]
fn objectives_are_at_or_below_the_authors() {
    let Some(recordings) = imported() else { return };
    let Some(published) = data("reference/published") else { return };
    let mut compared = 0;
    for entry in std::fs::read_dir(published).expect("readable") {
        let reference = json(&entry.expect("an entry").path());
        let scene = reference["scene"].as_str().expect("scene");
        let recording = recordings.path().join(scene);
        if !recording.exists() {
            eprintln!("SKIPPED: {scene}: its measurement is not among the reference data");
            continue;
        }
        let update = update(&recording, reference["lambda"].as_f64().expect("lambda"));
        let ours = update["solution"]["objective"].as_f64().expect("objective");
        let theirs = reference["authors_objective"]["total"].as_f64().expect("total");
        eprintln!("{scene}: objective {ours:.5}, the authors' {theirs:.5}, ratio {:.4}", ours / theirs);
        let ratio = NOT_REACHED.iter().find(|(name, _)| *name == scene).map_or(1.0, |(_, ratio)| *ratio);
        assert!(ours <= ratio * theirs, "{scene}: {ours} > {ratio} * {theirs}");
        let bound = update["solution"]["bound"].as_f64().expect("bound");
        assert!(bound > 0.0 && bound <= ours, "{scene}: bound {bound}, objective {ours}");
        compared += 1;
    }
    assert!(compared > 0);
}

#[test]
fn the_strongest_unified_facet_is_the_published_figures() {
    let Some(recordings) = imported() else { return };
    let Some(grid) = data("reference/grid.json").map(|path| json(&path)) else { return };
    for scene in ["lab-0", "lab-2", "lab-4"] {
        let Some(reference) = data(&format!("reference/published/{scene}.json")).map(|path| json(&path)) else {
            return;
        };
        let update = update(&recordings.path().join(scene), reference["lambda"].as_f64().expect("lambda"));
        let brighter =
            |f: &Value| (f["index"].as_u64().expect("index") as usize, rgb(&f["unified"]).map(|v| v.max(0.0)));
        let ours = strongest(update["facets"].as_array().expect("facets").iter().map(brighter));
        let figure = reference["published"]["combo"].as_object().expect("combo");
        let theirs = strongest(figure.iter().map(|(n, v)| (n.parse().expect("index"), rgb(v))));
        assert!(neighbours(&grid, ours.0, theirs.0), "{scene}: facet {} against the figure's {}", ours.0, theirs.0);
        let dot: f64 = ours.1.iter().zip(theirs.1).map(|(a, b)| a * b).sum();
        let cosine = dot / (norm(ours.1) * norm(theirs.1));
        assert!(cosine >= 0.97, "{scene}: cosine of the colours {cosine}");
    }
}

#[test]
fn the_difference_is_the_one_that_the_authors_solved_for() {
    use doorcam_core::light::{Decoding, Filter, LightTable, Patch, PatchResampler};
    use doorcam_core::transport::edge_foot_mask;
    use doorcam_core::transport::{PatchGrid, PixelLayout};

    let Some(recordings) = imported() else { return };
    let patch = PatchGrid { size: 64, fov_m: 0.15, layout: PixelLayout::EndsIncluded };
    let mask = edge_foot_mask(&patch);
    for (scene, fraction) in [("lab-0", 1.0), ("lab-2", 1.0), ("lab-4", 1.0), ("syn-0", 0.5), ("syn-1", 0.5)] {
        let Some(reference) = data(&format!("reference/published/{scene}.json")).map(|path| json(&path)) else {
            return;
        };
        let read = |index: u32, side: &str| {
            let file = recordings.path().join(scene).join(format!("frames/{index:08}_{side}.png"));
            let image = doorcam_source::image::decode(&std::fs::read(file).expect("readable")).expect("an image");
            let mut patch = Patch::zeros(64);
            PatchResampler::new((image.width, image.height), fraction, 64, Filter::Bicubic).apply(
                &image,
                &LightTable::new(&Decoding::Published),
                &mut patch,
            );
            patch
        };
        let mut half_energy = 0.0;
        for side in ["left", "right"] {
            let (before, after) = (read(0, side), read(1, side));
            for channel in 0..3 {
                for k in (0..mask.len()).filter(|&k| mask[k]) {
                    half_energy += 0.5 * f64::from(after.plane(channel)[k] - before.plane(channel)[k]).powi(2);
                }
            }
        }
        let theirs = reference["zero_objective"].as_f64().expect("zero_objective");
        // PNG codes are exact. JPEG decoders may differ by one code, and the differences are only a few codes.
        let tolerance = if scene.starts_with("syn") { 1e-6 } else { 1e-2 };
        assert!((half_energy - theirs).abs() < tolerance * theirs, "{scene}: ½‖y‖² is {half_energy}, theirs {theirs}");
    }
}

#[test]
fn import_lists_what_is_missing_and_overwrites_only_when_told() {
    let Some(source) = data("DoorwayCameraCode") else { return };
    let Some(recordings) = imported() else { return };
    let (source, out) = (source.to_str().unwrap(), recordings.path().to_str().unwrap());
    let again = run(&["import", "doorway-camera-code", source, out]);
    assert_eq!(again.status.code(), Some(1));
    let said = stderr(&again);
    assert!(said.contains("lab-0 exists already; give --force to overwrite it"), "{said}");
    let forced = run(&["import", "doorway-camera-code", source, out, "--force"]);
    assert_eq!(forced.status.code(), Some(0));
    let written = String::from_utf8(forced.stdout.clone()).unwrap();
    assert!(written.lines().any(|line| line.ends_with("/lab-0")), "{written}");
    for scene in ["lab-1", "syn-2"].iter().filter(|s| !recordings.path().join(s).exists()) {
        assert!(stderr(&forced).contains(&format!("{scene}: left out, no ")), "{}", stderr(&forced));
    }
    let empty = tempfile::tempdir().unwrap();
    let nothing = run(&["import", "doorway-camera-code", empty.path().to_str().unwrap(), out]);
    assert_eq!(nothing.status.code(), Some(1));
    assert!(stderr(&nothing).contains("no measurement of DoorwayCameraCode found"));
}

#[test]
fn neither_random_starts_nor_the_relaxation_find_anything_much_better() {
    let Some(recordings) = imported() else { return };
    for (scene, lambda) in [("lab-0", "0.05"), ("lab-2", "0.05"), ("lab-4", "0.01"), ("syn-0", "0.2"), ("syn-1", "0.1")]
    {
        let recording = recordings.path().join(scene);
        if !recording.exists() {
            eprintln!("SKIPPED: {scene}: its measurement is not among the reference data");
            continue;
        }
        let path = recording.to_str().expect("UTF-8");
        let output = run(&["reconstruct", path, "--preset", "published", "--lambda", lambda, "--audit", "200"]);
        let said = stderr(&output);
        let after = |what: &str| -> f64 {
            let rest = said.split(what).nth(1).unwrap_or_else(|| panic!("{scene}: no {what:?} in {said}"));
            rest.split([' ', ',', '\n']).next().and_then(|number| number.parse().ok()).expect("a number")
        };
        let (best, relaxed) = (after("the best of 200 random starts "), after("two lights per facet "));
        let (rounded, bound) = (after("and from there "), after("proven bound "));
        eprintln!("{scene}: best of 200 {best}, two lights {relaxed}, from there {rounded}, bound {bound}");
        assert!((0.995..=1.0).contains(&best), "{scene}: {said}");
        assert!((0.995..=1.005).contains(&rounded), "{scene}: {said}");
        assert!(bound <= relaxed && relaxed <= best && best <= rounded, "{scene}: {said}");
    }
}

/// One frame of the empty room and one of somebody, with the default settings: a map, and people in it.
#[test]
fn published_measurements_show_their_map_with_the_default_settings() {
    let Some(recordings) = imported() else { return };
    let mut looked_at = 0;
    for scene in ["lab-0", "lab-2", "lab-4", "syn-0", "syn-1", "syn-2"] {
        let recording = recordings.path().join(scene);
        if !recording.exists() {
            eprintln!("SKIPPED: {scene}: its measurement is not among the reference data");
            continue;
        }
        let output = run(&["reconstruct", recording.to_str().expect("UTF-8")]);
        assert!(output.status.success(), "{}", stderr(&output));
        let update: Value = serde_json::from_slice(&output.stdout).expect("one update");
        assert!(!update["facets"].as_array().expect("facets").is_empty(), "{scene}");
        assert!(!update["tracks"].as_array().expect("tracks").is_empty(), "{scene}");
        looked_at += 1;
    }
    assert!(looked_at > 0);
}
