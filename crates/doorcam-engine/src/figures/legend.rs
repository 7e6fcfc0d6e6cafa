//! Brightness scales and the key of a figure.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use svg::node::element::{Circle, Group, Image, Line, Path, Rectangle};

use super::axes::{SPACING, ticks};
use super::text::{Anchor, decimal, line, unit};
use super::{panel, raster};

/// Width of a scale with its ticks and label, in page units.
pub(super) const SCALE_WIDTH: f64 = 80.0;

const BAR: f64 = 11.0;
const TEXT: f64 = 10.0;

/// Embeds RGB bytes as an image in the SVG, stretched over a rectangle without smoothing; none if they do not form an
/// image.
pub(super) fn embed(rgb: &[u8], size: [usize; 2], [x, y, width, height]: [f64; 4]) -> Option<Image> {
    let [columns, rows] = size.map(|s| u32::try_from(s).unwrap_or(0));
    let png = raster::encode(rgb, columns, rows).ok()?;
    let image = Image::new()
        .set("x", unit(x))
        .set("y", unit(y))
        .set("width", unit(width))
        .set("height", unit(height))
        .set("preserveAspectRatio", "none")
        .set("image-rendering", "optimizeSpeed")
        .set("href", format!("data:image/png;base64,{}", STANDARD.encode(png)));
    Some(image)
}

/// A vertical brightness scale from `range[0]` at the bottom to `range[1]` at the top. `level` gives the grey value at
/// a height from 0 (bottom) to 1 (top).
pub(super) fn scale([x, y, height]: [f64; 3], level: impl Fn(f64) -> u8, range: [f64; 2], label: &str) -> Group {
    const STEPS: usize = 128;
    let rgb: Vec<u8> = (0..STEPS).rev().flat_map(|k| [level((k as f64 + 0.5) / STEPS as f64); 3]).collect();
    let mut group = Group::new().set("class", "scale");
    if let Some(image) = embed(&rgb, [1, STEPS], [x, y, BAR, height]) {
        group = group.add(image);
    }
    let (factor, unit_text) = power_of_ten(range[1]);
    let [low, high] = range.map(|v| v / factor);
    let (values, decimals) = ticks([low, high], height / SPACING);
    let mut marks = String::new();
    for value in values {
        let at = y + height * (high - value) / (high - low);
        marks += &format!("M{} {}h3", unit(x + BAR), unit(at));
        group = group.add(line(x + BAR + 6.0, at + 3.6, TEXT, Anchor::Start, &decimal(value, decimals)));
    }
    let (turn_x, turn_y) = (unit(x + SCALE_WIDTH - 6.0), unit(y + height / 2.0));
    group
        .add(
            Rectangle::new()
                .set("x", unit(x))
                .set("y", unit(y))
                .set("width", BAR)
                .set("height", unit(height))
                .set("fill", "none")
                .set("stroke", "#000")
                .set("stroke-width", 0.8),
        )
        .add(Path::new().set("d", marks).set("stroke", "#000").set("stroke-width", 0.8))
        .add(
            line(turn_x, turn_y, TEXT, Anchor::Middle, &format!("{label}{unit_text}"))
                .set("transform", format!("rotate(-90 {turn_x} {turn_y})")),
        )
}

/// A power of ten to factor out of values that would need long tick labels, and the text that states it.
fn power_of_ten(largest: f64) -> (f64, String) {
    let exponent = largest.log10().floor();
    if (-3.0..4.0).contains(&exponent) {
        (1.0, String::new())
    } else {
        (10f64.powf(exponent), format!(" [1e{}]", decimal(exponent, 0)))
    }
}

/// Height of the key, in page units.
pub(super) const KEY_HEIGHT: f64 = 5.0 * ROW;
const ROW: f64 = 21.0;

/// The key of the panels.
pub(super) fn key(x: f64, y: f64) -> Group {
    let chip = |row: usize, fill: &str| {
        Rectangle::new()
            .set("x", unit(x))
            .set("y", unit(y + row as f64 * ROW))
            .set("width", 30)
            .set("height", 15)
            .set("fill", fill)
    };
    let middle = |row: usize| unit(y + row as f64 * ROW + 7.5);
    let facet = |row: usize| {
        Line::new().set("x1", unit(x + 5.0)).set("x2", unit(x + 25.0)).set("y1", middle(row)).set("y2", middle(row))
    };
    let mut group = Group::new()
        .set("class", "key")
        .add(chip(0, panel::ROOM))
        .add(
            Rectangle::new()
                .set("x", unit(x + 5.0))
                .set("y", unit(y + 4.5))
                .set("width", 20)
                .set("height", 6)
                .set("fill", "#d9822b")
                .set("stroke", panel::OUTLINE)
                .set("stroke-width", panel::OUTLINE_WIDTH),
        )
        .add(chip(1, panel::ROOM))
        .add(facet(1).set("stroke", panel::UNLIT).set("stroke-width", 1))
        .add(chip(2, panel::WALL))
        .add(chip(3, panel::ROOM))
        .add(Circle::new().set("cx", unit(x + 15.0)).set("cy", middle(3)).set("r", 3).set("fill", panel::EDGE))
        .add(chip(4, panel::FLOOR))
        .add(
            Rectangle::new()
                .set("x", unit(x + 10.0))
                .set("y", unit(y + 4.0 * ROW + 2.5))
                .set("width", 10)
                .set("height", 10)
                .set("fill", "none")
                .set("stroke", panel::PATCH)
                .set("stroke-width", 1),
        );
    let meanings = [
        "facet that changed, in the colour of the change",
        "facet without change",
        "wall, seen from above",
        "edge of the doorway (bright: whose view it is)",
        "measured patch of floor",
    ];
    for (row, text) in meanings.into_iter().enumerate() {
        group = group.add(line(x + 38.0, y + row as f64 * ROW + 11.2, TEXT, Anchor::Start, text));
    }
    group
}
