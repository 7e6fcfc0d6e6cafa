//! Crossings of the threshold, as marks on a line above the errors over time.

use svg::node::element::{Circle, Group, Line};

use super::plan::{TRUTH, WRONG, cross, ring};
use super::text::{Anchor, line, unit};
use crate::evaluation::{CrossingScore, CrossingVerdict};
use doorcam_core::tracking::Direction;

/// Height with the words above the line, in page units.
pub(super) const HEIGHT: f64 = 34.0;
const TEXT: f64 = 10.0;

/// Draws the marks with their directions on a line as wide as the rows below; `x` gives the place of a time.
pub(super) fn marks(crossings: &[CrossingScore], x: impl Fn(f64) -> f64, [left, top, width]: [f64; 3]) -> Group {
    let y = top + 18.0;
    let axis = Line::new()
        .set("x1", unit(left))
        .set("x2", unit(left + width))
        .set("y1", unit(y))
        .set("y2", unit(y))
        .set("stroke", "#000")
        .set("stroke-width", 0.8);
    let name = line(left - 7.0, y + 3.6, TEXT, Anchor::End, "crossings");
    let mut group = Group::new().set("id", "doorcam-crossings").add(axis).add(name);
    for crossing in crossings {
        let at = x(crossing.seconds);
        let (name, colour) = match crossing.verdict {
            CrossingVerdict::Right => ("right", TRUTH),
            CrossingVerdict::Missed => ("missed", WRONG),
            CrossingVerdict::False => ("false", WRONG),
        };
        let mark = Group::new().set("class", name);
        let mark = match crossing.verdict {
            CrossingVerdict::Right => {
                mark.add(Circle::new().set("cx", unit(at)).set("cy", unit(y)).set("r", 3.2).set("fill", TRUTH))
            }
            CrossingVerdict::Missed => mark.add(ring([at, y])),
            CrossingVerdict::False => mark.add(cross(std::iter::once([at, y]))),
        };
        let word = line(at, y - 7.0, TEXT, Anchor::Middle, direction(crossing.direction)).set("fill", colour);
        group = group.add(mark.add(word));
    }
    group
}

fn direction(direction: Direction) -> &'static str {
    match direction {
        Direction::In => "in",
        Direction::Out => "out",
        Direction::Back => "back",
    }
}
