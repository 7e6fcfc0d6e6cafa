//! The key of an evaluation's picture.

use svg::node::element::{Circle, Ellipse, Group, Line, Rectangle};

use super::{Shade, TRUTH, cross, name_mark, ring};
use crate::figures::text::{Anchor, line, unit};
use crate::figures::timeline::{REACH, SETTLING};

const ROW: f64 = 18.0;
const TEXT: f64 = 10.5;
const SIGN: f64 = 30.0;
const COLUMN: f64 = 205.0;
/// Number of signs in the first column.
const SIGNS: usize = 7;
/// Maximum number of tracks that are named.
const NAMED: usize = 9;

pub(in crate::figures) fn height(shades: &[Shade]) -> f64 {
    ROW * rows(shades).len().max(SIGNS) as f64
}

/// Colours and names in the second column.
fn rows(shades: &[Shade]) -> Vec<(&'static str, String)> {
    let name = |id: Option<u64>| id.map_or_else(|| "detections".to_owned(), |id| format!("track {id}"));
    let mut rows: Vec<_> = shades.iter().take(NAMED).map(|&(id, colour)| (colour, name(id))).collect();
    if shades.len() > NAMED {
        rows.push((TRUTH, format!("and {} more tracks, in the same colours", shades.len() - NAMED)));
    }
    rows
}

/// Draws the key: signs on the left, tracks on the right.
pub(in crate::figures) fn key(x: f64, y: f64, shades: &[Shade], step: f64) -> Group {
    let middle = |row: usize| y + (row as f64 + 0.5) * ROW;
    let text = |column: f64, row: usize, words: &str| {
        line(x + column + SIGN + 8.0, middle(row) + 3.7, TEXT, Anchor::Start, words)
    };
    let stroke = |column: f64, row: usize, colour: &str| {
        Line::new()
            .set("x1", unit(x + column))
            .set("x2", unit(x + column + SIGN))
            .set("y1", unit(middle(row)))
            .set("y2", unit(middle(row)))
            .set("stroke", colour)
    };
    let area = |row: usize, colour: &str| {
        Rectangle::new()
            .set("x", unit(x))
            .set("y", unit(middle(row) - 5.5))
            .set("width", SIGN)
            .set("height", 11)
            .set("fill", colour)
    };
    let centre = x + SIGN / 2.0;
    let tick = Line::new().set("x1", unit(centre)).set("x2", unit(centre)).set("stroke", TRUTH);
    let plural = if step == 1.0 { "second".to_owned() } else { format!("{step} seconds") };
    let ellipse = Ellipse::new()
        .set("cx", unit(centre))
        .set("cy", unit(middle(2)))
        .set("rx", 13)
        .set("ry", 5.5)
        .set("fill", "#777")
        .set("fill-opacity", 0.1)
        .set("stroke", "#777");
    let mut group = Group::new()
        .set("class", "key")
        .add(name_mark([centre, middle(0)], "1"))
        .add(text(0.0, 0, "person, start of a path"))
        .add(stroke(0.0, 1, TRUTH).set("stroke-width", 1.2))
        .add(tick.set("y1", unit(middle(1) - 3.5)).set("y2", unit(middle(1) + 3.5)))
        .add(text(0.0, 1, &format!("true path, a tick every {plural}")))
        .add(ellipse)
        .add(text(0.0, 2, "reported 95 % ellipse"))
        .add(ring([centre, middle(3)]))
        .add(text(0.0, 3, "missed"))
        .add(cross(std::iter::once([centre, middle(4)])))
        .add(text(0.0, 4, "false: nobody there"))
        .add(area(5, REACH))
        .add(text(0.0, 5, "(b) reach of the ellipse"))
        .add(area(6, SETTLING))
        .add(text(0.0, 6, "(b) just came in: not scored"));
    for (row, (colour, name)) in rows(shades).into_iter().enumerate() {
        let dot = Circle::new().set("cx", unit(centre + COLUMN)).set("cy", unit(middle(row))).set("r", 2.4);
        group = group
            .add(stroke(COLUMN, row, colour).set("stroke-width", 1.3))
            .add(dot.set("fill", colour))
            .add(text(COLUMN, row, &name));
    }
    group
}
