use crate::geometry::Side;
use crate::light::PatchPair;

/// Cells along each side of a patch.
const CELLS: usize = 4;

/// A coarse summary of a patch pair: each colour's mean light in the 16 cells of each patch, relative to that of the
/// whole patch, so that a gain or flicker has no effect. Averaging removes noise but not the effect of somebody in the
/// room, because the light of the room is smooth on the floor.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Cells(Vec<f32>);

impl Cells {
    /// Summarises the pixels that count.
    pub fn of(pair: &PatchPair, counted: &[Vec<bool>; 2]) -> Self {
        let mut cells = Vec::with_capacity(2 * 3 * CELLS * CELLS);
        for (s, side) in Side::BOTH.into_iter().enumerate() {
            let size = pair.side(side).size();
            for channel in 0..3 {
                let mut sums = [(0.0_f64, 0.0_f64); CELLS * CELLS];
                for (k, value) in pair.side(side).plane(channel).iter().enumerate().filter(|&(k, _)| counted[s][k]) {
                    let cell = (k / size * CELLS / size) * CELLS + k % size * CELLS / size;
                    sums[cell].0 += f64::from(*value);
                    sums[cell].1 += 1.0;
                }
                let (light, count) = sums.iter().fold((0.0, 0.0), |(l, n), (light, count)| (l + light, n + count));
                let whole = if count > 0.0 { light / count } else { 0.0 };
                // A cell with few pixels that count is noisier than the others and would mask them.
                let enough = |count: f64| count >= 0.5 * (size * size / (CELLS * CELLS)) as f64;
                let relative = |&(light, n): &(f64, f64)| {
                    if enough(n) && whole > 0.0 { (light / n / whole - 1.0) as f32 } else { 0.0 }
                };
                cells.extend(sums.iter().map(relative));
            }
        }
        Self(cells)
    }

    /// Mean square difference.
    pub fn distance2(&self, other: &Self) -> f64 {
        let squares = self.0.iter().zip(&other.0).map(|(a, b)| f64::from(a - b).powi(2));
        squares.sum::<f64>() / self.0.len().max(1) as f64
    }
}

/// Variance of the cells due to noise alone: half the median squared difference of successive moments, to which motion
/// adds little.
pub(super) fn noise_variance<'a>(moments: impl Iterator<Item = &'a Cells> + Clone) -> f64 {
    let mut steps: Vec<f64> = moments.clone().zip(moments.skip(1)).map(|(a, b)| a.distance2(b) / 2.0).collect();
    let middle = steps.len() / 2;
    if steps.is_empty() { 0.0 } else { *steps.select_nth_unstable_by(middle, f64::total_cmp).1 }
}

/// Variance of the cells over all moments, in units of [`noise_variance`]: about 1 if nothing moves.
pub(super) fn restlessness<'a>(moments: impl Iterator<Item = &'a Cells> + Clone) -> f64 {
    let count = moments.clone().count();
    let noise = noise_variance(moments.clone());
    let Some(first) = moments.clone().next().filter(|_| count > 2) else {
        return f64::INFINITY;
    };
    let mut mean = vec![0.0; first.0.len()];
    for Cells(cells) in moments.clone() {
        mean.iter_mut().zip(cells).for_each(|(mean, v)| *mean += f64::from(*v) / count as f64);
    }
    let square = |Cells(cells): &Cells| cells.iter().zip(&mean).map(|(v, m)| (f64::from(*v) - m).powi(2)).sum::<f64>();
    let variance = moments.map(square).sum::<f64>() / ((count - 1) * mean.len().max(1)) as f64;
    // Identical frames have no noise to compare with, and nothing moves in them.
    if variance <= f64::from(f32::EPSILON).powi(2) { 1.0 } else { variance / noise }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::noise::tests::{all, frames};
    use crate::light::{NoiseModel, PatchPair};

    fn cells(frames: &[PatchPair]) -> Vec<Cells> {
        frames.iter().map(|f| Cells::of(f, &all())).collect()
    }

    #[test]
    fn noise_is_still_and_what_moves_is_not() {
        let noise = NoiseModel { read: 1e-5, shot: 0.0 };
        let still = restlessness(cells(&frames(30, noise, 0.0)).iter());
        assert!((0.8..1.3).contains(&still), "{still}");
        // A slowly growing pattern, weaker than the noise of one pixel.
        let moving = restlessness(cells(&frames(30, noise, 0.002)).iter());
        assert!(moving > 2.0, "{moving}");
    }

    #[test]
    fn equal_frames_are_still() {
        let frame = frames(1, NoiseModel { read: 0.0, shot: 0.0 }, 0.0).remove(0);
        assert_eq!(restlessness(cells(&vec![frame; 5]).iter()), 1.0);
        assert_eq!(restlessness([].iter()), f64::INFINITY);
    }

    #[test]
    fn a_gain_changes_nothing() {
        let frame = frames(1, NoiseModel { read: 0.0, shot: 0.0 }, 0.0).remove(0);
        let mut brighter = frame.clone();
        brighter.left.data_mut().iter_mut().for_each(|v| *v *= 1.2);
        assert!(Cells::of(&frame, &all()).distance2(&Cells::of(&brighter, &all())) < 1e-12);
    }
}
