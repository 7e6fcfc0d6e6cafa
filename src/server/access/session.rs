//! `/api/v1/session`: a browser sends a token once and is known by a cookie from then on.

use std::sync::Arc;
use std::time::Instant;

use axum::Json;
use axum::body::Bytes;
use axum::extract::rejection::QueryRejection;
use axum::extract::{Extension, Query, State};
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};

use super::tokens::Scope;
use super::{Access, Peer};
use crate::server::answers::{Failed, Malformed, STATE, TooLarge, TooMany, WrongToken};
use crate::server::problem::ProblemDetails;

/// The path of the session, which is open to everybody.
pub(super) const PATH: &str = "/api/v1/session";

/// What a client may do, and what it should know about access.
#[derive(Debug, Serialize, ToSchema)]
#[schema(as = Session)]
pub(in crate::server) struct Report {
    /// What the client may do; null if it needs a token first.
    #[schema(required)]
    scope: Option<Scope>,
    /// Whether doorcam has tokens.
    token_needed: bool,
    /// Whether everybody in the network may do everything.
    exposed: bool,
    /// Whether pictures of the visible side are shown.
    images: bool,
    /// Seconds until the client's session ends; null without one.
    #[schema(required)]
    expires_s: Option<u64>,
    /// Why changes and live sockets of a page of the `origin` that was asked about are refused; null if they are not.
    #[schema(required)]
    refusal: Option<String>,
}

/// The query parameters of a question about the session.
#[derive(Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
pub(in crate::server) struct Asked {
    /// The page's own origin, such as `https://door.lan`. A browser does not tell it when a page only looks.
    origin: Option<String>,
}

/// What a browser sends to begin a session.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(in crate::server) struct Login {
    /// The token.
    token: String,
}

/// What this client may do.
#[utoipa::path(
    get, path = "/session", tag = STATE, params(Asked),
    responses(
        (status = 200, description = "What the client may do", body = Report), (status = 400, response = Malformed),
    )
)]
pub(in crate::server) async fn tell(
    State(access): State<Arc<Access>>,
    Extension(peer): Extension<Peer>,
    asked: Result<Query<Asked>, QueryRejection>,
    headers: HeaderMap,
) -> Response {
    let Ok(Query(Asked { origin })) = asked else {
        return ProblemDetails::bad_request("expected origin=SCHEME://HOST:PORT once, or nothing").into_response();
    };
    let pass = access.pass_of(&headers, peer).await.ok();
    let now = Instant::now();
    let session = access.cookie(&headers).and_then(|number| access.session(number, now));
    let report = Report {
        expires_s: session.map(|session| session.end.saturating_duration_since(now).as_secs()),
        refusal: origin.and_then(|origin| access.refusal_of(origin.as_bytes(), &headers)),
        ..access.report(pass.map(|pass| pass.scope()))
    };
    Json(report).into_response()
}

/// Begins a session: the client sends a token once, and a cookie from then on.
#[utoipa::path(
    post, path = "/session", tag = STATE, request_body = Login,
    responses(
        (status = 200, description = "The session has begun, or no token is needed", body = Report),
        (status = 400, response = Malformed), (status = 401, response = WrongToken),
        (status = 413, response = TooLarge), (status = 429, response = TooMany), (status = 500, response = Failed),
    )
)]
pub(in crate::server) async fn begin(
    State(access): State<Arc<Access>>,
    Extension(peer): Extension<Peer>,
    headers: HeaderMap,
    body: Bytes,
) -> Response {
    // serde would also accept a list of the values.
    let is_object = body.trim_ascii_start().starts_with(b"{");
    let Some(Login { token }) = serde_json::from_slice(&body).ok().filter(|_| is_object) else {
        // serde's own message could contain the token.
        return ProblemDetails::bad_request("expected {\"token\": \"...\"}").into_response();
    };
    if access.tokens().is_empty() {
        return Json(access.report(Some(Scope::Control))).into_response();
    }
    let grant = match access.grant_of(token.trim().as_bytes(), &headers, peer).await {
        Ok(grant) => grant,
        Err(refusal) => return refusal.into_response(),
    };
    // The previous session, perhaps of another scope, ends.
    access.cookie(&headers).into_iter().for_each(|number| access.end_session(number));
    let number = match access.sessions.begin(grant, Instant::now()) {
        Ok(number) => number,
        Err(e) => return ProblemDetails::internal(&format!("no random numbers for a session: {e}")).into_response(),
    };
    // One that this one has pushed out takes with it what it let in.
    access.changes.send_replace(());
    let lifetime = access.sessions.lifetime().as_secs();
    let cookie = access.set_cookie(&headers, &number, lifetime);
    let report = Report { scope: Some(grant.scope), expires_s: Some(lifetime), ..access.report(None) };
    ([(header::SET_COOKIE, cookie)], Json(report)).into_response()
}

/// Ends the session, if there is one.
#[utoipa::path(
    delete, path = "/session", tag = STATE,
    responses((status = 204, description = "There is no session any more"))
)]
pub(in crate::server) async fn end(State(access): State<Arc<Access>>, headers: HeaderMap) -> Response {
    access.cookie(&headers).into_iter().for_each(|number| access.end_session(number));
    (StatusCode::NO_CONTENT, [(header::SET_COOKIE, access.set_cookie(&headers, "", 0))]).into_response()
}

impl Access {
    /// A report to a client without a session.
    fn report(&self, scope: Option<Scope>) -> Report {
        Report {
            scope,
            token_needed: !self.tokens().is_empty(),
            exposed: self.exposed,
            images: self.images,
            expires_s: None,
            refusal: None,
        }
    }

    /// The session's number in the request's cookies.
    pub(super) fn cookie<'h>(&self, headers: &'h HeaderMap) -> Option<&'h str> {
        let cookies = headers.get_all(header::COOKIE).iter().filter_map(|value| value.to_str().ok());
        let mut pairs = cookies.flat_map(|value| value.split(';')).filter_map(|pair| pair.trim().split_once('='));
        pairs.find(|(name, _)| *name == self.cookie_name).map(|(_, number)| number)
    }

    /// A cookie that neither scripts nor requests of other sites can use. It is limited to TLS if the client uses TLS,
    /// with doorcam itself or with a proxy in front, as the page's origin then shows.
    fn set_cookie(&self, headers: &HeaderMap, number: &str, lifetime_s: u64) -> String {
        let origin = headers.get(header::ORIGIN).map(|origin| origin.as_bytes().starts_with(b"https:"));
        let secure = if self.tls || origin == Some(true) { "; Secure" } else { "" };
        let name = &self.cookie_name;
        format!("{name}={number}; Path=/; HttpOnly; SameSite=Strict; Max-Age={lifetime_s}{secure}")
    }
}
