//! How far a facet with light is from meeting the first-order conditions of eq. 13.
//!
//! Write c = ρ u with unit u, and z_s = A_snᵀ r_s at the point. With X = ρ u vᵀ, the derivatives of the objective are
//! λ u_s − z_s·v along c_s, and −q·(u_L z_L + u_R z_R) along a direction q of v orthogonal to v (times ρ, since that
//! is how far X moves). Each must be zero, or nonnegative where c_s or a colour of v is at its bound.

use super::facet::{Admissible, Pair};
use crate::scene::Intensity;

/// The largest violated condition, as a share of λ.
pub(super) fn violation(kind: Admissible, i: &Intensity, z: &Pair, lambda: f64) -> f64 {
    let rho = i.strength();
    let u = [i.left / rho, i.right / rho];
    let v = i.colour;
    let mut worst = 0.0_f64;
    for s in 0..2 {
        let slope = lambda * u[s] - dot(&z[s], &v);
        let bound = kind.light_is_nonnegative() && u[s] == 0.0;
        worst = worst.max(if bound { -slope } else { slope.abs() });
    }
    let pull: [f64; 3] = std::array::from_fn(|p| u[0] * z[0][p] + u[1] * z[1][p]);
    let along = dot(&pull, &v);
    for p in 0..3 {
        let slope = along * v[p] - pull[p];
        let bound = kind.colour_is_nonnegative() && v[p] == 0.0;
        worst = worst.max(if bound { -slope } else { slope.abs() });
    }
    worst / lambda.max(f64::MIN_POSITIVE)
}

fn dot(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    (0..3).map(|p| a[p] * b[p]).sum()
}
