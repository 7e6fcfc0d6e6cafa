use rayon::prelude::*;

use super::floor::{FloorMap, Tap};
use super::room::Vector;
use super::scenario::{CameraSpec, FloorSpec};
use super::visible::WallSpec;
use doorcam_core::geometry::{Doorway, Point, Side};
use doorcam_core::optics::FloorPoint;
use doorcam_core::scene::Rgb;
use doorcam_core::transport::{PatchGrid, PixelLayout};

/// Samples along each side of a pixel, over which its content is averaged.
const SAMPLES: usize = 3;
/// The sides of the opening, and what is far in the room, have a uniform albedo.
const JAMB: [f32; 3] = [0.35, 0.34, 0.32];
const BEYOND: [f32; 3] = [0.12, 0.12, 0.12];
/// The room's floor is shown up to this distance behind the doorway, in metres; the camera itself never sees people.
const SHOWN_M: f64 = 1.0;

/// Nothing nearer than this is seen, in metres.
const NEAREST_M: f64 = 0.02;

/// The content of a pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Pixel {
    /// Interpolation of the light on the floor.
    pub(super) taps: [Tap; 2],
    /// Albedo of the floor, times the share of the pixel that is floor.
    pub(super) floor: [f32; 3],
    /// Albedo of the rest, times its share of the pixel. Only the visible side's light falls on it.
    pub(super) flat: [f32; 3],
    /// The part of the visible side's light that falls on the floor here.
    pub(super) visible: f32,
}

/// What a line of sight ends at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Surface {
    /// The floor at (x, y).
    Floor(Point),
    /// The wall's visible face at (x, z).
    Face(Point),
    /// A side of the opening.
    Jamb,
    /// The depth of the room.
    Beyond,
}

/// What is seen.
#[derive(Debug, Clone, Copy)]
pub(super) struct Seen<'a> {
    pub(super) doorway: &'a Doorway,
    pub(super) floor: &'a FloorSpec,
    pub(super) wall: &'a WallSpec,
    pub(super) map: &'a FloorMap,
}

/// All pixels of a frame, row by row from the top left: of a picture, or of the left patch followed by the right.
#[derive(Debug, Clone)]
pub(super) struct View {
    pub(super) pixels: Vec<Pixel>,
    pub(super) width: usize,
    /// The place on the floor that each pixel shows, not a number where it shows none.
    pub(super) places: Vec<[f32; 2]>,
}

/// A pinhole camera.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pinhole {
    pub(super) at: Vector,
    ahead: Vector,
    right: Vector,
    down: Vector,
    focal: f64,
    size: [usize; 2],
    /// How its picture has moved.
    bump: Bump,
}

/// How a camera's picture moves when somebody bumps it: it turns about its middle, and shifts.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Bump {
    /// To the right and down, in pixels.
    pub(super) shift: Point,
    /// What it shows turns clockwise by this, in degrees.
    pub(super) turn_deg: f64,
}

impl Bump {
    /// Where a pixel, counted from the middle of the picture, moves to.
    fn moves(&self, [u, v]: Point) -> Point {
        let (sine, cosine) = self.turn_deg.to_radians().sin_cos();
        [cosine * u - sine * v + self.shift[0], sine * u + cosine * v + self.shift[1]]
    }

    /// Where it was before.
    fn undone(&self, [u, v]: Point) -> Point {
        let (u, v) = (u - self.shift[0], v - self.shift[1]);
        let (sine, cosine) = self.turn_deg.to_radians().sin_cos();
        [cosine * u + sine * v, cosine * v - sine * u]
    }
}

fn cross(a: Vector, b: Vector) -> Vector {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn unit(a: Vector) -> Option<Vector> {
    let length = dot(a, a).sqrt();
    (length > 1e-6).then(|| a.map(|x| x / length))
}

impl Pinhole {
    pub(super) fn new(spec: &CameraSpec) -> Self {
        let at = spec.at_m;
        let towards = [spec.look_at_m[0] - at[0], spec.look_at_m[1] - at[1], -at[2]];
        let ahead = unit(towards).unwrap_or([0.0, 0.0, -1.0]);
        // If it looks straight down, the wall is at the top of the picture.
        let level = unit(cross(ahead, [0.0, 0.0, 1.0])).unwrap_or([1.0, 0.0, 0.0]);
        let below = cross(ahead, level);
        let (sine, cosine) = spec.roll_deg.to_radians().sin_cos();
        let turned = |a: Vector, b: Vector, sine: f64| [0, 1, 2].map(|k| cosine * a[k] + sine * b[k]);
        let focal = spec.size[0] as f64 / 2.0 / (spec.field_of_view_deg.to_radians() / 2.0).tan();
        let (right, down) = (turned(level, below, sine), turned(below, level, -sine));
        Self { at, ahead, right, down, focal, size: spec.size, bump: Bump::default() }
    }

    /// The same camera after a bump.
    pub(super) fn bumped(self, bump: Bump) -> Self {
        Self { bump, ..self }
    }

    /// Direction of a pixel's line of sight, as long as it goes 1 m straight ahead.
    pub(super) fn ray(&self, [u, v]: Point) -> Vector {
        let [x, y] = self.bump.undone([u - self.middle(0), v - self.middle(1)]).map(|d| d / self.focal);
        [0, 1, 2].map(|k| self.ahead[k] + x * self.right[k] + y * self.down[k])
    }

    fn middle(&self, axis: usize) -> f64 {
        (self.size[axis] as f64 - 1.0) / 2.0
    }

    /// The pixel at which a floor point is seen; none outside the picture.
    pub(super) fn see(&self, [x, y]: Point) -> Option<Point> {
        let d = [x - self.at[0], y - self.at[1], -self.at[2]];
        let depth = dot(d, self.ahead);
        let [u, v] = self.bump.moves([self.right, self.down].map(|axis| self.focal * dot(d, axis) / depth));
        let pixel = [self.middle(0) + u, self.middle(1) + v];
        let within = |k: usize| (0.0..=self.size[k] as f64 - 1.0).contains(&pixel[k]);
        (depth > 0.05 && within(0) && within(1)).then_some(pixel)
    }

    /// A range of columns and rows outside which nothing of a ball is seen; none if nothing is.
    pub(super) fn bounds(&self, centre: Vector, radius: f64) -> Option<[[f64; 2]; 2]> {
        let d = [0, 1, 2].map(|k| centre[k] - self.at[k]);
        let depth = dot(d, self.ahead);
        if depth + radius < NEAREST_M {
            return None;
        }
        if depth - radius < NEAREST_M {
            return Some([0, 1].map(|k| [0.0, self.size[k] as f64]));
        }
        // The ball is in a box, whose corners bound its picture.
        let range = |axis: Vector| {
            let aside = dot(d, axis);
            let ends = [aside - radius, aside + radius].map(|a| [a / (depth - radius), a / (depth + radius)]);
            let [low, high] = ends.map(|pair| pair.map(|e| e * self.focal));
            [low[0].min(low[1]), high[0].max(high[1])]
        };
        let ranges = [self.right, self.down].map(range);
        let mut bounds = [[f64::INFINITY, f64::NEG_INFINITY]; 2];
        for corner in 0..4 {
            let moved = self.bump.moves([ranges[0][corner % 2], ranges[1][corner / 2]]);
            for (k, bound) in bounds.iter_mut().enumerate() {
                let at = self.middle(k) + moved[k];
                *bound = [bound[0].min(at), bound[1].max(at)];
            }
        }
        let within = (0..2).all(|k| bounds[k][0] <= self.size[k] as f64 && bounds[k][1] >= -1.0);
        within.then_some(bounds)
    }

    /// What a pixel's line of sight ends at, and how far along it that is, in multiples of [`Pinhole::ray`]: infinitely
    /// far in the depth of the room.
    pub(super) fn meet(&self, doorway: &Doorway, pixel: Point) -> (Surface, f64) {
        let ray = self.ray(pixel);
        let at = |t: f64| [0, 1, 2].map(|k| self.at[k] + t * ray[k]);
        let open = |[x, _, z]: Vector| x.abs() < doorway.half_width() && doorway.height_m.is_none_or(|h| z < h);
        let floor = if ray[2] < 0.0 { -self.at[2] / ray[2] } else { f64::INFINITY };
        let plane = |y: f64| if ray[1] > 0.0 { (y - self.at[1]) / ray[1] } else { f64::INFINITY };
        let (face, hidden, far) = (plane(-doorway.wall_thickness_m), plane(0.0), plane(SHOWN_M));
        let [x, y, _] = at(floor.min(1e3));
        if floor <= face {
            return (Surface::Floor([x, y]), floor);
        }
        if !open(at(face)) {
            let [x, _, z] = at(face.min(1e3));
            return (Surface::Face([x, z]), face);
        }
        if floor <= hidden && x.abs() < doorway.half_width() {
            return (Surface::Floor([x, y]), floor);
        }
        if floor <= hidden || !open(at(hidden)) {
            return (Surface::Jamb, self.jamb(doorway, ray, face).min(hidden));
        }
        if floor <= far { (Surface::Floor([x, y]), floor) } else { (Surface::Beyond, f64::INFINITY) }
    }

    /// How far along a line of sight that has passed the visible face the side of the opening, or its lintel, is.
    fn jamb(&self, doorway: &Doorway, ray: Vector, face: f64) -> f64 {
        let side = if ray[0] > 0.0 { doorway.half_width() } else { -doorway.half_width() };
        let beside = (side - self.at[0]) / ray[0];
        let lintel = doorway.height_m.map_or(f64::INFINITY, |h| (h - self.at[2]) / ray[2]);
        // A ray along a surface gives an infinity or NaN, which is none of these.
        [beside, lintel].into_iter().filter(|t| *t >= face).fold(f64::INFINITY, f64::min)
    }
}

impl View {
    /// The view of a camera picture.
    pub(super) fn picture(camera: &Pinhole, seen: &Seen<'_>) -> Self {
        let [width, height] = camera.size;
        let of = |k: usize| {
            let at = |du: f64, dv: f64| camera.meet(seen.doorway, [(k % width) as f64 + du, (k / width) as f64 + dv]).0;
            pixel(at, seen)
        };
        Self::of_pixels((0..width * height).into_par_iter().map(of).unzip(), width)
    }

    /// The view of two patches.
    pub(super) fn patches(grid: &PatchGrid, seen: &Seen<'_>) -> Self {
        let side = grid.fov_m / grid.size as f64;
        let of = |point: Point| pixel(|du, dv| Surface::Floor([point[0] + du * side, point[1] - dv * side]), seen);
        let points: Vec<Point> = Side::BOTH.into_iter().flat_map(|s| grid.points(seen.doorway, s)).collect();
        Self::of_pixels(points.into_par_iter().map(of).unzip(), grid.size)
    }

    fn of_pixels((pixels, places): (Vec<Pixel>, Vec<[f32; 2]>), width: usize) -> Self {
        Self { pixels, places, width }
    }
}

/// The patches of layout "patches".
pub(super) fn patch_grid(camera: &CameraSpec) -> PatchGrid {
    PatchGrid { size: camera.size[0], fov_m: camera.fov_m, layout: PixelLayout::Cells }
}

/// The marks of a careful calibration that are in the picture: at the wall's foot and 0.3 m in front of it.
pub(super) fn floor_points(camera: &Pinhole, doorway: &Doorway) -> Vec<FloorPoint> {
    let (half, foot) = (doorway.half_width(), -doorway.wall_thickness_m);
    let across = [-half - 0.2, -half, 0.0, half, half + 0.2];
    let marks = [foot, foot - 0.3].into_iter().flat_map(|y| across.map(|x| [x, y]));
    marks.filter_map(|floor_m| Some(FloorPoint { pixel: camera.see(floor_m)?, floor_m })).collect()
}

/// Averages what the samples of a pixel see, at offsets of up to half a pixel. Also returns the place on the floor.
fn pixel(at: impl Fn(f64, f64) -> Surface, seen: &Seen<'_>) -> (Pixel, [f32; 2]) {
    let Seen { floor, wall, map, .. } = *seen;
    let mut pixel = Pixel { taps: [Tap::default(); 2], floor: [0.0; 3], flat: [0.0; 3], visible: 0.0 };
    let (mut place, mut on_floor) = ([0.0; 2], 0.0);
    let share = 1.0 / (SAMPLES * SAMPLES) as f32;
    let patterned = |albedo: Rgb, deviation: f64, grain: f64, at: Point| {
        let speckle = 1.0 + deviation * speckle(at, grain);
        albedo.map(|albedo| (albedo * speckle).clamp(0.0, 1.0) as f32)
    };
    for k in 0..SAMPLES * SAMPLES {
        let offset = |k: usize| (k as f64 + 0.5) / SAMPLES as f64 - 0.5;
        let flat = match at(offset(k % SAMPLES), offset(k / SAMPLES)) {
            Surface::Floor(point) => {
                let colour = patterned(floor.albedo, floor.speckle, floor.grain_m, point);
                (0..3).for_each(|c| pixel.floor[c] += share * colour[c]);
                place = [place[0] + point[0], place[1] + point[1]];
                on_floor += 1.0;
                continue;
            }
            Surface::Face(point) => patterned(wall.albedo, wall.speckle, wall.grain_m, point),
            Surface::Jamb => JAMB,
            Surface::Beyond => BEYOND,
        };
        (0..3).for_each(|c| pixel.flat[c] += share * flat[c]);
    }
    if on_floor == 0.0 {
        return (pixel, [f32::NAN; 2]);
    }
    let place = place.map(|p| p / on_floor);
    pixel.taps = map.taps(place);
    pixel.visible = map.visible_light(place) as f32;
    (pixel, place.map(|p| p as f32))
}

/// The floor's fixed pattern: for each grain a value of mean 0 and standard deviation 1.
fn speckle([x, y]: Point, grain: f64) -> f64 {
    let cell = |value: f64| (value / grain).floor() as i64 as u64;
    // SplitMix64 of the grain's number, so that neighbours are unrelated.
    let mut z = cell(x).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ cell(y).wrapping_mul(0xc2b2_ae3d_27d4_eb4f);
    let mut sum = 0.0;
    for _ in 0..3 {
        z = z.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut w = z;
        w = (w ^ (w >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        w = (w ^ (w >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        // Sum of three uniform numbers, each with a standard deviation of 1/√12.
        sum += ((w ^ (w >> 31)) >> 11) as f64 / (1_u64 << 53) as f64 - 0.5;
    }
    2.0 * sum
}

#[cfg(test)]
mod tests {
    use super::super::scenario::{SMALLEST, Scenario};
    use super::*;

    #[test]
    fn a_floor_point_is_seen_where_the_line_of_sight_meets_it() {
        let mut spec = Scenario::parse(SMALLEST).unwrap().camera;
        let doorway = Doorway { width_m: 0.8, wall_thickness_m: 0.1, height_m: None, leaf: None };
        for roll in [0.0, 7.0] {
            spec.roll_deg = roll;
            let camera = Pinhole::new(&spec);
            let points = floor_points(&camera, &doorway);
            assert!(points.len() >= 6, "{points:?}");
            for FloorPoint { pixel, floor_m: [x, y] } in points {
                // Just in front of the wall's foot, on which some of them are.
                let pixel = camera.see([x, y - 1e-9]).map_or(pixel, |p| p);
                let (Surface::Floor(found), _) = camera.meet(&doorway, pixel) else { panic!("{pixel:?} is floor") };
                assert!((found[0] - x).hypot(found[1] - y) < 1e-6, "{found:?} {x} {y}");
            }
            let middle = camera.see(spec.look_at_m).unwrap();
            assert!((middle[0] - 319.5).hypot(middle[1] - 179.5) < 1e-9);
        }
        // If the camera turns clockwise, the picture turns the other way.
        spec.roll_deg = 10.0;
        let right = Pinhole::new(&spec).see([0.2, -0.25]).unwrap();
        assert!(right[0] > 330.0 && right[1] < 179.5, "{right:?}");
    }

    #[test]
    fn the_speckle_has_mean_0_and_deviation_1() {
        let values: Vec<f64> = (0..40_000)
            .map(|k| speckle([f64::from(k % 200) * 0.004 - 0.398, f64::from(k / 200) * -0.004 - 0.002], 0.004))
            .collect();
        let mean = values.iter().sum::<f64>() / 4e4;
        let variance = values.iter().map(|v| v * v).sum::<f64>() / 4e4;
        let next = values.windows(2).map(|p| p[0] * p[1]).sum::<f64>() / 4e4;
        assert!(mean.abs() < 0.02 && (variance - 1.0).abs() < 0.03 && next.abs() < 0.02, "{mean} {variance} {next}");
    }
}
