use std::collections::HashMap;
use std::net::IpAddr;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use super::network;

/// Number of wrong tokens within [`WINDOW`] that bars an address.
const ALLOWED: u32 = 10;
const WINDOW: Duration = Duration::from_secs(60);
/// Most addresses that are remembered.
const MOST: usize = 4096;

/// The addresses that recently sent wrong tokens. Open sessions are not affected, so an attacker behind the same proxy
/// cannot lock out anybody who is logged in.
#[derive(Debug, Default)]
pub(super) struct Attempts {
    failed: Mutex<HashMap<IpAddr, Failed>>,
}

#[derive(Debug, Clone, Copy)]
struct Failed {
    since: Instant,
    count: u32,
}

impl Failed {
    /// The time until this is forgotten; `None` once it is.
    fn rest(&self, now: Instant) -> Option<Duration> {
        WINDOW.checked_sub(now.saturating_duration_since(self.since)).filter(|rest| !rest.is_zero())
    }
}

impl Attempts {
    /// For how long tokens from this address are refused without a check; `None` if they are checked.
    pub(super) fn barred(&self, address: IpAddr, now: Instant) -> Option<Duration> {
        let failed = self.failed.lock().unwrap_or_else(PoisonError::into_inner);
        let failed = failed.get(&network(address))?;
        failed.rest(now).filter(|_| failed.count >= ALLOWED)
    }

    /// Counts a wrong token; returns whether it is the one that bars the address.
    pub(super) fn note(&self, address: IpAddr, now: Instant) -> bool {
        let mut all = self.failed.lock().unwrap_or_else(PoisonError::into_inner);
        let address = network(address);
        if all.len() >= MOST && !all.contains_key(&address) {
            all.retain(|_, failed| failed.rest(now).is_some());
        }
        if all.len() >= MOST && !all.contains_key(&address) {
            // So many at once come from one attacker, so drop the one that would be forgotten first anyway.
            let oldest = all.iter().min_by_key(|(_, failed)| failed.since).map(|(&address, _)| address);
            oldest.map(|oldest| all.remove(&oldest));
        }
        let failed = all.entry(address).or_insert(Failed { since: now, count: 0 });
        if failed.rest(now).is_none() {
            *failed = Failed { since: now, count: 0 };
        }
        failed.count = failed.count.saturating_add(1);
        failed.count == ALLOWED
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn address(text: &str) -> IpAddr {
        text.parse().unwrap()
    }

    #[test]
    fn ten_wrong_tokens_in_a_minute_bar_an_address_until_it_is_over() {
        let (attempts, start) = (Attempts::default(), Instant::now());
        let at = |seconds| start + Duration::from_secs(seconds);
        let (guest, other) = (address("192.0.2.1"), address("192.0.2.2"));
        for k in 0..9 {
            assert!(!attempts.note(guest, at(k)));
            assert_eq!(attempts.barred(guest, at(k)), None);
        }
        assert!(attempts.note(guest, at(10)));
        assert_eq!(attempts.barred(guest, at(20)), Some(Duration::from_secs(40)));
        assert_eq!(attempts.barred(other, at(20)), None);
        assert_eq!(attempts.barred(guest, at(60)), None);
        assert!(!attempts.note(guest, at(61)), "a new count begins");
        assert_eq!(attempts.barred(guest, at(61)), None);
    }

    #[test]
    fn one_network_of_ipv6_is_one_sender() {
        let (attempts, now) = (Attempts::default(), Instant::now());
        for k in 0..10 {
            attempts.note(address(&format!("2001:db8:1:2::{k}")), now);
        }
        assert!(attempts.barred(address("2001:db8:1:2:ffff::1"), now).is_some());
        assert!(attempts.barred(address("2001:db8:1:3::1"), now).is_none());
        for _ in 0..10 {
            attempts.note(address("::ffff:192.0.2.1"), now);
        }
        assert!(attempts.barred(address("192.0.2.1"), now).is_some());
    }

    #[test]
    fn many_addresses_take_little_memory() {
        let (attempts, start) = (Attempts::default(), Instant::now());
        for k in 0..3 * MOST {
            let now = start + Duration::from_millis(k as u64);
            attempts.note(IpAddr::from((k as u32).to_be_bytes()), now);
        }
        assert!(attempts.failed.lock().unwrap().len() <= MOST);
    }
}
