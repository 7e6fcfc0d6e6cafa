use nalgebra::DMatrix;

use super::facet::{Admissible, Pair};
use super::projection::Correlations;
use crate::scene::Intensity;

/// When to stop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Stop when a sweep over the active facets lowers the objective by less than this fraction of it.
    pub tolerance: f64,
    /// Stop after this many sweeps in all, with the best point so far.
    pub sweeps: usize,
}

impl Default for Limits {
    fn default() -> Self {
        Self { tolerance: 1e-7, sweeps: 4000 }
    }
}

/// A stationary point of eq. 13.
#[derive(Debug, Clone, PartialEq)]
pub struct Solution {
    /// (c_L, c_R) and v of each facet.
    pub intensities: Vec<Intensity>,
    /// The penalty's weight.
    pub lambda: f64,
    /// Data term: half the squared residual.
    pub data: f64,
    /// λ Σ ‖c_n‖.
    pub penalty: f64,
    /// Lower bound on the objective of every admissible point, by duality: a small gap proves the solution, a large one
    /// says only that it is not proven.
    pub bound: f64,
    /// Sweeps over facets that it took.
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

/// Block descent over facets: each step is the exact minimiser over one facet's (c, v).
#[derive(Debug, Clone)]
pub struct Solver {
    gram: [DMatrix<f64>; 2],
    admissible: Vec<Admissible>,
}

/// The point that moves, and what is kept up to date with it.
struct State {
    intensities: Vec<Intensity>,
    /// Per side, channel and facet: A_snᵀ r_s^p with r the residual at the point.
    correlations: [[Vec<f64>; 3]; 2],
}

impl Solver {
    /// For the Gram matrices of the left and right side and each facet's admissible set.
    pub fn new(gram: &[DMatrix<f64>; 2], admissible: Vec<Admissible>) -> Self {
        Self { gram: gram.clone(), admissible }
    }

    /// The smallest λ with an empty map.
    pub fn lambda_max(&self, frame: &Correlations) -> f64 {
        (0..self.admissible.len()).map(|n| self.admissible[n].dual_norm(&pair(&frame.rhs, n))).fold(0.0, f64::max)
    }

    /// Descends from `start` (from the empty map without one).
    pub fn solve(&self, frame: &Correlations, lambda: f64, limits: Limits, start: Option<&Solution>) -> Solution {
        let n = self.admissible.len();
        let mut state = State { intensities: vec![Intensity::default(); n], correlations: frame.rhs.clone() };
        let warm = start.filter(|s| s.intensities.len() == n);
        if let Some(start) = warm {
            for (k, &intensity) in start.intensities.iter().enumerate() {
                self.set(&mut state, k, intensity);
            }
        }
        let mut active: Vec<usize> = (0..n).filter(|&k| state.intensities[k] != Intensity::default()).collect();
        let mut sweeps = 0;
        let capped = loop {
            let entered = self.enter(&state, lambda, &mut active);
            if !entered {
                break false;
            }
            if !self.settle(&mut state, frame, lambda, limits, &mut active, &mut sweeps) {
                break true;
            }
        };
        let (data, penalty) = self.terms(&state, frame, lambda);
        let bound = self.bound(&state, frame, lambda, data);
        Solution { intensities: state.intensities, lambda, data, penalty, bound, sweeps, warm: warm.is_some(), capped }
    }

    /// The dual objective s⟨y, r⟩ − ½ s²‖r‖² at the residual scaled by the largest s that keeps every facet's dual norm
    /// at most λ (and at most the best s).
    fn bound(&self, state: &State, frame: &Correlations, lambda: f64, data: f64) -> f64 {
        let r2 = 2.0 * data;
        if r2 <= 0.0 {
            return 0.0;
        }
        let explained: f64 = (state.intensities.iter().enumerate())
            .flat_map(|(n, i)| [(0, i.left), (1, i.right)].map(|(s, c)| (n, s, c, i.colour)))
            .map(|(n, s, c, v)| (0..3).map(|p| c * v[p] * frame.rhs[s][p][n]).sum::<f64>())
            .sum();
        let y_r = frame.energy - explained;
        let largest = (0..self.admissible.len())
            .map(|n| self.admissible[n].dual_norm(&pair(&state.correlations, n)))
            .fold(0.0, f64::max);
        let feasible = if largest > 0.0 { lambda / (largest * (1.0 + 1e-9)) } else { f64::INFINITY };
        let s = (y_r / r2).min(feasible).max(0.0);
        s * y_r - 0.5 * s * s * r2
    }

    /// Adds the dark facets that want light most to the active ones; false if none does.
    fn enter(&self, state: &State, lambda: f64, active: &mut Vec<usize>) -> bool {
        // A few at a time: the strongest ones usually explain what made the others want light.
        const AT_ONCE: usize = 3;
        let mut wanting: Vec<(f64, usize)> = (0..self.admissible.len())
            .filter(|&n| state.intensities[n] == Intensity::default())
            .map(|n| (self.admissible[n].dual_norm(&pair(&state.correlations, n)), n))
            .filter(|&(norm, _)| norm > lambda * (1.0 + 1e-6))
            .collect();
        wanting.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        let new = wanting.iter().take(AT_ONCE).map(|&(_, n)| n).filter(|n| !active.contains(n)).collect::<Vec<_>>();
        active.extend(&new);
        !new.is_empty()
    }

    /// Sweeps over the active facets until the objective stands still; false if the sweeps ran out.
    fn settle(
        &self,
        state: &mut State,
        frame: &Correlations,
        lambda: f64,
        limits: Limits,
        active: &mut Vec<usize>,
        sweeps: &mut usize,
    ) -> bool {
        loop {
            if *sweeps >= limits.sweeps {
                return false;
            }
            *sweeps += 1;
            let fall: f64 = active.iter().map(|&n| self.step(state, n, lambda)).sum();
            active.retain(|&n| state.intensities[n] != Intensity::default());
            let (data, penalty) = self.terms(state, frame, lambda);
            if fall <= limits.tolerance * (data + penalty) {
                return true;
            }
        }
    }

    /// Moves one facet to its exact minimiser; returns by how much the objective fell.
    fn step(&self, state: &mut State, n: usize, lambda: f64) -> f64 {
        let energy = [self.gram[0][(n, n)], self.gram[1][(n, n)]];
        let old = state.intensities[n];
        let mut g = pair(&state.correlations, n);
        let c = [old.left, old.right];
        for (s, side) in g.iter_mut().enumerate() {
            for (p, value) in side.iter_mut().enumerate() {
                *value += energy[s] * c[s] * old.colour[p];
            }
        }
        let new = self.admissible[n].minimise(&g, energy, lambda);
        let fall = local_cost(&old, &g, energy, lambda) - local_cost(&new, &g, energy, lambda);
        if fall <= 0.0 {
            return 0.0;
        }
        self.set(state, n, new);
        fall
    }

    /// Gives facet `n` new values and keeps the correlations up to date.
    fn set(&self, state: &mut State, n: usize, new: Intensity) {
        let old = std::mem::replace(&mut state.intensities[n], new);
        for (s, (c_old, c_new)) in [(old.left, new.left), (old.right, new.right)].into_iter().enumerate() {
            let column = self.gram[s].column(n);
            for p in 0..3 {
                let change = c_new * new.colour[p] - c_old * old.colour[p];
                if change != 0.0 {
                    for (value, g) in state.correlations[s][p].iter_mut().zip(column.iter()) {
                        *value -= change * g;
                    }
                }
            }
        }
    }

    /// (data term, penalty) at the point. With z = Aᵀr and w = Aᵀy: ‖y − Ax‖² = ‖y‖² − ⟨x, w + z⟩.
    fn terms(&self, state: &State, frame: &Correlations, lambda: f64) -> (f64, f64) {
        let (mut explained, mut norms) = (0.0, 0.0);
        for (n, i) in state.intensities.iter().enumerate() {
            if *i == Intensity::default() {
                continue;
            }
            norms += i.left.hypot(i.right);
            for (s, c) in [i.left, i.right].into_iter().enumerate() {
                for p in 0..3 {
                    explained += c * i.colour[p] * (frame.rhs[s][p][n] + state.correlations[s][p][n]);
                }
            }
        }
        (0.5 * (frame.energy - explained), lambda * norms)
    }
}

fn pair(correlations: &[[Vec<f64>; 3]; 2], n: usize) -> Pair {
    [0, 1].map(|s| [0, 1, 2].map(|p| correlations[s][p][n]))
}

/// The objective's part that depends on one facet.
fn local_cost(i: &Intensity, g: &Pair, energy: [f64; 2], lambda: f64) -> f64 {
    let dot = |g: &[f64; 3]| (0..3).map(|p| g[p] * i.colour[p]).sum::<f64>();
    0.5 * (energy[0] * i.left * i.left + energy[1] * i.right * i.right) - i.left * dot(&g[0]) - i.right * dot(&g[1])
        + lambda * i.left.hypot(i.right)
}
