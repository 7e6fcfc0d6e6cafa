//! The floor points at which light is calculated, and interpolation between them.
//!
//! The light that passes an edge forms a fan about the edge's foot: crisp in angle, smooth along each ray from the
//! foot. So the light through the opening is split by a smooth weight into a part for the left edge and one for the
//! right edge, and each part is sampled on a polar grid about the foot that cuts it. In a thick wall this foot is the
//! visible face's for floor points beside the opening on that edge's side, and the hidden face's for all others; hence
//! three zones.

use std::f64::consts::FRAC_PI_2;

use doorcam_core::geometry::{Doorway, Point, Side};

/// Angles of a fan, from along the wall to straight away from it.
const ANGLES: usize = 64;
/// Number of distances from the foot at which a fan's light is calculated, and that number if the foot is on the other
/// side of the opening.
const NEAR_RADII: usize = 16;
const FAR_RADII: usize = 9;
/// Light is smooth along a ray from the foot: cubics refine each interval of distances by this factor, and linear
/// interpolation does the rest.
const FINER: usize = 4;
/// How far the floor is sampled beside and in front of the opening, in metres.
const REACH_M: f64 = 0.9;
/// Extent in metres, and samples along x and y, of the room's own floor, of which the camera may see a little.
const INSIDE_M: f64 = 1.0;
const INSIDE: [usize; 2] = [21, 11];
/// Points on a face of the wall are moved this far in front of it, in metres.
const BEFORE_M: f64 = 1e-6;

/// A floor point, and which part of the light is sampled there.
#[derive(Debug, Clone, Copy)]
pub(super) struct FloorNode {
    pub(super) at: Point,
    /// Range of azimuths in which it sees the room: 0 into it, positive to the right. Empty if the first exceeds the
    /// second.
    pub(super) azimuths: [f64; 2],
    /// The two feet that cut the light, and the side whose part is sampled; none for all of the light.
    seam: Option<([Point; 2], Side)>,
}

impl FloorNode {
    /// Weight of light from an azimuth; those of the left and the right part add up to 1.
    pub(super) fn weight(&self, ray: Point) -> f64 {
        let Some(([a, b], side)) = self.seam else { return 1.0 };
        let cross = |u: Point, v: Point| u[0] * v[1] - u[1] * v[0];
        let along = [b[0] - a[0], b[1] - a[1]];
        let t = -cross([a[0] - self.at[0], a[1] - self.at[1]], ray) / cross(along, ray);
        let t = t.clamp(0.0, 1.0);
        let right = t * t * (3.0 - 2.0 * t);
        match side {
            Side::Left => 1.0 - right,
            Side::Right => right,
        }
    }
}

/// A polar grid about a foot; angle 0 runs along the wall.
#[derive(Debug, Clone)]
struct Fan {
    start: usize,
    foot: Point,
    /// Direction of angle 0 along x: 1 or −1.
    across: f64,
    /// Start of its refined values.
    fine_start: usize,
    /// Distances of the nodes.
    coarse: Vec<f64>,
    /// Distances of the refined values.
    fine: Vec<f64>,
    /// For each refined value, the first of four nodes and their weights.
    cubics: Vec<(usize, [f32; 4])>,
}

/// All floor samples.
#[derive(Debug, Clone)]
pub(super) struct FloorMap {
    doorway: Doorway,
    /// Left and right part of the zones to the left of, in front of and to the right of the opening.
    fans: [[Fan; 2]; 3],
    inside: usize,
    /// Start of the values on the room's floor.
    fine_inside: usize,
    pub(super) nodes: Vec<FloorNode>,
}

/// A bilinear interpolation between four samples: `base`, the next one, and the two `stride` further on.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Tap {
    pub(super) base: u32,
    pub(super) stride: u32,
    pub(super) along: f32,
    pub(super) beside: f32,
}

impl Tap {
    /// The interpolated value, from the values of [`FloorMap::refine`].
    pub(super) fn of(self, values: &[[f32; 3]]) -> [f32; 3] {
        let (at, next) = (self.base as usize, (self.base + self.stride) as usize);
        let (a, b) = (self.along, self.beside);
        let [p, q, r, s] = [values[at], values[at + 1], values[next], values[next + 1]];
        [0, 1, 2].map(|c| (p[c] * (1.0 - a) + q[c] * a) * (1.0 - b) + (r[c] * (1.0 - a) + s[c] * a) * b)
    }
}

impl FloorMap {
    pub(super) fn new(doorway: Doorway) -> Self {
        let (half, thickness) = (doorway.half_width(), doorway.wall_thickness_m);
        let visible = [[-half, -thickness], [half, -thickness]];
        let hidden = [[-half, 0.0], [half, 0.0]];
        let depth = thickness + REACH_M;
        // Distances from an edge's own foot, and from the other edge's foot.
        let near = |reach: f64| -> Vec<f64> {
            (0..NEAR_RADII).map(|k| reach * (k as f64 / (NEAR_RADII - 1) as f64).powf(1.6)).collect()
        };
        let far: Vec<f64> = (0..FAR_RADII)
            .map(|k| doorway.width_m + (depth + REACH_M) * (k as f64 / (FAR_RADII - 1) as f64).powf(1.3))
            .collect();
        let across_the_opening = near(doorway.width_m.hypot(depth));
        let mut nodes = Vec::new();
        let mut fine_start = 0;
        let mut zone = |cuts: [Point; 2], across: [f64; 2], radii: [Vec<f64>; 2]| {
            let mut radii = radii.into_iter();
            [0, 1].map(|k| {
                let side = Side::BOTH[k];
                let fan = Fan::new([nodes.len(), fine_start], cuts[k], across[k], radii.next().unwrap_or_default());
                fine_start += (ANGLES + 1) * fan.fine.len();
                for angle in 0..=ANGLES {
                    for &radius in &fan.coarse {
                        let at = fan.place(angle as f64 / ANGLES as f64 * FRAC_PI_2, radius);
                        nodes.push(FloorNode {
                            at,
                            azimuths: cuts.map(|cut| azimuth(at, cut)),
                            seam: Some((cuts, side)),
                        });
                    }
                }
                fan
            })
        };
        let fans = [
            zone([visible[0], hidden[1]], [-1.0, -1.0], [near(depth + REACH_M), far.clone()]),
            zone(hidden, [1.0, -1.0], [across_the_opening.clone(), across_the_opening]),
            zone([hidden[0], visible[1]], [1.0, 1.0], [far, near(depth + REACH_M)]),
        ];
        let inside = nodes.len();
        let map = Self { doorway, fans, inside, fine_inside: fine_start, nodes: Vec::new() };
        for j in 0..INSIDE[1] {
            for i in 0..INSIDE[0] {
                let u = i as f64 / (INSIDE[0] - 1) as f64;
                let at =
                    [(2.0 * u - 1.0) * map.inside_width(), INSIDE_M * j as f64 / (INSIDE[1] - 1) as f64 + BEFORE_M];
                nodes.push(FloorNode { at, azimuths: [-FRAC_PI_2, FRAC_PI_2], seam: None });
            }
        }
        Self { nodes, ..map }
    }

    /// How far to each side of x = 0 the room's floor is sampled, in metres.
    fn inside_width(&self) -> f64 {
        self.doorway.half_width() + INSIDE_M
    }

    /// Whether a node is on the room's own floor.
    pub(super) fn is_inside(&self, node: usize) -> bool {
        node >= self.inside
    }

    /// Which nodes the values at some places depend on.
    pub(super) fn nodes_of(&self, places: impl Iterator<Item = Tap>) -> Vec<bool> {
        let mut values = vec![false; self.fine_inside + INSIDE[0] * INSIDE[1] + 2];
        for Tap { base, stride, .. } in places {
            [base, base + 1, base + stride, base + stride + 1].iter().for_each(|&k| values[k as usize] = true);
        }
        let mut nodes = vec![false; self.nodes.len()];
        for fan in self.fans.iter().flatten() {
            for angle in 0..=ANGLES {
                for (k, (first, _)) in fan.cubics.iter().enumerate() {
                    if values[fan.fine_start + angle * fan.fine.len() + k] {
                        nodes[fan.start + angle * fan.coarse.len() + first..][..4].fill(true);
                    }
                }
            }
        }
        let inside = nodes.len() - self.inside;
        nodes[self.inside..].copy_from_slice(&values[self.fine_inside..][..inside]);
        nodes
    }

    /// Values for [`Tap::of`] from those at the nodes: refined along the fans' rays, and two zeros at the end.
    pub(super) fn refine(&self, nodes: &[[f64; 3]]) -> Vec<[f32; 3]> {
        let mut values = Vec::with_capacity(self.fine_inside + INSIDE[0] * INSIDE[1] + 2);
        for fan in self.fans.iter().flatten() {
            for angle in 0..=ANGLES {
                let ray = &nodes[fan.start + angle * fan.coarse.len()..][..fan.coarse.len()];
                values.extend(fan.cubics.iter().map(|(first, weights)| {
                    let four = &ray[*first..first + 4];
                    [0, 1, 2].map(|c| {
                        let sum: f32 = four.iter().zip(weights).map(|(node, weight)| node[c] as f32 * weight).sum();
                        // A cubic may fall below 0.
                        sum.max(0.0)
                    })
                }));
            }
        }
        values.extend(nodes[self.inside..].iter().map(|node| node.map(|light| light.max(0.0) as f32)));
        values.extend([[0.0; 3]; 2]);
        values
    }

    /// The two taps whose values add up to the light at a floor point.
    pub(super) fn taps(&self, at: Point) -> [Tap; 2] {
        let half = self.doorway.half_width();
        if at[1] >= 0.0 {
            let grid = |value: f64, count: usize| split(value * (count - 1) as f64, count);
            let (i, a) = grid((at[0] / self.inside_width() + 1.0) / 2.0, INSIDE[0]);
            let (j, b) = grid(at[1] / INSIDE_M, INSIDE[1]);
            let base = (self.fine_inside + j * INSIDE[0] + i) as u32;
            let tap = Tap { base, stride: INSIDE[0] as u32, along: a as f32, beside: b as f32 };
            // The second tap adds nothing: it points at the zeros at the end.
            let end = self.fine_inside + INSIDE[0] * INSIDE[1];
            return [tap, Tap { base: end as u32, ..Tap::default() }];
        }
        let zone = if at[0] < -half { 0 } else { 1 + usize::from(at[0] > half) };
        [0, 1].map(|k| self.fans[zone][k].tap(at))
    }

    /// The part of the visible side's light that reaches a floor point: all of it in front of the wall; behind the
    /// visible face, the horizontal angle in which the opening is seen, as a share of π.
    pub(super) fn visible_light(&self, [x, y]: Point) -> f64 {
        let behind = y + self.doorway.wall_thickness_m;
        if behind <= 0.0 {
            return 1.0;
        }
        let half = self.doorway.half_width();
        (((half - x) / behind).atan() + ((half + x) / behind).atan()).max(0.0) / std::f64::consts::PI
    }
}

impl Fan {
    fn new([start, fine_start]: [usize; 2], foot: Point, across: f64, coarse: Vec<f64>) -> Self {
        let steps = coarse.windows(2);
        let mut fine: Vec<f64> =
            steps.flat_map(|r| (0..FINER).map(move |k| r[0] + (r[1] - r[0]) * k as f64 / FINER as f64)).collect();
        fine.extend(coarse.last());
        let cubics = fine.iter().map(|&radius| {
            let below = coarse.iter().rposition(|&r| r <= radius).unwrap_or(0);
            let first = below.saturating_sub(1).min(coarse.len() - 4);
            let four = &coarse[first..first + 4];
            // Lagrange interpolation.
            let weight = |k: usize| {
                let others = (0..4).filter(|&j| j != k);
                others.map(|j| (radius - four[j]) / (four[k] - four[j])).product::<f64>() as f32
            };
            (first, [weight(0), weight(1), weight(2), weight(3)])
        });
        Self { cubics: cubics.collect(), start, fine_start, foot, across, fine, coarse }
    }

    fn place(&self, angle: f64, radius: f64) -> Point {
        let radius = radius.max(1e-5);
        let away = (radius * angle.sin()).max(BEFORE_M);
        [self.foot[0] + self.across * radius * angle.cos(), self.foot[1] - away]
    }

    fn tap(&self, at: Point) -> Tap {
        let (along, away) = (self.across * (at[0] - self.foot[0]), self.foot[1] - at[1]);
        let (j, b) = split(away.atan2(along) / FRAC_PI_2 * ANGLES as f64, ANGLES + 1);
        let radius = along.hypot(away);
        let last = self.fine.len() - 2;
        let i = self.fine.partition_point(|&r| r <= radius).saturating_sub(1).min(last);
        let a = ((radius - self.fine[i]) / (self.fine[i + 1] - self.fine[i])).clamp(0.0, 1.0);
        let stride = self.fine.len();
        let base = (self.fine_start + j * stride + i) as u32;
        Tap { base, stride: stride as u32, along: a as f32, beside: b as f32 }
    }
}

/// Index of the sample at or below a place, and the fraction of the way to the next.
fn split(place: f64, count: usize) -> (usize, f64) {
    let place = place.clamp(0.0, (count - 1) as f64);
    let low = (place as usize).min(count - 2);
    (low, place - low as f64)
}

fn azimuth(from: Point, to: Point) -> f64 {
    (to[0] - from[0]).atan2(to[1] - from[1])
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn map() -> FloorMap {
        FloorMap::new(Doorway { width_m: 0.8, wall_thickness_m: 0.12, height_m: None, leaf: None })
    }

    proptest! {
        /// Interpolation reproduces a linear function of position, except that a grid's straight lines differ from
        /// circles.
        #[test]
        fn a_place_is_where_its_taps_say(x in -1.0..1.0f64, y in -0.9..0.3f64) {
            prop_assume!(x.abs() < 0.4 || y < -0.12);
            let map = map();
            // Positive everywhere, since values below 0 are cut off.
            let nodes: Vec<[f64; 3]> = map.nodes.iter().map(|n| [n.at[0] + 5.0, n.at[1] + 5.0, 1.0]).collect();
            let values = map.refine(&nodes);
            let [first, second] = map.taps([x, y]).map(|tap| tap.of(&values));
            for found in if y >= 0.0 { vec![first] } else { vec![first, second] } {
                prop_assert!((f64::from(found[0]) - 5.0 - x).abs() < 1e-3 && (f64::from(found[1]) - 5.0 - y).abs() < 1e-3, "{found:?}");
            }
        }

        #[test]
        fn the_parts_of_both_edges_make_the_whole(x in -1.0..1.0f64, y in -0.9..-0.13f64, phi in -1.5..1.5f64) {
            let ray = [phi.sin(), phi.cos()];
            let map = map();
            let zone = if x < -0.4 { 0 } else { 1 + usize::from(x > 0.4) };
            let weights: Vec<f64> = map.fans[zone]
                .iter()
                .map(|fan| FloorNode { at: [x, y], ..map.nodes[fan.start] }.weight(ray))
                .collect();
            prop_assert!((weights[0] + weights[1] - 1.0).abs() < 1e-12 && weights.iter().all(|w| (0.0..=1.0).contains(w)));
        }
    }
}
