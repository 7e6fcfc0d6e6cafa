use crate::light::PatchPair;
use crate::light::rolling::KEPT;

/// The empty room's patch pair x_0 of eq. 4: the mean of the learned frames.
#[derive(Debug, Clone)]
pub struct Background {
    sums: [Vec<f64>; 2],
    frames: u64,
    mean: PatchPair,
    kept: Vec<PatchPair>,
}

impl Background {
    /// An empty background for patches of `size` x `size` pixels.
    pub fn new(size: usize) -> Self {
        let mean = PatchPair::zeros(size);
        let zeros = || vec![0.0; mean.left.data().len()];
        Self { sums: [zeros(), zeros()], frames: 0, mean, kept: Vec::new() }
    }

    /// A background with a given mean of `frames` frames, and frames for its statistics.
    pub(super) fn known(mean: PatchPair, frames: u64, kept: Vec<PatchPair>) -> Self {
        let sums = |patch: &super::Patch| patch.data().iter().map(|&v| f64::from(v) * frames as f64).collect();
        Self { sums: [sums(&mean.left), sums(&mean.right)], frames, mean, kept }
    }

    /// Adds a frame of the empty room.
    pub fn learn(&mut self, pair: &PatchPair) {
        self.frames += 1;
        if self.kept.len() < KEPT {
            self.kept.push(pair.clone());
        }
        for (sums, (patch, mean)) in
            self.sums.iter_mut().zip([(&pair.left, &mut self.mean.left), (&pair.right, &mut self.mean.right)])
        {
            for ((sum, value), mean) in sums.iter_mut().zip(patch.data()).zip(mean.data_mut()) {
                *sum += f64::from(*value);
                *mean = (*sum / self.frames as f64) as f32;
            }
        }
    }

    /// Number of frames learned.
    pub fn frames(&self) -> u64 {
        self.frames
    }

    /// The mean of the frames learned; zeros before the first.
    pub fn mean(&self) -> &PatchPair {
        &self.mean
    }

    /// Frames kept for their statistics: the first ones learned.
    pub fn kept(&self) -> &[PatchPair] {
        &self.kept
    }

    /// Writes y = x_t − x_0 (eq. 4) into `out`. Before the first frame is learned, it writes nothing and returns false.
    pub fn difference(&self, pair: &PatchPair, out: &mut PatchPair) -> bool {
        if self.frames > 0 {
            pair.subtract(&self.mean, out);
        }
        self.frames > 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_difference_is_against_the_mean() {
        let filled = |v: f32| {
            let mut pair = PatchPair::zeros(4);
            pair.left.data_mut().fill(v);
            pair.right.data_mut().fill(2.0 * v);
            pair
        };
        let mut background = Background::new(4);
        let mut y = PatchPair::zeros(4);
        assert!(!background.difference(&filled(1.0), &mut y) && background.frames() == 0);
        for v in [0.25, 0.5, 0.75] {
            background.learn(&filled(v));
        }
        assert!(background.difference(&filled(0.75), &mut y));
        assert_eq!((background.frames(), y), (3, filled(0.25)));
    }
}
