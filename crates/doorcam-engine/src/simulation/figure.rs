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

/// A vertical cylinder. Most stand on the floor; the head is extended down to it, and the body hides most of that.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Part {
    pub(super) centre: Point,
    pub(super) radius: f64,
    /// Height of its bottom above the floor, in metres: 0 if it stands on the floor.
    pub(super) bottom: f64,
    /// Height of its top above the floor, in metres.
    pub(super) top: f64,
}

/// The light that falls on somebody besides the lamps' own: the room's ambient light, and that of the visible side.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Ambient {
    pub(super) room: Rgb,
    pub(super) visible: Rgb,
}

/// The opening between the two sides, through which a lamp lights those who are not in the room.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Opening {
    pub(super) half_width: f64,
    pub(super) height: f64,
}

impl Opening {
    /// Whether the straight way from a place in the room to one of the visible side, or of the room, is free.
    fn lets_through(&self, from: Vector, to: Vector) -> bool {
        if to[1] >= 0.0 {
            return true;
        }
        let share = from[1] / (from[1] - to[1]);
        let at = |k: usize| from[k] + share * (to[k] - from[k]);
        at(0).abs() < self.half_width && at(2) < self.height
    }
}

/// Somebody in the room at one moment.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Figure {
    /// Body and head, or legs, trunk and head.
    pub(super) parts: Vec<Part>,
    /// Their albedo.
    albedo: Vec<Rgb>,
    /// Radiance of each part at `AROUND` x `UP` places, heights first.
    radiance: Vec<Vec<Rgb>>,
}

impl Figure {
    pub(super) fn new(centre: Point, radius: f64, height: f64, clothes: Rgb, skin: Rgb) -> Self {
        let body = Part { centre, radius, bottom: 0.0, top: height - HEAD_HEIGHT_M };
        let head = Part { centre, radius: HEAD_RADIUS_M.min(0.8 * radius), bottom: 0.0, top: height };
        Self::of_parts(vec![(body, clothes), (head, skin)])
    }

    /// Somebody made of these parts, each with its albedo.
    pub(super) fn of_parts(parts: Vec<(Part, Rgb)>) -> Self {
        let (parts, albedo): (Vec<Part>, Vec<Rgb>) = parts.into_iter().unzip();
        Self { radiance: vec![Vec::new(); parts.len()], parts, albedo }
    }

    /// Lights the person: `lamps` at their `levels`, with the shadows of `others`, and `ambient` irradiance from
    /// everywhere. Who is in the doorway or before it is lit by the lamps that are seen through the `opening`.
    pub(super) fn light(
        &mut self,
        lamps: &[Lamp],
        levels: &[f64],
        ambient: Ambient,
        opening: Opening,
        others: &[Part],
    ) {
        for (k, part) in self.parts.iter().enumerate() {
            let albedo = self.albedo[k];
            // Within 0.3 m of the hidden face, the light of one side goes over into that of the other.
            let inside = ((part.centre[1] + 0.3) / 0.6).clamp(0.0, 1.0);
            let ambient: Rgb = [0, 1, 2].map(|c| inside * ambient.room[c] + (1.0 - inside) * ambient.visible[c]);
            self.radiance[k] = (0..AROUND * UP)
                .map(|place| {
                    let turn = (place / UP) as f64 / AROUND as f64 * TAU;
                    let normal = [turn.cos(), turn.sin(), 0.0];
                    let z = part.bottom + (place % UP) as f64 / (UP - 1) as f64 * (part.top - part.bottom);
                    let at: Vector =
                        [part.centre[0] + part.radius * normal[0], part.centre[1] + part.radius * normal[1], z];
                    let mut light = ambient;
                    for (lamp, level) in lamps.iter().zip(levels).filter(|(_, level)| **level > 0.0) {
                        let direct = lamp.irradiance(at, normal);
                        if direct > 0.0 && opening.lets_through(lamp.at, at) {
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
        Column { lines: [line(i), line(i + 1)], beside: turn.fract(), part: &self.parts[part] }
    }
}

/// Radiance along a vertical line, interpolated between two known ones.
pub(super) struct Column<'a> {
    lines: [&'a [Rgb]; 2],
    beside: f64,
    part: &'a Part,
}

impl Column<'_> {
    /// Radiance at height z.
    pub(super) fn at(&self, z: f64) -> Rgb {
        let Part { bottom, top, .. } = *self.part;
        let up = ((z - bottom) / (top - bottom)).clamp(0.0, 1.0) * (UP - 1) as f64;
        let j = (up as usize).min(UP - 2);
        let (a, b) = (self.beside, up - j as f64);
        let [near, far] = self.lines;
        let between = |low: f64, high: f64, t: f64| low + (high - low) * t;
        [0, 1, 2].map(|c| between(between(near[j][c], near[j + 1][c], b), between(far[j][c], far[j + 1][c], b), a))
    }
}

impl Part {
    /// Distances along a horizontal ray to its front and back; none if the ray misses it. From inside a cylinder that
    /// stands on the floor, nothing is met; below one that does not, the front is at 0.
    pub(super) fn meet(&self, from: Point, ray: Point) -> Option<[f64; 2]> {
        let centre = [self.centre[0] - from[0], self.centre[1] - from[1]];
        let beside = ray[0] * centre[1] - ray[1] * centre[0];
        let chord2 = self.radius * self.radius - beside * beside;
        let middle = centre[0] * ray[0] + centre[1] * ray[1];
        let half = chord2.max(0.0).sqrt();
        let (front, back) = (middle - half, middle + half);
        let outside = front > 0.0 || (self.bottom > 0.0 && back > 0.0);
        (chord2 > 0.0 && outside).then_some([front.max(0.0), back])
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
