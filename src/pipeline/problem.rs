use std::f64::consts::PI;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};

use super::Model;
use crate::config::Lambda;
use crate::measurement::{Background, NoiseModel, PatchPair, drift_patterns, relative_albedo};
use crate::solver::{Admissible, Columns, Correlations, ModelKind, Nuisance, Pixels, Projection, Solver};

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
/// How much stronger the noise of Aᵀy is than that of white noise where the frames of the empty room are too few to tell:
/// compression and interpolation spread noise over neighbours.
const COLOURED: f64 = 2.0;
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
        let frames = background.kept();
        let empty = background.mean();
        let averaged = (1.0 + 1.0 / background.frames().max(1) as f64).sqrt();
        let noise = match NoiseModel::from_frames(frames, &model.counted) {
            Some(noise) => {
                NoiseModel { read: noise.read * averaged * averaged, shot: noise.shot * averaged * averaged }
            }
            None => NoiseModel::from_texture(difference),
        };
        let sides = [&empty.left, &empty.right];
        let weights = [0, 1].map(|s| {
            let level = |k: usize| [0, 1, 2].map(|p| sides[s].plane(p)[k]);
            let weight = |k: usize| {
                let rgb = level(k);
                let dark = !model.counted[s][k] || rgb.iter().any(|&v| v >= SATURATED);
                if dark { 0.0 } else { noise.sigma(rgb.iter().map(|&v| f64::from(v)).sum::<f64>() / 3.0).recip() }
            };
            (0..model.patch.pixels()).map(weight).collect::<Vec<f64>>()
        });
        let used = [0, 1].map(|s| weights[s].iter().map(|&w| w > 0.0).collect::<Vec<bool>>());
        let albedo = [0, 1].map(|s| relative_albedo(sides[s], &used[s]));
        // Even light of the visible side shows the floor's albedo; an exposure step adds a multiple of the background's own
        // picture, in each colour.
        let gains = [0, 1].map(|s| {
            let picture = |p: usize| sides[s].plane(p).iter().map(|&v| f64::from(v)).collect::<Vec<f64>>();
            vec![albedo[s].clone(), picture(0), picture(1), picture(2)]
        });
        let [left_drift, right_drift] = drift_patterns(frames, &gains, &used, DRIFT_PATTERNS);
        let [left, right] = gains;
        let nuisance = Nuisance::new([[left, left_drift].concat(), [right, right_drift].concat()]);
        let projection = Projection::new(&model.transport, &Pixels { weights, albedo }, &nuisance, Columns::UnitNorm);
        let solver = Solver::new(projection.gram(), vec![Admissible::Signed; projection.facets()]);
        let penalty = match model.lambda {
            Lambda::Fixed(lambda) => Penalty::Fixed(lambda),
            Lambda::Auto => Penalty::Adaptive {
                floor: model.lambda_factor * empty_room_reach(&projection, &solver, background),
                share: model.lambda_share,
            },
        };
        Self { projection, solver, penalty }
    }

    /// λ for a frame.
    pub fn lambda(&self, frame: &Correlations) -> f64 {
        match self.penalty {
            Penalty::Fixed(lambda) => lambda,
            Penalty::Adaptive { floor, share } => floor.max(share * self.solver.lambda_max(frame)),
        }
    }
}

/// The λ above which the empty room's noise lights a facet in no more than one frame in a thousand.
///
/// The largest dual norm over the facets of white noise is simulated and fitted with a Gumbel distribution, as maxima have;
/// the frames of the empty room tell how much stronger than white noise the real one is.
fn empty_room_reach(projection: &Projection, solver: &Solver, background: &Background) -> f64 {
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
    let reach = mean + (6.0 * variance).sqrt() / PI * (1000.0_f64.ln() - 0.577_2);
    let frames = background.kept();
    if frames.len() < ENOUGH {
        return COLOURED * reach;
    }
    let n = frames.len() as f64;
    // x_i − x̄ has the variance σ² (1 − 1/n); a new frame's difference will have σ² (1 + 1/n).
    let unbiased = ((1.0 + 1.0 / n) / (1.0 - 1.0 / n)).sqrt();
    let mut difference = PatchPair::zeros(frames[0].left.size());
    let mut measured: Vec<f64> = frames
        .iter()
        .filter_map(|frame| {
            background.difference(frame, &mut difference);
            projection.project(&difference, &mut drawn).ok()?;
            Some(unbiased * solver.lambda_max(&drawn))
        })
        .collect();
    let middle = measured.len() / 2;
    let median = if measured.is_empty() { 0.0 } else { *measured.select_nth_unstable_by(middle, f64::total_cmp).1 };
    reach * (median / mean).max(1.0)
}
