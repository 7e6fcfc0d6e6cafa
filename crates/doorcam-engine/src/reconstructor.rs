use std::sync::Arc;
use std::time::{Duration, Instant};

use crate::{Model, Problem};
use doorcam_core::geometry::Point;
use doorcam_core::light::{Background, PatchPair, Sensing};
use doorcam_core::scene::{BlobWorkspace, Rgb, Scene};
use doorcam_core::solver::{Audit, Correlations, Limits, ProjectionError, Solution, Start, Workspace, audit};
use doorcam_core::tracking::{Detection, Prediction};

/// Where people might be need not be known exactly: it is refined.
const FAINT_SWEEPS: usize = 30;
const FAINT_TOLERANCE: f64 = 1e-2;

/// The stages from a patch pair to a scene, with what they remember between frames.
pub struct Reconstructor {
    model: Arc<Model>,
    background: Background,
    difference: PatchPair,
    warm_start: bool,
    problem: Option<Prepared>,
}

/// The problem of the background in use, and the room that solving it takes.
pub(super) struct Prepared {
    problem: Problem,
    /// The picture that it is built for: differences from another one would not be free of gains.
    reference: PatchPair,
    correlations: Correlations,
    workspace: Workspace,
    solution: Solution,
    refit: Vec<f64>,
    /// The map at the smallest λ that noise allows, where the other is empty.
    faint: Solution,
    /// The last frame's λ_max, and the smallest λ.
    lambdas: [f64; 2],
    blobs: BlobWorkspace,
    seeds: Vec<Point>,
    /// For looks at other pictures than the frame's.
    aside: (PatchPair, Correlations),
    /// How long all that took to set up.
    pub took: Duration,
}

/// What one frame says about the room.
#[derive(Debug, Clone, PartialEq)]
pub struct Reconstruction {
    /// The solution of eq. 13.
    pub solution: Solution,
    /// Views and unified map.
    pub scene: Scene,
    /// Per facet, the factor of a least-squares refit on the support: brightness without the penalty's shrinkage
    /// ([`refit`](doorcam_core::solver::Solver::refit)).
    pub refit: Vec<f64>,
    /// Mean change of the visible side's light: left, right. With the published model, b of eq. 12.
    pub illumination: [Rgb; 2],
    /// The factor by which the floor's own picture of the empty room is multiplied, apart from what the facets explain:
    /// left, right. None with the published model, which knows no gain.
    pub gain: Option<[Rgb; 2]>,
    /// Mean square of the weighed difference once gains, lamps and drift are out; with the signed model in units of the noise,
    /// so that it is about 1 in the empty room.
    pub energy: f64,
    /// The same of what the map leaves.
    pub residual: f64,
    /// Time for the difference.
    pub background_time: Duration,
    /// Time for Aᵀy.
    pub project_time: Duration,
    /// Time to solve.
    pub solve_time: Duration,
}

impl Reconstruction {
    /// Whether no facet changed.
    pub fn is_empty(&self) -> bool {
        self.solution.penalty == 0.0
    }
}

impl Prepared {
    /// For a background; where its frames do not tell the noise, a `difference` from it does.
    pub fn new(model: &Model, background: &Background, difference: &PatchPair) -> Self {
        let start = Instant::now();
        let problem = Problem::new(model, background, difference);
        Self {
            reference: background.mean().clone(),
            correlations: problem.projection.correlations(),
            workspace: problem.solver.workspace(),
            solution: Solution::default(),
            refit: Vec::new(),
            faint: Solution::default(),
            lambdas: [0.0; 2],
            blobs: BlobWorkspace::default(),
            seeds: Vec::new(),
            aside: (difference.clone(), problem.projection.correlations()),
            problem,
            took: start.elapsed(),
        }
    }
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

    /// What was learned by [`Reconstructor::learn`].
    pub(super) fn background(&self) -> &Background {
        &self.background
    }

    /// Gives away what was learned, which is large and which the problem made of it can do without.
    pub(super) fn take_background(&mut self) -> Background {
        std::mem::replace(&mut self.background, Background::new(self.model.patch.size))
    }

    /// Takes a problem that was prepared elsewhere.
    pub(super) fn install(&mut self, prepared: Prepared) {
        self.problem = Some(prepared);
        self.take_background();
    }

    /// The picture that frames are compared with; none before there is one.
    pub(super) fn reference(&self) -> Option<&PatchPair> {
        self.problem.as_ref().map(|prepared| &prepared.reference)
    }

    /// By how much a picture differs from another in a way that would show, as a share of what noise may do: above 1, it
    /// would be detected. None before there is a background.
    pub(super) fn departure(&mut self, picture: &PatchPair, from: Option<&PatchPair>) -> Option<f64> {
        let Prepared { problem, reference, aside: (difference, correlations), .. } = self.problem.as_mut()?;
        picture.subtract(from.unwrap_or(reference), difference);
        problem.projection.project(difference, correlations).ok()?;
        let least = problem.lambda(correlations, 0.0);
        Some(problem.solver.lambda_max(correlations) / least)
    }

    /// How good the last frame's solution is among those from `starts` random starts; none before the first one.
    pub fn audit(&self, starts: usize) -> Option<Audit> {
        let Prepared { problem, correlations, solution, .. } = self.problem.as_ref()?;
        Some(audit(&problem.solver, correlations, solution.lambda, self.model.limits, starts))
    }

    /// Whom the last frame shows, `elapsed_s` after the one before, given where people are expected.
    pub fn find(&mut self, expected: impl Iterator<Item = Prediction>, elapsed_s: f64) -> &[Detection] {
        let Some(prepared) = &mut self.problem else { return &[] };
        let Prepared { problem, correlations, workspace, solution, faint, lambdas, blobs, seeds, .. } = prepared;
        let Some(finder) = &mut problem.finder else { return &[] };
        seeds.clear();
        // What a changed lamp and the floor's texture might do is kept from the map; people can be told from it.
        let [lambda_max, least] = *lambdas;
        let map = if solution.penalty == 0.0 && lambda_max > least {
            let limits = Limits { sweeps: FAINT_SWEEPS, tolerance: FAINT_TOLERANCE };
            problem.solver.solve_into(correlations, least, limits, Start::Empty, workspace, faint);
            &*faint
        } else {
            &*solution
        };
        let blobs = self.model.neighbourhood.blobs(&map.intensities, blobs);
        seeds.extend(blobs.iter().map(|blob| blob.position));
        finder.find(&self.difference, expected, seeds, elapsed_s)
    }

    /// What the pixels can tell; none before there is a background, and with the published model.
    pub(super) fn sensing(&self) -> Option<&Arc<Sensing>> {
        self.problem.as_ref()?.problem.sensing.as_ref()
    }

    /// The last frame's difference measurement (eq. 4).
    pub fn difference(&self) -> &PatchPair {
        &self.difference
    }

    /// Reconstructs what changed against the empty room; none before that was learned. The first frame after learning
    /// takes longer: the problem is built for what was learned.
    pub fn reconstruct(&mut self, pair: &PatchPair) -> Result<Option<Reconstruction>, ProjectionError> {
        self.reconstruct_in_noise(pair, 1.0)
    }

    /// The same for a frame with `excess` times the noise of the others.
    pub fn reconstruct_in_noise(
        &mut self,
        pair: &PatchPair,
        excess: f64,
    ) -> Result<Option<Reconstruction>, ProjectionError> {
        let start = Instant::now();
        let reference = match &self.problem {
            Some(prepared) => &prepared.reference,
            None if self.background.frames() > 0 => self.background.mean(),
            None => return Ok(None),
        };
        pair.subtract(reference, &mut self.difference);
        let background_time = start.elapsed();
        let (model, background, difference) = (&self.model, &self.background, &self.difference);
        let Prepared { problem, correlations, workspace, solution, refit, lambdas, .. } =
            self.problem.get_or_insert_with(|| Prepared::new(model, background, difference));
        let start = Instant::now();
        problem.projection.project(&self.difference, correlations)?;
        let project_time = start.elapsed();
        let start = Instant::now();
        let lambda_max = problem.solver.lambda_max(correlations);
        let lambda = problem.lambda_in_noise(correlations, lambda_max, excess);
        *lambdas = [lambda_max, problem.least_lambda(lambda_max, excess)];
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
        let per_value = (problem.values.max(1) as f64).recip();
        let (energy, residual) = (per_value * correlations.energy, per_value * 2.0 * solution.data);
        let (solution, refit) = (solution.clone(), refit.clone());
        Ok(Some(Reconstruction {
            solution,
            scene,
            refit,
            illumination,
            gain,
            energy,
            residual,
            background_time,
            project_time,
            solve_time,
        }))
    }
}
