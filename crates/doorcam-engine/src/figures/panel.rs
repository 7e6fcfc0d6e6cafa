//! One bird's-eye panel: the hidden room, the wall with its opening, and the strip of floor that the camera sees.

use svg::node::element::{Circle, Group, Path, Rectangle};

use super::axes::axes;
use super::colour::{Exposure, hex};
use super::frame::Frame;
use super::text::{Anchor, line, unit};
use doorcam_core::geometry::{Doorway, Facet, Side};
use doorcam_core::scene::Rgb;
use doorcam_core::transport::PatchGrid;

/// Background of the hidden room, nearly black as in the paper.
pub(super) const ROOM: &str = "#08080c";
/// Floor of the visible side.
pub(super) const FLOOR: &str = "#26262c";
pub(super) const WALL: &str = "#8c8c92";
pub(super) const EDGE: &str = "#ffd21f";
pub(super) const PATCH: &str = "#f4f4f4";
/// The same for the edge whose view a panel does not show.
const OTHER_EDGE: &str = "#6b5c2a";
const OTHER_PATCH: &str = "#6e6e74";
/// Facets without change: just visible, to show the grid.
pub(super) const UNLIT: &str = "#44444e";
/// Light outline of lit facets (paper, figure 9), so that dark colours show as well.
pub(super) const OUTLINE: &str = "#dcdcdc";
pub(super) const OUTLINE_WIDTH: f64 = 0.7;

/// Minimum drawn thickness of a wall, in page units.
const THIN_WALL: f64 = 2.0;

/// What all panels of a figure share.
pub(super) struct Plan<'a> {
    pub(super) doorway: &'a Doorway,
    pub(super) patch: &'a PatchGrid,
    pub(super) facets: &'a [Facet],
    /// Drawn thickness of each facet, in page units.
    pub(super) thickness: Vec<f64>,
    /// Reference to the clip path of a panel at the origin.
    pub(super) clip: String,
    /// Reference to the shared wall, floor and grid.
    pub(super) backdrop: String,
}

/// Drawn thickness of each facet, in page units: about half the distance to its nearest neighbour, so that rings stay
/// apart.
pub(super) fn thicknesses(facets: &[Facet], scale: f64) -> Vec<f64> {
    let middles: Vec<_> = facets.iter().map(Facet::midpoint).collect();
    let nearest = |n: usize| {
        let [x, y] = middles[n];
        let others = middles.iter().enumerate().filter(|(m, _)| *m != n);
        others.map(|(_, p)| (p[0] - x).powi(2) + (p[1] - y).powi(2)).fold(f64::INFINITY, f64::min).sqrt()
    };
    (0..facets.len()).map(|n| (0.55 * nearest(n) * scale).clamp(2.0, 7.0)).collect()
}

/// The parts of a panel that do not depend on the scene.
pub(super) fn backdrop(frame: &Frame, doorway: &Doorway, facets: &[Facet]) -> Group {
    let rectangle = |x: [f64; 2], top: f64, height: f64, fill: &str| {
        let [left, right] = x.map(|x| frame.place([x, 0.0])[0]);
        Rectangle::new()
            .set("x", unit(left))
            .set("y", unit(top))
            .set("width", unit((right - left).max(0.0)))
            .set("height", unit(height.max(0.0)))
            .set("fill", fill)
    };
    let [_, hidden_face] = frame.place([0.0, 0.0]);
    let thickness = (doorway.wall_thickness_m * frame.scale).max(THIN_WALL);
    let visible_face = hidden_face + thickness;
    let half = doorway.half_width();
    let grid = facets.iter().filter_map(|f| segment(frame, f)).fold(String::new(), |mut d, [[x1, y1], [x2, y2]]| {
        d += &format!("M{} {}L{} {}", unit(x1), unit(y1), unit(x2), unit(y2));
        d
    });
    Group::new()
        .add(rectangle(frame.x, frame.top, frame.height(), ROOM))
        .add(rectangle(frame.x, visible_face, frame.bottom() - visible_face, FLOOR))
        .add(rectangle([frame.x[0], -half], hidden_face, thickness, WALL))
        .add(rectangle([half, frame.x[1]], hidden_face, thickness, WALL))
        .add(Path::new().set("d", grid).set("stroke", UNLIT).set("stroke-width", 0.7).set("fill", "none"))
}

/// Draws one view (one change per facet, in order) with its axes. `looking`: the edges whose view it is.
pub(super) fn panel(plan: &Plan, frame: &Frame, exposure: &Exposure, view: &[Rgb], looking: &[Side]) -> Group {
    let local = frame.at(0.0, 0.0);
    let mut content = Group::new()
        .set("clip-path", plan.clip.as_str())
        .add(svg::node::element::Use::new().set("href", plan.backdrop.as_str()));
    let mut lit = Group::new().set("class", "lit").set("stroke", OUTLINE).set("stroke-width", OUTLINE_WIDTH);
    let mut changed = false;
    for ((facet, &rgb), &thickness) in plan.facets.iter().zip(view).zip(&plan.thickness) {
        let (Some(colour), Some(ends)) = (exposure.colour(rgb), segment(&local, facet)) else { continue };
        changed = true;
        lit = lit.add(Path::new().set("d", bar(ends, thickness)).set("fill", hex(colour)));
    }
    content = content.add(lit);
    for side in Side::BOTH {
        let colours = if looking.contains(&side) { [PATCH, EDGE] } else { [OTHER_PATCH, OTHER_EDGE] };
        content = content.add(patch_and_edge(&local, plan, side, colours));
    }
    let mut group = Group::new()
        .add(content.set("transform", format!("translate({} {})", unit(frame.left), unit(frame.top))))
        .add(axes(frame));
    if !changed {
        let [x, y] = frame.place([(frame.x[0] + frame.x[1]) / 2.0, frame.y[1] / 2.0]);
        group = group.add(line(x, y, 13.0, Anchor::Middle, "no change").set("fill", "#c8c8c8"));
    }
    group
}

fn patch_and_edge(frame: &Frame, plan: &Plan, side: Side, [outline, dot]: [&str; 2]) -> Group {
    let fov = plan.patch.fov_m;
    let edge = plan.doorway.edge(side);
    let [edge_x, edge_y] = frame.place(edge);
    let [left, top] = frame.place([edge[0] - fov / 2.0, -plan.doorway.wall_thickness_m]);
    let square = Rectangle::new()
        .set("x", unit(left))
        .set("y", unit(top))
        .set("width", unit(fov * frame.scale))
        .set("height", unit(fov * frame.scale))
        .set("fill", "none")
        .set("stroke", outline)
        .set("stroke-width", 1);
    let dot = Circle::new().set("cx", unit(edge_x)).set("cy", unit(edge_y)).set("r", 2.8).set("fill", dot);
    Group::new().add(square).add(dot)
}

/// The ends of a facet on the page; none if an SVG cannot hold them.
fn segment(frame: &Frame, facet: &Facet) -> Option<[[f64; 2]; 2]> {
    let ends = [facet.from, facet.to].map(|end| frame.place(end));
    ends.iter().flatten().all(|v| v.abs() < 1e6).then_some(ends)
}

/// Outline of a thick stroke between two points.
fn bar([[x1, y1], [x2, y2]]: [[f64; 2]; 2], thickness: f64) -> String {
    let length = (x2 - x1).hypot(y2 - y1).max(f64::MIN_POSITIVE);
    let [nx, ny] = [-(y2 - y1), x2 - x1].map(|v| v / length * thickness / 2.0);
    let corners = [[x1 + nx, y1 + ny], [x2 + nx, y2 + ny], [x2 - nx, y2 - ny], [x1 - nx, y1 - ny]];
    let mut d = String::new();
    for (k, [x, y]) in corners.into_iter().enumerate() {
        d += &format!("{}{} {}", if k == 0 { 'M' } else { 'L' }, unit(x), unit(y));
    }
    d + "Z"
}
