//! The floor plan of an evaluation: walls, a grid, true and estimated paths.

pub(super) mod key;

use svg::node::element::{Circle, Ellipse, Group, Path, Rectangle};

use super::evaluation_picture::EvaluationPicture;
use super::frame::Frame;
use super::text::{Anchor, line, unit};
use crate::evaluation::{EstimatedPoint, PersonPath, TrackPath, TruePoint};
use doorcam_core::geometry::{Doorway, Point, Side};

pub(super) const TRUTH: &str = "#1a1a1a";
/// Colour of missed people and of reports of nobody.
pub(super) const WRONG: &str = "#d1330f";
const WALL: &str = "#8c8c92";
const GRID: &str = "#e4e4e8";
const EDGE: &str = "#1a1a1a";
/// Minimum drawn thickness of a wall, in page units.
const THIN_WALL: f64 = 2.5;
/// Colours that people with red-green blindness can tell apart (Okabe and Ito), without those that are too pale on
/// white or too close to that of errors.
const PALETTE: [&str; 5] = ["#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9"];
/// √5.991: semi-axes of the 95 % ellipse in standard deviations (χ² with 2 degrees of freedom).
const SIGMAS_95: f64 = 2.4476;

/// A track's id and colour.
pub(super) type Shade = (Option<u64>, &'static str);

/// Each track's colour, in order of first appearance.
pub(super) fn shades(tracks: &[TrackPath]) -> Vec<Shade> {
    tracks.iter().map(|track| track.id).zip(PALETTE.into_iter().cycle()).collect()
}

pub(super) fn shade_of(shades: &[Shade], id: Option<u64>) -> &'static str {
    shades.iter().find(|(name, _)| *name == id).map_or(PALETTE[0], |(_, colour)| colour)
}

/// Floor, grid and wall.
pub(super) fn floor(frame: &Frame, doorway: &Doorway) -> Group {
    let mut grid = String::new();
    let halves = |[low, high]: [f64; 2]| {
        let [first, last] = [(2.0 * low).ceil(), (2.0 * high).floor()].map(|v| v.clamp(-400.0, 400.0) as i32);
        (first..=last).map(|k| f64::from(k) / 2.0)
    };
    for x in halves(frame.x) {
        let [at, top] = frame.place([x, frame.y[1]]);
        grid += &format!("M{} {}V{}", unit(at), unit(top), unit(frame.bottom()));
    }
    for y in halves(frame.y) {
        let [left, at] = frame.place([frame.x[0], y]);
        grid += &format!("M{} {}h{}", unit(left), unit(at), unit(frame.width()));
    }
    let [_, hidden_face] = frame.place([0.0, 0.0]);
    let thickness = (doorway.wall_thickness_m * frame.scale).max(THIN_WALL);
    let wall = |from: f64, to: f64| {
        let [left, right] = [from, to].map(|x| frame.place([x, 0.0])[0]);
        Rectangle::new()
            .set("x", unit(left))
            .set("y", unit(hidden_face))
            .set("width", unit((right - left).max(0.0)))
            .set("height", unit(thickness))
            .set("fill", WALL)
    };
    let half = doorway.half_width();
    let mut group = Group::new()
        .add(Path::new().set("d", grid).set("stroke", GRID).set("stroke-width", 0.7).set("fill", "none"))
        .add(wall(frame.x[0], -half))
        .add(wall(half, frame.x[1]));
    for side in Side::BOTH {
        let [x, y] = frame.place(doorway.edge(side));
        group = group.add(Circle::new().set("cx", unit(x)).set("cy", unit(y)).set("r", 2.6).set("fill", EDGE));
    }
    group
}

/// Ellipses, below paths, below marks.
pub(super) fn people_and_tracks(frame: &Frame, picture: &EvaluationPicture, shades: &[Shade], step: f64) -> Group {
    let mut ellipses = Group::new().set("class", "ellipses").set("stroke-width", 0.8).set("fill-opacity", 0.1);
    let mut tracks = Group::new().set("class", "tracks");
    for track in picture.tracks {
        let colour = shade_of(shades, track.id);
        for point in at_ticks(&track.points, |p| p.seconds, step).filter(|p| !p.stray || track.id.is_some()) {
            if let Some(ellipse) = ellipse(frame, point) {
                ellipses = ellipses.add(ellipse.set("stroke", colour).set("fill", colour));
            }
        }
        tracks = tracks.add(estimated(frame, track, colour));
    }
    let mut people = Group::new().set("class", "people");
    let mut marks = Group::new().set("class", "marks");
    for person in picture.people {
        people = people.add(walked(frame, person, step));
        marks = marks.add(start(frame, person));
    }
    Group::new().add(ellipses).add(people).add(tracks).add(strays(frame, picture.tracks)).add(marks)
}

/// The first point after each whole multiple of `step` seconds.
fn at_ticks<T>(points: &[T], seconds: impl Fn(&T) -> f64, step: f64) -> impl Iterator<Item = &T> {
    let mut last = None;
    points.iter().filter(move |point| {
        let tick = (seconds(point) / step + 1e-6).floor();
        last.replace(tick) != Some(tick)
    })
}

fn walked(frame: &Frame, person: &PersonPath, step: f64) -> Group {
    let stroke = |d: String, width: f64| {
        Path::new().set("d", d).set("stroke", TRUTH).set("stroke-width", width).set("fill", "none")
    };
    let places: Vec<Point> = person.points.iter().map(|p| p.position).collect();
    let mut ticks = String::new();
    for point in at_ticks(&person.points, |p| p.seconds, step) {
        let k = person.points.iter().position(|p| std::ptr::eq(p, point)).unwrap_or(0);
        let (before, after) = (places[k.saturating_sub(1)], places[(k + 1).min(places.len() - 1)]);
        let [dx, dy] = [after[0] - before[0], after[1] - before[1]];
        let length = dx.hypot(dy);
        // Across the path. Somebody who stands still gets a tick as well.
        let [nx, ny] = if length > 0.0 { [3.5 * dy / length, 3.5 * dx / length] } else { [0.0, 3.5] };
        let [x, y] = frame.place(point.position);
        ticks += &format!("M{} {}L{} {}", unit(x - nx), unit(y - ny), unit(x + nx), unit(y + ny));
    }
    let mut missed = Group::new().set("class", "missed");
    for TruePoint { position, .. } in person.points.iter().filter(|p| p.missed()) {
        missed = missed.add(ring(frame.place(*position)));
    }
    Group::new().add(stroke(polyline(frame, places.iter().copied()), 1.2)).add(stroke(ticks, 1.0)).add(missed)
}

/// Marks where somebody is missed.
pub(super) fn ring([x, y]: Point) -> Circle {
    Circle::new()
        .set("cx", unit(x))
        .set("cy", unit(y))
        .set("r", 3.2)
        .set("fill", "#fff")
        .set("stroke", WRONG)
        .set("stroke-width", 1.2)
}

fn start(frame: &Frame, person: &PersonPath) -> Group {
    let Some(first) = person.points.first() else { return Group::new() };
    let [x, y] = frame.place(first.position);
    let mut mark = Group::new();
    if first.missed() {
        // The disc would hide the ring of somebody who is missed here, so draw a larger one around it.
        mark = mark.add(ring([x, y]).set("r", 10));
    }
    mark.add(name_mark([x, y], &person.id.to_string()))
}

/// Marks the start of a true path with the person's id.
pub(super) fn name_mark([x, y]: Point, name: &str) -> Group {
    let disc = Circle::new().set("cx", unit(x)).set("cy", unit(y)).set("r", 7.5).set("fill", TRUTH);
    let name = line(x, y + 3.4, 9.5, Anchor::Middle, name).set("fill", "#fff").set("font-weight", "bold");
    Group::new().add(disc.set("stroke", "#fff").set("stroke-width", 1)).add(name)
}

fn estimated(frame: &Frame, track: &TrackPath, colour: &str) -> Group {
    let mut group = Group::new();
    if track.id.is_some() {
        let stretches = track.points.chunk_by(|_, next| next.joined);
        let d: String = stretches.map(|s| polyline(frame, s.iter().map(|p| p.position))).collect();
        let path = Path::new().set("d", d).set("stroke", colour).set("fill", "none");
        group = group.add(path.set("stroke-width", 1.3).set("stroke-linejoin", "round"));
    }
    for point in track.points.iter().filter(|p| !p.stray) {
        let [x, y] = frame.place(point.position);
        group = group.add(Circle::new().set("cx", unit(x)).set("cy", unit(y)).set("r", 1.9).set("fill", colour));
    }
    group
}

fn strays(frame: &Frame, tracks: &[TrackPath]) -> Path {
    let points = tracks.iter().flat_map(|track| &track.points).filter(|point| point.stray);
    cross(points.map(|point| frame.place(point.position)))
}

/// Marks reports of nobody.
pub(super) fn cross(places: impl Iterator<Item = Point>) -> Path {
    let d = places.fold(String::new(), |mut d, [x, y]| {
        d += &format!("M{} {}l6 6m0 -6l-6 6", unit(x - 3.0), unit(y - 3.0));
        d
    });
    Path::new().set("class", "strays").set("d", d).set("stroke", WRONG).set("stroke-width", 1.4).set("fill", "none")
}

/// The 95 % ellipse; none if the covariance does not define one.
fn ellipse(frame: &Frame, point: &EstimatedPoint) -> Option<Ellipse> {
    let [[xx, xy], [_, yy]] = point.covariance;
    let (mean, spread) = ((xx + yy) / 2.0, ((xx - yy) / 2.0).hypot(xy));
    let axes = [mean + spread, mean - spread].map(|variance| SIGMAS_95 * variance.sqrt() * frame.scale);
    if !axes.iter().all(|&a| a > 0.0 && a < 1e5) {
        return None;
    }
    let [x, y] = frame.place(point.position).map(unit);
    // On the page y points down, so angles turn the other way.
    let degrees = -(0.5 * (2.0 * xy).atan2(xx - yy)).to_degrees();
    let ellipse = Ellipse::new().set("cx", x).set("cy", y).set("rx", unit(axes[0])).set("ry", unit(axes[1]));
    Some(ellipse.set("transform", format!("rotate({} {x} {y})", unit(degrees))))
}

fn polyline(frame: &Frame, places: impl Iterator<Item = Point>) -> String {
    let mut d = String::new();
    for (k, place) in places.enumerate() {
        let [x, y] = frame.place(place);
        d += &format!("{}{} {}", if k == 0 { 'M' } else { 'L' }, unit(x), unit(y));
    }
    d
}
