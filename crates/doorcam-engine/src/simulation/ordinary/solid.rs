use super::super::room::Vector;
use super::super::scenario::Scenario;
use super::spec::{FurnitureSpec, LeafSpec};
use doorcam_core::geometry::{Doorway, Point, Side};
use doorcam_core::scene::Rgb;

/// Thickness of a door's leaf, and how far its hinge is beside the opening and behind the hidden face, in metres.
const LEAF_M: f64 = 0.04;
const HINGE_M: f64 = 0.01;

/// An upright block with four corners: a piece of furniture, or the door's leaf.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Solid {
    /// Counterclockwise, seen from above.
    pub(super) corners: [Point; 4],
    pub(super) bottom: f64,
    pub(super) top: f64,
    pub(super) albedo: Rgb,
}

/// Where a horizontal ray meets a solid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct SolidHit {
    pub(super) near: f64,
    pub(super) far: f64,
    /// The side that it enters, from corner `side` to the next.
    pub(super) side: usize,
    /// How far from that corner, in metres.
    pub(super) u: f64,
}

impl Solid {
    /// Everything that stands in the room.
    pub(super) fn all(scenario: &Scenario) -> Vec<Self> {
        let furniture = scenario.furniture.iter().map(Self::furniture);
        furniture.chain(scenario.leaf.iter().map(|leaf| Self::leaf(leaf, &scenario.doorway))).collect()
    }

    fn furniture(spec: &FurnitureSpec) -> Self {
        let ([west, east], [near, far]) = (spec.x_m, spec.y_m);
        let corners = [[west, near], [east, near], [east, far], [west, far]];
        Self { corners, bottom: spec.up_m[0], top: spec.up_m[1], albedo: spec.albedo }
    }

    pub(super) fn leaf(spec: &LeafSpec, doorway: &Doorway) -> Self {
        let side = if spec.hinge == Side::Left { -1.0 } else { 1.0 };
        let (sine, cosine) = spec.angle_deg.to_radians().sin_cos();
        let along = [-side * cosine, sine];
        let across = [-along[1] * LEAF_M / 2.0, along[0] * LEAF_M / 2.0];
        let hinge = [side * (doorway.half_width() + HINGE_M), HINGE_M];
        let corner = |far: f64, way: f64| [0, 1].map(|k| hinge[k] + far * along[k] + way * across[k]);
        let w = spec.width_m;
        let corners = [corner(0.0, -1.0), corner(w, -1.0), corner(w, 1.0), corner(0.0, 1.0)];
        Self { corners, bottom: 0.0, top: spec.height_m, albedo: spec.albedo }
    }

    /// A side's first corner, direction and length.
    pub(super) fn side(&self, k: usize) -> (Point, Point, f64) {
        let (a, b) = (self.corners[k], self.corners[(k + 1) % 4]);
        let length = (b[0] - a[0]).hypot(b[1] - a[1]);
        (a, [(b[0] - a[0]) / length, (b[1] - a[1]) / length], length)
    }

    /// The part [first, last] of the way from `from` along `way` that is above or below its floor plan, and the side
    /// that is entered there; none from inside, and if nothing is ahead.
    fn clip(&self, from: Point, way: Point) -> Option<(f64, f64, usize)> {
        let (mut first, mut last, mut entered) = (f64::NEG_INFINITY, f64::INFINITY, 0);
        for k in 0..4 {
            let (a, along, _) = self.side(k);
            // Outwards is to the right of the way around.
            let out = [along[1], -along[0]];
            let away = (from[0] - a[0]) * out[0] + (from[1] - a[1]) * out[1];
            let speed = way[0] * out[0] + way[1] * out[1];
            if speed.abs() < 1e-12 {
                if away > 0.0 {
                    return None;
                }
            } else if speed < 0.0 {
                if -away / speed > first {
                    (first, entered) = (-away / speed, k);
                }
            } else {
                last = last.min(-away / speed);
            }
        }
        (first < last && last > 0.0).then_some((first, last, entered))
    }

    /// Where a horizontal ray of length 1 enters and leaves; none from inside.
    pub(super) fn meet(&self, from: Point, ray: Point) -> Option<SolidHit> {
        let (near, far, side) = self.clip(from, ray).filter(|(near, ..)| *near > 0.0)?;
        let (a, along, length) = self.side(side);
        let u = (from[0] + near * ray[0] - a[0]) * along[0] + (from[1] + near * ray[1] - a[1]) * along[1];
        Some(SolidHit { near, far, side, u: u.clamp(0.0, length) })
    }

    /// Whether it stands between two places.
    pub(super) fn blocks(&self, a: Vector, b: Vector) -> bool {
        let way = [b[0] - a[0], b[1] - a[1]];
        let Some((mut first, mut last, _)) = self.clip([a[0], a[1]], way) else { return false };
        let rise = b[2] - a[2];
        let heights = [self.bottom, self.top].map(|z| (z - a[2]) / rise);
        if rise.abs() > 1e-9 {
            first = first.max(heights[0].min(heights[1]));
            last = last.min(heights[0].max(heights[1]));
        } else if a[2] <= self.bottom || a[2] >= self.top {
            return false;
        }
        first.max(1e-6) < last.min(1.0 - 1e-6)
    }
}

/// Whether anything stands between two places.
pub(super) fn blocked(solids: &[Solid], a: Vector, b: Vector) -> bool {
    solids.iter().any(|solid| solid.blocks(a, b))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn inside(solid: &Solid, [x, y]: Point) -> bool {
        (0..4).all(|k| {
            let (a, along, _) = solid.side(k);
            (x - a[0]) * along[1] - (y - a[1]) * along[0] <= 0.0
        })
    }

    /// Compared with marching along the way.
    #[test]
    fn a_solid_is_met_and_blocks_where_marching_finds_it() {
        let leaf = LeafSpec { hinge: Side::Left, angle_deg: 98.0, width_m: 0.8, height_m: 1.9, albedo: [0.5; 3] };
        let door = Doorway { width_m: 0.9, wall_thickness_m: 0.1, height_m: None, leaf: None };
        let table = FurnitureSpec { x_m: [0.2, 1.0], y_m: [1.0, 2.0], up_m: [0.6, 0.8], albedo: [0.5; 3] };
        let (mut met, mut blocked) = (0, 0);
        for solid in [Solid::leaf(&leaf, &door), Solid::furniture(&table)] {
            for k in 0..200 {
                let phi = -1.2 + 0.012 * f64::from(k);
                let (from, ray) = ([0.4, -0.2], [phi.sin(), phi.cos()]);
                let marched = (0..40_000)
                    .map(|i| f64::from(i) * 1e-4)
                    .find(|d| inside(&solid, [from[0] + d * ray[0], from[1] + d * ray[1]]));
                let found = solid.meet(from, ray);
                match (found, marched) {
                    (Some(hit), Some(d)) => assert!((hit.near - d).abs() < 2e-3, "{phi}: {hit:?} {d}"),
                    (None, None) => {}
                    // A corner that is only touched.
                    (Some(hit), None) => assert!(hit.far - hit.near < 2e-3),
                    (None, Some(d)) => panic!("{phi}: {d}"),
                }
                met += i32::from(found.is_some());
                let (a, b) = ([0.4, -0.2, 0.3], [0.4 + 3.0 * ray[0], -0.2 + 3.0 * ray[1], 1.2]);
                let stands = (1..3000).any(|i| {
                    let t = f64::from(i) / 3000.0;
                    let z = 0.3 + 0.9 * t;
                    z > solid.bottom && z < solid.top && inside(&solid, [0, 1].map(|k| a[k] + t * (b[k] - a[k])))
                });
                // One step of the march may make the difference at a corner.
                let ours = solid.blocks(a, b);
                blocked += i32::from(ours == stands);
            }
        }
        assert!(met > 40 && blocked >= 396, "{met} {blocked}");
    }

    #[test]
    fn a_leaf_at_0_degrees_shuts_the_opening_and_at_90_stands_straight_into_the_room() {
        let door = Doorway { width_m: 0.9, wall_thickness_m: 0.1, height_m: None, leaf: None };
        let far = |hinge: Side, angle_deg: f64| {
            let spec = LeafSpec { hinge, angle_deg, width_m: 0.88, height_m: 2.0, albedo: [0.5; 3] };
            let corners = Solid::leaf(&spec, &door).corners;
            [0, 1].map(|k| (corners[1][k] + corners[2][k]) / 2.0)
        };
        let near = |a: Point, b: Point| (a[0] - b[0]).hypot(a[1] - b[1]) < 1e-9;
        assert!(near(far(Side::Left, 0.0), [0.42, 0.01]) && near(far(Side::Right, 0.0), [-0.42, 0.01]));
        assert!(near(far(Side::Left, 90.0), [-0.46, 0.89]) && near(far(Side::Right, 90.0), [0.46, 0.89]));
        assert!(far(Side::Left, 98.0)[0] < -0.46 && far(Side::Right, 98.0)[0] > 0.46);
    }
}
