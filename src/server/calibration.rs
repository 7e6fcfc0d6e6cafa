//! The calibration, over REST: what is in use, what another would be worth, and its replacement.

use axum::Json;
use axum::body::Bytes;
use axum::extract::State;
use axum::extract::rejection::BytesRejection;
use axum::http::HeaderMap;
use axum::response::{IntoResponse, Response};

use super::Shared;
use super::openapi::{Conflicting, Failed, Malformed, SETUP, TooLarge, UNCHANGED, Unfit, Unknown};
use super::problem::Problem;
use super::tag;
use crate::watch::{CalibrationRefused, CalibrationReport, Calibrator};
use doorcam_core::calibration::{Calibration, Check};

/// The calibration in use, what it is worth, and whether it can be changed.
#[utoipa::path(
    get, path = "/calibration", tag = SETUP,
    responses(
        (status = 200, description = "The calibration", body = CalibrationReport), (status = 304, description = UNCHANGED),
        (status = 500, response = Failed),
    )
)]
pub(super) async fn get(State(shared): State<Shared>, asked: HeaderMap) -> Response {
    blocking(shared, move |calibrator| tag::json(&asked, &calibrator.report())).await
}

/// What a calibration would be worth: nothing is changed.
#[utoipa::path(
    post, path = "/calibration/check", tag = SETUP, request_body = Calibration,
    responses(
        (status = 200, description = "What it would be worth; `ok` tells whether it can be used", body = Check),
        (status = 400, response = Malformed), (status = 413, response = TooLarge), (status = 500, response = Failed),
    )
)]
pub(super) async fn check(State(shared): State<Shared>, body: Result<Bytes, BytesRejection>) -> Response {
    let calibration: Calibration = match Problem::body(body) {
        Ok(calibration) => calibration,
        Err(problem) => return problem.into_response(),
    };
    blocking(shared, move |calibrator| Json(calibrator.check(&calibration)).into_response()).await
}

/// Uses another calibration from the next frame on, and keeps the one before.
#[utoipa::path(
    put, path = "/calibration", tag = SETUP, request_body = Calibration,
    responses(
        (status = 200, description = "It is used from the next frame on", body = CalibrationReport),
        (status = 400, response = Malformed), (status = 409, response = Conflicting),
        (status = 413, response = TooLarge), (status = 422, response = Unfit), (status = 500, response = Failed),
    )
)]
pub(super) async fn put(State(shared): State<Shared>, body: Result<Bytes, BytesRejection>) -> Response {
    let calibration: Calibration = match Problem::body(body) {
        Ok(calibration) => calibration,
        Err(problem) => return problem.into_response(),
    };
    blocking(shared, move |calibrator| changed(calibrator, calibrator.replace(calibration))).await
}

/// Uses the calibration before this one again.
#[utoipa::path(
    post, path = "/calibration/previous", tag = SETUP,
    responses(
        (status = 200, description = "It is used from the next frame on", body = CalibrationReport),
        (status = 404, response = Unknown), (status = 409, response = Conflicting),
        (status = 422, response = Unfit), (status = 500, response = Failed),
    )
)]
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
