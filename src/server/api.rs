use std::sync::atomic::Ordering;

use axum::Json;
use axum::body::Bytes;
use axum::extract::State;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Serialize;

use super::Shared;
use super::problem::Problem;
use crate::geometry::{Doorway, Point, Room};
use crate::pipeline::{Command, Status, Watched};
use crate::render::RenderError;
use crate::tracking::Zone;

/// GET /api/v1/geometry, in the door frame.
#[derive(Serialize)]
pub(super) struct Geometry {
    calibration: u32,
    doorway: Doorway,
    room: Room,
    patch: PatchReport,
    facets: Vec<[Point; 2]>,
    foreground: Vec<bool>,
    zones_revision: u32,
    zones: Vec<Zone>,
}

#[derive(Serialize)]
struct PatchReport {
    fov_m: f64,
    pixels: usize,
}

pub(super) async fn status(State(shared): State<Shared>) -> Json<Status> {
    Json(shared.hub.status(shared.clients.load(Ordering::Relaxed)))
}

pub(super) async fn geometry(State(shared): State<Shared>) -> Response {
    let Some(Watched { model, calibration }) = shared.hub.watched() else {
        return Problem::not_found("the camera is not calibrated yet: see /api/v1/calibration").into_response();
    };
    let geometry = Geometry {
        calibration,
        doorway: model.doorway,
        room: model.grid.room,
        patch: PatchReport { fov_m: model.patch.fov_m, pixels: model.patch.size },
        facets: model.grid.facets.iter().map(|f| [f.from, f.to]).collect(),
        foreground: model.grid.foreground.clone(),
        zones_revision: shared.hub.zones_revision(),
        zones: shared.hub.zones(),
    };
    Json(geometry).into_response()
}

pub(super) async fn reconstruction(State(shared): State<Shared>) -> Response {
    match shared.hub.latest() {
        Some(latest) => ([(header::CONTENT_TYPE, "application/json")], latest.json.to_string()).into_response(),
        None => Problem::not_found("there is no update yet").into_response(),
    }
}

pub(super) async fn reconstruction_png(State(shared): State<Shared>) -> Response {
    picture(shared, |shared| {
        let latest = shared.hub.latest()?;
        let watched = shared.hub.watched().filter(|w| w.calibration == latest.update.calibration)?;
        shared.pictures.reconstruction(&watched.model, &latest)
    })
    .await
}

pub(super) async fn difference_png(State(shared): State<Shared>) -> Response {
    picture(shared, |shared| shared.pictures.difference(&shared.hub.latest()?)).await
}

pub(super) async fn patches_png(State(shared): State<Shared>) -> Response {
    picture(shared, |shared| shared.pictures.patches(&shared.hub.latest()?)).await
}

/// Draws on a thread that may take its time.
async fn picture(
    shared: Shared,
    draw: impl FnOnce(&Shared) -> Option<Result<Bytes, RenderError>> + Send + 'static,
) -> Response {
    match tokio::task::spawn_blocking(move || draw(&shared)).await {
        Ok(Some(Ok(png))) => ([(header::CONTENT_TYPE, "image/png")], png).into_response(),
        Ok(Some(Err(e))) => Problem::internal(&e.to_string()).into_response(),
        Ok(None) => Problem::not_found("there is no map yet: the empty room is being learned").into_response(),
        Err(_) => Problem::internal("drawing the picture failed").into_response(),
    }
}

/// Learns the empty room anew, from the next frame on.
pub(super) async fn reset_background(State(shared): State<Shared>) -> Response {
    if shared.control.tell(Command::ResetBackground) {
        return StatusCode::ACCEPTED.into_response();
    }
    Problem::conflict("the source has ended: no frames will come to learn from").into_response()
}

/// 200 while updates are of now, 503 otherwise.
pub(super) async fn readyz(State(shared): State<Shared>) -> Response {
    if shared.hub.is_fresh() {
        return "ready\n".into_response();
    }
    Problem::unavailable("no fresh update: see /api/v1/status").into_response()
}
