//! Drawing zones over REST.

use axum::body::Bytes;
use axum::extract::State;
use axum::extract::rejection::BytesRejection;
use axum::http::HeaderMap;
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use utoipa::ToSchema;

use super::answers::{Busy, Failed, IF_MATCH, Malformed, PEOPLE, Stale, TooLarge, Unfit};
use super::jobs::Kind;
use super::people::Zones;
use super::problem::ProblemDetails;
use super::tag::Edition;
use super::{Shared, people};
use crate::watch::{ZoneKeeper, ZonesRefused};
use doorcam_core::tracking::Zone;

/// Zones that a user has drawn.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Drawn {
    /// All zones.
    zones: Vec<Zone>,
}

/// Replaces all zones from the next frame on, and keeps the new ones.
#[utoipa::path(
    put, path = "/zones", tag = PEOPLE, request_body = Drawn,
    params(("If-Match" = Option<String>, Header, description = IF_MATCH)),
    responses(
        (status = 200, description = "The zones", body = Zones),
        (status = 400, response = Malformed), (status = 412, response = Stale), (status = 413, response = TooLarge),
        (status = 422, response = Unfit), (status = 500, response = Failed), (status = 503, response = Busy),
    )
)]
pub(super) async fn put(
    State(shared): State<Shared>,
    asked: HeaderMap,
    body: Result<Bytes, BytesRejection>,
) -> Response {
    match ProblemDetails::body::<Drawn>(body) {
        Ok(Drawn { zones }) => changed(shared, asked, move |keeper, only_if| keeper.replace(zones, only_if)).await,
        Err(problem) => problem.into_response(),
    }
}

/// Goes back to the configured zones.
#[utoipa::path(
    delete, path = "/zones", tag = PEOPLE,
    params(("If-Match" = Option<String>, Header, description = IF_MATCH)),
    responses(
        (status = 200, description = "The zones", body = Zones), (status = 412, response = Stale),
        (status = 500, response = Failed), (status = 503, response = Busy),
    )
)]
pub(super) async fn delete(State(shared): State<Shared>, asked: HeaderMap) -> Response {
    changed(shared, asked, |keeper, only_if| keeper.forget(only_if)).await
}

/// Makes a change, if the client knows the zones as they are now, and answers like GET.
async fn changed(
    shared: Shared,
    asked: HeaderMap,
    change: impl FnOnce(&ZoneKeeper, &dyn Fn(u32) -> bool) -> Result<(), ZonesRefused> + Send + 'static,
) -> Response {
    let (keeper, run) = (shared.zones.clone(), shared.run);
    let only_if = move |revision| Edition::new(run, revision).may_change(&asked);
    match shared.jobs.run(Kind::Writing, move || change(&keeper, &only_if)).await {
        Ok(Ok(())) => people::zones(State(shared), HeaderMap::new()).await,
        Ok(Err(e @ ZonesRefused::Unfit(_))) => ProblemDetails::unprocessable(&e.to_string()).into_response(),
        Ok(Err(e @ ZonesRefused::Stale)) => ProblemDetails::precondition_failed(&e.to_string()).into_response(),
        Ok(Err(e)) => ProblemDetails::internal(&e.to_string()).into_response(),
        Err(problem) => problem.into_response(),
    }
}
