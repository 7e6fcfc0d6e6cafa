use std::collections::VecDeque;

use serde::{Deserialize, Serialize};

use crate::geometry::Side;
use crate::light::PatchPair;

/// How frames are averaged over time, before the background is subtracted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[serde(rename_all = "lowercase")]
pub enum Averaging {
    /// Each frame by itself.
    #[default]
    None,
    /// Weights fall off with age as exp(−age / time); the mean age is `time`.
    Exponential,
    /// Equal weights for the frames of the last `time`; the mean age is half of it.
    Boxcar,
}

/// Most frames that a boxcar holds; a limit on memory.
const MOST: usize = 256;
/// A pause between frames restarts the average if it is longer than this many seconds, than the averaging time, and than
/// [`PAUSE`] usual intervals.
const GAP_S: f64 = 1.0;
/// A pause is longer than this many usual intervals: a slow or busy camera's frames come unevenly, but none is missing.
const PAUSE: f64 = 4.0;
/// Number of intervals from which the usual one is known.
const INTERVALS: usize = 9;
/// Relative change of a patch's total light between frames that restarts the average. Nobody walking can cause it.
const JUMP: f64 = 0.05;

/// A running average of patch pairs: less noise for more latency.
///
/// It restarts when frames are missing, when time runs backwards (a recording that restarts) and when the light jumps,
/// so that no average mixes frames from before and after. Until it is full again it is noisier, by the factor
/// [`Averager::excess`].
#[derive(Debug, Clone)]
pub struct Averager {
    mode: Averaging,
    time_s: f64,
    mean: PatchPair,
    /// Boxcar: the frames in the window with their times, oldest first.
    frames: VecDeque<(f64, PatchPair)>,
    /// Boxcar: unused buffers.
    spare: Vec<PatchPair>,
    /// Boxcar: sum of the frames in the window, per side.
    sums: [Vec<f64>; 2],
    last: Option<Last>,
    /// Frames since the last restart.
    count: u64,
    /// Variance of the average for frames of unit variance.
    variance: f64,
    /// The last seconds between frames, in no particular order, and how many there have been.
    intervals: ([f64; INTERVALS], usize),
    /// Usual seconds between frames; `None` until known.
    rhythm_s: Option<f64>,
}

#[derive(Debug, Clone, Copy)]
struct Last {
    seconds: f64,
    light: [f64; 2],
}

impl Averager {
    /// An averager for patches of `size` x `size` pixels, over `time_s` seconds.
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
            intervals: ([0.0; INTERVALS], 0),
            rhythm_s: None,
        }
    }

    /// Seconds between two averages whose noise is independent because they share hardly any frames. Noise must be
    /// measured on averages at least this far apart.
    pub fn independent_s(&self) -> f64 {
        match self.mode {
            Averaging::None => 0.0,
            Averaging::Exponential => 2.0 * self.time_s,
            Averaging::Boxcar => self.time_s,
        }
    }

    /// Standard deviation of this average relative to that of a full one: 1 once it is full.
    pub fn excess(&self) -> f64 {
        if self.mode == Averaging::None {
            return 1.0;
        }
        // Variance of a full average at the usual frame interval, or a first guess until that is known.
        let full = match (self.mode, self.rhythm_s) {
            (_, None) => 0.25,
            (Averaging::Boxcar, Some(step)) => (self.time_s / step).round().clamp(1.0, MOST as f64).recip(),
            (_, Some(step)) => {
                let share = 1.0 - (-step / self.time_s).exp();
                share / (2.0 - share)
            }
        };
        let ratio = (self.variance / full).sqrt();
        // Capture jitter changes the number of frames slightly; that needs no correction.
        if ratio < 1.05 { 1.0 } else { ratio }
    }

    /// The kind of averaging and its time, in seconds.
    pub fn kind(&self) -> (Averaging, f64) {
        (self.mode, if self.mode == Averaging::None { 0.0 } else { self.time_s })
    }

    /// Restarts the average with the next frame.
    pub fn restart(&mut self) {
        self.last = None;
    }

    /// Adds a frame, captured at `seconds` on the source's clock, and returns the average and its [`Averager::excess`].
    /// Allocates nothing once the average has been full.
    pub fn push<'a>(&'a mut self, pair: &'a PatchPair, seconds: f64) -> (&'a PatchPair, f64) {
        if self.mode == Averaging::None {
            return (pair, 1.0);
        }
        let light = light(pair);
        let step = self.last.map(|last| seconds - last.seconds);
        if let Some(step) = step.filter(|step| *step > 0.0) {
            self.note_interval(step);
        }
        let usual = self.rhythm_s.unwrap_or(0.0);
        let gap = step.is_none_or(|step| step <= 0.0 || step > self.time_s.max(GAP_S).max(PAUSE * usual));
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
        self.count += 1;
        match self.mode {
            Averaging::None => {}
            Averaging::Exponential => self.fade(pair, step),
            Averaging::Boxcar => self.slide(pair, seconds, step),
        }
        let excess = self.excess();
        (&self.mean, excess)
    }

    /// Learns the usual interval: the mean of the last ones without pauses.
    fn note_interval(&mut self, step: f64) {
        let (intervals, count) = &mut self.intervals;
        intervals[*count % INTERVALS] = step;
        *count += 1;
        let mut sorted = *intervals;
        let known = &mut sorted[..INTERVALS.min(*count)];
        known.sort_unstable_by(f64::total_cmp);
        let median = known[(known.len() - 1) / 2];
        let usual = known.iter().filter(|step| **step <= PAUSE * median);
        let (sum, number) = usual.fold((0.0, 0), |(sum, number), step| (sum + step, number + 1));
        self.rhythm_s = Some(sum / f64::from(number.max(1)));
    }

    fn fade(&mut self, pair: &PatchPair, step: f64) {
        let fading = 1.0 - (-step / self.time_s).exp();
        // The first frames get equal weights, until an equal weight falls below the exponential one.
        let share = if self.count == 1 { 1.0 } else { fading.max(1.0 / self.count as f64) };
        self.variance = (1.0 - share).powi(2) * self.variance + share * share;
        blend(&mut self.mean, pair, share as f32);
    }

    fn slide(&mut self, pair: &PatchPair, seconds: f64, step: f64) {
        // Half a step of slack, so that rounding does not change the number of evenly spaced frames in the window.
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

/// Moves `mean` towards `pair` by the fraction `share` of their difference.
pub(super) fn blend(mean: &mut PatchPair, pair: &PatchPair, share: f32) {
    for side in Side::BOTH {
        let values = mean.side_mut(side).data_mut().iter_mut();
        // In this form, a share of 1 gives exactly the new value, whatever the mean was.
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
    // Summed in blocks, so that f32 is precise enough for a few hundred thousand values.
    let sum = |side: Side| pair.side(side).data().chunks(512).map(|c| f64::from(c.iter().sum::<f32>())).sum();
    Side::BOTH.map(sum)
}

#[cfg(test)]
#[path = "averaging_tests.rs"]
mod tests;
