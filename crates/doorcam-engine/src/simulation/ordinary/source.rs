use std::f64::consts::PI;

use super::super::room::Vector;
use super::super::scenario::{LampKind, LampSpec, Scenario, WallName, in_force};
use super::spec::{LampFacing, SunSpec, WindowSpec};
use doorcam_core::geometry::Point;
use doorcam_core::scene::Rgb;

/// Largest side of the tiles for which a source's light on surfaces is summed, in metres, and most of them in a row.
const TILE_M: f64 = 0.35;
const MOST_TILES: usize = 6;
/// Least radius of a bulb, in metres: the floor's samples do not show the shadows of a smaller one.
const LEAST_BULB_M: f64 = 0.03;
/// Angular radius of the sun.
const SUN: f64 = 0.0047;

/// What a source looks like from the floor.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Shape {
    /// An upright rectangle from one point of the floor plan to another that shines to the right of that way.
    Upright {
        from: Point,
        to: Point,
        up: [f64; 2],
    },
    /// A level rectangle that shines downwards.
    Level {
        centre: Point,
        half: Point,
        z: f64,
    },
    /// A level disc that shines downwards.
    Disc {
        centre: Point,
        radius: f64,
        z: f64,
    },
    Ball {
        at: Vector,
        radius: f64,
    },
    /// The sun: no floor point before the doorway sees it.
    Beam,
}

/// A piece of a source whose light on surfaces is that of a point.
#[derive(Debug, Clone, Copy)]
pub(super) struct Tile {
    pub(super) source: usize,
    kind: TileKind,
}

#[derive(Debug, Clone, Copy)]
enum TileKind {
    Flat {
        at: Vector,
        normal: Vector,
        area: f64,
    },
    Ball {
        at: Vector,
        radius: f64,
    },
    /// Parallel light in that direction, through a rectangle in the plane of a wall.
    Beam {
        towards: Vector,
        window: [Vector; 3],
    },
}

/// Something that shines: a lamp, a window, its sun, a television.
#[derive(Debug, Clone)]
pub(super) struct Source {
    /// Radiance; of the sun, irradiance of a surface that faces it.
    pub(super) radiance: Rgb,
    shape: Shape,
    level: Level,
}

#[derive(Debug, Clone)]
enum Level {
    Switched(Vec<(f64, f64)>),
    Television { number: u64, flicker: f64 },
}

/// Lamps first, in the scenario's order, then windows and their suns, then televisions.
pub(super) fn all(scenario: &Scenario) -> (Vec<Source>, Vec<Tile>) {
    let room = &scenario.room;
    let mut sources = Vec::new();
    let mut tiles = Vec::new();
    for spec in &scenario.lamp {
        let (shape, kinds, area) = lamp(spec);
        let radiance = spec.rgb.map(|c| c / area);
        let source = sources.len();
        sources.push(Source { radiance, shape, level: Level::Switched(spec.switch.clone()) });
        tiles.extend(kinds.into_iter().map(|kind| Tile { source, kind }));
    }
    for spec in &scenario.window {
        let (shape, kinds) = on_wall(spec.wall, spec.along_m, spec.up_m, room.half_width_m, room.depth_m);
        let level = || Level::Switched(spec.switch.clone());
        let source = sources.len();
        sources.push(Source { radiance: spec.sky, shape, level: level() });
        tiles.extend(kinds.into_iter().map(|kind| Tile { source, kind }));
        if let Some(sun) = &spec.sun {
            tiles.push(Tile { source: sources.len(), kind: beam(spec, sun, room.half_width_m, room.depth_m) });
            sources.push(Source { radiance: sun.rgb, shape: Shape::Beam, level: level() });
        }
    }
    for (number, spec) in (0..).zip(&scenario.television) {
        let (shape, kinds) = on_wall(spec.wall, spec.along_m, spec.up_m, room.half_width_m, room.depth_m);
        let source = sources.len();
        let level = Level::Television { number, flicker: spec.flicker };
        sources.push(Source { radiance: spec.rgb, shape, level });
        tiles.extend(kinds.into_iter().map(|kind| Tile { source, kind }));
    }
    (sources, tiles)
}

/// A lamp's shape, tiles and area over which its intensity is spread.
fn lamp(spec: &LampSpec) -> (Shape, Vec<TileKind>, f64) {
    let [x, y, z] = spec.at_m;
    match (spec.kind, spec.size_m) {
        (LampKind::Panel, Some([a, b])) => {
            let (along, up, normal): (Vector, Vector, Vector) = match spec.faces {
                LampFacing::Down => ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]),
                LampFacing::Left => ([0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]),
                LampFacing::Right => ([0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]),
                LampFacing::Back => ([1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]),
                LampFacing::Front => ([1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]),
            };
            let end = |way: f64| [x + way * a / 2.0 * along[0], y + way * a / 2.0 * along[1]];
            let up_m = [z - b / 2.0, z + b / 2.0];
            let shape = match spec.faces {
                LampFacing::Down => Shape::Level { centre: [x, y], half: [a / 2.0, b / 2.0], z },
                // So that it shines to the right of the way.
                LampFacing::Right | LampFacing::Front => Shape::Upright { from: end(-1.0), to: end(1.0), up: up_m },
                LampFacing::Left | LampFacing::Back => Shape::Upright { from: end(1.0), to: end(-1.0), up: up_m },
            };
            (shape, tiled(spec.at_m, along, up, normal, [a, b]), a * b)
        }
        (LampKind::Panel, None) => {
            let r = spec.radius_m.max(LEAST_BULB_M);
            let side = r * PI.sqrt();
            let shape = Shape::Disc { centre: [x, y], radius: r, z };
            let tiles = tiled(spec.at_m, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [side, side]);
            (shape, tiles, PI * r * r)
        }
        (LampKind::Bulb, _) => {
            let radius = spec.radius_m.max(LEAST_BULB_M);
            (
                Shape::Ball { at: spec.at_m, radius },
                vec![TileKind::Ball { at: spec.at_m, radius }],
                PI * radius * radius,
            )
        }
    }
}

fn tiled(centre: Vector, along: Vector, up: Vector, normal: Vector, size: [f64; 2]) -> Vec<TileKind> {
    let count = size.map(|side| ((side / TILE_M).ceil() as usize).clamp(1, MOST_TILES));
    let area = size[0] * size[1] / (count[0] * count[1]) as f64;
    let offset = |k: usize, axis: usize| ((k as f64 + 0.5) / count[axis] as f64 - 0.5) * size[axis];
    (0..count[0] * count[1])
        .map(|k| {
            let (a, b) = (offset(k % count[0], 0), offset(k / count[0], 1));
            TileKind::Flat { at: [0, 1, 2].map(|c| centre[c] + a * along[c] + b * up[c]), normal, area }
        })
        .collect()
}

/// Corner, direction along and normal of a wall, and where along it begins.
fn wall(name: WallName, w: f64, d: f64) -> (Vector, Vector, Vector) {
    match name {
        WallName::Left => ([-w, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]),
        WallName::Back => ([0.0, d, 0.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]),
        WallName::Right => ([w, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]),
    }
}

fn on_wall(name: WallName, along_m: [f64; 2], up_m: [f64; 2], w: f64, d: f64) -> (Shape, Vec<TileKind>) {
    let (origin, along, normal) = wall(name, w, d);
    let place = |a: f64, z: f64| [origin[0] + a * along[0], origin[1] + a * along[1], z];
    let middle = place((along_m[0] + along_m[1]) / 2.0, (up_m[0] + up_m[1]) / 2.0);
    let size = [along_m[1] - along_m[0], up_m[1] - up_m[0]];
    let ends = along_m.map(|a| [place(a, 0.0)[0], place(a, 0.0)[1]]);
    let [from, to] = if name == WallName::Right { [ends[1], ends[0]] } else { ends };
    (Shape::Upright { from, to, up: up_m }, tiled(middle, along, [0.0, 0.0, 1.0], normal, size))
}

fn beam(spec: &WindowSpec, sun: &SunSpec, w: f64, d: f64) -> TileKind {
    let (origin, along, _) = wall(spec.wall, w, d);
    let corner = |a: f64, z: f64| [origin[0] + a * along[0], origin[1] + a * along[1], z];
    let ([a, b], [low, high]) = (spec.along_m, spec.up_m);
    let length = sun.towards.iter().map(|c| c * c).sum::<f64>().sqrt().max(1e-9);
    let window = [corner(a, low), corner(b, low), corner(a, high)];
    TileKind::Beam { towards: sun.towards.map(|c| c / length), window }
}

/// Whether the sun of a window shines on a place, if nothing else is in the way.
pub(super) fn sunlit(spec: &WindowSpec, sun: &SunSpec, half_width: f64, depth: f64, place: Vector) -> bool {
    Tile { source: 0, kind: beam(spec, sun, half_width, depth) }.irradiance(place, [0.0; 3], 0.0).1
}

impl Source {
    /// Distance of what a horizontal ray meets of it, and the sin² of the elevations between which it is seen; none if
    /// it is not, or only from behind.
    pub(super) fn meet(&self, at: Point, ray: Point) -> Option<(f64, [f64; 2])> {
        let sine_squared = |z: f64, d: f64| z * z / (z * z + d * d);
        match self.shape {
            Shape::Upright { from, to, up } => {
                let along = [to[0] - from[0], to[1] - from[1]];
                let foot = [from[0] - at[0], from[1] - at[1]];
                let across = ray[0] * along[1] - ray[1] * along[0];
                // It shines to the right of `along`, which is seen by who looks to the left of it.
                if across >= -1e-12 {
                    return None;
                }
                let distance = (foot[0] * along[1] - foot[1] * along[0]) / across;
                let share = (foot[0] * ray[1] - foot[1] * ray[0]) / across;
                let seen = distance > 0.0 && (0.0..=1.0).contains(&share);
                seen.then(|| (distance, up.map(|z| sine_squared(z, distance))))
            }
            Shape::Level { centre, half, z } => {
                let mut range = [0.0_f64, f64::INFINITY];
                for k in 0..2 {
                    let d = centre[k] - at[k];
                    if ray[k].abs() < 1e-12 {
                        if d.abs() > half[k] {
                            return None;
                        }
                        continue;
                    }
                    let ends = [(d - half[k]) / ray[k], (d + half[k]) / ray[k]];
                    range = [range[0].max(ends[0].min(ends[1])), range[1].min(ends[0].max(ends[1]))];
                }
                let [near, far] = range;
                (near < far).then(|| (near, [sine_squared(z, far), sine_squared(z, near)]))
            }
            Shape::Disc { centre, radius, z } => {
                let d = [centre[0] - at[0], centre[1] - at[1]];
                let (middle, beside) = (d[0] * ray[0] + d[1] * ray[1], d[0] * ray[1] - d[1] * ray[0]);
                let half = (radius * radius - beside * beside).max(0.0).sqrt();
                let (near, far) = ((middle - half).max(0.0), middle + half);
                (half > 0.0 && far > 0.0).then(|| (near, [sine_squared(z, far), sine_squared(z, near)]))
            }
            Shape::Ball { at: centre, radius } => {
                let d = [centre[0] - at[0], centre[1] - at[1]];
                let (middle, beside) = (d[0] * ray[0] + d[1] * ray[1], d[0] * ray[1] - d[1] * ray[0]);
                let cut = (radius * radius - beside * beside).max(0.0).sqrt();
                let range = middle.hypot(centre[2]);
                if cut <= 0.0 || middle <= 0.0 || range <= cut {
                    return None;
                }
                let (up, half) = (centre[2].atan2(middle), (cut / range).asin());
                let s = [(up - half).max(0.0), (up + half).min(PI / 2.0)].map(|e| e.sin().powi(2));
                Some(((middle - cut).max(0.0), s))
            }
            Shape::Beam => None,
        }
    }

    /// Points of the floor plan at which it may begin and end, seen from a floor point.
    pub(super) fn ends(&self, at: Point) -> Vec<Point> {
        let round = |centre: Point, radius: f64| {
            let d = [centre[0] - at[0], centre[1] - at[1]];
            let range = d[0].hypot(d[1]).max(radius * 1.001);
            // The points of contact.
            let (along, across) =
                (1.0 - (radius / range).powi(2), radius / range * (1.0 - (radius / range).powi(2)).sqrt());
            [-1.0, 1.0, 0.0]
                .map(|way| [at[0] + along * d[0] - way * across * d[1], at[1] + along * d[1] + way * across * d[0]])
        };
        match self.shape {
            Shape::Upright { from, to, .. } => vec![from, to],
            Shape::Level { centre, half, .. } => [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]
                .map(|[a, b]| [centre[0] + a * half[0], centre[1] + b * half[1]])
                .to_vec(),
            Shape::Disc { centre, radius, .. } => round(centre, radius).to_vec(),
            Shape::Ball { at: [x, y, _], radius } => round([x, y], radius).to_vec(),
            Shape::Beam => Vec::new(),
        }
    }

    /// Its level: `seconds` count from the end of the empty time, `shown` from the first frame of all; without that, a
    /// television has its mean.
    pub(super) fn level(&self, seconds: f64, shown: Option<f64>, seed: u64) -> f64 {
        match &self.level {
            Level::Switched(switch) => in_force(switch, seconds),
            Level::Television { number, flicker } => {
                shown.map_or(1.0, |shown| 1.0 + flicker * television(seed ^ (number << 32), shown))
            }
        }
    }
}

/// Mean time between a television's cuts, in seconds.
const CUT_S: f64 = 1.1;

/// What a television shows, from −1 to 1: another level after each cut, and a little movement within each scene.
fn television(seed: u64, seconds: f64) -> f64 {
    let random = |k: i64, salt: u64| {
        // SplitMix64.
        let mut z = seed ^ (k as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ salt.wrapping_mul(0xc2b2_ae3d_27d4_eb4f);
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    };
    let place = (seconds / CUT_S).floor() as i64;
    // One cut in each span of time, somewhere in it.
    let cut = (place as f64 + random(place, 1)) * CUT_S;
    let scene = if seconds < cut { place - 1 } else { place };
    let movement = 0.15 * (std::f64::consts::TAU * (0.7 * seconds + random(scene, 3))).sin();
    (0.85 * (2.0 * random(scene, 2) - 1.0) + movement).clamp(-1.0, 1.0)
}

impl Tile {
    /// Irradiance of a surface at a place, for a radiance of 1, if nothing is in the way; and whether any light comes
    /// this way, whatever the surface faces.
    pub(super) fn irradiance(&self, place: Vector, normal: Vector, half: f64) -> (f64, bool) {
        match self.kind {
            TileKind::Flat { at, normal: out, area } => {
                let d = [0, 1, 2].map(|k| at[k] - place[k]);
                let d2 = dot(d, d).max(0.2 * area);
                let (facing, shining) = (dot(d, normal), -dot(d, out));
                let light = if facing > 0.0 && shining > 0.0 { area * facing * shining / (d2 * d2) } else { 0.0 };
                (light, shining > 0.0)
            }
            TileKind::Ball { at, radius } => {
                let d = [0, 1, 2].map(|k| at[k] - place[k]);
                let d2 = dot(d, d).max(radius * radius);
                (PI * radius * radius * dot(d, normal).max(0.0) / (d2 * d2.sqrt()), true)
            }
            TileKind::Beam { towards, window: [corner, along, up] } => {
                let edge = |end: Vector| [0, 1, 2].map(|k| end[k] - corner[k]);
                let (a, b) = (edge(along), edge(up));
                let plane = cross(a, b);
                let foot = [0, 1, 2].map(|k| corner[k] - place[k]);
                let distance = dot(foot, plane) / dot(towards, plane);
                if distance.is_nan() || distance <= 0.0 {
                    return (0.0, false);
                }
                let hit = [0, 1, 2].map(|k| distance * towards[k] - foot[k]);
                // The surface element that the place stands for softens the border.
                let soft = half.max(SUN * distance);
                let inside = |axis: Vector| {
                    let length = dot(axis, axis).sqrt();
                    let at = dot(hit, axis) / length;
                    let ramp = |x: f64| (0.5 + x / (2.0 * soft.max(1e-6))).clamp(0.0, 1.0);
                    ramp(at) * ramp(length - at)
                };
                let through = inside(a) * inside(b);
                (through * dot(towards, normal).max(0.0), through > 0.0)
            }
        }
    }

    /// Where its light comes from, seen from a place, and half of its size there.
    pub(super) fn from(&self, place: Vector) -> (Vector, f64) {
        match self.kind {
            TileKind::Flat { at, area, .. } => (at, (area / PI).sqrt()),
            TileKind::Ball { at, radius } => (at, radius),
            TileKind::Beam { towards, window: [corner, along, up] } => {
                let edge = |end: Vector| [0, 1, 2].map(|k| end[k] - corner[k]);
                let plane = cross(edge(along), edge(up));
                let foot = [0, 1, 2].map(|k| corner[k] - place[k]);
                let distance = dot(foot, plane) / dot(towards, plane);
                ([0, 1, 2].map(|k| place[k] + distance * towards[k]), SUN * distance)
            }
        }
    }

    /// All the light that it gives, for a radiance of 1.
    #[cfg(test)]
    pub(super) fn flux(&self) -> f64 {
        match self.kind {
            TileKind::Flat { area, .. } => PI * area,
            TileKind::Ball { radius, .. } => 4.0 * PI * PI * radius * radius,
            TileKind::Beam { towards, window: [corner, along, up] } => {
                let edge = |end: Vector| [0, 1, 2].map(|k| end[k] - corner[k]);
                dot(cross(edge(along), edge(up)), towards).abs()
            }
        }
    }
}

pub(super) fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: Vector, b: Vector) -> Vector {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}
