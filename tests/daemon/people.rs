//! From a simulated room to tracks: the real program compared with the truth.

use std::path::Path;
use std::process::Command;

pub(super) fn doorcam(arguments: &[&str]) -> String {
    let output = Command::new(env!("CARGO_BIN_EXE_doorcam")).args(arguments).output().unwrap();
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

pub(super) fn evaluate(recording: &Path) -> serde_json::Value {
    serde_json::from_str(&doorcam(&["evaluate", "--json", recording.to_str().unwrap()])).unwrap()
}

/// Simulates a scenario (a name or a file in `tests/rooms`) and evaluates it.
fn simulate(scenario: &str, frames: &str) -> serde_json::Value {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("recording");
    doorcam(&["simulate", scenario, out.to_str().unwrap(), "--frames", frames, "--seed", "5"]);
    evaluate(&out)
}

fn number(figures: &serde_json::Value, key: &str) -> f64 {
    figures[key].as_f64().unwrap_or_else(|| panic!("{key} of {figures}"))
}

#[test]
fn one_person_is_followed_through_a_simulated_room() {
    let figures = simulate("one-person", "300");
    assert!(number(&figures, "mean_error_m") < 0.1, "{figures}");
    assert!(number(&figures, "missed_share") < 0.05, "{figures}");
    assert_eq!((&figures["false_tracks"], &figures["id_switches"]), (&0.into(), &0.into()), "{figures}");
}

#[test]
fn two_who_cross_keep_their_tracks() {
    let figures = simulate("two-crossing", "400");
    assert!(number(&figures, "mean_error_m") < 0.1, "{figures}");
    assert!(number(&figures, "missed_share") < 0.1, "{figures}");
    // For a moment, one person hides the other from both edges.
    assert!(number(&figures, "id_switches") <= 1.0, "{figures}");
    assert!(number(&figures, "ellipse_share") > 0.85, "{figures}");
}

/// As in section 5.1.3 of the paper. All four people are found and nobody else. Distances are not checked, because with
/// some noise one of them seems farther away (docs/detection.md).
#[test]
fn four_people_at_once_are_followed() {
    let figures = simulate("four-people", "400");
    assert!(number(&figures, "missed_share") < 0.05, "{figures}");
    assert_eq!(figures["false_tracks"], 0, "{figures}");
}

/// A person hardly darker than what is behind, at least 2 m away: thresholds that are too strict lose such people
/// first.
#[test]
fn somebody_faint_and_far_is_followed() {
    let room = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/rooms/faint.toml");
    let figures = simulate(room, "120");
    assert!(number(&figures, "mean_error_m") < 0.2, "{figures}");
    assert!(number(&figures, "missed_share") < 0.15, "{figures}");
    assert_eq!(figures["false_tracks"], 0, "{figures}");
}

#[test]
fn nobody_is_followed_in_an_empty_room() {
    let figures = simulate("empty-room", "240");
    assert_eq!((&figures["tracks"], &figures["false"]), (&0.into(), &0.into()), "{figures}");
}

/// Path-traced rooms that were rendered by other software.
#[test]
fn people_in_rendered_rooms_are_followed() {
    let data = std::env::var_os("DOORCAM_DATA").unwrap_or_else(|| "../shared/data".into());
    let rendered = Path::new(&data).join("rendered");
    if !rendered.is_dir() {
        eprintln!("skipped: no {}", rendered.display());
        return;
    }
    for (name, mean_m, p95_m, missed) in [("D1", 0.12, 0.30, 0.05), ("D2", 0.20, 0.45, 0.10), ("D3", 0.10, 0.30, 0.10)]
    {
        let figures = evaluate(&rendered.join(name));
        assert!(number(&figures, "mean_error_m") <= mean_m, "{figures}");
        assert!(number(&figures, "p95_error_m") <= p95_m, "{figures}");
        assert!(number(&figures, "missed_share") <= missed, "{figures}");
        // Bodies here are cylinders, which the model knows better than those with legs and arms that its errors are for:
        // ellipses may be wider than these rooms need, but not wide beyond measure.
        assert!(number(&figures, "ellipse_share") >= 0.85 && number(&figures, "median_nees") > 0.05, "{figures}");
        assert_eq!((&figures["false_tracks"], &figures["id_switches"]), (&0.into(), &0.into()), "{figures}");
    }
}
