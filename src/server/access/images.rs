use axum::extract::Request;
use axum::http::StatusCode;
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

use crate::server::problem::ProblemDetails;

/// The routes that show the visible side as the camera sees it, or its floor.
const IMAGES: [&str; 4] =
    ["/api/v1/frame.jpg", "/api/v1/stream.mjpg", "/api/v1/patches.png", "/api/v1/calibration/reference.jpg"];

/// Refuses requests for the camera's pictures.
pub(super) async fn withhold(request: Request, next: Next) -> Response {
    if IMAGES.contains(&request.uri().path()) {
        let detail = "pictures of the visible side are switched off: see access.images";
        return ProblemDetails::new(StatusCode::FORBIDDEN, detail).into_response();
    }
    next.run(request).await
}
