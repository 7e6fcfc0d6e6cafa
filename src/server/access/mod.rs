//! Who may see and change what. The rules are layers around all routes, so a new route is covered automatically.

mod attempts;
mod bodies;
mod guard;
mod headers;
mod hosts;
mod images;
mod origins;
mod pass;
mod peer;
mod proxies;
mod senders;
pub(super) mod session;
mod sessions;
mod tokens;
mod told;

use std::ffi::OsString;
use std::net::SocketAddr;
use std::sync::{Arc, PoisonError, RwLock, RwLockReadGuard};
use std::time::{Duration, Instant};

use axum::{Router, middleware};
use tokio::sync::watch;

use self::attempts::Attempts;
use self::bodies::Budget;
use self::hosts::Hosts;
use self::origins::Origin;
pub(super) use self::pass::Pass;
pub(super) use self::peer::Peer;
use self::proxies::Proxies;
pub(super) use self::senders::network;
use self::sessions::{Session, Sessions};
use self::tokens::Tokens;
use self::told::Told;
use crate::config::AccessConfig;

/// Why the rules of access cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum AccessError {
    /// Others can reach the address, and there is no token.
    #[error(
        "{0} can be reached by others and there is no token, expected --token-file FILE, access.token_file or \
         DOORCAM_TOKEN (or --allow-unauthenticated, with which everybody who reaches it sees and changes everything)"
    )]
    Exposed(SocketAddr),
    /// A token is given both in a file and in the environment.
    #[error("{variable} and {key} (or its option) are both given, expected one of them")]
    TwoTokens {
        /// The configuration key of the file.
        key: &'static str,
        /// The environment variable.
        variable: &'static str,
    },
    /// The control and the read token are the same.
    #[error("the token and the read token are the same, expected two different ones")]
    SameTokens,
    /// A token is too short, and could be guessed, or too long.
    #[error(
        "{place} has {length} characters, expected a token of {shortest} to {longest}, as from openssl rand -hex 24"
    )]
    Length {
        /// File or variable.
        place: String,
        /// Its length, in characters.
        length: usize,
        /// The shortest allowed, in characters.
        shortest: usize,
        /// The longest allowed, in characters.
        longest: usize,
    },
    /// A token has characters that cannot be sent in a header.
    #[error(
        "{place} has a character that a header cannot carry, expected a token of printable ASCII characters without \
         spaces"
    )]
    Characters {
        /// File or variable.
        place: String,
    },
    /// An allowed origin is not valid.
    #[error("access.allowed_origins has \"{0}\", expected scheme and host, such as \"https://door.lan\"")]
    Origin(String),
    /// A reload would add the first token or remove the last one.
    #[error("adding the first token or removing the last one takes a restart")]
    Presence,
    /// A token's file cannot be read, or others can read it.
    #[error("{0}")]
    Secret(String),
}

/// The rules of access: who may see and change what.
#[derive(Debug)]
pub struct Access {
    tokens: RwLock<Tokens>,
    attempts: Attempts,
    sessions: Sessions,
    /// Changes when tokens are replaced and when sessions end before their time.
    changes: watch::Sender<()>,
    proxies: Proxies,
    cookie_name: String,
    tls: bool,
    exposed: bool,
    images: bool,
    hosts: Hosts,
    foreign_hosts: Told,
    origins: Vec<Origin>,
    foreign_origins: Told,
}

impl Access {
    /// The rules of a configuration for a server that listens on `listen`. `environment` gives the values of the
    /// variables `DOORCAM_TOKEN` and `DOORCAM_READ_TOKEN`.
    ///
    /// # Errors
    ///
    /// If a token is not valid or cannot be read, if an allowed origin is not valid, or if others can reach the address
    /// and there is no token.
    pub fn new(
        config: &AccessConfig,
        listen: SocketAddr,
        environment: impl Fn(&str) -> Option<OsString>,
    ) -> Result<Self, AccessError> {
        let tokens = Tokens::load(config, environment)?;
        let exposed = tokens.is_empty() && !is_loopback(listen);
        if exposed && !config.allow_unauthenticated {
            return Err(AccessError::Exposed(listen));
        }
        let origin = |text: &String| Origin::parse(text.as_bytes()).ok_or_else(|| AccessError::Origin(text.clone()));
        let origins = config.allowed_origins.iter().map(origin).collect::<Result<_, _>>()?;
        let hosts = Hosts::new(&config.allowed_hosts, listen);
        Ok(Self {
            tokens: RwLock::new(tokens),
            attempts: Attempts::default(),
            sessions: Sessions::new(Duration::from_secs_f64(config.session_s)),
            changes: watch::Sender::default(),
            proxies: Proxies::new(&config.trusted_proxies),
            cookie_name: "doorcam".into(),
            tls: false,
            exposed,
            images: config.images,
            hosts,
            foreign_hosts: Told::default(),
            origins,
            foreign_origins: Told::default(),
        })
    }

    /// Sets the port, once it is known, and whether there is TLS. The port goes into the cookie's name, because
    /// browsers share cookies between all ports of a host, where other doorcams may listen.
    pub(super) fn on(mut self, port: u16, tls: bool) -> Self {
        self.tls = tls;
        self.cookie_name = format!("doorcam-{port}");
        self
    }

    /// Reads the tokens again; returns whether they have changed. Sessions, live sockets and streams of a token that is
    /// no longer one end.
    ///
    /// # Errors
    ///
    /// If a token is not valid or cannot be read, or if the first token were added or the last one removed. The tokens
    /// in use then stay.
    pub fn reload(
        &self,
        config: &AccessConfig,
        environment: impl Fn(&str) -> Option<OsString>,
    ) -> Result<bool, AccessError> {
        let next = Tokens::load(config, environment)?;
        let mut tokens = self.tokens.write().unwrap_or_else(PoisonError::into_inner);
        if next.is_empty() != tokens.is_empty() {
            return Err(AccessError::Presence);
        }
        let differ = !next.are(&tokens);
        if differ {
            self.sessions.keep(|grant| next.still_give(grant));
            *tokens = next;
            drop(tokens);
            self.changes.send_replace(());
        }
        Ok(differ)
    }

    /// The open session with this number. A session never outlives its token.
    fn session(&self, number: &str, now: Instant) -> Option<Session> {
        self.sessions.get(number, now).filter(|session| self.tokens().still_give(&session.grant))
    }

    /// Ends the session with this number, and what it let in.
    fn end_session(&self, number: &str) {
        if self.sessions.end(number) {
            self.changes.send_replace(());
        }
    }

    fn tokens(&self) -> RwLockReadGuard<'_, Tokens> {
        self.tokens.read().unwrap_or_else(PoisonError::into_inner)
    }

    /// Whether everybody in the network can see and change everything.
    pub fn is_exposed(&self) -> bool {
        self.exposed
    }
}

/// Puts the rules around every route; the last layer is asked first.
pub(super) fn layers(router: Router, access: Arc<Access>) -> Router {
    let state = || Arc::clone(&access);
    let mut router = router.layer(middleware::from_fn_with_state(Arc::<Budget>::default(), bodies::limit));
    if !access.images {
        router = router.layer(middleware::from_fn(images::withhold));
    }
    router = router
        .layer(middleware::from_fn_with_state(state(), guard::guard))
        .layer(middleware::from_fn_with_state(state(), origins::check));
    // Before the guard, because browsers send preflight requests without a token.
    if let Some(cors) = origins::cors(&access.origins) {
        router = router.layer(cors);
    }
    router = router.layer(middleware::from_fn_with_state(state(), hosts::check));
    headers::layers(router.layer(middleware::from_fn(bodies::settle)), access.tls)
}

fn is_loopback(address: SocketAddr) -> bool {
    address.ip().to_canonical().is_loopback()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_that_others_can_reach_takes_a_token_or_a_clear_word() {
        let none = |_: &str| None;
        let some = |name: &str| (name == "DOORCAM_READ_TOKEN").then(|| "read-read-read-read-read".into());
        let closed = AccessConfig::default();
        let open = AccessConfig { allow_unauthenticated: true, ..AccessConfig::default() };
        for here in ["127.0.0.1:8080", "127.8.0.1:80", "[::1]:8080", "[::ffff:127.0.0.1]:8080"] {
            let here = here.parse().unwrap();
            assert!(!Access::new(&closed, here, none).unwrap().is_exposed());
            assert!(!Access::new(&open, here, none).unwrap().is_exposed());
        }
        for there in ["0.0.0.0:8080", "192.168.1.2:8080", "[::]:8080", "[fe80::1]:8080", "128.0.0.1:1"] {
            let there = there.parse().unwrap();
            assert!(matches!(Access::new(&closed, there, none), Err(AccessError::Exposed(_))), "{there}");
            assert!(Access::new(&open, there, none).unwrap().is_exposed());
            assert!(!Access::new(&closed, there, some).unwrap().is_exposed());
            assert!(!Access::new(&open, there, some).unwrap().is_exposed());
        }
    }
}
