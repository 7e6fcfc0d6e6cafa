//! The directions in which the facets with light can move, with eq. 13's gradient and Hessian along them.
//!
//! Around X_n = c vᵀ = ρ u vᵀ, the coordinates are c itself and w: v turns to v + Q w/ρ, normalised, where Q's columns
//! are orthogonal to v. X_n moves along p qᵀ, with (p, q) = (e_s, v) for c_s and (u, q_k) for w_k. A c_s or a colour
//! that is at its bound of 0 takes part only if descent leads away from the bound.
//!
//! With z = Aᵀr, the Hessian is Σ_s G_s,nm (p_s p'_s) (q·q') for any two tangents. Tangents of the same facet add
//! λ/ρ (I − u uᵀ) for c, −z_s·q_k/ρ between c_s and w_k, and (uᵀ z v)/ρ I for w.

use pulp::{Arch, Simd, WithSimd};

use super::active::{Active, Point, lit, pair};
use super::facet::{Admissible, Pair};
use crate::scene::Intensity;

/// The tangents at a point, grouped by facet.
#[derive(Debug, Clone, Default)]
pub(super) struct Tangents {
    all: Vec<Tangent>,
    /// The gradient along each.
    pub gradient: Vec<f64>,
    /// p qᵀ of each: per side and colour, one value per tangent.
    moves: [[Vec<f64>; 3]; 2],
    /// A facet's row of each Gram matrix, one value per tangent.
    rows: [Vec<f64>; 2],
}

/// One coordinate of one facet.
#[derive(Debug, Clone, Copy)]
struct Tangent {
    facet: usize,
    role: Role,
    /// q.
    colour: [f64; 3],
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Role {
    /// c_s.
    Light(usize),
    /// w_k.
    Colour(usize),
}

/// Which second derivatives count, besides those of the data term.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Curvature {
    /// All.
    Exact,
    /// Those that cannot make the Hessian indefinite.
    Positive,
}

impl Tangents {
    /// A workspace for `n` facets.
    pub fn with_capacity(n: usize) -> Self {
        let buffer = || Vec::with_capacity(4 * n);
        Self {
            all: Vec::with_capacity(4 * n),
            gradient: buffer(),
            moves: [0, 1].map(|_| [0, 1, 2].map(|_| buffer())),
            rows: [buffer(), buffer()],
        }
    }

    /// Number of tangents.
    pub fn len(&self) -> usize {
        self.all.len()
    }

    /// Finds the tangents at a point and the gradient along them.
    pub fn span(&mut self, active: &Active, point: &Point) {
        self.all.clear();
        self.gradient.clear();
        self.moves.iter_mut().flatten().for_each(Vec::clear);
        for (facet, light) in point.light.iter().enumerate().filter(|(_, light)| lit(light)) {
            let kind = active.kinds[facet];
            let z = pair(&point.correlations, facet);
            let (_, u) = polar(light);
            let v = light.colour;
            for s in 0..2 {
                if u[s] != 0.0 || !kind.light_is_nonnegative() || dot(&z[s], &v) > 0.0 {
                    let mut e = [0.0; 2];
                    e[s] = 1.0;
                    let slope = active.lambdas[facet] * u[s] - dot(&z[s], &v);
                    self.push(Tangent { facet, role: Role::Light(s), colour: v }, e, slope);
                }
            }
            let pull: [f64; 3] = std::array::from_fn(|p| u[0] * z[0][p] + u[1] * z[1][p]);
            for (k, q) in turns(kind, &v, &pull).into_iter().flatten().enumerate() {
                self.push(Tangent { facet, role: Role::Colour(k), colour: q }, u, -dot(&pull, &q));
            }
        }
    }

    fn push(&mut self, tangent: Tangent, light: [f64; 2], slope: f64) {
        self.gradient.push(slope);
        for (planes, light) in self.moves.iter_mut().zip(light) {
            for (plane, colour) in planes.iter_mut().zip(tangent.colour) {
                plane.push(light * colour);
            }
        }
        self.all.push(tangent);
    }

    /// Writes the Hessian's lower triangle into `out`, column by column, with the diagonal multiplied by 1 + `damping`.
    pub fn hessian(&mut self, active: &Active, point: &Point, curvature: Curvature, damping: f64, out: &mut Vec<f64>) {
        out.resize(self.len() * self.len(), 0.0);
        let n = self.len();
        for b in 0..n {
            let tangent = &self.all[b];
            if b == 0 || self.all[b - 1].facet != tangent.facet {
                for (s, row) in self.rows.iter_mut().enumerate() {
                    let gram = active.row(s, tangent.facet);
                    row.clear();
                    row.resize(b, 0.0);
                    row.extend(self.all[b..].iter().map(|other| gram[other.facet]));
                }
            }
            let column = &mut out[b * n..][b..n];
            let moves = [0, 1].map(|s| [0, 1, 2].map(|p| &self.moves[s][p][b..n]));
            let rows = [0, 1].map(|s| &self.rows[s][b..n]);
            Arch::new().dispatch(Products { moves, rows, column });
            let z = pair(&point.correlations, tangent.facet);
            let (light, lambda) = (&point.light[tangent.facet], active.lambdas[tangent.facet]);
            let same_facet = self.all[b..].iter().take_while(|other| other.facet == tangent.facet);
            for (value, other) in column.iter_mut().zip(same_facet) {
                *value += curvature.between(other, tangent, light, &z, lambda);
            }
            column[0] *= 1.0 + damping;
        }
    }

    /// Puts the light at the share `t` of a step into `out`, made admissible.
    pub fn travel(&self, active: &Active, point: &Point, step: &[f64], t: f64, out: &mut Vec<Intensity>) {
        out.clone_from(&point.light);
        for (facet, change) in self.changes(point, step) {
            let old = &point.light[facet];
            let c = [0, 1].map(|s| [old.left, old.right][s] + t * change.light[s]);
            let v = [0, 1, 2].map(|p| old.colour[p] + t * change.colour[p]);
            out[facet] = admit(active.kinds[facet], old, c, v);
        }
    }

    /// Lists in order where along a step, between 0 and 1, a light or a colour reaches its bound or a facet becomes
    /// dark.
    pub fn bounds(&self, active: &Active, point: &Point, step: &[f64], out: &mut Vec<f64>) {
        out.clear();
        let mut at = |value: f64, change: f64| {
            let t = -value / change;
            if t > 0.0 && t < 1.0 {
                out.push(t);
            }
        };
        for (facet, change) in self.changes(point, step) {
            let (light, kind) = (&point.light[facet], active.kinds[facet]);
            let c = [light.left, light.right];
            if kind.light_is_nonnegative() {
                (0..2).for_each(|s| at(c[s], change.light[s]));
            } else {
                at(c[0] * c[0] + c[1] * c[1], c[0] * change.light[0] + c[1] * change.light[1]);
            }
            if kind.colour_is_nonnegative() {
                (0..3).for_each(|p| at(light.colour[p], change.colour[p]));
            }
        }
        out.sort_unstable_by(f64::total_cmp);
    }

    /// What a step does to each facet.
    fn changes<'a>(&'a self, point: &'a Point, step: &'a [f64]) -> impl Iterator<Item = (usize, Change)> + 'a {
        let mut steps = step.iter();
        self.all.chunk_by(|a, b| a.facet == b.facet).map(move |tangents| {
            let facet = tangents[0].facet;
            let (rho, _) = polar(&point.light[facet]);
            let mut change = Change { light: [0.0; 2], colour: [0.0; 3] };
            for (tangent, by) in tangents.iter().zip(&mut steps) {
                match tangent.role {
                    Role::Light(s) => change.light[s] += by,
                    Role::Colour(_) => (0..3).for_each(|p| change.colour[p] += by / rho * tangent.colour[p]),
                }
            }
            (facet, change)
        })
    }
}

/// Σ_s G_s,nm (p_s p'_s) (q·q') between the first of the given tangents and each of them, with the widest available
/// vector registers.
pub(super) struct Products<'a> {
    pub moves: [[&'a [f64]; 3]; 2],
    pub rows: [&'a [f64]; 2],
    pub column: &'a mut [f64],
}

impl WithSimd for Products<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { moves: [left, right], rows: [gram_left, gram_right], column } = self;
        let [l, r] = [left, right].map(|planes| planes.map(|plane| plane[0]));
        let left = left[0].iter().zip(left[1]).zip(left[2]).zip(gram_left);
        let right = right[0].iter().zip(right[1]).zip(right[2]).zip(gram_right);
        for ((value, (((lr, lg), lb), gl)), (((rr, rg), rb), gr)) in column.iter_mut().zip(left).zip(right) {
            *value = gl * (l[0] * lr + l[1] * lg + l[2] * lb) + gr * (r[0] * rr + r[1] * rg + r[2] * rb);
        }
    }
}

/// Changes of c and v before they are made admissible.
struct Change {
    light: [f64; 2],
    colour: [f64; 3],
}

/// The nearest admissible values; dark if c passes through zero.
fn admit(kind: Admissible, old: &Intensity, c: [f64; 2], v: [f64; 3]) -> Intensity {
    let c = if kind.light_is_nonnegative() { c.map(|x| x.max(0.0)) } else { c };
    let v = if kind.colour_is_nonnegative() { v.map(|x| x.max(0.0)) } else { v };
    let norm = dot(&v, &v).sqrt();
    if c[0] * old.left + c[1] * old.right <= 0.0 || norm == 0.0 {
        return Intensity::default();
    }
    Intensity { left: c[0], right: c[1], colour: v.map(|x| x / norm) }
}

impl Curvature {
    /// The second derivative, due to penalty and parametrisation, between two tangents of one facet.
    fn between(self, a: &Tangent, b: &Tangent, i: &Intensity, z: &Pair, lambda: f64) -> f64 {
        let (rho, u) = polar(i);
        let same = if a.role == b.role { 1.0 } else { 0.0 };
        match (a.role, b.role) {
            (Role::Light(s), Role::Light(t)) => lambda / rho * (same - u[s] * u[t]),
            (Role::Colour(_), Role::Colour(_)) => {
                let along = u[0] * dot(&z[0], &i.colour) + u[1] * dot(&z[1], &i.colour);
                same * if self == Curvature::Exact { along } else { along.max(lambda) } / rho
            }
            _ if self == Curvature::Positive => 0.0,
            (Role::Light(s), Role::Colour(_)) => -dot(&z[s], &b.colour) / rho,
            (Role::Colour(_), Role::Light(s)) => -dot(&z[s], &a.colour) / rho,
        }
    }
}

/// ρ and u.
fn polar(i: &Intensity) -> (f64, [f64; 2]) {
    let rho = i.strength();
    (rho, [i.left / rho, i.right / rho])
}

/// Unit vectors that v can turn towards: orthogonal to v and to each other, without the colours held at their bound.
/// `pull` is minus the gradient along each colour.
fn turns(kind: Admissible, v: &[f64; 3], pull: &[f64; 3]) -> [Option<[f64; 3]>; 2] {
    let free = |p: usize| v[p] != 0.0 || !kind.colour_is_nonnegative() || pull[p] > 0.0;
    match [0, 1, 2].map(free) {
        [true, true, true] => {
            // Cross v with the axis along which it is smallest.
            let least = (0..3).fold(0, |a, p| if v[p].abs() < v[a].abs() { p } else { a });
            let mut e = [0.0; 3];
            e[least] = 1.0;
            let first = unit(cross(v, &e));
            [Some(first), Some(cross(v, &first))]
        }
        [false, true, true] => [Some(unit([0.0, -v[2], v[1]])), None],
        [true, false, true] => [Some(unit([-v[2], 0.0, v[0]])), None],
        [true, true, false] => [Some(unit([-v[1], v[0], 0.0])), None],
        _ => [None, None],
    }
}

fn cross(a: &[f64; 3], b: &[f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn unit(a: [f64; 3]) -> [f64; 3] {
    let norm = dot(&a, &a).sqrt();
    a.map(|x| x / norm)
}

fn dot(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
