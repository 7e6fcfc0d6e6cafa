use std::f64::consts::PI;

use super::figure::Part;
use super::room::Vector;
use super::scenario::{LampKind, LampSpec};
use doorcam_core::scene::Rgb;

/// A lamp of the hidden room: a small sphere that shines evenly, or a disc that shines downwards by Lambert's law. For
/// shadows, both are spheres.
#[derive(Debug, Clone)]
pub(super) struct Lamp {
    pub(super) at: Vector,
    pub(super) radius: f64,
    /// Radiant intensity; for a disc, straight down.
    pub(super) intensity: Rgb,
    kind: LampKind,
}

impl Lamp {
    pub(super) fn new(spec: &LampSpec) -> Self {
        Self { at: spec.at_m, radius: spec.radius_m, intensity: spec.rgb, kind: spec.kind }
    }

    /// Unobstructed irradiance of a surface at `place` with that normal, for an intensity of 1.
    pub(super) fn irradiance(&self, place: Vector, normal: Vector) -> f64 {
        let d = [0, 1, 2].map(|k| self.at[k] - place[k]);
        // Keeps the light finite for a person inside a lamp.
        let d2 = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).max(self.radius * self.radius).max(1e-4);
        let facing = (d[0] * normal[0] + d[1] * normal[1] + d[2] * normal[2]).max(0.0) / d2.sqrt();
        let emitted = match self.kind {
            LampKind::Bulb => 1.0,
            LampKind::Panel => d[2].max(0.0) / d2.sqrt(),
        };
        emitted * facing / d2
    }

    /// Flux for an intensity of 1.
    pub(super) fn flux(&self) -> f64 {
        match self.kind {
            LampKind::Bulb => 4.0 * PI,
            LampKind::Panel => PI,
        }
    }

    /// The part of the lamp that people hide from a place, 0 to 1. `half` is half the side of the surface element that
    /// the place stands for, by which the shadow's border is softened.
    pub(super) fn hidden_by<'a>(&self, place: Vector, half: f64, parts: impl Iterator<Item = &'a Part>) -> f64 {
        // Each part takes its share of what the others leave: exact unless two borders cross the lamp at once.
        1.0 - parts.map(|part| 1.0 - hidden_by_part(self.at, self.radius, place, half, part)).product::<f64>()
    }
}

/// The part of a ball of that `radius` about `at` that an upright cylinder hides from a place.
pub(super) fn hidden_by_part(at: Vector, radius: f64, place: Vector, half: f64, part: &Part) -> f64 {
    let to_lamp = [at[0] - place[0], at[1] - place[1]];
    let range = to_lamp[0].hypot(to_lamp[1]).max(1e-6);
    let towards = to_lamp.map(|d| d / range);
    let centre = [part.centre[0] - place[0], part.centre[1] - place[1]];
    let along = centre[0] * towards[0] + centre[1] * towards[1];
    if along < -part.radius || along > range + part.radius {
        return 0.0;
    }
    let beside = towards[0] * centre[1] - towards[1] * centre[0];
    let share = (along / range).clamp(0.0, 1.0);
    // Half the width of the beam to the lamp where it passes the person.
    let width = (radius * share).hypot(half * (1.0 - share)).max(1e-6);
    let across = below((beside + part.radius) / width) - below((beside - part.radius) / width);
    if across <= 0.0 {
        return 0.0;
    }
    // Where the middle of the blocked beam enters and leaves the cylinder.
    let middle = ((beside - part.radius).max(-width) + (beside + part.radius).min(width)) / 2.0 - beside;
    let chord = (part.radius * part.radius - middle * middle).max(0.0).sqrt();
    let height = |along: f64| place[2] + (at[2] - place[2]) * (along / range).clamp(0.0, 1.0);
    let (near, far) = (height(along - chord), height(along + chord));
    let beneath = if part.bottom > 0.0 { below((part.bottom - near.max(far)) / width) } else { 0.0 };
    across * (below((part.top - near.min(far)) / width) - beneath).max(0.0)
}

/// The part of a disc of radius 1 whose coordinate is below u.
pub(super) fn below(u: f64) -> f64 {
    let u = u.clamp(-1.0, 1.0);
    0.5 + (u * (1.0 - u * u).sqrt() + u.asin()) / PI
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lamp(radius: f64, kind: LampKind) -> Lamp {
        Lamp { at: [0.3, 1.2, 2.2], radius, intensity: [1.0; 3], kind }
    }

    /// All of a lamp's light arrives at the walls of a box around it.
    #[test]
    fn the_flux_is_the_irradiance_summed_over_a_box() {
        for kind in [LampKind::Bulb, LampKind::Panel] {
            let lamp = lamp(0.05, kind);
            let n = 300;
            let mut sum = 0.0;
            for axis in 0..3 {
                for sign in [-1.0, 1.0] {
                    for k in 0..n * n {
                        let [a, b] = [k / n, k % n].map(|i| 2.0 * (i as f64 + 0.5) / n as f64 - 1.0);
                        let mut place = lamp.at;
                        place[axis] += sign;
                        place[(axis + 1) % 3] += a;
                        place[(axis + 2) % 3] += b;
                        let mut normal = [0.0; 3];
                        normal[axis] = -sign;
                        sum += lamp.irradiance(place, normal) * 4.0 / (n * n) as f64;
                    }
                }
            }
            assert!((sum / lamp.flux() - 1.0).abs() < 1e-3, "{kind:?}: {sum}");
        }
    }

    /// Compared with rays to points spread over the sphere, each marched to test for the cylinder.
    #[test]
    fn a_shadow_equals_the_share_of_rays_that_the_cylinder_stops() {
        let part = Part { centre: [0.0, 1.8], radius: 0.2, bottom: 0.0, top: 1.6 };
        let lamp = lamp(0.12, LampKind::Bulb);
        let (mut partial, mut whole) = (0, 0);
        for place in (0..30).map(|k| [-0.9 + 0.05 * f64::from(k), 3.0, 0.7]) {
            let (mut stopped, mut all) = (0.0, 0.0);
            for k in 0..900 {
                let [a, b] = [k / 30, k % 30].map(|i| (f64::from(i) + 0.5) / 15.0 - 1.0);
                if a * a + b * b > 1.0 {
                    continue;
                }
                all += 1.0;
                // A point of a disc about the lamp: horizontally across the direction to it, and vertically.
                let d = [0, 1, 2].map(|k| lamp.at[k] - place[k]);
                let flat = f64::hypot(d[0], d[1]);
                let end = [
                    lamp.at[0] + lamp.radius * a * d[1] / flat,
                    lamp.at[1] - lamp.radius * a * d[0] / flat,
                    lamp.at[2] + lamp.radius * b,
                ];
                let hit = (0..1000).any(|i| {
                    let t = f64::from(i) / 1000.0;
                    let at = [0, 1, 2].map(|k| place[k] + t * (end[k] - place[k]));
                    (at[0] - part.centre[0]).hypot(at[1] - part.centre[1]) < part.radius && at[2] < part.top
                });
                stopped += f64::from(u8::from(hit));
            }
            let (literal, ours) = (stopped / all, lamp.hidden_by(place, 0.0, [&part].into_iter()));
            assert!((literal - ours).abs() < 0.1, "{place:?}: {literal} {ours}");
            partial += i32::from((0.1..0.9).contains(&literal));
            whole += i32::from(literal > 0.95);
        }
        assert!(partial >= 3 && whole >= 3, "{partial} {whole}");
    }
}
