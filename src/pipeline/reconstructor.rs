use std::sync::Arc;
use std::time::{Duration, Instant};

use super::Model;
use crate::measurement::{Background, PatchPair};
use crate::scene::{Rgb, Scene};
use crate::solver::{Correlations, ProjectionError, Solution};

/// The stages from a patch pair to a scene, with what they remember between frames.
pub struct Reconstructor {
    model: Arc<Model>,
    background: Background,
    difference: PatchPair,
    correlations: Correlations,
    previous: Option<Solution>,
    warm_start: bool,
}

/// What one frame says about the room.
#[derive(Debug, Clone, PartialEq)]
pub struct Reconstruction {
    /// The solution of eq. 13.
    pub solution: Solution,
    /// Views and unified map.
    pub scene: Scene,
    /// b of eq. 12: left, right.
    pub illumination: [Rgb; 2],
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
            correlations: model.projection.correlations(),
            previous: None,
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
    }

    /// The last frame's difference measurement (eq. 4).
    pub fn difference(&self) -> &PatchPair {
        &self.difference
    }

    /// Reconstructs what changed against the empty room; none before that was learned.
    pub fn reconstruct(&mut self, pair: &PatchPair) -> Result<Option<Reconstruction>, ProjectionError> {
        let start = Instant::now();
        if !self.background.difference(pair, &mut self.difference) {
            return Ok(None);
        }
        let background_time = start.elapsed();
        let start = Instant::now();
        let model = &self.model;
        model.projection.project(&self.difference, &mut self.correlations)?;
        let project_time = start.elapsed();
        let start = Instant::now();
        let warm = self.previous.as_ref().filter(|_| self.warm_start);
        let solution = model.solver.solve(&self.correlations, model.lambda, model.limits, warm);
        let solve_time = start.elapsed();
        let scene = Scene::new(&solution.intensities, model.unified_threshold);
        let illumination = model.projection.illumination(&self.correlations, |s, n| {
            let i = &solution.intensities[n];
            i.colour.map(|v| [i.left, i.right][s] * v)
        });
        self.previous = Some(solution.clone());
        Ok(Some(Reconstruction { solution, scene, illumination, background_time, project_time, solve_time }))
    }
}
