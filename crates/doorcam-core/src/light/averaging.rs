use std::collections::VecDeque;

use serde::{Deserialize, Serialize};

use crate::geometry::Side;
use crate::light::PatchPair;

/// How frames are averaged in time, before anything is subtracted from them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[serde(rename_all = "lowercase")]
pub enum Averaging {
    /// Each frame by itself.
    #[default]
    None,
    /// Each frame's weight falls off with its age as exp(−age / time): a frame is `time` old on average.
    Exponential,
    /// The frames of the last `time` count alike: a frame is half of it old on average.
    Boxcar,
}

/// Frames that a boxcar holds at most: a bound on memory, not on what is useful.
const MOST: usize = 256;
/// Seconds without a frame that break off every average, even a longer one.
const GAP_S: f64 = 1.0;
/// A change of a patch's whole light from one frame to the next that nobody who walks can make.
const JUMP: f64 = 0.05;

/// A running average of patch pairs: noise for latency.
///
/// It begins anew when frames are missing, when time runs backwards (a recording that starts again) and when the light
/// jumps: no average mixes what was before with what is after. Until it is full again, it is noisier than it will be, by
/// [`Averager::excess`].
#[derive(Debug, Clone)]
pub struct Averager {
    mode: Averaging,
    time_s: f64,
    mean: PatchPair,
    /// Boxcar: the frames that count, oldest first, and their sum per side.
    frames: VecDeque<(f64, PatchPair)>,
    spare: Vec<PatchPair>,
    sums: [Vec<f64>; 2],
    last: Option<Last>,
    /// Frames since it began.
    count: u64,
    /// Variance of the average for frames of unit variance.
    variance: f64,
    /// Seconds from frame to frame, where none are missing; none before that is known.
    rhythm_s: Option<f64>,
}

#[derive(Debug, Clone, Copy)]
struct Last {
    seconds: f64,
    light: [f64; 2],
}

impl Averager {
    /// Of patches of `size` x `size` pixels, over `time_s` seconds.
    pub fn new(mode: Averaging, time_s: f64, size: usize) -> Self {
        let sums = if mode == Averaging::Boxcar { 3 * size * size } else { 0 };
        Self {
            mode,
            time_s,
            mean: PatchPair::zeros(size),
            frames: VecDeque::new(),
            spare: Vec::new(),
            sums: [vec![0.0; sums], vec![0.0; sums]],
            last: None,
            count: 0,
            variance: 1.0,
            rhythm_s: None,
        }
    }

    /// Seconds between two averages that have hardly a frame in common, so that their noise is independent: what is
    /// measured about noise must be measured on averages so far apart.
    pub fn independent_s(&self) -> f64 {
        match self.mode {
            Averaging::None => 0.0,
            Averaging::Exponential => 2.0 * self.time_s,
            Averaging::Boxcar => self.time_s,
        }
    }

    /// How many times the standard deviation of a full average this one has: 1 once it is full.
    pub fn excess(&self) -> f64 {
        if self.mode == Averaging::None {
            return 1.0;
        }
        // With frames at the usual rhythm; until that is known, a first guess.
        let full = match (self.mode, self.rhythm_s) {
            (_, None) => 0.25,
            (Averaging::Boxcar, Some(step)) => (self.time_s / step).round().clamp(1.0, MOST as f64).recip(),
            (_, Some(step)) => {
                let share = 1.0 - (-step / self.time_s).exp();
                share / (2.0 - share)
            }
        };
        let ratio = (self.variance / full).sqrt();
        // A few frames more or less, as capture jitters, are nothing to correct for.
        if ratio < 1.05 { 1.0 } else { ratio }
    }

    /// What it does, and over how many seconds.
    pub fn kind(&self) -> (Averaging, f64) {
        (self.mode, if self.mode == Averaging::None { 0.0 } else { self.time_s })
    }

    /// Begins anew with the next frame.
    pub fn restart(&mut self) {
        self.last = None;
    }

    /// Adds a frame, captured at `seconds` on the source's clock, and gives the average and its [`Averager::excess`]. Once it
    /// has been full, it allocates nothing.
    pub fn push<'a>(&'a mut self, pair: &'a PatchPair, seconds: f64) -> (&'a PatchPair, f64) {
        if self.mode == Averaging::None {
            return (pair, 1.0);
        }
        let light = light(pair);
        let step = self.last.map(|last| seconds - last.seconds);
        let gap = step.is_none_or(|step| step <= 0.0 || step > self.time_s.max(GAP_S));
        let jumped = self.last.is_some_and(|last| {
            light.iter().zip(last.light).any(|(now, before)| (now - before).abs() > JUMP * before.abs())
        });
        self.last = Some(Last { seconds, light });
        let step = step.unwrap_or(0.0);
        if gap || jumped {
            self.count = 0;
            self.spare.extend(self.frames.drain(..).map(|(_, pair)| pair));
            self.sums.iter_mut().for_each(|sums| sums.fill(0.0));
        }
        if !gap {
            // Smoothed: capture jitters.
            self.rhythm_s = Some(self.rhythm_s.map_or(step, |rhythm| rhythm + 0.2 * (step - rhythm)));
        }
        self.count += 1;
        match self.mode {
            Averaging::None => {}
            Averaging::Exponential => self.fade(pair, step),
            Averaging::Boxcar => self.slide(pair, seconds, step),
        }
        let excess = self.excess();
        (&self.mean, excess)
    }

    fn fade(&mut self, pair: &PatchPair, step: f64) {
        let fading = 1.0 - (-step / self.time_s).exp();
        // The first frames count alike, until one more would weigh less than it shall.
        let share = if self.count == 1 { 1.0 } else { fading.max(1.0 / self.count as f64) };
        self.variance = (1.0 - share).powi(2) * self.variance + share * share;
        blend(&mut self.mean, pair, share as f32);
    }

    fn slide(&mut self, pair: &PatchPair, seconds: f64, step: f64) {
        // Half a step of slack: with frames at even times, the number in the window must not hang on rounding.
        let old = |(t, _): &mut (f64, PatchPair)| seconds - *t >= self.time_s - step / 2.0;
        while self.frames.len() >= MOST || self.frames.front_mut().is_some_and(old) {
            let Some((_, gone)) = self.frames.pop_front() else { break };
            add(&mut self.sums, &gone, -1.0);
            self.spare.push(gone);
        }
        add(&mut self.sums, pair, 1.0);
        let mut kept = self.spare.pop().unwrap_or_else(|| pair.clone());
        kept.copy_from(pair);
        self.frames.push_back((seconds, kept));
        let count = self.frames.len() as f64;
        self.variance = 1.0 / count;
        for (sums, side) in self.sums.iter().zip(Side::BOTH) {
            let values = self.mean.side_mut(side).data_mut().iter_mut();
            values.zip(sums).for_each(|(mean, sum)| *mean = (sum / count) as f32);
        }
    }
}

/// Moves `mean` towards `pair` by a share of their difference.
pub(super) fn blend(mean: &mut PatchPair, pair: &PatchPair, share: f32) {
    for side in Side::BOTH {
        let values = mean.side_mut(side).data_mut().iter_mut();
        // From a mean of whatever was before, the whole way must lead exactly to the new value.
        values.zip(pair.side(side).data()).for_each(|(mean, x)| *mean = *mean * (1.0 - share) + share * x);
    }
}

fn add(sums: &mut [Vec<f64>; 2], pair: &PatchPair, factor: f64) {
    for (sums, side) in sums.iter_mut().zip(Side::BOTH) {
        sums.iter_mut().zip(pair.side(side).data()).for_each(|(sum, x)| *sum += factor * f64::from(*x));
    }
}

/// Sum of each patch's light.
fn light(pair: &PatchPair) -> [f64; 2] {
    // In blocks, so that the sums of a few hundred thousand numbers may be made in f32.
    let sum = |side: Side| pair.side(side).data().chunks(512).map(|c| f64::from(c.iter().sum::<f32>())).sum();
    Side::BOTH.map(sum)
}

#[cfg(test)]
#[path = "averaging_tests.rs"]
mod tests;
