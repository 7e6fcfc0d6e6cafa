use crate::scene::Intensity;

/// When a solve stops.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Stop once no first-order condition is violated by more than this share of λ.
    pub tolerance: f64,
    /// Stop after this many sweeps and Newton steps in total, with the best point so far.
    pub sweeps: usize,
}

impl Default for Limits {
    fn default() -> Self {
        Self { tolerance: 1e-8, sweeps: 4000 }
    }
}

/// Where a solve starts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Start {
    /// From the empty map.
    Empty,
    /// From the intensities of the solution that will be replaced.
    Previous,
}

/// A stationary point of eq. 13.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Solution {
    /// (c_L, c_R) and v of each facet.
    pub intensities: Vec<Intensity>,
    /// The penalty's weight.
    pub lambda: f64,
    /// Data term: half the squared residual.
    pub data: f64,
    /// λ Σ w_n ‖c_n‖.
    pub penalty: f64,
    /// Lower bound on the objective of every admissible point, by duality. A small gap proves the solution optimal; a
    /// large one only leaves it unproven.
    pub bound: f64,
    /// The largest violation of a first-order condition, as a share of λ w_n.
    pub residual: f64,
    /// Per facet with light, whether it also wants light of a second colour or left-right balance: ⟨c vᵀ, Aᵀr⟩ exceeds
    /// λ w_n for an admissible unit (c, v) other than its own, so a sum of two such lights would lower the objective of
    /// the problem without the rank constraint. If this holds for no facet, the solution is the global optimum.
    pub wants_second: Vec<bool>,
    /// Number of sweeps over facets and Newton steps taken.
    pub sweeps: usize,
    /// Whether it started from an earlier solution.
    pub warm: bool,
    /// Whether it stopped at the limit on sweeps before reaching the tolerance.
    pub capped: bool,
}

impl Solution {
    /// The value of eq. 13.
    pub fn objective(&self) -> f64 {
        self.data + self.penalty
    }
}
