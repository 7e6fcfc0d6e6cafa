//! `/api/v1/session`: a browser shows a token once and is known by a cookie from then on.

use std::sync::Arc;
use std::time::Instant;

use axum::Json;
use axum::body::Bytes;
use axum::extract::{Extension, State};
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::tokens::Scope;
use super::{Access, Peer};
use crate::server::openapi::{Failed, Malformed, STATE, TooLarge, TooMany, WrongToken};
use crate::server::problem::Problem;

/// Where it is; open to everybody.
pub(super) const PATH: &str = "/api/v1/session";

/// What a client may do here, and what it should know.
#[derive(Debug, Serialize, ToSchema)]
#[schema(as = Session)]
pub(in crate::server) struct Report {
    /// What it may do; nothing without a token.
    #[schema(required)]
    scope: Option<Scope>,
    /// Whether there are tokens at all.
    token_needed: bool,
    /// Whether everybody in the network may do everything.
    exposed: bool,
    /// Whether pictures of the visible side are shown.
    images: bool,
    /// Until its session ends; none without one.
    #[schema(required)]
    expires_s: Option<u64>,
}

/// What a browser shows once.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(in crate::server) struct Login {
    /// The token.
    token: String,
}

/// What this client may do.
#[utoipa::path(get, path = "/session", tag = STATE, responses((status = 200, description = "What it may do", body = Report)))]
pub(in crate::server) async fn tell(
    State(access): State<Arc<Access>>,
    Extension(peer): Extension<Peer>,
    headers: HeaderMap,
) -> Response {
    Json(access.report(peer, &headers)).into_response()
}

/// Begins a session: a token is shown once, and a cookie from then on.
#[utoipa::path(
    post, path = "/session", tag = STATE, request_body = Login,
    responses(
        (status = 200, description = "It has begun; nothing begins where no token is needed", body = Report),
        (status = 400, response = Malformed), (status = 401, response = WrongToken), (status = 413, response = TooLarge),
        (status = 429, response = TooMany), (status = 500, response = Failed),
    )
)]
pub(in crate::server) async fn begin(
    State(access): State<Arc<Access>>,
    Extension(peer): Extension<Peer>,
    headers: HeaderMap,
    body: Bytes,
) -> Response {
    let Ok(Login { token }) = serde_json::from_slice(&body) else {
        // Not the reader's own words: they could show the token.
        return Problem::bad_request("expected {\"token\": \"...\"}").into_response();
    };
    if access.tokens().is_empty() {
        return Json(access.report(peer, &headers)).into_response();
    }
    let now = Instant::now();
    let scope = match access.scope_of_token(token.trim().as_bytes(), peer, now) {
        Ok(scope) => scope,
        Err(refusal) => return refusal.into_response(),
    };
    // The one before, of another scope maybe, is over.
    access.cookie(&headers).into_iter().for_each(|number| access.sessions.end(number));
    let number = match access.sessions.begin(scope, now) {
        Ok(number) => number,
        Err(e) => return Problem::internal(&format!("no random numbers for a session: {e}")).into_response(),
    };
    let lifetime = access.sessions.lifetime().as_secs();
    let cookie = access.set_cookie(&headers, &number, lifetime);
    let report = Report { scope: Some(scope), expires_s: Some(lifetime), ..access.report(peer, &headers) };
    ([(header::SET_COOKIE, cookie)], Json(report)).into_response()
}

/// Ends the session, if there is one.
#[utoipa::path(delete, path = "/session", tag = STATE, responses((status = 204, description = "There is none any more")))]
pub(in crate::server) async fn end(State(access): State<Arc<Access>>, headers: HeaderMap) -> Response {
    access.cookie(&headers).into_iter().for_each(|number| access.sessions.end(number));
    (StatusCode::NO_CONTENT, [(header::SET_COOKIE, access.set_cookie(&headers, "", 0))]).into_response()
}

impl Access {
    fn report(&self, peer: Peer, headers: &HeaderMap) -> Report {
        let now = Instant::now();
        let session = self.cookie(headers).and_then(|number| self.sessions.get(number, now));
        Report {
            scope: self.scope_of(headers, peer).ok(),
            token_needed: !self.tokens().is_empty(),
            exposed: self.exposed,
            images: self.images,
            expires_s: session.map(|session| session.end.saturating_duration_since(now).as_secs()),
        }
    }

    /// The session's number in the request's cookies.
    pub(super) fn cookie<'h>(&self, headers: &'h HeaderMap) -> Option<&'h str> {
        let cookies = headers.get_all(header::COOKIE).iter().filter_map(|value| value.to_str().ok());
        let mut pairs = cookies.flat_map(|value| value.split(';')).filter_map(|pair| pair.trim().split_once('='));
        pairs.find(|(name, _)| *name == self.cookie_name).map(|(_, number)| number)
    }

    /// Out of reach of scripts and of requests that other sites make; over TLS only, if it came over TLS: from doorcam itself, or from
    /// what ends it in front, as the page's origin then tells.
    fn set_cookie(&self, headers: &HeaderMap, number: &str, lifetime_s: u64) -> String {
        let origin = headers.get(header::ORIGIN).map(|origin| origin.as_bytes().starts_with(b"https:"));
        let secure = if self.tls || origin == Some(true) { "; Secure" } else { "" };
        let name = &self.cookie_name;
        format!("{name}={number}; Path=/; HttpOnly; SameSite=Strict; Max-Age={lifetime_s}{secure}")
    }
}
