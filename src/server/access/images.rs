use axum::extract::Request;
use axum::http::StatusCode;
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

use crate::server::problem::Problem;

/// What shows the visible side as the camera sees it, all of it or the floor.
const IMAGES: [&str; 3] = ["/api/v1/frame.jpg", "/api/v1/stream.mjpg", "/api/v1/patches.png"];

/// Keeps the camera's pictures to itself.
pub(super) async fn withhold(request: Request, next: Next) -> Response {
    if IMAGES.contains(&request.uri().path()) {
        let detail = "pictures of the visible side are switched off: see access.images";
        return Problem::new(StatusCode::FORBIDDEN, detail).into_response();
    }
    next.run(request).await
}
