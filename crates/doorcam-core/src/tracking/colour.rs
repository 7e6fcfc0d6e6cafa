use crate::scene::Rgb;

/// Time constant of the averaged colour, in seconds.
const MEMORY_S: f64 = 2.0;
/// Standard deviation of one person's colour direction from frame to frame, without noise.
const OWN_SPREAD: f64 = 0.25;
/// Standard deviation of the colour directions of different people. It is small because nearly all people darken.
const ANYONES_SPREAD: f64 = 0.6;
/// Limits of the log ratio: colour is only a hint, since two people seen as one have a colour that is neither's.
const LOG_RATIO_RANGE: (f64, f64) = (-2.5, 1.5);

/// A person's colour, averaged over the last seconds.
///
/// Only the direction of the change in (r, g, b) is compared, sign included, because its strength depends on the place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Colour {
    mean: Rgb,
    weight: f64,
}

impl Colour {
    /// A colour seen once; values that are not finite count as unseen.
    pub fn new(rgb: Rgb) -> Self {
        let unknown = Self { mean: [0.0; 3], weight: 0.0 };
        if rgb.iter().all(|v| v.is_finite()) { Self { mean: rgb, weight: 1.0 } } else { unknown }
    }

    /// The mean change of radiance.
    pub fn rgb(&self) -> Rgb {
        self.mean
    }

    /// Adds the colour seen `seconds` after the previous frame.
    pub fn update(&mut self, rgb: Rgb, seconds: f64) {
        if !rgb.iter().all(|v| v.is_finite()) {
            return;
        }
        self.weight = 1.0 + self.weight * (-seconds / MEMORY_S).exp();
        for (mean, value) in self.mean.iter_mut().zip(rgb) {
            *mean += (value - *mean) / self.weight;
        }
    }

    /// Log likelihood ratio of a colour of the given significance (2 log likelihood ratio) for this person to anybody:
    /// a ratio of two normal distributions of the difference of directions.
    pub fn log_ratio(&self, rgb: Rgb, significance: f64) -> f64 {
        let (Some(own), Some(seen)) = (direction(self.mean), direction(rgb)) else { return 0.0 };
        let distance2: f64 = own.iter().zip(seen).map(|(a, b)| (a - b).powi(2)).sum();
        // A vector √significance standard deviations above the noise has a direction with a variance of 1 /
        // significance.
        let noise = if significance > 1.0 { significance.recip() } else { 1.0 };
        let own = OWN_SPREAD.powi(2) + noise;
        let anyones = ANYONES_SPREAD.powi(2) + noise;
        // A direction has two degrees of freedom.
        let log_ratio = (anyones / own).ln() - 0.5 * distance2 * (own.recip() - anyones.recip());
        log_ratio.clamp(LOG_RATIO_RANGE.0, LOG_RATIO_RANGE.1)
    }
}

fn direction(rgb: Rgb) -> Option<Rgb> {
    let length = rgb.iter().map(|v| v * v).sum::<f64>().sqrt();
    (length.is_finite() && length > 0.0).then(|| rgb.map(|v| v / length))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_direction_counts_and_its_sign_but_not_the_strength() {
        let dark = Colour::new([-0.02, -0.05, -0.04]);
        let same = dark.log_ratio([-0.002, -0.005, -0.004], 100.0);
        assert!((same - dark.log_ratio([-0.2, -0.5, -0.4], 100.0)).abs() < 1e-12);
        let other = dark.log_ratio([-0.05, -0.01, -0.01], 100.0);
        let bright = dark.log_ratio([0.02, 0.05, 0.04], 100.0);
        assert!(same > 1.0 && other < 0.0 && bright == LOG_RATIO_RANGE.0, "{same} {other} {bright}");
    }

    #[test]
    fn faint_colours_say_little() {
        let red = Colour::new([0.05, 0.0, 0.0]);
        let strength = |significance: f64| {
            red.log_ratio([0.05, 0.0, 0.0], significance) - red.log_ratio([0.0, 0.05, 0.0], significance)
        };
        assert!(strength(4.0) < 0.5 * strength(100.0));
        for nothing in [[0.0; 3], [f64::NAN; 3], [f64::INFINITY, 0.0, 0.0]] {
            assert_eq!(red.log_ratio(nothing, 100.0), 0.0);
        }
        assert!(red.log_ratio([0.05, 0.0, 0.0], f64::NAN).is_finite());
    }

    #[test]
    fn the_mean_is_of_all_at_first_and_of_the_last_seconds_later() {
        let mut colour = Colour::new([1.0, 0.0, 0.0]);
        colour.update([0.0, 1.0, 0.0], 0.0);
        assert_eq!(colour.rgb(), [0.5, 0.5, 0.0]);
        for _ in 0..100 {
            colour.update([0.0, 0.0, 1.0], 0.1);
        }
        assert!(colour.rgb()[0] < 0.01 && colour.rgb()[2] > 0.98);
        let before = colour;
        colour.update([f64::NAN, 0.0, 0.0], 0.1);
        assert_eq!(colour, before);
        let mut unseen = Colour::new([f64::NAN, 0.0, 0.0]);
        unseen.update([0.5, 0.25, 0.0], 0.1);
        assert_eq!(unseen, Colour::new([0.5, 0.25, 0.0]));
    }
}
