use std::f64::consts::{PI, TAU};

use super::lamp::Lamp;
use super::room::Vector;
use doorcam_core::geometry::Point;
use doorcam_core::scene::Rgb;

/// Radius and height of a head, in metres.
const HEAD_RADIUS_M: f64 = 0.09;
const HEAD_HEIGHT_M: f64 = 0.25;
/// Numbers of places around and up a person for which light is calculated; it is interpolated between them.
const AROUND: usize = 24;
const UP: usize = 8;

/// A vertical cylinder on the floor: the body, or the head extended down to the floor, most of which the body hides.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Part {
    pub(super) centre: Point,
    pub(super) radius: f64,
    /// Height of its top above the floor, in metres.
    pub(super) top: f64,
}

/// Somebody in the room at one moment.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Figure {
    /// Body and head.
    pub(super) parts: [Part; 2],
    /// Their albedo.
    albedo: [Rgb; 2],
    /// Radiance of each part at `AROUND` x `UP` places, heights first.
    radiance: [Vec<Rgb>; 2],
}

impl Figure {
    pub(super) fn new(centre: Point, radius: f64, height: f64, clothes: Rgb, skin: Rgb) -> Self {
        let body = Part { centre, radius, top: height - HEAD_HEIGHT_M };
        let head = Part { centre, radius: HEAD_RADIUS_M.min(0.8 * radius), top: height };
        Self { parts: [body, head], albedo: [clothes, skin], radiance: [Vec::new(), Vec::new()] }
    }

    /// Lights the person: `lamps` at their `levels`, with the shadows of `others`, and `ambient` irradiance from
    /// everywhere.
    pub(super) fn light(&mut self, lamps: &[Lamp], levels: &[f64], ambient: Rgb, others: &[Part]) {
        for (k, part) in self.parts.iter().enumerate() {
            let albedo = self.albedo[k];
            self.radiance[k] = (0..AROUND * UP)
                .map(|place| {
                    let turn = (place / UP) as f64 / AROUND as f64 * TAU;
                    let normal = [turn.cos(), turn.sin(), 0.0];
                    let z = (place % UP) as f64 / (UP - 1) as f64 * part.top;
                    let at: Vector =
                        [part.centre[0] + part.radius * normal[0], part.centre[1] + part.radius * normal[1], z];
                    let mut light = ambient;
                    for (lamp, level) in lamps.iter().zip(levels).filter(|(_, level)| **level > 0.0) {
                        let direct = lamp.irradiance(at, normal);
                        if direct > 0.0 {
                            let seen = level * direct * (1.0 - lamp.hidden_by(at, 0.02, others.iter()));
                            (0..3).for_each(|c| light[c] += lamp.intensity[c] * seen);
                        }
                    }
                    [0, 1, 2].map(|c| albedo[c] / PI * light[c])
                })
                .collect();
        }
    }

    /// The visible vertical line of a part's surface where `normal`, a unit vector, points away from the axis.
    pub(super) fn column(&self, part: usize, normal: Point) -> Column<'_> {
        let turn = normal[1].atan2(normal[0]).rem_euclid(TAU) / TAU * AROUND as f64;
        let line = |i: usize| &self.radiance[part][i % AROUND * UP..][..UP];
        let i = turn as usize;
        Column { lines: [line(i), line(i + 1)], beside: turn.fract(), top: self.parts[part].top }
    }
}

/// Radiance along a vertical line, interpolated between two known ones.
pub(super) struct Column<'a> {
    lines: [&'a [Rgb]; 2],
    beside: f64,
    top: f64,
}

impl Column<'_> {
    /// Radiance at height z.
    pub(super) fn at(&self, z: f64) -> Rgb {
        let up = (z / self.top).clamp(0.0, 1.0) * (UP - 1) as f64;
        let j = (up as usize).min(UP - 2);
        let (a, b) = (self.beside, up - j as f64);
        let [near, far] = self.lines;
        let between = |low: f64, high: f64, t: f64| low + (high - low) * t;
        [0, 1, 2].map(|c| between(between(near[j][c], near[j + 1][c], b), between(far[j][c], far[j + 1][c], b), a))
    }
}

impl Part {
    /// Distance along a horizontal ray to its front; none if the ray misses it.
    pub(super) fn meet(&self, from: Point, ray: Point) -> Option<f64> {
        let centre = [self.centre[0] - from[0], self.centre[1] - from[1]];
        let beside = ray[0] * centre[1] - ray[1] * centre[0];
        let chord2 = self.radius * self.radius - beside * beside;
        let distance = centre[0] * ray[0] + centre[1] * ray[1] - chord2.max(0.0).sqrt();
        (chord2 > 0.0 && distance > 0.0).then_some(distance)
    }

    /// The azimuths of its two sides (0 into the room, positive to the right); none from inside it.
    pub(super) fn outline(&self, from: Point) -> Option<[f64; 2]> {
        let centre = [self.centre[0] - from[0], self.centre[1] - from[1]];
        let range = centre[0].hypot(centre[1]);
        let half = (self.radius < range).then(|| (self.radius / range).asin())?;
        let middle = centre[0].atan2(centre[1]);
        Some([middle - half, middle + half])
    }
}
