use std::sync::Arc;
use std::time::{Duration, Instant};

use crate::{Model, Problem};
use doorcam_core::geometry::{Point, Side};
use doorcam_core::light::{Background, PatchPair, Sensing, Usable};
use doorcam_core::scene::{BlobWorkspace, Rgb, Scene};
use doorcam_core::solver::{Audit, Correlations, Limits, ProjectionError, Solution, Start, Workspace, audit};
use doorcam_core::still_room::StillRoom;
use doorcam_core::tracking::{Detection, Prediction};

/// Blobs only seed the search for people and are refined later, so a rough solution is enough.
const FAINT_SWEEPS: usize = 30;
const FAINT_TOLERANCE: f64 = 1e-2;

/// The stages from a patch pair to a scene, with their state between frames.
pub struct Reconstructor {
    model: Arc<Model>,
    background: Background,
    difference: PatchPair,
    warm_start: bool,
    problem: Option<Prepared>,
    /// Which pixels of the frame show the floor.
    usable: Usable,
    /// Per side, the share of its pixels that are usable; 0 for a blocked side.
    used: [f64; 2],
}

/// The problem of the background in use, with the workspace for solving it.
pub(super) struct Prepared {
    problem: Problem,
    /// The picture that the problem is built for: differences from another picture would contain gains.
    pub reference: PatchPair,
    correlations: Correlations,
    workspace: Workspace,
    solution: Solution,
    refit: Vec<f64>,
    /// The map at the smallest λ that noise allows, used where `solution` is empty.
    faint: Solution,
    /// The last frame's λ_max and smallest λ.
    lambdas: [f64; 2],
    /// Whether the frame shows nothing that noise, texture and model errors could not do.
    hidden: bool,
    /// Per side, the share of its usual information that the last frame has.
    trust: [f64; 2],
    blobs: BlobWorkspace,
    seeds: Vec<Point>,
    /// Workspace for comparing pictures other than the frame's.
    aside: (PatchPair, Correlations),
    /// How long building all this took.
    pub took: Duration,
}

/// Mean square, in units of the noise, of what no light from the room can cause, from which a frame counts as noisier
/// than the empty room.
const FOREIGN: f64 = 2.0;
/// Such noise is not white: over a cell of a fan its mean square is about this many times that of white noise.
const SPREAD: f64 = 4.0;

/// What one frame says about the hidden room. Light is linear, relative to full scale.
#[derive(Debug, Clone, PartialEq)]
pub struct Reconstruction {
    /// The solution of eq. 13.
    pub solution: Solution,
    /// Both views and the unified map.
    pub scene: Scene,
    /// Per facet, the factor of a least-squares refit on the support: brightness without the penalty's shrinkage
    /// ([`refit`](doorcam_core::solver::Solver::refit)).
    pub refit: Vec<f64>,
    /// Mean change of the visible side's light at the left and right patch; b of eq. 12 with the published model.
    pub illumination: [Rgb; 2],
    /// Per patch (left, right) and colour, the factor on the floor's own picture of the empty room, apart from what the
    /// facets explain. None with the published model, which has no gain.
    pub gain: Option<[Rgb; 2]>,
    /// Mean square of the weighted difference after gains, lamps and drift are projected out. With the signed model it
    /// is in units of the noise: about 1 in the empty room.
    pub energy: f64,
    /// The same for what the map leaves unexplained.
    pub residual: f64,
    /// The same, per patch, for what no light from the hidden room could cause (eq. 2).
    pub foreign: [f64; 2],
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
    /// Builds the problem for a background. If its frames do not tell the noise, it is estimated from `difference`.
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
            hidden: true,
            trust: [1.0; 2],
            blobs: BlobWorkspace::default(),
            seeds: Vec::new(),
            aside: (difference.clone(), problem.projection.correlations()),
            problem,
            took: start.elapsed(),
        }
    }
}

impl Reconstructor {
    /// Starts with nothing learned. With `warm_start`, each frame is solved from the previous one's map: faster, but
    /// the solution can then depend on it.
    pub fn new(model: Arc<Model>, warm_start: bool) -> Self {
        Self {
            background: Background::new(model.patch.size),
            difference: PatchPair::zeros(model.patch.size),
            problem: None,
            warm_start,
            usable: Usable::all(&model.counted),
            used: [1.0; 2],
            model,
        }
    }

    /// The model in use.
    pub fn model(&self) -> &Arc<Model> {
        &self.model
    }

    /// Says which pixels of the next frames show the floor. `used` is their share per side, 0 for a side that shows so
    /// little that it is left out.
    pub(super) fn use_only(&mut self, usable: &Usable, used: [f64; 2]) {
        self.usable.copy_from(usable);
        self.used = used;
    }

    /// Learns from a frame of the empty room.
    pub fn learn(&mut self, pair: &PatchPair) {
        self.background.learn(pair);
        self.problem = None;
    }

    /// What [`Reconstructor::learn`] has learned.
    pub(super) fn background(&self) -> &Background {
        &self.background
    }

    /// Takes out what was learned: it is large, and the problem built from it does not need it.
    pub(super) fn take_background(&mut self) -> Background {
        std::mem::replace(&mut self.background, Background::new(self.model.patch.size))
    }

    /// Restores what [`Reconstructor::take_background`] took out.
    pub(super) fn restore_background(&mut self, background: Background) {
        self.background = background;
        self.problem = None;
    }

    /// Installs a problem that was prepared elsewhere.
    pub(super) fn install(&mut self, prepared: Prepared) {
        self.problem = Some(prepared);
        self.take_background();
    }

    /// Exchanges the problem in use for another, which is kept.
    pub(super) fn exchange(&mut self, other: &mut Prepared) {
        if let Some(prepared) = &mut self.problem {
            std::mem::swap(prepared, other);
        }
    }

    /// The picture that frames are compared with; none before there is one.
    pub(super) fn reference(&self) -> Option<&PatchPair> {
        self.problem.as_ref().map(|prepared| &prepared.reference)
    }

    /// The same for a picture that is fixed, to correct it: the problem stays as it is.
    pub(super) fn reference_mut(&mut self) -> Option<&mut PatchPair> {
        self.problem.as_mut().filter(|prepared| prepared.problem.knows_noise()).map(|prepared| &mut prepared.reference)
    }

    /// The picture of the empty room that frames can be judged by; none if it is known from too few frames, as in
    /// published measurements.
    pub(super) fn empty(&self) -> Option<&PatchPair> {
        self.problem.as_ref().filter(|prepared| prepared.problem.knows_noise()).map(|prepared| &prepared.reference)
    }

    /// How visibly `picture` differs from `from` (the reference if none), as a share of what noise can reach: above 1,
    /// the difference would be detected. None before there is a background.
    pub(super) fn departure(&mut self, picture: &PatchPair, from: Option<&PatchPair>) -> Option<f64> {
        let Prepared { problem, reference, aside: (difference, correlations), .. } = self.problem.as_mut()?;
        picture.subtract(from.unwrap_or(reference), difference);
        problem.projection.project(difference, correlations).ok()?;
        let least = problem.lambda(correlations, 0.0);
        Some(problem.solver.lambda_max(correlations) / least)
    }

    /// Compares the last frame's solution with those from `starts` random starts; none before the first frame.
    pub fn audit(&self, starts: usize) -> Option<Audit> {
        let Prepared { problem, correlations, solution, .. } = self.problem.as_ref()?;
        Some(audit(&problem.solver, correlations, solution.lambda, self.model.limits, starts))
    }

    /// Finds people in the last frame, `elapsed_s` seconds after the previous one, given where they are expected.
    pub fn find(&mut self, expected: impl Iterator<Item = Prediction>, elapsed_s: f64) -> &[Detection] {
        let Some(prepared) = &mut self.problem else { return &[] };
        let Prepared {
            problem, correlations, workspace, solution, faint, lambdas, hidden, blobs, seeds, trust, ..
        } = prepared;
        let Some(finder) = &mut problem.finder else { return &[] };
        seeds.clear();
        // λ is raised where a changed lamp on textured floor might show as facets. People can be told from that.
        let [lambda_max, least] = *lambdas;
        let map = if *hidden && lambda_max > least {
            let limits = Limits { sweeps: FAINT_SWEEPS, tolerance: FAINT_TOLERANCE };
            problem.solver.solve_into(correlations, least, limits, Start::Empty, workspace, faint);
            &*faint
        } else {
            &*solution
        };
        let blobs = self.model.neighbourhood.blobs(&map.intensities, blobs);
        seeds.extend(blobs.iter().map(|blob| blob.position));
        finder.find_with(&self.difference, *trust, expected, seeds, elapsed_s)
    }

    /// What the pixels can measure; none before there is a background, and with the published model.
    pub(super) fn sensing(&self) -> Option<&Arc<Sensing>> {
        self.problem.as_ref()?.problem.sensing.as_ref()
    }

    /// What the room looks like while it is empty; none before there is a background, and with the published model.
    pub(super) fn still(&self) -> Option<&Arc<StillRoom>> {
        self.problem.as_ref()?.problem.still.as_ref()
    }

    /// The last frame's difference (eq. 4), in linear light.
    pub fn difference(&self) -> &PatchPair {
        &self.difference
    }

    /// Reconstructs what has changed compared with the empty room; none before that is learned. The first frame after
    /// learning takes longer, because the problem is built then.
    ///
    /// # Errors
    ///
    /// If the patches have another size than the model's, or contain a value that is not finite.
    pub fn reconstruct(&mut self, pair: &PatchPair) -> Result<Option<Reconstruction>, ProjectionError> {
        self.reconstruct_in_noise(pair, 1.0)
    }

    /// Like [`Reconstructor::reconstruct`], for a frame with `excess` times the usual noise (standard deviation).
    ///
    /// # Errors
    ///
    /// If the patches have another size than the model's, or contain a value that is not finite.
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
        let Prepared { problem, correlations, workspace, solution, refit, lambdas, hidden, trust, .. } =
            self.problem.get_or_insert_with(|| Prepared::new(model, background, difference));
        let start = Instant::now();
        for (side, used) in Side::BOTH.into_iter().zip(self.used) {
            if used == 0.0 {
                self.difference.side_mut(side).data_mut().fill(0.0);
            }
        }
        if self.used.iter().any(|&used| used > 0.0 && used < 1.0) {
            problem.projection.fill(&mut self.difference, &self.usable, correlations);
        }
        problem.projection.project(&self.difference, correlations)?;
        // Half of the values are those of one patch.
        let per_value = (problem.values.max(1) as f64).recip();
        let foreign = correlations.foreign.map(|foreign| 2.0 * per_value * foreign);
        // Noise that the empty room does not have, such as that of a sharp shadow's border, is noise all the same.
        let known = problem.knows_noise();
        let noisier = [0, 1].map(|s| if known && foreign[s] > FOREIGN { foreign[s] } else { 1.0 });
        let spread = |noisier: f64| if noisier > 1.0 { SPREAD * noisier } else { 1.0 };
        *trust = [0, 1].map(|s| self.used[s] * self.used[s] / spread(noisier[s]));
        let excess = excess * noisier[0].max(noisier[1]).sqrt();
        let project_time = start.elapsed();
        let start = Instant::now();
        let lambda_max = problem.solver.lambda_max(correlations);
        let lambda = problem.lambda_in_noise(correlations, lambda_max, excess);
        *lambdas = [lambda_max, problem.least_lambda(lambda_max, excess)];
        *hidden = lambda >= lambda_max;
        let by_itself = problem.lambda_by_itself(lambda_max, excess).filter(|_| *hidden);
        let lambda = by_itself.unwrap_or(lambda);
        // A map that is known to be empty starts empty, so that nothing of the previous frame can remain by mistake.
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
        // With the brightness as measured: the penalty's shrinkage would leave part of every facet's light to the gain.
        let gain = problem.projection.gain(correlations, |s, n| intensities(s, n).map(|x| refit[n] * x));
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
            foreign,
            background_time,
            project_time,
            solve_time,
        }))
    }
}
