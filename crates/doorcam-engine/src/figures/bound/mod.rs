//! How well a target can be located with several ways to measure: regions of uncertainty above, sample measurements
//! below (paper: figure 5).

mod region;
mod samples;

use svg::Document;
use svg::node::element::{Circle, Group, Path, Rectangle, Title};

use super::axes::{self, axes};
use super::frame::{Frame, length_or};
use super::text::{Anchor, FONT, line, unit, wrap};
use doorcam_core::geometry::{Biangular, Doorway, Point, Side};

/// What the figure shows. Positions in metres in the door frame, angles in radians.
#[derive(Debug, Clone, Copy)]
pub struct BoundPicture<'a> {
    /// The doorway.
    pub doorway: &'a Doorway,
    /// Side of a patch, in metres.
    pub patch_m: f64,
    /// The panels from left to right.
    pub panels: &'a [BoundPanel],
    /// The target of the sample measurements, marked in every panel.
    pub target: Option<Point>,
    /// Text below, wrapped to the width.
    pub caption: &'a str,
}

/// One way to measure.
#[derive(Debug, Clone, PartialEq)]
pub struct BoundPanel {
    /// Title above the panel.
    pub title: String,
    /// The sides whose patches are measured.
    pub sides: Vec<Side>,
    /// Whether there is a wall whose edges block the light.
    pub walled: bool,
    /// Where the target could be.
    pub regions: Vec<Region>,
    /// One measurement per patch: square, row by row from the wall; empty to leave them out.
    pub samples: Vec<Vec<f64>>,
}

/// A cell of biangular coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Region {
    /// Its centre.
    pub angles: Biangular,
    /// Its widths in α1 and α2, in radians; infinite if anything is possible.
    pub widths: [f64; 2],
}

/// Maximum width and height of a panel, in page units.
const PANEL: [f64; 2] = [230.0, 300.0];
const GAP: f64 = 14.0;
const TITLE: f64 = 22.0;
const TITLE_TEXT: f64 = 12.5;
const CAPTION_TEXT: f64 = 12.0;
const CAPTION_LINE: f64 = 17.0;
const RAY: &str = "#e4e4ea";
const WALL: &str = "#8c8c92";
const PATCH: &str = "#6e6e74";
const TARGET: &str = "#e01b1b";
/// Minimum drawn thickness of a wall, in page units.
const THIN_WALL: f64 = 2.5;

/// Draws the regions of each way to measure on the floor plan, to scale, and below each the target's sample
/// measurement, as an SVG document.
///
/// All samples share one brightness scale, from the smallest to the largest value of any.
pub fn bound_svg(picture: &BoundPicture) -> String {
    let doorway = &Doorway {
        width_m: length_or(picture.doorway.width_m, 1.0),
        wall_thickness_m: length_or(picture.doorway.wall_thickness_m, 0.0),
        height_m: None,
        leaf: None,
    };
    let frame = extent(picture, doorway);
    let cell = frame.width() + axes::LEFT + GAP;
    let scale = samples::Scale::of(picture.panels);
    let mut page = Group::new();
    let below = frame.bottom() + axes::BELOW + GAP;
    let mut bottom = frame.bottom() + axes::BELOW;
    for (k, shown) in picture.panels.iter().enumerate() {
        let frame = frame.at(frame.left + k as f64 * cell, frame.top);
        page = page.add(panel(picture, doorway, shown, &frame, k));
        if let Some(scale) = scale.as_ref().filter(|_| !shown.samples.is_empty()) {
            let (group, end) = samples::samples(shown, [frame.left, below, frame.width()], scale);
            page = page.add(group);
            bottom = bottom.max(end);
        }
    }
    bottom += GAP / 2.0;
    let width = picture.panels.len().max(2) as f64 * cell + GAP;
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
        .add(Title::new("How well a target behind a doorway can be located"))
        .add(Rectangle::new().set("width", "100%").set("height", "100%").set("fill", "#fff"))
        .add(page)
        .to_string()
}

/// The part of the floor plan that is shown: the centres of all regions with a margin, and the patches.
fn extent(picture: &BoundPicture, doorway: &Doorway) -> Frame {
    let width = doorway.width_m;
    let (mut half, mut depth) = (0.75 * width, width);
    let middles = picture.panels.iter().flat_map(|p| &p.regions).map(|region| region.angles.to_point(doorway));
    for [x, y] in middles.chain(picture.target) {
        half = half.max(length_or(x.abs(), half));
        depth = depth.max(length_or(y, depth));
    }
    let before = doorway.wall_thickness_m + length_or(picture.patch_m, 0.0) + 0.06 * depth;
    let [half, depth] = [half + 0.3 * width, depth + 0.3 * width];
    let scale = (PANEL[0] / (2.0 * half)).min(PANEL[1] / (depth + before));
    Frame { left: axes::LEFT, top: GAP + TITLE, scale, x: [-half, half], y: [-before, depth] }
}

fn panel(picture: &BoundPicture, doorway: &Doorway, shown: &BoundPanel, frame: &Frame, k: usize) -> Group {
    let letter = char::from(b'a' + (k % 26) as u8);
    let title = format!("({letter}) {}", shown.title);
    let mut group = Group::new()
        .set("id", format!("doorcam-bound-{letter}"))
        .add(line(frame.left, frame.top - 8.0, TITLE_TEXT, Anchor::Start, &title))
        .add(rays(frame, doorway))
        .add(floor(picture, doorway, shown, frame));
    let mut regions = Group::new()
        .set("class", "regions")
        .set("fill", "#0072b2")
        .set("fill-opacity", 0.35)
        .set("stroke", "#0072b2")
        .set("stroke-width", 1.2)
        .set("stroke-linejoin", "round");
    for shape in shown.regions.iter().filter_map(|r| region::outline(r, doorway, frame)) {
        regions = regions.add(Path::new().set("d", shape));
    }
    group = group.add(regions);
    if let Some([x, y]) = picture.target.map(|target| frame.place(target)) {
        let dot = Circle::new().set("cx", unit(x)).set("cy", unit(y)).set("r", 3.6).set("fill", TARGET);
        group = group.add(dot.set("stroke", "#fff").set("stroke-width", 1));
    }
    group.add(axes(frame))
}

/// Faint lines of equal angle, 15° apart.
fn rays(frame: &Frame, doorway: &Doorway) -> Path {
    let mut d = String::new();
    for step in 1..12 {
        let (sine, cosine) = (f64::from(15 * step)).to_radians().sin_cos();
        for (side, along) in [(Side::Left, cosine), (Side::Right, -cosine)] {
            let edge = doorway.edge(side);
            // Up to the border of the panel.
            let beside = if along > 0.0 { frame.x[1] - edge[0] } else { frame.x[0] - edge[0] };
            let length = (beside / along).min(frame.y[1] / sine);
            let ([x1, y1], [x2, y2]) = (frame.place(edge), frame.place([edge[0] + length * along, length * sine]));
            d += &format!("M{} {}L{} {}", unit(x1), unit(y1), unit(x2), unit(y2));
        }
    }
    Path::new().set("d", d).set("stroke", RAY).set("stroke-width", 0.7).set("fill", "none")
}

/// The wall if there is one, the edges where angles are measured, and the patches.
fn floor(picture: &BoundPicture, doorway: &Doorway, shown: &BoundPanel, frame: &Frame) -> Group {
    let mut group = Group::new();
    let half = doorway.half_width();
    let [_, hidden_face] = frame.place([0.0, 0.0]);
    let walls = [([frame.x[0], -half], Side::Left), ([half, frame.x[1]], Side::Right)];
    for ([from, to], side) in walls {
        if !shown.walled || !shown.sides.contains(&side) {
            continue;
        }
        let [left, right] = [from, to].map(|x| frame.place([x, 0.0])[0]);
        let thickness = (doorway.wall_thickness_m * frame.scale).max(THIN_WALL);
        let wall = Rectangle::new().set("x", unit(left)).set("y", unit(hidden_face)).set("fill", WALL);
        group = group.add(wall.set("width", unit((right - left).max(0.0))).set("height", unit(thickness)));
    }
    let fov = length_or(picture.patch_m, 0.0);
    for side in Side::BOTH {
        let edge = doorway.edge(side);
        let [x, y] = frame.place(edge);
        group = group.add(Circle::new().set("cx", unit(x)).set("cy", unit(y)).set("r", 2.6).set("fill", "#000"));
        if shown.sides.contains(&side) {
            let [left, top] = frame.place([edge[0] - fov / 2.0, -doorway.wall_thickness_m]);
            let side = unit(fov * frame.scale);
            let square = Rectangle::new().set("x", unit(left)).set("y", unit(top)).set("width", side);
            group = group.add(square.set("height", side).set("fill", "none").set("stroke", PATCH));
        }
    }
    group
}
