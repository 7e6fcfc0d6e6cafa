//! The calibration, over REST: what is in use, what another would be worth, and its replacement.

use axum::Json;
use axum::body::Bytes;
use axum::extract::State;
use axum::response::{IntoResponse, Response};

use super::Shared;
use super::problem::Problem;
use crate::measurement::Calibration;
use crate::pipeline::{CalibrationRefused, Calibrator};

/// GET /api/v1/calibration
pub(super) async fn get(State(shared): State<Shared>) -> Response {
    blocking(shared, |calibrator| Json(calibrator.report()).into_response()).await
}

/// POST /api/v1/calibration/check: nothing is changed.
pub(super) async fn check(State(shared): State<Shared>, body: Bytes) -> Response {
    let calibration: Calibration = match Problem::read(&body) {
        Ok(calibration) => calibration,
        Err(problem) => return problem.into_response(),
    };
    blocking(shared, move |calibrator| Json(calibrator.check(&calibration)).into_response()).await
}

/// PUT /api/v1/calibration
pub(super) async fn put(State(shared): State<Shared>, body: Bytes) -> Response {
    let calibration: Calibration = match Problem::read(&body) {
        Ok(calibration) => calibration,
        Err(problem) => return problem.into_response(),
    };
    blocking(shared, move |calibrator| changed(calibrator, calibrator.replace(calibration))).await
}

/// POST /api/v1/calibration/previous
pub(super) async fn previous(State(shared): State<Shared>) -> Response {
    blocking(shared, |calibrator| changed(calibrator, calibrator.restore())).await
}

fn changed(calibrator: &Calibrator, result: Result<(), CalibrationRefused>) -> Response {
    match result {
        Ok(()) => Json(calibrator.report()).into_response(),
        Err(e) => {
            let problem = match &e {
                CalibrationRefused::Fixed(_) | CalibrationRefused::Ended => Problem::conflict,
                CalibrationRefused::Unfit(_) => Problem::unprocessable,
                CalibrationRefused::NoPrevious => Problem::not_found,
                CalibrationRefused::Store(_) => Problem::internal,
            };
            problem(&e.to_string()).into_response()
        }
    }
}

/// Fitting, and building a model, take longer than a request's thread may be held.
async fn blocking(shared: Shared, work: impl FnOnce(&Calibrator) -> Response + Send + 'static) -> Response {
    match tokio::task::spawn_blocking(move || work(&shared.calibrator)).await {
        Ok(response) => response,
        Err(_) => Problem::internal("the calibration failed on an internal error").into_response(),
    }
}
