use std::f64::consts::TAU;

use super::super::figure::Part;
use super::super::visible::Body;
use doorcam_core::geometry::Point;
use doorcam_core::scene::Rgb;

/// Numbers of directions and heights for which the light on a person is calculated; it is interpolated between them.
pub(super) const AROUND: usize = 16;
pub(super) const UP: usize = 8;
/// The rounded end of a limb, which mostly lies in the next one, hides as much as a blunt one that is longer by this part
/// of its radius.
const END: f64 = 0.5;
/// Height of the head of a person without limbs, and its radius, in metres.
const HEAD_HEIGHT_M: f64 = 0.25;
const HEAD_RADIUS_M: f64 = 0.09;

/// Somebody in the room at one moment.
#[derive(Debug, Clone)]
pub(in crate::simulation) struct Person {
    pub(super) axis: Point,
    pub(super) height: f64,
    /// Radius of the cylinder on which the light on them is calculated.
    pub(super) radius: f64,
    /// What the floor sees of them: upright cylinders, each with its albedo.
    pub(super) parts: Vec<(Part, Rgb)>,
    /// The same with less detail, for shadows.
    pub(super) shade: Vec<(Part, Rgb)>,
    /// A cylinder around all of them.
    pub(super) hull: Part,
    /// Irradiance of surfaces that face away from the axis: `AROUND` x `UP`, heights first.
    pub(super) irradiance: Vec<Rgb>,
}

impl Person {
    /// Somebody who is a cylinder with another one on top as the head.
    pub(in crate::simulation) fn cylinder(axis: Point, radius: f64, height: f64, clothes: Rgb, skin: Rgb) -> Self {
        let neck = height - HEAD_HEIGHT_M;
        let body = Part { centre: axis, radius, bottom: 0.0, top: neck };
        let head = Part { centre: axis, radius: HEAD_RADIUS_M.min(0.8 * radius), bottom: neck, top: height };
        let parts = vec![(body, clothes), (head, skin)];
        Self::of(axis, parts.clone(), parts)
    }

    /// Somebody with legs, arms, trunk and head.
    pub(in crate::simulation) fn body(body: &Body) -> Self {
        let mut parts = Vec::with_capacity(24);
        for (capsule, albedo) in body.capsules() {
            let (a, b, r) = (capsule.from, capsule.to, capsule.radius);
            let across = (b[0] - a[0]).hypot(b[1] - a[1]);
            // Steps of at most half of the limb's radius, as far as possible.
            let count = ((2.0 * across / r).ceil() as usize).clamp(1, 6);
            for k in 0..count {
                let at = |share: f64| [0, 1, 2].map(|c| a[c] + share * (b[c] - a[c]));
                let (from, to) = (at(k as f64 / count as f64), at((k + 1) as f64 / count as f64));
                let middle = at((k as f64 + 0.5) / count as f64);
                let steep = (b[2] - a[2]).abs() > across;
                let [mut low, mut high] = [from[2].min(to[2]), from[2].max(to[2])];
                // A steep limb is longer by its ends; a level one is as thick as it is wide everywhere.
                if !steep || (if b[2] > a[2] { k == 0 } else { k + 1 == count }) {
                    low -= END * r;
                }
                if !steep || (if b[2] > a[2] { k + 1 == count } else { k == 0 }) {
                    high += END * r;
                }
                let bottom = low.max(0.0);
                if high > bottom + 1e-3 {
                    let bottom = if bottom < 1e-3 { 0.0 } else { bottom };
                    let part = Part { centre: [middle[0], middle[1]], radius: r, bottom, top: high };
                    parts.push((part, *albedo));
                }
            }
        }
        let axis = body.axis();
        Self::of(axis, parts, body.columns().to_vec())
    }

    fn of(axis: Point, parts: Vec<(Part, Rgb)>, shade: Vec<(Part, Rgb)>) -> Self {
        let all = || parts.iter().chain(&shade).map(|(part, _)| part);
        let away = |p: &Part| (p.centre[0] - axis[0]).hypot(p.centre[1] - axis[1]) + p.radius;
        let (reach, height) = all().fold((0.0_f64, 0.0_f64), |(r, h), p| (r.max(away(p)), h.max(p.top)));
        let radius = shade.iter().map(|(p, _)| p.radius).fold(0.0, f64::max);
        let hull = Part { centre: axis, radius: reach, bottom: 0.0, top: height };
        Self { axis, height, radius, parts, shade, hull, irradiance: Vec::new() }
    }

    /// The places for which light is calculated: place and normal.
    pub(super) fn places(&self) -> impl Iterator<Item = ([f64; 3], [f64; 3])> + '_ {
        (0..AROUND * UP).map(|k| {
            let turn = (k / UP) as f64 / AROUND as f64 * TAU;
            let normal = [turn.cos(), turn.sin(), 0.0];
            let z = (k % UP) as f64 / (UP - 1) as f64 * self.height;
            ([self.axis[0] + self.radius * normal[0], self.axis[1] + self.radius * normal[1], z], normal)
        })
    }

    /// Irradiance up a part where `normal`, a unit vector, points away from its axis.
    pub(super) fn line(&self, normal: Point) -> Line<'_> {
        let turn = normal[1].atan2(normal[0]).rem_euclid(TAU) / TAU * AROUND as f64;
        let i = turn as usize % AROUND;
        let line = |i: usize| &self.irradiance[i * UP..][..UP];
        Line { lines: [line(i), line((i + 1) % AROUND)], beside: turn.fract(), height: self.height }
    }
}

/// Irradiance along a vertical line, interpolated between two known ones.
#[derive(Clone, Copy)]
pub(super) struct Line<'a> {
    lines: [&'a [Rgb]; 2],
    beside: f64,
    height: f64,
}

impl Line<'_> {
    /// Irradiance at height z.
    pub(super) fn at(&self, z: f64) -> Rgb {
        let up = (z / self.height).clamp(0.0, 1.0) * (UP - 1) as f64;
        let j = (up as usize).min(UP - 2);
        let (a, b) = (self.beside, up - j as f64);
        let [near, far] = self.lines;
        let between = |low: f64, high: f64, t: f64| low + (high - low) * t;
        [0, 1, 2].map(|c| between(between(near[j][c], near[j + 1][c], b), between(far[j][c], far[j + 1][c], b), a))
    }
}
