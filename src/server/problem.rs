use axum::body::Bytes;
use axum::extract::rejection::BytesRejection;
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use doorcam_source::files;
use serde::Serialize;
use serde::de::DeserializeOwned;
use utoipa::ToSchema;

use crate::text::one_line;

/// An error in the form of RFC 9457 (application/problem+json).
#[derive(Debug, Serialize, ToSchema)]
#[schema(as = Problem)]
pub(super) struct ProblemDetails {
    /// The kind of error.
    title: &'static str,
    /// The status code.
    status: u16,
    /// What is wrong, in one line.
    detail: String,
    /// Seconds after which to try again, as the header `Retry-After`.
    #[serde(skip)]
    retry_after_s: Option<u64>,
}

/// When to try again what was too much at the moment, in seconds.
const BUSY_S: u64 = 2;

impl ProblemDetails {
    pub(super) fn new(status: StatusCode, detail: &str) -> Self {
        let title = status.canonical_reason().unwrap_or("Error");
        Self { title, status: status.as_u16(), detail: one_line(detail).into(), retry_after_s: None }
    }

    /// Tells the client to try again after this many seconds.
    pub(super) fn retry_after(self, seconds: u64) -> Self {
        Self { retry_after_s: Some(seconds), ..self }
    }

    /// Parses the JSON body of a request. The problem names the key and what was expected.
    pub(super) fn body<T: DeserializeOwned>(body: Result<Bytes, BytesRejection>) -> Result<T, Self> {
        let body = body?;
        // Without a byte order mark, which JSON does not know.
        let text = files::text(&body).map_err(|e| Self::bad_request(&format!("the body {e}")))?;
        // serde would also accept a list of the values.
        if !text.trim_ascii_start().starts_with('{') {
            return Err(Self::bad_request("expected a JSON object"));
        }
        let mut json = serde_json::Deserializer::from_str(text);
        let read = serde_path_to_error::deserialize(&mut json)
            .map_err(|e| Self::bad_request(&format!("{}: {}", e.path(), e.inner())))?;
        json.end().map_err(|e| Self::bad_request(&format!("after the object: {e}")))?;
        Ok(read)
    }

    pub(super) fn not_found(detail: &str) -> Self {
        Self::new(StatusCode::NOT_FOUND, detail)
    }

    pub(super) fn bad_request(detail: &str) -> Self {
        Self::new(StatusCode::BAD_REQUEST, detail)
    }

    pub(super) fn precondition_failed(detail: &str) -> Self {
        Self::new(StatusCode::PRECONDITION_FAILED, detail)
    }

    pub(super) fn unprocessable(detail: &str) -> Self {
        Self::new(StatusCode::UNPROCESSABLE_ENTITY, detail)
    }

    pub(super) fn conflict(detail: &str) -> Self {
        Self::new(StatusCode::CONFLICT, detail)
    }

    pub(super) fn method_not_allowed(detail: &str) -> Self {
        Self::new(StatusCode::METHOD_NOT_ALLOWED, detail)
    }

    pub(super) fn upgrade_required(detail: &str) -> Self {
        Self::new(StatusCode::UPGRADE_REQUIRED, detail)
    }

    pub(super) fn unavailable(detail: &str) -> Self {
        Self::new(StatusCode::SERVICE_UNAVAILABLE, detail)
    }

    /// More is asked for at the same time than doorcam takes on: `what` says of what.
    pub(super) fn busy(what: &str) -> Self {
        Self::unavailable(&format!("{what}, try again in {BUSY_S} s")).retry_after(BUSY_S)
    }

    pub(super) fn internal(detail: &str) -> Self {
        Self::new(StatusCode::INTERNAL_SERVER_ERROR, detail)
    }
}

impl From<BytesRejection> for ProblemDetails {
    fn from(rejection: BytesRejection) -> Self {
        Self::new(rejection.status(), &rejection.body_text())
    }
}

impl IntoResponse for ProblemDetails {
    fn into_response(self) -> Response {
        let status = StatusCode::from_u16(self.status).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR);
        let body = serde_json::to_string(&self).unwrap_or_default();
        let mut response = (status, [(header::CONTENT_TYPE, "application/problem+json")], body).into_response();
        if let Some(seconds) = self.retry_after_s {
            response.headers_mut().insert(header::RETRY_AFTER, HeaderValue::from(seconds));
        }
        response
    }
}
