use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};

use super::pixel_light::patch_light;
use super::point::{Setup, Strategy};
use crate::geometry::Point;

/// One simulated measurement of the paper's model, y_m = i_m + ε, of a target at a point with y > 0, in metres in the
/// door frame. Returns the strategy's patches, left first, each row by row from the wall. The same seed gives the same
/// noise.
pub fn sample_measurement(setup: &Setup, strategy: Strategy, target: Point, seed: u64) -> Vec<Vec<f64>> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut noise = || -> f64 { StandardNormal.sample(&mut rng) };
    let light = strategy.sides().iter().map(|&side| patch_light(setup, side, strategy.has_edge(), target));
    light.map(|pixels| pixels.iter().map(|p| p.light + setup.noise * noise()).collect()).collect()
}
