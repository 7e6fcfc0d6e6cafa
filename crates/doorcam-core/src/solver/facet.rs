//! The exact minimiser of eq. 13 over one facet's (c_n, v_n) with all else fixed.
//!
//! With the residual's correlations g_s = A_snᵀ r_s (3-vectors; r without this facet's own light) and the column
//! energies a_s = ‖A_sn‖², write c = ρ (cos φ, sin φ), ρ >= 0. For a given φ, the best unit colour v is along
//! g(φ) = cos φ g_L + sin φ g_R, or along its positive part where v >= 0 is required. With h(φ) = ‖g(φ)‖ (or ‖g(φ)₊‖),
//! the best ρ is (h − λ)₊ / d(φ), d = a_L cos²φ + a_R sin²φ, and the objective falls by ½ (h − λ)₊² / d. What remains
//! is to maximise a function of one angle.

use std::f64::consts::{FRAC_PI_2, TAU};
use std::sync::LazyLock;

use super::dual::{dual_direction, signed_dual_norm};
use crate::scene::Intensity;

/// Which (c_L, c_R) and v a facet may have.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Admissible {
    /// c_L, c_R >= 0 and v >= 0: the published model's foreground.
    Brighter,
    /// c_L, c_R of any sign and v >= 0: the published model's background.
    EitherSign,
    /// c_L, c_R >= 0 and v of any sign: every facet of the signed model, eq. 13 as it is written.
    Signed,
}

/// Correlations (g_L, g_R) of one facet: per side, one value per colour.
pub type Pair = [[f64; 3]; 2];

/// Number of intervals in which a quarter turn is scanned before the best bracket is refined.
const SCAN: usize = 12;

/// (sin, cos) of the scanned angles of a whole turn.
static SCANNED: LazyLock<[(f64, f64); 4 * SCAN + 1]> =
    LazyLock::new(|| std::array::from_fn(|k| (k as f64 * TAU / (4 * SCAN) as f64).sin_cos()));

/// Scanned peaks of at least this share of the largest are refined, since a narrow one may be higher than its samples.
const CONTENDER: f64 = 0.7;

/// Most steps of the refinement.
const REFINE: usize = 40;

/// The refinement stops at brackets of this width, in radians: within it, the objective is flat up to rounding.
const FLAT: f64 = 1e-10;

impl Admissible {
    /// Whether v >= 0 is required.
    pub fn colour_is_nonnegative(self) -> bool {
        matches!(self, Admissible::Brighter | Admissible::EitherSign)
    }

    /// Whether c_L, c_R >= 0 is required.
    pub fn light_is_nonnegative(self) -> bool {
        matches!(self, Admissible::Brighter | Admissible::Signed)
    }

    /// g(φ), or its positive part where v >= 0 is required. Its direction is the best colour, its length is h(φ).
    pub(super) fn colour(self, pair: &Pair, (sin, cos): (f64, f64)) -> [f64; 3] {
        let floor = if self.colour_is_nonnegative() { 0.0 } else { f64::NEG_INFINITY };
        std::array::from_fn(|p| (cos * pair[0][p] + sin * pair[1][p]).max(floor))
    }

    /// max over admissible unit c and v of ⟨c vᵀ, g⟩. The facet stays dark if and only if this is at most λ.
    pub fn dual_norm(self, pair: &Pair) -> f64 {
        if self == Admissible::Signed { signed_dual_norm(pair) } else { dual_direction(self, pair).0 }
    }

    /// The facet's exact minimiser; zero if a dark facet is better.
    ///
    /// `pair` are the correlations without the facet's own light, `energy` is (a_L, a_R).
    pub fn minimise(self, pair: &Pair, energy: [f64; 2], lambda: f64) -> Intensity {
        // ‖g(φ)‖² <= ‖g_L‖² + ‖g_R‖² identifies most dark facets cheaply.
        let most = pair.iter().flatten().map(|x| x * x).sum::<f64>();
        if most <= lambda * lambda || (energy[0] <= 0.0 && energy[1] <= 0.0) {
            return Intensity::default();
        }
        // A side that does not see the facet has energy 0; keep d above 0 at angles that point to it.
        let floor = 1e-12 * energy[0].max(energy[1]);
        let gain = Gain { kind: self, pair, energy: energy.map(|a| a.max(floor)), lambda };
        let Some((sin, cos)) = gain.best() else {
            return Intensity::default();
        };
        let g = self.colour(pair, (sin, cos));
        let h = norm(&g);
        let rho = (h - lambda) / gain.energy((sin, cos));
        Intensity { left: rho * cos, right: rho * sin, colour: g.map(|x| x / h) }
    }
}

/// The function of the angle φ that a facet maximises.
struct Gain<'a> {
    kind: Admissible,
    pair: &'a Pair,
    energy: [f64; 2],
    lambda: f64,
}

impl Gain<'_> {
    /// d(φ).
    fn energy(&self, (sin, cos): (f64, f64)) -> f64 {
        self.energy[0] * cos * cos + self.energy[1] * sin * sin
    }

    /// Twice the fall of the objective.
    fn at(&self, direction: (f64, f64)) -> f64 {
        let h2 = self.kind.colour(self.pair, direction).iter().map(|g| g * g).sum::<f64>();
        if h2 <= self.lambda * self.lambda {
            return 0.0;
        }
        let over = h2.sqrt() - self.lambda;
        over * over / self.energy(direction)
    }

    /// A function with the sign of the derivative of the gain; none where the gain is zero.
    fn slope(&self, phi: f64) -> Option<f64> {
        let (sin, cos) = phi.sin_cos();
        let [left, right] = self.pair;
        let g = self.kind.colour(self.pair, (sin, cos));
        let h = norm(&g);
        if h <= self.lambda {
            return None;
        }
        let half_h2_slope = (0..3).map(|p| g[p] * (cos * right[p] - sin * left[p])).sum::<f64>();
        let half_d_slope = (self.energy[1] - self.energy[0]) * sin * cos;
        // With F = (h − λ)² / d: F' = 2 (h − λ) / d² · (h' d − (h − λ) d' / 2).
        Some(half_h2_slope / h * self.energy((sin, cos)) - (h - self.lambda) * half_d_slope)
    }

    /// (sin, cos) of the angle of the largest gain; none if the gain is zero everywhere.
    fn best(&self) -> Option<(f64, f64)> {
        let closed = !self.kind.light_is_nonnegative();
        let (to, count) = if closed { (TAU, 4 * SCAN) } else { (FRAC_PI_2, SCAN) };
        let step = to / count as f64;
        let (lowest, highest) = if closed { (f64::NEG_INFINITY, f64::INFINITY) } else { (0.0, FRAC_PI_2) };
        let climb_from = |phi: f64| self.climb((phi - step).max(lowest), phi, (phi + step).min(highest));
        let mut gains = [0.0; 4 * SCAN + 1];
        for (gain, &direction) in gains.iter_mut().zip(&SCANNED[..=count]) {
            *gain = self.at(direction);
        }
        let largest = gains[..=count].iter().fold(0.0_f64, |a, &b| a.max(b));
        let phi = if largest > 0.0 {
            let before = |k: usize| if k > 0 { gains[k - 1] } else { gains[if closed { count - 1 } else { 0 }] };
            let after = |k: usize| if k < count { gains[k + 1] } else { gains[if closed { 1 } else { count }] };
            (0..=count)
                .filter(|&k| gains[k] >= CONTENDER * largest && gains[k] >= before(k) && gains[k] >= after(k))
                .map(|k| climb_from(k as f64 * step))
                .map(|phi| (phi, self.at(phi.sin_cos())))
                .reduce(|best, next| if next.1 > best.1 { next } else { best })?
                .0
        } else {
            // The scan can miss a gain only near the angle of the largest h.
            let (h, (sin, cos)) = dual_direction(self.kind, self.pair);
            if h <= self.lambda {
                return None;
            }
            climb_from(sin.atan2(cos))
        };
        // cos(π/2) is not exactly zero in floating point, but a facet that only the right patch sees has c_L = 0.
        if !closed && phi >= FRAC_PI_2 { Some((1.0, 0.0)) } else { Some(phi.sin_cos()) }
    }

    /// The maximum in [low, high] around `inside`, where the gain is positive. Finds the slope's sign change by false
    /// position, in the Illinois variant: halving the stale end's value makes both ends move.
    fn climb(&self, low: f64, inside: f64, high: f64) -> f64 {
        let up = self.slope(inside).unwrap_or(0.0) >= 0.0;
        let (mut a, mut b) = if up { (inside, high) } else { (low, inside) };
        // Where the gain is zero, the maximum lies back towards `inside`.
        let rising = |phi: f64| self.slope(phi).unwrap_or(if up { -1.0 } else { 1.0 });
        let (mut fa, mut fb) = (rising(a), rising(b));
        if up && fb >= 0.0 {
            return b;
        }
        if !up && fa <= 0.0 {
            return a;
        }
        let mut last_moved_a = None;
        for step in 0..REFINE {
            if b - a < FLAT {
                break;
            }
            let secant = a - fa * (b - a) / (fb - fa);
            let phi = if step % 8 == 7 || !(a..=b).contains(&secant) { 0.5 * (a + b) } else { secant };
            let f = rising(phi);
            if f == 0.0 || phi == a || phi == b {
                return phi;
            }
            let moves_a = f > 0.0;
            let stale = if last_moved_a == Some(moves_a) { 0.5 } else { 1.0 };
            last_moved_a = Some(moves_a);
            if moves_a {
                (a, fa, fb) = (phi, f, fb * stale);
            } else {
                (b, fb, fa) = (phi, f, fa * stale);
            }
        }
        if self.at(a.sin_cos()) >= self.at(b.sin_cos()) { a } else { b }
    }
}

fn norm(g: &[f64; 3]) -> f64 {
    g.iter().map(|x| x * x).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// ½ (a_L c_L² + a_R c_R²) − c_L g_L·v − c_R g_R·v + λ ‖c‖, the part of the objective that depends on the facet.
    fn cost(i: &Intensity, pair: &Pair, energy: [f64; 2], lambda: f64) -> f64 {
        let dot = |g: &[f64; 3]| (0..3).map(|p| g[p] * i.colour[p]).sum::<f64>();
        0.5 * (energy[0] * i.left * i.left + energy[1] * i.right * i.right)
            - i.left * dot(&pair[0])
            - i.right * dot(&pair[1])
            + lambda * i.left.hypot(i.right)
    }

    fn kind() -> impl Strategy<Value = Admissible> {
        prop::sample::select(vec![Admissible::Brighter, Admissible::EitherSign, Admissible::Signed])
    }

    /// Column energies: one patch may see a facet a thousand times better than the other.
    fn energy() -> impl Strategy<Value = f64> {
        (-3.0..0.5f64).prop_map(|e| 10f64.powf(e))
    }

    fn side() -> impl Strategy<Value = [f64; 3]> {
        prop::array::uniform3(-1.0..1.0f64)
    }

    proptest! {
        #![proptest_config(crate::testing::cases(400))]
        /// Compares with brute force over a fine lattice of angles, with v and ρ from their closed forms.
        #[test]
        fn no_admissible_point_is_better(
            left in side(), right in side(), a in energy(), b in energy(), lambda in 0.01..1.2f64, kind in kind(),
        ) {
            let pair = [left, right];
            let found = kind.minimise(&pair, [a, b], lambda);
            let ours = cost(&found, &pair, [a, b], lambda);
            prop_assert!(ours <= 0.0);
            prop_assert!(!kind.light_is_nonnegative() || (found.left >= 0.0 && found.right >= 0.0));
            prop_assert!(!kind.colour_is_nonnegative() || found.colour.iter().all(|&v| v >= 0.0));
            let to = if kind.light_is_nonnegative() { FRAC_PI_2 } else { TAU };
            for k in 0..=4000 {
                let phi = to * f64::from(k) / 4000.0;
                let (sin, cos) = phi.sin_cos();
                let along: [f64; 3] = std::array::from_fn(|p| cos * left[p] + sin * right[p]);
                let g = if kind.colour_is_nonnegative() { along.map(|x| x.max(0.0)) } else { along };
                let h = g.iter().map(|x| x * x).sum::<f64>().sqrt();
                if h == 0.0 { continue }
                let rho = ((h - lambda) / (a * cos * cos + b * sin * sin)).max(0.0);
                let other = Intensity { left: rho * cos, right: rho * sin, colour: g.map(|x| x / h) };
                let theirs = cost(&other, &pair, [a, b], lambda);
                // Two peaks within one interval of the scan are rare, and then have nearly the same height.
                prop_assert!(ours <= theirs + 1e-3 * theirs.abs(), "{found:?} {ours} {other:?} {theirs}");
            }
        }

        #[test]
        fn a_facet_is_dark_if_and_only_if_its_dual_norm_is_at_most_lambda(
            left in side(), right in side(), a in energy(), b in energy(), kind in kind(),
        ) {
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
