use std::sync::Arc;
use std::time::{Duration, Instant};

use axum::extract::{Extension, Request, State};
use axum::http::{HeaderMap, HeaderValue, Method, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

use super::attempts::{PAUSE, Verdict};
use super::pass::Pass;
use super::tokens::{Grant, Scope};
use super::{Access, Peer, session};
use crate::server::assets;
use crate::server::problem::ProblemDetails;

/// Why a request is refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Refusal {
    /// It has no token.
    NoToken,
    /// Its token is unknown.
    WrongToken,
    /// Its token does not allow this.
    Scope,
    /// Its token is unknown, and its address has sent too many such: no other is worth trying for this long.
    Later(Duration),
}

/// Lets a request pass if its sender has the scope for it.
pub(super) async fn guard(
    State(access): State<Arc<Access>>,
    Extension(peer): Extension<Peer>,
    mut request: Request,
    next: Next,
) -> Response {
    let Some(needed) = needed(request.method(), request.uri().path()) else {
        return next.run(request).await;
    };
    match access.pass_of(request.headers(), peer).await {
        Ok(pass) if pass.scope() >= needed => {
            request.extensions_mut().insert(pass);
            next.run(request).await
        }
        Ok(_) => Refusal::Scope.into_response(),
        Err(refusal) => refusal.into_response(),
    }
}

/// The scope that a request needs; `None` if it is open to everybody. Only the routes named here are open, so a new one
/// is closed: the two probes, the files of the page, which tell nothing about the room, and the login.
fn needed(method: &Method, path: &str) -> Option<Scope> {
    if matches!(path, "/livez" | "/readyz" | session::PATH) || assets::has(path) {
        return None;
    }
    Some(if matches!(*method, Method::GET | Method::HEAD) { Scope::Read } else { Scope::Control })
}

impl Access {
    /// What lets a request pass, as its token or its session says.
    pub(super) async fn pass_of(&self, headers: &HeaderMap, peer: Peer) -> Result<Pass, Refusal> {
        if self.tokens().is_empty() {
            return Ok(Pass::Open);
        }
        if let Some(token) = bearer(headers) {
            return self.grant_of(token, headers, peer).await.map(Pass::Token);
        }
        let number = self.cookie(headers).ok_or(Refusal::NoToken)?;
        let session = self.session(number, Instant::now()).ok_or(Refusal::NoToken)?;
        Ok(Pass::Session(number.into(), session.grant))
    }

    /// What the holder of a token may do. A right token is let in whatever else came from its address, at most a little
    /// later.
    pub(super) async fn grant_of(&self, token: &[u8], headers: &HeaderMap, peer: Peer) -> Result<Grant, Refusal> {
        let address = self.proxies.client(peer, headers);
        if let Some(turn) = self.attempts.turn(address, Instant::now()) {
            let _turn = turn.lock().await;
            tokio::time::sleep(PAUSE).await;
        }
        let grant = self.tokens().grant_of(token);
        grant.ok_or_else(|| match self.attempts.note(address, Instant::now()) {
            Verdict::Wrong => Refusal::WrongToken,
            Verdict::Last => {
                tracing::warn!("{address}: too many wrong tokens, further ones are refused for a while");
                Refusal::WrongToken
            }
            Verdict::Later(rest) => Refusal::Later(rest),
        })
    }
}

/// The token of `Authorization: Bearer TOKEN`.
fn bearer(headers: &HeaderMap) -> Option<&[u8]> {
    let (scheme, token) = headers.get(header::AUTHORIZATION)?.as_bytes().split_at_checked(7)?;
    scheme.eq_ignore_ascii_case(b"Bearer ").then(|| token.trim_ascii())
}

impl IntoResponse for Refusal {
    fn into_response(self) -> Response {
        let (status, challenge, detail) = match self {
            Self::NoToken => (
                StatusCode::UNAUTHORIZED,
                "Bearer realm=\"doorcam\"",
                "a token is needed: Authorization: Bearer TOKEN, or a session of the page",
            ),
            Self::WrongToken => (
                StatusCode::UNAUTHORIZED,
                "Bearer realm=\"doorcam\", error=\"invalid_token\"",
                "the token is not one of this doorcam's",
            ),
            Self::Later(rest) => return too_many(rest),
            Self::Scope => (
                StatusCode::FORBIDDEN,
                "Bearer realm=\"doorcam\", error=\"insufficient_scope\", scope=\"control\"",
                "the token is for reading only: changes need the control token",
            ),
        };
        let mut response = ProblemDetails::new(status, detail).into_response();
        response.headers_mut().insert(header::WWW_AUTHENTICATE, HeaderValue::from_static(challenge));
        response
    }
}

fn too_many(rest: Duration) -> Response {
    let wait = rest.as_secs() + 1;
    let detail = format!("wrong, like too many other tokens from this address: try again in {wait} s");
    ProblemDetails::new(StatusCode::TOO_MANY_REQUESTS, &detail).retry_after(wait).into_response()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_page_and_the_probes_are_open() {
        for path in ["/", "/index.html", "/app.js", "/map/map.js", "/livez", "/readyz", "/api/v1/session"] {
            assert_eq!(needed(&Method::GET, path), None, "{path}");
        }
        for path in
            ["/metrics", "/api/v1/status", "/api/v1/live", "/livez/", "//api/v1/status", "/api/v1/../", "/new", ""]
        {
            assert_eq!(needed(&Method::GET, path), Some(Scope::Read), "{path}");
            assert_eq!(needed(&Method::HEAD, path), Some(Scope::Read), "{path}");
            for method in [Method::POST, Method::PUT, Method::DELETE, Method::PATCH, Method::OPTIONS] {
                assert_eq!(needed(&method, path), Some(Scope::Control), "{method} {path}");
            }
        }
    }

    #[test]
    fn a_bearer_token_is_read_from_its_header_only() {
        let read = |value: &'static str| {
            let mut headers = HeaderMap::new();
            headers.insert(header::AUTHORIZATION, HeaderValue::from_static(value));
            bearer(&headers).map(<[u8]>::to_vec)
        };
        assert_eq!(read("Bearer abc"), Some(b"abc".to_vec()));
        assert_eq!(read("bearer  abc "), Some(b"abc".to_vec()));
        for other in ["", "Bearer", "Basic abc", "abc", "Bearerabc"] {
            assert_eq!(read(other), None, "{other}");
        }
    }
}
