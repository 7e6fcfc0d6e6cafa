use axum::body::Bytes;
use axum::extract::State;
use axum::http::{HeaderName, HeaderValue, header};
use axum::response::{IntoResponse, Response};

use super::Shared;
use super::problem::Problem;
use crate::source::RawImages;

/// When the picture was captured, RFC 3339.
const CAPTURED: HeaderName = HeaderName::from_static("x-captured");

/// GET /api/v1/frame.jpg: what the camera sees, the newest frame. A PNG if the recording has PNGs.
pub(super) async fn frame(State(shared): State<Shared>) -> Response {
    let Some(seen) = shared.hub.seen() else {
        return Problem::not_found("there is no frame yet").into_response();
    };
    let captured = HeaderValue::from_str(&seen.time.to_string()).unwrap_or(HeaderValue::from_static(""));
    let (kind, body) = match &seen.images {
        RawImages::Patches(_) => {
            return Problem::not_found("this source gives rectified patches, not a camera's image").into_response();
        }
        RawImages::Camera(bytes) => {
            let kind = if bytes.starts_with(b"\x89PNG") { "image/png" } else { "image/jpeg" };
            (kind, Bytes::from(bytes.to_vec()))
        }
        RawImages::Sensor(..) => return Problem::not_found("raw pixels cannot be shown yet").into_response(),
    };
    ([(header::CONTENT_TYPE, HeaderValue::from_static(kind)), (CAPTURED, captured)], body).into_response()
}
