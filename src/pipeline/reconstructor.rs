use std::sync::Arc;
use std::time::{Duration, Instant};

use super::{Model, Problem};
use crate::measurement::{Background, PatchPair};
use crate::scene::{Rgb, Scene};
use crate::solver::{Audit, Correlations, ProjectionError, Solution, Start, Workspace, audit};

/// The stages from a patch pair to a scene, with what they remember between frames.
pub struct Reconstructor {
    model: Arc<Model>,
    background: Background,
    difference: PatchPair,
    warm_start: bool,
    problem: Option<Prepared>,
}

/// The problem of the background in use, and the room that solving it takes.
struct Prepared {
    problem: Problem,
    correlations: Correlations,
    workspace: Workspace,
    solution: Solution,
    refit: Vec<f64>,
}

/// What one frame says about the room.
#[derive(Debug, Clone, PartialEq)]
pub struct Reconstruction {
    /// The solution of eq. 13.
    pub solution: Solution,
    /// Views and unified map.
    pub scene: Scene,
    /// Per facet, the factor of a least-squares refit on the support: brightness without the penalty's shrinkage
    /// ([`refit`](crate::solver::Solver::refit)).
    pub refit: Vec<f64>,
    /// Mean change of the visible side's light: left, right. With the published model, b of eq. 12.
    pub illumination: [Rgb; 2],
    /// The factor by which the floor's own picture of the empty room is multiplied, apart from what the facets explain:
    /// left, right. None with the published model, which knows no gain.
    pub gain: Option<[Rgb; 2]>,
    /// Time for the difference.
    pub background_time: Duration,
    /// Time for Aᵀy.
    pub project_time: Duration,
    /// Time to solve.
    pub solve_time: Duration,
}

impl Reconstructor {
    /// With nothing learned yet. With `warm_start`, each frame starts from the one before: faster, but then what is found
    /// can depend on it.
    pub fn new(model: Arc<Model>, warm_start: bool) -> Self {
        Self {
            background: Background::new(model.patch.size),
            difference: PatchPair::zeros(model.patch.size),
            problem: None,
            warm_start,
            model,
        }
    }

    /// The model in use.
    pub fn model(&self) -> &Arc<Model> {
        &self.model
    }

    /// Learns a frame of the empty room.
    pub fn learn(&mut self, pair: &PatchPair) {
        self.background.learn(pair);
        self.problem = None;
    }

    /// How good the last frame's solution is among those from `starts` random starts; none before the first one.
    pub fn audit(&self, starts: usize) -> Option<Audit> {
        let Prepared { problem, correlations, solution, .. } = self.problem.as_ref()?;
        Some(audit(&problem.solver, correlations, solution.lambda, self.model.limits, starts))
    }

    /// The last frame's difference measurement (eq. 4).
    pub fn difference(&self) -> &PatchPair {
        &self.difference
    }

    /// Reconstructs what changed against the empty room; none before that was learned. The first frame after learning
    /// takes longer: the problem is built for what was learned.
    pub fn reconstruct(&mut self, pair: &PatchPair) -> Result<Option<Reconstruction>, ProjectionError> {
        let start = Instant::now();
        if !self.background.difference(pair, &mut self.difference) {
            return Ok(None);
        }
        let background_time = start.elapsed();
        let (model, background, difference) = (&self.model, &self.background, &self.difference);
        let Prepared { problem, correlations, workspace, solution, refit } = self.problem.get_or_insert_with(|| {
            let problem = Problem::new(model, background, difference);
            Prepared {
                correlations: problem.projection.correlations(),
                workspace: problem.solver.workspace(),
                solution: Solution::default(),
                refit: Vec::new(),
                problem,
            }
        });
        let start = Instant::now();
        problem.projection.project(&self.difference, correlations)?;
        let project_time = start.elapsed();
        let start = Instant::now();
        let lambda_max = problem.solver.lambda_max(correlations);
        let lambda = problem.lambda(correlations, lambda_max);
        // What is known to end empty starts empty: nothing of the frame before can stay by mistake.
        let warm = self.warm_start && lambda_max > lambda;
        let from = if warm { Start::Previous } else { Start::Empty };
        problem.solver.solve_into(correlations, lambda, self.model.limits, from, workspace, solution);
        let solve_time = start.elapsed();
        let scene = Scene::new(&solution.intensities, problem.projection.radiance(), self.model.unified_threshold);
        let intensities = |s: usize, n: usize| {
            let i = &solution.intensities[n];
            i.colour.map(|v| [i.left, i.right][s] * v)
        };
        let illumination = problem.projection.illumination(correlations, intensities);
        problem.solver.refit(correlations, solution, refit);
        // As bright as measured: the penalty's shrinkage would leave a part of every facet's light to the gain.
        let gain = problem.projection.gain(correlations, |s, n| intensities(s, n).map(|x| refit[n] * x));
        let (solution, refit) = (solution.clone(), refit.clone());
        Ok(Some(Reconstruction {
            solution,
            scene,
            refit,
            illumination,
            gain,
            background_time,
            project_time,
            solve_time,
        }))
    }
}
