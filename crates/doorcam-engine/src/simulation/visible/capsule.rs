use super::super::lamp::below;
use super::super::room::Vector;

/// All points that are at most `radius` from a straight line between two points: a limb, a trunk, a head, a bag.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::simulation) struct Capsule {
    pub(in crate::simulation) from: Vector,
    pub(in crate::simulation) to: Vector,
    pub(in crate::simulation) radius: f64,
}

pub(super) fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(super) fn sub(a: Vector, b: Vector) -> Vector {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// a + t b
pub(super) fn along(a: Vector, t: f64, b: Vector) -> Vector {
    [a[0] + t * b[0], a[1] + t * b[1], a[2] + t * b[2]]
}

impl Capsule {
    /// Where a ray from outside enters it, in multiples of the ray's length; none if it misses or lies behind.
    pub(super) fn meet(&self, eye: Vector, ray: Vector) -> Option<f64> {
        let (axis, away) = (sub(self.to, self.from), sub(eye, self.from));
        let (axis2, ray2, both) = (dot(axis, axis), dot(ray, ray), dot(axis, ray));
        let (axis_away, ray_away) = (dot(axis, away), dot(ray, away));
        let radius2 = self.radius * self.radius;
        // The endless cylinder about the axis: a t² + 2 b t + c = 0.
        let a = axis2 * ray2 - both * both;
        let b = axis2 * ray_away - axis_away * both;
        let c = axis2 * (dot(away, away) - radius2) - axis_away * axis_away;
        if a > 1e-12 * axis2 * ray2 && axis2 > 0.0 {
            let root = b * b - a * c;
            if root < 0.0 {
                return None;
            }
            let t = (-b - root.sqrt()) / a;
            if (0.0..=axis2).contains(&(axis_away + t * both)) {
                return (t > 0.0).then_some(t);
            }
        }
        let end = |centre: Vector| {
            let away = sub(eye, centre);
            let b = dot(ray, away);
            let root = b * b - ray2 * (dot(away, away) - radius2);
            let t = (-b - root.max(0.0).sqrt()) / ray2;
            (root >= 0.0 && t > 0.0).then_some(t)
        };
        match (end(self.from), end(self.to)) {
            (Some(a), Some(b)) => Some(a.min(b)),
            (a, b) => a.or(b),
        }
    }

    /// The unit vector that points out of it at a place of its surface.
    pub(super) fn normal(&self, at: Vector) -> Vector {
        let (axis, away) = (sub(self.to, self.from), sub(at, self.from));
        let share = (dot(axis, away) / dot(axis, axis).max(1e-12)).clamp(0.0, 1.0);
        along(away, -share, axis).map(|d| d / self.radius)
    }

    /// The share that it hides of a sphere of radius `lamp_radius` about `lamp`, seen from a place: 0 to 1. `half` is
    /// half the side of the surface that the place stands for, by which the border of the shadow is softened.
    pub(super) fn hides(&self, place: Vector, half: f64, lamp: Vector, lamp_radius: f64) -> f64 {
        let [share, distance] = nearest(place, lamp, self.from, self.to);
        // Half the width of the beam to the lamp where it passes.
        let width = (lamp_radius * share).hypot(half * (1.0 - share)).max(1e-6);
        if distance > self.radius + width {
            return 0.0;
        }
        // A stripe as wide as the capsule across the disc of the beam.
        (below((self.radius + distance) / width) - below((distance - self.radius) / width)).clamp(0.0, 1.0)
    }
}

/// Where the lines from `a` to `b` and from `c` to `d` are nearest to each other: the share of the way from `a` to `b`,
/// and the distance.
pub(super) fn nearest(a: Vector, b: Vector, c: Vector, d: Vector) -> [f64; 2] {
    let (u, v, w) = (sub(b, a), sub(d, c), sub(a, c));
    let (uu, vv, uv) = (dot(u, u).max(1e-12), dot(v, v), dot(u, v));
    let (uw, vw) = (dot(u, w), dot(v, w));
    let determinant = uu * vv - uv * uv;
    let mut s = if determinant > 1e-12 * uu * vv.max(1e-12) {
        ((uv * vw - vv * uw) / determinant).clamp(0.0, 1.0)
    } else {
        0.0
    };
    let t = if vv > 1e-12 { ((uv * s + vw) / vv).clamp(0.0, 1.0) } else { 0.0 };
    s = ((uv * t - uw) / uu).clamp(0.0, 1.0);
    let apart = along(along(w, s, u), -t, v);
    [s, dot(apart, apart).sqrt()]
}

#[cfg(test)]
#[path = "capsule_tests.rs"]
mod tests;
