use std::f64::consts::PI;

use rayon::prelude::*;

use super::figure::{Ambient, Figure, Opening, Part};
use super::floor::{FloorMap, FloorNode, Tap};
use super::lamp::{Lamp, below};
use super::room::{Shell, Taps};
use super::scenario::Scenario;
use doorcam_core::geometry::{Doorway, Point};
use doorcam_core::quadrature::Quadrature;
use doorcam_core::scene::Rgb;

/// Azimuths per radian, and elevations per surface, in the sums over what does not move.
const AZIMUTHS: f64 = 45.0;
const ELEVATIONS: usize = 14;
/// Quadrature nodes per interval of azimuth in which rays meet the same people, and elevations per part that they hide
/// or show.
const NODES: usize = 4;
const STEPS: usize = 3;
/// How far beside and in front of the opening somebody on the visible side may stand in its light, in metres.
const VISIBLE_M: f64 = 2.0;
/// Minimum radius of a lamp seen from the floor, in radians: half the angular step of a fan. A smaller lamp would make
/// the steps visible.
const LEAST_LAMP: f64 = 0.012;

/// The light of a hidden room on the floor, with people or without.
///
/// E(p) = Σ lamps seen + ∫∫ L cos ϑ dω over what is seen through the opening, L = albedo / π · E of the surface. A
/// surface's E is the lamps' direct light, in which people throw shadows, plus an ambient term for all further bounces:
/// the flux of the lamps spread evenly, ρ Φ / (S (1 − ρ)), ρ the mean albedo, S the area of the room.
///
/// What does not move is summed once: the transport from each texel to each floor node, and each lamp's light in the
/// empty room. A frame adds what people change: texels in their shadows, lamps that they hide, and the wedges of
/// azimuth in which they are seen instead of what is behind them.
#[derive(Debug, Clone)]
pub(super) struct RoomLight {
    doorway: Doorway,
    shell: Shell,
    lamps: Vec<Lamp>,
    floor: FloorMap,
    /// One row per node: light per unit radiance of each texel.
    transport: Vec<f32>,
    /// Per lamp and texel: irradiance for an intensity of 1, without people.
    direct: Vec<Vec<f64>>,
    /// Per lamp: ambient irradiance.
    ambient: Vec<Rgb>,
    /// Per lamp and node: all of its light in the empty room.
    empty: Vec<Vec<Rgb>>,
    /// Per lamp and node: its direct light for an intensity of 1.
    seen: Vec<Vec<f64>>,
    rule: Quadrature,
    /// The nodes that a pixel uses.
    needed: Vec<bool>,
}

impl RoomLight {
    pub(super) fn new(scenario: &Scenario) -> Self {
        let doorway = scenario.doorway;
        let shell = Shell::new(&scenario.room, &scenario.panel);
        let lamps: Vec<Lamp> = scenario.lamp.iter().map(Lamp::new).collect();
        let floor = FloorMap::new(doorway);
        let direct =
            lamps.iter().map(|l| shell.texels.iter().map(|t| l.irradiance(t.centre, t.normal)).collect()).collect();
        let ambient = lamps.iter().map(|lamp| ambient(lamp, &shell, scenario)).collect();
        let count = shell.texels.len();
        let mut light = Self {
            transport: vec![0.0; floor.nodes.len() * count],
            doorway,
            shell,
            lamps,
            floor,
            direct,
            ambient,
            empty: Vec::new(),
            seen: Vec::new(),
            rule: Quadrature::new(NODES),
            needed: Vec::new(),
        };
        light.needed = vec![true; light.floor.nodes.len()];
        let mut transport = std::mem::take(&mut light.transport);
        transport.par_chunks_mut(count).zip(&light.floor.nodes).for_each(|(row, node)| light.sum_transport(node, row));
        light.transport = transport;
        light.seen =
            light.lamps.iter().map(|l| light.floor.nodes.iter().map(|n| light.sees_lamp(n, l)).collect()).collect();
        light.empty = (0..light.lamps.len()).map(|lamp| light.of_lamp(lamp, scenario.room.albedo.front)).collect();
        light
    }

    pub(super) fn floor(&self) -> &FloorMap {
        &self.floor
    }

    /// Limits people's changes to the nodes that these taps use, for a camera that sees no others.
    pub(super) fn look_only_at(&mut self, places: impl Iterator<Item = Tap>) {
        self.needed = self.floor.nodes_of(places);
    }

    /// The light on the floor with each lamp at its level, as values of [`FloorMap::refine`]. `visible` is the visible
    /// side's light, which falls on those of the people who are there.
    pub(super) fn light(&self, levels: &[f64], mut people: Vec<Figure>, visible: Rgb) -> Vec<[f32; 3]> {
        let mut nodes: Vec<Rgb> = vec![[0.0; 3]; self.floor.nodes.len()];
        for (empty, level) in self.empty.iter().zip(levels) {
            for (node, empty) in nodes.iter_mut().zip(empty) {
                (0..3).for_each(|c| node[c] += level * empty[c]);
            }
        }
        people.retain(|figure| self.is_near(figure));
        if !people.is_empty() {
            self.light_people(levels, visible, &mut people);
            let radiance = self.radiance(levels, &people);
            let needed = nodes.par_iter_mut().enumerate().filter(|(k, _)| self.needed[*k]);
            needed.for_each_init(Hits::default, |hits, (k, node)| {
                let change = self.change(k, levels, &people, &radiance, hits);
                (0..3).for_each(|c| node[c] += change[c]);
            });
        }
        self.floor.refine(&nodes)
    }

    /// Whether any part of the person is in the room, or where it may stand in the light of the opening.
    fn is_near(&self, figure: &Figure) -> bool {
        let Shell { half_width, depth, .. } = self.shell;
        figure.parts.iter().any(|&Part { centre: [x, y], radius, .. }| match y {
            0.0.. => x.abs() < half_width + radius && y < depth + radius,
            _ => x.abs() < VISIBLE_M && y > -VISIBLE_M,
        })
    }

    fn light_people(&self, levels: &[f64], visible: Rgb, people: &mut [Figure]) {
        let parts: Vec<Vec<Part>> = people.iter().map(|p| p.parts.clone()).collect();
        let ambient = Ambient { room: self.ambient_at(levels), visible };
        let opening = Opening { half_width: self.doorway.half_width(), height: self.opening_height() };
        for (k, figure) in people.iter_mut().enumerate() {
            let others: Vec<Part> = parts
                .iter()
                .enumerate()
                .filter(|(other, _)| *other != k)
                .flat_map(|(_, parts)| parts.iter().copied())
                .collect();
            figure.light(&self.lamps, levels, ambient, opening, &others);
        }
    }

    /// Without a lintel the opening ends at the ceiling: light from above it belongs to the visible side.
    fn opening_height(&self) -> f64 {
        self.doorway.height_m.unwrap_or(f64::INFINITY).min(self.shell.height)
    }

    fn ambient_at(&self, levels: &[f64]) -> Rgb {
        [0, 1, 2].map(|c| self.ambient.iter().zip(levels).map(|(ambient, level)| level * ambient[c]).sum())
    }

    /// Radiance of the walls and ceiling including people's shadows, and what the texels in shadow lack.
    fn radiance(&self, levels: &[f64], people: &[Figure]) -> Radiance {
        let ambient = self.ambient_at(levels);
        let both: Vec<(Rgb, Rgb)> = self
            .shell
            .texels
            .par_iter()
            .enumerate()
            .map(|(k, texel)| {
                let (mut light, mut lacks) = (ambient, [0.0; 3]);
                for ((lamp, direct), level) in self.lamps.iter().zip(&self.direct).zip(levels) {
                    let direct = level * direct[k];
                    if direct > 0.0 {
                        let parts = people.iter().flat_map(|p| &p.parts);
                        let hidden = lamp.hidden_by(texel.centre, texel.half, parts);
                        (0..3).for_each(|c| {
                            light[c] += lamp.intensity[c] * direct * (1.0 - hidden);
                            lacks[c] += lamp.intensity[c] * direct * hidden;
                        });
                    }
                }
                let shine = |light: Rgb| [0, 1, 2].map(|c| texel.albedo[c] / PI * light[c]);
                (shine(light), shine(lacks))
            })
            .collect();
        let shadows = both.iter().enumerate().filter(|(_, (_, lacks))| lacks.iter().any(|&l| l > 0.0));
        Radiance {
            shadows: shadows.map(|(k, (_, [r, g, b]))| (k, [*r as f32, *g as f32, *b as f32, 0.0])).collect(),
            texels: both.iter().map(|(light, _)| *light).collect(),
        }
    }

    /// People's change of the light at a node.
    fn change(&self, k: usize, levels: &[f64], people: &[Figure], radiance: &Radiance, hits: &mut Hits) -> Rgb {
        let node = &self.floor.nodes[k];
        let row = &self.transport[k * self.shell.texels.len()..][..self.shell.texels.len()];
        let mut lacks = [0.0_f32; 4];
        for (texel, shadow) in &radiance.shadows {
            let weight = row[*texel];
            (0..4).for_each(|c| lacks[c] += weight * shadow[c]);
        }
        let mut change = [0, 1, 2].map(|c| -f64::from(lacks[c]));
        for ((lamp, seen), level) in self.lamps.iter().zip(&self.seen).zip(levels) {
            let direct = level * seen[k];
            if direct > 0.0 {
                let parts = people.iter().flat_map(|p| &p.parts);
                let hidden = direct * lamp.hidden_by([node.at[0], node.at[1], 0.0], 0.005, parts);
                (0..3).for_each(|c| change[c] -= lamp.intensity[c] * hidden);
            }
        }
        self.add_people(node, people, radiance, hits, &mut change);
        change
    }

    /// Adds what people show and subtracts what they hide, one wedge of azimuth after the other.
    fn add_people(&self, node: &FloorNode, people: &[Figure], radiance: &Radiance, hits: &mut Hits, light: &mut Rgb) {
        let [first, last] = node.azimuths;
        let Hits { breaks, column } = hits;
        breaks.clear();
        for part in people.iter().flat_map(|p| &p.parts) {
            let [from, to] = part.outline(node.at).unwrap_or([first, last]);
            if from < last && to > first {
                breaks.extend([from.max(first), to.min(last)]);
            }
        }
        breaks.sort_by(f64::total_cmp);
        for pair in breaks.windows(2).filter(|pair| pair[1] - pair[0] > 1e-9) {
            let middle = direction((pair[0] + pair[1]) / 2.0);
            if !people.iter().flat_map(|p| &p.parts).any(|part| part.meet(node.at, middle).is_some()) {
                continue;
            }
            for (phi, width) in self.rule.over(pair[0], pair[1]) {
                let ray = direction(phi);
                let change = self.column(node, ray, people, radiance, column);
                let weight = width * node.weight(ray);
                (0..3).for_each(|c| light[c] += weight * change[c]);
            }
        }
    }

    /// ∫ ΔL sin ε cos ε dε = ½ ∫ ΔL ds, s = sin² ε, over one azimuth.
    fn column(
        &self,
        node: &FloorNode,
        ray: Point,
        people: &[Figure],
        radiance: &Radiance,
        scratch: &mut ColumnScratch,
    ) -> Rgb {
        let wall = self.shell.wall(node.at, ray);
        let ColumnScratch { met, hidden, covered } = scratch;
        met.clear();
        for (who, figure) in people.iter().enumerate() {
            for (part, cylinder) in figure.parts.iter().enumerate() {
                // People behind the wall are not in the room.
                if let Some([distance, back]) = cylinder.meet(node.at, ray).filter(|[front, _]| *front < wall.distance)
                {
                    // From below, the underside hides what is above its far rim.
                    let s = [sine_squared(cylinder.bottom, back), sine_squared(cylinder.top, distance)];
                    met.push(Met { who, part, distance, s });
                }
            }
        }
        met.sort_by(|a, b| a.distance.total_cmp(&b.distance));
        let open = self.open(node, ray);
        covered.clear();
        let mut light = [0.0; 3];
        for &Met { who, part, distance, s: [from, to] } in met.iter() {
            hidden.clear();
            free(covered, from, to.min(open), hidden);
            let at = [node.at[0] + distance * ray[0], node.at[1] + distance * ray[1]];
            let figure = &people[who];
            let Part { centre, radius, .. } = figure.parts[part];
            let normal = [(at[0] - centre[0]) / radius, (at[1] - centre[1]) / radius];
            let column = figure.column(part, normal);
            for &(from, to) in hidden.iter() {
                let step = (to - from) / STEPS as f64;
                for j in 0..STEPS {
                    let s = from + (j as f64 + 0.5) * step;
                    let shown = column.at(distance * (s / (1.0 - s)).sqrt());
                    (0..3).for_each(|c| light[c] += 0.5 * step * shown[c]);
                }
                cover(covered, from, to);
            }
        }
        let edge = sine_squared(self.shell.height, wall.distance);
        for (from, to) in covered.iter().flat_map(|&(from, to)| {
            let edge = edge.clamp(from, to);
            [(from, edge), (edge, to)]
        }) {
            let step = (to - from) / STEPS as f64;
            if step <= 0.0 {
                continue;
            }
            for j in 0..STEPS {
                let taps = self.shell.taps(node.at, ray, &wall, from + (j as f64 + 0.5) * step);
                let behind = radiance.at(&taps);
                (0..3).for_each(|c| light[c] -= 0.5 * step * behind[c]);
            }
        }
        light
    }

    /// sin² of the elevation at which the opening ends.
    fn open(&self, node: &FloorNode, ray: Point) -> f64 {
        if node.at[1] < 0.0 { sine_squared(self.opening_height(), -node.at[1] / ray[1]) } else { 1.0 }
    }

    /// Adds up a node's light per unit radiance of each texel.
    fn sum_transport(&self, node: &FloorNode, row: &mut [f32]) {
        let [first, last] = node.azimuths;
        if last <= first {
            return;
        }
        let count = ((last - first) * AZIMUTHS).ceil().max(8.0) as usize;
        let width = (last - first) / count as f64;
        for k in 0..count {
            let ray = direction(first + (k as f64 + 0.5) * width);
            let wall = self.shell.wall(node.at, ray);
            let open = self.open(node, ray);
            let edge = sine_squared(self.shell.height, wall.distance).min(open);
            let weight = node.weight(ray);
            for (from, to) in [(0.0, edge), (edge, open)] {
                let step = (to - from) / ELEVATIONS as f64;
                for j in 0..ELEVATIONS {
                    let taps = self.shell.taps(node.at, ray, &wall, from + (j as f64 + 0.5) * step);
                    for (texel, share) in taps {
                        row[texel] += (weight * width * 0.5 * step * share) as f32;
                    }
                }
            }
        }
    }

    /// A lamp's direct light at a floor node, for an intensity of 1: the part that the edges and the lintel let
    /// through.
    fn sees_lamp(&self, node: &FloorNode, lamp: &Lamp) -> f64 {
        let [first, last] = node.azimuths;
        let to_lamp = [lamp.at[0] - node.at[0], lamp.at[1] - node.at[1]];
        let range = to_lamp[0].hypot(to_lamp[1]).max(1e-6);
        let (azimuth, size) = (to_lamp[0].atan2(to_lamp[1]), (lamp.radius / range).max(LEAST_LAMP));
        let between = below((last - azimuth) / size) - below((first - azimuth) / size);
        let ray = to_lamp.map(|d| d / range);
        let under = match self.doorway.height_m {
            Some(height) if node.at[1] < 0.0 => {
                let share = -node.at[1] / to_lamp[1];
                below((height - lamp.at[2] * share) / (lamp.radius * share).max(1e-3))
            }
            _ => 1.0,
        };
        let place = [node.at[0], node.at[1], 0.0];
        node.weight(ray) * between.max(0.0) * under * lamp.irradiance(place, [0.0, 0.0, 1.0])
    }

    /// All light of one lamp at each node in the empty room.
    fn of_lamp(&self, lamp: usize, front: Rgb) -> Vec<Rgb> {
        let (intensity, ambient) = (self.lamps[lamp].intensity, self.ambient[lamp]);
        let texels = self.shell.texels.iter().zip(&self.direct[lamp]);
        let radiance: Vec<Rgb> = texels
            .map(|(t, direct)| [0, 1, 2].map(|c| t.albedo[c] / PI * (intensity[c] * direct + ambient[c])))
            .collect();
        let of_node = |(k, row): (usize, &[f32])| {
            let mut light = intensity.map(|i| i * self.seen[lamp][k]);
            for (weight, radiance) in row.iter().zip(&radiance) {
                (0..3).for_each(|c| light[c] += f64::from(*weight) * radiance[c]);
            }
            if self.floor.is_inside(k) {
                // Half of what such a point sees is the doorway's wall, which only ambient light reaches.
                (0..3).for_each(|c| light[c] += front[c] * ambient[c] / 2.0);
            }
            light
        };
        self.transport.par_chunks(radiance.len()).enumerate().map(of_node).collect()
    }
}

/// Radiance of walls and ceiling.
struct Radiance {
    texels: Vec<Rgb>,
    /// Texels in shadow and the radiance that the shadow takes from them. The fourth value is 0: four are faster to add
    /// than three.
    shadows: Vec<(usize, [f32; 4])>,
}

impl Radiance {
    fn at(&self, taps: &Taps) -> Rgb {
        let mut light = [0.0; 3];
        for &(texel, share) in taps {
            let radiance = self.texels[texel];
            (0..3).for_each(|c| light[c] += share * radiance[c]);
        }
        light
    }
}

/// Scratch lists, reused from node to node.
#[derive(Default)]
struct Hits {
    breaks: Vec<f64>,
    column: ColumnScratch,
}

/// Scratch lists of one azimuth.
#[derive(Default)]
struct ColumnScratch {
    met: Vec<Met>,
    /// What one part hides.
    hidden: Vec<(f64, f64)>,
    /// What all nearer parts hide: intervals of s, rising, without overlaps.
    covered: Vec<(f64, f64)>,
}

/// A part of a person that a ray meets.
struct Met {
    who: usize,
    part: usize,
    distance: f64,
    /// sin² of the elevations of its bottom and top.
    s: [f64; 2],
}

/// Adds to `free` those parts of an interval that `covered` leaves.
fn free(covered: &[(f64, f64)], mut from: f64, to: f64, free: &mut Vec<(f64, f64)>) {
    for &(first, last) in covered {
        if first > from {
            free.push((from, first.min(to)));
        }
        from = from.max(last);
        if from >= to {
            break;
        }
    }
    if from < to {
        free.push((from, to));
    }
    free.retain(|(from, to)| from < to);
}

/// Adds an interval that nothing covers yet, and joins it with those that it touches.
fn cover(covered: &mut Vec<(f64, f64)>, from: f64, to: f64) {
    let at = covered.partition_point(|&(_, last)| last < from);
    match covered.get(at).copied() {
        Some((first, last)) if last == from => {
            let next = covered.get(at + 1).copied().filter(|&(next, _)| next == to);
            covered[at] = (first, next.map_or(to, |(_, end)| end));
            if next.is_some() {
                covered.remove(at + 1);
            }
        }
        Some((first, last)) if first == to => covered[at] = (from, last),
        _ => covered.insert(at, (from, to)),
    }
}

/// ρ Φ / (S (1 − ρ)), where the doorway reflects nothing.
fn ambient(lamp: &Lamp, shell: &Shell, scenario: &Scenario) -> Rgb {
    let Shell { half_width, depth, height, .. } = *shell;
    let front = 2.0 * half_width * height;
    let opening = scenario.doorway.width_m * scenario.doorway.height_m.unwrap_or(height).min(height);
    let floor = 2.0 * half_width * depth;
    let texels: f64 = shell.texels.iter().map(|t| 4.0 * t.half * t.half).sum();
    let area = texels + floor + front;
    let albedo = &scenario.room.albedo;
    [0, 1, 2].map(|c| {
        let reflected = shell.texels.iter().map(|t| 4.0 * t.half * t.half * t.albedo[c]).sum::<f64>()
            + floor * albedo.floor[c]
            + (front - opening) * albedo.front[c];
        let mean = reflected / area;
        mean * lamp.flux() * lamp.intensity[c] / (area * (1.0 - mean).max(0.05))
    })
}

fn direction(phi: f64) -> Point {
    let (sine, cosine) = phi.sin_cos();
    [sine, cosine]
}

/// sin² of the elevation of something of this height at this distance.
fn sine_squared(height: f64, distance: f64) -> f64 {
    let h2 = height * height;
    h2 / (distance * distance + h2)
}

#[cfg(test)]
#[path = "light_tests.rs"]
mod tests;
