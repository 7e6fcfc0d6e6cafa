use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// Events in the last seconds.
#[derive(Debug, Default)]
pub(super) struct Rate(VecDeque<Instant>);

impl Rate {
    const WINDOW: Duration = Duration::from_secs(3);
    const MOST: usize = 4096;

    /// Counts one.
    pub(super) fn count(&mut self, now: Instant) {
        self.trim(now);
        if self.0.len() < Self::MOST {
            self.0.push_back(now);
        }
    }

    fn trim(&mut self, now: Instant) {
        while self.0.front().is_some_and(|&t| now.duration_since(t) > Self::WINDOW) {
            self.0.pop_front();
        }
    }

    /// How many a second.
    pub(super) fn hz(&mut self, now: Instant) -> f64 {
        self.trim(now);
        match (self.0.front(), self.0.back()) {
            (Some(&first), Some(&last)) if last > first => {
                (self.0.len() - 1) as f64 / last.duration_since(first).as_secs_f64()
            }
            _ => 0.0,
        }
    }
}
