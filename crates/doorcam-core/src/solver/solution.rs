use crate::scene::Intensity;

/// When to stop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Stop when no first-order condition is violated by more than this share of λ.
    pub tolerance: f64,
    /// Stop after this many sweeps and Newton steps in all, with the best point so far.
    pub sweeps: usize,
}

impl Default for Limits {
    fn default() -> Self {
        Self { tolerance: 1e-8, sweeps: 4000 }
    }
}

/// Where to start.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Start {
    /// From the empty map.
    Empty,
    /// From the intensities of the solution that is to be replaced.
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
    /// Lower bound on the objective of every admissible point, by duality: a small gap proves the solution, a large one
    /// says only that it is not proven.
    pub bound: f64,
    /// The largest violation of a first-order condition, as a share of λ w_n.
    pub residual: f64,
    /// Per facet with light, whether it wants light of a second colour or balance of left and right as well: ⟨c vᵀ, Aᵀr⟩
    /// exceeds λ w_n for another admissible unit (c, v) than its own, so that a sum of two such lights would lower the
    /// objective of the problem without the rank constraint. If no facet does, the solution is the global optimum.
    pub wants_second: Vec<bool>,
    /// Sweeps over facets and Newton steps that it took.
    pub sweeps: usize,
    /// Whether it started from an earlier solution.
    pub warm: bool,
    /// Whether it stopped at the cap on sweeps rather than at the tolerance.
    pub capped: bool,
}

impl Solution {
    /// The value of eq. 13.
    pub fn objective(&self) -> f64 {
        self.data + self.penalty
    }
}
