use std::collections::HashMap;
use std::net::IpAddr;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use tokio::sync::Mutex as Turn;

use super::network;

/// Number of wrong tokens within [`WINDOW`] after which further wrong ones are answered "later".
const ALLOWED: u32 = 10;
const WINDOW: Duration = Duration::from_secs(60);
/// The pause before each token from an address that has sent too many wrong ones: it has at most 200 tokens a second
/// checked, however many connections it uses. With tokens of at least 20 characters that leaves nothing to guess at, and
/// whoever sends a right one from the same address (behind the same proxy) gets in after at most a second or so.
pub(super) const PAUSE: Duration = Duration::from_millis(5);
/// Most addresses that are remembered.
const MOST: usize = 4096;

/// The addresses that recently sent wrong tokens. Only wrong tokens suffer: a right one is always let in, and open
/// sessions are not affected, so nobody who guesses can lock out anybody else behind the same proxy.
#[derive(Debug, Default)]
pub(super) struct Attempts {
    failed: Mutex<HashMap<IpAddr, Failed>>,
}

#[derive(Debug, Clone)]
struct Failed {
    since: Instant,
    count: u32,
    /// Lets tokens be checked one after the other, in the order in which they came.
    turn: Arc<Turn<()>>,
}

/// How a wrong token is answered.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Verdict {
    /// As a wrong one.
    Wrong,
    /// As a wrong one; it is the last: from now on they are answered `Later`.
    Last,
    /// As one too many: no other is worth trying for this long.
    Later(Duration),
}

impl Failed {
    fn new(now: Instant) -> Self {
        Self { since: now, count: 0, turn: Arc::default() }
    }

    /// The time until this is forgotten; `None` once it is.
    fn rest(&self, now: Instant) -> Option<Duration> {
        WINDOW.checked_sub(now.saturating_duration_since(self.since)).filter(|rest| !rest.is_zero())
    }
}

impl Attempts {
    /// The turn to wait for before a token from this address is checked; `None` if it is checked at once.
    pub(super) fn turn(&self, address: IpAddr, now: Instant) -> Option<Arc<Turn<()>>> {
        let failed = self.failed();
        let failed = failed.get(&network(address)).filter(|failed| failed.count >= ALLOWED)?;
        failed.rest(now).map(|_| Arc::clone(&failed.turn))
    }

    /// Counts a wrong token.
    pub(super) fn note(&self, address: IpAddr, now: Instant) -> Verdict {
        let mut all = self.failed();
        let address = network(address);
        if all.len() >= MOST && !all.contains_key(&address) {
            all.retain(|_, failed| failed.rest(now).is_some());
        }
        if all.len() >= MOST && !all.contains_key(&address) {
            // So many at once come from one attacker, so drop the one that would be forgotten first anyway.
            let oldest = all.iter().min_by_key(|(_, failed)| failed.since).map(|(&address, _)| address);
            oldest.map(|oldest| all.remove(&oldest));
        }
        let failed = all.entry(address).or_insert_with(|| Failed::new(now));
        let rest = match failed.rest(now) {
            Some(rest) => rest,
            None => {
                (failed.since, failed.count) = (now, 0);
                WINDOW
            }
        };
        if failed.count >= ALLOWED {
            return Verdict::Later(rest);
        }
        failed.count += 1;
        if failed.count == ALLOWED { Verdict::Last } else { Verdict::Wrong }
    }

    fn failed(&self) -> MutexGuard<'_, HashMap<IpAddr, Failed>> {
        self.failed.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn address(text: &str) -> IpAddr {
        text.parse().unwrap()
    }

    #[test]
    fn after_ten_wrong_tokens_in_a_minute_further_ones_take_their_turn_until_it_is_over() {
        let (attempts, start) = (Attempts::default(), Instant::now());
        let at = |seconds| start + Duration::from_secs(seconds);
        let (guest, other) = (address("192.0.2.1"), address("192.0.2.2"));
        for k in 0..9 {
            assert_eq!(attempts.note(guest, at(k)), Verdict::Wrong);
            assert!(attempts.turn(guest, at(k)).is_none());
        }
        assert_eq!(attempts.note(guest, at(10)), Verdict::Last);
        assert_eq!(attempts.note(guest, at(20)), Verdict::Later(Duration::from_secs(40)));
        assert!(attempts.turn(guest, at(20)).is_some() && attempts.turn(other, at(20)).is_none());
        assert_eq!(attempts.note(other, at(20)), Verdict::Wrong);
        assert!(attempts.turn(guest, at(60)).is_none());
        assert_eq!(attempts.note(guest, at(61)), Verdict::Wrong, "a new count begins");
        assert!(attempts.turn(guest, at(61)).is_none());
    }

    #[test]
    fn one_network_of_ipv6_is_one_sender() {
        let (attempts, now) = (Attempts::default(), Instant::now());
        for k in 0..10 {
            attempts.note(address(&format!("2001:db8:1:2::{k}")), now);
        }
        assert!(attempts.turn(address("2001:db8:1:2:ffff::1"), now).is_some());
        assert!(attempts.turn(address("2001:db8:1:3::1"), now).is_none());
        for _ in 0..10 {
            attempts.note(address("::ffff:192.0.2.1"), now);
        }
        assert!(attempts.turn(address("192.0.2.1"), now).is_some());
    }

    #[test]
    fn many_addresses_take_little_memory() {
        let (attempts, start) = (Attempts::default(), Instant::now());
        for k in 0..3 * MOST {
            let now = start + Duration::from_millis(k as u64);
            attempts.note(IpAddr::from((k as u32).to_be_bytes()), now);
        }
        assert!(attempts.failed().len() <= MOST);
    }
}
