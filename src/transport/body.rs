//! Light from what stands anywhere in the room, not on the grid: a person's outline, and smooth light of the walls.
//!
//! With azimuth φ and elevation ε, a Lambertian surface of radiance L adds L sin ε cos ε dε dφ to a floor point (the factor
//! albedo / π left out, as everywhere). Something that stands on the floor ρ away and is H high fills the elevations with
//! tan ε <= H / ρ, so that each azimuth of it adds ½ L H² / (ρ² + H²): eq. 2 with the radiometric law, integrated over
//! height in closed form.

use crate::geometry::{Doorway, Point, Room};

/// A vertical cylinder that stands on the floor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Body {
    /// Its axis, in metres in the door frame.
    pub centre: Point,
    /// Its radius, in metres.
    pub radius_m: f64,
    /// Its height, in metres.
    pub height_m: f64,
}

/// A floor point of the visible side, and the azimuths (0 straight into the room, positive to the right) under which it sees
/// the room through both faces of the wall.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FloorView {
    point: Point,
    first: f64,
    last: f64,
}

impl FloorView {
    /// What a floor point sees. One that sees nothing has no azimuths.
    pub fn new(doorway: &Doorway, point: Point) -> Self {
        let [x, y] = point;
        let half = doorway.half_width();
        let faces = [-doorway.wall_thickness_m - y, -y];
        let first = faces.iter().map(|&d| (-half - x).atan2(d)).fold(f64::NEG_INFINITY, f64::max);
        let last = faces.iter().map(|&d| (half - x).atan2(d)).fold(f64::INFINITY, f64::min);
        Self { point, first, last }
    }

    /// Light from a body of unit radiance, per steradian: the azimuths of its outline that are seen, times ½ H² / (ρ² + H²)
    /// at its axis, or where the lintel cuts if that is lower.
    pub fn body(&self, doorway: &Doorway, body: &Body) -> f64 {
        let (dx, dy) = (body.centre[0] - self.point[0], body.centre[1] - self.point[1]);
        let distance2 = dx * dx + dy * dy;
        let half = (body.radius_m / distance2.sqrt()).min(1.0).asin();
        let middle = dx.atan2(dy);
        let seen = (middle + half).min(self.last) - (middle - half).max(self.first);
        if seen <= 0.0 {
            return 0.0;
        }
        0.5 * seen * share(body.height_m, distance2).min(self.lintel(doorway, dy * dy / distance2))
    }

    /// Light from the walls of a room whose radiance along azimuth a, seen from the middle of the doorway, is
    /// cos k (a + π/2), k = 0 .. modes: the smooth changes that a person's shadows and reflections make.
    pub fn walls(&self, doorway: &Doorway, room: &Room, height_m: f64, modes: &mut [f64]) {
        /// Azimuths of the sum, over what varies by at most `modes` half waves.
        const NODES: usize = 32;
        modes.fill(0.0);
        if self.last <= self.first {
            return;
        }
        let width = (self.last - self.first) / NODES as f64;
        for node in 0..NODES {
            let (sine, cosine) = (self.first + (node as f64 + 0.5) * width).sin_cos();
            let beside = (room.half_width_m.copysign(sine) - self.point[0]) / sine;
            let behind = (room.depth_m - self.point[1]) / cosine;
            // Along the axis nothing is met at the side; what is negative lies behind.
            let distance = if beside > 0.0 { beside.min(behind) } else { behind };
            let wall = [self.point[0] + distance * sine, self.point[1] + distance * cosine];
            let azimuth = wall[0].atan2(wall[1]) + std::f64::consts::FRAC_PI_2;
            let light = 0.5 * width * share(height_m, distance * distance).min(self.lintel(doorway, cosine * cosine));
            modes.iter_mut().enumerate().for_each(|(k, mode)| *mode += light * (k as f64 * azimuth).cos());
        }
    }

    /// H² / (ρ² + H²) of the lintel, at the hidden face, in a direction with that squared cosine of the azimuth.
    fn lintel(&self, doorway: &Doorway, cosine2: f64) -> f64 {
        doorway.height_m.map_or(1.0, |height| share(height, self.point[1] * self.point[1] / cosine2))
    }
}

/// H² / (ρ² + H²), from ρ².
fn share(height: f64, distance2: f64) -> f64 {
    height * height / (distance2 + height * height)
}
