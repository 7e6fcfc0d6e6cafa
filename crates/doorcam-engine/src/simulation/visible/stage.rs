use rayon::prelude::*;

use super::super::room::Vector;
use super::super::view::{Pinhole, View};
use super::body::Body;
use super::capsule::{Capsule, along, dot, sub};
use super::lamp::{VisibleLamp, lit_through};
use doorcam_core::geometry::{Doorway, Point};
use doorcam_core::scene::Rgb;

/// Samples along each side of a pixel in which a body is looked for.
const SAMPLES: usize = 2;
/// Half of the floor that a pixel shows, in metres, by which shadows are softened.
const HALF_PIXEL_M: f64 = 0.0015;
/// Part of the light that hits a body and goes on to the floor, relative to its albedo.
const REFLECTED: f64 = 0.5;

/// What the visible side makes of a pixel.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(in crate::simulation) struct Sight {
    /// The visible side's light on the floor, in multiples of what falls there on the whole.
    pub(in crate::simulation) floor: [f32; 3],
    /// Share of the pixel that a body covers.
    pub(in crate::simulation) covered: f32,
    /// The light that comes from the body, times that share.
    pub(in crate::simulation) body: [f32; 3],
}

/// The visible side at one moment.
pub(in crate::simulation) struct Stage<'a> {
    pub(in crate::simulation) doorway: &'a Doorway,
    pub(in crate::simulation) lamps: &'a [VisibleLamp],
    /// Part of the light that comes from everywhere.
    pub(in crate::simulation) ambient: f64,
    pub(in crate::simulation) bodies: &'a [Body],
    /// The visible side's light, of which `lamps` and `ambient` are parts.
    pub(in crate::simulation) visible: Rgb,
    /// The hidden room's light on the floor at a place.
    pub(in crate::simulation) hidden: &'a (dyn Fn(Point) -> Rgb + Sync),
}

/// A capsule in the picture.
struct Drawn<'a> {
    capsule: &'a Capsule,
    albedo: Rgb,
    /// Columns and rows in which it may be seen.
    bounds: [[f64; 2]; 2],
}

impl Stage<'_> {
    /// What is seen of the visible side in each pixel; nobody if no camera is given.
    pub(in crate::simulation) fn sights(&self, view: &View, camera: Option<&Pinhole>) -> Vec<Sight> {
        let drawn: Vec<Drawn<'_>> = camera.map_or_else(Vec::new, |camera| self.drawn(camera));
        let mut sights = vec![Sight::default(); view.pixels.len()];
        let rows = sights.par_chunks_mut(view.width).zip(view.places.par_chunks(view.width)).enumerate();
        rows.for_each(|(row, (sights, places))| {
            let first = row * view.width;
            for (k, (sight, place)) in sights.iter_mut().zip(places).enumerate() {
                let light = self.on_floor(place.map(f64::from), f64::from(view.pixels[first + k].visible));
                sight.floor = [light as f32; 3];
            }
            let Some(camera) = camera else { return };
            let here: Vec<&Drawn<'_>> = drawn.iter().filter(|d| d.reaches(1, row)).collect();
            if !here.is_empty() {
                for (column, sight) in sights.iter_mut().enumerate() {
                    self.draw(camera, &here, [column, row], sight);
                }
            }
        });
        sights
    }

    fn drawn(&self, camera: &Pinhole) -> Vec<Drawn<'_>> {
        let capsules = self.bodies.iter().flat_map(|body| &body.capsules);
        let bounds = |capsule: &Capsule| {
            let ends = [capsule.from, capsule.to].map(|end| camera.bounds(end, capsule.radius));
            match ends {
                [Some(a), Some(b)] => Some([0, 1].map(|k| [a[k][0].min(b[k][0]), a[k][1].max(b[k][1])])),
                // One end is not in the picture, but what lies between may be.
                [None, None] => None,
                _ => Some([[0.0, f64::INFINITY]; 2]),
            }
        };
        let drawn =
            capsules.map(|(capsule, albedo)| Some(Drawn { capsule, albedo: *albedo, bounds: bounds(capsule)? }));
        drawn.flatten().collect()
    }

    /// The visible side's light on the floor at a place. `sky` is the part of the light from everywhere that arrives
    /// there if nobody is in its way.
    fn on_floor(&self, [x, y]: Point, sky: f64) -> f64 {
        if x.is_nan() {
            return 0.0;
        }
        let mut open = sky;
        for body in self.bodies {
            open -= body.covers([x, y]);
        }
        let place = [x, y, 0.0];
        let lamps = self.lamps.iter().map(|lamp| {
            let seen = lit_through(self.doorway, lamp.at, lamp.radius, place);
            if seen <= 0.0 {
                return 0.0;
            }
            let free: f64 = self.bodies.iter().map(|body| 1.0 - body.hides(place, lamp)).product();
            lamp.on_floor([x, y]) * seen * free
        });
        self.ambient * open.max(0.0) + lamps.sum::<f64>()
    }

    fn draw(&self, camera: &Pinhole, here: &[&Drawn<'_>], [column, row]: [usize; 2], sight: &mut Sight) {
        if !here.iter().any(|drawn| drawn.reaches(0, column)) {
            return;
        }
        let share = 1.0 / (SAMPLES * SAMPLES) as f64;
        for k in 0..SAMPLES * SAMPLES {
            let offset = |k: usize| (k as f64 + 0.5) / SAMPLES as f64 - 0.5;
            let pixel = [column as f64 + offset(k % SAMPLES), row as f64 + offset(k / SAMPLES)];
            let ray = camera.ray(pixel);
            let mut nearest: Option<(f64, &Drawn<'_>)> = None;
            for &drawn in here.iter().filter(|drawn| drawn.reaches(0, column)) {
                let met = drawn.capsule.meet(camera.at, ray);
                if let Some(t) = met.filter(|&t| nearest.is_none_or(|(first, _)| t < first)) {
                    nearest = Some((t, drawn));
                }
            }
            let Some((t, drawn)) = nearest.filter(|(t, _)| *t < camera.meet(self.doorway, pixel).1) else { continue };
            let at = along(camera.at, t, ray);
            let light = self.on_body(at, drawn.capsule.normal(at));
            sight.covered += share as f32;
            (0..3).for_each(|c| sight.body[c] += (share * drawn.albedo[c] * light[c]) as f32);
        }
    }

    /// The light of both sides on a body.
    fn on_body(&self, at: Vector, normal: Vector) -> Rgb {
        let [x, y, z] = at;
        // The sky of the visible side is above and all around; in the room, little of it is left.
        let outside = 1.0 - ((y + self.doorway.wall_thickness_m) / 0.5).clamp(0.0, 0.8);
        let mut visible = self.ambient * outside * (0.6 + 0.4 * normal[2]);
        for lamp in self.lamps {
            let d = sub(lamp.at, at);
            let d2 = dot(d, d);
            let facing = dot(d, normal) / d2.sqrt();
            if facing > 0.0 {
                visible += lamp.intensity * facing / d2 * lit_through(self.doorway, lamp.at, lamp.radius, at);
            }
        }
        let hidden = (self.hidden)([x, y]);
        let facing = if y < 0.0 { (0.4 + 0.6 * normal[1]).max(0.1) } else { 0.6 + 0.3 * normal[2] };
        // Above the lintel nothing of the room is seen from before the wall.
        let facing = if y < 0.0 && self.doorway.height_m.is_some_and(|h| z > h) { 0.1 * facing } else { facing };
        [0, 1, 2].map(|c| self.visible[c] * visible + hidden[c] * facing)
    }
}

impl Drawn<'_> {
    fn reaches(&self, axis: usize, at: usize) -> bool {
        let [low, high] = self.bounds[axis];
        (low - 1.0..=high + 1.0).contains(&(at as f64))
    }
}

impl Body {
    /// The share of a lamp that it hides from a place.
    fn hides(&self, place: Vector, lamp: &VisibleLamp) -> f64 {
        if self.hull.hides(place, HALF_PIXEL_M, lamp.at, lamp.radius) <= 0.0 {
            return 0.0;
        }
        // Each part takes its share of what the others leave.
        let hidden = |(capsule, _): &(Capsule, Rgb)| capsule.hides(place, HALF_PIXEL_M, lamp.at, lamp.radius);
        1.0 - self.capsules.iter().map(|part| 1.0 - hidden(part)).product::<f64>()
    }

    /// The share of the light from everywhere, on the floor at a place, that it takes away: ∫∫ ½ ds dφ / π over what it
    /// covers of the sky, less what it reflects. Behind the wall it covers nothing of the sky.
    fn covers(&self, place: Point) -> f64 {
        let share = self.columns.iter().map(|(part, albedo)| {
            let [dx, dy] = [part.centre[0] - place[0], part.centre[1] - place[1]];
            let before = (1.0 - part.centre[1] / part.radius).clamp(0.0, 1.0);
            if before == 0.0 {
                return 0.0;
            }
            let d2 = dx * dx + dy * dy;
            let (d, r) = (d2.sqrt(), part.radius);
            // Half of the azimuths that it covers, as a share of π: all of them from inside.
            let width = if d > r { (r / d).asin() / std::f64::consts::PI } else { 1.0 - 0.5 * d / r };
            let sine_squared = |height: f64, distance: f64| height * height / (height * height + distance * distance);
            let top = sine_squared(part.top, (d - r).max(0.0));
            let bottom = if part.bottom > 0.0 { sine_squared(part.bottom, d + r) } else { 0.0 };
            let dark = 1.0 - REFLECTED * albedo.iter().sum::<f64>() / 3.0;
            before * dark * width * (top - bottom).max(0.0)
        });
        share.sum()
    }
}

#[cfg(test)]
#[path = "stage_tests.rs"]
mod tests;
