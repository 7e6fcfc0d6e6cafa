use crate::geometry::Side;
use crate::light::PatchPair;

/// Noise of a patch pixel as a function of its level: variance = `read` + `shot` · level, in linear light relative to
/// full scale.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NoiseModel {
    /// Variance that does not depend on the level: read noise, quantisation.
    pub read: f64,
    /// Variance per unit of level: photon noise.
    pub shot: f64,
}

/// Lower bound of the standard deviation, relative to full scale: an eighth of a 16-bit code.
const QUIETEST: f64 = 2e-6;

impl NoiseModel {
    /// Fits the model to the variance of each pixel over the frames; `None` with fewer than two frames.
    pub fn from_frames(frames: &[&PatchPair], counted: &[Vec<bool>; 2]) -> Option<Self> {
        if frames.len() < 2 {
            return None;
        }
        // Sums of an unweighted regression of variance on level.
        let (mut n, mut level_sum, mut variance_sum, mut cross, mut squares) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for (s, side) in Side::BOTH.into_iter().enumerate() {
            for channel in 0..3 {
                for k in (0..counted[s].len()).filter(|&k| counted[s][k]) {
                    let values = || frames.iter().map(|f| f64::from(f.side(side).plane(channel)[k]));
                    let level = values().sum::<f64>() / frames.len() as f64;
                    let variance = values().map(|v| (v - level).powi(2)).sum::<f64>() / (frames.len() - 1) as f64;
                    n += 1.0;
                    level_sum += level;
                    variance_sum += variance;
                    cross += level * variance;
                    squares += level * level;
                }
            }
        }
        let (mean_level, mean_variance) = (level_sum / n, variance_sum / n);
        let spread = squares / n - mean_level * mean_level;
        // Levels that hardly differ do not determine the slope; all noise is then taken as photon noise.
        let slope = if spread > 1e-4 * mean_level * mean_level {
            (cross / n - mean_level * mean_variance) / spread
        } else {
            mean_variance / mean_level.max(f64::MIN_POSITIVE)
        };
        let shot = slope.clamp(0.0, mean_variance / mean_level.max(f64::MIN_POSITIVE));
        Some(Self { read: (mean_variance - shot * mean_level).max(QUIETEST * QUIETEST), shot })
    }

    /// Estimates the noise from a single `difference`: from the median absolute second difference along rows, to which
    /// a smooth penumbra contributes little. For a difference of two frames, the result is the noise of both together.
    pub fn from_texture(difference: &PatchPair) -> Self {
        let mut jumps = Vec::new();
        for side in Side::BOTH {
            let patch = difference.side(side);
            for channel in 0..3 {
                for row in patch.plane(channel).chunks_exact(patch.size()) {
                    jumps.extend(row.windows(3).map(|w| (w[0] - 2.0 * w[1] + w[2]).abs()).filter(|j| j.is_finite()));
                }
            }
        }
        let middle = jumps.len() / 2;
        let median = if jumps.is_empty() { 0.0 } else { *jumps.select_nth_unstable_by(middle, f32::total_cmp).1 };
        // A second difference has √6 times the noise; the median of |N(0, 1)| is 0.6745.
        let sigma = f64::from(median) / (0.6745 * 6.0_f64.sqrt());
        Self { read: sigma.max(QUIETEST).powi(2), shot: 0.0 }
    }

    /// Standard deviation at a level; both in linear light relative to full scale.
    pub fn sigma(&self, level: f64) -> f64 {
        (self.read + self.shot * level.max(0.0)).sqrt()
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub const SIZE: usize = 32;

    /// Reproducible, approximately normal numbers: sums of twelve uniform ones.
    struct Normal(u64);

    impl Normal {
        fn next(&mut self) -> f64 {
            let mut uniform = || {
                self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (self.0 >> 11) as f64 / (1u64 << 53) as f64
            };
            (0..12).map(|_| uniform()).sum::<f64>() - 6.0
        }
    }

    /// Frames of light that increases to the right, with a pattern that grows from frame to frame, and noise.
    pub fn frames(count: usize, noise: NoiseModel, drift: f64) -> Vec<PatchPair> {
        let mut normal = Normal(3);
        (0..count)
            .map(|t| {
                let mut pair = PatchPair::zeros(SIZE);
                for side in Side::BOTH {
                    for channel in 0..3 {
                        let strength = drift * (t as f64 - count as f64 / 2.0) / count as f64;
                        for (k, value) in pair.side_mut(side).plane_mut(channel).iter_mut().enumerate() {
                            let level = 0.1 + 0.6 * (k % SIZE) as f64 / SIZE as f64;
                            let lamp = ((k / SIZE) as f64 / 6.0).sin();
                            *value = (level + strength * lamp + noise.sigma(level) * normal.next()) as f32;
                        }
                    }
                }
                pair
            })
            .collect()
    }

    pub fn all() -> [Vec<bool>; 2] {
        [vec![true; SIZE * SIZE], vec![true; SIZE * SIZE]]
    }

    #[test]
    fn shot_and_read_noise_are_found() {
        let truth = NoiseModel { read: 4e-6, shot: 2e-5 };
        let found = NoiseModel::from_frames(&frames(20, truth, 0.0).iter().collect::<Vec<_>>(), &all()).unwrap();
        for level in [0.1, 0.4, 0.7] {
            let ratio = found.sigma(level) / truth.sigma(level);
            assert!((ratio - 1.0).abs() < 0.03, "level {level}: {ratio}");
        }
        assert!(NoiseModel::from_frames(&frames(1, truth, 0.0).iter().collect::<Vec<_>>(), &all()).is_none());
    }

    #[test]
    fn a_single_difference_tells_its_noise() {
        let truth = NoiseModel { read: 1e-6, shot: 0.0 };
        let found = NoiseModel::from_texture(&frames(1, truth, 0.0)[0]);
        assert!((found.sigma(0.5) / 1e-3 - 1.0).abs() < 0.05, "{found:?}");
    }
}
