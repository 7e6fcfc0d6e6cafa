//! Light from the hidden side at a floor point, by eq. 2 with the radiometric law and first-hit occlusion.
//!
//! A Lambertian surface of radiance L adds L cos ϑ dω to the light on the floor, with ϑ the angle from the vertical.
//! With azimuth φ and elevation ε, cos ϑ = sin ε and dω = cos ε dε dφ. A vertical surface of height H that stands on
//! the floor at horizontal distance ρ(φ) fills the elevations with tan ε <= H / ρ, so the integral over ε has a closed
//! form:
//!
//! ```text
//! E(p) = ∫ dφ L(φ) ½ s,   s = sin² ε_top = H² / (ρ² + H²)
//! ```
//!
//! A nearer surface hides its elevations: along each azimuth, a surface contributes only the part of its s above the
//! largest s in front of it. The azimuths are those that pass both faces of the wall between the edges; a lintel cuts
//! the elevations at the s of its height at the hidden face. As everywhere in this program, the factor albedo / π is
//! left out: E is in units of radiance times steradian, and radiance is relative to the camera's full scale.

use doorcam_core::geometry::{Doorway, Point};
use doorcam_core::quadrature::Quadrature;
use doorcam_core::scene::Rgb;

/// A luminous vertical rectangle that stands on the floor. Both of its faces shine. Walls may touch but not cross.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wall {
    /// One end of its foot, in metres in the door frame.
    pub from: Point,
    /// The other end.
    pub to: Point,
    /// Its height, in metres.
    pub height_m: f64,
    /// Its radiance.
    pub radiance: Rgb,
}

/// A luminous vertical cylinder that stands on the floor: a person. Cylinders must not cross each other; one that is
/// half inside a wall shows its nearer part.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cylinder {
    /// Its axis, in metres in the door frame.
    pub centre: Point,
    /// Its radius, in metres.
    pub radius_m: f64,
    /// Its height, in metres.
    pub height_m: f64,
    /// Its radiance.
    pub radiance: Rgb,
}

/// The light that comes through a doorway from a room.
#[derive(Debug, Clone)]
pub struct DirectLight {
    doorway: Doorway,
    walls: Vec<Wall>,
    rule: Quadrature,
}

/// The people in the room at one moment.
#[derive(Debug, Clone)]
pub struct Crowd {
    cylinders: Vec<Cylinder>,
    /// Where people's outlines cross walls, which changes what is hit first.
    crossings: Vec<Point>,
}

/// A surface that an azimuth meets.
struct Hit {
    distance: f64,
    /// H² / (ρ² + H²).
    s: f64,
    radiance: Rgb,
}

impl DirectLight {
    /// A room behind a doorway; `rule` integrates over each interval of azimuth in which the same surfaces are met.
    pub fn new(doorway: Doorway, walls: Vec<Wall>, rule: Quadrature) -> Self {
        Self { doorway, walls, rule }
    }

    /// Prepares people for [`DirectLight::change`].
    pub fn crowd(&self, cylinders: Vec<Cylinder>) -> Crowd {
        let crossings = cylinders.iter().flat_map(|c| self.walls.iter().flat_map(move |w| crossings(c, w))).collect();
        Crowd { cylinders, crossings }
    }

    /// E at a floor point of the visible side, from the room without people.
    pub fn empty(&self, pixel: Point) -> Rgb {
        let breaks = self.breaks(pixel, self.walls.iter().flat_map(|w| [w.from, w.to]).map(|p| azimuth(pixel, p)));
        let mut hits = Vec::new();
        let mut light = [0.0; 3];
        for (from, to) in breaks.windows(2).map(|pair| (pair[0], pair[1])) {
            for (phi, weight) in self.rule.over(from, to) {
                hits.clear();
                let ray = direction(phi);
                self.meet_walls(pixel, ray, &mut hits);
                add(&mut light, weight, self.shine(&mut hits, pixel, ray));
            }
        }
        light
    }

    /// People's change of E at a floor point: only azimuths that meet somebody are integrated.
    pub fn change(&self, crowd: &Crowd, pixel: Point) -> Rgb {
        let outlines = crowd.cylinders.iter().flat_map(|c| outline(pixel, c));
        let corners = self.walls.iter().flat_map(|w| [w.from, w.to]).chain(crowd.crossings.iter().copied());
        let breaks = self.breaks(pixel, outlines.chain(corners.map(|p| azimuth(pixel, p))));
        let mut hits = Vec::new();
        let mut light = [0.0; 3];
        for (from, to) in breaks.windows(2).map(|pair| (pair[0], pair[1])) {
            let middle = direction((from + to) / 2.0);
            if !crowd.cylinders.iter().any(|c| meet_cylinder(pixel, middle, c).is_some()) {
                continue;
            }
            for (phi, weight) in self.rule.over(from, to) {
                hits.clear();
                let ray = direction(phi);
                self.meet_walls(pixel, ray, &mut hits);
                add(&mut light, -weight, self.shine(&mut hits, pixel, ray));
                hits.extend(crowd.cylinders.iter().filter_map(|c| meet_cylinder(pixel, ray, c)));
                add(&mut light, weight, self.shine(&mut hits, pixel, ray));
            }
        }
        light
    }

    /// The ends of the visible azimuths and the given azimuths between them, rising; empty if the opening is not seen.
    fn breaks(&self, pixel: Point, azimuths: impl Iterator<Item = f64>) -> Vec<f64> {
        let Some((first, last)) = self.visible(pixel) else {
            return Vec::new();
        };
        let mut breaks = vec![first, last];
        breaks.extend(azimuths.filter(|&a| a > first && a < last));
        breaks.sort_by(f64::total_cmp);
        breaks
    }

    /// The azimuths that pass the visible face, y = −T, and the hidden face, y = 0, between the edges.
    fn visible(&self, [x, y]: Point) -> Option<(f64, f64)> {
        let half = self.doorway.half_width();
        let faces = [-self.doorway.wall_thickness_m - y, -y];
        let first = faces.iter().map(|&d| (-half - x).atan2(d)).fold(f64::NEG_INFINITY, f64::max);
        let last = faces.iter().map(|&d| (half - x).atan2(d)).fold(f64::INFINITY, f64::min);
        (first < last).then_some((first, last))
    }

    fn meet_walls(&self, pixel: Point, ray: Point, hits: &mut Vec<Hit>) {
        hits.extend(self.walls.iter().filter_map(|w| meet_wall(pixel, ray, w)));
    }

    /// ∫ L sin ε cos ε dε along one azimuth: each surface contributes the elevations that nothing nearer hides.
    fn shine(&self, hits: &mut [Hit], pixel: Point, ray: Point) -> Rgb {
        hits.sort_by(|a, b| a.distance.total_cmp(&b.distance));
        let open = self.doorway.height_m.map_or(1.0, |height| {
            let hidden_face = -pixel[1] / ray[1];
            sine_squared(height, hidden_face)
        });
        let mut covered = 0.0;
        let mut light = [0.0; 3];
        for hit in hits {
            let s = hit.s.min(open);
            if s > covered {
                add(&mut light, 0.5 * (s - covered), hit.radiance);
                covered = s;
            }
        }
        light
    }
}

fn add(sum: &mut Rgb, factor: f64, light: Rgb) {
    for (sum, light) in sum.iter_mut().zip(light) {
        *sum += factor * light;
    }
}

/// H² / (ρ² + H²).
fn sine_squared(height: f64, distance: f64) -> f64 {
    let h2 = height * height;
    h2 / (distance * distance + h2)
}

/// Azimuth of a point seen from a floor point, in radians: 0 straight into the room, positive to the right.
fn azimuth(pixel: Point, [x, y]: Point) -> f64 {
    (x - pixel[0]).atan2(y - pixel[1])
}

/// The unit vector of an azimuth.
fn direction(phi: f64) -> Point {
    let (sine, cosine) = phi.sin_cos();
    [sine, cosine]
}

fn cross(a: Point, b: Point) -> f64 {
    a[0] * b[1] - a[1] * b[0]
}

fn meet_wall(pixel: Point, ray: Point, wall: &Wall) -> Option<Hit> {
    let along = [wall.to[0] - wall.from[0], wall.to[1] - wall.from[1]];
    let foot = [wall.from[0] - pixel[0], wall.from[1] - pixel[1]];
    // pixel + ρ ray = from + t along; a ray parallel to the wall gives an infinity or NaN, which meets nothing.
    let across = cross(ray, along);
    let (distance, t) = (cross(foot, along) / across, cross(foot, ray) / across);
    (distance > 0.0 && (0.0..=1.0).contains(&t)).then(|| Hit {
        distance,
        s: sine_squared(wall.height_m, distance),
        radiance: wall.radiance,
    })
}

fn meet_cylinder(pixel: Point, ray: Point, cylinder: &Cylinder) -> Option<Hit> {
    let centre = [cylinder.centre[0] - pixel[0], cylinder.centre[1] - pixel[1]];
    let beside = cross(ray, centre);
    let half_chord2 = cylinder.radius_m * cylinder.radius_m - beside * beside;
    let distance = centre[0] * ray[0] + centre[1] * ray[1] - half_chord2.max(0.0).sqrt();
    (half_chord2 > 0.0 && distance > 0.0).then(|| Hit {
        distance,
        s: sine_squared(cylinder.height_m, distance),
        radiance: cylinder.radiance,
    })
}

/// The two azimuths at which a ray touches a cylinder; from inside it NaN, which no interval contains.
fn outline(pixel: Point, cylinder: &Cylinder) -> [f64; 2] {
    let middle = azimuth(pixel, cylinder.centre);
    let range = (cylinder.centre[0] - pixel[0]).hypot(cylinder.centre[1] - pixel[1]);
    let half = (cylinder.radius_m / range).asin();
    [middle - half, middle + half]
}

/// Where a cylinder's foot crosses a wall's.
fn crossings(cylinder: &Cylinder, wall: &Wall) -> impl Iterator<Item = Point> + use<> {
    let (from, to) = (wall.from, wall.to);
    let along = [to[0] - from[0], to[1] - from[1]];
    let centre = [cylinder.centre[0] - from[0], cylinder.centre[1] - from[1]];
    let length2 = along[0] * along[0] + along[1] * along[1];
    let nearest = (centre[0] * along[0] + centre[1] * along[1]) / length2;
    let beside = cross(along, centre) / length2;
    // For a cylinder that does not reach the wall the square root is NaN, which no range contains.
    let half = (cylinder.radius_m * cylinder.radius_m / length2 - beside * beside).sqrt();
    [nearest - half, nearest + half]
        .into_iter()
        .filter(|t| (0.0..=1.0).contains(t))
        .map(move |t| [from[0] + t * along[0], from[1] + t * along[1]])
}

#[cfg(test)]
#[path = "direct_tests.rs"]
mod tests;
