//! Newton's step on all facets with light at once.
//!
//! Near a solution the facets that have light, the c_s at 0 and the colours at 0 stay what they are, and eq. 13 is smooth
//! in the rest. Block descent is slow there because neighbouring facets look much alike; Newton's method is not.
//!
//! Around X_n = ρ u vᵀ the coordinates are c itself and w, with v turning to v + Q w/ρ made unit, where Q's columns are at
//! right angles to v (and zero where a colour is at its bound). X_n moves along p qᵀ with (p, q) = (e_s, v) for c_s and
//! (u, q_k) for w_k, so that the Hessian is, with z = Aᵀr,
//!
//! Σ_s G_s,nm (p_s p'_s) (q·q') for any two tangents, plus, for tangents of one facet,
//! λ/ρ (I − u uᵀ) for c, −z_s·q_k/ρ between c_s and w_k, (uᵀ z v)/ρ I for w.

use super::active::{Active, Point, lit, pair};
use super::cholesky;
use super::facet::{Admissible, Pair};
use crate::scene::Intensity;

/// Steps that are tried at most, each damped more than the one before.
const TRIALS: usize = 4;

/// Damping (Levenberg and Marquardt's: a share of the Hessian's diagonal that is added to it) after the first bad step,
/// its bounds, and the factors by which it changes. A full Newton step is far too long while facets still come and go:
/// the Hessian is nearly singular, for neighbouring facets look much alike.
const DAMPING: Damping = Damping { first: 1e-3, least: 1e-8, most: 1.0, more: 10.0, some_more: 3.0, less: 0.1 };

struct Damping {
    first: f64,
    least: f64,
    most: f64,
    more: f64,
    some_more: f64,
    less: f64,
}

/// A step is good if the objective falls by this share of its linear prediction.
const GOOD: f64 = 1e-4;

/// Differences of the objective below this share of ‖y‖² are rounding; the residual decides then.
const ROUNDING: f64 = 1e-15;

/// One coordinate: X of the facet moves along `light` `colour`ᵀ.
#[derive(Debug, Clone, Copy)]
struct Tangent {
    facet: usize,
    role: Role,
    light: [f64; 2],
    colour: [f64; 3],
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Role {
    /// c_s.
    Light(usize),
    /// w_k.
    Colour(usize),
}

/// Room for Newton's step.
#[derive(Debug, Clone, Default)]
pub(super) struct Newton {
    tangents: Vec<Tangent>,
    gradient: Vec<f64>,
    hessian: Vec<f64>,
    step: Vec<f64>,
    trial: Point,
    damping: f64,
}

impl Newton {
    /// Room for `n` facets.
    pub fn with_capacity(n: usize) -> Self {
        Self {
            tangents: Vec::with_capacity(4 * n),
            gradient: Vec::with_capacity(4 * n),
            // Solutions have light in a fraction of the facets; should they have more, this grows once.
            hessian: Vec::with_capacity((2 * n).pow(2)),
            step: Vec::with_capacity(4 * n),
            trial: Point::with_capacity(n),
            damping: 0.0,
        }
    }

    /// Forgets the damping of the solve before.
    pub fn reset(&mut self) {
        self.damping = 0.0;
    }

    /// Moves the point if that lowers the objective; returns by how much, none if no step was good.
    pub fn step(&mut self, active: &Active, point: &mut Point) -> Option<f64> {
        self.span(active, point);
        if self.tangents.is_empty() {
            return None;
        }
        let rounding = ROUNDING * active.energy();
        for _ in 0..TRIALS {
            let mut at_end = false;
            if self.solve(active, point, true) || self.solve(active, point, false) {
                let slope: f64 = self.gradient.iter().zip(&self.step).map(|(g, d)| g * d).sum();
                self.take(active, point);
                let fall = active.fall(point, &self.trial);
                at_end = -slope <= 1e-3 * rounding;
                // At the very end even the fall is rounding; the residual still tells better from worse.
                let good = fall >= -GOOD * slope
                    || (fall >= -rounding && active.residual(&self.trial) < 0.5 * active.residual(point));
                if good {
                    self.adapt(fall / (-0.5 * slope));
                    std::mem::swap(point, &mut self.trial);
                    return Some(fall);
                }
            }
            if at_end {
                return None;
            }
            self.damping = (self.damping * DAMPING.more).clamp(DAMPING.first, DAMPING.most);
        }
        None
    }

    /// Damps less after a step that did what the quadratic model promised, more after one that did not.
    fn adapt(&mut self, kept: f64) {
        if kept > 0.8 {
            self.damping *= DAMPING.less;
        } else if kept < 0.3 {
            self.damping *= DAMPING.some_more;
        }
        if self.damping < DAMPING.least {
            self.damping = 0.0;
        }
    }

    /// Sets up the coordinates and the gradient.
    fn span(&mut self, active: &Active, point: &Point) {
        self.tangents.clear();
        self.gradient.clear();
        for (facet, light) in point.light.iter().enumerate().filter(|(_, light)| lit(light)) {
            let kind = active.kinds[facet];
            let z = pair(&point.correlations, facet);
            let (_, u) = polar(light);
            for s in 0..2 {
                if u[s] != 0.0 || !kind.light_is_nonnegative() {
                    let e = if s == 0 { [1.0, 0.0] } else { [0.0, 1.0] };
                    self.tangents.push(Tangent { facet, role: Role::Light(s), light: e, colour: light.colour });
                    self.gradient.push(active.lambdas[facet] * u[s] - dot(&z[s], &light.colour));
                }
            }
            for (k, q) in turns(kind, &light.colour).into_iter().flatten().enumerate() {
                self.tangents.push(Tangent { facet, role: Role::Colour(k), light: u, colour: q });
                self.gradient.push(-u[0] * dot(&z[0], &q) - u[1] * dot(&z[1], &q));
            }
        }
    }

    /// Solves for the step: with the exact Hessian, or, where that is not positive definite, without the terms that may be
    /// negative.
    fn solve(&mut self, active: &Active, point: &Point, exact: bool) -> bool {
        let n = self.tangents.len();
        self.hessian.clear();
        self.hessian.resize(n * n, 0.0);
        for (a, ta) in self.tangents.iter().enumerate() {
            let rows = [active.row(0, ta.facet), active.row(1, ta.facet)];
            let out = &mut self.hessian[a * n..][..=a];
            for (value, tb) in out.iter_mut().zip(&self.tangents) {
                let both = [0, 1].map(|s| rows[s][tb.facet] * ta.light[s] * tb.light[s]);
                *value = (both[0] + both[1]) * dot(&ta.colour, &tb.colour);
            }
            let z = pair(&point.correlations, ta.facet);
            let light = &point.light[ta.facet];
            for b in (0..=a).rev().take_while(|&b| self.tangents[b].facet == ta.facet) {
                out[b] += curvature(ta, &self.tangents[b], light, &z, active.lambdas[ta.facet], exact);
            }
            out[a] *= 1.0 + self.damping;
        }
        self.step.clear();
        self.step.extend(self.gradient.iter().map(|g| -g));
        cholesky::solve(&mut self.hessian, &mut self.step)
    }

    /// Puts the point after the step into `self.trial`.
    fn take(&mut self, active: &Active, point: &Point) {
        self.trial.light.clone_from(&point.light);
        let mut steps = self.step.iter();
        for tangents in self.tangents.chunk_by(|a, b| a.facet == b.facet) {
            let facet = tangents[0].facet;
            let old = &point.light[facet];
            let (rho, _) = polar(old);
            let (mut c, mut v) = ([old.left, old.right], old.colour);
            for (tangent, by) in tangents.iter().zip(&mut steps) {
                match tangent.role {
                    Role::Light(s) => c[s] += by,
                    Role::Colour(_) => (0..3).for_each(|p| v[p] += by / rho * tangent.colour[p]),
                }
            }
            self.trial.light[facet] = admit(active.kinds[facet], old, c, v);
        }
        active.correlate(&mut self.trial);
    }
}

/// The nearest admissible values; dark if the step leads through zero.
fn admit(kind: Admissible, old: &Intensity, c: [f64; 2], v: [f64; 3]) -> Intensity {
    let c = if kind.light_is_nonnegative() { c.map(|x| x.max(0.0)) } else { c };
    let v = if kind.colour_is_nonnegative() { v.map(|x| x.max(0.0)) } else { v };
    let norm = dot(&v, &v).sqrt();
    if c[0] * old.left + c[1] * old.right <= 0.0 || norm == 0.0 {
        return Intensity::default();
    }
    Intensity { left: c[0], right: c[1], colour: v.map(|x| x / norm) }
}

/// The second derivatives of penalty and parametrisation between two tangents of one facet.
fn curvature(a: &Tangent, b: &Tangent, i: &Intensity, z: &Pair, lambda: f64, exact: bool) -> f64 {
    let (rho, u) = polar(i);
    let same = if a.role == b.role { 1.0 } else { 0.0 };
    match (a.role, b.role) {
        (Role::Light(s), Role::Light(t)) => lambda / rho * (same - u[s] * u[t]),
        (Role::Colour(_), Role::Colour(_)) => {
            let along = u[0] * dot(&z[0], &i.colour) + u[1] * dot(&z[1], &i.colour);
            same * if exact { along } else { along.max(lambda) } / rho
        }
        (Role::Light(s), Role::Colour(_)) if exact => -dot(&z[s], &b.colour) / rho,
        (Role::Colour(_), Role::Light(s)) if exact => -dot(&z[s], &a.colour) / rho,
        _ => 0.0,
    }
}

/// ρ and u.
fn polar(i: &Intensity) -> (f64, [f64; 2]) {
    let rho = i.left.hypot(i.right);
    (rho, [i.left / rho, i.right / rho])
}

/// Unit vectors that v can turn to: at right angles to v and to each other, without the colours at their bound.
fn turns(kind: Admissible, v: &[f64; 3]) -> [Option<[f64; 3]>; 2] {
    let free = |p: usize| v[p] != 0.0 || !kind.colour_is_nonnegative();
    match [0, 1, 2].map(free) {
        [true, true, true] => {
            // Cross v with the axis that it is least along.
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
