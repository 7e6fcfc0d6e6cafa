use std::sync::{Mutex, PoisonError};

use axum::body::Bytes;
use axum::extract::State;
use axum::http::{HeaderName, HeaderValue, header};
use axum::response::{IntoResponse, Response};

use super::Shared;
use super::problem::Problem;
use crate::pipeline::Seen;
use crate::source::RawImages;
use crate::source::image::{Image, ImageError};

/// Quality of JPEGs made of raw pixels: for people to look at and to mark points in.
const QUALITY: u8 = 90;

/// The last picture encoded, and the number of its frame. The lock is held while encoding, so that many who ask at once wait
/// for one encoding.
pub(super) type Encoded = Mutex<Option<(u64, Bytes)>>;

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
            (kind, Ok(Bytes::from(bytes.to_vec())))
        }
        RawImages::Sensor(..) => {
            let encoding = tokio::task::spawn_blocking(move || encoded(&shared.encoded, &seen));
            let Ok(encoded) = encoding.await else {
                return Problem::internal("encoding the picture failed").into_response();
            };
            ("image/jpeg", encoded)
        }
    };
    match body {
        Ok(body) => {
            ([(header::CONTENT_TYPE, HeaderValue::from_static(kind)), (CAPTURED, captured)], body).into_response()
        }
        Err(e) => Problem::internal(&e.to_string()).into_response(),
    }
}

fn encoded(cache: &Encoded, seen: &Seen) -> Result<Bytes, ImageError> {
    let mut cache = cache.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some((number, bytes)) = &*cache
        && *number == seen.number
    {
        return Ok(bytes.clone());
    }
    let RawImages::Sensor(format, bytes) = &seen.images else { return Ok(Bytes::new()) };
    let bytes = Bytes::from(Image::from_sensor(format, bytes)?.to_jpeg(QUALITY)?);
    *cache = Some((seen.number, bytes.clone()));
    Ok(bytes)
}
