//! Light from objects that are not on the grid: a person's outline, and smooth light from the walls.
//!
//! With azimuth φ and elevation ε, a Lambertian surface of radiance L adds L sin ε cos ε dε dφ to a floor point (the
//! factor albedo / π is left out, as everywhere). Something of height H that stands on the floor at distance ρ fills
//! the elevations with tan ε <= H / ρ, so each azimuth of it adds ½ L H² / (ρ² + H²): eq. 2 with the radiometric law,
//! integrated over height in closed form.

use crate::geometry::{Doorway, Point, Room};

/// A person, modelled as a vertical cylinder on the floor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Body {
    /// Its axis, in metres in the door frame.
    pub centre: Point,
    /// Its radius, in metres.
    pub radius_m: f64,
    /// Its height, in metres.
    pub height_m: f64,
}

/// A floor point of the visible side and the range of azimuths, in radians, in which it sees the hidden room through
/// both faces of the wall. Azimuth 0 points straight into the room, positive to the right. The door's leaf hides what is
/// behind it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FloorView {
    point: Point,
    first: f64,
    last: f64,
    leaf: Option<LeafView>,
}

impl FloorView {
    /// The view from a floor point, in metres in the door frame. The range is empty if the point sees nothing.
    pub fn new(doorway: &Doorway, point: Point) -> Self {
        let [x, y] = point;
        let half = doorway.half_width();
        let faces = [-doorway.wall_thickness_m - y, -y];
        let first = faces.iter().map(|&d| (-half - x).atan2(d)).fold(f64::NEG_INFINITY, f64::max);
        let last = faces.iter().map(|&d| (half - x).atan2(d)).fold(f64::INFINITY, f64::min);
        Self { point, first, last, leaf: doorway.leaf_ends().map(|ends| LeafView::new(point, ends)) }
    }

    /// Light from a body of unit radiance (per steradian): the visible part of its outline's azimuths, times
    /// ½ H² / (ρ² + H²) at its axis or at the lintel, whichever is lower. The leaf is taken for higher than anybody: it
    /// hides all of what is farther away than itself.
    pub fn body(&self, doorway: &Doorway, body: &Body) -> f64 {
        let [from, to] = self.outline(body);
        let distance2 = self.distance2(body);
        let hidden = self.leaf.map_or(0.0, |leaf| leaf.hidden(from, to, distance2));
        let seen = to - from - hidden;
        if seen <= 0.0 {
            return 0.0;
        }
        let dy = body.centre[1] - self.point[1];
        0.5 * seen * share(body.height_m, distance2).min(self.lintel(doorway, dy * dy / distance2))
    }

    /// The part of a body's outline that is seen through the opening, as azimuths, leaf or not; the second is not larger than the first if nothing is seen.
    pub(crate) fn outline(&self, body: &Body) -> [f64; 2] {
        let (dx, dy) = (body.centre[0] - self.point[0], body.centre[1] - self.point[1]);
        let half = (body.radius_m / dx.hypot(dy)).min(1.0).asin();
        let middle = dx.atan2(dy);
        [(middle - half).max(self.first), (middle + half).min(self.last)]
    }

    /// Squared distance of a body's axis on the floor plan, in m².
    pub(crate) fn distance2(&self, body: &Body) -> f64 {
        (body.centre[0] - self.point[0]).powi(2) + (body.centre[1] - self.point[1]).powi(2)
    }

    /// The range of azimuths in which the hidden room is seen; empty if the second is not larger than the first.
    pub(crate) fn azimuths(&self) -> [f64; 2] {
        [self.first, self.last]
    }

    pub(crate) fn point(&self) -> Point {
        self.point
    }

    /// Light from walls of height `height_m`, one value per mode. In mode k, the walls' radiance is cos(k (a + π/2)) at
    /// the azimuth a seen from the middle of the doorway. The modes model the smooth changes that a person's shadows
    /// and reflections cause. The leaf is one of the walls, up to the lintel; above it, there is what is behind.
    pub fn walls(&self, doorway: &Doorway, room: &Room, height_m: f64, modes: &mut [f64]) {
        /// Azimuths in the sum. The integrand has at most `modes` half waves.
        const NODES: usize = 64;
        modes.fill(0.0);
        if self.last <= self.first {
            return;
        }
        let width = (self.last - self.first) / NODES as f64;
        for node in 0..NODES {
            let (sine, cosine) = (self.first + (node as f64 + 0.5) * width).sin_cos();
            let beside = (room.half_width_m.copysign(sine) - self.point[0]) / sine;
            let behind = (room.depth_m - self.point[1]) / cosine;
            // Infinite for a ray along y, which meets no side wall; negative if the wall lies behind the floor point.
            let distance = if beside > 0.0 { beside.min(behind) } else { behind };
            let lintel = self.lintel(doorway, cosine * cosine);
            let mut add = |distance: f64, light: f64| {
                let at = [self.point[0] + distance * sine, self.point[1] + distance * cosine];
                let azimuth = at[0].atan2(at[1]) + std::f64::consts::FRAC_PI_2;
                modes.iter_mut().enumerate().for_each(|(k, mode)| *mode += light * (k as f64 * azimuth).cos());
            };
            let wall = share(height_m, distance * distance).min(lintel);
            let leaf = self.leaf.and_then(|leaf| leaf.distance(sine, cosine)).filter(|&leaf| leaf < distance);
            let below = leaf.map_or(0.0, |leaf| {
                let top = doorway.height_m.map_or(height_m, |lintel| lintel.min(height_m));
                let light = share(top, leaf * leaf).min(lintel);
                add(leaf, 0.5 * width * light);
                light
            });
            if wall > below {
                add(distance, 0.5 * width * (wall - below));
            }
        }
    }

    /// H² / (ρ² + H²) of the lintel at the hidden face; `cosine2` is the squared cosine of the azimuth.
    pub(crate) fn lintel(&self, doorway: &Doorway, cosine2: f64) -> f64 {
        doorway.height_m.map_or(1.0, |height| share(height, self.point[1] * self.point[1] / cosine2))
    }
}

/// A door's leaf as a floor point sees it.
#[derive(Debug, Clone, Copy, PartialEq)]
struct LeafView {
    /// From the floor point to the hinge.
    hinge: Point,
    /// From the hinge to the free edge.
    along: Point,
    /// The range of azimuths that it fills.
    azimuths: [f64; 2],
}

impl LeafView {
    fn new(point: Point, [hinge, free]: [Point; 2]) -> Self {
        let azimuth = |[x, y]: Point| (x - point[0]).atan2(y - point[1]);
        let (a, b) = (azimuth(hinge), azimuth(free));
        Self {
            hinge: [hinge[0] - point[0], hinge[1] - point[1]],
            along: [free[0] - hinge[0], free[1] - hinge[1]],
            azimuths: [a.min(b), a.max(b)],
        }
    }

    /// How much of a range of azimuths the leaf hides from something at a distance, given by its square.
    fn hidden(&self, first: f64, last: f64, distance2: f64) -> f64 {
        let overlap = |[a, b]: [f64; 2]| (b.min(last) - a.max(first)).max(0.0);
        if overlap(self.azimuths) == 0.0 {
            return 0.0;
        }
        // The part of the leaf that is nearer: |hinge + t along|² < distance², with t from 0 to 1.
        let dot = |[ax, ay]: Point, [bx, by]: Point| ax * bx + ay * by;
        let (a, b) = (dot(self.along, self.along), dot(self.hinge, self.along));
        let root = (b * b - a * (dot(self.hinge, self.hinge) - distance2)).max(0.0).sqrt();
        let at = |t: f64| {
            let t = t.clamp(0.0, 1.0);
            (self.hinge[0] + t * self.along[0]).atan2(self.hinge[1] + t * self.along[1])
        };
        let (from, to) = (at((-b - root) / a), at((-b + root) / a));
        overlap([from.min(to), from.max(to)])
    }

    /// How far away the leaf is in a direction, if it is there.
    fn distance(&self, sine: f64, cosine: f64) -> Option<f64> {
        let cross = |a: Point, b: Point| a[0] * b[1] - a[1] * b[0];
        let across = cross([sine, cosine], self.along);
        let distance = cross(self.hinge, self.along) / across;
        let share = cross(self.hinge, [sine, cosine]) / across;
        (across != 0.0 && distance > 0.0 && (0.0..=1.0).contains(&share)).then_some(distance)
    }
}

/// H² / (ρ² + H²), from ρ².
pub(crate) fn share(height: f64, distance2: f64) -> f64 {
    height * height / (distance2 + height * height)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::testing::{leaf, meets_leaf};
    use super::*;

    /// Radiance, from the tangent of one elevation to that of another.
    type Layer = (f64, f64, f64);

    /// The light of a body or of the walls, summed ray by ray over azimuth and elevation. A ray passes if it crosses
    /// both faces between the edges and below the lintel.
    fn literal(doorway: &Doorway, [px, py]: Point, radiance: impl Fn(f64, f64) -> [Layer; 2]) -> f64 {
        const AZIMUTHS: usize = 4000;
        const ELEVATIONS: usize = 400;
        let (da, de) = (std::f64::consts::PI / AZIMUTHS as f64, std::f64::consts::FRAC_PI_2 / ELEVATIONS as f64);
        let mut sum = 0.0;
        for a in (0..AZIMUTHS).map(|k| (k as f64 + 0.5) * da - std::f64::consts::FRAC_PI_2) {
            let crosses = |face: f64| (px + (face - py) * a.tan()).abs() < doorway.half_width();
            if !crosses(0.0) || !crosses(-doorway.wall_thickness_m) {
                continue;
            }
            let layers = radiance(a.sin(), a.cos());
            for e in (0..ELEVATIONS).map(|k| (k as f64 + 0.5) * de) {
                let at_lintel = doorway.height_m.is_none_or(|h| -py / a.cos() * e.tan() < h);
                let light: f64 = layers.iter().filter(|l| (l.1..l.2).contains(&e.tan())).map(|l| l.0).sum();
                if light != 0.0 && at_lintel {
                    sum += light * e.sin() * e.cos() * de * da;
                }
            }
        }
        sum
    }

    const NOTHING: Layer = (0.0, 0.0, 0.0);

    /// Distance of a point from a doorway's leaf, by trying all of it.
    fn from_leaf(doorway: &Doorway, [x, y]: Point) -> f64 {
        let Some([hinge, free]) = doorway.leaf_ends() else { return f64::INFINITY };
        let at = |t: f64| [0, 1].map(|k| hinge[k] + t * (free[k] - hinge[k]));
        let distances = (0..=1000).map(|k| at(k as f64 / 1000.0)).map(|[lx, ly]| (lx - x).hypot(ly - y));
        distances.fold(f64::INFINITY, f64::min)
    }

    proptest! {
        #![proptest_config(crate::testing::cases(24))]
        #[test]
        fn bodies_and_walls_equal_sums_over_rays(
            width_m in 0.4..1.0f64, wall_thickness_m in 0.0..0.2f64, lintel in prop::option::of(1.9..2.2f64),
            px in -0.6..0.6f64, depth in 0.02..0.3f64, x in -1.2..1.2f64, y in 0.6..2.8f64, radius_m in 0.1..0.3f64,
            leaf in leaf(),
        ) {
            let doorway = Doorway { width_m, wall_thickness_m, height_m: lintel, leaf };
            let point = [px, -wall_thickness_m - depth];
            let view = FloorView::new(&doorway, point);
            let body = Body { centre: [x, y], radius_m, height_m: 1.7 };
            let (dx, dy) = (x - px, y - point[1]);
            let distance = dx.hypot(dy);
            let summed = literal(&doorway, point, |sine, cosine| {
                let beside = (dx * cosine - dy * sine).abs();
                let along = dx * sine + dy * cosine;
                let hidden = meets_leaf(&doorway, point, [px + along * sine, point[1] + along * cosine]);
                let seen = beside < radius_m && along > 0.0 && !hidden;
                [if seen { (1.0, 0.0, 1.7 / distance) } else { NOTHING }, NOTHING]
            });
            let whole = 0.5 * 2.0 * radius_m / distance * share(1.7, distance * distance);
            // Nobody stands in the door's leaf.
            if from_leaf(&doorway, body.centre) > radius_m {
                prop_assert!((view.body(&doorway, &body) - summed).abs() < 0.03 * whole + 1e-4, "{summed}");
            }

            let room = Room { half_width_m: 1.5, depth_m: 3.0 };
            let mut modes = [0.0; 4];
            view.walls(&doorway, &room, 2.4, &mut modes);
            for (k, &mode) in modes.iter().enumerate() {
                let summed = literal(&doorway, point, |sine, cosine| {
                    let side = if sine == 0.0 { f64::INFINITY } else { (1.5_f64.copysign(sine) - px) / sine };
                    let distance = side.min((3.0 - point[1]) / cosine);
                    let light = |distance: f64| {
                        let at = [px + distance * sine, point[1] + distance * cosine];
                        let azimuth = at[0].atan2(at[1]) + std::f64::consts::FRAC_PI_2;
                        (k as f64 * azimuth).cos()
                    };
                    let end = |distance: f64| [px + distance * sine, point[1] + distance * cosine];
                    if !meets_leaf(&doorway, point, end(distance)) {
                        return [(light(distance), 0.0, 2.4 / distance), NOTHING];
                    }
                    // Where the leaf is, by halving.
                    let (mut near, mut far) = (0.0, distance);
                    for _ in 0..40 {
                        let middle = 0.5 * (near + far);
                        if meets_leaf(&doorway, point, end(middle)) { far = middle } else { near = middle }
                    }
                    let top = lintel.unwrap_or(2.4) / far;
                    [(light(far), 0.0, top), (light(distance), top, 2.4 / distance)]
                });
                prop_assert!((mode - summed).abs() < 0.01 * modes[0].abs() + 1e-3, "mode {k}: {mode} {summed}");
            }
        }
    }
}
