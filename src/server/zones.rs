//! Zones that somebody draws, over REST.

use axum::body::Bytes;
use axum::extract::State;
use axum::response::{IntoResponse, Response};
use serde::Deserialize;

use super::problem::Problem;
use super::{Shared, people};
use crate::pipeline::{ZoneKeeper, ZonesRefused};
use crate::tracking::Zone;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Drawn {
    zones: Vec<Zone>,
}

/// PUT /api/v1/zones: all of them at once.
pub(super) async fn put(State(shared): State<Shared>, body: Bytes) -> Response {
    match Problem::read::<Drawn>(&body) {
        Ok(Drawn { zones }) => changed(shared, move |keeper| keeper.replace(zones)).await,
        Err(problem) => problem.into_response(),
    }
}

/// DELETE /api/v1/zones: back to those of the configuration.
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
