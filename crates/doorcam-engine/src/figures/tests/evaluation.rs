//! Reads the picture of an evaluation back: positions from its axes, signs from its pixels.

use proptest::prelude::*;

use super::shown::Shown;
use super::*;
use crate::evaluation::{CrossingScore, CrossingVerdict, EstimatedPoint, Found, PersonPath, TrackPath, TruePoint};
use doorcam_core::tracking::Direction;

const DOORWAY: Doorway = Doorway { width_m: 0.85, wall_thickness_m: 0.12, height_m: None, leaf: None };
const ROOM: Room = Room { half_width_m: 1.5, depth_m: 3.0 };
const COVARIANCE: [[f64; 2]; 2] = [[0.01, 0.0], [0.0, 0.04]];

fn svg(people: &[PersonPath], tracks: &[TrackPath], caption: &str) -> String {
    evaluation_svg(&EvaluationPicture { doorway: &DOORWAY, room: &ROOM, people, tracks, crossings: &[], caption })
}

fn still(seconds: f64, position: Point, found: Option<Found>) -> TruePoint {
    TruePoint { seconds, position, settling: false, directed: false, found }
}

fn estimate(seconds: f64, position: Point, stray: bool) -> EstimatedPoint {
    EstimatedPoint { seconds, position, covariance: COVARIANCE, stray, joined: true }
}

#[test]
fn paths_strays_and_ellipses_stand_where_they_are() {
    let found = Some(Found { track: Some(4), error_m: 0.5, reach_m: Some(0.6) });
    let person = PersonPath {
        id: 1,
        points: vec![still(0.1, [-1.0, 1.0], found), still(0.5, [0.0, 1.0], found), still(0.9, [1.0, 1.0], None)],
    };
    let track =
        TrackPath { id: Some(4), points: vec![estimate(0.1, [-1.0, 1.5], false), estimate(0.5, [0.0, 1.5], false)] };
    let nobody = TrackPath { id: Some(5), points: vec![estimate(0.1, [0.5, 2.5], true)] };
    let shown = Shown::new(svg(&[person], &[track, nobody], "caption"));
    let at = |place| shown.at("doorcam-plan", 0, place);
    let close = |found: [u8; 3], expected: [u8; 3]| found.iter().zip(expected).all(|(&a, b)| a.abs_diff(b) < 40);
    assert!(close(at([-0.3, 1.0]), [0x1a; 3]), "the true path: {:?}", at([-0.3, 1.0]));
    assert!(close(at([0.0, 1.5]), [0x00, 0x72, 0xb2]), "the estimated one: {:?}", at([0.0, 1.5]));
    assert!(close(at([0.5, 2.5]), [0xd1, 0x33, 0x0f]), "a stray: {:?}", at([0.5, 2.5]));
    assert_eq!(at([1.0, 1.0]), [255; 3], "the middle of the ring around a missed person");
    assert_eq!(at([1.2, -0.06]), [0x8c, 0x8c, 0x92], "the wall");
    assert_eq!(at([0.2, -0.06]), [255; 3], "the doorway");
    // The ellipse reaches 2.45 · 0.1 m along x and 2.45 · 0.2 m along y.
    let tinted = |place| at(place)[0] < 250;
    assert!(tinted([-0.8, 1.55]) && tinted([-1.05, 1.9]), "inside the ellipse");
    assert!(!tinted([-0.7, 1.62]) && !tinted([-1.1, 2.07]), "outside of it");
}

#[test]
fn who_walks_is_ticked_and_who_is_missed_is_marked_in_both_panels() {
    let person = |id, missed: bool| PersonPath {
        id,
        points: (0..21).map(|k| still(0.2 * f64::from(k), [0.05 * f64::from(k), 1.0], None)).collect::<Vec<_>>()
            [..if missed { 21 } else { 1 }]
            .to_vec(),
    };
    let text = svg(&[person(3, true), person(8, false)], &[], "");
    assert!(text.contains(">\n3\n<") && text.contains("person 8"), "names");
    let document = Document::parse(&text).expect("XML");
    let rings = document.descendants().filter(|n| n.has_tag_name("g") && n.attribute("class") == Some("missed"));
    let counts: Vec<usize> = rings.map(|g| g.children().filter(|n| n.has_tag_name("circle")).count()).collect();
    assert_eq!(counts, [21, 1]);
    let strokes = document.descendants().filter(|n| n.has_tag_name("path") && n.attribute("class") == Some("missed"));
    let strokes: Vec<usize> = strokes.map(|p| p.attribute("d").expect("d").matches('M').count()).collect();
    assert_eq!(strokes, [21, 1]);
}

#[test]
fn crossings_are_marked_on_a_line_of_their_own_in_order_of_time() {
    let crossing = |seconds, direction, verdict| CrossingScore { seconds, direction, verdict };
    let crossings = [
        crossing(0.5, Direction::In, CrossingVerdict::Right),
        crossing(3.0, Direction::Back, CrossingVerdict::False),
        crossing(5.5, Direction::Out, CrossingVerdict::Missed),
    ];
    let person = PersonPath { id: 1, points: vec![still(1.0, [0.0, 1.0], None), still(5.0, [0.0, 1.0], None)] };
    for people in [&[person][..], &[]] {
        let picture = EvaluationPicture {
            doorway: &DOORWAY,
            room: &ROOM,
            people,
            tracks: &[],
            crossings: &crossings,
            caption: "",
        };
        let text = evaluation_svg(&picture);
        let document = Document::parse(&text).expect("XML");
        let line = document.descendants().find(|n| n.attribute("id") == Some("doorcam-crossings")).expect("the line");
        let marks = line.children().filter(|n| n.has_tag_name("g"));
        let mark = |mark: Node<'_, '_>| {
            let word = mark.children().find(|n| n.has_tag_name("text")).expect("a word");
            let x: f64 = word.attribute("x").expect("a place").parse().expect("a number");
            let words = word.text().expect("words").trim();
            (mark.attribute("class").expect("a verdict").to_owned(), words.to_owned(), x)
        };
        let marks: Vec<_> = marks.map(mark).collect();
        let named: Vec<_> = marks.iter().map(|(verdict, word, _)| (verdict.as_str(), word.as_str())).collect();
        assert_eq!(named, [("right", "in"), ("false", "back"), ("missed", "out")]);
        // The first and the last are the ends of the line, and the other is in its middle.
        assert!((marks[1].2 - (marks[0].2 + marks[2].2) / 2.0).abs() < 0.1 && marks[0].2 < marks[1].2, "{marks:?}");
        assert_eq!(text.contains(">\nnobody there\n<"), people.is_empty());
        png(&text, 800).expect("PNG");
    }
    assert!(!svg(&[], &[], "").contains("doorcam-crossings"));
}

#[test]
fn who_is_known_by_direction_is_not_marked_as_missed() {
    let mut points = vec![still(0.0, [0.0, 1.0], None), still(0.1, [0.0, 1.0], None)];
    points[0].directed = true;
    let text = svg(&[PersonPath { id: 1, points }], &[], "");
    let document = Document::parse(&text).expect("XML");
    let missed = document.descendants().find(|n| n.has_tag_name("path") && n.attribute("class") == Some("missed"));
    assert_eq!(missed.and_then(|p| p.attribute("d")).expect("strokes").matches('M').count(), 1);
}

#[test]
fn an_empty_room_is_a_picture_too() {
    let text = svg(&[], &[], "nobody");
    assert!(text.contains("nobody there"));
    png(&text, 800).expect("PNG");
}

proptest! {
    #[test]
    fn no_number_breaks_the_picture(values in proptest::collection::vec(prop_oneof![
        Just(f64::NAN), Just(f64::INFINITY), Just(-1e300), Just(0.0), -3.0..3.0
    ], 12)) {
        let point = |k: usize| [values[k], values[k + 1]];
        let found = Some(Found { track: None, error_m: values[0], reach_m: Some(values[1]) });
        let person = PersonPath { id: 1, points: vec![still(values[2], point(3), found), still(values[5], point(6), None)] };
        let covariance = [[values[8], values[9]], [values[9], values[10]]];
        let stray = EstimatedPoint { seconds: values[11], position: point(0), covariance, stray: values[4] > 0.0, joined: true };
        let text = svg(&[person], &[TrackPath { id: Some(1), points: vec![stray, stray] }], "");
        prop_assert!(!text.contains("NaN") && !text.contains("inf"));
        prop_assert!(png(&text, 300).is_ok());
    }
}
