use std::f64::consts::PI;

use rayon::prelude::*;

use super::super::figure::Part;
use super::super::floor::{FloorMap, FloorNode, Tap};
use super::super::lamp::hidden_by_part;
use super::super::room::Vector;
use super::super::scenario::Scenario;
use super::column::Scratch;
use super::gloss::Gloss;
use super::person::Person;
use super::radiosity::{BOUNCES, Exchange, on_place};
use super::shell::{Shell, Texel};
use super::solid::blocked;
use super::source::{self, Source, Tile};
use doorcam_core::geometry::Doorway;
use doorcam_core::scene::Rgb;

/// How far beside and in front of the opening somebody on the visible side may stand in its light, in metres.
const VISIBLE_M: f64 = 2.0;
/// The floor is watched up to this far beside and before the edges, in metres, and sees a source if more than this part
/// of that source's light there comes straight from it: not just a corner at the foot of a thin wall.
const WATCHED_M: f64 = 0.3;
const SEEN: f64 = 0.05;
/// Pieces up each part of a person between which and the walls light is exchanged.
const PIECES: usize = 3;

/// The light of an ordinary room on the floor, with people or without.
///
/// What does not move is summed once: the exchange of light between all surfaces, the transport from each texel that is
/// seen to each floor node past whatever stands in the room, and each source's light at each node. A frame adds what
/// people change: the shadows that they throw on surfaces, the light that they take from and give to them, and the
/// azimuths in which they are seen instead of what is behind them.
#[derive(Debug, Clone)]
pub(in crate::simulation) struct OrdinaryLight {
    pub(super) doorway: Doorway,
    pub(super) shell: Shell,
    pub(super) sources: Vec<Source>,
    pub(super) tiles: Vec<Tile>,
    pub(super) floor: FloorMap,
    pub(super) gloss: Option<Gloss>,
    pub(super) exchange: Exchange,
    /// One row per node: light per unit radiance of each texel.
    pub(super) transport: Vec<f32>,
    /// Per node: azimuths at which something in the empty room begins or ends, rising.
    pub(super) breaks: Vec<Vec<f64>>,
    /// Per source and node: all of its light in the empty room, at level 1.
    empty: Vec<Vec<Rgb>>,
    /// The nodes that are needed.
    needed: Vec<bool>,
    /// Whether the floor beside the edges sees a source itself.
    seen: bool,
}

/// Walls, ceiling and furniture with people in the room.
pub(super) struct Now {
    /// Radiance of each texel.
    pub(super) texels: Vec<Rgb>,
    /// What people add to it or take from it, by channel.
    pub(super) change: [Vec<f32>; 3],
    /// Level of each source.
    pub(super) levels: Vec<f64>,
}

impl OrdinaryLight {
    /// Calculates what does not move, at the nodes that `places` use.
    pub(in crate::simulation) fn new(scenario: &Scenario, floor: FloorMap, places: impl Iterator<Item = Tap>) -> Self {
        let shell = Shell::new(scenario);
        let (sources, tiles) = source::all(scenario);
        let bounces = scenario.room.bounces.unwrap_or(BOUNCES);
        let exchange = Exchange::new(&shell, &sources, &tiles, bounces);
        let needed = floor.nodes_of(places);
        let count = shell.texels.len();
        let mut light = Self {
            doorway: scenario.doorway,
            gloss: Gloss::new(&scenario.floor, &scenario.camera),
            transport: vec![0.0; floor.nodes.len() * count],
            breaks: Vec::new(),
            empty: vec![vec![[0.0; 3]; floor.nodes.len()]; sources.len()],
            shell,
            sources,
            tiles,
            floor,
            exchange,
            needed,
            seen: false,
        };
        light.breaks = light.floor.nodes.iter().map(|node| light.breaks_of(node)).collect();
        let mut transport = std::mem::take(&mut light.transport);
        let nodes = transport.par_chunks_mut(count).zip(&light.floor.nodes).enumerate();
        let all: Vec<Vec<(f64, Rgb)>> = nodes
            .map_init(Scratch::default, |scratch, (k, (row, node))| {
                if !light.needed[k] {
                    return Vec::new();
                }
                let direct = light.sum_node(node, &light.breaks[k], row, scratch);
                let of_source = |source: usize| (direct[source], light.of_source(source, k, direct[source], row));
                (0..light.sources.len()).map(of_source).collect()
            })
            .collect();
        light.transport = transport;
        let mut sums = vec![[0.0; 2]; light.sources.len()];
        for (k, of_node) in all.into_iter().enumerate() {
            let area = light.area_beside(&light.floor.nodes[k]);
            for (source, (direct, value)) in of_node.into_iter().enumerate() {
                let straight = direct * light.sources[source].radiance.iter().sum::<f64>();
                sums[source][0] += area * straight;
                sums[source][1] += area * value.iter().sum::<f64>();
                light.empty[source][k] = value;
            }
        }
        light.seen = sums.into_iter().any(|[straight, all]| straight > SEEN * all);
        light
    }

    /// What a node stands for of the floor beside the edges that is watched, relative to others: nodes are the denser the
    /// nearer to an edge's foot. Nothing for those that do not see what the floor sees there: some nodes look past the
    /// hidden face only, for what is between them before the opening.
    fn area_beside(&self, node: &FloorNode) -> f64 {
        let [x, y] = node.at;
        let (half, thickness) = (self.doorway.half_width(), self.doorway.wall_thickness_m);
        let (beside, before) = (x.abs() - half, -thickness - y);
        let face = |side: f64| if x * side > 0.0 { -thickness } else { 0.0 };
        let edge = |side: f64| (side * half - x).atan2(face(side) - y);
        let looks = [edge(-1.0), edge(1.0)].iter().zip(node.azimuths).all(|(edge, cut)| (edge - cut).abs() < 1e-9);
        let watched = (0.0..WATCHED_M).contains(&beside) && (0.0..WATCHED_M).contains(&before);
        if looks && watched { beside.hypot(before) } else { 0.0 }
    }

    /// Whether the floor beside the edges sees a lamp, a window or a television itself.
    pub(in crate::simulation) fn sees_a_source(&self) -> bool {
        self.seen
    }

    pub(in crate::simulation) fn floor(&self) -> &FloorMap {
        &self.floor
    }

    /// Each source's level: `seconds` count from the end of the empty time, `shown` from the first frame of all. Without
    /// that, everything that flickers has its mean.
    pub(in crate::simulation) fn levels(&self, seconds: f64, shown: Option<f64>, seed: u64) -> Vec<f64> {
        self.sources.iter().map(|source| source.level(seconds, shown, seed)).collect()
    }

    /// All light of one source at a node in the empty room.
    fn of_source(&self, source: usize, node: usize, direct: f64, row: &[f32]) -> Rgb {
        let mut light = self.sources[source].radiance.map(|c| c * direct);
        let texels = self.shell.texels.iter().zip(&self.exchange.texels[source]);
        for (weight, (texel, falls)) in row.iter().zip(texels).filter(|(weight, _)| **weight > 0.0) {
            (0..3).for_each(|c| light[c] += f64::from(*weight) * texel.albedo[c] / PI * falls[c]);
        }
        if self.floor.is_inside(node) {
            // Half of what such a point sees is the doorway's wall.
            (0..3).for_each(|c| light[c] += PI / 2.0 * self.exchange.front[source][c]);
        }
        light
    }

    /// The light on the floor with each source at its level, as values of [`FloorMap::refine`]. `visible` is the visible
    /// side's light, which falls on those of the people who are there.
    pub(in crate::simulation) fn light(&self, levels: &[f64], mut people: Vec<Person>, visible: Rgb) -> Vec<[f32; 3]> {
        let mut nodes: Vec<Rgb> = vec![[0.0; 3]; self.floor.nodes.len()];
        for (empty, level) in self.empty.iter().zip(levels) {
            for (node, empty) in nodes.iter_mut().zip(empty) {
                (0..3).for_each(|c| node[c] += level * empty[c]);
            }
        }
        people.retain(|person| self.is_near(person));
        if !people.is_empty() {
            self.light_people(levels, visible, &mut people);
            let now = self.now(levels, &mut people);
            let needed = nodes.par_iter_mut().enumerate().filter(|(k, _)| self.needed[*k]);
            needed.for_each_init(Scratch::default, |scratch, (k, node)| {
                let change = self.change(k, &people, &now, scratch);
                (0..3).for_each(|c| node[c] += change[c]);
            });
        }
        self.floor.refine(&nodes)
    }

    /// Whether somebody is in the room, or where they may stand in the light of the opening.
    fn is_near(&self, person: &Person) -> bool {
        let Part { centre: [x, y], radius, .. } = person.hull;
        match y {
            0.0.. => x.abs() < self.shell.half_width() + radius && y < self.shell.depth() + radius,
            _ => x.abs() < VISIBLE_M && y > -VISIBLE_M,
        }
    }

    /// Lights all people.
    fn light_people(&self, levels: &[f64], visible: Rgb, people: &mut [Person]) {
        let mut shown = vec![[0.0; 3]; self.shell.patches.len()];
        for (patches, level) in self.exchange.patches.iter().zip(levels).filter(|(_, level)| **level > 0.0) {
            for (sum, patch) in shown.iter_mut().zip(patches) {
                (0..3).for_each(|c| sum[c] += level * patch[c]);
            }
        }
        for k in 0..people.len() {
            let others: Vec<Part> = people
                .iter()
                .enumerate()
                .filter(|(other, _)| *other != k)
                .flat_map(|(_, other)| other.shade.iter().map(|(part, _)| *part))
                .collect();
            let places: Vec<(Vector, Vector)> = people[k].places().collect();
            let irradiance = places.into_par_iter().map(|(place, normal)| {
                // Within 0.3 m of the hidden face, the light of one side goes over into that of the other.
                let inside = ((place[1] + 0.3) / 0.6).clamp(0.0, 1.0);
                let room = if inside > 0.0 { on_place(place, normal, &self.shell.patches, &shown) } else { [0.0; 3] };
                let mut light = [0, 1, 2].map(|c| inside * room[c] + (1.0 - inside) * visible[c]);
                for tile in self.tiles.iter().filter(|tile| levels[tile.source] > 0.0) {
                    let direct = levels[tile.source] * self.on_body(tile, place, normal, &others);
                    (0..3).for_each(|c| light[c] += direct * self.sources[tile.source].radiance[c]);
                }
                light
            });
            people[k].irradiance = irradiance.collect();
        }
    }

    /// Direct irradiance from a tile at a place on somebody, for a radiance of 1.
    fn on_body(&self, tile: &Tile, place: Vector, normal: Vector, others: &[Part]) -> f64 {
        let (direct, _) = tile.irradiance(place, normal, 0.02);
        if direct <= 0.0 {
            return 0.0;
        }
        let (at, size) = tile.from(place);
        if !self.lets_through(at, place) || blocked(&self.shell.solids, place, at) {
            return 0.0;
        }
        direct * others.iter().map(|part| 1.0 - hidden_by_part(at, size, place, 0.02, part)).product::<f64>()
    }

    /// Whether the way from a place in the room to one of the visible side, or of the room, passes the opening.
    fn lets_through(&self, from: Vector, to: Vector) -> bool {
        if to[1] >= 0.0 {
            return true;
        }
        let share = from[1] / (from[1] - to[1]);
        let at = |k: usize| from[k] + share * (to[k] - from[k]);
        at(0).abs() < self.doorway.half_width() && at(2) < self.opening_height()
    }

    /// Without a lintel the opening ends at the ceiling: light from above it belongs to the visible side.
    pub(super) fn opening_height(&self) -> f64 {
        self.doorway.height_m.unwrap_or(f64::INFINITY).min(self.shell.ceiling())
    }

    /// The surfaces with people's shadows and the light that people take from them and give to them, and what all of them
    /// reflect less because of that. People get less of it, too.
    fn now(&self, levels: &[f64], people: &mut [Person]) -> Now {
        let Exchange { texels: all, indirect, direct, patches: shown, on_patches, .. } = &self.exchange;
        let level = |of: &[Vec<Rgb>], k: usize| {
            let mut sum = [0.0; 3];
            for (source, level) in of.iter().zip(levels).filter(|(_, level)| **level > 0.0) {
                (0..3).for_each(|c| sum[c] += level * source[k][c]);
            }
            sum
        };
        let patches = &self.shell.patches;
        let first: Vec<(Rgb, Rgb)> = (0..patches.len())
            .into_par_iter()
            .map(|k| {
                let patch = &patches[k];
                // What a black patch gets is not known from what it shows; it takes part in nothing anyway.
                let radiance = level(shown, k);
                let falls = [0, 1, 2].map(|c| PI * radiance[c] / patch.albedo[c].max(0.02));
                let straight = self.straight(levels, on_patches, k);
                let indirect = [0, 1, 2].map(|c| (falls[c] - straight[c]).max(0.0));
                (self.shadow(levels, people, on_patches, patch, k), given(people, patch, indirect))
            })
            .collect();
        let (shadows, taken): (Vec<Rgb>, Vec<Rgb>) = first.into_iter().unzip();
        let (late, mean) = self.exchange.response(patches, &shadows, &taken);
        for person in people.iter_mut().filter(|person| person.axis[1] > 0.0) {
            person
                .irradiance
                .iter_mut()
                .for_each(|light| (0..3).for_each(|c| light[c] = (light[c] + mean[c]).max(0.0)));
        }
        let people = &*people;
        let texels = self.shell.texels.par_iter().enumerate().map(|(k, texel)| {
            let still = level(all, k);
            let shadow = self.shadow(levels, people, direct, texel, k);
            let taken = given(people, texel, level(indirect, k));
            let change = [0, 1, 2].map(|c| (shadow[c] + taken[c] + late[k][c]).max(-still[c]));
            let shine = |light: Rgb| [0, 1, 2].map(|c| texel.albedo[c] / PI * light[c]);
            (shine([0, 1, 2].map(|c| still[c] + change[c])), shine(change))
        });
        let both: Vec<(Rgb, Rgb)> = texels.collect();
        Now {
            change: [0, 1, 2].map(|c| both.iter().map(|(_, change)| change[c] as f32).collect()),
            texels: both.into_iter().map(|(now, _)| now).collect(),
            levels: levels.to_vec(),
        }
    }

    /// What falls straight from all sources on a piece of surface in the empty room.
    fn straight(&self, levels: &[f64], direct: &[Vec<f32>], k: usize) -> Rgb {
        let mut sum = [0.0; 3];
        for (tile, direct) in self.tiles.iter().zip(direct) {
            let (light, radiance) = (levels[tile.source] * f64::from(direct[k]), self.sources[tile.source].radiance);
            (0..3).for_each(|c| sum[c] += radiance[c] * light);
        }
        sum
    }

    /// What people take of that: a negative irradiance.
    fn shadow(&self, levels: &[f64], people: &[Person], direct: &[Vec<f32>], texel: &Texel, k: usize) -> Rgb {
        let mut change = [0.0; 3];
        for (tile, direct) in self.tiles.iter().zip(direct) {
            let direct = levels[tile.source] * f64::from(direct[k]);
            if direct > 0.0 {
                let (at, size) = tile.from(texel.centre);
                let hides = |part: &Part| hidden_by_part(at, size, texel.centre, texel.half(), part);
                let free: f64 = people
                    .iter()
                    .filter(|person| hides(&person.hull) > 0.0)
                    .flat_map(|person| person.shade.iter().map(|(part, _)| 1.0 - hides(part)))
                    .product();
                let radiance = self.sources[tile.source].radiance;
                (0..3).for_each(|c| change[c] -= radiance[c] * direct * (1.0 - free));
            }
        }
        change
    }
}

/// What people give a piece of surface, less what they hide of the indirect light there.
fn given(people: &[Person], texel: &Texel, indirect: Rgb) -> Rgb {
    let mut sum = [0.0; 3];
    for person in people.iter().filter(|person| person.axis[1] > 0.0) {
        let given = exchanged(person, texel.centre, texel.normal, indirect);
        (0..3).for_each(|c| sum[c] += given[c]);
    }
    sum
}

/// The irradiance that somebody gives a place, less what they hide of the indirect light there.
fn exchanged(person: &Person, place: Vector, normal: Vector, indirect: Rgb) -> Rgb {
    let mut sum = [0.0; 3];
    for (part, albedo) in &person.shade {
        let tall = (part.top - part.bottom) / PIECES as f64;
        for k in 0..PIECES {
            let z = part.bottom + (k as f64 + 0.5) * tall;
            let d = [part.centre[0] - place[0], part.centre[1] - place[1], z - place[2]];
            let facing = d[0] * normal[0] + d[1] * normal[1] + d[2] * normal[2];
            if facing <= 0.0 {
                continue;
            }
            let flat2 = d[0] * d[0] + d[1] * d[1];
            let d2 = flat2 + d[2] * d[2];
            let outline = 2.0 * part.radius * tall;
            // The outline as a disc: bounded where it is close.
            let factor = facing * flat2.sqrt() * outline / (d2 * (PI * d2 + outline));
            let flat = flat2.sqrt().max(1e-6);
            let light = person.line([-d[0] / flat, -d[1] / flat]).at(z);
            (0..3).for_each(|c| sum[c] += factor * (albedo[c] * light[c] - indirect[c]));
        }
    }
    sum
}

#[cfg(test)]
#[path = "light_tests.rs"]
mod tests;
