//! Recordings, over REST: how the one under way is doing, its beginning and its end.

use axum::Json;
use axum::body::Bytes;
use axum::extract::State;
use axum::extract::rejection::BytesRejection;
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};

use super::Shared;
use super::openapi::{Conflicting, Failed, Malformed, SETUP, TooLarge, Unfit, Unknown};
use super::problem::Problem;
use crate::watch::{RecordingRefused, RecordingReport, RecordingWish};

/// Whether something can be recorded, and how the recording under way is doing.
#[utoipa::path(
    get, path = "/recording", tag = SETUP,
    responses((status = 200, description = "How it is", body = RecordingReport))
)]
pub(super) async fn get(State(shared): State<Shared>) -> Json<RecordingReport> {
    Json(report(&shared))
}

/// Begins to record what the source gives, into a directory of its own.
#[utoipa::path(
    post, path = "/recording", tag = SETUP, request_body = Option<RecordingWish>,
    responses(
        (status = 201, description = "It has begun", body = RecordingReport),
        (status = 400, response = Malformed), (status = 409, response = Conflicting), (status = 413, response = TooLarge),
        (status = 422, response = Unfit), (status = 500, response = Failed),
    )
)]
pub(super) async fn post(State(shared): State<Shared>, body: Result<Bytes, BytesRejection>) -> Response {
    let wish = match body {
        Ok(body) if matches!(body.trim_ascii(), b"" | b"null") => Ok(RecordingWish::default()),
        body => Problem::body(body),
    };
    match wish {
        Ok(wish) => {
            changed(shared, StatusCode::CREATED, move |shared| {
                shared.recordings.start(&wish, shared.calibrator.calibration().as_ref())
            })
            .await
        }
        Err(problem) => problem.into_response(),
    }
}

/// Ends the recording: answers when all of it is on the disk.
#[utoipa::path(
    delete, path = "/recording", tag = SETUP,
    responses(
        (status = 200, description = "It has ended", body = RecordingReport),
        (status = 404, response = Unknown), (status = 500, response = Failed),
    )
)]
pub(super) async fn delete(State(shared): State<Shared>) -> Response {
    changed(shared, StatusCode::OK, |shared| shared.recordings.stop()).await
}

fn report(shared: &Shared) -> RecordingReport {
    shared.recordings.report(shared.calibrator.calibration().as_ref())
}

/// Disks take longer than a request's thread may be held.
async fn changed(
    shared: Shared,
    done: StatusCode,
    change: impl FnOnce(&Shared) -> Result<(), RecordingRefused> + Send + 'static,
) -> Response {
    let changing = tokio::task::spawn_blocking(move || change(&shared).map(|()| report(&shared)));
    match changing.await {
        Ok(Ok(report)) => (done, Json(report)).into_response(),
        Ok(Err(refused)) => problem(&refused).into_response(),
        Err(_) => Problem::internal("the recording failed on an internal error").into_response(),
    }
}

fn problem(refused: &RecordingRefused) -> Problem {
    use doorcam_source::recorder::RecordError;

    let kind = match refused {
        RecordingRefused::Name(_) | RecordingRefused::Seconds(..) => Problem::unprocessable,
        RecordingRefused::NotRecording => Problem::not_found,
        RecordingRefused::Write(RecordError::Write { .. } | RecordError::Thread(_)) => Problem::internal,
        _ => Problem::conflict,
    };
    kind(&refused.to_string())
}
