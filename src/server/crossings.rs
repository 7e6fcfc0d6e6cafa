//! Who walked through the doorway, over REST.

use axum::Json;
use axum::body::Bytes;
use axum::extract::State;
use axum::extract::rejection::BytesRejection;
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use utoipa::ToSchema;

use super::Shared;
use super::answers::{Busy, Failed, Malformed, PEOPLE, TooLarge, Unfit};
use super::jobs::Kind;
use super::problem::ProblemDetails;
use crate::watch::{CrossingsReport, InsideRefused};

/// How many people are inside, as somebody knows who looked.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Counted {
    /// How many.
    #[schema(value_type = u32, maximum = 1000)]
    inside: serde_json::Number,
}

/// Who walked through the doorway: counts since midnight, local time, and an estimate of how many are inside.
#[utoipa::path(
    get, path = "/crossings", tag = PEOPLE,
    responses((status = 200, description = "The crossings", body = CrossingsReport))
)]
pub(super) async fn get(State(shared): State<Shared>) -> Json<CrossingsReport> {
    Json(shared.hub.crossings())
}

/// Sets the estimate of how many people are inside right. It is kept, and goes on from there.
#[utoipa::path(
    put, path = "/crossings", tag = PEOPLE, request_body = Counted,
    responses(
        (status = 200, description = "The crossings", body = CrossingsReport),
        (status = 400, response = Malformed), (status = 413, response = TooLarge), (status = 422, response = Unfit),
        (status = 500, response = Failed), (status = 503, response = Busy),
    )
)]
pub(super) async fn put(State(shared): State<Shared>, body: Result<Bytes, BytesRejection>) -> Response {
    let Counted { inside } = match ProblemDetails::body(body) {
        Ok(counted) => counted,
        Err(problem) => return problem.into_response(),
    };
    let keeper = shared.crossings.clone();
    match shared.jobs.clone().run(Kind::Writing, move || keeper.set_inside(&inside)).await {
        Ok(Ok(())) => get(State(shared)).await.into_response(),
        Ok(Err(e @ InsideRefused::Unfit(_))) => ProblemDetails::unprocessable(&e.to_string()).into_response(),
        Ok(Err(e)) => ProblemDetails::internal(&e.to_string()).into_response(),
        Err(problem) => problem.into_response(),
    }
}
