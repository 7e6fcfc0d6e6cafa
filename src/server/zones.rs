//! Zones that somebody draws, over REST.

use axum::body::Bytes;
use axum::extract::State;
use axum::extract::rejection::BytesRejection;
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use utoipa::ToSchema;

use super::openapi::{Failed, Malformed, PEOPLE, TooLarge, Unfit};
use super::people::Zones;
use super::problem::Problem;
use super::{Shared, people};
use crate::watch::{ZoneKeeper, ZonesRefused};
use doorcam_core::tracking::Zone;

/// Zones that somebody draws.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Drawn {
    /// All of them.
    zones: Vec<Zone>,
}

/// Uses other zones from the next frame on, all of them at once, and keeps them.
#[utoipa::path(
    put, path = "/zones", tag = PEOPLE, request_body = Drawn,
    responses(
        (status = 200, description = "The zones", body = Zones),
        (status = 400, response = Malformed), (status = 413, response = TooLarge),
        (status = 422, response = Unfit), (status = 500, response = Failed),
    )
)]
pub(super) async fn put(State(shared): State<Shared>, body: Result<Bytes, BytesRejection>) -> Response {
    match Problem::body::<Drawn>(body) {
        Ok(Drawn { zones }) => changed(shared, move |keeper| keeper.replace(zones)).await,
        Err(problem) => problem.into_response(),
    }
}

/// Goes back to the zones of the configuration.
#[utoipa::path(
    delete, path = "/zones", tag = PEOPLE,
    responses((status = 200, description = "The zones", body = Zones), (status = 500, response = Failed))
)]
pub(super) async fn delete(State(shared): State<Shared>) -> Response {
    changed(shared, ZoneKeeper::forget).await
}

/// Answers as GET does.
async fn changed(
    shared: Shared,
    change: impl FnOnce(&ZoneKeeper) -> Result<(), ZonesRefused> + Send + 'static,
) -> Response {
    let keeper = shared.zones.clone();
    match tokio::task::spawn_blocking(move || change(&keeper)).await {
        Ok(Ok(())) => people::zones(State(shared)).await,
        Ok(Err(e @ ZonesRefused::Unfit(_))) => Problem::unprocessable(&e.to_string()).into_response(),
        Ok(Err(e)) => Problem::internal(&e.to_string()).into_response(),
        Err(_) => Problem::internal("the zones failed on an internal error").into_response(),
    }
}
