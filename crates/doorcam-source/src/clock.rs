use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Time for pacing: the machine's, or simulated in tests.
pub trait Clock: Send {
    /// Time since the clock was created.
    fn now(&self) -> Duration;

    /// Returns when `now` has reached `until`.
    fn wait_until(&self, until: Duration);
}

/// The machine's monotonic clock.
#[derive(Debug)]
pub struct SystemClock(Instant);

impl Default for SystemClock {
    fn default() -> Self {
        Self(Instant::now())
    }
}

impl Clock for SystemClock {
    fn now(&self) -> Duration {
        self.0.elapsed()
    }

    fn wait_until(&self, until: Duration) {
        std::thread::sleep(until.saturating_sub(self.now()));
    }
}

/// A clock for tests: waiting takes no real time but advances the clock.
#[derive(Debug, Clone, Default)]
pub struct ManualClock(Arc<Mutex<Duration>>);

impl ManualClock {
    /// Advances the clock, as work that takes `by` would.
    pub fn advance(&self, by: Duration) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) += by;
    }
}

impl Clock for ManualClock {
    fn now(&self) -> Duration {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn wait_until(&self, until: Duration) {
        let mut now = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        *now = now.max(until);
    }
}
