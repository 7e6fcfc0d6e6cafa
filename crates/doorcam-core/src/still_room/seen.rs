use super::surfaces::{LEVELS, NODES, Shining, Surfaces};
use crate::geometry::Doorway;
use crate::scene::Rgb;
use crate::transport::{Body, FloorView, share};

/// What a floor point sees of a still room, prepared so that what bodies hide is quickly found.
#[derive(Debug, Clone)]
pub struct Seen {
    view: FloorView,
    /// Azimuths per radian.
    nodes: f64,
    /// Light of the room's surfaces from all directions to the left of an azimuth and below an elevation:
    /// (NODES + 1) x (LEVELS + 1). Empty if nothing is seen.
    sums: Vec<[f32; 3]>,
    /// Described lights, by azimuth.
    beams: Vec<Beam>,
}

/// A described light in one azimuth. Its distance and height are known, which those of walls and ceiling are not.
#[derive(Debug, Clone, Copy)]
struct Beam {
    node: usize,
    distance2: f64,
    /// Sin² of the elevations between which it is seen.
    elevations: [f64; 2],
    /// Light of the whole azimuth per unit of sin².
    rgb: Rgb,
}

impl Seen {
    pub(super) fn new(doorway: &Doorway, surfaces: &Surfaces, radiance: &[Rgb], view: &FloorView) -> Self {
        let [first, last] = view.azimuths();
        if last <= first {
            return Self { view: *view, nodes: 0.0, sums: Vec::new(), beams: Vec::new() };
        }
        let of_room = surfaces.of_room();
        let mut sums = vec![[0.0_f32; 3]; (NODES + 1) * (LEVELS + 1)];
        surfaces.look(doorway, view, |look| {
            if look.piece < of_room {
                let sum = &mut sums[at(look.node + 1, look.level + 1)];
                (0..3).for_each(|c| sum[c] = (radiance[look.piece][c] * look.light) as f32);
            }
        });
        for node in 1..=NODES {
            for level in 1..=LEVELS {
                let (left, below, both) =
                    (sums[at(node - 1, level)], sums[at(node, level - 1)], sums[at(node - 1, level - 1)]);
                let sum = &mut sums[at(node, level)];
                (0..3).for_each(|c| sum[c] += left[c] + below[c] - both[c]);
            }
        }
        let width = (last - first) / NODES as f64;
        let beams = (0..NODES).flat_map(|node| {
            let open = view.lintel(doorway, (first + (node as f64 + 0.5) * width).cos().powi(2));
            let beam = move |light: Shining| Beam {
                node,
                distance2: light.distance2,
                elevations: light.elevations.map(|elevation| elevation.min(open)),
                rgb: radiance[of_room + light.number].map(|radiance| 0.5 * width * light.share * radiance),
            };
            surfaces.shining(view.point(), [0, 1].map(|k| first + (node + k) as f64 * width)).map(beam)
        });
        Self { view: *view, nodes: width.recip(), sums, beams: beams.collect() }
    }

    /// All light from the still room.
    pub fn light(&self) -> Rgb {
        let room = self.sums.last().map_or([0.0; 3], |all| all.map(f64::from));
        let of = |beam: &Beam, c: usize| (beam.elevations[1] - beam.elevations[0]) * beam.rgb[c];
        [0, 1, 2].map(|c| room[c] + self.beams.iter().map(|beam| of(beam, c)).sum::<f64>())
    }

    /// Light that a body takes away: all that is behind its outline, up to the elevation of its top. The room's surfaces
    /// are behind everybody; a described light may be in front.
    pub fn hidden(&self, body: &Body) -> Rgb {
        let [from, to] = self.view.outline(body);
        if to <= from || self.sums.is_empty() {
            return [0.0; 3];
        }
        let [first, _] = self.view.azimuths();
        let distance2 = self.view.distance2(body);
        let highest = share(body.height_m, distance2);
        let top = highest * LEVELS as f64;
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
        let mut hidden = [0, 1, 2].map(|c| f64::from(right[c] - left[c]));
        let [from, to] = [from, to].map(|azimuth| (azimuth - first) * self.nodes);
        let begin = self.beams.partition_point(|beam| beam.node as f64 + 1.0 < from);
        let behind = |beam: &&Beam| beam.distance2 > distance2;
        for beam in self.beams[begin..].iter().take_while(|beam| (beam.node as f64) < to).filter(behind) {
            let across = (to.min(beam.node as f64 + 1.0) - from.max(beam.node as f64)).max(0.0);
            let up = (highest.min(beam.elevations[1]) - beam.elevations[0]).max(0.0);
            (0..3).for_each(|c| hidden[c] += across * up * beam.rgb[c]);
        }
        hidden
    }
}

fn at(node: usize, level: usize) -> usize {
    node * (LEVELS + 1) + level
}
