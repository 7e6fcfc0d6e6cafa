//! The active facets. Their part of the Gram system is copied into contiguous storage, so a step costs O(active)
//! instead of O(N).

use nalgebra::DMatrix;
use pulp::{Arch, Simd, WithSimd};

use super::facet::{Admissible, Pair};
use super::projection::Correlations;
use super::stationarity::violation;
use crate::scene::Intensity;

/// Values per side and channel, one per facet.
pub(super) type Planes = [[Vec<f64>; 3]; 2];

/// The values of one facet.
pub(super) fn pair(planes: &Planes, n: usize) -> Pair {
    [0, 1].map(|s| [0, 1, 2].map(|p| planes[s][p][n]))
}

/// Whether the facet has light.
pub(super) fn lit(i: &Intensity) -> bool {
    i.left != 0.0 || i.right != 0.0
}

/// X_n = c_n v_nᵀ.
pub(super) fn rank_one(i: &Intensity) -> Pair {
    [i.left, i.right].map(|c| i.colour.map(|v| c * v))
}

/// ⟨a, b⟩.
pub(super) fn product(a: &Pair, b: &Pair) -> f64 {
    a.iter().flatten().zip(b.iter().flatten()).map(|(a, b)| a * b).sum()
}

/// Subtracts what one facet's light explains from a side's correlations; `gram` is the facet's column.
#[inline(always)]
pub(super) fn take_out(correlations: &mut [Vec<f64>; 3], gram: &[f64], colour: [f64; 3]) {
    for (correlations, colour) in correlations.iter_mut().zip(colour) {
        correlations.iter_mut().zip(gram).for_each(|(value, g)| *value -= colour * g);
    }
}

/// Subtracts what lights explain from a side's correlations, with the widest available vector registers.
pub(super) struct TakeOut<'a, I> {
    pub correlations: &'a mut [Vec<f64>; 3],
    pub side: usize,
    /// Each facet's column of the side's Gram matrix, and its light.
    pub columns: I,
}

impl<'a, I: Iterator<Item = (&'a [f64], &'a Intensity)>> WithSimd for TakeOut<'_, I> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        for (column, light) in self.columns.filter(|(_, light)| lit(light)) {
            take_out(self.correlations, column, rank_one(light)[self.side]);
        }
    }
}

/// A fall of the objective below this share of its terms is rounding error.
const ROUNDING: f64 = 1e-15;

/// The problem restricted to the active facets.
#[derive(Debug, Clone, Default)]
pub(super) struct Active {
    /// Indices of the active facets.
    pub facets: Vec<usize>,
    pub kinds: Vec<Admissible>,
    /// λ w_n.
    pub lambdas: Vec<f64>,
    /// AᵀA of each side, row by row.
    gram: [Vec<f64>; 2],
    /// Aᵀy.
    rhs: Planes,
    /// ‖y‖².
    energy: f64,
}

/// The light of the active facets, with the correlations that go with it.
#[derive(Debug, Clone, Default)]
pub(super) struct Point {
    pub light: Vec<Intensity>,
    /// Aᵀr, with r the residual.
    pub correlations: Planes,
}

impl Active {
    /// A workspace for `n` facets.
    pub fn with_capacity(n: usize) -> Self {
        Self {
            facets: Vec::with_capacity(n),
            kinds: Vec::with_capacity(n),
            lambdas: Vec::with_capacity(n),
            gram: [Vec::with_capacity(n * n), Vec::with_capacity(n * n)],
            rhs: planes(n),
            energy: 0.0,
        }
    }

    /// Copies the part of the problem for `self.facets`; `penalty` returns a facet's kind and λ w_n.
    pub fn load(
        &mut self,
        gram: &[DMatrix<f64>; 2],
        frame: &Correlations,
        penalty: impl Fn(usize) -> (Admissible, f64),
    ) {
        self.energy = frame.energy;
        self.kinds.clear();
        self.lambdas.clear();
        for &n in &self.facets {
            let (kind, lambda) = penalty(n);
            self.kinds.push(kind);
            self.lambdas.push(lambda);
        }
        for (s, whole) in gram.iter().enumerate() {
            self.gram[s].clear();
            for &n in &self.facets {
                let column = whole.column(n);
                self.gram[s].extend(self.facets.iter().map(|&m| column[m]));
            }
            for p in 0..3 {
                self.rhs[s][p].clear();
                self.rhs[s][p].extend(self.facets.iter().map(|&n| frame.rhs[s][p][n]));
            }
        }
    }

    /// Number of active facets.
    pub fn len(&self) -> usize {
        self.facets.len()
    }

    /// ‖y‖².
    pub fn energy(&self) -> f64 {
        self.energy
    }

    /// The row of active facet `i` in a side's Gram matrix.
    pub fn row(&self, side: usize, i: usize) -> &[f64] {
        &self.gram[side][i * self.len()..][..self.len()]
    }

    /// Computes the correlations of a point from its light.
    pub fn correlate(&self, point: &mut Point) {
        for s in 0..2 {
            for p in 0..3 {
                point.correlations[s][p].clone_from(&self.rhs[s][p]);
            }
        }
        let lights = point.light.iter().enumerate();
        for (s, correlations) in point.correlations.iter_mut().enumerate() {
            let columns = lights.clone().map(|(i, light)| (self.row(s, i), light));
            Arch::new().dispatch(TakeOut { correlations, side: s, columns });
        }
    }

    /// Subtracts what a change of one facet's light explains from the correlations.
    fn spread(&self, point: &mut Point, i: usize, change: Pair) {
        for (s, (correlations, change)) in point.correlations.iter_mut().zip(change).enumerate() {
            take_out(correlations, self.row(s, i), change);
        }
    }

    /// (data term, penalty) at the point. With z = Aᵀr and w = Aᵀy: ‖y − Ax‖² = ‖y‖² − ⟨x, w + z⟩.
    pub fn terms(&self, point: &Point) -> (f64, f64) {
        let (mut explained, mut penalty) = (0.0, 0.0);
        for (i, light) in point.light.iter().enumerate().filter(|(_, light)| lit(light)) {
            penalty += self.lambdas[i] * light.strength();
            let (w, z) = (pair(&self.rhs, i), pair(&point.correlations, i));
            explained += product(&rank_one(light), &w) + product(&rank_one(light), &z);
        }
        (0.5 * (self.energy - explained), penalty)
    }

    /// The value of eq. 13.
    pub fn objective(&self, point: &Point) -> f64 {
        let (data, penalty) = self.terms(point);
        data + penalty
    }

    /// How much lower the objective is at `to` than at `from`, without the cancellation of subtracting two objectives:
    /// ½‖r‖² − ½‖r'‖² = ⟨x' − x, (z + z')/2⟩.
    pub fn fall(&self, from: &Point, to: &Point) -> f64 {
        let mut fall = 0.0;
        for (i, (a, b)) in from.light.iter().zip(&to.light).enumerate().filter(|(_, (a, b))| a != b) {
            fall += self.lambdas[i] * (a.strength() - b.strength());
            for z in [pair(&from.correlations, i), pair(&to.correlations, i)] {
                fall += 0.5 * (product(&rank_one(b), &z) - product(&rank_one(a), &z));
            }
        }
        fall
    }

    /// The largest violation of a first-order condition among the facets with light, as a share of λ w_n.
    pub fn residual(&self, point: &Point) -> f64 {
        (0..self.len())
            .filter(|&i| lit(&point.light[i]))
            .map(|i| violation(self.kinds[i], &point.light[i], &pair(&point.correlations, i), self.lambdas[i]))
            .fold(0.0, f64::max)
    }

    /// Moves each facet in turn to its exact minimiser; returns by how much the objective fell.
    pub fn sweep(&self, point: &mut Point) -> f64 {
        (0..self.len()).map(|i| self.step(point, i)).sum()
    }

    /// Moves one facet to its exact minimiser; returns by how much the objective fell.
    pub fn step(&self, point: &mut Point, i: usize) -> f64 {
        let energy = [self.row(0, i)[i], self.row(1, i)[i]];
        let (old, lambda) = (point.light[i], self.lambdas[i]);
        let own = rank_one(&old);
        let mut g = pair(&point.correlations, i);
        for s in 0..2 {
            for p in 0..3 {
                g[s][p] += energy[s] * own[s][p];
            }
        }
        let new = self.kinds[i].minimise(&g, energy, lambda);
        let cost = local_cost(&new, &g, energy, lambda);
        let fall = local_cost(&old, &g, energy, lambda) - cost;
        if fall <= ROUNDING * (lambda * new.strength() - cost) {
            return 0.0;
        }
        let x = rank_one(&new);
        self.spread(point, i, [0, 1].map(|s| [0, 1, 2].map(|p| x[s][p] - own[s][p])));
        point.light[i] = new;
        fall
    }
}

impl Point {
    /// A workspace for `n` facets.
    pub fn with_capacity(n: usize) -> Self {
        Self { light: Vec::with_capacity(n), correlations: planes(n) }
    }
}

fn planes(n: usize) -> Planes {
    [0, 1].map(|_| [0, 1, 2].map(|_| Vec::with_capacity(n)))
}

/// The part of the objective that depends on one facet.
fn local_cost(i: &Intensity, g: &Pair, energy: [f64; 2], lambda: f64) -> f64 {
    let dot = |g: &[f64; 3]| (0..3).map(|p| g[p] * i.colour[p]).sum::<f64>();
    0.5 * (energy[0] * i.left * i.left + energy[1] * i.right * i.right) - i.left * dot(&g[0]) - i.right * dot(&g[1])
        + lambda * i.strength()
}
