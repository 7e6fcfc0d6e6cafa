use std::time::Duration;

use axum::body::{Body, to_bytes};
use axum::extract::Request;
use axum::http::StatusCode;
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use tokio::time::timeout;

use super::session;
use crate::server::problem::ProblemDetails;

/// Longest body of a request, in bytes. Even a calibration with ten thousand points gets a detailed error.
const LONGEST: usize = 2 * 1024 * 1024;
/// Longest body of a login, in bytes, which anybody may send.
const LONGEST_LOGIN: usize = 1024;
/// How long the body may take to arrive.
const BODY_TIME: Duration = Duration::from_secs(10);
/// How long the answer may take to begin: a calibration builds the whole model again.
const ANSWER_TIME: Duration = Duration::from_secs(60);

/// Reads the whole body before the route runs, so that a large or slow one cannot hold it up.
pub(super) async fn limit(request: Request, next: Next) -> Response {
    let most = if request.uri().path() == session::PATH { LONGEST_LOGIN } else { LONGEST };
    let (head, body) = request.into_parts();
    let body = match timeout(BODY_TIME, to_bytes(body, most)).await {
        Ok(Ok(body)) => body,
        Ok(Err(_)) => {
            let detail = format!("the body is cut off or longer than {most} bytes");
            return ProblemDetails::new(StatusCode::PAYLOAD_TOO_LARGE, &detail).into_response();
        }
        Err(_) => {
            let detail = format!("the body did not arrive within {} s", BODY_TIME.as_secs());
            return ProblemDetails::new(StatusCode::REQUEST_TIMEOUT, &detail).into_response();
        }
    };
    let answer = next.run(Request::from_parts(head, Body::from(body)));
    timeout(ANSWER_TIME, answer).await.unwrap_or_else(|_| {
        ProblemDetails::unavailable(&format!("no answer within {} s", ANSWER_TIME.as_secs())).into_response()
    })
}
