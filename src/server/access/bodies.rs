//! Bodies of requests: how long each may be, how long it may take, and how many bytes all together may hold.

use std::sync::Arc;
use std::time::Duration;

use axum::body::{Body, BodyDataStream, Bytes, HttpBody};
use axum::extract::{Request, State};
use axum::http::{HeaderValue, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use futures_util::{StreamExt, TryStreamExt};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio::time::timeout;

use super::session;
use crate::server::problem::ProblemDetails;

/// Longest calibration, in bytes. Even one with ten thousand points gets a detailed error.
const LONGEST_CALIBRATION: usize = 2 * 1024 * 1024;
/// Longest zones, in bytes: 32 zones of 100 corners, every number in full and on a line of its own.
const LONGEST_ZONES: usize = 256 * 1024;
/// Longest login, in bytes, which anybody may send.
const LONGEST_LOGIN: usize = 1024;
/// Longest body of all other requests, in bytes: a few short keys, if anything.
const LONGEST_OTHER: usize = 4 * 1024;

/// Most bytes that all bodies together hold.
const MOST_AT_ONCE: usize = 16 * 1024 * 1024;
/// Bodies of up to this many bytes are not counted, so that large ones never hold up a login or a few zones. The number
/// of connections bounds them.
const SMALL: usize = 16 * 1024;
/// How long a body waits for others to be done with before it is refused.
const PATIENCE: Duration = Duration::from_secs(2);

/// How long the body may take to arrive.
const BODY_TIME: Duration = Duration::from_secs(10);
/// How long the answer may take to begin: a calibration builds the whole model again.
const ANSWER_TIME: Duration = Duration::from_secs(60);

/// Most bytes of a refused body that are read and thrown away, and how long that may take. A client that is still
/// sending when the connection is closed would see a broken connection and not the answer.
const THROWN_AWAY: usize = 4 * 1024 * 1024;
const THROWING_TIME: Duration = Duration::from_secs(2);

/// Longest body of a request to this path, in bytes.
fn longest(path: &str) -> usize {
    match path {
        "/api/v1/calibration" | "/api/v1/calibration/check" => LONGEST_CALIBRATION,
        "/api/v1/zones" => LONGEST_ZONES,
        session::PATH => LONGEST_LOGIN,
        _ => LONGEST_OTHER,
    }
}

/// Why a body is refused.
#[derive(Debug, PartialEq, Eq)]
enum Refused {
    /// It is longer than its route allows.
    TooLong,
    /// It ended before its declared end, or is not encoded as HTTP has it.
    CutOff,
    /// It did not arrive in time.
    TooSlow,
    /// Other bodies hold all bytes that there are.
    Busy,
}

/// The bytes that bodies may hold all together. Each permit is one byte, taken before it is read.
#[derive(Debug)]
pub(super) struct Budget {
    bytes: Arc<Semaphore>,
    patience: Duration,
}

impl Default for Budget {
    fn default() -> Self {
        Self::new(MOST_AT_ONCE, PATIENCE)
    }
}

impl Budget {
    fn new(bytes: usize, patience: Duration) -> Self {
        Self { bytes: Arc::new(Semaphore::new(bytes)), patience }
    }

    /// The permit to hold this many bytes; small bodies need none. All of it at once: bodies that each hold a part and
    /// wait for the rest would wait for one another.
    async fn take(&self, bytes: usize) -> Result<Option<OwnedSemaphorePermit>, Refused> {
        if bytes <= SMALL {
            return Ok(None);
        }
        let count = u32::try_from(bytes).map_err(|_| Refused::TooLong)?;
        match timeout(self.patience, Arc::clone(&self.bytes).acquire_many_owned(count)).await {
            Ok(Ok(permit)) => Ok(Some(permit)),
            _ => Err(Refused::Busy),
        }
    }

    /// Reads a body of at most `most` bytes. The permit counts its bytes until it is dropped.
    async fn read(
        &self,
        body: &mut BodyDataStream,
        most: usize,
    ) -> Result<(Bytes, Option<OwnedSemaphorePermit>), Refused> {
        let size = HttpBody::size_hint(&*body);
        // A body in chunks does not say how long it is.
        let room = size.upper().map_or(most, |upper| usize::try_from(upper).unwrap_or(usize::MAX));
        if room > most {
            return Err(Refused::TooLong);
        }
        let permit = self.take(room).await?;
        Ok((collect(body, room).await?, permit))
    }
}

/// Collects a body of at most `room` bytes in one block of memory. The parts that arrive are small and are freed at once, and a large block is
/// mapped by itself and returned to the system when it is freed (see src/cli/memory.rs): nothing of a burst stays.
async fn collect(body: &mut BodyDataStream, room: usize) -> Result<Bytes, Refused> {
    let mut bytes = Vec::with_capacity(room);
    let arriving = async {
        while let Some(part) = body.try_next().await.map_err(|_| Refused::CutOff)? {
            if part.len() > room - bytes.len() {
                return Err(Refused::TooLong);
            }
            bytes.extend_from_slice(&part);
        }
        Ok(())
    };
    timeout(BODY_TIME, arriving).await.map_err(|_| Refused::TooSlow)??;
    Ok(bytes.into())
}

/// Reads small bodies before anything can be refused. A refusal would leave them unread, so the connection would have to
/// be closed, and a proxy that has just put its next request on it would answer that with an error of its own. Where
/// more than that is refused, the answer says that the connection ends.
pub(super) async fn settle(request: Request, next: Next) -> Response {
    let (head, body) = request.into_parts();
    let length = HttpBody::size_hint(&body).exact().and_then(|length| usize::try_from(length).ok());
    let body = match length {
        Some(0) => body,
        Some(room) if room <= SMALL => match collect(&mut body.into_data_stream(), room).await {
            Ok(bytes) => Body::from(bytes),
            Err(refused) => return refused.problem(room).into_response(),
        },
        _ => {
            let mut response = next.run(Request::from_parts(head, body)).await;
            if response.status().is_client_error() || response.status().is_server_error() {
                response.headers_mut().insert(header::CONNECTION, HeaderValue::from_static("close"));
            }
            return response;
        }
    };
    next.run(Request::from_parts(head, body)).await
}

/// Reads the whole body before the route runs, so that a large or slow one cannot hold it up.
pub(super) async fn limit(State(budget): State<Arc<Budget>>, request: Request, next: Next) -> Response {
    let most = longest(request.uri().path());
    let asks_first = request.headers().contains_key(header::EXPECT);
    let (head, body) = request.into_parts();
    let mut body = body.into_data_stream();
    let (body, _permit) = match budget.read(&mut body, most).await {
        Ok(read) => read,
        Err(refused) => {
            // Reading on would tell a client that asks first (100-continue) to send its body after all.
            if !asks_first && matches!(refused, Refused::TooLong | Refused::Busy) {
                throw_away(body).await;
            }
            return refused.problem(most).into_response();
        }
    };
    let answer = next.run(Request::from_parts(head, Body::from(body)));
    timeout(ANSWER_TIME, answer).await.unwrap_or_else(|_| {
        ProblemDetails::unavailable(&format!("no answer within {} s", ANSWER_TIME.as_secs())).into_response()
    })
}

async fn throw_away(mut body: BodyDataStream) {
    let reading = async {
        let mut rest = THROWN_AWAY;
        while let Some(Ok(part)) = body.next().await
            && rest > part.len()
        {
            rest -= part.len();
        }
    };
    // Whoever is still sending after that has had its chance.
    let _ = timeout(THROWING_TIME, reading).await;
}

impl Refused {
    fn problem(&self, most: usize) -> ProblemDetails {
        let (status, detail) = match self {
            Self::TooLong => {
                (StatusCode::PAYLOAD_TOO_LARGE, format!("the body is too long, expected at most {most} bytes here"))
            }
            Self::CutOff => (StatusCode::BAD_REQUEST, "the body is cut off or wrongly encoded".into()),
            Self::TooSlow => {
                (StatusCode::REQUEST_TIMEOUT, format!("the body did not arrive within {} s", BODY_TIME.as_secs()))
            }
            Self::Busy => return ProblemDetails::busy("too many large requests at the same time"),
        };
        ProblemDetails::new(status, &detail)
    }
}

#[cfg(test)]
mod tests {
    use std::convert::Infallible;

    use axum::routing::put;
    use axum::{Router, middleware};
    use futures_util::stream;
    use tokio::sync::Notify;
    use tower::ServiceExt;

    use super::*;

    const CALIBRATION: &str = "/api/v1/calibration";

    fn limited(router: Router, budget: &Arc<Budget>) -> Router {
        router.layer(middleware::from_fn_with_state(Arc::clone(budget), limit))
    }

    fn to(path: &str, body: impl Into<Body>) -> Request {
        Request::put(path).body(body.into()).unwrap()
    }

    /// A body that does not say how long it is, as one sent in chunks.
    fn chunks(count: usize) -> Body {
        Body::from_stream(stream::iter((0..count).map(|_| Ok::<_, Infallible>(Bytes::from(vec![b' '; 8192])))))
    }

    #[tokio::test]
    async fn bodies_wait_for_their_bytes_and_give_them_back() {
        let budget = Arc::new(Budget::new(LONGEST_CALIBRATION, Duration::from_millis(50)));
        let (held, go_on) = (Arc::new(Notify::new()), Arc::new(Notify::new()));
        let slow = {
            let (held, go_on) = (Arc::clone(&held), Arc::clone(&go_on));
            move |_: Bytes| async move {
                held.notify_one();
                go_on.notified().await;
                "done"
            }
        };
        let router = Router::new().route(CALIBRATION, put(slow)).route("/api/v1/zones", put(|_: Bytes| async {}));
        let router = limited(router, &budget);
        let large = || vec![b' '; LONGEST_CALIBRATION - 100_000];
        let first = tokio::spawn(router.clone().oneshot(to(CALIBRATION, large())));
        held.notified().await;
        assert_eq!(budget.bytes.available_permits(), 100_000, "the handler runs, and its body is still counted");

        // Neither a declared nor an undeclared length fits now; the answer says when to come back.
        for body in [Body::from(large()), chunks(3)] {
            let refused = router.clone().oneshot(to(CALIBRATION, body)).await.unwrap();
            assert_eq!(refused.status(), StatusCode::SERVICE_UNAVAILABLE);
            assert!(refused.headers().contains_key(header::RETRY_AFTER));
        }
        // Small bodies are never held up.
        for body in [Vec::new(), vec![b' '; SMALL], vec![b' '; 90_000]] {
            assert_eq!(router.clone().oneshot(to("/api/v1/zones", body)).await.unwrap().status(), StatusCode::OK);
        }
        go_on.notify_one();
        assert_eq!(first.await.unwrap().unwrap().status(), StatusCode::OK);
        assert_eq!(budget.bytes.available_permits(), LONGEST_CALIBRATION);
    }

    #[tokio::test]
    async fn each_way_a_body_fails_has_its_own_answer_and_leaves_nothing_held() {
        let budget = Arc::new(Budget::new(MOST_AT_ONCE, Duration::from_millis(50)));
        let router = Router::new().fallback(|body: Bytes| async move { body.len().to_string() });
        let router = limited(router, &budget);
        let status = async |path: &str, body: Body| router.clone().oneshot(to(path, body)).await.unwrap().status();
        for (path, most) in [
            (CALIBRATION, LONGEST_CALIBRATION),
            ("/api/v1/calibration/check", LONGEST_CALIBRATION),
            ("/api/v1/zones", LONGEST_ZONES),
            (session::PATH, LONGEST_LOGIN),
            ("/api/v1/recording", LONGEST_OTHER),
            ("/anything", LONGEST_OTHER),
        ] {
            assert_eq!(status(path, Body::from(vec![b' '; most])).await, StatusCode::OK, "{path}");
            assert_eq!(status(path, Body::from(vec![b' '; most + 1])).await, StatusCode::PAYLOAD_TOO_LARGE, "{path}");
            assert_eq!(status(path, chunks(most / 8192 + 1)).await, StatusCode::PAYLOAD_TOO_LARGE, "{path}");
        }
        let broken = || {
            let parts = [Ok(Bytes::from_static(b"{")), Err(std::io::Error::other("the client is gone"))];
            Body::from_stream(stream::iter(parts))
        };
        assert_eq!(status(CALIBRATION, broken()).await, StatusCode::BAD_REQUEST);
        assert_eq!(status("/api/v1/recording", broken()).await, StatusCode::BAD_REQUEST);
        assert_eq!(budget.bytes.available_permits(), MOST_AT_ONCE);
    }
}
