//! Reads the figure back as a reader would: positions from its axes, colours from its pixels.

mod bound;
mod curves;
mod evaluation;
mod shown;

use resvg::usvg::roxmltree::{Document, Node};

use self::shown::{Axis, Shown, by_id};
use super::*;
use doorcam_core::geometry::{Doorway, FacetGrid, GridSpec, Point, Room, Side};
use doorcam_core::light::PatchPair;
use doorcam_core::scene::{Intensity, Scene};
use doorcam_core::transport::{PatchGrid, PixelLayout};

const PANELS: [[&str; 3]; 2] = [
    ["doorcam-left-brighter", "doorcam-right-brighter", "doorcam-unified-brighter"],
    ["doorcam-left-darker", "doorcam-right-darker", "doorcam-unified-darker"],
];

/// A doorway, grid and patches.
struct Setting {
    doorway: Doorway,
    grid: FacetGrid,
    patch: PatchGrid,
}

impl Setting {
    fn published() -> Self {
        Self::new(0.508, 0.0, 1.5, 3.0, 0.15)
    }

    fn wide() -> Self {
        Self::new(0.85, 0.12, 2.0, 4.0, 0.3)
    }

    fn new(width_m: f64, wall_thickness_m: f64, half_width_m: f64, depth_m: f64, fov_m: f64) -> Self {
        let doorway = Doorway { width_m, wall_thickness_m, height_m: None, leaf: None };
        let spec = GridSpec { room: Room { half_width_m, depth_m }, ..GridSpec::published() };
        let grid = FacetGrid::new(&doorway, &spec).expect("grid");
        Self { doorway, grid, patch: PatchGrid { size: 64, fov_m, layout: PixelLayout::Cells } }
    }

    /// The facet whose middle is nearest to a point, and that middle.
    fn facet_near(&self, [x, y]: Point) -> (usize, Point) {
        let middles = self.grid.facets.iter().map(|f| f.midpoint()).enumerate();
        let distance = |p: Point| (p[0] - x).hypot(p[1] - y);
        middles.min_by(|(_, p), (_, q)| distance(*p).total_cmp(&distance(*q))).expect("a facet")
    }

    fn scene(&self, changes: &[(usize, Intensity)]) -> Scene {
        let mut intensities = vec![Intensity::default(); self.grid.len()];
        changes.iter().for_each(|&(n, i)| intensities[n] = i);
        let radiance = vec![1.0; intensities.len()];
        Scene::new(&intensities, [&radiance, &radiance], 0.0)
    }

    fn svg(&self, scene: &Scene, difference: Option<&PatchPair>, caption: &str) -> String {
        let Self { doorway, grid, patch } = self;
        reconstruction_svg(&ReconstructionPicture { doorway, grid, patch, scene, difference, caption })
    }
}

fn red(left: f64, right: f64) -> Intensity {
    Intensity { left, right, colour: [1.0, 0.0, 0.0] }
}

#[test]
fn a_facet_shows_where_its_axes_put_it_in_the_panels_it_belongs_to() {
    let setting = Setting::published();
    let (near, near_at) = setting.facet_near([-0.5, 1.2]);
    let (far, far_at) = setting.facet_near([0.4, 2.3]);
    let lost = Intensity { left: -0.003, right: -0.003, colour: [0.0, 1.0, 0.0] };
    let shown = Shown::new(setting.svg(&setting.scene(&[(near, red(0.02, 0.01)), (far, lost)]), None, ""));
    let colours = |at| PANELS.map(|row| row.map(|panel| shown.at(panel, 0, at)));
    let dark = |rgb: [u8; 3]| rgb.iter().all(|&v| v < 0x60);

    // The right view sees half as much, and 0.5 of linear light is 188 in sRGB: the views share their scale.
    let [brighter, darker] = colours(near_at);
    assert_eq!(brighter, [[255, 0, 0], [188, 0, 0], [255, 0, 0]]);
    assert!(darker.into_iter().all(dark), "{darker:?}");
    // What became darker has a scale of its own.
    let [brighter, darker] = colours(far_at);
    assert!(brighter.into_iter().all(dark), "{brighter:?}");
    assert_eq!(darker, [[0, 255, 0]; 3]);
}

#[test]
fn what_one_view_alone_sees_is_not_in_the_unified_map() {
    let setting = Setting::published();
    let (n, at) = setting.facet_near([0.6, 1.0]);
    let shown = Shown::new(setting.svg(&setting.scene(&[(n, red(0.0, 0.01))]), None, ""));
    let [left, right, unified] = PANELS[0].map(|panel| shown.at(panel, 0, at));
    assert_eq!(right, [255, 0, 0]);
    assert!(left[0] < 0x60 && unified[0] < 0x60, "{left:?} {unified:?}");
}

#[test]
fn everything_is_to_scale_and_stands_where_the_door_has_it() {
    let setting = Setting::wide();
    let shown = Shown::new(setting.svg(&setting.scene(&[]), Some(&PatchPair::zeros(64)), ""));
    let document = Document::parse(&shown.svg).expect("XML");
    let groups = PANELS.into_iter().flatten().map(|panel| (panel, 0)).chain([0, 1].map(|k| ("doorcam-difference", k)));
    for (group, k) in groups {
        let axis = |class, attribute| {
            let found = by_id(&document, group).descendants().filter(|n| n.attribute("class") == Some(class)).nth(k);
            Axis::read(found.expect("axis"), attribute).per_metre()
        };
        let (x, y) = (axis("x-axis", "x"), axis("y-axis", "y"));
        assert!(x > 0.0 && (x + y).abs() < 1e-3 * x, "{group}: {x} units a metre along x, {y} along y");
    }
    let panel = |at| shown.at("doorcam-unified-brighter", 0, at);
    let wall = [0x8c, 0x8c, 0x92];
    for x in [-1.0, -0.5, 0.5, 1.9] {
        assert_eq!(panel([x, -0.06]), wall, "wall at x = {x}");
    }
    for at in [[0.0, -0.06], [-0.3, -0.06], [1.0, -0.2], [1.0, 0.06]] {
        assert!(panel(at)[0] < 0x40, "no wall at {at:?}");
    }
    // The dots of the edges, and the outline of each patch half-way down its sides.
    for x in [-0.425, 0.425] {
        assert_eq!(panel([x, 0.0]), [0xff, 0xd2, 0x1f]);
        for side in [-0.15, 0.15] {
            assert!(panel([x + side, -0.12 - 0.15])[0] > 0x80, "patch at {x}");
        }
        assert!(panel([x, -0.12 - 0.15])[0] < 0x40);
    }
}

#[test]
fn a_mirrored_scene_gives_mirrored_panels() {
    let setting = Setting::wide();
    let mirror = |n: usize| {
        let [x, y] = setting.grid.facets[n].midpoint();
        setting.facet_near([-x, y]).0
    };
    let changes: Vec<(usize, Intensity)> = (0..setting.grid.len())
        .step_by(5)
        .map(|n| (n, Intensity { left: 1e-3 * n as f64, right: 0.1 - 2e-3 * n as f64, colour: [0.6, 0.0, 0.8] }))
        .collect();
    let mirrored: Vec<(usize, Intensity)> =
        changes.iter().map(|&(n, i)| (mirror(n), Intensity { left: i.right, right: i.left, ..i })).collect();
    let one = Shown::new(setting.svg(&setting.scene(&changes), None, ""));
    let other = Shown::new(setting.svg(&setting.scene(&mirrored), None, ""));
    let (mut probes, mut lit, mut wrong) = (0, 0, 0);
    for [left, right, unified] in PANELS {
        for (a, b) in [(left, right), (right, left), (unified, unified)] {
            for k in 0..400 {
                let at = [-1.95 + 0.195 * f64::from(k % 20) + 0.011, 0.15 + 0.19 * f64::from(k / 20)];
                let (p, q) = (one.at(a, 0, at), other.at(b, 0, [-at[0], at[1]]));
                probes += 1;
                lit += usize::from(p[2] > 0x60);
                wrong += usize::from((0..3).any(|c| p[c].abs_diff(q[c]) > 48));
            }
        }
    }
    assert!(lit > 20, "only {lit} of {probes} places are lit");
    assert!(wrong * 200 < probes, "{wrong} of {probes} places differ");
}

#[test]
fn the_difference_is_magnified_with_one_scale_the_row_at_the_wall_on_top() {
    let setting = Setting::wide();
    let mut pair = PatchPair::zeros(64);
    pair.left.plane_mut(1)[..64].fill(0.012);
    pair.right.plane_mut(0)[63 * 64..].fill(-0.006);
    let shown = Shown::new(setting.svg(&setting.scene(&[]), Some(&pair), ""));
    for (k, side) in Side::BOTH.into_iter().enumerate() {
        for column in [0, 31, 63] {
            let at = |row| shown.at("doorcam-difference", k, setting.patch.point(&setting.doorway, side, row, column));
            let (top, bottom) =
                if side == Side::Left { ([128, 255, 128], [128; 3]) } else { ([128; 3], [64, 128, 128]) };
            assert_eq!((at(0), at(32), at(63)), (top, [128; 3], bottom), "{side:?}, column {column}");
        }
    }
    assert!(shown.svg.contains("±0.012"), "the magnification is stated");
    assert!(!setting.svg(&setting.scene(&[]), None, "").contains("data:image/png"), "nothing lit, no difference");
}

#[test]
fn panels_are_lettered_row_by_row_brighter_above_darker() {
    let setting = Setting::published();
    let svg = setting.svg(&setting.scene(&[]), None, "");
    let document = Document::parse(&svg).expect("XML");
    let titles = PANELS.map(|row| {
        row.map(|panel| {
            let title = by_id(&document, panel).descendants().find(|n| n.has_tag_name("text")).expect("title");
            let words: String = title.descendants().filter(Node::is_text).filter_map(|n| n.text()).collect();
            let place = ["x", "y"].map(|a| title.attribute(a).expect("place").parse::<f64>().expect("number"));
            (words.trim().to_owned(), place)
        })
    });
    assert_eq!(
        titles.each_ref().map(|row| row.each_ref().map(|(words, _)| words.as_str())),
        [
            ["(a) left view vL, brighter", "(b) right view vR, brighter", "(c) unified vu, brighter"],
            ["(d) left view vL, darker", "(e) right view vR, darker", "(f) unified vu, darker"],
        ]
    );
    let [above, below] = titles.map(|row| row.map(|(_, place)| place));
    for k in 0..3 {
        assert!(above[k][1] < below[k][1] && above[k][1] == above[0][1] && above[k][0] == below[k][0]);
        assert!(k == 0 || above[k - 1][0] < above[k][0]);
    }
}

#[test]
fn text_is_drawn() {
    let setting = Setting::published();
    let svg = |caption| setting.svg(&setting.scene(&[]), None, caption);
    let ink = |shown: &Shown, [x, y, width, height]: [u32; 4]| {
        let area = (x..x + width).flat_map(|x| (y..y + height).map(move |y| (x, y)));
        area.filter(|&(x, y)| shown.pixels.get_pixel(x, y).0 == [0, 0, 0]).count()
    };
    let shown = Shown::new(svg(""));
    let document = Document::parse(&shown.svg).expect("XML");
    for panel in PANELS.into_iter().flatten() {
        let title = by_id(&document, panel).descendants().find(|n| n.has_tag_name("text")).expect("title");
        let [x, y] = ["x", "y"].map(|a| title.attribute(a).expect("place").parse::<f64>().expect("number") as u32);
        assert!(ink(&shown, [2 * x, 2 * (y - 10), 300, 20]) > 300, "title of {panel}");
        let said = by_id(&document, panel)
            .descendants()
            .filter(|n| n.has_tag_name("text"))
            .filter(|n| n.text().is_some_and(|t| t.trim() == "no change"));
        assert_eq!(said.count(), 1, "{panel}");
    }
    let captioned = Shown::new(svg("λ = 0.05 <b>&amp; \u{0}\u{1b}\u{ffff}"));
    let (width, height) = captioned.pixels.dimensions();
    assert!(ink(&captioned, [0, height - 60, width, 60]) > 200, "caption");
    assert_eq!(ink(&shown, [0, shown.pixels.height() - 30, width, 30]), 0, "only white without a caption");
}

#[test]
fn the_same_input_gives_the_same_bytes() {
    let setting = Setting::published();
    let scene = setting.scene(&[(7, red(0.1, 0.2)), (120, red(-0.1, -0.1))]);
    let make = || setting.svg(&scene, Some(&PatchPair::zeros(64)), "twice");
    let (one, two) = (make(), make());
    assert_eq!(one, two);
    assert_eq!(png(&one, 400).expect("PNG"), png(&two, 400).expect("PNG"));
}

#[test]
fn nothing_that_is_not_a_number_reaches_the_svg() {
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, f64::MAX, 1e-310] {
        let mut setting = Setting::published();
        let scene = setting.scene(&[(3, red(bad, 1.0)), (4, red(-1.0, bad)), (5, red(0.5, 0.5))]);
        setting.doorway.width_m = bad;
        setting.doorway.wall_thickness_m = bad;
        setting.patch.fov_m = bad;
        setting.grid.facets[5].to[0] = bad;
        setting.grid.room.depth_m = bad;
        let mut pair = PatchPair::zeros(2);
        pair.left.data_mut()[0] = bad as f32;
        let svg = setting.svg(&scene, Some(&pair), "");
        let document = Document::parse(&svg).expect("XML");
        for attribute in document.descendants().flat_map(|n| n.attributes().collect::<Vec<_>>()) {
            let broken = ["NaN", "inf"].iter().any(|word| attribute.value().contains(word));
            assert!(!broken || attribute.name() == "href", "{attribute:?} with {bad}");
        }
        png(&svg, 300).unwrap_or_else(|e| panic!("with {bad}: {e}"));
    }
}

#[test]
fn what_cannot_be_drawn_is_an_error() {
    assert!(matches!(png("<svg", 100), Err(RenderError::Svg(_))));
    let svg = |size: &str| format!(r#"<svg xmlns="http://www.w3.org/2000/svg" {size}/>"#);
    for (size, width) in
        [(r#"width="10" height="10""#, 0), (r#"width="10" height="10""#, 100_000), (r#"width="1" height="1e6""#, 9)]
    {
        let error = png(&svg(size), width).expect_err("refused");
        assert!(matches!(error, RenderError::Size { .. }), "{size} at {width}: {error}");
    }
}
