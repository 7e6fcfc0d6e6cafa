use std::time::Duration;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// Delays between attempts: doubled up to a cap, then drawn from the upper half, so that several programs that wait for
/// the same thing do not retry at the same time.
#[derive(Debug, Clone)]
pub struct Backoff {
    first: Duration,
    longest: Duration,
    attempt: u32,
    random: ChaCha8Rng,
}

impl Backoff {
    /// Delays from `first` to `longest`; `seed` makes their random part differ from that of other programs.
    pub fn new(first: Duration, longest: Duration, seed: u64) -> Self {
        Self { first, longest, attempt: 0, random: ChaCha8Rng::seed_from_u64(seed) }
    }

    /// The next delay.
    pub fn next_delay(&mut self) -> Duration {
        let whole = self.first.saturating_mul(1 << self.attempt.min(16)).min(self.longest);
        self.attempt += 1;
        let share = f64::from(self.random.next_u32()) / f64::from(u32::MAX);
        whole.mul_f64(0.5 + 0.5 * share)
    }

    /// Starts over: the next delay is the first one.
    pub fn reset(&mut self) {
        self.attempt = 0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn delays_grow_to_the_cap_and_are_never_the_same_for_two() {
        let (first, longest) = (Duration::from_millis(250), Duration::from_secs(2));
        let delays = |seed| {
            let mut backoff = Backoff::new(first, longest, seed);
            (0..40).map(|_| backoff.next_delay()).collect::<Vec<_>>()
        };
        let ours = delays(1);
        for (k, delay) in ours.iter().enumerate() {
            let whole = (first * 2_u32.pow(k.min(10) as u32)).min(longest);
            assert!(*delay >= whole / 2 && *delay <= whole, "{k}: {delay:?}");
        }
        assert_ne!(ours, delays(2));
        let mut backoff = Backoff::new(first, longest, 1);
        backoff.next_delay();
        backoff.next_delay();
        backoff.reset();
        assert!(backoff.next_delay() <= first);
    }
}
