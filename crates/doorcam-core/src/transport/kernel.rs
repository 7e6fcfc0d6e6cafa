use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::visibility::{below_lintel, sees, visible_parts};
use crate::geometry::{Doorway, Facet, Point};

/// The law by which a facet lights the floor, with d the vector from a facet's sample at height z to the pixel and n
/// the facet's normal. Both laws leave out the factor albedo / π, which only scales brightness.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[serde(rename_all = "lowercase")]
pub enum Kernel {
    /// (n·d)₊ z / |d|³ dA, summed over 16 x 16 samples, as in the authors' program (falls off as 1/d).
    Published,
    /// (n·d)₊ z / |d|⁴ dA, the radiometric law (falls off as 1/d²), integrated in closed form over the visible part.
    Radiometric,
}

/// Samples along each side of a facet in the published matrices.
const SAMPLES: usize = 16;

impl Kernel {
    /// Prepares one facet of the given height, in metres, for evaluation at many pixels.
    pub(super) fn prepare<'a>(self, doorway: &'a Doorway, facet: &'a Facet, height: f64) -> Source<'a> {
        let sampled = match self {
            Kernel::Published => Some(Samples::new(facet, height)),
            Kernel::Radiometric => None,
        };
        Source { doorway, facet, normal: facet.normal(), height, sampled }
    }
}

/// A facet as a light source.
pub(super) struct Source<'a> {
    doorway: &'a Doorway,
    facet: &'a Facet,
    normal: Point,
    height: f64,
    sampled: Option<Samples>,
}

/// Sample positions of the published quadrature.
struct Samples {
    points: [Point; SAMPLES],
    heights: [f64; SAMPLES],
    area: f64,
}

impl Samples {
    fn new(facet: &Facet, height: f64) -> Self {
        let middle = |k: usize| (k as f64 + 0.5) / SAMPLES as f64;
        Self {
            points: std::array::from_fn(|k| {
                [0, 1].map(|axis| facet.from[axis] + middle(k) * (facet.to[axis] - facet.from[axis]))
            }),
            heights: std::array::from_fn(|k| middle(k) * height),
            area: height * facet.length() / (SAMPLES * SAMPLES) as f64,
        }
    }
}

impl Source<'_> {
    /// Light at a floor point from the part of the facet that it sees, per unit of radiance. `pixel` is in metres in
    /// the door frame.
    pub(super) fn light_at(&self, pixel: Point) -> f64 {
        match &self.sampled {
            Some(samples) => self.published(samples, pixel),
            None => self.radiometric(pixel),
        }
    }

    fn published(&self, samples: &Samples, pixel: Point) -> f64 {
        let mut sum = 0.0;
        for &point in &samples.points {
            let d = [pixel[0] - point[0], pixel[1] - point[1]];
            let facing = d[0] * self.normal[0] + d[1] * self.normal[1];
            if facing <= 0.0 || !sees(self.doorway, pixel, point) {
                continue;
            }
            let floor2 = d[0] * d[0] + d[1] * d[1];
            let top = below_lintel(self.doorway, pixel, point);
            let terms = samples.heights.map(|z| {
                let d2 = floor2 + z * z;
                if z < top { z / (d2 * d2.sqrt()) } else { 0.0 }
            });
            sum += facing * terms.iter().sum::<f64>();
        }
        sum * samples.area
    }

    /// The light of the parts that are seen. Where the lintel is above the facet, its top is level; otherwise the lintel
    /// cuts it off along a line that rises with the distance from the wall.
    fn radiometric(&self, pixel: Point) -> f64 {
        let from = self.facet.from;
        let to_pixel = [pixel[0] - from[0], pixel[1] - from[1]];
        let h = to_pixel[0] * self.normal[0] + to_pixel[1] * self.normal[1];
        if h <= 0.0 {
            return 0.0;
        }
        let limits = [from, self.facet.to].map(|end| below_lintel(self.doorway, pixel, end));
        let lintel_at = |s: f64| limits[0] + s * (limits[1] - limits[0]);
        // Where the lintel's line leaves the facet's top.
        let bend = (self.height - limits[0]) / (limits[1] - limits[0]);
        let parts = visible_parts(self.doorway, pixel, self.facet).into_iter().filter(|(s0, s1)| s0 < s1);
        parts
            .map(|(s0, s1)| {
                if limits.iter().all(|&limit| limit >= self.height) {
                    return self.below_level_top(pixel, h, s0, s1);
                }
                let middle = if bend.is_finite() { bend.clamp(s0, s1) } else { s0 };
                let stretches = [(s0, middle), (middle, s1)].into_iter().filter(|(a, b)| a < b);
                let light = |(a, b): (f64, f64)| {
                    if lintel_at(0.5 * (a + b)) >= self.height {
                        self.below_level_top(pixel, h, a, b)
                    } else {
                        self.below_line(pixel, h, [a, b], [lintel_at(a), lintel_at(b)])
                    }
                };
                stretches.map(light).sum()
            })
            .sum()
    }

    /// With h the distance from the pixel to the facet's plane, t the position along the facet from the foot of that
    /// perpendicular and q² = h² + H²: ∫∫ h z / (h² + t² + z²)² dz dt = ½ [atan(t/h) − (h/q) atan(t/q)], for z from 0
    /// to H.
    fn below_level_top(&self, pixel: Point, h: f64, s0: f64, s1: f64) -> f64 {
        let length = self.facet.length();
        let foot = self.foot(pixel);
        let q = h.hypot(self.height);
        let antiderivative = |s: f64| {
            let t = s * length - foot;
            (t / h).atan() - h / q * (t / q).atan()
        };
        0.5 * (antiderivative(s1) - antiderivative(s0))
    }

    /// The same with a top that runs straight from one height to another: Lambert's formula, half the sum over the
    /// polygon's sides of the angle that each fills, times the vertical part of the normal of its plane with the pixel.
    /// Upright sides have none.
    fn below_line(&self, pixel: Point, h: f64, shares: [f64; 2], heights: [f64; 2]) -> f64 {
        let foot = self.foot(pixel);
        let [t0, t1] = shares.map(|s| s * self.facet.length() - foot);
        let [a, b] = [(t0, heights[0]), (t1, heights[1])].map(|(t, z)| Vector3::new(t, h, z));
        let top = a.cross(&b);
        let angle = top.norm().atan2(a.dot(&b));
        0.5 * ((t1 / h).atan() - (t0 / h).atan() + angle * top[2] / top.norm().max(f64::MIN_POSITIVE))
    }

    /// Position along the facet of the foot of the perpendicular from the pixel, in metres from its beginning.
    fn foot(&self, pixel: Point) -> f64 {
        let to_pixel = [pixel[0] - self.facet.from[0], pixel[1] - self.facet.from[1]];
        // The facet's direction is its normal rotated by a quarter turn: (n_x, n_y) -> (-n_y, n_x).
        -to_pixel[0] * self.normal[1] + to_pixel[1] * self.normal[0]
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::testing::leaf;
    use super::*;

    /// Eq. 2 with the radiometric law, summed directly over a fine lattice of samples.
    fn brute_force(doorway: &Doorway, facet: &Facet, height: f64, pixel: Point, n: usize) -> f64 {
        let normal = facet.normal();
        let cell = facet.length() * height / (n * n) as f64;
        let mut sum = 0.0;
        for i in 0..n {
            let s = (i as f64 + 0.5) / n as f64;
            let point = [0, 1].map(|k| facet.from[k] + s * (facet.to[k] - facet.from[k]));
            if !sees(doorway, pixel, point) {
                continue;
            }
            for k in 0..n {
                let z = (k as f64 + 0.5) / n as f64 * height;
                let at_lintel = -pixel[1] / (point[1] - pixel[1]) * z;
                if doorway.height_m.is_some_and(|lintel| at_lintel >= lintel) {
                    continue;
                }
                let d = [pixel[0] - point[0], pixel[1] - point[1]];
                let facing = (d[0] * normal[0] + d[1] * normal[1]).max(0.0);
                let d2 = d[0] * d[0] + d[1] * d[1] + z * z;
                sum += facing * z / (d2 * d2) * cell;
            }
        }
        sum
    }

    proptest! {
        #![proptest_config(crate::testing::cases(64))]
        #[test]
        fn closed_form_equals_the_literal_sum(
            thickness in 0.0..0.2f64, px in -0.6..0.6f64, depth in 0.01..0.3f64, height in 0.5..2.5f64,
            x in -1.5..1.5f64, y in 0.4..3.0f64, half in 0.03..0.2f64, turn in -1.2..1.2f64,
            lintel in prop::option::of(0.05..1.0f64), leaf in leaf(),
        ) {
            let door = Doorway { width_m: 0.8, wall_thickness_m: thickness, height_m: lintel, leaf };
            let along = [half * f64::cos(turn), half * f64::sin(turn)];
            let facet = Facet { from: [x - along[0], y - along[1]], to: [x + along[0], y + along[1]] };
            let pixel = [px, -thickness - depth];
            let exact = Kernel::Radiometric.prepare(&door, &facet, height).light_at(pixel);
            let literal = brute_force(&door, &facet, height, pixel, 400);
            let whole = brute_force(&Doorway { width_m: 1e6, height_m: None, leaf: None, ..door }, &facet, height, pixel, 50);
            // One sample more or less at each border of the visible parts is 1/400 of the whole.
            let borders = 1.0 + 2.0 * f64::from(u8::from(leaf.is_some())) + f64::from(u8::from(lintel.is_some()));
            prop_assert!((exact - literal).abs() <= 0.004 * borders * whole + 1e-12, "{exact} {literal} {whole}");
        }
    }

    #[test]
    fn the_part_below_the_lintel_agrees_to_quadrature_accuracy() {
        let facet = Facet { from: [-0.1, 1.0], to: [0.15, 1.35] };
        // Cut off all along, and in one half only.
        for lintel in [0.2, 0.3] {
            let door = Doorway { width_m: 0.8, wall_thickness_m: 0.1, height_m: Some(lintel), leaf: None };
            let pixel = [0.0, -0.2];
            let exact = Kernel::Radiometric.prepare(&door, &facet, 2.0).light_at(pixel);
            let literal = brute_force(&door, &facet, 2.0, pixel, 1500);
            assert!((exact - literal).abs() <= 1e-3 * literal, "{exact} {literal}");
            let open = Doorway { height_m: None, ..door };
            assert!(Kernel::Radiometric.prepare(&open, &facet, 2.0).light_at(pixel) > 1.0005 * exact);
            let [cut, whole] = [door, open].map(|door| Kernel::Published.prepare(&door, &facet, 2.0).light_at(pixel));
            assert!(cut < whole, "{cut} {whole}");
        }
    }

    #[test]
    fn a_facet_seen_whole_agrees_to_quadrature_accuracy() {
        let door = Doorway { width_m: 0.8, wall_thickness_m: 0.1, height_m: None, leaf: None };
        let facet = Facet { from: [0.1, 1.0], to: [-0.1, 1.05] };
        for pixel in [[-0.3, -0.2], [0.0, -0.15], [0.35, -0.4]] {
            for facet in [facet, Facet { from: facet.to, to: facet.from }] {
                let exact = Kernel::Radiometric.prepare(&door, &facet, 2.0).light_at(pixel);
                let literal = brute_force(&door, &facet, 2.0, pixel, 1500);
                assert!((exact - literal).abs() <= 1e-6 * literal, "{exact} {literal}");
            }
        }
    }
}
