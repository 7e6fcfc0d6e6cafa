use std::f64::consts::PI;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};

use super::Model;
use crate::config::Lambda;
use crate::measurement::{Background, Floor, NoiseModel, PatchPair, drift_patterns};
use crate::solver::{Admissible, Columns, ModelKind, Nuisance, Pixels, Projection, Solver};

/// The inverse problem for one background: built when the empty room is known, used for every frame after.
#[derive(Debug, Clone)]
pub struct Problem {
    /// Measurements to the Gram system.
    pub projection: Projection,
    /// The Gram system's solver.
    pub solver: Solver,
    penalty: Penalty,
}

/// How λ is chosen.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Penalty {
    Fixed(f64),
    /// The larger of what noise can reach and a share of the strongest facet's wish: model errors grow with the signal.
    Adaptive {
        floor: f64,
        share: f64,
    },
}

/// Drift patterns that are projected out at most, per side.
const DRIFT_PATTERNS: usize = 3;
/// A level of light above which a pixel counts as saturated.
const SATURATED: f32 = 0.98;
/// How much further noise reaches than white noise where the frames of the empty room are too few to tell: compression and
/// interpolation spread noise over neighbours, and the background has noise of its own.
const COLOURED: f64 = 3.0;
/// Frames of the empty room from which on its own noise is measured.
const ENOUGH: usize = 4;

impl Problem {
    /// For a background, of which at least one frame is known, and a first difference from it.
    pub fn new(model: &Model, background: &Background, difference: &PatchPair) -> Self {
        match model.kind {
            ModelKind::Published => Self::published(model),
            ModelKind::Signed => Self::signed(model, background, difference),
        }
    }

    /// The authors' problem: constants out, columns as they are.
    fn published(model: &Model) -> Self {
        let nuisance = Nuisance::constant(model.patch.pixels());
        let projection =
            Projection::new(&model.transport, &Pixels::uniform(&model.counted), &nuisance, Columns::Radiance);
        let kinds = model.grid.foreground.iter();
        let kinds = kinds.map(|&f| if f { Admissible::Brighter } else { Admissible::EitherSign }).collect();
        let lambda = match model.lambda {
            Lambda::Fixed(lambda) => lambda,
            Lambda::Auto => Lambda::PUBLISHED,
        };
        Self { solver: Solver::new(projection.gram(), kinds), projection, penalty: Penalty::Fixed(lambda) }
    }

    /// Eq. 13 as it is written, in units of the noise, with unit-norm columns and without what exposure, flicker and drift
    /// can do.
    fn signed(model: &Model, background: &Background, difference: &PatchPair) -> Self {
        let frames: Vec<&PatchPair> = background.kept().iter().collect();
        let noise = noise(model, &frames, background.frames()).unwrap_or_else(|| NoiseModel::from_texture(difference));
        let projection = signed_projection(model, background.mean(), &frames, noise);
        let solver = signed_solver(&projection);
        let penalty = match model.lambda {
            Lambda::Fixed(lambda) => Penalty::Fixed(lambda),
            Lambda::Auto => {
                let coloured = noise_colour(model, &frames).unwrap_or(COLOURED);
                let floor = model.lambda_factor * coloured * white_noise_reach(&projection, &solver).quantile;
                Penalty::Adaptive { floor, share: model.lambda_share }
            }
        };
        Self { projection, solver, penalty }
    }

    /// λ for a frame whose map is empty from `lambda_max` on.
    pub fn lambda(&self, lambda_max: f64) -> f64 {
        match self.penalty {
            Penalty::Fixed(lambda) => lambda,
            Penalty::Adaptive { floor, share } => floor.max(share * lambda_max),
        }
    }
}

/// Noise of a difference from the mean of `averaged` frames.
fn noise(model: &Model, frames: &[&PatchPair], averaged: u64) -> Option<NoiseModel> {
    let of_both = 1.0 + 1.0 / averaged.max(1) as f64;
    let of_one = NoiseModel::from_frames(frames, &model.counted)?;
    Some(NoiseModel { read: of_one.read * of_both, shot: of_one.shot * of_both })
}

fn signed_solver(projection: &Projection) -> Solver {
    Solver::new(projection.gram(), vec![Admissible::Signed; projection.facets()])
}

/// The projection for differences from `empty`, which the frames are of.
fn signed_projection(model: &Model, empty: &PatchPair, frames: &[&PatchPair], noise: NoiseModel) -> Projection {
    let sides = [&empty.left, &empty.right];
    let weights = [0, 1].map(|s| {
        let weight = |k: usize| {
            let rgb = [0, 1, 2].map(|p| sides[s].plane(p)[k]);
            let unused = !model.counted[s][k] || rgb.iter().any(|&v| v >= SATURATED);
            let level = rgb.iter().map(|&v| f64::from(v)).sum::<f64>() / 3.0;
            if unused { 0.0 } else { noise.sigma(level).recip() }
        };
        (0..model.patch.pixels()).map(weight).collect::<Vec<f64>>()
    });
    let used = [0, 1].map(|s| weights[s].iter().map(|&w| w > 0.0).collect::<Vec<bool>>());
    let floors = [0, 1].map(|s| Floor::from_picture(sides[s], &used[s]));
    // Even light of the visible side shows the floor's albedo. An exposure step adds a multiple of the background's own
    // picture, in each colour; a lamp changes its balance. Any colour may hold any of these, so they are smoothed; what is
    // exactly a colour's own picture, with its noise, is taken out beforehand.
    let gains = [0, 1].map(|s| {
        let floor = &floors[s];
        vec![floor.albedo.clone(), floor.picture(0), floor.picture(1), floor.picture(2)]
    });
    let albedo = floors.map(|floor| floor.albedo);
    let [left_drift, right_drift] = drift_patterns(frames, &gains, &used, DRIFT_PATTERNS);
    let [left, right] = gains;
    let nuisance = Nuisance::new([[left, left_drift].concat(), [right, right_drift].concat()]);
    let nuisance = nuisance.with_own_pictures(empty.clone());
    Projection::new(&model.transport, &Pixels { weights, albedo }, &nuisance, Columns::UnitNorm)
}

/// What white noise of unit variance does to the largest dual norm over the facets.
struct Reach {
    mean: f64,
    /// Exceeded in one frame of a thousand.
    quantile: f64,
}

/// Simulated, and fitted with a Gumbel distribution, as maxima have.
fn white_noise_reach(projection: &Projection, solver: &Solver) -> Reach {
    const DRAWS: usize = 200;
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let mut drawn = projection.correlations();
    let maxima: Vec<f64> = (0..DRAWS)
        .map(|_| {
            projection.white_noise(&mut drawn, || StandardNormal.sample(&mut random));
            solver.lambda_max(&drawn)
        })
        .collect();
    let mean = maxima.iter().sum::<f64>() / DRAWS as f64;
    let variance = maxima.iter().map(|m| (m - mean).powi(2)).sum::<f64>() / (DRAWS - 1) as f64;
    // Quantile 0.999 of a Gumbel distribution of this mean and variance: β = σ √6 / π, mean + β (ln 1000 − 0.5772).
    Reach { mean, quantile: mean + (6.0 * variance).sqrt() / PI * (1000.0_f64.ln() - 0.577_2) }
}

/// How much further than white noise the empty room's real noise reaches: everything is built from every other frame, as
/// if only they were known, and the frames between, which had no say in it, are looked at. None with too few frames.
///
/// Built from half the frames, the background is noisier than the one in use; the measure errs on the safe side.
fn noise_colour(model: &Model, frames: &[&PatchPair]) -> Option<f64> {
    if frames.len() < ENOUGH {
        return None;
    }
    let known: Vec<&PatchPair> = frames.iter().step_by(2).copied().collect();
    let mut background = Background::new(known[0].left.size());
    known.iter().for_each(|frame| background.learn(frame));
    let noise = noise(model, &known, background.frames())?;
    let projection = signed_projection(model, background.mean(), &known, noise);
    let solver = signed_solver(&projection);
    let mut difference = PatchPair::zeros(known[0].left.size());
    let mut correlations = projection.correlations();
    let mut maxima: Vec<f64> = (frames.iter().skip(1).step_by(2))
        .filter_map(|frame| {
            background.difference(frame, &mut difference);
            projection.project(&difference, &mut correlations).ok()?;
            Some(solver.lambda_max(&correlations))
        })
        .collect();
    let middle = maxima.len() / 2;
    let median = if maxima.is_empty() { 0.0 } else { *maxima.select_nth_unstable_by(middle, f64::total_cmp).1 };
    // Few frames may by chance all have been quiet ones.
    let margin = 1.0 + 1.0 / (maxima.len().max(1) as f64).sqrt();
    Some((margin * median / white_noise_reach(&projection, &solver).mean).max(1.0))
}
