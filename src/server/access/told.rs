use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// How often refusals of one kind are logged at most: whoever is refused may try again and again.
const EVERY: Duration = Duration::from_secs(60);
/// Most bytes of a value from outside that are logged.
const SHOWN: usize = 100;

/// When refusals of one kind were last logged.
#[derive(Debug, Default)]
pub(super) struct Told(Mutex<Option<Last>>);

#[derive(Debug, Clone, Copy)]
struct Last {
    at: Instant,
    /// How many have not been logged since.
    kept_back: u64,
}

impl Told {
    /// Logs a refusal unless one was logged less than a minute ago; `what` makes its text.
    pub(super) fn tell(&self, what: impl FnOnce() -> String) {
        match self.due(Instant::now()) {
            None => {}
            Some(0) => tracing::warn!("{}", what()),
            Some(more) => tracing::warn!("{} (and {more} more since the last one)", what()),
        }
    }

    /// How many were kept back, if one is to be logged now.
    fn due(&self, now: Instant) -> Option<u64> {
        let mut last = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        match &mut *last {
            Some(last) if now.saturating_duration_since(last.at) < EVERY => {
                last.kept_back = last.kept_back.saturating_add(1);
                None
            }
            last => last.replace(Last { at: now, kept_back: 0 }).map_or(Some(0), |last| Some(last.kept_back)),
        }
    }
}

/// A value from outside as it may be logged or told: on one line, without control characters, and not too long.
pub(super) fn shown(value: &[u8]) -> String {
    let more = if value.len() > SHOWN { "..." } else { "" };
    format!("{}{more}", value[..value.len().min(SHOWN)].escape_ascii())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_a_minute_is_told_and_the_others_are_counted() {
        let (told, start) = (Told::default(), Instant::now());
        let at = |seconds| start + Duration::from_secs(seconds);
        let due: Vec<_> = [0, 1, 59, 60, 61, 130, 200].into_iter().map(|second| told.due(at(second))).collect();
        assert_eq!(due, [Some(0), None, None, Some(2), None, Some(1), Some(0)]);
    }

    #[test]
    fn nothing_forges_a_line() {
        assert_eq!(shown(b"door.lan:8081"), "door.lan:8081");
        assert_eq!(shown("a\r\n\u{1b}[31m\"\u{fc}".as_bytes()), "a\\r\\n\\x1b[31m\\\"\\xc3\\xbc");
        assert_eq!(shown(&[b'a'; 300]).len(), SHOWN + 3);
    }
}
