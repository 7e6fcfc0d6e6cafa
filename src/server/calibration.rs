//! The calibration over REST: reading the one in use, checking another, and replacing it.

use std::sync::Arc;

use axum::Json;
use axum::body::Bytes;
use axum::extract::State;
use axum::extract::rejection::BytesRejection;
use axum::http::{HeaderMap, header};
use axum::response::{IntoResponse, Response};

use super::Shared;
use super::answers::{
    Busy, Conflicting, Failed, IF_MATCH, Malformed, NotYet, PICTURES, Picture, SETUP, Stale, TooLarge, UNCHANGED,
    Unfit, Unknown,
};
use super::jobs::Kind;
use super::problem::ProblemDetails;
use super::tag;
use crate::watch::{CalibrationRefused, CalibrationReport, Calibrator, Precondition};
use doorcam_core::calibration::{Calibration, Check};
use doorcam_source::image::encode_jpeg;

/// JPEG quality of the reference picture.
const QUALITY: u8 = 90;

/// The calibration in use, how good it is, and whether it can be changed.
#[utoipa::path(
    get, path = "/calibration", tag = SETUP,
    responses(
        (status = 200, description = "The calibration", body = CalibrationReport),
        (status = 304, description = UNCHANGED), (status = 500, response = Failed), (status = 503, response = Busy),
    )
)]
pub(super) async fn get(State(shared): State<Shared>, asked: HeaderMap) -> Response {
    blocking(shared, Kind::Reading, move |calibrator| tag::json(&asked, &calibrator.report())).await
}

/// Checks how good a calibration would be, without using it.
#[utoipa::path(
    post, path = "/calibration/check", tag = SETUP, request_body = Calibration,
    responses(
        (status = 200, description = "How good it would be; `ok` says whether it can be used", body = Check),
        (status = 400, response = Malformed), (status = 413, response = TooLarge), (status = 500, response = Failed),
        (status = 503, response = Busy),
    )
)]
pub(super) async fn check(State(shared): State<Shared>, body: Result<Bytes, BytesRejection>) -> Response {
    blocking(shared, Kind::Calibrating, move |calibrator| match ProblemDetails::body::<Calibration>(body) {
        Ok(calibration) => Json(calibrator.check(&calibration)).into_response(),
        Err(problem) => problem.into_response(),
    })
    .await
}

/// Replaces the calibration from the next frame on, and keeps the previous one.
#[utoipa::path(
    put, path = "/calibration", tag = SETUP, request_body = Calibration,
    params(("If-Match" = Option<String>, Header, description = IF_MATCH)),
    responses(
        (status = 200, description = "It is used from the next frame on", body = CalibrationReport),
        (status = 400, response = Malformed), (status = 409, response = Conflicting), (status = 412, response = Stale),
        (status = 413, response = TooLarge), (status = 422, response = Unfit), (status = 500, response = Failed),
        (status = 503, response = Busy),
    )
)]
pub(super) async fn put(
    State(shared): State<Shared>,
    asked: HeaderMap,
    body: Result<Bytes, BytesRejection>,
) -> Response {
    // Parsing a long calibration takes too long for an async worker.
    let parsed = shared.jobs.run(Kind::Calibrating, || ProblemDetails::body::<Calibration>(body)).await;
    match parsed.flatten() {
        Ok(calibration) => {
            let replaced = shared.calibrator.replace(calibration, only_if(&asked)).await;
            changed(shared, replaced).await
        }
        Err(problem) => problem.into_response(),
    }
}

/// Goes back to the previous calibration, from the next frame on.
#[utoipa::path(
    post, path = "/calibration/previous", tag = SETUP,
    params(("If-Match" = Option<String>, Header, description = IF_MATCH)),
    responses(
        (status = 200, description = "It is used from the next frame on", body = CalibrationReport),
        (status = 404, response = Unknown), (status = 409, response = Conflicting), (status = 412, response = Stale),
        (status = 422, response = Unfit), (status = 500, response = Failed), (status = 503, response = Busy),
    )
)]
pub(super) async fn previous(State(shared): State<Shared>, asked: HeaderMap) -> Response {
    let restored = shared.calibrator.restore(only_if(&asked)).await;
    changed(shared, restored).await
}

/// The picture of the empty room, small and grey, by which doorcam notices that the camera has moved. 404 before it is
/// taken.
#[utoipa::path(
    get, path = "/calibration/reference.jpg", tag = PICTURES,
    responses(
        (status = 200, description = "A JPEG", content((Picture = "image/jpeg"))),
        (status = 404, response = NotYet), (status = 500, response = Failed), (status = 503, response = Busy),
    )
)]
pub(super) async fn reference(State(shared): State<Shared>) -> Response {
    let Some(picture) = shared.hub.latest().and_then(|latest| latest.reference.clone()) else {
        return ProblemDetails::not_found("there is no picture of the empty room yet").into_response();
    };
    let encoded = shared.jobs.run(Kind::Drawing, move || encode_jpeg(&picture.image(), QUALITY)).await;
    match encoded {
        Ok(Ok(bytes)) => ([(header::CONTENT_TYPE, "image/jpeg")], bytes).into_response(),
        Ok(Err(e)) => ProblemDetails::internal(&e.to_string()).into_response(),
        Err(problem) => problem.into_response(),
    }
}

/// The condition that a request's If-Match sets.
fn only_if(asked: &HeaderMap) -> Precondition {
    let asked = asked.clone();
    Box::new(move |report| tag::may_change(&asked, report))
}

async fn changed(shared: Shared, result: Result<(), CalibrationRefused>) -> Response {
    let Err(e) = result else {
        return blocking(shared, Kind::Reading, |calibrator| tag::json(&HeaderMap::new(), &calibrator.report())).await;
    };
    let problem = match &e {
        CalibrationRefused::Fixed(_) | CalibrationRefused::Ended | CalibrationRefused::Superseded => {
            ProblemDetails::conflict
        }
        CalibrationRefused::Stale => ProblemDetails::precondition_failed,
        CalibrationRefused::Unfit(_) => ProblemDetails::unprocessable,
        CalibrationRefused::NoPrevious => ProblemDetails::not_found,
        CalibrationRefused::Store(_) | CalibrationRefused::Internal => ProblemDetails::internal,
    };
    problem(&e.to_string()).into_response()
}

/// Runs `work` as a job: parsing a long calibration, fitting and building a model take too long for an async worker.
async fn blocking(shared: Shared, kind: Kind, work: impl FnOnce(&Calibrator) -> Response + Send + 'static) -> Response {
    let jobs = Arc::clone(&shared.jobs);
    let done = jobs.run(kind, move || work(&shared.calibrator)).await;
    done.unwrap_or_else(IntoResponse::into_response)
}
