//! Curves on logarithmic axes: how an error depends on a choice.

use svg::Document;
use svg::node::element::{Circle, Group, Path, Rectangle, Title};

use super::text::{Anchor, FONT, line, unit, wrap};
use doorcam_core::geometry::Point;

/// What the figure shows.
#[derive(Debug, Clone, Copy)]
pub struct CurvesPicture<'a> {
    /// Label below the horizontal axes.
    pub x_label: &'a str,
    /// Label beside the vertical axes.
    pub y_label: &'a str,
    /// The panels from left to right.
    pub panels: &'a [CurvesPanel],
    /// Text below, wrapped to the width.
    pub caption: &'a str,
}

/// One plot; all panels of a picture share the axes.
#[derive(Debug, Clone, PartialEq)]
pub struct CurvesPanel {
    /// Title above the panel.
    pub title: String,
    /// Curves in the order of the key.
    pub curves: Vec<Curve>,
}

/// One curve.
#[derive(Debug, Clone, PartialEq)]
pub struct Curve {
    /// Name in the key.
    pub name: String,
    /// Points (x, y) in order of x. The curve is broken where one is not finite or not above 0.
    pub points: Vec<Point>,
}

const PLOT: [f64; 2] = [330.0, 270.0];
const LEFT: f64 = 66.0;
const BELOW: f64 = 40.0;
const GAP: f64 = 14.0;
const TITLE: f64 = 22.0;
const TITLE_TEXT: f64 = 12.5;
const TEXT: f64 = 10.0;
const LABEL_TEXT: f64 = 11.0;
const CAPTION_TEXT: f64 = 12.0;
const CAPTION_LINE: f64 = 17.0;
const KEY: f64 = 190.0;
const GRID: &str = "#e4e4e8";
/// The palette of tracks in another order: colours that people with red-green blindness can tell apart (Okabe and Ito).
const PALETTE: [&str; 5] = ["#cc79a7", "#e69f00", "#009e73", "#0072b2", "#56b4e9"];

/// Draws the curves of all panels on the same axes, as an SVG document.
pub fn curves_svg(picture: &CurvesPicture) -> String {
    let points = || picture.panels.iter().flat_map(|panel| &panel.curves).flat_map(|curve| &curve.points);
    let drawn = || points().filter(|point| shown(**point));
    let axes = [0, 1].map(|k| Axis::over(drawn().map(|point| point[k]), PLOT[k], k == 1));
    let mut page = Group::new();
    let top = GAP + TITLE;
    for (k, panel) in picture.panels.iter().enumerate() {
        let left = LEFT + k as f64 * (LEFT + PLOT[0]);
        page = page.add(plot(picture, panel, &axes, [left, top]).set("id", format!("doorcam-curves-{k}")));
    }
    let key_left = picture.panels.len() as f64 * (LEFT + PLOT[0]) + GAP;
    for (k, curve) in picture.panels.iter().take(1).flat_map(|panel| &panel.curves).enumerate() {
        let y = top + 10.0 + 20.0 * k as f64;
        let colour = PALETTE[k % PALETTE.len()];
        let stroke = Path::new().set("d", format!("M{} {}h24", unit(key_left), unit(y)));
        page = page.add(stroke.set("stroke", colour).set("stroke-width", 1.8)).add(line(
            key_left + 32.0,
            y + 3.6,
            TEXT,
            Anchor::Start,
            &curve.name,
        ));
    }
    let width = key_left + KEY;
    let mut bottom = top + PLOT[1] + BELOW + GAP / 2.0;
    for text in wrap(picture.caption, width - LEFT - GAP, CAPTION_TEXT) {
        bottom += CAPTION_LINE;
        page = page.add(line(LEFT, bottom, CAPTION_TEXT, Anchor::Start, &text));
    }
    let size = [width, bottom + GAP].map(unit);
    Document::new()
        .set("width", size[0])
        .set("height", size[1])
        .set("viewBox", (0, 0, size[0], size[1]))
        .set("font-family", FONT)
        .add(Title::new(format!("{} against {}", picture.y_label, picture.x_label)))
        .add(Rectangle::new().set("width", "100%").set("height", "100%").set("fill", "#fff"))
        .add(page)
        .to_string()
}

/// Whether a logarithmic axis can show a point.
fn shown(point: Point) -> bool {
    point.iter().all(|v| (1e-12..=1e12).contains(v))
}

/// A logarithmic axis.
struct Axis {
    /// Logarithms of the ends.
    ends: [f64; 2],
    length: f64,
    /// Whether it points up the page.
    upright: bool,
}

impl Axis {
    /// An axis slightly longer than the range of the values; from 0.1 to 10 if there are none.
    fn over(values: impl Iterator<Item = f64>, length: f64, upright: bool) -> Self {
        let (low, high) =
            values.map(f64::ln).fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
        let (low, high) = if low <= high { (low, high) } else { (0.1_f64.ln(), 10.0_f64.ln()) };
        let margin = (0.05 * (high - low)).max(0.1);
        Self { ends: [low - margin, high + margin], length, upright }
    }

    /// Position in page units from the axis's left or top end.
    fn place(&self, value: f64) -> f64 {
        let share = (value.ln() - self.ends[0]) / (self.ends[1] - self.ends[0]);
        self.length * if self.upright { 1.0 - share } else { share }
    }

    /// 1, 2 and 5 times powers of ten, or powers alone if those would be crowded.
    fn ticks(&self) -> Vec<f64> {
        let decades = self.ends.map(|end| end / std::f64::consts::LN_10);
        let decade = self.length / (decades[1] - decades[0]);
        let multiples: &[f64] = if decade > 110.0 { &[1.0, 2.0, 5.0] } else { &[1.0] };
        let powers = decades[0].floor() as i32..=decades[1].ceil() as i32;
        let ticks = powers.flat_map(|power| multiples.iter().map(move |m| m * 10f64.powi(power)));
        ticks.filter(|tick| (self.ends[0]..=self.ends[1]).contains(&tick.ln())).collect()
    }
}

fn plot(picture: &CurvesPicture, panel: &CurvesPanel, [x, y]: &[Axis; 2], [left, top]: Point) -> Group {
    let mut group = Group::new().add(line(left, top - 8.0, TITLE_TEXT, Anchor::Start, &panel.title));
    let bottom = top + PLOT[1];
    let mut grid = String::new();
    let mut labels = Group::new();
    for tick in x.ticks() {
        let at = left + x.place(tick);
        grid += &format!("M{} {}v{}", unit(at), unit(top), PLOT[1]);
        labels = labels.add(line(at, bottom + 14.0, TEXT, Anchor::Middle, &number(tick)));
    }
    for tick in y.ticks() {
        let at = top + y.place(tick);
        grid += &format!("M{} {}h{}", unit(left), unit(at), PLOT[0]);
        labels = labels.add(line(left - 6.0, at + 3.6, TEXT, Anchor::End, &number(tick)));
    }
    let upright = left - LEFT + 14.0;
    let middle = top + PLOT[1] / 2.0;
    group = group
        .add(Path::new().set("d", grid).set("stroke", GRID).set("stroke-width", 0.7).set("fill", "none"))
        .add(labels)
        .add(line(left + PLOT[0] / 2.0, bottom + 31.0, LABEL_TEXT, Anchor::Middle, picture.x_label))
        .add(
            line(upright, middle, LABEL_TEXT, Anchor::Middle, picture.y_label)
                .set("transform", format!("rotate(-90 {} {})", unit(upright), unit(middle))),
        );
    for (k, curve) in panel.curves.iter().enumerate() {
        let colour = PALETTE[k % PALETTE.len()];
        let (mut d, mut broken, mut dots) = (String::new(), true, Group::new().set("fill", colour));
        for &point in &curve.points {
            if !shown(point) {
                broken = true;
                continue;
            }
            let [at_x, at_y] = [unit(left + x.place(point[0])), unit(top + y.place(point[1]))];
            d += &format!("{}{at_x} {at_y}", if broken { 'M' } else { 'L' });
            broken = false;
            dots = dots.add(Circle::new().set("cx", at_x).set("cy", at_y).set("r", 2.4));
        }
        let path = Path::new().set("class", "curve").set("d", d).set("stroke", colour).set("fill", "none");
        group = group.add(path.set("stroke-width", 1.6).set("stroke-linejoin", "round")).add(dots);
    }
    let border = Rectangle::new().set("x", unit(left)).set("y", unit(top)).set("fill", "none").set("stroke", "#000");
    group.add(border.set("width", PLOT[0]).set("height", PLOT[1]).set("stroke-width", 0.8))
}

/// A tick label: 0.002, 5, 200, 1e−5.
fn number(value: f64) -> String {
    if (1e-4..1e5).contains(&(value * (1.0 + 1e-9))) {
        let decimals = (-value.log10().floor() - 1e-9).max(0.0).ceil() as usize;
        return format!("{value:.decimals$}");
    }
    format!("{value:.0e}").replace('-', "−")
}
