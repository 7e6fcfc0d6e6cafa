//! Recordings, over REST: how the one under way is doing, its beginning and its end.

use axum::Json;
use axum::body::Bytes;
use axum::extract::State;
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};

use super::Shared;
use super::problem::Problem;
use crate::pipeline::{RecordingRefused, RecordingReport, RecordingWish};

/// GET /api/v1/recording
pub(super) async fn get(State(shared): State<Shared>) -> Json<RecordingReport> {
    Json(report(&shared))
}

/// POST /api/v1/recording
pub(super) async fn post(State(shared): State<Shared>, body: Bytes) -> Response {
    let wish = if body.is_empty() { Ok(RecordingWish::default()) } else { Problem::read(&body) };
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

/// DELETE /api/v1/recording: answers when all of it is on the disk.
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
    use crate::source::recorder::RecordError;

    let kind = match refused {
        RecordingRefused::Name(_) | RecordingRefused::Seconds(..) => Problem::unprocessable,
        RecordingRefused::NotRecording => Problem::not_found,
        RecordingRefused::Write(RecordError::Write { .. } | RecordError::Thread(_)) => Problem::internal,
        _ => Problem::conflict,
    };
    kind(&refused.to_string())
}
