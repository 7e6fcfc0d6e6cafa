use nalgebra::DMatrix;
use pulp::Arch;

use super::active::{Active, Planes, Point, TakeOut, lit, pair, product, rank_one};
use super::dual::{SignedDualNorms, dual_norm_above};
use super::facet::Admissible;
use super::newton::Newton;
use super::projection::Correlations;
use super::solution::{Limits, Solution, Start};
use super::stationarity::violation;
use crate::scene::Intensity;

/// A facet wants a second light if its dual norm exceeds λ by this share; less may be rounding error.
const SECOND: f64 = 1e-6;

/// A fall of the objective by less than this share is no progress.
const STILL: f64 = 1e-12;

/// Progress is slow if the objective falls by less than this share. Newton's step then does better than a sweep, and
/// adding missing facets does better than either.
const SLOW: f64 = 1e-3;

/// Violation of a first-order condition, as a share of λ, that is small enough to look for missing facets.
const ROUGH: f64 = 0.1;

/// Before more facets enter, the residual of those with light is brought down to this share of the largest excess of a
/// dark one.
const AHEAD: f64 = 0.1;

/// If no facet is missing, the residual is reduced by this factor before missing facets are looked for again.
const CHECK: f64 = 0.01;

/// Most dark facets that enter at once.
const AT_ONCE: usize = 8;

/// A dark facet waits if its excess over λ is below this share of the largest excess among those that enter.
const FAINT: f64 = 0.3;

/// Descends on eq. 13. Newton's steps on all facets with light at once give convergence. Where they are not smooth,
/// exact minimisers facet by facet find out which facets have light and what is at its bound. Dark facets enter a few
/// at a time.
#[derive(Debug, Clone)]
pub struct Solver {
    gram: [DMatrix<f64>; 2],
    admissible: Vec<Admissible>,
    weights: Vec<f64>,
    /// Whether all facets are [`Admissible::Signed`].
    signed: bool,
}

/// Reusable workspace, so that a solve allocates nothing.
#[derive(Debug, Clone)]
pub struct Workspace {
    /// Aᵀr for all facets.
    correlations: Planes,
    /// Per facet, the dual norm of its correlations, or an upper bound on it that is at most λ w_n.
    dual: Vec<f64>,
    active: Active,
    point: Point,
    newton: Newton,
    /// Number of active facets that have just entered; they are the last ones.
    fresh: usize,
}

/// The result of a descent over the active facets.
struct Settled {
    /// The value of eq. 13.
    objective: f64,
    /// The largest violation of a first-order condition among the facets with light, as a share of λ.
    residual: f64,
}

impl Solver {
    /// A solver for the Gram matrices of the left and right side (N x N each) and each facet's admissible set.
    pub fn new(gram: [DMatrix<f64>; 2], admissible: Vec<Admissible>) -> Self {
        let weights = vec![1.0; admissible.len()];
        let signed = admissible.iter().all(|&kind| kind == Admissible::Signed);
        Self { gram, admissible, weights, signed }
    }

    /// Sets the penalty to λ Σ w_n ‖c_n‖ with positive weights; the default is 1.
    pub fn with_weights(self, weights: Vec<f64>) -> Self {
        Self { weights, ..self }
    }

    /// Number of facets, N.
    pub fn facets(&self) -> usize {
        self.admissible.len()
    }

    /// The admissible set of facet `n`.
    pub(super) fn admissible(&self, n: usize) -> Admissible {
        self.admissible[n]
    }

    /// ⟨A_n, A_m⟩ of one side.
    pub(super) fn gram(&self, side: usize, n: usize, m: usize) -> f64 {
        self.gram[side][(n, m)]
    }

    /// ⟨A_n, A_m⟩ of one side for all m.
    fn column(&self, side: usize, n: usize) -> &[f64] {
        &self.gram[side].as_slice()[n * self.facets()..][..self.facets()]
    }

    /// The mean energy of facet `n`'s two columns.
    pub(super) fn energy(&self, n: usize) -> f64 {
        self.gram.iter().map(|gram| gram[(n, n)]).sum::<f64>() / 2.0
    }

    /// The same problem with every facet present twice, so that two lights of different colour and balance may share a
    /// place.
    pub(super) fn doubled(&self) -> Self {
        let n = self.facets();
        let gram = |g: &DMatrix<f64>| DMatrix::from_fn(2 * n, 2 * n, |i, j| g[(i % n, j % n)]);
        Self {
            gram: [gram(&self.gram[0]), gram(&self.gram[1])],
            admissible: [self.admissible.as_slice(), &self.admissible].concat(),
            weights: [self.weights.as_slice(), &self.weights].concat(),
            signed: self.signed,
        }
    }

    /// A workspace for [`Solver::solve_into`].
    pub fn workspace(&self) -> Workspace {
        let n = self.admissible.len();
        Workspace {
            correlations: [0, 1].map(|_| [0, 1, 2].map(|_| vec![0.0; n])),
            dual: vec![0.0; n],
            active: Active::with_capacity(n),
            point: Point::with_capacity(n),
            newton: Newton::with_capacity(n),
            fresh: 0,
        }
    }

    /// λ_max, the smallest λ with an empty map.
    pub fn lambda_max(&self, frame: &Correlations) -> f64 {
        (0..self.admissible.len())
            .map(|n| self.admissible[n].dual_norm(&pair(&frame.rhs, n)) / self.weights[n])
            .fold(0.0, f64::max)
    }

    /// [`Solver::solve_into`] with a workspace of its own, from `start` if given, otherwise from the empty map.
    pub fn solve(&self, frame: &Correlations, lambda: f64, limits: Limits, start: Option<&Solution>) -> Solution {
        let mut solution = start.cloned().unwrap_or_default();
        let from = if start.is_some() { Start::Previous } else { Start::Empty };
        self.solve_into(frame, lambda, limits, from, &mut self.workspace(), &mut solution);
        solution
    }

    /// Descends to a stationary point of eq. 13 and puts it into `solution`.
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
        let mut settled = Settled { objective: frame.energy / 2.0, residual: 0.0 };
        if solution.warm {
            self.enter_none(work, solution);
            settled = self.settle(frame, lambda, limits, ROUGH, work, solution);
        }
        // A dark facet may exceed λ by so little that lighting it changes nothing. Then no facet enters until the
        // others settle.
        let (mut closed, mut stuck) = (false, false);
        loop {
            self.correlate(frame, lambda, work, solution);
            let excess =
                if closed { self.enter_none(work, solution) } else { self.enter(lambda, limits, work, solution) };
            let complete = work.fresh == 0;
            if solution.capped || (complete && (stuck || settled.residual <= limits.tolerance)) {
                break;
            }
            let target = if complete { CHECK * settled.residual } else { AHEAD * excess };
            let target = target.clamp(limits.tolerance, ROUGH);
            let before = settled.objective;
            settled = self.settle(frame, lambda, limits, target, work, solution);
            let idle = before - settled.objective <= STILL * settled.objective;
            closed = idle && (closed || !complete);
            stuck = idle && complete && settled.residual > target;
        }
        self.certify(frame, lambda, work, solution);
    }

    /// Computes the correlations of all facets at the solution, and their dual norms.
    fn correlate(&self, frame: &Correlations, lambda: f64, work: &mut Workspace, solution: &Solution) {
        for (correlations, rhs) in work.correlations.iter_mut().flatten().zip(frame.rhs.iter().flatten()) {
            correlations.clone_from(rhs);
        }
        let lights = solution.intensities.iter().enumerate();
        for (s, correlations) in work.correlations.iter_mut().enumerate() {
            let columns = lights.clone().map(|(n, light)| (self.column(s, n), light));
            Arch::new().dispatch(TakeOut { correlations, side: s, columns });
        }
        self.wishes(lambda, work);
    }

    /// Computes all facets' dual norms.
    fn wishes(&self, lambda: f64, work: &mut Workspace) {
        let Workspace { correlations, dual, .. } = work;
        if self.signed {
            Arch::new().dispatch(SignedDualNorms { correlations, out: dual });
            return;
        }
        for (n, dual) in dual.iter_mut().enumerate() {
            *dual = dual_norm_above(self.admissible[n], &pair(correlations, n), lambda * self.weights[n]);
        }
    }

    /// Activates the facets that have light and no others. Returns 0, the excess if no facet enters.
    fn enter_none(&self, work: &mut Workspace, solution: &Solution) -> f64 {
        work.fresh = 0;
        work.active.facets.clear();
        work.active.facets.extend((0..self.facets()).filter(|&n| lit(&solution.intensities[n])));
        0.0
    }

    /// Activates the facets that have light, and lights the dark ones that exceed λ most, one after the other, each
    /// with its minimiser: the strongest ones usually explain why the others wanted light. Returns the largest excess
    /// over λ of one that entered, as a share of λ.
    fn enter(&self, lambda: f64, limits: Limits, work: &mut Workspace, solution: &mut Solution) -> f64 {
        let mut most = self.enter_none(work, solution);
        while work.fresh < AT_ONCE {
            let wish = |n: usize| work.dual[n] / (lambda * self.weights[n]) - 1.0;
            let dark = (0..self.facets()).filter(|&n| !lit(&solution.intensities[n]));
            let Some((n, excess)) = dark.map(|n| (n, wish(n))).reduce(|a, b| if b.1 > a.1 { b } else { a }) else {
                break;
            };
            if excess <= limits.tolerance || excess < FAINT * most {
                break;
            }
            let energy = [0, 1].map(|s| self.gram(s, n, n));
            let light = self.admissible[n].minimise(&pair(&work.correlations, n), energy, lambda * self.weights[n]);
            if !lit(&light) {
                break;
            }
            solution.intensities[n] = light;
            work.active.facets.push(n);
            work.fresh += 1;
            most = f64::max(most, excess);
            for (s, correlations) in work.correlations.iter_mut().enumerate() {
                let columns = std::iter::once((self.column(s, n), &light));
                Arch::new().dispatch(TakeOut { correlations, side: s, columns });
            }
            self.wishes(lambda, work);
        }
        most
    }

    /// Descends over the active facets until none with light violates a condition by more than `target`, or until other
    /// facets are needed.
    fn settle(
        &self,
        frame: &Correlations,
        lambda: f64,
        limits: Limits,
        target: f64,
        work: &mut Workspace,
        solution: &mut Solution,
    ) -> Settled {
        let Workspace { active, point, newton, fresh, .. } = work;
        active.load(&self.gram, frame, |n| (self.admissible[n], lambda * self.weights[n]));
        point.light.clear();
        point.light.extend(active.facets.iter().map(|&n| solution.intensities[n]));
        active.correlate(point);
        let mut residual = f64::INFINITY;
        // Light from the previous frame is a guess; a sweep finds out which of it remains.
        let mut sweep = solution.sweeps == 0 && *fresh == 0;
        loop {
            if solution.sweeps >= limits.sweeps {
                solution.capped = true;
                break;
            }
            let mut fall = 0.0;
            if sweep {
                fall += active.sweep(point);
                solution.sweeps += 1;
                if fall > SLOW * active.objective(point) {
                    continue;
                }
            }
            let step = newton.step(active, point);
            solution.sweeps += 1;
            let objective = active.objective(point);
            // Newton's last steps change the objective by less than its rounding error, so only the lack of any step
            // ends this.
            let over = sweep && step.is_none() && fall <= STILL * objective;
            fall += step.map_or(0.0, |step| step.fall);
            residual = active.residual(point);
            let missing = *fresh > 0 && residual <= ROUGH && fall <= SLOW * objective;
            if residual <= target || missing || over {
                break;
            }
            sweep = step.is_none_or(|step| !step.smooth);
        }
        for (&n, &light) in active.facets.iter().zip(&point.light) {
            solution.intensities[n] = light;
        }
        Settled { objective: active.objective(point), residual }
    }

    /// Fills in the solution's objective, residual and bound.
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
            penalty += penalty_n * i.strength();
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

/// The dual objective s⟨y, r⟩ − ½ s²‖r‖² at the scaled residual s r. s is the best value, or if smaller, the largest
/// that keeps every facet's dual norm at most λ w_n. `largest` is max_n of dual norm / (λ w_n) at the residual itself.
fn dual_bound(y_r: f64, r2: f64, largest: f64) -> f64 {
    if r2 <= 0.0 {
        return 0.0;
    }
    let feasible = if largest > 0.0 { 1.0 / (largest * (1.0 + 1e-9)) } else { f64::INFINITY };
    let s = (y_r / r2).min(feasible).max(0.0);
    s * y_r - 0.5 * s * s * r2
}
