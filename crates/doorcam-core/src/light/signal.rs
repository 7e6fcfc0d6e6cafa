use crate::geometry::Side;
use crate::light::{PatchPair, Sensing};

/// Strength of the change on a patch relative to the camera's noise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Signal {
    /// Power of the change over that of the noise, per pixel and colour; 0 if there is only noise.
    pub snr: f64,
    /// RMS of the change without the noise, relative to the mean light of the still patch.
    pub change: f64,
    /// Standard deviation of one pixel's difference, relative to the mean light of the still patch.
    pub noise: f64,
}

impl Signal {
    /// The signal in a difference measurement, per side; `None` for a side without pixels that count.
    ///
    /// In each colour, the fit of even light and a gain ({1, x0}) is subtracted first, as in the signed model: neither
    /// says anything about the hidden room.
    pub fn of(difference: &PatchPair, sensing: &Sensing) -> [Option<Self>; 2] {
        [0, 1].map(|s| Self::of_side(difference, sensing, s))
    }

    fn of_side(difference: &PatchPair, sensing: &Sensing, s: usize) -> Option<Self> {
        let side = Side::BOTH[s];
        let (mut power, mut counted, mut free, mut level, mut variance) = (0.0, 0, 0, 0.0, 0.0);
        for channel in 0..3 {
            let still = sensing.still.side(side).plane(channel);
            let change = difference.side(side).plane(channel);
            let samples = || {
                let all = sensing.weights[s].iter().zip(still).zip(change);
                all.filter(|((w, _), _)| **w > 0.0).map(|((w, x0), y)| (*w, f64::from(*x0), f64::from(*y)))
            };
            let Some([veil, gain]) = nuisance(samples()) else { continue };
            for (w, x0, y) in samples() {
                power += (w * (y - veil - gain * x0)).powi(2);
                level += x0;
                variance += w.powi(-2);
                counted += 1;
            }
            free += samples().count().saturating_sub(2);
        }
        if free == 0 || level <= 0.0 {
            return None;
        }
        let (mean, noise) = (level / f64::from(counted), (variance / f64::from(counted)).sqrt());
        let snr = (power / free as f64 - 1.0).max(0.0);
        Some(Self { snr, change: snr.sqrt() * noise / mean, noise: noise / mean })
    }
}

/// Weighted least-squares fit (a, b) of a + b·x0 to y. b is 0 if x0 is the same everywhere; `None` without samples.
fn nuisance(samples: impl Iterator<Item = (f64, f64, f64)>) -> Option<[f64; 2]> {
    let [mut n, mut x, mut y, mut xx, mut xy] = [0.0; 5];
    for (w, x0, change) in samples {
        let w = w * w;
        n += w;
        x += w * x0;
        y += w * change;
        xx += w * x0 * x0;
        xy += w * x0 * change;
    }
    if n <= 0.0 {
        return None;
    }
    let spread = xx - x * x / n;
    let slope = if spread > 1e-9 * xx { (xy - x * y / n) / spread } else { 0.0 };
    Some([(y - slope * x) / n, slope])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::NoiseModel;
    use crate::light::noise::tests::{SIZE, frames};

    const SIGMA: f64 = 0.002;

    /// A still picture, and the difference of a noisy frame from it.
    fn noisy() -> (Sensing, PatchPair) {
        let quiet = frames(1, NoiseModel { read: 0.0, shot: 0.0 }, 0.0).remove(0);
        let noisy = frames(1, NoiseModel { read: SIGMA * SIGMA, shot: 0.0 }, 0.0).remove(0);
        let mut difference = PatchPair::zeros(SIZE);
        noisy.subtract(&quiet, &mut difference);
        let weights = || vec![1.0 / SIGMA; SIZE * SIZE];
        (Sensing { still: quiet, weights: [weights(), weights()] }, difference)
    }

    fn add(pair: &mut PatchPair, light: impl Fn(usize, usize) -> f64) {
        for channel in 0..3 {
            for (k, value) in pair.left.plane_mut(channel).iter_mut().enumerate() {
                *value += light(k / SIZE, k % SIZE) as f32;
            }
        }
    }

    #[test]
    fn noise_alone_is_no_signal() {
        let (sensing, difference) = noisy();
        for signal in Signal::of(&difference, &sensing) {
            let Signal { snr, noise, .. } = signal.unwrap();
            assert!(snr < 0.06, "{snr}");
            // The mean light is 0.1 + 0.6 · 31 / 64.
            assert!((noise / (SIGMA / 0.390_625) - 1.0).abs() < 1e-3, "{noise}");
        }
    }

    #[test]
    fn the_edge_of_a_fan_is_measured_against_the_noise() {
        let (sensing, mut difference) = noisy();
        let edge = |_: usize, column: usize| if column < SIZE / 2 { 0.01 } else { -0.01 };
        // It varies with the row only, so none of it resembles the still picture, which varies with the column.
        add(&mut difference, |row, column| edge(column, row));
        let [left, right] = Signal::of(&difference, &sensing).map(|signal| signal.unwrap());
        assert!((left.snr / 25.0 - 1.0).abs() < 0.05, "{left:?}");
        assert!((left.change / (0.01 / 0.390_625) - 1.0).abs() < 0.03, "{left:?}");
        assert!(right.snr < 0.06, "the other side has none of it: {right:?}");
    }

    #[test]
    fn gain_and_veil_of_the_visible_side_do_not_count() {
        let (sensing, mut difference) = noisy();
        add(&mut difference, |_, column| 0.1 * (0.1 + 0.6 * column as f64 / SIZE as f64) + 0.02);
        let [left, _] = Signal::of(&difference, &sensing).map(|signal| signal.unwrap());
        assert!(left.snr < 0.06, "{left:?}");
    }

    #[test]
    fn pixels_that_do_not_count_tell_nothing() {
        let (mut sensing, mut difference) = noisy();
        add(&mut difference, |row, _| if row == 0 { 0.5 } else { 0.0 });
        sensing.weights[0][..SIZE].fill(0.0);
        assert!(Signal::of(&difference, &sensing)[0].unwrap().snr < 0.06);
        sensing.weights[1].fill(0.0);
        assert_eq!(Signal::of(&difference, &sensing)[1], None);
    }
}
