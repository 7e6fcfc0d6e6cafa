//! Errors over time: one row per true path, all with the same axes.

use svg::node::element::{Group, Path, Rectangle};

use super::axes::{SPACING, ticks};
use super::crossings;
use super::plan::{Shade, WRONG, shade_of};
use super::text::{Anchor, decimal, line, unit};
use crate::evaluation::{CrossingScore, PersonPath, TruePoint};

/// Colour of the reach of the reported ellipse.
pub(super) const REACH: &str = "#dcdce2";
/// Colour of the time in which somebody settles.
pub(super) const SETTLING: &str = "#f6ecd2";
/// Maximum number of rows; further paths are only in the table.
const MOST: usize = 8;
const LEAST_HEIGHT: f64 = 46.0;
const MOST_HEIGHT: f64 = 190.0;
const GAP: f64 = 10.0;
const TEXT: f64 = 10.0;
/// Space below the last row for its ticks and label.
const BELOW: f64 = 34.0;

/// Position and ranges of one row.
struct Row {
    left: f64,
    top: f64,
    size: [f64; 2],
    /// Time range from left to right, in seconds.
    seconds: [f64; 2],
    /// Value at the top, in metres; the bottom is 0.
    metres: f64,
}

impl Row {
    fn x(&self, seconds: f64) -> f64 {
        let [from, to] = self.seconds;
        self.left + self.size[0] * (seconds - from) / (to - from)
    }

    fn y(&self, metres: f64) -> f64 {
        self.top + self.size[1] * (1.0 - (metres / self.metres).clamp(0.0, 1.0))
    }

    fn bottom(&self) -> f64 {
        self.top + self.size[1]
    }
}

/// Draws the rows at a place of the page (left, top, width, height), below a line with the crossings if there are any;
/// returns them and the y at which they end.
pub(super) fn rows(
    people: &[PersonPath],
    crossings: &[CrossingScore],
    shades: &[Shade],
    [left, top, width, height]: [f64; 4],
) -> (Group, f64) {
    let shown = &people[..people.len().min(MOST)];
    let points = || shown.iter().flat_map(|person| &person.points);
    let times = points().map(|p| p.seconds).chain(crossings.iter().map(|c| c.seconds));
    let (first, last) = times.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), t| (a.min(t), b.max(t)));
    if !(first.is_finite() && last.is_finite()) {
        let group = Group::new().add(line(left, top + 20.0, 12.0, Anchor::Start, "nobody there"));
        return (group, top + 30.0);
    }
    // A single frame is a point in the middle of one second.
    let seconds = if last - first > 1e-3 { [first, last] } else { [first - 0.5, first + 0.5] };
    let largest = points().filter_map(|p| p.found).map(|f| f.error_m).fold(0.0, f64::max);
    let metres = (1.15 * largest).clamp(0.2, 0.6);
    let above = if crossings.is_empty() { 0.0 } else { crossings::HEIGHT };
    let count = shown.len().max(1) as f64;
    let each = ((height - above - BELOW) / count - GAP).clamp(LEAST_HEIGHT, MOST_HEIGHT);
    let mut group = Group::new().set("id", "doorcam-errors");
    let mut row = Row { left, top, size: [width, each], seconds, metres };
    if !crossings.is_empty() {
        group = group.add(crossings::marks(crossings, |seconds| row.x(seconds), [left, top, width]));
        row.top += above;
    }
    if people.is_empty() {
        let nobody = line(left, row.top + 20.0, 12.0, Anchor::Start, "nobody there");
        return (group.add(nobody), row.top + 30.0);
    }
    for (k, person) in shown.iter().enumerate() {
        let last = k + 1 == shown.len();
        group = group.add(errors(&row, person, shades)).add(axes(&row, &format!("person {}", person.id), last));
        row.top += each + GAP;
    }
    let mut end = row.top - GAP + BELOW;
    if people.len() > MOST {
        end += 14.0;
        let more = format!("and {} more paths", people.len() - MOST);
        group = group.add(line(left, end, TEXT, Anchor::Start, &more));
    }
    (group, end)
}

fn errors(row: &Row, person: &PersonPath, shades: &[Shade]) -> Group {
    let mut settling = Group::new().set("class", "settling");
    if let Some((from, to)) = span(person.points.iter().filter(|p| p.settling)) {
        let rectangle = Rectangle::new()
            .set("x", unit(row.x(from)))
            .set("y", unit(row.top))
            .set("width", unit((row.x(to) - row.x(from)).max(1.0)))
            .set("height", unit(row.size[1]));
        settling = settling.add(rectangle.set("fill", SETTLING));
    }
    let mut reach = Group::new().set("class", "reach").set("fill", REACH);
    let mut lines = Group::new().set("class", "error").set("fill", "none").set("stroke-width", 1.3);
    // Stretches in which the person is found as one track, without a gap.
    for stretch in person.points.chunk_by(|a, b| name(a).is_some() && name(a) == name(b)) {
        let Some(track) = name(&stretch[0]) else { continue };
        let found = || stretch.iter().filter_map(|p| Some((row.x(p.seconds), p.found?)));
        let mut above = String::new();
        let mut d = String::new();
        for (k, (x, found)) in found().enumerate() {
            let to = if k == 0 { 'M' } else { 'L' };
            d += &format!("{to}{} {}", unit(x), unit(row.y(found.error_m)));
            above += &format!("{to}{} {}", unit(x), unit(row.y(found.reach_m.unwrap_or(0.0))));
        }
        if let [first, .., last] = stretch {
            let base = unit(row.bottom());
            above += &format!("L{} {base}L{} {base}Z", unit(row.x(last.seconds)), unit(row.x(first.seconds)));
            reach = reach.add(Path::new().set("d", above));
        } else {
            // A single point makes no line: draw a short one across it.
            d += "m-3 0h6";
        }
        lines = lines.add(Path::new().set("d", d).set("stroke", shade_of(shades, track)));
    }
    let missed = person.points.iter().filter(|p| p.missed());
    let d = missed.fold(String::new(), |mut d, point| {
        d += &format!("M{} {}v-6", unit(row.x(point.seconds)), unit(row.bottom()));
        d
    });
    let missed = Path::new().set("class", "missed").set("d", d).set("stroke", WRONG).set("stroke-width", 2);
    Group::new().add(settling).add(reach).add(lines).add(missed)
}

/// The track that a point is found as, if it is found.
fn name(point: &TruePoint) -> Option<Option<u64>> {
    point.found.map(|found| found.track)
}

fn span<'a>(mut points: impl Iterator<Item = &'a TruePoint>) -> Option<(f64, f64)> {
    let first = points.next()?.seconds;
    Some((first, points.last().map_or(first, |p| p.seconds)))
}

fn axes(row: &Row, name: &str, last: bool) -> Group {
    let [width, height] = row.size;
    let border = Rectangle::new()
        .set("x", unit(row.left))
        .set("y", unit(row.top))
        .set("width", unit(width))
        .set("height", unit(height))
        .set("fill", "none")
        .set("stroke", "#000")
        .set("stroke-width", 0.8);
    let mut marks = String::new();
    let mut group = Group::new().add(border);
    let (metres, decimals) = ticks([0.0, row.metres], height / 24.0);
    for value in metres {
        let y = row.y(value);
        marks += &format!("M{} {}h-4", unit(row.left), unit(y));
        group = group.add(line(row.left - 7.0, y + 3.6, TEXT, Anchor::End, &decimal(value, decimals)));
    }
    let (seconds, decimals) = ticks(row.seconds, width / SPACING);
    for value in seconds {
        let x = row.x(value);
        marks += &format!("M{} {}v4", unit(x), unit(row.bottom()));
        if last {
            group = group.add(line(x, row.bottom() + 15.0, TEXT, Anchor::Middle, &decimal(value, decimals)));
        }
    }
    if last {
        group = group.add(line(row.left + width / 2.0, row.bottom() + 29.0, TEXT + 1.0, Anchor::Middle, "time [s]"));
    }
    // With a white outline, to be legible on whatever is drawn below.
    let name = line(row.left + width - 6.0, row.top + 14.0, TEXT, Anchor::End, name)
        .set("stroke", "#fff")
        .set("stroke-width", 3)
        .set("paint-order", "stroke");
    let (x, y) = (unit(row.left - 38.0), unit(row.top + height / 2.0));
    group
        .add(Path::new().set("d", marks).set("stroke", "#000").set("stroke-width", 0.8))
        .add(line(x, y, TEXT, Anchor::Middle, "error [m]").set("transform", format!("rotate(-90 {x} {y})")))
        .add(name)
}
