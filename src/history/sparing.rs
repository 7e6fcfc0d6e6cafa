use std::time::{Duration, Instant};

/// How often a kind of message is said.
const EVERY: Duration = Duration::from_secs(60);

/// Lets each kind of message through once a minute, so that what fails again and again does not fill the log.
#[derive(Debug, Default)]
pub(super) struct Sparing(Vec<(&'static str, Instant)>);

impl Sparing {
    /// Whether a message of this kind may be said now.
    pub(super) fn may(&mut self, kind: &'static str) -> bool {
        let now = Instant::now();
        match self.0.iter_mut().find(|(said, _)| *said == kind) {
            Some((_, at)) if now.duration_since(*at) < EVERY => false,
            Some((_, at)) => {
                *at = now;
                true
            }
            None => {
                self.0.push((kind, now));
                true
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_kind_is_said_once_a_minute() {
        let mut sparing = Sparing::default();
        assert!(sparing.may("a") && !sparing.may("a") && sparing.may("b") && !sparing.may("b"));
        sparing.0[0].1 = Instant::now().checked_sub(EVERY).unwrap();
        assert!(sparing.may("a") && !sparing.may("a"));
    }
}
