//! The whole figure: six panels, the magnified difference, the key and the caption.

use svg::Document;
use svg::node::element::{ClipPath, Definitions, Group, Rectangle, Text, Title};

use super::axes::{self, axes};
use super::colour::{Exposure, encode};
use super::frame::{Frame, length_or};
use super::panel::{Plan, backdrop, panel, thicknesses};
use super::text::{Anchor, FONT, line, line_with_symbol, significant, unit, wrap};
use super::{difference, legend};
use crate::Model;
use doorcam_core::geometry::{Doorway, FacetGrid, Side};
use doorcam_core::light::PatchPair;
use doorcam_core::scene::{Scene, Sign};
use doorcam_core::transport::PatchGrid;

/// What a figure shows.
#[derive(Debug, Clone, Copy)]
pub struct ReconstructionPicture<'a> {
    /// The doorway, in metres.
    pub doorway: &'a Doorway,
    /// The facets of the map and their room, in metres.
    pub grid: &'a FacetGrid,
    /// Size of the two floor patches, in metres.
    pub patch: &'a PatchGrid,
    /// The change of each facet per view, in linear light.
    pub scene: &'a Scene,
    /// The difference that the scene explains, in linear light; left out of the figure if none.
    pub difference: Option<&'a PatchPair>,
    /// Text below the figure, wrapped to its width.
    pub caption: &'a str,
}

impl<'a> ReconstructionPicture<'a> {
    /// The picture of a scene that `model` found.
    pub fn of(
        model: &'a Model,
        scene: &'a Scene,
        difference: Option<&'a PatchPair>,
        caption: &'a str,
    ) -> ReconstructionPicture<'a> {
        let Model { doorway, grid, patch, .. } = model;
        Self { doorway, grid, patch, scene, difference, caption }
    }
}

/// Maximum width and height of a bird's-eye panel, in page units.
const PANEL: [f64; 2] = [270.0, 330.0];
/// Side of a magnified patch, in page units.
const PATCH: f64 = 180.0;
/// Minimum width of a column, for titles and the key.
const NARROW: f64 = 220.0;
/// Minimum height of a row, for the brightness scale and its label.
const SHALLOW: f64 = 120.0;
const TITLE: f64 = 24.0;
const TITLE_TEXT: f64 = 12.5;
const GAP: f64 = 12.0;
const CAPTION_TEXT: f64 = 12.0;
const CAPTION_LINE: f64 = 17.0;
/// Ids of shared shapes, with a prefix because a page may embed the SVG.
const CLIP: &str = "doorcam-figure-clip";
const BACKDROP: &str = "doorcam-figure-backdrop";

/// Draws the reconstruction as a figure for print, an SVG document.
///
/// Rows: what became brighter; what became darker, drawn as the light that is missing. Columns: left view, right view,
/// unified map, all to scale in metres. Each row has one brightness scale. Below: the colour-magnified difference of
/// the two patches, y / max|y| / 2 + 0.5, with the row at the wall on top.
pub fn reconstruction_svg(picture: &ReconstructionPicture) -> String {
    // Replaces lengths that are not numbers, or absurd, so that everything below can rely on them.
    let doorway = Doorway {
        width_m: length_or(picture.doorway.width_m, 0.0),
        wall_thickness_m: length_or(picture.doorway.wall_thickness_m, 0.0),
        height_m: None,
        leaf: None,
    };
    let patch = PatchGrid { fov_m: length_or(picture.patch.fov_m, 0.0), ..*picture.patch };
    let picture = &ReconstructionPicture { doorway: &doorway, patch: &patch, ..*picture };
    let bird = birds_eye(picture);
    let cell = [axes::LEFT + bird.width().max(NARROW) + GAP, TITLE + bird.height().max(SHALLOW) + axes::BELOW];
    let width = GAP + 3.0 * cell[0] + legend::SCALE_WIDTH + GAP;
    let origin = bird.at(0.0, 0.0);
    let plan = Plan {
        doorway: picture.doorway,
        patch: picture.patch,
        facets: &picture.grid.facets,
        thickness: thicknesses(&picture.grid.facets, bird.scale),
        clip: format!("url(#{CLIP})"),
        backdrop: format!("#{BACKDROP}"),
    };
    let area = Rectangle::new().set("width", unit(origin.width())).set("height", unit(origin.height()));
    let shared = Definitions::new()
        .add(ClipPath::new().set("id", CLIP).add(area))
        .add(backdrop(&origin, picture.doorway, &picture.grid.facets).set("id", BACKDROP));

    let mut page = Group::new();
    let mut top = GAP;
    for sign in [Sign::Brighter, Sign::Darker] {
        page = page.add(panels(picture, &plan, &bird.at(0.0, top + TITLE), sign, cell[0]));
        top += cell[1] + GAP;
    }
    let column = |k: usize| GAP + k as f64 * cell[0] + axes::LEFT;
    let mut last = top + TITLE + legend::KEY_HEIGHT;
    if let Some(pair) = picture.difference {
        page = page.add(patches(picture, pair, [column(0), column(1)], top));
        last = last.max(top + TITLE + PATCH + axes::BELOW);
    }
    let key = if picture.difference.is_some() { column(2) } else { column(0) };
    page = page.add(legend::key(key, top + TITLE));
    let mut bottom = last + GAP;
    for text in wrap(picture.caption, width - 2.0 * GAP - axes::LEFT, CAPTION_TEXT) {
        bottom += CAPTION_LINE;
        page = page.add(line(column(0), bottom, CAPTION_TEXT, Anchor::Start, &text));
    }
    let height = bottom + GAP;
    let size = [width, height].map(unit);
    Document::new()
        .set("width", size[0])
        .set("height", size[1])
        .set("viewBox", (0, 0, size[0], size[1]))
        .set("font-family", FONT)
        .add(Title::new("What changed behind the doorway"))
        .add(shared)
        .add(Rectangle::new().set("width", "100%").set("height", "100%").set("fill", "#fff"))
        .add(page)
        .to_string()
}

/// The part of the floor plan that each panel shows: the room, and beyond the wall the patches with some floor around.
fn birds_eye(picture: &ReconstructionPicture) -> Frame {
    let room = &picture.grid.room;
    let [half, depth] = [room.half_width_m, room.depth_m].map(|v| length_or(v, 1.0));
    let fov = picture.patch.fov_m;
    let floor = picture.doorway.wall_thickness_m + fov + (0.3 * fov).max(0.03 * depth);
    let scale = (PANEL[0] / (2.0 * half)).min(PANEL[1] / (depth + floor));
    Frame { left: 0.0, top: 0.0, scale, x: [-half, half], y: [-floor, depth] }
}

/// One row of panels for one sign: left view, right view and unified map, with their brightness scale.
fn panels(picture: &ReconstructionPicture, plan: &Plan, at: &Frame, sign: Sign, cell: f64) -> Group {
    let exposure = Exposure::new(picture.scene, sign);
    let (titles, word, id, direction) = match sign {
        Sign::Brighter => (["(a) left view ", "(b) right view ", "(c) unified "], ", brighter", "brighter", "increase"),
        Sign::Darker => (["(d) left view ", "(e) right view ", "(f) unified "], ", darker", "darker", "decrease"),
    };
    let views = [
        ("left", "L", &picture.scene.left, &Side::BOTH[..1]),
        ("right", "R", &picture.scene.right, &Side::BOTH[1..]),
        ("unified", "u", &picture.scene.unified, &Side::BOTH[..]),
    ];
    let mut group = Group::new();
    for (k, (title, (name, subscript, view, looking))) in titles.into_iter().zip(views).enumerate() {
        let frame = at.at(GAP + k as f64 * cell + axes::LEFT, at.top);
        group = group.add(
            Group::new()
                .set("id", format!("doorcam-{name}-{id}"))
                .add(heading(&frame, [title, "v", subscript, word]))
                .add(panel(plan, &frame, &exposure, view, looking)),
        );
    }
    if exposure.white > 0.0 {
        let place = [GAP + 3.0 * cell, at.top, at.height().max(SHALLOW)];
        let label = format!("{direction}, linear light");
        group = group.add(legend::scale(place, encode, [0.0, exposure.white], &label));
    }
    group
}

/// The two magnified differences, with axes in metres of floor and a common scale.
fn patches(picture: &ReconstructionPicture, pair: &PatchPair, columns: [f64; 2], top: f64) -> Group {
    let fov = length_or(picture.patch.fov_m, 1.0);
    let wall = picture.doorway.wall_thickness_m;
    let largest = difference::largest(pair);
    let top = top + TITLE;
    let titles = [["(g) difference, left patch ", "y", "L", ""], ["(h) difference, right patch ", "y", "R", ""]];
    let mut group = Group::new().set("id", "doorcam-difference");
    for ((side, title), left) in Side::BOTH.into_iter().zip(titles).zip(columns) {
        let [middle, _] = picture.doorway.edge(side);
        let x = [middle - fov / 2.0, middle + fov / 2.0];
        let frame = Frame { left, top, scale: PATCH / fov, x, y: [-wall - fov, -wall] };
        let patch = pair.side(side);
        // Enlarged within the PNG, since some viewers smooth images despite the rendering hint.
        let enlarge = 256_usize.div_ceil(patch.size().max(1));
        let rgb = difference::magnified(patch, largest, enlarge);
        let place = [frame.left, frame.top, frame.width(), frame.height()];
        group = group.add(heading(&frame, title));
        if let Some(image) = legend::embed(&rgb, [enlarge * patch.size(); 2], place) {
            group = group.add(image);
        }
        group = group.add(axes(&frame));
    }
    let place = [columns[1] + PATCH + GAP, top, PATCH];
    if largest > 0.0 {
        let label = format!("magnified: ±{}, linear light", significant(largest));
        let level = |fraction| difference::magnify(2.0 * fraction - 1.0, 1.0);
        group.add(legend::scale(place, level, [-largest, largest], &label))
    } else {
        group.add(line(place[0], top + PATCH / 2.0, TITLE_TEXT, Anchor::Start, "no change"))
    }
}

fn heading(frame: &Frame, words: [&'static str; 4]) -> Text {
    line_with_symbol([frame.left, frame.top - 8.0, TITLE_TEXT], words)
}
