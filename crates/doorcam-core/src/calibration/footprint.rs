//! The image pixels, with weights, that make up each patch pixel.
//!
//! An image pixel is the mean over its square of the image, which shows a quadrilateral of floor. A patch pixel is the
//! mean over its square of floor: each image pixel is weighted by the area of floor that the two share. Its value
//! therefore does not depend on how obliquely the camera sees the floor (paper, footnote 2), and no light is left out
//! or counted twice.
//!
//! Light within an image pixel is taken to change linearly, with the slope between the pixel's neighbours. This
//! preserves the pixel's mean and follows a ramp exactly. Unlike interpolation between pixel centres, it does not blur
//! where patch pixels are as fine as those of the image.

use crate::calibration::Camera;
use crate::geometry::{Doorway, Point, Side};
use crate::transport::PatchGrid;

/// Image pixels (row-major index) and their weights, which sum to 1.
pub(crate) type Footprint = Vec<(u32, f32)>;

/// Footprints of a patch's pixels, row-major; empty where the image does not show the whole of a pixel's square.
pub(crate) fn footprints(
    doorway: &Doorway,
    patch: &PatchGrid,
    side: Side,
    camera: &Camera,
    (width, height): (usize, usize),
) -> Vec<Footprint> {
    let plan = Plan::new(doorway, patch, side);
    let view = View::new(&plan, camera, (width, height));
    let mut shares: Vec<Vec<Share>> = vec![Vec::new(); patch.pixels()];
    for pixel in view.pixels() {
        if let Some(quad) = view.quad(pixel) {
            plan.share(pixel, quad, &mut shares);
        }
    }
    shares.into_iter().map(|shares| view.footprint(&plan, &shares)).collect()
}

/// How a camera sees a patch.
#[derive(Debug, Clone, PartialEq)]
pub struct PatchSight {
    /// For each pixel of the patch, whether the image shows the whole of its square.
    pub whole: Vec<bool>,
    /// Pixels of the image in the upright rectangle around what it shows of the patch: as many as are looked at to read
    /// the patch.
    pub area_px: f64,
}

impl PatchSight {
    /// How `camera` sees a patch in images of `size` (width, height) pixels. Takes a projection for each of the patch's
    /// pixels, however large the image is.
    pub fn new(doorway: &Doorway, patch: &PatchGrid, side: Side, camera: &Camera, [width, height]: [usize; 2]) -> Self {
        let plan = Plan::new(doorway, patch, side);
        let n = plan.size;
        let corners: Vec<Option<Point>> = plan.corners(camera).collect();
        let within = |at: f64, size: usize| (-0.5..=size as f64 - 0.5).contains(&at);
        let shown = |c: usize| corners[c].is_some_and(|[u, v]| within(u, width) && within(v, height));
        let whole = |k: usize| {
            let first = k / n * (n + 1) + k % n;
            [first, first + 1, first + n + 1, first + n + 2].into_iter().all(shown)
        };
        let (low, high) = span(corners.iter().copied().flatten());
        let length = |c: usize, size: usize| {
            let within = |at: f64| at.clamp(-0.5, size as f64 - 0.5);
            (within(high[c]) - within(low[c])).max(0.0)
        };
        Self { whole: (0..patch.pixels()).map(whole).collect(), area_px: length(0, width) * length(1, height) }
    }

    /// Fraction of the patch that the image shows.
    pub fn share(&self) -> f64 {
        self.whole.iter().filter(|&&whole| whole).count() as f64 / self.whole.len().max(1) as f64
    }
}

/// Smallest and largest coordinates of some points.
fn span(points: impl Iterator<Item = Point>) -> (Point, Point) {
    points.fold(([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]), |(low, high), p| {
        ([0, 1].map(|c| p[c].min(low[c])), [0, 1].map(|c| p[c].max(high[c])))
    })
}

/// Floor coordinates of a patch in units of its pixels: (column, row) from its corner at the wall with the smallest x.
struct Plan {
    corner: Point,
    cell: f64,
    size: usize,
}

/// The part of a patch pixel's square that an image pixel shows.
#[derive(Clone, Copy)]
struct Share {
    pixel: [usize; 2],
    /// Fraction of the square.
    area: f64,
    /// Centroid of the shared part, in plan coordinates.
    middle: Point,
}

impl Plan {
    fn new(doorway: &Doorway, patch: &PatchGrid, side: Side) -> Self {
        let corner = [doorway.edge(side)[0] - patch.fov_m / 2.0, -doorway.wall_thickness_m];
        Self { corner, cell: patch.fov_m / patch.size as f64, size: patch.size }
    }

    fn floor(&self, [column, row]: Point) -> Point {
        [self.corner[0] + column * self.cell, self.corner[1] - row * self.cell]
    }

    /// Where a camera sees the corners of the patch's pixels, row by row; `None` where it does not.
    fn corners(&self, camera: &Camera) -> impl Iterator<Item = Option<Point>> {
        let n = self.size + 1;
        (0..n * n).map(move |k| camera.project(self.floor([(k % n) as f64, (k / n) as f64])))
    }

    fn cells(&self, floor: Point) -> Point {
        [(floor[0] - self.corner[0]) / self.cell, (self.corner[1] - floor[1]) / self.cell]
    }

    /// Adds the share that an image pixel, which shows the floor within `quad`, has in each patch pixel.
    fn share(&self, pixel: [usize; 2], quad: [Point; 4], shares: &mut [Vec<Share>]) {
        let range = |axis: usize| {
            let (low, high) = quad.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), corner| {
                (low.min(corner[axis]), high.max(corner[axis]))
            });
            let limit = |at: f64| at.clamp(0.0, self.size as f64) as usize;
            limit(low.floor())..limit(high.ceil())
        };
        let whole = Polygon::from(quad);
        for row in range(1) {
            let band = whole.between(1, row as f64);
            for column in range(0) {
                let (area, middle) = band.between(0, column as f64).area_and_middle();
                if area > 0.0 {
                    shares[row * self.size + column].push(Share { pixel, area, middle });
                }
            }
        }
    }
}

/// The part of the image in which a patch is seen.
struct View<'a> {
    camera: &'a Camera,
    size: [usize; 2],
    from: [usize; 2],
    to: [usize; 2],
    /// Corners of these pixels in plan coordinates.
    corners: Vec<Option<Point>>,
}

impl<'a> View<'a> {
    fn new(plan: &Plan, camera: &'a Camera, (width, height): (usize, usize)) -> Self {
        let size = [width, height];
        let (low, high) = span(plan.corners(camera).flatten());
        // One extra pixel, because the lens may bend the outline.
        let limit = |at: f64, c: usize| at.clamp(0.0, size[c] as f64) as usize;
        let from = [0, 1].map(|c| limit((low[c] - 1.5).floor(), c));
        let to = [0, 1].map(|c| limit((high[c] + 2.5).ceil(), c).max(from[c]));
        let across = to[0] - from[0] + 1;
        let corner = |k: usize| {
            let pixel = [from[0] + k % across, from[1] + k / across];
            camera.floor(pixel.map(|p| p as f64 - 0.5)).map(|floor| plan.cells(floor))
        };
        let corners = (0..across * (to[1] - from[1] + 1)).map(corner).collect();
        Self { camera, size, from, to, corners }
    }

    fn pixels(&self) -> impl Iterator<Item = [usize; 2]> {
        let (columns, rows) = (self.from[0]..self.to[0], self.from[1]..self.to[1]);
        rows.flat_map(move |v| columns.clone().map(move |u| [u, v]))
    }

    /// The floor that an image pixel shows, in plan coordinates; `None` if it does not show floor alone.
    fn quad(&self, [u, v]: [usize; 2]) -> Option<[Point; 4]> {
        let across = self.to[0] - self.from[0] + 1;
        let first = (v - self.from[1]) * across + u - self.from[0];
        let [a, b, c, d] = [first, first + 1, first + across + 1, first + across].map(|k| self.corners[k]);
        Some([a?, b?, c?, d?])
    }

    /// Whether an image pixel shows only floor in front of the wall.
    fn floor_alone(&self, pixel: [i64; 2]) -> bool {
        let inside = (0..2).all(|c| (self.from[c] as i64..self.to[c] as i64).contains(&pixel[c]));
        inside && self.quad(pixel.map(|p| p as usize)).is_some_and(|quad| quad.iter().all(|corner| corner[1] >= -1e-9))
    }

    /// Footprint of a patch pixel from its shares.
    fn footprint(&self, plan: &Plan, shares: &[Share]) -> Footprint {
        let total: f64 = shares.iter().map(|s| s.area).sum();
        if total < 1.0 - 1e-6 {
            return Vec::new();
        }
        let mut taps: Vec<(u32, f64)> = Vec::new();
        let mut add = |[u, v]: [i64; 2], weight: f64| {
            let index = (v * self.size[0] as i64 + u) as u32;
            match taps.iter_mut().find(|(k, _)| *k == index) {
                Some((_, sum)) => *sum += weight,
                None => taps.push((index, weight)),
            }
        };
        for share in shares {
            let weight = share.area / total;
            let Some(middle) = self.camera.project(plan.floor(share.middle)) else { continue };
            let own = share.pixel.map(|p| p as i64);
            if !self.floor_alone(own) {
                add(self.nearest_floor(own, middle), weight);
                continue;
            }
            add(own, weight);
            for axis in 0..2 {
                let (low, high) = self.neighbours(own, axis);
                let span = (high[axis] - low[axis]) as f64;
                if span > 0.0 {
                    let slope = weight * (middle[axis] - own[axis] as f64) / span;
                    add(high, slope);
                    add(low, -slope);
                }
            }
        }
        taps.retain(|&(_, weight)| weight.abs() > 1e-9);
        taps.sort_unstable_by_key(|&(index, _)| index);
        taps.into_iter().map(|(index, weight)| (index, weight as f32)).collect()
    }

    /// Nearest pixel that shows only floor, to replace a pixel that shows part of the wall's face and so says nothing
    /// about the floor. Its light is used unchanged, because extrapolating its slope would amplify noise.
    fn nearest_floor(&self, own: [i64; 2], middle: Point) -> [i64; 2] {
        let distance = |p: &[i64; 2]| (p[0] as f64 - middle[0]).hypot(p[1] as f64 - middle[1]);
        let around = (-2..=2).flat_map(|dv| (-2..=2).map(move |du| [own[0] + du, own[1] + dv]));
        let floor = around.filter(|&p| self.floor_alone(p));
        floor.min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap_or(own)
    }

    /// The pixels before and after a pixel along an axis; the pixel itself in place of one that does not show only
    /// floor.
    fn neighbours(&self, pixel: [i64; 2], axis: usize) -> ([i64; 2], [i64; 2]) {
        let beside = |step: i64| {
            let mut other = pixel;
            other[axis] += step;
            if self.floor_alone(other) { other } else { pixel }
        };
        (beside(-1), beside(1))
    }
}

/// A convex polygon. A quadrilateral cut by four lines has at most eight corners.
#[derive(Clone, Copy)]
struct Polygon {
    corners: [Point; 8],
    count: usize,
}

impl From<[Point; 4]> for Polygon {
    fn from(quad: [Point; 4]) -> Self {
        let mut corners = [[0.0; 2]; 8];
        corners[..4].copy_from_slice(&quad);
        Self { corners, count: 4 }
    }
}

impl Polygon {
    /// The part whose coordinate along `axis` lies between `from` and `from` + 1.
    fn between(&self, axis: usize, from: f64) -> Self {
        self.cut(|p| p[axis] - from).cut(|p| from + 1.0 - p[axis])
    }

    /// The part on which the linear function `inside` is not negative.
    fn cut(&self, inside: impl Fn(&Point) -> f64) -> Self {
        let mut out = Polygon { corners: [[0.0; 2]; 8], count: 0 };
        let mut push = |p: Point| {
            if let Some(corner) = out.corners.get_mut(out.count) {
                *corner = p;
                out.count += 1;
            }
        };
        for k in 0..self.count {
            let (a, b) = (self.corners[k], self.corners[(k + 1) % self.count]);
            let (da, db) = (inside(&a), inside(&b));
            if da >= 0.0 {
                push(a);
            }
            if (da < 0.0) != (db < 0.0) {
                let t = da / (da - db);
                push([0, 1].map(|c| a[c] + t * (b[c] - a[c])));
            }
        }
        out
    }

    /// Area and centroid.
    fn area_and_middle(&self) -> (f64, Point) {
        let origin = self.corners[0];
        let (mut twice, mut moment) = (0.0, [0.0; 2]);
        for pair in self.corners[..self.count].windows(2) {
            let (a, b) = ([0, 1].map(|c| pair[0][c] - origin[c]), [0, 1].map(|c| pair[1][c] - origin[c]));
            let cross = a[0] * b[1] - a[1] * b[0];
            twice += cross;
            (0..2).for_each(|c| moment[c] += cross * (a[c] + b[c]) / 3.0);
        }
        if twice == 0.0 { (0.0, origin) } else { (twice.abs() / 2.0, [0, 1].map(|c| origin[c] + moment[c] / twice)) }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::calibration::pinhole::Pinhole;
    use crate::calibration::{Homography, LensMap};
    use crate::optics::Lens;
    use crate::transport::PixelLayout;

    const DOORWAY: Doorway = Doorway { width_m: 0.6, wall_thickness_m: 0.1, height_m: None, leaf: None };

    fn patch(size: usize) -> PatchGrid {
        PatchGrid { size, fov_m: 0.3, layout: PixelLayout::Cells }
    }

    /// A camera at `height` that looks down at the middle of the door from `back` metres in front of it, zoomed so that
    /// the patches fill most of its image.
    fn camera(height: f64, back: f64, turn: f64, width: usize, k1: f64) -> (Camera, (usize, usize)) {
        let size = (width, width * 5 / 8);
        let at = [turn, -0.25 - back, height];
        let distance = height.hypot(back).hypot(turn);
        let pinhole = Pinhole {
            at,
            tilt: (height / back.hypot(turn)).atan(),
            turn: (-turn).atan2(back),
            roll: 0.03,
            focal: 0.6 * width as f64 * distance,
            centre: [(size.0 - 1) as f64 / 2.0, (size.1 - 1) as f64 / 2.0],
        };
        let floor: [Point; 4] = [[-0.4, -0.12], [0.4, -0.12], [0.4, -0.38], [-0.4, -0.38]];
        let homography = Homography::fit(&floor.map(|f| (f, pinhole.see(f).unwrap()))).unwrap();
        let lens = Lens { k1, k2: 0.0, focal_px: Some(2.0 * width as f64) };
        let lens = LensMap::new(&lens, [size.0, size.1]).unwrap();
        (Camera::new(homography, (k1 != 0.0).then_some(lens)), size)
    }

    /// A camera's image of a floor: each pixel is the mean of 8 x 8 samples of the light that falls into it.
    fn photograph(camera: &Camera, (width, height): (usize, usize), light: impl Fn(Point) -> f64) -> Vec<f64> {
        const FINE: usize = 8;
        let within = |n: usize| (n as f64 + 0.5) / FINE as f64 - 0.5;
        (0..width * height)
            .map(|k| {
                let (u, v) = ((k % width) as f64, (k / width) as f64);
                let sample = |s: usize| camera.floor([u + within(s % FINE), v + within(s / FINE)]).map_or(0.0, &light);
                (0..FINE * FINE).map(sample).sum::<f64>() / (FINE * FINE) as f64
            })
            .collect()
    }

    fn value(footprint: &Footprint, image: &[f64]) -> f64 {
        footprint.iter().map(|&(k, weight)| f64::from(weight) * image[k as usize]).sum()
    }

    /// Pixels of the image between its border and the nearest corner of a patch pixel's square; infinite if a corner is
    /// not projected at all.
    fn from_border(camera: &Camera, (width, height): (usize, usize), side: Side, size: usize, pixel: usize) -> f64 {
        let plan = Plan::new(&DOORWAY, &patch(size), side);
        let corners =
            [[0, 0], [1, 0], [0, 1], [1, 1]].map(|[i, j]| [(pixel % size + i) as f64, (pixel / size + j) as f64]);
        let distance = |corner: Point| {
            let Some([u, v]) = camera.project(plan.floor(corner)) else { return f64::INFINITY };
            let of = |at: f64, size: usize| (at + 0.5).abs().min((at - size as f64 + 0.5).abs());
            of(u, width).min(of(v, height))
        };
        corners.into_iter().map(distance).fold(f64::INFINITY, f64::min)
    }

    proptest! {
        #![proptest_config(crate::testing::cases(24))]

        #[test]
        fn a_constant_stays_one_and_what_is_seen_whole_is_known_beforehand(
            height in 0.4..2.0f64, back in 0.2..2.5f64, turn in -0.6..0.6f64, width in 60usize..400, size in 4usize..24, k1 in -0.3..0.3f64,
        ) {
            let (camera, image) = camera(height, back, turn, width, k1);
            for side in Side::BOTH {
                let footprints = footprints(&DOORWAY, &patch(size), side, &camera, image);
                let seen = PatchSight::new(&DOORWAY, &patch(size), side, &camera, [image.0, image.1]).whole;
                for (k, (footprint, seen)) in footprints.iter().zip(seen).enumerate() {
                    // Squares that end at the image's border, to a fiftieth of a pixel, may count as seen or not.
                    if from_border(&camera, image, side, size, k) > 0.02 {
                        prop_assert_eq!(!footprint.is_empty(), seen);
                    }
                    let sum: f64 = footprint.iter().map(|t| f64::from(t.1)).sum();
                    prop_assert!(footprint.is_empty() || (sum - 1.0).abs() < 1e-5, "{sum}");
                }
            }
        }

        #[test]
        fn a_ramp_over_the_image_is_read_at_each_squares_middle_of_gravity(
            height in 0.4..2.0f64, back in 0.2..2.5f64, width in 60usize..400, size in 4usize..24, k1 in -0.3..0.3f64,
        ) {
            let (camera, (width, rows)) = camera(height, back, 0.1, width, k1);
            let image: Vec<f64> = (0..width * rows).map(|k| (k % width) as f64 + 0.3 * (k / width) as f64).collect();
            let patch = patch(size);
            let footprints = footprints(&DOORWAY, &patch, Side::Left, &camera, (width, rows));
            let plan = Plan::new(&DOORWAY, &patch, Side::Left);
            let view = View::new(&plan, &camera, (width, rows));
            // At the wall and at the image's border the slope has a neighbour on one side only.
            let clear = |k: usize| {
                let corners = [[0, 0], [0, 1], [1, 1], [1, 0]].map(|[i, j]| [(k % size + j) as f64, (k / size + i) as f64]);
                corners.into_iter().all(|at| {
                    let seen = camera.project(plan.floor(at)).unwrap().map(|c| c.round() as i64);
                    (-1..=1).all(|dv| (-1..=1).all(|du| view.floor_alone([seen[0] + du, seen[1] + dv])))
                })
            };
            for (k, footprint) in footprints.iter().enumerate().filter(|(_, f)| !f.is_empty()) {
                if !clear(k) {
                    continue;
                }
                let sample = |s: usize| {
                    let within = |n: usize| (n as f64 + 0.5) / 16.0;
                    let at = [(k % size) as f64 + within(s % 16), (k / size) as f64 + within(s / 16)];
                    let [u, v] = camera.project(plan.floor(at)).unwrap();
                    u + 0.3 * v
                };
                let truth = (0..256).map(sample).sum::<f64>() / 256.0;
                let got = value(footprint, &image);
                prop_assert!((got - truth).abs() < 0.02, "{k}: {got} {truth}");
            }
        }
    }

    #[test]
    fn shares_are_those_of_brute_force() {
        // A patch pixel covers many image pixels, a few, or less than one; from above and obliquely, through a lens.
        for (height, back, width, size) in
            [(1.0, 0.3, 640, 8), (0.5, 1.5, 640, 16), (1.0, 1.0, 200, 32), (0.6, 1.0, 60, 48)]
        {
            let (camera, image) = camera(height, back, 0.2, width, -0.2);
            let patch = patch(size);
            let plan = Plan::new(&DOORWAY, &patch, Side::Right);
            let view = View::new(&plan, &camera, image);
            let mut shares: Vec<Vec<Share>> = vec![Vec::new(); patch.pixels()];
            view.pixels().for_each(|p| plan.share(p, view.quad(p).unwrap(), &mut shares));
            for k in [0, size / 2, 5 * size + 3, patch.pixels() - 1] {
                const FINE: usize = 64;
                let within = |n: usize| (n as f64 + 0.5) / FINE as f64;
                let mut counts = std::collections::HashMap::new();
                for s in 0..FINE * FINE {
                    let at = [(k % size) as f64 + within(s % FINE), (k / size) as f64 + within(s / FINE)];
                    let [u, v] = camera.project(plan.floor(at)).unwrap();
                    *counts.entry([u.round() as usize, v.round() as usize]).or_insert(0.0) +=
                        1.0 / (FINE * FINE) as f64;
                }
                let ours: f64 = shares[k].iter().map(|s| s.area).sum();
                assert!((ours - 1.0).abs() < 1e-9, "{ours}");
                for share in &shares[k] {
                    let brute = counts.remove(&share.pixel).unwrap_or(0.0);
                    assert!((share.area - brute).abs() < 0.02, "{k} {:?}: {} {brute}", share.pixel, share.area);
                }
                assert!(counts.values().sum::<f64>() < 1e-9, "every image pixel is there");
            }
        }
    }

    #[test]
    fn cameras_above_and_at_a_slant_agree_with_the_floor() {
        // Light as smooth as a penumbra: a wavelength of 8 cm.
        let light = |[x, y]: Point| 1.0 + 0.3 * (80.0 * x + 0.5).sin() * (75.0 * y).cos();
        let patch = patch(24);
        for (height, back, width, limits) in [
            (1.2, 0.05, 400, (0.03, 0.001)),
            (0.9, 1.5, 400, (0.15, 0.01)),
            (0.5, 1.5, 640, (0.15, 0.01)),
            // A wave is six image pixels long here.
            (1.0, 0.8, 160, (0.2, 0.05)),
        ] {
            let (camera, size) = camera(height, back, 0.15, width, -0.15);
            let image = photograph(&camera, size, light);
            let plan = Plan::new(&DOORWAY, &patch, Side::Left);
            let footprints = footprints(&DOORWAY, &patch, Side::Left, &camera, size);
            let mut worst = (0.0_f64, 0.0_f64);
            for (k, footprint) in footprints.iter().enumerate() {
                assert!(!footprint.is_empty());
                let sample = |s: usize| {
                    let within = |n: usize| (n as f64 + 0.5) / 16.0;
                    light(plan.floor([(k % 24) as f64 + within(s % 16), (k / 24) as f64 + within(s / 16)]))
                };
                let off = (value(footprint, &image) - (0..256).map(sample).sum::<f64>() / 256.0).abs();
                if k < 24 { worst.0 = worst.0.max(off) } else { worst.1 = worst.1.max(off) }
            }
            // At the wall light is taken as constant over a pixel, which at a slant spans much of a wave.
            assert!(worst.0 < limits.0 && worst.1 < limits.1, "{worst:?}");
        }
    }
}
