use super::super::floor::FloorNode;
use super::super::room::{Taps, Vector, WallHit};
use super::light::{Now, OrdinaryLight};
use super::person::Person;
use super::radiosity::product;
use super::shell::slope;
use doorcam_core::geometry::Point;
use doorcam_core::scene::Rgb;
use std::f64::consts::PI;

/// Azimuths per radian, least of them between two breaks, and elevations per surface, in the sums over what does not
/// move.
const AZIMUTHS: f64 = 60.0;
const LEAST_AZIMUTHS: usize = 3;
const ELEVATIONS: usize = 12;
/// Largest step of azimuth over people, in radians, most steps between two breaks, and elevations per part that they
/// hide or show.
const STEP: f64 = 0.01;
const MOST_STEPS: usize = 6;
const STEPS: usize = 2;
/// Breaks nearer to each other than this are one, in radians.
const SAME: f64 = 0.005;
/// Elevations at which a glossy floor's view of a source is sampled.
const GLOSSY: usize = 5;

/// Something between a floor point and the walls, in one azimuth.
#[derive(Debug, Clone, Copy)]
struct Met {
    distance: f64,
    /// sin² of the elevations of its lower and upper end.
    s: [f64; 2],
    what: What,
}

#[derive(Debug, Clone, Copy)]
enum What {
    /// A side of a solid, at a place along it; its lower end is at this height.
    Side {
        surface: usize,
        u: f64,
        bottom: f64,
    },
    Underside {
        surface: usize,
    },
    Source(usize),
    Person {
        who: usize,
        part: usize,
    },
}

/// Intervals of s, rising, without overlaps.
type Intervals = Vec<(f64, f64)>;

/// Scratch lists, reused from node to node.
#[derive(Default)]
pub(super) struct Scratch {
    breaks: Vec<f64>,
    met: Vec<Met>,
    /// What is not hidden yet.
    free: Intervals,
    /// Where people are seen.
    people: Intervals,
    cut: Intervals,
    spare: Intervals,
}

/// One azimuth, seen from a floor node.
#[derive(Clone, Copy)]
struct View<'a> {
    node: &'a FloorNode,
    ray: Point,
    /// Direction to the camera, if the floor is glossy.
    camera: Vector,
}

impl OrdinaryLight {
    /// Azimuths at which something in the empty room begins or ends, and those of the opening.
    pub(super) fn breaks_of(&self, node: &FloorNode) -> Vec<f64> {
        let [first, last] = node.azimuths;
        let sources = self.sources.iter().flat_map(|source| source.ends(node.at));
        let ends = self.shell.corners().chain(sources);
        let azimuths = ends.map(|[x, y]| (x - node.at[0]).atan2(y - node.at[1]));
        let mut breaks: Vec<f64> = azimuths.filter(|phi| *phi > first && *phi < last).collect();
        if first < last {
            breaks.extend([first, last]);
        }
        breaks.sort_by(f64::total_cmp);
        breaks.dedup_by(|a, b| *a - *b < 1e-9);
        breaks
    }

    fn view<'a>(&self, node: &'a FloorNode, phi: f64) -> View<'a> {
        let (sine, cosine) = phi.sin_cos();
        let camera = self.gloss.map_or([0.0; 3], |gloss| gloss.towards(node.at));
        View { node, ray: [sine, cosine], camera }
    }

    /// The camera's weight of light from an elevation, besides that of the fan.
    fn glossy(&self, view: &View<'_>, s: f64) -> f64 {
        self.gloss.map_or(1.0, |gloss| gloss.weight(view.camera, view.ray, s))
    }

    /// ∫ ½ weight ds between two elevations.
    fn solid_angle(&self, view: &View<'_>, (from, to): (f64, f64)) -> f64 {
        if self.gloss.is_none() {
            return 0.5 * (to - from);
        }
        let step = (to - from) / GLOSSY as f64;
        (0..GLOSSY).map(|k| 0.5 * step * self.glossy(view, from + (k as f64 + 0.5) * step)).sum()
    }

    /// sin² of the elevation at which the opening ends.
    fn open(&self, view: &View<'_>) -> f64 {
        if view.node.at[1] < 0.0 { sine_squared(self.opening_height(), -view.node.at[1] / view.ray[1]) } else { 1.0 }
    }

    /// Adds what stands still in an azimuth.
    fn meet_still(&self, view: &View<'_>, met: &mut Vec<Met>) {
        let View { node, ray, .. } = *view;
        for (solid, &surface) in self.shell.solids.iter().zip(&self.shell.of_solid) {
            let Some(hit) = solid.meet(node.at, ray) else { continue };
            let [low, high] = [solid.bottom, solid.top].map(|z| sine_squared(z, hit.near));
            let what = What::Side { surface: surface + hit.side, u: hit.u, bottom: solid.bottom };
            met.push(Met { distance: hit.near, s: [low, high], what });
            if solid.bottom > 0.0 {
                let s = [sine_squared(solid.bottom, hit.far), low];
                met.push(Met { distance: hit.near, s, what: What::Underside { surface: surface + 5 } });
            }
        }
        for (k, source) in self.sources.iter().enumerate() {
            if let Some((distance, s)) = source.meet(node.at, ray) {
                met.push(Met { distance, s, what: What::Source(k) });
            }
        }
    }

    /// Adds up a node's light per unit radiance of each texel, in the empty room, and returns that of each source.
    pub(super) fn sum_node(
        &self,
        node: &FloorNode,
        breaks: &[f64],
        row: &mut [f32],
        scratch: &mut Scratch,
    ) -> Vec<f64> {
        let mut direct = vec![0.0; self.sources.len()];
        for pair in breaks.windows(2) {
            let count = ((pair[1] - pair[0]) * AZIMUTHS).ceil().max(LEAST_AZIMUTHS as f64) as usize;
            let width = (pair[1] - pair[0]) / count as f64;
            for k in 0..count {
                let view = self.view(node, pair[0] + (k as f64 + 0.5) * width);
                let weight = width * node.weight(view.ray);
                if weight > 0.0 {
                    self.sum_column(&view, weight, row, &mut direct, scratch);
                }
            }
        }
        direct
    }

    fn sum_column(&self, view: &View<'_>, weight: f64, row: &mut [f32], direct: &mut [f64], scratch: &mut Scratch) {
        let wall = self.shell.wall(view.node.at, view.ray);
        let Scratch { met, free, cut, spare, .. } = scratch;
        met.clear();
        self.meet_still(view, met);
        met.sort_by(|a, b| a.distance.total_cmp(&b.distance));
        let open = self.open(view);
        free.clear();
        free.push((0.0, open));
        let mut add = |taps: Option<Taps>, amount: f64| {
            for (texel, share) in taps.into_iter().flatten() {
                row[texel] += (amount * share) as f32;
            }
        };
        for met in met.iter() {
            take(free, met.s, cut, spare);
            for &interval in cut.iter() {
                match met.what {
                    What::Source(k) => direct[k] += weight * self.solid_angle(view, interval),
                    _ => {
                        for (s, step) in steps(interval, STEPS) {
                            add(self.taps(view, met, s), weight * 0.5 * step * self.glossy(view, s));
                        }
                    }
                }
            }
        }
        let edge = sine_squared(self.shell.ceiling(), wall.distance);
        for interval in split(free, edge) {
            for (s, step) in steps(interval, ELEVATIONS) {
                add(self.shell.taps(view.node.at, view.ray, &wall, s), weight * 0.5 * step * self.glossy(view, s));
            }
        }
    }

    /// The texels that are seen of a solid at an elevation.
    fn taps(&self, view: &View<'_>, met: &Met, s: f64) -> Option<Taps> {
        match met.what {
            What::Side { surface, u, bottom } => {
                self.shell.surfaces[surface].taps([u, met.distance * slope(s) - bottom])
            }
            What::Underside { surface } => self.shell.level(surface, view.node.at, view.ray, s),
            What::Source(_) | What::Person { .. } => None,
        }
    }

    /// People's change of the light at a node.
    pub(super) fn change(&self, k: usize, people: &[Person], now: &Now, scratch: &mut Scratch) -> Rgb {
        let node = &self.floor.nodes[k];
        let count = self.shell.texels.len();
        let row = &self.transport[k * count..][..count];
        let mut change = [0, 1, 2].map(|c| product(row, &now.change[c]));
        let [first, last] = node.azimuths;
        let mut breaks = std::mem::take(&mut scratch.breaks);
        breaks.clear();
        let mut range = [f64::INFINITY, f64::NEG_INFINITY];
        for person in people {
            let [from, to] = person.hull.outline(node.at).unwrap_or([first, last]);
            if from >= last || to <= first {
                continue;
            }
            range = [range[0].min(from.max(first)), range[1].max(to.min(last))];
            for (part, _) in &person.parts {
                let [from, to] = part.outline(node.at).unwrap_or([first, last]);
                if from < last && to > first {
                    breaks.extend([from.max(first), to.min(last)]);
                }
            }
        }
        breaks.extend(self.breaks[k].iter().filter(|phi| (range[0]..=range[1]).contains(*phi)));
        breaks.sort_by(f64::total_cmp);
        // Of two that are nearly the same, the first remains; the last of all is kept.
        let end = breaks.last().copied();
        breaks.dedup_by(|next, kept| *next - *kept < SAME);
        if let (Some(end), Some(last)) = (end, breaks.last_mut()) {
            *last = end;
        }
        for pair in breaks.windows(2) {
            let count = (((pair[1] - pair[0]) / STEP).ceil() as usize).clamp(1, MOST_STEPS);
            let width = (pair[1] - pair[0]) / count as f64;
            for j in 0..count {
                let view = self.view(node, pair[0] + (j as f64 + 0.5) * width);
                let weight = width * node.weight(view.ray);
                if weight > 0.0 {
                    let seen = self.change_column(&view, people, now, scratch);
                    (0..3).for_each(|c| change[c] += weight * seen[c]);
                }
            }
        }
        scratch.breaks = breaks;
        change
    }

    /// ½ ∫ ΔL ds over one azimuth.
    fn change_column(&self, view: &View<'_>, people: &[Person], now: &Now, scratch: &mut Scratch) -> Rgb {
        let at = view.node.at;
        let wall = self.shell.wall(at, view.ray);
        let Scratch { met, free, people: shown, cut, spare, .. } = scratch;
        met.clear();
        for (who, person) in people.iter().enumerate() {
            if person.hull.meet(at, view.ray).is_none() && person.hull.outline(at).is_some() {
                continue;
            }
            for (part, (cylinder, _)) in person.parts.iter().enumerate() {
                // People behind the wall are not in the room.
                if let Some([distance, back]) = cylinder.meet(at, view.ray).filter(|[front, _]| *front < wall.distance)
                {
                    // From below, the underside hides what is above its far rim.
                    let s = [sine_squared(cylinder.bottom, back), sine_squared(cylinder.top, distance)];
                    met.push(Met { distance, s, what: What::Person { who, part } });
                }
            }
        }
        let mut light = [0.0; 3];
        if met.is_empty() {
            return light;
        }
        self.meet_still(view, met);
        met.sort_by(|a, b| a.distance.total_cmp(&b.distance));
        free.clear();
        free.push((0.0, self.open(view)));
        shown.clear();
        for met in met.iter() {
            take(free, met.s, cut, spare);
            let What::Person { who, part } = met.what else { continue };
            let (cylinder, albedo) = &people[who].parts[part];
            let normal = [0, 1].map(|k| (at[k] + met.distance * view.ray[k] - cylinder.centre[k]) / cylinder.radius);
            if cut.is_empty() {
                continue;
            }
            let line = people[who].line(normal);
            for &interval in cut.iter() {
                shown.push(interval);
                for (s, step) in steps(interval, STEPS) {
                    let falls = line.at(met.distance * slope(s));
                    let weight = 0.5 * step * self.glossy(view, s) / PI;
                    (0..3).for_each(|c| light[c] += weight * albedo[c] * falls[c]);
                }
            }
        }
        // What is behind them, from the nearest on.
        for met in met.iter().filter(|met| !matches!(met.what, What::Person { .. })) {
            take(shown, met.s, cut, spare);
            for &interval in cut.iter() {
                if let What::Source(k) = met.what {
                    let hidden = now.levels[k] * self.solid_angle(view, interval);
                    (0..3).for_each(|c| light[c] -= hidden * self.sources[k].radiance[c]);
                    continue;
                }
                for (s, step) in steps(interval, STEPS) {
                    self.subtract(now, self.taps(view, met, s), 0.5 * step * self.glossy(view, s), &mut light);
                }
            }
        }
        self.subtract_wall(view, &wall, now, shown, &mut light);
        light
    }

    fn subtract_wall(&self, view: &View<'_>, wall: &WallHit, now: &Now, hidden: &Intervals, light: &mut Rgb) {
        let edge = sine_squared(self.shell.ceiling(), wall.distance);
        for interval in split(hidden, edge) {
            for (s, step) in steps(interval, STEPS) {
                let taps = self.shell.taps(view.node.at, view.ray, wall, s);
                self.subtract(now, taps, 0.5 * step * self.glossy(view, s), light);
            }
        }
    }

    fn subtract(&self, now: &Now, taps: Option<Taps>, amount: f64, light: &mut Rgb) {
        for (texel, share) in taps.into_iter().flatten() {
            let radiance = now.texels[texel];
            (0..3).for_each(|c| light[c] -= amount * share * radiance[c]);
        }
    }
}

/// The middles and lengths of equal steps of an interval.
fn steps((from, to): (f64, f64), count: usize) -> impl Iterator<Item = (f64, f64)> {
    let step = (to - from) / count as f64;
    (0..count).map(move |k| (from + (k as f64 + 0.5) * step, step))
}

/// Intervals below and above an elevation.
fn split(intervals: &Intervals, edge: f64) -> impl Iterator<Item = (f64, f64)> + '_ {
    intervals
        .iter()
        .flat_map(move |&(from, to)| {
            let edge = edge.clamp(from, to);
            [(from, edge), (edge, to)]
        })
        .filter(|(from, to)| from < to)
}

/// Moves what is in [from, to] from `free` to `cut`.
fn take(free: &mut Intervals, [from, to]: [f64; 2], cut: &mut Intervals, spare: &mut Intervals) {
    cut.clear();
    spare.clear();
    for &(first, last) in free.iter() {
        let (low, high) = (first.max(from), last.min(to));
        if low < high {
            cut.push((low, high));
            if first < low {
                spare.push((first, low));
            }
            if high < last {
                spare.push((high, last));
            }
        } else {
            spare.push((first, last));
        }
    }
    std::mem::swap(free, spare);
}

/// sin² of the elevation of something of this height at this distance.
fn sine_squared(height: f64, distance: f64) -> f64 {
    let h2 = height * height;
    h2 / (distance * distance + h2).max(1e-12)
}
