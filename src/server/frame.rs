use std::sync::{Arc, Mutex, PoisonError};

use axum::body::Bytes;
use axum::extract::State;
use axum::http::{HeaderMap, HeaderName, header};
use axum::response::{IntoResponse, Response};

use super::Shared;
use super::answers::{Busy, Failed, NotYet, PICTURES, Picture, UNCHANGED};
use super::jobs::Kind;
use super::problem::ProblemDetails;
use super::tag::Tag;
use crate::watch::CapturedImages;
use doorcam_source::RawImages;
use doorcam_source::image::ImageError;
use doorcam_source::image::{decode_sensor, encode_jpeg};

/// JPEG quality for frames of raw pixels, which people look at and mark points in.
const QUALITY: u8 = 90;

/// The last picture encoded, with the number of its frame. The lock is held while encoding, so that simultaneous
/// requests share one encoding.
pub(super) type Encoded = Mutex<Option<(u64, Bytes)>>;

/// When the picture was captured, RFC 3339.
pub(super) const CAPTURED: HeaderName = HeaderName::from_static("x-captured");

/// The newest frame as the camera sees it. 404 before the first, and for recordings of rectified patches.
#[utoipa::path(
    get, path = "/frame.jpg", tag = PICTURES,
    responses(
        (
            status = 200, description = "A JPEG, or a PNG where a recording has PNGs",
            content((Picture = "image/jpeg"), (Picture = "image/png")),
            headers(("x-captured" = String, description = "When it was captured, RFC 3339")),
        ),
        (status = 304, description = UNCHANGED), (status = 404, response = NotYet), (status = 500, response = Failed),
        (status = 503, response = Busy),
    )
)]
pub(super) async fn frame(State(shared): State<Shared>, asked: HeaderMap) -> Response {
    let Some(seen) = shared.hub.seen() else {
        return ProblemDetails::not_found("there is no frame yet").into_response();
    };
    let tag = Tag::numbered(shared.run, seen.number);
    if tag.is_known(&asked) {
        return tag.answer(&asked, || ());
    }
    match picture(&shared, &seen).await {
        Ok((kind, body)) => {
            let captured = seen.time.to_string();
            tag.answer(&asked, || ([(header::CONTENT_TYPE, kind.to_owned()), (CAPTURED, captured)], body))
        }
        Err(problem) => problem.into_response(),
    }
}

/// The content type and file of a frame, which is encoded only once however many clients ask for it.
pub(super) async fn picture(shared: &Shared, seen: &CapturedImages) -> Result<(&'static str, Bytes), ProblemDetails> {
    match &seen.images {
        RawImages::Patches(_) => {
            Err(ProblemDetails::not_found("this source gives rectified patches, not a camera's image"))
        }
        RawImages::Camera(bytes) => {
            let kind = if bytes.starts_with(b"\x89PNG") { "image/png" } else { "image/jpeg" };
            Ok((kind, Bytes::from_owner(File(Arc::clone(bytes)))))
        }
        RawImages::Sensor(..) => {
            if let Some(bytes) = known(&shared.encoded, seen.number) {
                return Ok(("image/jpeg", bytes));
            }
            let (cache, seen) = (Arc::clone(&shared.encoded), seen.clone());
            let bytes = shared.jobs.run(Kind::Drawing, move || encoded(&cache, &seen)).await?;
            bytes.map(|bytes| ("image/jpeg", bytes)).map_err(|e| ProblemDetails::internal(&e.to_string()))
        }
    }
}

/// A frame's file, shared without copying.
struct File(Arc<Vec<u8>>);

impl AsRef<[u8]> for File {
    fn as_ref(&self) -> &[u8] {
        &self.0
    }
}

/// The picture of a frame, if it is encoded already. Never waits for the one who is encoding it.
fn known(cache: &Encoded, number: u64) -> Option<Bytes> {
    let cache = cache.try_lock().ok()?;
    cache.as_ref().filter(|(of, _)| *of == number).map(|(_, bytes)| bytes.clone())
}

fn encoded(cache: &Encoded, seen: &CapturedImages) -> Result<Bytes, ImageError> {
    let mut cache = cache.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some((number, bytes)) = &*cache
        && *number == seen.number
    {
        return Ok(bytes.clone());
    }
    let RawImages::Sensor(format, bytes) = &seen.images else { return Ok(Bytes::new()) };
    let bytes = Bytes::from(encode_jpeg(&decode_sensor(format, bytes)?, QUALITY)?);
    *cache = Some((seen.number, bytes.clone()));
    Ok(bytes)
}
