//! Recordings over REST: state, start and end.

use std::sync::Arc;

use axum::Json;
use axum::body::Bytes;
use axum::extract::State;
use axum::extract::rejection::BytesRejection;
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};

use super::Shared;
use super::answers::{Busy, Conflicting, Failed, Malformed, SETUP, TooLarge, Unfit, Unknown};
use super::jobs::Kind;
use super::problem::ProblemDetails;
use crate::watch::{RecordingRefused, RecordingReport, RecordingWish};

/// Whether a recording can be started, and the state of the one under way.
#[utoipa::path(
    get, path = "/recording", tag = SETUP,
    responses((status = 200, description = "The state", body = RecordingReport))
)]
pub(super) async fn get(State(shared): State<Shared>) -> Json<RecordingReport> {
    Json(report(&shared))
}

/// Starts to record the source into a new directory.
#[utoipa::path(
    post, path = "/recording", tag = SETUP, request_body = Option<RecordingWish>,
    responses(
        (status = 201, description = "The recording has started", body = RecordingReport),
        (status = 400, response = Malformed), (status = 409, response = Conflicting),
        (status = 413, response = TooLarge), (status = 422, response = Unfit), (status = 500, response = Failed),
        (status = 503, response = Busy),
    )
)]
pub(super) async fn post(State(shared): State<Shared>, body: Result<Bytes, BytesRejection>) -> Response {
    let wish = match body {
        Ok(body) if matches!(body.trim_ascii(), b"" | b"null") => Ok(RecordingWish::default()),
        body => ProblemDetails::body(body),
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

/// Ends the recording; answers once all of it is on the disk.
#[utoipa::path(
    delete, path = "/recording", tag = SETUP,
    responses(
        (status = 200, description = "The recording has ended", body = RecordingReport),
        (status = 404, response = Unknown), (status = 500, response = Failed), (status = 503, response = Busy),
    )
)]
pub(super) async fn delete(State(shared): State<Shared>) -> Response {
    changed(shared, StatusCode::OK, |shared| shared.recordings.stop()).await
}

fn report(shared: &Shared) -> RecordingReport {
    shared.recordings.report(shared.calibrator.calibration().as_ref())
}

/// Makes a change as a job, because it may wait for the disk.
async fn changed(
    shared: Shared,
    done: StatusCode,
    change: impl FnOnce(&Shared) -> Result<(), RecordingRefused> + Send + 'static,
) -> Response {
    let jobs = Arc::clone(&shared.jobs);
    match jobs.run(Kind::Writing, move || change(&shared).map(|()| report(&shared))).await {
        Ok(Ok(report)) => (done, Json(report)).into_response(),
        Ok(Err(refused)) => problem(&refused).into_response(),
        Err(problem) => problem.into_response(),
    }
}

fn problem(refused: &RecordingRefused) -> ProblemDetails {
    use doorcam_source::recorder::RecordError;

    let kind = match refused {
        RecordingRefused::Name(_) | RecordingRefused::Path { .. } | RecordingRefused::Seconds(..) => {
            ProblemDetails::unprocessable
        }
        RecordingRefused::NotRecording => ProblemDetails::not_found,
        RecordingRefused::Write(RecordError::Write { .. } | RecordError::Thread(_)) => ProblemDetails::internal,
        _ => ProblemDetails::conflict,
    };
    kind(&refused.to_string())
}
