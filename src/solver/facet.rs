//! The exact minimiser of eq. 13 over one facet's (c_n, v_n), all else fixed.
//!
//! With the residual's correlations g_s = A_snᵀ r_s (3-vectors; r without this facet's own light) and the column energies
//! a_s = ‖A_sn‖², write c = ρ (cos φ, sin φ), ρ >= 0. For given φ the best unit colour v is along
//! g(φ) = cos φ g_L + sin φ g_R, or along its positive part where v >= 0 is asked for, and with h(φ) = ‖g(φ)‖ (‖g(φ)₊‖)
//! the best ρ is (h − λ)₊ / d(φ), d = a_L cos²φ + a_R sin²φ. The objective falls by ½ (h − λ)₊² / d: one function of one
//! angle is left to maximise.

use std::f64::consts::{FRAC_PI_2, TAU};
use std::sync::LazyLock;

use crate::scene::Intensity;

/// Which (c_L, c_R) and v a facet may have.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Admissible {
    /// c_L, c_R >= 0 and v >= 0: the published model's foreground.
    Brighter,
    /// c_L, c_R of any sign and v >= 0: the published model's background.
    EitherSign,
}

/// Correlations (g_L, g_R) of one facet: per side, three colours.
pub type Pair = [[f64; 3]; 2];

/// Intervals a quarter turn is scanned in before the best bracket is refined.
const SCAN: usize = 12;

/// (sin, cos) of the scanned angles of a whole turn.
static SCANNED: LazyLock<[(f64, f64); 4 * SCAN + 1]> =
    LazyLock::new(|| std::array::from_fn(|k| (k as f64 * TAU / (4 * SCAN) as f64).sin_cos()));

/// Steps of the refinement at most; it halves the bracket at least every second step.
const REFINE: usize = 24;

/// The function of the angle that a facet maximises.
struct Gain<'a> {
    pair: &'a Pair,
    energy: [f64; 2],
    lambda: f64,
}

impl Gain<'_> {
    /// (‖g(φ)₊‖², half its derivative).
    fn strength(&self, (sin, cos): (f64, f64)) -> (f64, f64) {
        let [left, right] = self.pair;
        let (mut h2, mut slope) = (0.0, 0.0);
        for p in 0..3 {
            let g = (cos * left[p] + sin * right[p]).max(0.0);
            h2 += g * g;
            slope += g * (cos * right[p] - sin * left[p]);
        }
        (h2, slope)
    }

    /// The fall of the objective, times two.
    fn at(&self, phi: f64) -> f64 {
        self.along(phi.sin_cos())
    }

    fn along(&self, (sin, cos): (f64, f64)) -> f64 {
        let (h2, _) = self.strength((sin, cos));
        if h2 <= self.lambda * self.lambda {
            return 0.0;
        }
        let over = h2.sqrt() - self.lambda;
        over * over / (self.energy[0] * cos * cos + self.energy[1] * sin * sin)
    }

    /// A function with the sign of the derivative of the gain, where the gain is positive.
    fn slope(&self, phi: f64) -> f64 {
        let (sin, cos) = phi.sin_cos();
        let (h2, half_slope) = self.strength((sin, cos));
        let h = h2.sqrt();
        let d = self.energy[0] * cos * cos + self.energy[1] * sin * sin;
        let half_d_slope = (self.energy[1] - self.energy[0]) * sin * cos;
        // With F = (h − λ)² / d: F' = 2 (h − λ) / d² · (h' d − (h − λ) d' / 2).
        half_slope / h * d - (h - self.lambda) * half_d_slope
    }
}

impl Admissible {
    /// The largest admissible φ, from 0, and whether the angles close to a circle.
    fn angles(self) -> (f64, bool) {
        match self {
            Admissible::Brighter => (FRAC_PI_2, false),
            Admissible::EitherSign => (TAU, true),
        }
    }

    /// max over admissible unit c and v of ⟨c vᵀ, g⟩: the facet stays dark if and only if this is at most λ.
    pub fn dual_norm(self, pair: &Pair) -> f64 {
        let gain = Gain { pair, energy: [1.0, 1.0], lambda: 0.0 };
        maximise(&gain, self).map_or(0.0, |(_, value)| value.sqrt())
    }

    /// The facet's exact minimiser; zero if the facet is better dark.
    ///
    /// `pair` are the correlations without the facet's own light, `energy` is (a_L, a_R).
    pub fn minimise(self, pair: &Pair, energy: [f64; 2], lambda: f64) -> Intensity {
        if energy[0] <= 0.0 && energy[1] <= 0.0 {
            return Intensity::default();
        }
        // A side that sees nothing of the facet has no say; keep d away from 0 for angles that point to it.
        let floor = 1e-12 * energy[0].max(energy[1]);
        let energy = energy.map(|a| a.max(floor));
        let gain = Gain { pair, energy, lambda };
        let Some((phi, _)) = maximise(&gain, self) else {
            return Intensity::default();
        };
        let (sin, cos) = phi.sin_cos();
        let g: [f64; 3] = std::array::from_fn(|p| (cos * pair[0][p] + sin * pair[1][p]).max(0.0));
        let h = g.iter().map(|x| x * x).sum::<f64>().sqrt();
        let rho = (h - lambda) / (energy[0] * cos * cos + energy[1] * sin * sin);
        Intensity { left: rho * cos, right: rho * sin, colour: g.map(|x| x / h) }
    }
}

/// The angle of the largest gain and that gain; none if it is zero everywhere.
fn maximise(gain: &Gain, admissible: Admissible) -> Option<(f64, f64)> {
    let bound2 = |g: &[f64; 3]| g.iter().map(|x| x * x).sum::<f64>();
    // ‖g(φ)‖² <= ‖g_L‖² + ‖g_R‖²: most dark facets are told here.
    if bound2(&gain.pair[0]) + bound2(&gain.pair[1]) <= gain.lambda * gain.lambda {
        return None;
    }
    let (to, closed) = admissible.angles();
    let count = if closed { 4 * SCAN } else { SCAN };
    let step = to / count as f64;
    let (best, value) = scan(gain, count);
    if value <= 0.0 {
        // A gain can hide between two scanned angles only just above the threshold: look where h is largest.
        return refine_strength(gain, step, count);
    }
    let phi = best as f64 * step;
    let low = if closed || best > 0 { phi - step } else { phi };
    let high = if closed || best < count { phi + step } else { phi };
    let phi = climb(gain, low, phi, high);
    Some((phi, gain.at(phi)))
}

/// The scanned angle of the largest gain, and that gain.
fn scan(gain: &Gain, count: usize) -> (usize, f64) {
    SCANNED[..=count].iter().enumerate().fold((0, 0.0), |best, (k, &direction)| {
        let value = gain.along(direction);
        if value > best.1 { (k, value) } else { best }
    })
}

/// Finds an angle with h > λ near the scanned angle of the largest h, if there is one.
fn refine_strength(gain: &Gain, step: f64, count: usize) -> Option<(f64, f64)> {
    let strength = Gain { pair: gain.pair, energy: [1.0, 1.0], lambda: 0.0 };
    let (best, h2) = scan(&strength, count);
    // Between two angles `step` apart, ‖g(φ)₊‖ is at most its larger value there divided by cos(step / 2).
    if h2.sqrt() <= gain.lambda * (step / 2.0).cos() {
        return None;
    }
    let phi = best as f64 * step;
    let (low, high) = ((phi - step).max(0.0), (phi + step).min(count as f64 * step));
    let top = climb(&strength, low, phi, high);
    if gain.at(top) <= 0.0 {
        return None;
    }
    let phi = climb(gain, low.max(top - step / 4.0), top, high.min(top + step / 4.0));
    Some((phi, gain.at(phi)))
}

/// The maximum in [low, high] around `inside`, where the gain is positive: the slope's sign change, by bisection with
/// secant steps.
fn climb(gain: &Gain, low: f64, inside: f64, high: f64) -> f64 {
    let at_inside = gain.slope(inside);
    // Uphill from `inside`, towards an end where the gain may be zero: there, the maximum is before the end.
    let (mut a, mut b) = if at_inside >= 0.0 { (inside, high) } else { (low, inside) };
    let rising = |phi: f64| {
        if gain.at(phi) > 0.0 {
            gain.slope(phi)
        } else if at_inside >= 0.0 {
            -1.0
        } else {
            1.0
        }
    };
    let (mut fa, mut fb) = (rising(a), rising(b));
    if at_inside >= 0.0 && fb >= 0.0 {
        return b;
    }
    if at_inside < 0.0 && fa <= 0.0 {
        return a;
    }
    for step in 0..REFINE {
        if b - a < 1e-13 {
            break;
        }
        let secant = a - fa * (b - a) / (fb - fa);
        let guard = 0.01 * (b - a);
        let phi = if step % 3 == 2 || !secant.is_finite() { 0.5 * (a + b) } else { secant.clamp(a + guard, b - guard) };
        let f = rising(phi);
        if f >= 0.0 {
            (a, fa) = (phi, f);
        } else {
            (b, fb) = (phi, f);
        }
    }
    if gain.at(a) >= gain.at(b) { a } else { b }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// ½ (a_L c_L² + a_R c_R²) − c_L g_L·v − c_R g_R·v + λ ‖c‖, the objective's part that depends on the facet.
    fn cost(i: &Intensity, pair: &Pair, energy: [f64; 2], lambda: f64) -> f64 {
        let dot = |g: &[f64; 3]| (0..3).map(|p| g[p] * i.colour[p]).sum::<f64>();
        0.5 * (energy[0] * i.left * i.left + energy[1] * i.right * i.right)
            - i.left * dot(&pair[0])
            - i.right * dot(&pair[1])
            + lambda * i.left.hypot(i.right)
    }

    fn side() -> impl Strategy<Value = [f64; 3]> {
        prop::array::uniform3(-1.0..1.0f64)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(400))]
        /// Against brute force over a fine lattice of angles, with v and ρ from their own closed forms evaluated literally.
        #[test]
        fn no_admissible_point_is_better(
            left in side(), right in side(), a in 0.02..3.0f64, b in 0.02..3.0f64, lambda in 0.01..1.2f64,
            either in any::<bool>(),
        ) {
            let pair = [left, right];
            let kind = if either { Admissible::EitherSign } else { Admissible::Brighter };
            let found = kind.minimise(&pair, [a, b], lambda);
            let ours = cost(&found, &pair, [a, b], lambda);
            prop_assert!(ours <= 0.0);
            if !either {
                prop_assert!(found.left >= 0.0 && found.right >= 0.0);
            }
            prop_assert!(found.colour.iter().all(|&v| v >= 0.0));
            let (to, _) = kind.angles();
            for k in 0..=4000 {
                let phi = to * f64::from(k) / 4000.0;
                let (sin, cos) = phi.sin_cos();
                let g: [f64; 3] = std::array::from_fn(|p| (cos * left[p] + sin * right[p]).max(0.0));
                let h = g.iter().map(|x| x * x).sum::<f64>().sqrt();
                if h == 0.0 { continue }
                let rho = ((h - lambda) / (a * cos * cos + b * sin * sin)).max(0.0);
                let other = Intensity { left: rho * cos, right: rho * sin, colour: g.map(|x| x / h) };
                let theirs = cost(&other, &pair, [a, b], lambda);
                prop_assert!(ours <= theirs + 1e-9 * (1.0 + theirs.abs()), "{found:?} {ours} {other:?} {theirs}");
            }
        }

        #[test]
        fn a_facet_is_dark_if_and_only_if_its_dual_norm_is_at_most_lambda(
            left in side(), right in side(), a in 0.02..3.0f64, b in 0.02..3.0f64, either in any::<bool>(),
        ) {
            let kind = if either { Admissible::EitherSign } else { Admissible::Brighter };
            let pair = [left, right];
            let norm = kind.dual_norm(&pair);
            prop_assert_eq!(kind.minimise(&pair, [a, b], norm * 1.0001 + 1e-12), Intensity::default());
            if norm > 1e-6 {
                let lit = kind.minimise(&pair, [a, b], norm * 0.999);
                prop_assert!(lit.left.hypot(lit.right) > 0.0);
            }
        }
    }
}
