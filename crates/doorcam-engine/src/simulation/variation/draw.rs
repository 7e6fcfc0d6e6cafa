use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

use doorcam_core::scene::Rgb;

/// Random numbers of a scenario and seed.
pub(super) struct Draw(ChaCha8Rng);

impl Draw {
    /// Numbers that another scenario does not have for the same seed.
    pub(super) fn new(name: &str, seed: u64) -> Self {
        let mut generator = ChaCha8Rng::seed_from_u64(seed);
        generator.set_stream(name.bytes().fold(1, |sum, byte| sum * 31 + u64::from(byte)));
        Self(generator)
    }

    pub(super) fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.0.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
    }

    pub(super) fn chance(&mut self, share: f64) -> bool {
        self.between(0.0, 1.0) < share
    }

    /// −1 or 1.
    pub(super) fn sign(&mut self) -> f64 {
        if self.chance(0.5) { -1.0 } else { 1.0 }
    }

    pub(super) fn pick<T: Copy>(&mut self, choices: &[T]) -> T {
        let place = self.between(0.0, choices.len() as f64) as usize;
        choices[place.min(choices.len() - 1)]
    }

    /// The colour of something to wear.
    pub(super) fn cloth(&mut self) -> Rgb {
        let colour = self.pick(&[
            [0.03, 0.03, 0.035],
            [0.06, 0.12, 0.55],
            [0.55, 0.08, 0.07],
            [0.07, 0.3, 0.1],
            [0.7, 0.69, 0.66],
            [0.25, 0.25, 0.26],
            [0.6, 0.45, 0.08],
            [0.35, 0.25, 0.18],
        ]);
        colour.map(|c| c * self.between(0.8, 1.2))
    }
}
