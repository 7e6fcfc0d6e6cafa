use std::sync::Arc;
use std::time::Instant;

use super::Access;
use super::tokens::{Grant, Scope};

/// What let a request pass, an extension of every request that needed something. Live sockets and streams outlive their
/// request, but not what let them in.
#[derive(Debug, Clone)]
pub(in crate::server) enum Pass {
    /// Nothing: there are no tokens.
    Open,
    /// A token.
    Token(Grant),
    /// The session with this number.
    Session(String, Grant),
}

impl Pass {
    /// What its holder may do.
    pub(super) fn scope(&self) -> Scope {
        match self {
            Self::Open => Scope::Control,
            Self::Token(grant) | Self::Session(_, grant) => grant.scope,
        }
    }
}

impl Access {
    /// Completes when a pass is no longer good: its token was replaced, or its session has ended.
    pub(in crate::server) async fn ended(self: Arc<Self>, pass: Pass) {
        let mut changes = self.changes.subscribe();
        // The first look comes after subscribing: the pass may have ended since the request was let in.
        while let Some(end) = self.end_of(&pass, Instant::now()) {
            let expired = async {
                match end {
                    Some(end) => tokio::time::sleep_until(end.into()).await,
                    None => std::future::pending().await,
                }
            };
            tokio::select! {
                () = expired => {}
                changed = changes.changed() => if changed.is_err() { return },
            }
        }
    }

    /// When a pass that is good now ends by itself, if ever; `None` if it is not good.
    fn end_of(&self, pass: &Pass, now: Instant) -> Option<Option<Instant>> {
        match pass {
            Pass::Open => Some(None),
            Pass::Token(grant) => self.tokens().still_give(grant).then_some(None),
            Pass::Session(number, _) => self.session(number, now).map(|session| Some(session.end)),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use crate::config::AccessConfig;

    const TOKENS: [&str; 3] = ["control-control-control", "read-read-read-read-read", "another-another-another"];

    fn environment(control: &'static str, read: &'static str) -> impl Fn(&str) -> Option<std::ffi::OsString> {
        move |name| Some(if name == "DOORCAM_TOKEN" { control } else { read }.into())
    }

    fn access(session_s: f64) -> Arc<Access> {
        let config = AccessConfig { session_s, ..AccessConfig::default() };
        Arc::new(Access::new(&config, "127.0.0.1:0".parse().unwrap(), environment(TOKENS[0], TOKENS[1])).unwrap())
    }

    fn grant(access: &Access, token: &str) -> Grant {
        access.tokens().grant_of(token.as_bytes()).unwrap()
    }

    fn session(access: &Access, token: &str) -> Pass {
        let grant = grant(access, token);
        Pass::Session(access.sessions.begin(grant, Instant::now()).unwrap(), grant)
    }

    #[tokio::test]
    async fn a_replaced_token_ends_what_it_let_in_and_nothing_else() {
        let access = access(1000.0);
        let passes = [
            Pass::Token(grant(&access, TOKENS[0])),
            session(&access, TOKENS[0]),
            Pass::Token(grant(&access, TOKENS[1])),
            session(&access, TOKENS[1]),
        ];
        let mut watched = passes.map(|pass| tokio::spawn(Arc::clone(&access).ended(pass)));
        tokio::task::yield_now().await;
        assert!(!access.reload(&AccessConfig::default(), environment(TOKENS[0], TOKENS[1])).unwrap());
        assert!(access.reload(&AccessConfig::default(), environment(TOKENS[2], TOKENS[1])).unwrap());
        let [token, session, ..] = &mut watched;
        token.await.unwrap();
        session.await.unwrap();
        let [.., token, session] = &watched;
        assert!(!token.is_finished() && !session.is_finished(), "the read token is the same");
    }

    #[tokio::test]
    async fn a_session_takes_with_it_what_it_let_in() {
        let access = access(1000.0);
        let [ended, other] = [session(&access, TOKENS[0]), session(&access, TOKENS[0])];
        let Pass::Session(number, _) = &ended else { unreachable!() };
        let number = number.clone();
        let (ended, other) =
            (tokio::spawn(Arc::clone(&access).ended(ended)), tokio::spawn(Arc::clone(&access).ended(other)));
        tokio::task::yield_now().await;
        access.end_session(&number);
        ended.await.unwrap();
        assert!(!other.is_finished());
    }

    #[tokio::test]
    async fn what_has_ended_before_anybody_watched_ends_at_once() {
        let access = access(0.05);
        let gone = Pass::Session("no such session".into(), grant(&access, TOKENS[0]));
        Arc::clone(&access).ended(gone).await;
        // By itself, after its time.
        let short = session(&access, TOKENS[0]);
        tokio::time::timeout(Duration::from_secs(60), access.ended(short)).await.unwrap();
    }
}
