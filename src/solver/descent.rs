use nalgebra::DMatrix;

use super::active::{Active, Planes, Point, lit, pair, product, rank_one, take_out};
use super::dual::dual_norm_above;
use super::facet::Admissible;
use super::newton::Newton;
use super::projection::Correlations;
use super::solution::{Limits, Solution, Start};
use super::stationarity::violation;
use crate::scene::Intensity;

/// A facet wants a second light if its dual norm exceeds λ by this share: by less, it may be rounding.
const SECOND: f64 = 1e-6;

/// A fall of the objective by less than this share of it is no progress.
const STILL: f64 = 1e-12;

/// A rough settlement ends when a sweep and a Newton step lower the objective by less than this share of it.
const ROUGH: f64 = 1e-3;

/// Dark facets that enter at once at most.
const AT_ONCE: usize = 3;

/// How far to descend before facets may enter again.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Effort {
    /// Until progress slows: facets are still missing.
    Rough,
    /// To the tolerance.
    Full,
}

/// Descends on eq. 13: exact minimisers facet by facet find out which facets have light and what is at its bound, Newton's
/// steps on all of these at once converge. Dark facets enter a few at a time.
#[derive(Debug, Clone)]
pub struct Solver {
    gram: [DMatrix<f64>; 2],
    admissible: Vec<Admissible>,
    weights: Vec<f64>,
}

/// Room for a solve, to be used again: with it, a solve allocates nothing.
#[derive(Debug, Clone)]
pub struct Workspace {
    /// Aᵀr for all facets.
    correlations: Planes,
    /// Per facet, the dual norm of its correlations, or an upper bound of it where that is at most λ w_n.
    dual: Vec<f64>,
    wanting: Vec<(f64, usize)>,
    active: Active,
    point: Point,
    newton: Newton,
}

impl Solver {
    /// For the Gram matrices of the left and right side and each facet's admissible set.
    pub fn new(gram: &[DMatrix<f64>; 2], admissible: Vec<Admissible>) -> Self {
        let weights = vec![1.0; admissible.len()];
        Self { gram: gram.clone(), admissible, weights }
    }

    /// With the penalty λ Σ w_n ‖c_n‖; the weights are positive, 1 without this.
    pub fn with_weights(self, weights: Vec<f64>) -> Self {
        Self { weights, ..self }
    }

    /// Number of facets, N.
    pub fn facets(&self) -> usize {
        self.admissible.len()
    }

    /// What facet `n` may be.
    pub(super) fn admissible(&self, n: usize) -> Admissible {
        self.admissible[n]
    }

    /// ⟨A_n, A_m⟩ of one side.
    pub(super) fn gram(&self, side: usize, n: usize, m: usize) -> f64 {
        self.gram[side][(n, m)]
    }

    /// The mean energy of facet `n`'s two columns.
    pub(super) fn energy(&self, n: usize) -> f64 {
        self.gram.iter().map(|gram| gram[(n, n)]).sum::<f64>() / 2.0
    }

    /// The same problem with every facet there twice: two lights of different colour and balance may share a place.
    pub(super) fn doubled(&self) -> Self {
        let n = self.facets();
        let gram = |g: &DMatrix<f64>| DMatrix::from_fn(2 * n, 2 * n, |i, j| g[(i % n, j % n)]);
        Self {
            gram: [gram(&self.gram[0]), gram(&self.gram[1])],
            admissible: [self.admissible.as_slice(), &self.admissible].concat(),
            weights: [self.weights.as_slice(), &self.weights].concat(),
        }
    }

    /// Room for [`Solver::solve_into`].
    pub fn workspace(&self) -> Workspace {
        let n = self.admissible.len();
        Workspace {
            correlations: [0, 1].map(|_| [0, 1, 2].map(|_| vec![0.0; n])),
            dual: vec![0.0; n],
            wanting: Vec::with_capacity(n),
            active: Active::with_capacity(n),
            point: Point::with_capacity(n),
            newton: Newton::with_capacity(n),
        }
    }

    /// The smallest λ with an empty map.
    pub fn lambda_max(&self, frame: &Correlations) -> f64 {
        (0..self.admissible.len())
            .map(|n| self.admissible[n].dual_norm(&pair(&frame.rhs, n)) / self.weights[n])
            .fold(0.0, f64::max)
    }

    /// [`Solver::solve_into`] with room of its own, from `start` or from the empty map without one.
    pub fn solve(&self, frame: &Correlations, lambda: f64, limits: Limits, start: Option<&Solution>) -> Solution {
        let mut solution = start.cloned().unwrap_or_default();
        let from = if start.is_some() { Start::Previous } else { Start::Empty };
        self.solve_into(frame, lambda, limits, from, &mut self.workspace(), &mut solution);
        solution
    }

    /// Descends to a stationary point and puts it into `solution`.
    pub fn solve_into(
        &self,
        frame: &Correlations,
        lambda: f64,
        limits: Limits,
        start: Start,
        work: &mut Workspace,
        solution: &mut Solution,
    ) {
        let n = self.admissible.len();
        solution.warm = start == Start::Previous && solution.intensities.len() == n;
        if !solution.warm {
            solution.intensities.clear();
            solution.intensities.resize(n, Intensity::default());
        }
        solution.lambda = lambda;
        solution.sweeps = 0;
        solution.capped = false;
        work.newton.reset();
        if solution.warm {
            work.active.facets.clear();
            work.active.facets.extend((0..n).filter(|&k| lit(&solution.intensities[k])));
            self.settle(frame, lambda, limits, Effort::Rough, work, solution);
        }
        let (mut settled, mut moved) = (false, true);
        loop {
            self.correlate(frame, lambda, work, solution);
            // A facet may want light by so little that taking it in changes nothing.
            let entered = self.enter(lambda, limits, work, solution) && moved;
            if solution.capped || (settled && !entered) {
                break;
            }
            settled = !entered;
            let effort = if entered { Effort::Rough } else { Effort::Full };
            let fall = self.settle(frame, lambda, limits, effort, work, solution);
            moved = fall > STILL * work.active.objective(&work.point);
        }
        self.certify(frame, lambda, work, solution);
    }

    /// Computes all facets' correlations at the solution and their dual norms.
    fn correlate(&self, frame: &Correlations, lambda: f64, work: &mut Workspace, solution: &Solution) {
        for (correlations, rhs) in work.correlations.iter_mut().flatten().zip(frame.rhs.iter().flatten()) {
            correlations.clone_from(rhs);
        }
        let lights = solution.intensities.iter().enumerate().filter(|(_, i)| lit(i));
        for (n, light) in lights {
            let x = rank_one(light);
            for ((correlations, gram), x) in work.correlations.iter_mut().zip(&self.gram).zip(x) {
                take_out(correlations, gram.column(n).as_slice(), x);
            }
        }
        for (n, dual) in work.dual.iter_mut().enumerate() {
            *dual = dual_norm_above(self.admissible[n], &pair(&work.correlations, n), lambda * self.weights[n]);
        }
    }

    /// Puts the facets that have light into play, and the dark ones that want it most; false if no dark one does.
    fn enter(&self, lambda: f64, limits: Limits, work: &mut Workspace, solution: &Solution) -> bool {
        // A few at a time: the strongest ones usually explain what made the others want light.
        let at_once = AT_ONCE;
        let Workspace { dual, wanting, active, .. } = work;
        wanting.clear();
        wanting.extend(
            (dual.iter().zip(&self.weights).enumerate())
                .filter(|&(n, _)| !lit(&solution.intensities[n]))
                .map(|(n, (dual, weight))| (dual / weight, n))
                .filter(|&(strength, _)| strength > lambda * (1.0 + limits.tolerance)),
        );
        wanting.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        active.facets.clear();
        active.facets.extend((0..solution.intensities.len()).filter(|&n| lit(&solution.intensities[n])));
        active.facets.extend(wanting.iter().take(at_once).map(|&(_, n)| n));
        !wanting.is_empty()
    }

    /// Descends over the facets in play; returns by how much the objective fell.
    fn settle(
        &self,
        frame: &Correlations,
        lambda: f64,
        limits: Limits,
        effort: Effort,
        work: &mut Workspace,
        solution: &mut Solution,
    ) -> f64 {
        let Workspace { active, point, newton, .. } = work;
        active.load(&self.gram, frame, |n| (self.admissible[n], lambda * self.weights[n]));
        point.light.clear();
        point.light.extend(active.facets.iter().map(|&n| solution.intensities[n]));
        active.correlate(point);
        let mut total = 0.0;
        loop {
            if solution.sweeps >= limits.sweeps {
                solution.capped = true;
                break;
            }
            let fall = active.sweep(point);
            let newton_fall = newton.step(active, point);
            solution.sweeps += 2;
            let progress = fall + newton_fall.unwrap_or(0.0);
            total += progress;
            let objective = active.objective(point);
            if effort == Effort::Rough && progress <= ROUGH * objective {
                break;
            }
            if active.residual(point) <= limits.tolerance && fall <= STILL * objective {
                break;
            }
            // Newton's last steps change the objective by less than its rounding: no step at all is the end.
            if newton_fall.is_none() && fall <= STILL * objective {
                break;
            }
        }
        for (&n, &light) in active.facets.iter().zip(&point.light) {
            solution.intensities[n] = light;
        }
        total
    }

    /// Fills in what is known about the solution.
    fn certify(&self, frame: &Correlations, lambda: f64, work: &Workspace, solution: &mut Solution) {
        let (mut explained, mut left_over, mut penalty, mut residual) = (0.0, 0.0, 0.0, 0.0_f64);
        // max over facets of dual norm / (λ w_n).
        let mut largest = 0.0_f64;
        solution.wants_second.clear();
        for (n, i) in solution.intensities.iter().enumerate() {
            let penalty_n = lambda * self.weights[n];
            let excess = work.dual[n] / penalty_n;
            largest = largest.max(excess);
            if !lit(i) {
                residual = residual.max(excess - 1.0);
                solution.wants_second.push(false);
                continue;
            }
            let z = pair(&work.correlations, n);
            residual = residual.max(violation(self.admissible[n], i, &z, penalty_n));
            solution.wants_second.push(excess > 1.0 + SECOND);
            penalty += penalty_n * i.left.hypot(i.right);
            explained += product(&rank_one(i), &pair(&frame.rhs, n));
            left_over += product(&rank_one(i), &z);
        }
        // With z = Aᵀr and w = Aᵀy: ‖r‖² = ‖y‖² − ⟨x, w + z⟩ and ⟨y, r⟩ = ‖y‖² − ⟨x, w⟩.
        let r2 = (frame.energy - explained - left_over).max(0.0);
        let y_r = frame.energy - explained;
        solution.data = 0.5 * r2;
        solution.penalty = penalty;
        solution.residual = residual;
        solution.bound = dual_bound(y_r, r2, largest);
    }
}

/// The dual objective s⟨y, r⟩ − ½ s²‖r‖² at the residual scaled by the largest s that keeps every facet's dual norm at most
/// λ w_n (and at most the best s); `largest` is max_n of dual norm / (λ w_n) at the residual itself.
fn dual_bound(y_r: f64, r2: f64, largest: f64) -> f64 {
    if r2 <= 0.0 {
        return 0.0;
    }
    let feasible = if largest > 0.0 { 1.0 / (largest * (1.0 + 1e-9)) } else { f64::INFINITY };
    let s = (y_r / r2).min(feasible).max(0.0);
    s * y_r - 0.5 * s * s * r2
}
