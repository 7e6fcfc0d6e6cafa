//! True and estimated paths on the floor plan, beside the errors over time.

use svg::Document;
use svg::node::element::{ClipPath, Definitions, Group, Rectangle, Title};

use super::evaluation_picture::EvaluationPicture;
use super::frame::{Frame, length_or};
use super::plan::{floor, key, people_and_tracks, shades};
use super::text::{Anchor, FONT, line, unit, wrap};
use super::{axes, timeline};
use crate::evaluation::PersonPath;
use doorcam_core::geometry::Doorway;

/// Maximum width and height of the floor plan, in page units.
const PLAN: [f64; 2] = [520.0, 560.0];
/// Width of the rows of errors over time, in page units.
const TIMELINE: f64 = 400.0;
const GAP: f64 = 14.0;
const TITLE: f64 = 24.0;
const TITLE_TEXT: f64 = 12.5;
const CAPTION_TEXT: f64 = 12.0;
const CAPTION_LINE: f64 = 17.0;
/// Space between the two panels, for the labels of the second one.
const BETWEEN: f64 = 74.0;
const CLIP: &str = "doorcam-evaluation-clip";

/// Draws true and estimated paths as a figure for print, an SVG document.
///
/// Left: the floor plan to scale. True paths are dark, with a mark at the start and ticks at whole numbers of seconds.
/// Estimates have one colour per track, with the 95 % error ellipse at every tick. Right: one row per true path, with
/// its error over time against the reach of the reported ellipse in the error's direction, below the crossings of the
/// threshold.
pub fn evaluation_svg(picture: &EvaluationPicture) -> String {
    let doorway = &Doorway {
        width_m: length_or(picture.doorway.width_m, 0.0),
        wall_thickness_m: length_or(picture.doorway.wall_thickness_m, 0.0),
        height_m: None,
        leaf: None,
    };
    let frame = extent(picture, doorway);
    let shades = shades(picture.tracks);
    let step = tick_step(picture.people);
    let clip = Rectangle::new()
        .set("x", unit(frame.left))
        .set("y", unit(frame.top))
        .set("width", unit(frame.width()))
        .set("height", unit(frame.height()));
    let plan = Group::new()
        .set("id", "doorcam-plan")
        .add(line(frame.left, frame.top - 8.0, TITLE_TEXT, Anchor::Start, "(a) true and estimated paths"))
        .add(
            Group::new()
                .set("clip-path", format!("url(#{CLIP})"))
                .add(floor(&frame, doorway))
                .add(people_and_tracks(&frame, picture, &shades, step)),
        )
        .add(axes::axes(&frame));

    let left = frame.left + frame.width() + BETWEEN;
    let key_top = frame.top + frame.height() - key::height(&shades);
    let place = [left, frame.top, TIMELINE, (key_top - GAP - frame.top).max(120.0)];
    let (rows, rows_end) = timeline::rows(picture.people, picture.crossings, &shades, place);
    let key_top = key_top.max(rows_end + GAP);
    let width = left + TIMELINE + GAP;
    let mut page = Group::new()
        .add(plan)
        .add(line(left, frame.top - 8.0, TITLE_TEXT, Anchor::Start, "(b) error over time"))
        .add(rows)
        .add(key::key(left, key_top, &shades, step));
    let mut bottom = (frame.bottom() + axes::BELOW).max(key_top + key::height(&shades)) + GAP;
    for text in wrap(picture.caption, width - frame.left - GAP, CAPTION_TEXT) {
        bottom += CAPTION_LINE;
        page = page.add(line(frame.left, bottom, CAPTION_TEXT, Anchor::Start, &text));
    }
    let size = [width, bottom + GAP].map(unit);
    Document::new()
        .set("width", size[0])
        .set("height", size[1])
        .set("viewBox", (0, 0, size[0], size[1]))
        .set("font-family", FONT)
        .add(Title::new("True and estimated paths behind the doorway"))
        .add(Definitions::new().add(ClipPath::new().set("id", CLIP).add(clip)))
        .add(Rectangle::new().set("width", "100%").set("height", "100%").set("fill", "#fff"))
        .add(page)
        .to_string()
}

/// The part of the floor plan that is shown: the room, all true positions, and some floor in front of the wall.
fn extent(picture: &EvaluationPicture, doorway: &Doorway) -> Frame {
    let [mut half, mut depth] = [picture.room.half_width_m, picture.room.depth_m].map(|v| length_or(v, 1.0));
    for [x, y] in picture.people.iter().flat_map(|person| &person.points).map(|point| point.position) {
        half = half.max(length_or(x.abs() + 0.1, half));
        depth = depth.max(length_or(y + 0.1, depth));
    }
    let before = doorway.wall_thickness_m + 0.06 * depth;
    let scale = (PLAN[0] / (2.0 * half)).min(PLAN[1] / (depth + before));
    Frame { left: axes::LEFT, top: GAP + TITLE, scale, x: [-half, half], y: [-before, depth] }
}

/// Seconds between the ticks of a path: a round number, with about 15 ticks on the longest path.
fn tick_step(people: &[PersonPath]) -> f64 {
    let span = |person: &PersonPath| match (person.points.first(), person.points.last()) {
        (Some(first), Some(last)) => last.seconds - first.seconds,
        _ => 0.0,
    };
    let longest = people.iter().map(span).fold(0.0, f64::max);
    [1.0, 2.0, 5.0, 10.0, 30.0, 60.0, 300.0].into_iter().find(|step| longest / step <= 16.0).unwrap_or(1800.0)
}
