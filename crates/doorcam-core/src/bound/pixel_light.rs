//! The integrals of eq. 9 and 10, with their derivatives by the target's place.

use super::point::Setup;
use super::quadrature::Rule;
use crate::geometry::{Doorway, Point, Side};

/// Light that one pixel receives from a point of unit brightness on the hidden floor.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct PixelLight {
    /// i_m of eq. 9 or 10 with c_s = 1.
    pub light: f64,
    /// Its derivatives by the target's x and y, per metre.
    pub by: Point,
}

/// The light of a target at `target` (metres in the door frame) on every pixel of a patch, row by row from the wall.
/// With `edge`, the patch's own edge blocks light at both faces of the wall; otherwise nothing does.
pub(super) fn patch_light(setup: &Setup, side: Side, edge: bool, target: Point) -> Vec<PixelLight> {
    match side {
        Side::Left => left(setup, edge, target),
        // The mirror image about x = 0.
        Side::Right => {
            let mut pixels = left(setup, edge, [-target[0], target[1]]);
            pixels.iter_mut().for_each(|pixel| pixel.by[0] = -pixel.by[0]);
            pixels.chunks_exact_mut(setup.pixels).for_each(<[_]>::reverse);
            pixels
        }
    }
}

fn left(setup: &Setup, edge: bool, target: Point) -> Vec<PixelLight> {
    let cell = setup.patch_m / setup.pixels as f64;
    let [foot_x, top] = [-setup.doorway.half_width(), -setup.doorway.wall_thickness_m];
    // The nearest floor points are on the wall's visible face.
    let rule = Rule::new(cell, target[1] - top);
    let shadow = edge.then(|| Shadow::new(&setup.doorway, target));
    let mut pixels = Vec::with_capacity(setup.pixels * setup.pixels);
    for row in 0..setup.pixels {
        for column in 0..setup.pixels {
            let least = [foot_x - setup.patch_m / 2.0 + column as f64 * cell, top - (row + 1) as f64 * cell];
            pixels.push(pixel(&rule, least, cell, target, shadow.as_ref()));
        }
    }
    pixels
}

fn pixel(rule: &Rule, least: Point, cell: f64, target: Point, shadow: Option<&Shadow>) -> PixelLight {
    let mut sum = PixelLight::default();
    let Some(shadow) = shadow else {
        rule.square(least, cell).for_each(|(at, weight)| sum.add(target, at, weight));
        return sum;
    };
    let [x, y] = least;
    let corners = [[x, y], [x + cell, y], [x + cell, y + cell], [x, y + cell]];
    let heights = corners.map(|corner| shadow.height(corner));
    if heights.iter().all(|&h| h >= 0.0) {
        rule.square(least, cell).for_each(|(at, weight)| sum.add(target, at, weight));
    } else if heights.iter().any(|&h| h > 0.0) {
        let (lit, count) = clip(corners, heights);
        for k in 2..count {
            rule.triangle([lit[0], lit[k - 1], lit[k]]).for_each(|(at, weight)| sum.add(target, at, weight));
        }
        let boundary = shadow.sweep(rule, least, cell);
        sum.by[0] += boundary * shadow.normal[0];
        sum.by[1] += boundary * shadow.normal[1];
    }
    sum
}

impl PixelLight {
    /// Adds the light at a floor point p that sees the target s, 1 / |p − s|², and its gradient in s,
    /// 2 (p − s) / |p − s|⁴.
    fn add(&mut self, target: Point, at: Point, weight: f64) {
        let d = [at[0] - target[0], at[1] - target[1]];
        let falloff = 1.0 / (d[0] * d[0] + d[1] * d[1]);
        self.light += weight * falloff;
        let slope = 2.0 * weight * falloff * falloff;
        self.by[0] += slope * d[0];
        self.by[1] += slope * d[1];
    }
}

/// The border of the left edge's shadow: the ray from the target through the wall corner that blocks the light.
struct Shadow {
    corner: Point,
    /// Unit vector along the ray, away from the target.
    along: Point,
    /// Unit vector across it, towards the lit floor.
    normal: Point,
    /// Distance ρ from the target to the corner.
    range: f64,
}

impl Shadow {
    fn new(doorway: &Doorway, target: Point) -> Self {
        let [x, hidden] = doorway.edge(Side::Left);
        // Behind the wall, its hidden face blocks the target's light; behind the opening, its visible face does.
        let corner = if target[0] < x { [x, hidden] } else { [x, -doorway.wall_thickness_m] };
        let d = [corner[0] - target[0], corner[1] - target[1]];
        let range = d[0].hypot(d[1]);
        let along = [d[0] / range, d[1] / range];
        Self { corner, along, normal: [-along[1], along[0]], range }
    }

    /// Distance from the border, positive where the floor is lit.
    fn height(&self, [x, y]: Point) -> f64 {
        (x - self.corner[0]) * self.normal[0] + (y - self.corner[1]) * self.normal[1]
    }

    /// The light that the pixel gains per metre that the target moves along the normal. The border then turns about the
    /// corner and, at distance r from it, moves backwards by r / ρ. With the light 1 / (ρ + r)² there, this is the
    /// boundary term of Leibniz's rule, ∫ r / (ρ (ρ + r)²) dr over the part of the ray that lies in the pixel.
    fn sweep(&self, rule: &Rule, least: Point, cell: f64) -> f64 {
        let (mut from, mut to) = (0.0_f64, f64::INFINITY);
        for (k, least) in least.into_iter().enumerate() {
            let ends = [least, least + cell].map(|side| side - self.corner[k]);
            if self.along[k] == 0.0 {
                // Parallel to these sides, and between them since the ray crosses the pixel.
                continue;
            }
            let [a, b] = ends.map(|end| end / self.along[k]);
            from = from.max(a.min(b));
            to = to.min(a.max(b));
        }
        if to <= from {
            return 0.0;
        }
        rule.segment(from, to).map(|(r, weight)| weight * r / (self.range * (self.range + r).powi(2))).sum()
    }
}

/// The part of a square where a height, given at its corners and linear in between, is positive. Returns the part's
/// corners in order and their number.
fn clip(corners: [Point; 4], heights: [f64; 4]) -> ([Point; 8], usize) {
    let (mut lit, mut count) = ([[0.0; 2]; 8], 0);
    let mut push = |point| {
        lit[count] = point;
        count += 1;
    };
    for k in 0..4 {
        let next = (k + 1) % 4;
        let (here, there) = (heights[k], heights[next]);
        if here >= 0.0 {
            push(corners[k]);
        }
        if (here > 0.0 && there < 0.0) || (here < 0.0 && there > 0.0) {
            let share = here / (here - there);
            push([0, 1].map(|axis| corners[k][axis] + share * (corners[next][axis] - corners[k][axis])));
        }
    }
    (lit, count)
}
