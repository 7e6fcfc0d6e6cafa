use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use rand_distr::{Distribution, StandardNormal};

use doorcam_core::light::Patch;

/// Largest code of a 16-bit image.
const FULL_SCALE: f64 = 65535.0;

/// How light becomes codes: photon noise, read noise and 16-bit quantisation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sensor {
    /// Electrons at full scale, in one patch pixel (several pixels of a camera) and one exposure; infinite for no
    /// photon noise.
    pub full_scale_electrons: f64,
    /// Standard deviation of the read noise of one patch pixel, in electrons.
    pub read_electrons: f64,
}

impl Sensor {
    /// Random generator for one frame's noise. Each frame has its own stream, so that frames can be made in any order.
    pub fn generator(seed: u64, frame: u64) -> impl Rng {
        let mut generator = ChaCha8Rng::seed_from_u64(seed);
        generator.set_stream(frame);
        generator
    }

    /// 16-bit codes of a patch of linear light relative to full scale: red, green, blue interleaved, row by row from
    /// the wall.
    ///
    /// With n electrons the variance is n + read². With thousands of electrons Poisson's distribution is normal.
    pub fn expose(&self, patch: &Patch, generator: &mut impl Rng) -> Vec<u16> {
        let read = self.read_electrons / self.full_scale_electrons;
        (0..3 * patch.pixels())
            .map(|k| {
                let light = f64::from(patch.plane(k % 3)[k / 3]).max(0.0);
                let deviation = (light / self.full_scale_electrons + read * read).sqrt();
                let normal: f64 = StandardNormal.sample(generator);
                // The conversion saturates at both ends, as a sensor does.
                ((light + deviation * normal) * FULL_SCALE).round() as u16
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_noise_has_the_sensors_mean_and_variance() {
        let mut patch = Patch::zeros(64);
        patch.data_mut().fill(0.4);
        let sensor = Sensor { full_scale_electrons: 50_000.0, read_electrons: 100.0 };
        let codes = sensor.expose(&patch, &mut Sensor::generator(7, 3));
        let light: Vec<f64> = codes.iter().map(|&c| f64::from(c) / FULL_SCALE).collect();
        let mean = light.iter().sum::<f64>() / light.len() as f64;
        let variance = light.iter().map(|l| (l - mean).powi(2)).sum::<f64>() / (light.len() - 1) as f64;
        let expected = (0.4 * 50_000.0 + 1e4) / 50_000.0_f64.powi(2);
        // Four standard errors of each.
        assert!((mean - 0.4).abs() < 4.0 * (expected / light.len() as f64).sqrt(), "{mean}");
        assert!((variance / expected - 1.0).abs() < 4.0 * (2.0 / light.len() as f64).sqrt(), "{variance} {expected}");
        assert_eq!(codes, sensor.expose(&patch, &mut Sensor::generator(7, 3)));
        assert_ne!(codes, sensor.expose(&patch, &mut Sensor::generator(7, 4)));
        assert_ne!(codes, sensor.expose(&patch, &mut Sensor::generator(8, 3)));
    }
}
