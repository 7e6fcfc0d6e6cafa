//! The dual norm of one facet: Ω°(g) = max over admissible unit c and v of ⟨c vᵀ, g⟩ = max over admissible φ of h(φ).
//!
//! Where the colours in a set S are positive, h² = cᵀ M_S c with M_S = Σ_{p in S} g^p g^pᵀ, g^p = (g_L^p, g_R^p). h²
//! has a continuous derivative, so its maximum is at the leading eigenvector of one of the M_S or at an end of the
//! range of φ. All these directions are admissible, so trying each of them is exact and no scan is needed.

use pulp::{Simd, WithSimd};

use super::active::Planes;
use super::facet::{Admissible, Pair};

/// The dual norm, and (sin φ, cos φ) where it is attained.
pub(super) fn dual_direction(kind: Admissible, pair: &Pair) -> (f64, (f64, f64)) {
    let mut best = (0.0, (0.0, 1.0));
    let mut consider = |direction: (f64, f64)| {
        let h2 = kind.colour(pair, direction).iter().map(|g| g * g).sum::<f64>();
        if h2 > best.0 {
            best = (h2, direction);
        }
    };
    let quadrant = kind.light_is_nonnegative();
    consider((0.0, 1.0));
    consider((1.0, 0.0));
    // Without v >= 0, all colours count at every φ.
    let sets = if kind.colour_is_nonnegative() { 1..8 } else { 7..8 };
    for set in sets {
        let (sin, cos) = leading(pair, set);
        if !quadrant {
            consider((sin, cos));
            consider((-sin, -cos));
        } else if sin * cos >= 0.0 {
            consider((sin.abs(), cos.abs()));
        }
    }
    (best.0.sqrt(), best.1)
}

/// The dual norm if it is above `lambda`, otherwise an upper bound on it that is at most `lambda`. This is enough to
/// tell whether a dark facet wants light, and much cheaper for most facets.
pub(super) fn dual_norm_above(kind: Admissible, pair: &Pair, lambda: f64) -> f64 {
    // (cos φ g_L + sin φ g_R)₊ <= cos φ g_L₊ + sin φ g_R₊ for φ in the first quadrant; then ‖·‖ by Cauchy-Schwarz.
    let floor = if kind == Admissible::Brighter { 0.0 } else { f64::NEG_INFINITY };
    let most = pair.iter().flatten().map(|x| x.max(floor).powi(2)).sum::<f64>().sqrt();
    if most <= lambda { most } else { kind.dual_norm(pair) }
}

/// The dual norm where v may have any sign and c_L, c_R >= 0. Then h² = cᵀ M c with the same M = [ll lr; lr rr] for all
/// c. If lr >= 0, M's leading eigenvector is in the quadrant and the maximum of h² is its eigenvalue; otherwise the
/// maximum is at one of the quadrant's ends.
#[inline(always)]
pub(super) fn signed_dual_norm([left, right]: &Pair) -> f64 {
    let dot = |a: &[f64; 3], b: &[f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let (ll, lr, rr) = (dot(left, left), dot(left, right), dot(right, right));
    let turned = 0.5 * (ll + rr + ((ll - rr) * (ll - rr) + 4.0 * lr * lr).sqrt());
    (if lr > 0.0 { turned } else { ll.max(rr) }).sqrt()
}

/// [`signed_dual_norm`] of many facets, with the widest available vector registers.
pub(super) struct SignedDualNorms<'a> {
    pub correlations: &'a Planes,
    pub out: &'a mut [f64],
}

impl WithSimd for SignedDualNorms<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let n = self.out.len();
        let [[l0, l1, l2], [r0, r1, r2]] = self.correlations.each_ref().map(|side| side.each_ref().map(|p| &p[..n]));
        for (k, out) in self.out.iter_mut().enumerate() {
            *out = signed_dual_norm(&[[l0[k], l1[k], l2[k]], [r0[k], r1[k], r2[k]]]);
        }
    }
}

/// (sin, cos) of the leading eigenvector of M_S, with S the bits of `set`.
fn leading(pair: &Pair, set: usize) -> (f64, f64) {
    let (mut ll, mut lr, mut rr) = (0.0, 0.0, 0.0);
    for p in (0..3).filter(|p| set >> p & 1 == 1) {
        let (l, r) = (pair[0][p], pair[1][p]);
        (ll, lr, rr) = (ll + l * l, lr + l * r, rr + r * r);
    }
    // Half the angle of (ll − rr, 2 lr), by the half-angle formula without cancellation.
    let (x, y) = (ll - rr, 2.0 * lr);
    let r = (x * x + y * y).sqrt();
    if r == 0.0 {
        return (0.0, 1.0);
    }
    let (cos, sin) = if x >= 0.0 { (r + x, y) } else { (y.abs(), (r - x).copysign(y)) };
    let length = (cos * cos + sin * sin).sqrt();
    (sin / length, cos / length)
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{FRAC_PI_2, TAU};

    use proptest::prelude::*;

    use super::*;

    proptest! {
        #![proptest_config(crate::testing::cases(1000))]
        #[test]
        fn no_angle_of_a_fine_lattice_has_a_larger_h(
            pair in prop::array::uniform2(prop::array::uniform3(prop_oneof![-1.0..1.0f64, Just(0.0)])),
            kind in prop::sample::select(vec![Admissible::Brighter, Admissible::EitherSign, Admissible::Signed]),
        ) {
            let (norm, direction) = dual_direction(kind, &pair);
            let h = |direction| kind.colour(&pair, direction).iter().map(|g| g * g).sum::<f64>().sqrt();
            prop_assert!((direction.0.hypot(direction.1) - 1.0).abs() < 1e-12);
            prop_assert!((h(direction) - norm).abs() < 1e-12);
            let to = if kind.light_is_nonnegative() { FRAC_PI_2 } else { TAU };
            let most = (0..=2000).map(|k| h((to * f64::from(k) / 2000.0).sin_cos())).fold(0.0, f64::max);
            prop_assert!(most <= norm + 1e-12, "{most} {norm}");
            prop_assert!(norm <= most * (1.0 + 1e-5) + 1e-12, "{most} {norm}");
            for lambda in [0.5 * norm, 2.0 * norm + 1e-9] {
                let above = dual_norm_above(kind, &pair, lambda);
                prop_assert!(above >= norm - 1e-12);
                prop_assert!((above > lambda) == (norm > lambda), "{above} {norm} {lambda}");
            }
        }
    }
}
