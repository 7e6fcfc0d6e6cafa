use std::f64::consts::PI;
use std::sync::Arc;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};

use crate::Model;
use crate::model::BODY_HEIGHT_M;
use crate::texture_reach::{reach_in, texture_reach};
use doorcam_core::geometry::{Room, Side};
use doorcam_core::light::{Background, Floor, NoiseModel, PatchPair, Sensing, drift_patterns};
use doorcam_core::solver::{
    Admissible, Columns, Correlations, Lambda, ModelKind, Nuisance, Pixels, Projection, Solver,
};
use doorcam_core::still_room::{Empty, StillRoom};
use doorcam_core::tracking::likelihood::{Finder, Likelihood, LikelihoodSpec};
use doorcam_core::transport::Transport;

/// The inverse problem (eq. 13) for one background: built when the empty room is known, used for every frame after
/// that.
#[derive(Debug, Clone)]
pub struct Problem {
    /// From measurements to the Gram system.
    pub projection: Projection,
    /// Solver of the Gram system.
    pub solver: Solver,
    /// Finds people; none with the published model.
    pub finder: Option<Finder>,
    /// Values of a difference that count: counted pixels of both patches, times three colours.
    pub values: usize,
    /// What the pixels can measure; none with the published model, which does not use the noise.
    pub sensing: Option<Arc<Sensing>>,
    /// What the room looks like while it is empty; none with the published model, and in the dark.
    pub still: Option<Arc<StillRoom>>,
    penalty: Penalty,
    /// Whether so few frames of the empty room are known that its noise cannot be told from the floor's texture.
    few_frames: bool,
}

/// How λ is chosen.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Penalty {
    Fixed(f64),
    /// The larger of two values: what noise and, in changed light, the floor's texture can reach; and a share of λ_max,
    /// since model errors grow with the signal.
    Adaptive {
        noise: f64,
        /// Per side, reach of the texture per unit of even light.
        texture: [f64; 2],
        share: f64,
    },
}

/// Maximum number of drift patterns that are projected out, per side.
const DRIFT_PATTERNS: usize = 3;
/// Light level, relative to full scale, from which a pixel counts as saturated.
const SATURATED: f32 = 0.98;
/// Assumed reach of real noise relative to white noise if there are too few frames of the empty room to measure it:
/// compression and interpolation spread noise over neighbours, and the background has noise of its own.
const COLOURED: f64 = 3.0;
/// Frames of the empty room from which the reach of its noise is measured.
const ENOUGH: usize = 4;
/// In one of this many frames of an empty room, noise may make something show.
const FRAMES: f64 = 1000.0;
/// Least size of the room whose walls people hide, in metres: half its width, and its depth. People are often looked for in
/// a part of the room only, and for what they hide only directions matter much.
const LEAST_ROOM_M: [f64; 2] = [2.0, 4.0];
/// Its largest size, in the same way: the work of finding what it looks like grows with the cube of its surface.
const LARGEST_ROOM_M: [f64; 2] = [3.0, 6.0];
/// How far beyond the known walls those are thought to be at least, in metres.
const BEYOND_M: f64 = 0.2;
/// One of this many floors may have a texture that shows something when a lamp of the visible side changes.
const FLOORS: f64 = 100.0;

impl Problem {
    /// Builds the problem for a background of at least one frame, and a first difference from it.
    pub fn new(model: &Model, background: &Background, difference: &PatchPair) -> Self {
        match model.kind {
            ModelKind::Published => Self::published(model),
            ModelKind::Signed => Self::signed(model, background, difference),
        }
    }

    /// The authors' problem: constants projected out, columns unscaled.
    fn published(model: &Model) -> Self {
        let nuisance = Nuisance::constant(model.patch.pixels());
        let projection =
            Projection::new(&model.matrices(), &Pixels::uniform(&model.counted), &nuisance, Columns::Radiance);
        let kinds = model.grid.foreground.iter();
        let kinds = kinds.map(|&f| if f { Admissible::Brighter } else { Admissible::EitherSign }).collect();
        let lambda = match model.lambda {
            Lambda::Fixed(lambda) => lambda,
            Lambda::Auto => Lambda::PUBLISHED,
        };
        let values = 3 * model.counted.iter().flatten().filter(|&&counts| counts).count();
        Self {
            solver: Solver::new(projection.gram(), kinds),
            projection,
            finder: None,
            values,
            sensing: None,
            still: None,
            penalty: Penalty::Fixed(lambda),
            few_frames: false,
        }
    }

    /// Eq. 13 as it is written, in units of the noise, with unit-norm columns, and with the effects of exposure,
    /// flicker and drift projected out.
    fn signed(model: &Model, background: &Background, difference: &PatchPair) -> Self {
        let frames: Vec<&PatchPair> = background.kept().iter().collect();
        let noise = noise(model, &frames, background.frames()).unwrap_or_else(|| NoiseModel::from_texture(difference));
        let weights = weights(model, background.mean(), noise);
        let floors = floors(background.mean(), &weights);
        let albedo_noise = albedo_noise(background, noise);
        let transport = model.matrices();
        let projection = signed_projection(&transport, background.mean(), &frames, &weights, &floors);
        let solver = Solver::new(projection.gram(), vec![Admissible::Signed; projection.facets()]);
        let penalty = match model.lambda {
            Lambda::Fixed(lambda) => Penalty::Fixed(lambda),
            Lambda::Auto => {
                let coloured = noise_colour(model, &transport, &frames).unwrap_or(COLOURED);
                let noise = model.lambda_factor * coloured * white_noise_reach(&projection).exceeded_in_one_of(FRAMES);
                let texture = texture_reach(&transport, model.patch.size, &floors, &weights, albedo_noise, &projection)
                    .map(|maxima| model.lambda_factor * Reach::of(&maxima).exceeded_in_one_of(FLOORS));
                Penalty::Adaptive { noise, texture, share: model.lambda_share }
            }
        };
        // Large and no longer needed; the finder below needs memory of its own.
        drop(transport);
        let values = 3 * weights.iter().flatten().filter(|&&w| w > 0.0).count();
        let still = still_room(model, background.mean(), &floors);
        let finder = finder(model, background.mean(), &frames, &weights, &floors, still.as_ref());
        let still = still.map(Arc::new);
        let sensing = Some(Arc::new(Sensing { still: background.mean().clone(), weights }));
        let few_frames = frames.len() < ENOUGH;
        Self { projection, solver, finder, values, sensing, still, penalty, few_frames }
    }

    /// Whether the noise of the empty room is known, so that what it cannot be can be told.
    pub fn knows_noise(&self) -> bool {
        self.sensing.is_some() && !self.few_frames
    }

    /// λ for a frame. `lambda_max` is the smallest λ at which its map is empty.
    pub fn lambda(&self, frame: &Correlations, lambda_max: f64) -> f64 {
        self.lambda_in_noise(frame, lambda_max, 1.0)
    }

    /// λ for a frame whose map would be empty because of what the floor's texture might do: none, unless so few frames
    /// of the empty room are known, as in published measurements, that its strength is a guess. The frame is then
    /// judged by itself.
    pub fn lambda_by_itself(&self, lambda_max: f64, excess: f64) -> Option<f64> {
        self.few_frames.then(|| self.least_lambda(lambda_max, excess))
    }

    /// The smallest λ that noise allows, without the margin for the floor's texture.
    pub fn least_lambda(&self, lambda_max: f64, excess: f64) -> f64 {
        match self.penalty {
            Penalty::Fixed(lambda) => lambda,
            Penalty::Adaptive { noise, share, .. } => (excess * noise).max(share * lambda_max),
        }
    }

    /// Like [`Problem::lambda`], for a frame with `excess` times the usual noise, as the average of fewer frames has.
    pub fn lambda_in_noise(&self, frame: &Correlations, lambda_max: f64, excess: f64) -> f64 {
        match self.penalty {
            Penalty::Fixed(lambda) => lambda,
            Penalty::Adaptive { noise, texture, share } => {
                (excess * noise).hypot(reach_in(texture, &self.projection, frame)).max(share * lambda_max)
            }
        }
    }
}

/// Noise of a difference from the mean of `averaged` frames: that of a frame and of the mean.
fn noise(model: &Model, frames: &[&PatchPair], averaged: u64) -> Option<NoiseModel> {
    let of_both = 1.0 + 1.0 / averaged.max(1) as f64;
    let of_one = NoiseModel::from_frames(frames, &model.counted)?;
    Some(NoiseModel { read: of_one.read * of_both, shot: of_one.shot * of_both })
}

/// Noise of a floor's estimated albedo, relative: the background's share of a difference's noise, averaged over the
/// three colours.
fn albedo_noise(background: &Background, noise: NoiseModel) -> f64 {
    let values = || Side::BOTH.into_iter().flat_map(|side| background.mean().side(side).data());
    let level = values().map(|&v| f64::from(v)).sum::<f64>() / values().count().max(1) as f64;
    let of_background = 1.0 / (1.0 + background.frames() as f64);
    if level > 0.0 { noise.sigma(level) / level * (of_background / 3.0).sqrt() } else { 0.0 }
}

/// 1 / noise of each pixel of `empty`; 0 for pixels that do not count or are saturated.
fn weights(model: &Model, empty: &PatchPair, noise: NoiseModel) -> [Vec<f64>; 2] {
    let sides = [&empty.left, &empty.right];
    [0, 1].map(|s| {
        let weight = |k: usize| {
            let rgb = [0, 1, 2].map(|p| sides[s].plane(p)[k]);
            let unused = !model.counted[s][k] || rgb.iter().any(|&v| v >= SATURATED);
            let level = rgb.iter().map(|&v| f64::from(v)).sum::<f64>() / 3.0;
            if unused { 0.0 } else { noise.sigma(level).recip() }
        };
        (0..model.patch.pixels()).map(weight).collect()
    })
}

fn used(weights: &[Vec<f64>; 2]) -> [Vec<bool>; 2] {
    weights.each_ref().map(|weights| weights.iter().map(|&w| w > 0.0).collect())
}

fn floors(empty: &PatchPair, weights: &[Vec<f64>; 2]) -> [Floor; 2] {
    let [left, right] = used(weights);
    [Floor::from_picture(&empty.left, &left), Floor::from_picture(&empty.right, &right)]
}

/// The projection for differences from `empty`, the background of `frames`.
fn signed_projection(
    transport: &Transport,
    empty: &PatchPair,
    frames: &[&PatchPair],
    weights: &[Vec<f64>; 2],
    floors: &[Floor; 2],
) -> Projection {
    // Even light of the visible side shows the floor's albedo; it comes first, because λ depends on its strength. An
    // exposure step adds a multiple of the background's own picture in each colour; a lamp changes their balance. Each
    // pattern may occur in any colour, so all are smoothed. Each colour's own picture, with its noise, is taken out
    // exactly beforehand.
    let gains = [0, 1].map(|s| {
        let floor = &floors[s];
        vec![floor.albedo.clone(), floor.picture(0), floor.picture(1), floor.picture(2)]
    });
    let albedo = floors.each_ref().map(|floor| floor.albedo.clone());
    let [left_drift, right_drift] = drift_patterns(frames, &gains, &used(weights), DRIFT_PATTERNS);
    let [left, right] = gains;
    let nuisance = Nuisance::new([[left, left_drift].concat(), [right, right_drift].concat()]);
    let nuisance = nuisance.with_own_pictures(empty.clone());
    Projection::new(transport, &Pixels { weights: weights.clone(), albedo }, &nuisance, Columns::UnitNorm)
}

/// Where the walls of the still room are thought to be, if the map covers `mapped`.
fn walls(mapped: Room) -> Room {
    let beyond = |k: usize, length: f64| (length + BEYOND_M).clamp(LEAST_ROOM_M[k], LARGEST_ROOM_M[k]);
    Room { half_width_m: beyond(0, mapped.half_width_m), depth_m: beyond(1, mapped.depth_m) }
}

/// What the hidden room looks like in the picture of the empty floor.
fn still_room(model: &Model, empty: &PatchPair, floors: &[Floor; 2]) -> Option<StillRoom> {
    StillRoom::fit(&Empty {
        doorway: &model.doorway,
        room: walls(model.grid.room),
        lights: &model.lights,
        patch: &model.patch,
        fans: &model.fans,
        picture: empty,
        floors,
    })
}

/// Finds people in differences from `empty`, the background of `frames`.
fn finder(
    model: &Model,
    empty: &PatchPair,
    frames: &[&PatchPair],
    weights: &[Vec<f64>; 2],
    floors: &[Floor; 2],
    still: Option<&StillRoom>,
) -> Option<Finder> {
    let levels = || Side::BOTH.into_iter().flat_map(|side| empty.side(side).data()).map(|&v| f64::from(v));
    let level = levels().sum::<f64>() / levels().count().max(1) as f64;
    // Even light, and each colour's picture in any colour: exposure, lamps and their colours.
    let gains = [0, 1].map(|s| {
        let picture = |c: usize| empty.side(Side::BOTH[s]).plane(c).iter().map(|&v| f64::from(v)).collect::<Vec<f64>>();
        vec![vec![level; model.patch.pixels()], floors[s].albedo.clone(), picture(0), picture(1), picture(2)]
    });
    let [left_drift, right_drift] = drift_patterns(frames, &gains, &used(weights), DRIFT_PATTERNS);
    let [left, right] = gains;
    let likelihood = Likelihood::new(&LikelihoodSpec {
        doorway: &model.doorway,
        room: &model.grid.room,
        searched: &model.searched,
        patch: &model.patch,
        fans: &model.fans,
        table: model.bodies(),
        weights,
        patterns: [[left, left_drift].concat(), [right, right_drift].concat()],
        empty: frames,
        level,
        still,
        body: [model.body_radius_m, BODY_HEIGHT_M],
    })?;
    Some(Finder::new(model.doorway, likelihood, model.body_radius_m))
}

/// Distribution of the largest dual norm over the facets for something random: Gumbel, as it is a maximum.
struct Reach {
    mean: f64,
    /// β of the distribution.
    scale: f64,
}

impl Reach {
    /// Fits the distribution to simulated maxima, with β = σ √6 / π; 0 without any.
    fn of(maxima: &[f64]) -> Self {
        let mean = maxima.iter().sum::<f64>() / maxima.len().max(1) as f64;
        let squares = maxima.iter().map(|m| (m - mean).powi(2)).sum::<f64>();
        let variance = squares / maxima.len().saturating_sub(1).max(1) as f64;
        Self { mean, scale: (6.0 * variance).sqrt() / PI }
    }

    /// The value that is exceeded in one of `cases` cases, for many: mean + β (ln cases − 0.5772).
    fn exceeded_in_one_of(&self, cases: f64) -> f64 {
        self.mean + self.scale * (cases.ln() - 0.577_2)
    }
}

/// Reach of white noise of unit variance, simulated.
fn white_noise_reach(projection: &Projection) -> Reach {
    const DRAWS: usize = 200;
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let mut drawn = projection.correlations();
    let maxima: Vec<f64> = (0..DRAWS)
        .map(|_| {
            projection.white_noise(&mut drawn, || StandardNormal.sample(&mut random));
            drawn.signed_lambda_max()
        })
        .collect();
    Reach::of(&maxima)
}

/// How much further the empty room's real noise reaches than white noise. The problem is built from every other frame,
/// and measured on the frames between, which had no influence on it. None if there are too few frames.
///
/// A background of half the frames is noisier than the one in use, so the result errs on the safe side.
fn noise_colour(model: &Model, transport: &Transport, frames: &[&PatchPair]) -> Option<f64> {
    if frames.len() < ENOUGH {
        return None;
    }
    let known: Vec<&PatchPair> = frames.iter().step_by(2).copied().collect();
    let mut background = Background::new(known[0].left.size());
    known.iter().for_each(|frame| background.learn(frame));
    let noise = noise(model, &known, background.frames())?;
    let weights = weights(model, background.mean(), noise);
    let floors = floors(background.mean(), &weights);
    let projection = signed_projection(transport, background.mean(), &known, &weights, &floors);
    let mut difference = PatchPair::zeros(known[0].left.size());
    let mut correlations = projection.correlations();
    let mut maxima: Vec<f64> = (frames.iter().skip(1).step_by(2))
        .filter_map(|frame| {
            background.difference(frame, &mut difference);
            projection.project(&difference, &mut correlations).ok()?;
            Some(correlations.signed_lambda_max())
        })
        .collect();
    let middle = maxima.len() / 2;
    let median = if maxima.is_empty() { 0.0 } else { *maxima.select_nth_unstable_by(middle, f64::total_cmp).1 };
    // All of a few frames may be quiet by chance.
    let margin = 1.0 + 1.0 / (maxima.len().max(1) as f64).sqrt();
    Some((margin * median / white_noise_reach(&projection).mean).max(1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn however_large_the_mapped_room_is_the_still_one_stays_small() {
        let of = |half_width_m: f64, depth_m: f64| {
            let Room { half_width_m, depth_m } = walls(Room { half_width_m, depth_m });
            [half_width_m, depth_m]
        };
        assert_eq!(of(0.5, 1.0), LEAST_ROOM_M);
        assert_eq!(of(2.5, 5.0), [2.7, 5.2]);
        assert_eq!(of(100.0, 100.0), LARGEST_ROOM_M);
    }
}
