use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal, Uniform};

use super::active::rank_one;
use super::dual::dual_direction;
use super::facet::Pair;
use super::projection::Correlations;
use super::solution::{Limits, Solution, Start};
use super::{Admissible, Solver};
use crate::scene::Intensity;

/// How a solution compares with others that can be found. Slow; for tests and offline use.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Audit {
    /// Random starts tried.
    pub starts: usize,
    /// The lowest objective found from these starts, the empty map and the relaxation.
    pub best: f64,
    /// The share of the random starts that led to within 0.1 % of the lowest.
    pub agreeing: f64,
    /// The lowest objective found if each facet may have two lights of different colour and balance. This is the
    /// problem without the constraint on X_n's rank: λ Σ Ω(X_n) replaces λ Σ ‖c_n‖, with Ω the least Σ ‖c‖ of
    /// admissible lights that add up to X_n. It is the tightest convex relaxation of eq. 13, and [`Solution::bound`] is
    /// its dual.
    pub two_lights: f64,
    /// The objective reached from the relaxation, with each facet's two lights replaced by the nearest single one.
    pub from_two_lights: f64,
    /// The largest lower bound found on all of these.
    pub bound: f64,
}

/// Solves a frame again: from the empty map, from `starts` reproducible random starts, with every facet doubled, and
/// from that solution.
pub fn audit(solver: &Solver, frame: &Correlations, lambda: f64, limits: Limits, starts: usize) -> Audit {
    let mut random = ChaCha8Rng::seed_from_u64(starts as u64);
    let typical = solver.lambda_max(frame);
    let solve = |solver: &Solver, frame: &Correlations, start: Option<Vec<Intensity>>| {
        let from = if start.is_some() { Start::Previous } else { Start::Empty };
        let mut solution = Solution { intensities: start.unwrap_or_default(), ..Solution::default() };
        solver.solve_into(frame, lambda, limits, from, &mut solver.workspace(), &mut solution);
        solution
    };
    let cold = solve(solver, frame, None);
    let mut bound = cold.bound;
    let objectives: Vec<f64> = (0..starts)
        .map(|_| {
            let start = (0..solver.facets()).map(|n| random_light(solver, n, typical, &mut random)).collect();
            let solution = solve(solver, frame, Some(start));
            bound = bound.max(solution.bound);
            solution.objective()
        })
        .collect();
    let relaxed = solve(&solver.doubled(), &doubled(frame), None);
    let (first, second) = relaxed.intensities.split_at(solver.facets());
    let merged = (0..solver.facets()).map(|n| nearest(solver.admissible(n), &first[n], &second[n])).collect();
    let rounded = solve(solver, frame, Some(merged));
    bound = bound.max(rounded.bound);
    let best = objectives.iter().copied().fold(cold.objective().min(rounded.objective()), f64::min);
    let agreeing = objectives.iter().filter(|&&o| o <= best * 1.001).count() as f64 / starts.max(1) as f64;
    Audit {
        starts,
        best,
        agreeing,
        two_lights: relaxed.objective().min(best),
        from_two_lights: rounded.objective(),
        bound,
    }
}

/// The admissible light nearest to the sum X of two: ⟨c vᵀ, X⟩ c vᵀ with the unit c and v that maximise ⟨c vᵀ, X⟩.
fn nearest(kind: Admissible, a: &Intensity, b: &Intensity) -> Intensity {
    let (x, y) = (rank_one(a), rank_one(b));
    let sum: Pair = [0, 1].map(|s| [0, 1, 2].map(|p| x[s][p] + y[s][p]));
    let (strength, (sin, cos)) = dual_direction(kind, &sum);
    if strength <= 0.0 {
        return Intensity::default();
    }
    let colour = kind.colour(&sum, (sin, cos)).map(|g| g / strength);
    Intensity { left: strength * cos, right: strength * sin, colour }
}

/// Lights one facet in five, with random balance and colour, about as strong as the strongest facet would be alone.
fn random_light(solver: &Solver, n: usize, typical: f64, random: &mut ChaCha8Rng) -> Intensity {
    let mut normal = || -> f64 { StandardNormal.sample(random) };
    let (strength, left, right) = (normal(), normal(), normal());
    let colour = [normal(), normal(), normal()];
    let lit = Uniform::new(0.0, 1.0).is_ok_and(|unit| unit.sample(random) < 0.2_f64);
    let energy = solver.energy(n);
    if !lit || energy <= 0.0 {
        return Intensity::default();
    }
    let (left, right) = match solver.admissible(n) {
        Admissible::EitherSign => (left, right),
        Admissible::Brighter | Admissible::Signed => (left.abs(), right.abs()),
    };
    let colour = match solver.admissible(n) {
        Admissible::Signed => colour,
        Admissible::Brighter | Admissible::EitherSign => colour.map(f64::abs),
    };
    let norm = colour.iter().map(|v| v * v).sum::<f64>().sqrt().max(f64::MIN_POSITIVE);
    let scale = 0.3 * strength.abs() * typical / energy;
    Intensity { left: scale * left, right: scale * right, colour: colour.map(|v| v / norm) }
}

/// The correlations of the problem in which every facet is present twice.
fn doubled(frame: &Correlations) -> Correlations {
    let rhs = [0, 1].map(|s| [0, 1, 2].map(|p| [frame.rhs[s][p].as_slice(), &frame.rhs[s][p]].concat()));
    Correlations::new(rhs, frame.energy)
}
