use super::super::lamp::below;
use super::super::room::Vector;
use super::VisibleLampSpec;
use doorcam_core::geometry::{Doorway, Point};

/// Least half width of a beam of light where an edge cuts it, in metres.
const LEAST_BEAM_M: f64 = 1e-3;

/// A lamp of the visible side.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::simulation) struct VisibleLamp {
    pub(super) at: Vector,
    pub(super) radius: f64,
    /// Its irradiance of a surface that faces it at 1 m, in multiples of the visible side's whole light.
    pub(super) intensity: f64,
}

impl VisibleLamp {
    /// A lamp whose mean light at `reference` places on the floor is its share of the visible side's light.
    pub(in crate::simulation) fn new(spec: &VisibleLampSpec, reference: &[Point]) -> Self {
        let lamp = Self { at: spec.at_m, radius: spec.radius_m, intensity: 1.0 };
        let mean = reference.iter().map(|&p| lamp.on_floor(p)).sum::<f64>() / reference.len() as f64;
        Self { intensity: spec.share / mean.max(1e-9), ..lamp }
    }

    /// Its light at a floor point that sees it whole.
    pub(super) fn on_floor(&self, [x, y]: Point) -> f64 {
        let d = [self.at[0] - x, self.at[1] - y, self.at[2]];
        let d2 = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
        self.intensity * d[2] / (d2 * d2.sqrt())
    }
}

/// The share of a lamp that a place behind the wall's visible face sees through the doorway; all of it before the face.
pub(super) fn lit_through(doorway: &Doorway, lamp: Vector, radius: f64, place: Vector) -> f64 {
    let faces = [-doorway.wall_thickness_m, 0.0];
    faces
        .into_iter()
        .filter(|&face| place[1] > face && lamp[1] < face)
        .map(|face| {
            let share = (face - place[1]) / (lamp[1] - place[1]);
            let at = |k: usize| place[k] + share * (lamp[k] - place[k]);
            let beam = (radius * share).max(LEAST_BEAM_M);
            let between = below((doorway.half_width() - at(0)) / beam) - below((-doorway.half_width() - at(0)) / beam);
            between.max(0.0) * doorway.height_m.map_or(1.0, |height| below((height - at(2)) / beam))
        })
        .fold(1.0, f64::min)
}
