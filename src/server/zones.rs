//! Drawing zones over REST.

use axum::body::Bytes;
use axum::extract::State;
use axum::extract::rejection::BytesRejection;
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use utoipa::ToSchema;

use super::answers::{Busy, Failed, Malformed, PEOPLE, TooLarge, Unfit};
use super::jobs::Kind;
use super::people::Zones;
use super::problem::ProblemDetails;
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
    responses(
        (status = 200, description = "The zones", body = Zones),
        (status = 400, response = Malformed), (status = 413, response = TooLarge),
        (status = 422, response = Unfit), (status = 500, response = Failed), (status = 503, response = Busy),
    )
)]
pub(super) async fn put(State(shared): State<Shared>, body: Result<Bytes, BytesRejection>) -> Response {
    match ProblemDetails::body::<Drawn>(body) {
        Ok(Drawn { zones }) => changed(shared, move |keeper| keeper.replace(zones)).await,
        Err(problem) => problem.into_response(),
    }
}

/// Goes back to the configured zones.
#[utoipa::path(
    delete, path = "/zones", tag = PEOPLE,
    responses(
        (status = 200, description = "The zones", body = Zones), (status = 500, response = Failed),
        (status = 503, response = Busy),
    )
)]
pub(super) async fn delete(State(shared): State<Shared>) -> Response {
    changed(shared, ZoneKeeper::forget).await
}

/// Makes a change and answers like GET.
async fn changed(
    shared: Shared,
    change: impl FnOnce(&ZoneKeeper) -> Result<(), ZonesRefused> + Send + 'static,
) -> Response {
    let keeper = shared.zones.clone();
    match shared.jobs.run(Kind::Writing, move || change(&keeper)).await {
        Ok(Ok(())) => people::zones(State(shared)).await,
        Ok(Err(e @ ZonesRefused::Unfit(_))) => ProblemDetails::unprocessable(&e.to_string()).into_response(),
        Ok(Err(e)) => ProblemDetails::internal(&e.to_string()).into_response(),
        Err(problem) => problem.into_response(),
    }
}
