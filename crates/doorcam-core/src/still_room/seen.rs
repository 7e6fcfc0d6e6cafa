use super::surfaces::{LEVELS, NODES, Surfaces};
use crate::geometry::Doorway;
use crate::scene::Rgb;
use crate::transport::{Body, FloorView, share};

/// What a floor point sees of a still room, prepared so that what bodies hide is quickly found.
#[derive(Debug, Clone)]
pub struct Seen {
    view: FloorView,
    /// Azimuths per radian.
    nodes: f64,
    /// Light of all directions to the left of an azimuth and below an elevation: (NODES + 1) x (LEVELS + 1). Empty if
    /// nothing is seen.
    sums: Vec<[f32; 3]>,
}

impl Seen {
    pub(super) fn new(doorway: &Doorway, surfaces: &Surfaces, radiance: &[Rgb], view: &FloorView) -> Self {
        let [first, last] = view.azimuths();
        if last <= first {
            return Self { view: *view, nodes: 0.0, sums: Vec::new() };
        }
        let mut sums = vec![[0.0_f32; 3]; (NODES + 1) * (LEVELS + 1)];
        surfaces.look(doorway, view, |look| {
            let radiance = radiance[look.piece];
            sums[at(look.node + 1, look.level + 1)] = radiance.map(|radiance| (radiance * look.light) as f32);
        });
        for node in 1..=NODES {
            for level in 1..=LEVELS {
                let (left, below, both) =
                    (sums[at(node - 1, level)], sums[at(node, level - 1)], sums[at(node - 1, level - 1)]);
                let sum = &mut sums[at(node, level)];
                (0..3).for_each(|c| sum[c] += left[c] + below[c] - both[c]);
            }
        }
        Self { view: *view, nodes: NODES as f64 / (last - first), sums }
    }

    /// All light from the still room.
    pub fn light(&self) -> Rgb {
        self.sums.last().map_or([0.0; 3], |all| all.map(f64::from))
    }

    /// Light that a body takes away: all that is behind its outline, up to the elevation of its top.
    pub fn hidden(&self, body: &Body) -> Rgb {
        let [from, to] = self.view.outline(body);
        if to <= from || self.sums.is_empty() {
            return [0.0; 3];
        }
        let [first, _] = self.view.azimuths();
        let top = share(body.height_m, self.view.distance2(body)) * LEVELS as f64;
        let level = (top as usize).min(LEVELS - 1);
        let within = (top - level as f64) as f32;
        let sum = |azimuth: f64| {
            let place = ((azimuth - first) * self.nodes).clamp(0.0, NODES as f64);
            let node = (place as usize).min(NODES - 1);
            let part = (place - node as f64) as f32;
            let [a, b, c, d] = [at(node, level), at(node, level + 1), at(node + 1, level), at(node + 1, level + 1)]
                .map(|k| self.sums[k]);
            [0, 1, 2].map(|k| (1.0 - part) * (a[k] + within * (b[k] - a[k])) + part * (c[k] + within * (d[k] - c[k])))
        };
        let (right, left) = (sum(to), sum(from));
        [0, 1, 2].map(|c| f64::from(right[c] - left[c]))
    }
}

fn at(node: usize, level: usize) -> usize {
    node * (LEVELS + 1) + level
}
