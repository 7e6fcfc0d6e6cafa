use std::collections::HashMap;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use base64::Engine;
use base64::prelude::BASE64_URL_SAFE_NO_PAD;

use super::tokens::Grant;

/// Most open sessions; one more ends the one that would expire first.
const MOST: usize = 256;

/// The page's sessions. A browser that has sent a token once is known by a random number in a cookie, because scripts
/// cannot put a token on live sockets and pictures. They cannot read the cookie, so they cannot steal the number.
/// Sessions end with the process.
#[derive(Debug)]
pub(super) struct Sessions {
    lifetime: Duration,
    open: Mutex<HashMap<String, Session>>,
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Session {
    /// What its token lets it do.
    pub(super) grant: Grant,
    pub(super) end: Instant,
}

impl Sessions {
    pub(super) fn new(lifetime: Duration) -> Self {
        Self { lifetime, open: Mutex::default() }
    }

    /// How long a session lasts.
    pub(super) fn lifetime(&self) -> Duration {
        self.lifetime
    }

    /// Opens a session and returns its number. Fails if the system gives no random numbers.
    pub(super) fn begin(&self, grant: Grant, now: Instant) -> Result<String, getrandom::Error> {
        // 256 bits cannot be guessed, so attempts need no limit.
        let mut number = [0; 32];
        getrandom::fill(&mut number)?;
        let number = BASE64_URL_SAFE_NO_PAD.encode(number);
        let mut open = self.open.lock().unwrap_or_else(PoisonError::into_inner);
        open.retain(|_, session| session.end > now);
        if open.len() >= MOST {
            let first = open.iter().min_by_key(|(_, session)| session.end).map(|(number, _)| number.clone());
            first.map(|first| open.remove(&first));
        }
        open.insert(number.clone(), Session { grant, end: now + self.lifetime });
        Ok(number)
    }

    /// The open session with this number.
    pub(super) fn get(&self, number: &str, now: Instant) -> Option<Session> {
        let open = self.open.lock().unwrap_or_else(PoisonError::into_inner);
        open.get(number).copied().filter(|session| session.end > now)
    }

    /// Ends all sessions but those with such a grant.
    pub(super) fn keep(&self, good: impl Fn(&Grant) -> bool) {
        self.open.lock().unwrap_or_else(PoisonError::into_inner).retain(|_, session| good(&session.grant));
    }

    /// Ends the session with this number; returns whether there was one.
    pub(super) fn end(&self, number: &str) -> bool {
        self.open.lock().unwrap_or_else(PoisonError::into_inner).remove(number).is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::AccessConfig;
    use crate::server::access::tokens::{Scope, Tokens};

    /// The grants of a read and of a control token.
    fn grants() -> [Grant; 2] {
        let environment = |name: &str| Some(format!("{name}-{name}-{name}").into());
        let tokens = Tokens::load(&AccessConfig::default(), environment).unwrap();
        ["DOORCAM_READ_TOKEN", "DOORCAM_TOKEN"]
            .map(|name| tokens.grant_of(format!("{name}-{name}-{name}").as_bytes()).unwrap())
    }

    #[test]
    fn a_session_has_its_scope_until_it_ends_or_is_ended() {
        let (sessions, start) = (Sessions::new(Duration::from_secs(100)), Instant::now());
        let at = |seconds| start + Duration::from_secs(seconds);
        let [reads, controls] = grants();
        let read = sessions.begin(reads, start).unwrap();
        let control = sessions.begin(controls, at(50)).unwrap();
        let scope = |number: &str, now| sessions.get(number, now).map(|session| session.grant.scope);
        assert_eq!((scope(&read, at(99)), scope(&control, at(99))), (Some(Scope::Read), Some(Scope::Control)));
        assert_eq!((scope(&read, at(100)), scope(&control, at(100))), (None, Some(Scope::Control)));
        sessions.end(&control);
        assert_eq!(scope(&control, at(60)), None);
        assert_eq!(scope("", start), None);
        assert!(read != control && read.len() == 43, "{read}");
        let control = sessions.begin(controls, start).unwrap();
        sessions.keep(|grant| grant.scope == Scope::Control);
        assert_eq!((scope(&read, at(1)), scope(&control, at(1))), (None, Some(Scope::Control)));
    }

    #[test]
    fn many_sessions_end_the_oldest() {
        let (sessions, start) = (Sessions::new(Duration::from_secs(1000)), Instant::now());
        let at = |k: usize| start + Duration::from_millis(k as u64);
        let [reads, _] = grants();
        let numbers: Vec<String> = (0..MOST + 5).map(|k| sessions.begin(reads, at(k)).unwrap()).collect();
        let open = |number: &String| sessions.get(number, at(MOST + 5)).is_some();
        assert_eq!(numbers.iter().position(open), Some(5));
        assert!(numbers[5..].iter().all(open));
    }
}
