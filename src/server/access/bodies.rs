use std::time::Duration;

use axum::body::{Body, to_bytes};
use axum::extract::Request;
use axum::http::StatusCode;
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use tokio::time::timeout;

use super::session;
use crate::server::problem::Problem;

/// Longest body of a request. A calibration with ten thousand points is still told what is wrong with it.
const LONGEST: usize = 2 * 1024 * 1024;
/// Longest body of a login, which everybody may send.
const LONGEST_LOGIN: usize = 1024;
/// How long the body may take.
const BODY_TIME: Duration = Duration::from_secs(10);
/// How long the answer may take to begin: a calibration works a whole model out anew.
const ANSWER_TIME: Duration = Duration::from_secs(60);

/// Reads the whole body before anybody works on it, so that no route can be held up by one that is large or slow.
pub(super) async fn limit(request: Request, next: Next) -> Response {
    let most = if request.uri().path() == session::PATH { LONGEST_LOGIN } else { LONGEST };
    let (head, body) = request.into_parts();
    let body = match timeout(BODY_TIME, to_bytes(body, most)).await {
        Ok(Ok(body)) => body,
        Ok(Err(_)) => {
            let detail = format!("the body is cut off or longer than {most} bytes");
            return Problem::new(StatusCode::PAYLOAD_TOO_LARGE, &detail).into_response();
        }
        Err(_) => {
            let detail = format!("the body did not come within {} s", BODY_TIME.as_secs());
            return Problem::new(StatusCode::REQUEST_TIMEOUT, &detail).into_response();
        }
    };
    let answer = next.run(Request::from_parts(head, Body::from(body)));
    timeout(ANSWER_TIME, answer).await.unwrap_or_else(|_| {
        Problem::unavailable(&format!("no answer within {} s", ANSWER_TIME.as_secs())).into_response()
    })
}
