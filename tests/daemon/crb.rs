//! `doorcam crb` as a user sees it: table, CSV, figures, errors.

use std::collections::BTreeMap;
use std::path::Path;

use crate::common::{doorcam, run, stderr};

/// Runs `doorcam crb`, which must succeed, and returns its stdout.
fn crb(arguments: &[&str]) -> String {
    let output = doorcam(&["crb"]).args(arguments).output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{arguments:?}: {}", stderr(&output));
    String::from_utf8(output.stdout).unwrap()
}

/// Rows of a CSV by column.
fn csv(path: &Path, arguments: &[&str]) -> Vec<BTreeMap<String, String>> {
    let said = crb(&[arguments, &["--output", path.to_str().unwrap()]].concat());
    assert!(said.is_empty(), "{said}");
    let text = std::fs::read_to_string(path).unwrap();
    let mut lines = text.lines().map(|line| line.split(',').map(str::to_owned));
    let titles: Vec<String> = lines.next().unwrap().collect();
    lines.map(|line| titles.iter().cloned().zip(line).collect()).collect()
}

fn number(row: &BTreeMap<String, String>, column: &str) -> f64 {
    row[column].parse().unwrap()
}

#[test]
fn the_csv_has_the_columns_of_the_contract_and_the_order_of_figure_5() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("bound.csv");
    let rows = csv(&path, &[]);
    let text = std::fs::read_to_string(&path).unwrap();
    assert_eq!(text.lines().next(), Some("strategy,phi1_deg,phi2_deg,sd_c,sd_phi1_rad,sd_phi2_rad"));
    let mut places: BTreeMap<(String, String), BTreeMap<String, [f64; 2]>> = BTreeMap::new();
    for row in &rows {
        let angles = (row["phi1_deg"].clone(), row["phi2_deg"].clone());
        let sds = ["sd_phi1_rad", "sd_phi2_rad"].map(|column| number(row, column));
        places.entry(angles).or_default().insert(row["strategy"].clone(), sds);
    }
    assert_eq!(rows.len(), 4 * places.len());
    for (place, of) in &places {
        let [single, corner, double, door] =
            ["single-patch", "single-corner", "double-patch", "doorway"].map(|name| of[name]);
        for k in 0..2 {
            assert!(door[k] <= corner[k] && door[k] <= double[k] && double[k] <= single[k], "{place:?}: {of:?}");
        }
        assert!(corner[0] < 0.1 * single[0], "{place:?}: {of:?}");
    }
}

#[test]
fn noise_scales_every_figure_and_the_mirror_exchanges_the_angles() {
    let dir = tempfile::tempdir().unwrap();
    let at = ["--at", "60,45", "45,60"];
    let of = |name: &str, noise: &str| csv(&dir.path().join(name), &[&at[..], &["--noise", noise]].concat());
    let (unit, louder) = (of("unit.csv", "1"), of("louder.csv", "3"));
    assert_eq!(unit.len(), 8);
    for (a, b) in unit.iter().zip(&louder) {
        for column in ["sd_c", "sd_phi1_rad", "sd_phi2_rad"] {
            assert!((number(b, column) / number(a, column) - 3.0).abs() < 1e-9);
        }
    }
    let doorway: Vec<_> = unit.iter().filter(|row| row["strategy"] == "doorway").collect();
    let [first, second] = [doorway[0], doorway[1]];
    assert_eq!((&first["phi1_deg"][..], &first["phi2_deg"][..]), ("60", "45"));
    for (a, b) in [("sd_phi1_rad", "sd_phi2_rad"), ("sd_phi2_rad", "sd_phi1_rad"), ("sd_c", "sd_c")] {
        assert!((number(first, a) / number(second, b) - 1.0).abs() < 1e-6);
    }
}

#[test]
fn the_table_says_the_same_in_degrees_and_metres() {
    let dir = tempfile::tempdir().unwrap();
    let rows = csv(&dir.path().join("bound.csv"), &["--place", "-0.25,1"]);
    let table = crb(&["--place", "-0.25,1"]);
    let door: Vec<&str> = table.lines().find(|line| line.starts_with("doorway")).unwrap().split_whitespace().collect();
    assert_eq!(&door[..5], ["doorway", "76.0", "53.1", "-0.25", "1.00"]);
    let row = rows.iter().find(|row| row["strategy"] == "doorway").unwrap();
    for (cell, column) in [(door[6], "sd_phi1_rad"), (door[7], "sd_phi2_rad")] {
        let shown: f64 = cell.parse().unwrap();
        assert!((shown / number(row, column).to_degrees() - 1.0).abs() < 0.01, "{cell} {row:?}");
    }
    let [x, y, correlation, error] = [8, 9, 10, 11].map(|k| door[k].parse::<f64>().unwrap());
    assert!((x.hypot(y) / error - 1.0).abs() < 0.01);
    let of = |strategy: &str, place: &str| -> f64 {
        let table = crb(&["--place", place]);
        let row = table.lines().find(|line| line.starts_with(strategy)).unwrap().to_owned();
        row.split_whitespace().nth(10).unwrap().parse().unwrap()
    };
    assert!((correlation + of("doorway", "0.25,1")).abs() < 2e-3, "mirroring changes its sign");
    // With one edge, only the direction of its ray is known, which leads to the right.
    assert!(of("single-corner", "-0.25,1") > 0.95);
}

#[test]
fn figures_are_svg_and_png_of_the_same_shape() {
    let dir = tempfile::tempdir().unwrap();
    for more in
        [&["--pixels", "20"][..], &["--pixels", "20", "--width-sd", "500"], &["--person"], &["--sweep", "patch"]]
    {
        let [svg, png] = ["f.svg", "f.png"].map(|name| dir.path().join(name));
        for path in [&svg, &png] {
            assert!(crb(&[more, &["--output", path.to_str().unwrap()]].concat()).is_empty());
        }
        let text = std::fs::read_to_string(&svg).unwrap();
        let length = |name: &str| {
            let at = text.find(&format!(" {name}=\"")).unwrap() + name.len() + 3;
            text[at..].split('"').next().unwrap().parse::<f64>().unwrap()
        };
        let picture = image::open(&png).unwrap();
        let ratio = f64::from(picture.width()) / f64::from(picture.height());
        assert!((ratio / (length("width") / length("height")) - 1.0).abs() < 0.01);
        for title in ["single corner", "doorway"] {
            assert!(text.contains(title), "{more:?}");
        }
        let samples = if more.contains(&"--pixels") { 6 } else { 0 };
        assert_eq!(text.matches("<image").count(), samples, "{more:?}");
    }
}

#[test]
fn sweeps_answer_what_helps() {
    let dir = tempfile::tempdir().unwrap();
    let errors = |more: &[&str]| -> Vec<(f64, f64)> {
        let rows = csv(&dir.path().join("sweep.csv"), &[&["--place", "0.3,1.5"], more].concat());
        let doorway = rows.iter().filter(|row| row["strategy"] == "doorway");
        let name = more.iter().find_map(|word| word.split('=').next().filter(|w| rows[0].contains_key(*w))).unwrap();
        doorway.map(|row| (number(row, name), number(row, "error_m"))).collect()
    };
    for kind in [&[][..], &["--person", "--pixels", "32"]] {
        let sweep = |what: &str| errors(&[kind, &["--sweep", what]].concat());
        let exposure = sweep("exposure=1,4,16");
        for (value, error) in &exposure {
            assert!((error * value.sqrt() / exposure[0].1 - 1.0).abs() < 1e-9, "{exposure:?}");
        }
        let patch = sweep("patch=0.1,0.2,0.4");
        assert!(patch[0].1 > patch[1].1 && patch[1].1 > patch[2].1, "{patch:?}");
        // More pixels for the same light only sharpen the shadow's border.
        let pixels = sweep("pixels=8,16,32");
        assert!(pixels[0].1 > pixels[2].1 && pixels[1].1 > pixels[2].1, "{pixels:?}");
    }
}

#[test]
fn what_cannot_be_is_refused_in_one_line() {
    for (arguments, expected) in [
        (&["--noise", "0"][..], "doorcam: --noise is 0, expected a number above 0"),
        (&["--door", "-1"], "doorcam: --door is -1, expected metres from 0.01 to 100"),
        (&["--pixels", "0"], "doorcam: --pixels is 0, expected pixels along a side from 1 to 1000"),
        (&["--person", "--contrast", "0"], "doorcam: --contrast is 0, expected a share other than 0"),
        (&["--width-sd", "NaN"], "doorcam: --width-sd is NaN, expected a number above 0"),
        (&["--sweep", "patch=0.1,0"], "doorcam: --sweep patch: patch is 0, expected metres from 0.001 to 10"),
        (&["--output", "/nowhere/at/all.csv"], "doorcam: /nowhere/at/all.csv: No such file or directory (os error 2)"),
    ] {
        let output = doorcam(&["crb"]).args(arguments).output().unwrap();
        assert_eq!(output.status.code(), Some(1), "{arguments:?}");
        assert_eq!(stderr(&output).trim_end(), expected);
    }
    for (arguments, expected) in [
        (["--at", "100,90"], "both above 0 and less than 180 together"),
        (["--at", "60"], "expected two angles in degrees"),
        (["--place", "0,-1"], "expected metres to the right and into the room"),
        (["--sweep", "colour"], "expected patch, pixels, exposure, door or wall"),
        (["--sweep", "pixels=8,1.5"], "expected numbers after pixels="),
        (["--output", "bound.pdf"], "expected a name that ends in .svg, .png or .csv"),
        (["--contrast", "0.5"], "--person"),
    ] {
        let output = run(&["crb", arguments[0], arguments[1]]);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        assert!(stderr(&output).contains(expected), "{}", stderr(&output));
    }
}
