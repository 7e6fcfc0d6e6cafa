//! Reads curves back from their paths.

use proptest::prelude::*;

use super::*;

fn picture(points: Vec<Point>) -> String {
    let panel = CurvesPanel { title: "title".into(), curves: vec![Curve { name: "name".into(), points }] };
    curves_svg(&CurvesPicture { x_label: "x", y_label: "y", panels: &[panel], caption: "caption" })
}

fn path(svg: &str) -> String {
    let document = Document::parse(svg).expect("XML");
    let curve = document.descendants().find(|n| n.attribute("class") == Some("curve")).expect("a curve");
    curve.attribute("d").expect("d").to_owned()
}

#[test]
fn a_power_law_is_a_straight_line_and_gaps_stay_gaps() {
    let law = |x: f64| [x, 0.3 * x.powi(-2)];
    let d = path(&picture(vec![law(0.1), law(0.2), [0.3, f64::INFINITY], law(0.4), law(0.8)]));
    assert_eq!(d.matches('M').count(), 2, "broken at a value that is not finite: {d}");
    let numbers = d.replace(['M', 'L'], " ");
    let numbers: Vec<f64> = numbers.split_whitespace().map(|n| n.parse().expect("number")).collect();
    let steps: Vec<f64> = numbers.chunks(2).map(|p| p[0]).collect::<Vec<_>>().windows(2).map(|w| w[1] - w[0]).collect();
    let falls: Vec<f64> = numbers.chunks(2).map(|p| p[1]).collect::<Vec<_>>().windows(2).map(|w| w[1] - w[0]).collect();
    // Doublings of x are equally far apart on both axes: y falls to a quarter each time.
    for list in [steps, falls] {
        assert!(list.iter().all(|v| *v > 0.0 && (v - list[0]).abs() < 0.05), "{list:?}");
    }
}

#[test]
fn ticks_are_numbers_that_one_writes() {
    let svg = picture(vec![[0.05, 0.002], [0.5, 0.03]]);
    for tick in ["0.05", "0.1", "0.2", "0.5", "0.002", "0.005", "0.01", "0.02"] {
        assert!(svg.contains(&format!(">\n{tick}\n<")), "{tick} in {svg}");
    }
}

proptest! {
    #[test]
    fn no_number_breaks_the_curves(values in proptest::collection::vec(prop_oneof![
        Just(f64::NAN), Just(f64::INFINITY), Just(-1e300), Just(0.0), Just(1e11), Just(1e-11), 0.1..3.0
    ], 6)) {
        let text = picture(values.chunks(2).map(|p| [p[0], p[1]]).collect());
        prop_assert!(!text.contains("NaN") && !text.contains("inf"));
        prop_assert!(png(&text, 300).is_ok());
    }
}
