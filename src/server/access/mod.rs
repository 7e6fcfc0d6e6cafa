//! Who may see and change what: layers around every route, so that a new route is covered without knowing of them.

mod attempts;
mod bodies;
mod guard;
mod headers;
mod hosts;
mod images;
mod origins;
mod peer;
mod senders;
pub(super) mod session;
mod sessions;
mod tokens;

use std::ffi::OsString;
use std::net::SocketAddr;
use std::sync::{Arc, PoisonError, RwLock, RwLockReadGuard};
use std::time::Duration;

use axum::http::HeaderValue;
use axum::{Router, middleware};

use self::attempts::Attempts;
use self::hosts::Hosts;
pub(super) use self::peer::Peer;
pub(super) use self::senders::network;
use self::sessions::Sessions;
use self::tokens::Tokens;
use crate::config::AccessConfig;

/// Why doorcam does not start to serve.
#[derive(Debug, thiserror::Error)]
pub enum AccessError {
    /// Others could reach it, and nothing would hold them off.
    #[error(
        "{0} can be reached by others and there is no token, expected --token-file FILE, access.token_file or DOORCAM_TOKEN (or \
         --allow-unauthenticated, with which everybody who reaches it sees and changes everything)"
    )]
    Exposed(SocketAddr),
    /// A token is given twice.
    #[error("{variable} and {key} (or its option) are both given, expected one of them")]
    TwoTokens {
        /// The key of the file.
        key: &'static str,
        /// The variable.
        variable: &'static str,
    },
    /// One token for both scopes.
    #[error("the token and the read token are the same, expected two different ones")]
    SameTokens,
    /// A token that could be guessed, or is no token.
    #[error(
        "{place} has {length} characters, expected a token of {shortest} to {longest}, as from openssl rand -hex 24"
    )]
    Length {
        /// File or variable.
        place: String,
        /// Characters.
        length: usize,
        /// The fewest.
        shortest: usize,
        /// The most.
        longest: usize,
    },
    /// A token that cannot be sent.
    #[error(
        "{place} has a character that a header cannot carry, expected a token of printable ASCII characters without spaces"
    )]
    Characters {
        /// File or variable.
        place: String,
    },
    /// An origin that cannot be one.
    #[error("access.allowed_origins has \"{0}\", expected scheme and host, such as \"https://door.lan\"")]
    Origin(String),
    /// Tokens where there were none, or none any more.
    #[error("whether a token is needed at all changes with a restart only")]
    Presence,
    /// A file that cannot be read, or that others can.
    #[error("{0}")]
    Secret(String),
}

/// Who may see and change what.
#[derive(Debug)]
pub struct Access {
    tokens: RwLock<Tokens>,
    attempts: Attempts,
    sessions: Sessions,
    cookie_name: String,
    tls: bool,
    exposed: bool,
    images: bool,
    hosts: Hosts,
    origins: Vec<HeaderValue>,
}

impl Access {
    /// What a configuration says, for a server that listens on that address; `environment` gives the variables `DOORCAM_TOKEN`
    /// and `DOORCAM_READ_TOKEN`.
    ///
    /// Errors: tokens that are none or cannot be read, an address that others can reach without any token.
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
        let origin = |text: &String| HeaderValue::from_str(text).map_err(|_| AccessError::Origin(text.clone()));
        let origins = config.allowed_origins.iter().map(origin).collect::<Result<_, _>>()?;
        let hosts = Hosts::new(&config.allowed_hosts, listen);
        Ok(Self {
            tokens: RwLock::new(tokens),
            attempts: Attempts::default(),
            sessions: Sessions::new(Duration::from_secs_f64(config.session_s)),
            cookie_name: "doorcam".into(),
            tls: false,
            exposed,
            images: config.images,
            hosts,
            origins,
        })
    }

    /// Takes notice of the port, once it is known, and of TLS. Cookies are the same for all ports of a host, on which other doorcams
    /// may be.
    pub(super) fn on(mut self, port: u16, tls: bool) -> Self {
        self.tls = tls;
        self.cookie_name = format!("doorcam-{port}");
        self
    }

    /// Takes the tokens from where they were taken at the start; sessions that were begun with others end. False: they are the same.
    ///
    /// Errors as of [`Access::new`]; the tokens before then stay. Whether there are any cannot change.
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
            *tokens = next;
            self.sessions.end_all();
        }
        Ok(differ)
    }

    fn tokens(&self) -> RwLockReadGuard<'_, Tokens> {
        self.tokens.read().unwrap_or_else(PoisonError::into_inner)
    }

    /// Whether everybody in the network can see and change everything.
    pub fn is_exposed(&self) -> bool {
        self.exposed
    }
}

/// Puts the rules around every route; the last one is asked first.
pub(super) fn layers(router: Router, access: Arc<Access>) -> Router {
    let state = || Arc::clone(&access);
    let mut router = router.layer(middleware::from_fn(bodies::limit));
    if !access.images {
        router = router.layer(middleware::from_fn(images::withhold));
    }
    router = router
        .layer(middleware::from_fn_with_state(state(), guard::guard))
        .layer(middleware::from_fn_with_state(state(), origins::check));
    // Before the guard: a browser asks whether it may ask without a token.
    if let Some(cors) = origins::cors(&access.origins) {
        router = router.layer(cors);
    }
    headers::layers(router.layer(middleware::from_fn_with_state(state(), hosts::check)), access.tls)
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
