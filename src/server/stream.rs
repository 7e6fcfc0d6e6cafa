//! The camera's images as they come, in one endless answer (multipart/x-mixed-replace, known as MJPEG).

use std::convert::Infallible;
use std::pin::Pin;
use std::sync::Arc;
use std::time::Duration;

use axum::body::{Body, Bytes};
use axum::extract::rejection::QueryRejection;
use axum::extract::{Extension, Query, State};
use axum::http::header;
use axum::response::{IntoResponse, Response};
use futures_util::stream;
use serde::Deserialize;
use tokio::sync::watch;
use tokio::time::{Instant, sleep_until};
use utoipa::IntoParams;

use super::Shared;
use super::access::Pass;
use super::answers::{Malformed, NotYet, PICTURES, Picture};
use super::frame::picture;
use super::live::until;
use super::problem::ProblemDetails;
use crate::watch::CapturedImages;
use doorcam_source::RawImages;

/// The query parameters of `/stream.mjpg`.
#[derive(Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct Pace {
    /// At most this many pictures a second; without it, all of them.
    #[param(minimum = 0.01, maximum = 240.0)]
    fps: Option<f64>,
}

/// What the camera sees, as a stream of pictures (`multipart/x-mixed-replace`).
///
/// Each part has `content-type`, `content-length` and `x-captured`. Each is the newest picture; a slow client misses
/// those in between. The stream ends when doorcam does, and when what let the client in has ended. 404 before the first
/// frame, and for recordings of rectified patches.
#[utoipa::path(
    get, path = "/stream.mjpg", tag = PICTURES, params(Pace),
    responses(
        (
            status = 200, description = "The stream",
            body = Picture, content_type = "multipart/x-mixed-replace; boundary=frame",
        ),
        (status = 400, response = Malformed), (status = 404, response = NotYet),
    )
)]
pub(super) async fn stream(
    State(shared): State<Shared>,
    Extension(pass): Extension<Pass>,
    pace: Result<Query<Pace>, QueryRejection>,
) -> Response {
    let pause = match pace {
        Ok(Query(Pace { fps: None })) => Duration::ZERO,
        Ok(Query(Pace { fps: Some(fps) })) if (0.01..=240.0).contains(&fps) => Duration::from_secs_f64(1.0 / fps),
        _ => {
            return ProblemDetails::bad_request("expected fps=0.01 to 240 pictures a second, or nothing")
                .into_response();
        }
    };
    match shared.hub.seen() {
        None => return ProblemDetails::not_found("there is no frame yet").into_response(),
        Some(CapturedImages { images: RawImages::Patches(_), .. }) => {
            return ProblemDetails::not_found("this source gives rectified patches, not a camera's image")
                .into_response();
        }
        Some(_) => {}
    }
    let mut frames = shared.hub.frames();
    frames.mark_changed();
    let end = {
        let (mut ending, let_in) = (shared.ending.clone(), Arc::clone(&shared.access).ended(pass));
        async move {
            tokio::select! {
                () = until(&mut ending) => {}
                () = let_in => {}
            }
        }
    };
    let parts = Parts { end: Box::pin(end), shared, frames, pause, due: Instant::now(), begun: false };
    let body = stream::unfold(parts, |mut parts| async move {
        let part = parts.next().await?;
        Some((Ok::<_, Infallible>(part), parts))
    });
    let kind = [(header::CONTENT_TYPE, "multipart/x-mixed-replace; boundary=frame")];
    (kind, Body::from_stream(body)).into_response()
}

/// The parts of one client's stream. Each is made only after the previous one was taken, so nothing piles up.
struct Parts {
    shared: Shared,
    frames: watch::Receiver<Option<CapturedImages>>,
    /// Completes when doorcam ends or the client may no longer see it.
    end: Pin<Box<dyn Future<Output = ()> + Send>>,
    pause: Duration,
    due: Instant,
    begun: bool,
}

impl Parts {
    /// The newest picture not sent yet; `None` at the end.
    async fn next(&mut self) -> Option<Bytes> {
        loop {
            tokio::select! {
                () = &mut self.end => return None,
                () = sleep_until(self.due) => {}
            }
            tokio::select! {
                () = &mut self.end => return None,
                changed = self.frames.changed() => changed.ok()?,
            }
            let seen = self.frames.borrow_and_update().clone()?;
            self.due = Instant::now() + self.pause;
            // A picture that cannot be encoded is skipped, like a broken frame.
            if let Ok((kind, picture)) = picture(&self.shared, &seen).await {
                return Some(self.part(kind, &picture, &seen));
            }
        }
    }

    fn part(&mut self, kind: &str, picture: &[u8], seen: &CapturedImages) -> Bytes {
        let begin = if self.begun { "" } else { "--frame\r\n" };
        self.begun = true;
        let (length, time) = (picture.len(), seen.time);
        let head = format!("{begin}Content-Type: {kind}\r\nContent-Length: {length}\r\nX-Captured: {time}\r\n\r\n");
        // The next boundary follows at once, because browsers show a part only when they have seen its end.
        [head.as_bytes(), picture, b"\r\n--frame\r\n"].concat().into()
    }
}
