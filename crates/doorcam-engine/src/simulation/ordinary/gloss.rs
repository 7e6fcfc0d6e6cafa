use super::super::room::Vector;
use super::super::scenario::{CameraSpec, FloorSpec};
use doorcam_core::geometry::Point;
use std::f64::consts::PI;

/// A glossy floor, seen from the camera: a GGX lobe beside Lambert's law.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Gloss {
    camera: Vector,
    /// Reflectance straight from above.
    f0: f64,
    /// α²
    roughness2: f64,
    albedo: f64,
}

impl Gloss {
    /// None for a floor that only scatters.
    pub(super) fn new(floor: &FloorSpec, camera: &CameraSpec) -> Option<Self> {
        (floor.gloss > 0.0).then(|| Self {
            camera: camera.at_m,
            f0: floor.gloss,
            roughness2: floor.roughness * floor.roughness,
            albedo: (floor.albedo.iter().sum::<f64>() / 3.0).max(0.01),
        })
    }

    /// Direction from a floor point to the camera.
    pub(super) fn towards(&self, [x, y]: Point) -> Vector {
        let d = [self.camera[0] - x, self.camera[1] - y, self.camera[2]];
        let length = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt();
        d.map(|c| c / length)
    }

    /// How much more light from a direction the camera sees than of a floor that only scatters: 1 + π f / ρ.
    pub(super) fn weight(&self, camera: Vector, ray: Point, s: f64) -> f64 {
        let level = (1.0 - s).max(0.0).sqrt();
        let light = [ray[0] * level, ray[1] * level, s.sqrt().max(1e-4)];
        let sum = [0, 1, 2].map(|k| light[k] + camera[k]);
        let length = (sum[0] * sum[0] + sum[1] * sum[1] + sum[2] * sum[2]).sqrt();
        let half = sum.map(|c| c / length);
        let a2 = self.roughness2;
        let bulk = half[2] * half[2] * (a2 - 1.0) + 1.0;
        let spread = a2 / (PI * bulk * bulk);
        let towards = (0..3).map(|k| light[k] * half[k]).sum::<f64>().clamp(0.0, 1.0);
        let fresnel = self.f0 + (1.0 - self.f0) * (1.0 - towards).powi(5);
        let masked = |z: f64| (-1.0 + (1.0 + a2 * (1.0 - z * z) / (z * z)).sqrt()) / 2.0;
        let shadowing = 1.0 / (1.0 + masked(light[2]) + masked(camera[2]));
        1.0 + spread * fresnel * shadowing / (4.0 * light[2] * camera[2]) * PI / self.albedo
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// All of the lobe together reflects about as much as its Fresnel term says, and not more than comes in.
    #[test]
    fn the_lobe_reflects_what_its_fresnel_term_says() {
        let floor = FloorSpec { gloss: 0.05, roughness: 0.22, ..FloorSpec::default() };
        let gloss = Gloss { camera: [0.0, -0.5, 1.5], f0: floor.gloss, roughness2: 0.22 * 0.22, albedo: 0.6 };
        let camera = gloss.towards([0.0, -0.3]);
        let n = 400;
        let mut sum = 0.0;
        for k in 0..n * n {
            let phi = ((k % n) as f64 + 0.5) / n as f64 * std::f64::consts::TAU;
            let s = ((k / n) as f64 + 0.5) / n as f64;
            let ray = [phi.sin(), phi.cos()];
            // ∫ f cos dω, of which Lambert's part would be ρ: ½ ds dφ.
            sum += (gloss.weight(camera, ray, s) - 1.0) * 0.6 / PI * std::f64::consts::PI / (n * n) as f64;
        }
        assert!((sum / 0.05 - 1.0).abs() < 0.1, "{sum}");
    }
}
