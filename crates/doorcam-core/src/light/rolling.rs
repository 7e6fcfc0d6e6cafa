use std::collections::VecDeque;
use std::sync::Arc;

use crate::geometry::Side;
use crate::light::averaging::blend;
use crate::light::{Background, Patch, PatchPair};

/// Number of frames of the empty room that are kept for their statistics.
pub(super) const KEPT: usize = 64;

/// The empty room's picture, tracked over time: the mean of each pixel and the frames' deviations from it.
///
/// Deviations are kept as whole frames, at most 64, spread evenly over the time constant of the mean. They give each
/// pixel's variance, the correlation of noise between neighbours, and the drift patterns of the lamps. Each is taken
/// from the mean at its own time, with each colour's gain removed, so that slow drift and flicker, which are harmless,
/// do not count as noise.
#[derive(Debug, Clone)]
pub struct RollingBackground {
    mean: PatchPair,
    /// Number of equally weighted frames that would give a mean with the same noise.
    averaged: f64,
    deviations: VecDeque<Arc<PatchPair>>,
    /// Seconds since the last deviation was kept.
    since_kept_s: f64,
}

/// A rolling background at one moment; cheap to make, for work on other threads.
#[derive(Debug, Clone)]
pub struct Snapshot {
    pub(super) mean: PatchPair,
    pub(super) averaged: f64,
    pub(super) deviations: Vec<Arc<PatchPair>>,
}

impl RollingBackground {
    /// Starts from a learned background.
    pub fn from_background(background: &Background) -> Self {
        let mean = background.mean().clone();
        let deviation = |frame: &PatchPair| {
            let mut out = PatchPair::zeros(frame.left.size());
            deviation(frame, &mean, &mut out);
            Arc::new(out)
        };
        let deviations = background.kept().iter().map(deviation).collect();
        Self { averaged: background.frames() as f64, deviations, since_kept_s: 0.0, mean }
    }

    /// Starts from a single picture, without any noise statistics.
    pub fn from_picture(mean: PatchPair) -> Self {
        Self { mean, averaged: 1.0, deviations: VecDeque::new(), since_kept_s: 0.0 }
    }

    /// The mean picture of the empty room.
    pub fn mean(&self) -> &PatchPair {
        &self.mean
    }

    /// Number of equally weighted frames that would give a mean with the same noise.
    pub fn averaged(&self) -> f64 {
        self.averaged
    }

    /// Adapts to a frame of the empty room, `step_s` seconds after the previous one, with a time constant of `adapt_s`
    /// seconds. Allocates nothing once all deviations are filled, unless a snapshot still holds the oldest.
    pub fn adapt(&mut self, pair: &PatchPair, step_s: f64, adapt_s: f64) {
        self.since_kept_s += step_s.max(0.0);
        if self.deviations.len() < KEPT || self.since_kept_s >= adapt_s / KEPT as f64 {
            self.since_kept_s = 0.0;
            let oldest = if self.deviations.len() == KEPT { self.deviations.pop_front() } else { None };
            let mut kept = oldest.unwrap_or_else(|| Arc::new(PatchPair::zeros(pair.left.size())));
            // A snapshot may still hold it.
            if Arc::get_mut(&mut kept).is_none() {
                kept = Arc::new(PatchPair::zeros(pair.left.size()));
            }
            // A frame equal to the mean, as in a looped recording, says nothing about noise.
            if Arc::get_mut(&mut kept).is_some_and(|kept| deviation(pair, &self.mean, kept)) {
                self.deviations.push_back(kept);
            }
        }
        self.follow(pair, step_s, adapt_s);
    }

    /// Number of deviations kept for estimating noise.
    pub fn deviations(&self) -> usize {
        self.deviations.len()
    }

    /// Adapts only the mean to a frame; the noise statistics stay unchanged.
    pub fn follow(&mut self, pair: &PatchPair, step_s: f64, adapt_s: f64) {
        let fading = 1.0 - (-step_s.max(0.0) / adapt_s).exp();
        let share = fading.max(1.0 / (self.averaged + 1.0));
        self.averaged = ((1.0 - share).powi(2) / self.averaged + share * share).recip();
        blend(&mut self.mean, pair, share as f32);
    }

    /// Replaces the mean by a picture averaged from `averaged` frames; the noise statistics stay unchanged.
    pub fn replace(&mut self, mean: &PatchPair, averaged: f64) {
        self.mean.copy_from(mean);
        self.averaged = averaged.max(1.0);
    }

    /// Replaces one side's `pixels` by those of `picture`, averaged from `averaged` frames: something lies on the floor
    /// there. Its noise is taken for the floor's, which light in another amount makes larger or smaller.
    pub fn replace_pixels(&mut self, side: Side, pixels: &[bool], picture: &Patch, averaged: f64) {
        let mean = self.mean.side_mut(side);
        for channel in 0..3 {
            let (new, old) = (picture.plane(channel), mean.plane_mut(channel));
            for deviation in &mut self.deviations {
                let deviation = Arc::make_mut(deviation).side_mut(side).plane_mut(channel);
                for k in (0..pixels.len()).filter(|&k| pixels[k]) {
                    deviation[k] *= photon_noise(new[k], old[k]);
                }
            }
            (0..pixels.len()).filter(|&k| pixels[k]).for_each(|k| old[k] = new[k]);
        }
        self.averaged = self.averaged.min(averaged.max(1.0));
    }

    /// One of the kept deviations, in turn; none if there are none.
    pub fn deviation(&self, turn: usize) -> Option<&PatchPair> {
        self.deviations.get(turn % self.deviations.len().max(1)).map(Arc::as_ref)
    }

    /// The noise on each side, left and right: standard deviation of a pixel's grey level, from the kept deviations; 0
    /// without any.
    pub fn noise(&self) -> [f64; 2] {
        Side::BOTH.map(|side| {
            let of_frame = |deviation: &Arc<PatchPair>| {
                let [r, g, b] = [0, 1, 2].map(|p| deviation.side(side).plane(p));
                let squares = r.iter().zip(g).zip(b).map(|((r, g), b)| f64::from((r + g + b) / 3.0).powi(2));
                squares.sum::<f64>() / r.len().max(1) as f64
            };
            (self.deviations.iter().map(of_frame).sum::<f64>() / self.deviations.len().max(1) as f64).sqrt()
        })
    }

    /// A snapshot of the current state.
    pub fn snapshot(&self) -> Snapshot {
        let Self { mean, averaged, deviations, .. } = self;
        Snapshot { mean: mean.clone(), averaged: *averaged, deviations: deviations.iter().cloned().collect() }
    }
}

impl From<Snapshot> for RollingBackground {
    fn from(Snapshot { mean, averaged, deviations }: Snapshot) -> Self {
        Self { mean, averaged, deviations: deviations.into(), since_kept_s: 0.0 }
    }
}

impl Snapshot {
    /// The mean picture of the empty room.
    pub fn mean(&self) -> &PatchPair {
        &self.mean
    }

    /// Converts to a [`Background`], from which a problem can be built.
    pub fn background(&self) -> Background {
        let frame = |deviation: &Arc<PatchPair>| {
            let mut frame = self.mean.clone();
            for side in Side::BOTH {
                let values = frame.side_mut(side).data_mut().iter_mut();
                values.zip(deviation.side(side).data()).for_each(|(value, d)| *value += d);
            }
            frame
        };
        Background::known(self.mean.clone(), self.averaged.round() as u64, self.deviations.iter().map(frame).collect())
    }
}

/// How much more noise photons make at the level `new` than at `old`; within bounds, as a dark pixel has other noise.
fn photon_noise(new: f32, old: f32) -> f32 {
    if old > 0.0 { (new.max(0.0) / old).sqrt().clamp(0.25, 4.0) } else { 1.0 }
}

/// Writes x / g − mean into `out`, with a least-squares gain g per patch and colour; false if the result is exactly 0.
fn deviation(x: &PatchPair, mean: &PatchPair, out: &mut PatchPair) -> bool {
    let mut any = false;
    for side in Side::BOTH {
        for channel in 0..3 {
            let (x, mean) = (x.side(side).plane(channel), mean.side(side).plane(channel));
            let (mut both, mut square) = (0.0, 0.0);
            for (x, mean) in x.iter().zip(mean) {
                both += f64::from(*x) * f64::from(*mean);
                square += f64::from(*mean) * f64::from(*mean);
            }
            let inverse = if both > 0.0 && square > 0.0 { (square / both) as f32 } else { 1.0 };
            let values = out.side_mut(side).plane_mut(channel).iter_mut();
            values.zip(x.iter().zip(mean)).for_each(|(out, (x, mean))| {
                *out = x * inverse - mean;
                any |= *out != 0.0;
            });
        }
    }
    any
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::NoiseModel;
    use crate::light::noise::tests::{all, frames};

    const NOISE: NoiseModel = NoiseModel { read: 1e-6, shot: 0.0 };

    fn rolling(frames: &[PatchPair]) -> RollingBackground {
        let mut background = Background::new(frames[0].left.size());
        frames.iter().for_each(|frame| background.learn(frame));
        RollingBackground::from_background(&background)
    }

    fn scaled(pair: &PatchPair, factor: f32) -> PatchPair {
        let mut pair = pair.clone();
        Side::BOTH.iter().for_each(|&s| pair.side_mut(s).data_mut().iter_mut().for_each(|v| *v *= factor));
        pair
    }

    fn rms(a: &Patch, b: &Patch) -> f64 {
        (a.data().iter().zip(b.data()).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>() / a.data().len() as f64)
            .sqrt()
    }

    #[test]
    fn a_step_of_light_is_followed_by_time_and_not_by_frames() {
        let still = frames(16, NoiseModel { read: 0.0, shot: 0.0 }, 0.0);
        for fps in [1.0, 10.0] {
            let mut rolling = rolling(&still);
            // Run for long enough that only the time constant matters.
            (0..300 * fps as usize).for_each(|_| rolling.adapt(&still[0], 1.0 / fps, 60.0));
            let brighter = scaled(&still[0], 1.1);
            (0..60 * fps as usize).for_each(|_| rolling.adapt(&brighter, 1.0 / fps, 60.0));
            let gone = f64::from(rolling.mean().left.data()[5] / still[0].left.data()[5]) - 1.0;
            assert!((gone / 0.1 - (1.0 - (-1.0_f64).exp())).abs() < 0.01, "{fps} fps: {gone}");
        }
    }

    #[test]
    fn the_mean_is_as_good_as_the_number_of_frames_says() {
        let truth = &frames(1, NoiseModel { read: 0.0, shot: 0.0 }, 0.0)[0];
        let noisy = frames(400, NOISE, 0.0);
        let mut rolling = rolling(&noisy[..10]);
        for (k, frame) in noisy[10..].iter().enumerate() {
            rolling.adapt(frame, 0.2, 10.0);
            if [0, 20, 389].contains(&k) {
                let expected = NOISE.read.sqrt() / rolling.averaged().sqrt();
                let found = rms(&rolling.mean().left, &truth.left);
                assert!((found / expected - 1.0).abs() < 0.1, "{k}: {found}, expected {expected}");
            }
        }
        assert!((80.0..120.0).contains(&rolling.averaged()), "{}", rolling.averaged());
    }

    #[test]
    fn neither_flicker_nor_slow_drift_passes_for_noise() {
        let noisy = frames(200, NOISE, 0.0);
        let mut rolling = rolling(&noisy[..16]);
        for (k, frame) in noisy[16..].iter().enumerate() {
            let flicker = [1.0, 1.03, 0.98][k % 3] * (1.0 + 0.0002 * k as f32);
            rolling.adapt(&scaled(frame, flicker), 0.5, 20.0);
        }
        let background = rolling.snapshot().background();
        assert_eq!(background.kept().len(), KEPT);
        let found = NoiseModel::from_frames(&background.kept().iter().collect::<Vec<_>>(), &all()).unwrap();
        let ratio = found.sigma(0.4) / NOISE.sigma(0.4);
        assert!((ratio - 1.0).abs() < 0.06, "{ratio}");
    }

    #[test]
    fn a_replaced_picture_keeps_the_noise() {
        let noisy = frames(32, NOISE, 0.0);
        let mut rolling = rolling(&noisy);
        let chair = scaled(&noisy[0], 0.9);
        rolling.replace(&chair, 4.0);
        let background = rolling.snapshot().background();
        assert_eq!((background.mean(), background.frames()), (&chair, 4));
        let found = NoiseModel::from_frames(&background.kept().iter().collect::<Vec<_>>(), &all()).unwrap();
        assert!((found.sigma(0.4) / NOISE.sigma(0.4) - 1.0).abs() < 0.03);
    }

    #[test]
    fn replaced_pixels_have_the_noise_of_their_light_and_the_others_stay_as_they_are() {
        let photons = NoiseModel { read: 0.0, shot: 1e-5 };
        let noisy = frames(32, photons, 0.0);
        let mut rolling = rolling(&noisy);
        let before = rolling.clone();
        let pixels: Vec<bool> = (0..noisy[0].left.pixels()).map(|k| k % 3 == 0).collect();
        // A dark thing, with a ninth of the light.
        let dark = scaled(before.mean(), 1.0 / 9.0);
        let shared = rolling.snapshot();
        rolling.replace_pixels(Side::Left, &pixels, &dark.left, 8.0);
        assert_eq!((rolling.averaged(), rolling.mean().right.clone()), (8.0, before.mean().right.clone()));
        for (k, &replaced) in pixels.iter().enumerate() {
            let expected = if replaced { dark.left.plane(1)[k] } else { before.mean().left.plane(1)[k] };
            assert_eq!(rolling.mean().left.plane(1)[k], expected);
            let deviation = |rolling: &RollingBackground| rolling.deviation(5).unwrap().left.plane(1)[k];
            let expected = deviation(&before) * if replaced { 1.0 / 3.0 } else { 1.0 };
            assert!((deviation(&rolling) - expected).abs() < 1e-7);
        }
        assert_eq!(shared.mean(), before.mean(), "a snapshot is not changed");
        let [left, right] = rolling.noise();
        assert!(left < right && (right / (photons.sigma(0.4) / 3.0_f64.sqrt()) - 1.0).abs() < 0.1, "{left} {right}");
    }
}
