use std::sync::Arc;
use std::sync::atomic::Ordering;

use axum::Json;
use axum::body::Bytes;
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use metrics_exporter_prometheus::PrometheusHandle;
use serde::Serialize;
use utoipa::ToSchema;

use super::Shared;
use super::openapi::{Conflicting, Failed, NotReady, NotYet, PICTURES, Picture, ROOM, SETUP, STATE, UNCHANGED};
use super::problem::Problem;
use super::tag::{self, Tag};
use crate::config::Config;
use crate::history::HistoryReport;
use crate::publish::PublishReport;
use crate::watch::{Command, Status};
use doorcam_core::geometry::{Doorway, Point, Room};
use doorcam_core::schema;
use doorcam_core::tracking::Zone;
use doorcam_engine::figures::RenderError;
use doorcam_engine::{Published, Update, Watched};

/// The doorway, the room and what the map is made of, in the door frame.
#[derive(Serialize, ToSchema)]
pub(super) struct Geometry {
    /// Which calibration it is of: updates of another one have another geometry.
    calibration: u32,
    /// The opening.
    doorway: Doorway,
    /// The hidden room that the map covers.
    room: Room,
    /// The floor patches.
    patch: PatchReport,
    /// The ends of each facet on the floor plan; an update's facets are indices in here.
    #[schema(value_type = Vec<schema::Segment>)]
    facets: Vec<[Point; 2]>,
    /// Per facet, whether it is where people are; the rest shows walls.
    foreground: Vec<bool>,
    /// Counts changes of the zones in this run.
    zones_revision: u32,
    /// The parts of the room that have names.
    zones: Vec<Zone>,
}

/// The floor patches: one at each edge, on the visible side.
#[derive(Serialize, ToSchema)]
struct PatchReport {
    /// Side of the square of floor, in metres.
    fov_m: f64,
    /// Pixels along each side.
    pixels: usize,
}

/// How doorcam is doing.
#[derive(Serialize, ToSchema)]
pub(super) struct StatusReport {
    /// The watch.
    #[serde(flatten)]
    watch: Status,
    /// How events and occupancy are kept.
    history: HistoryReport,
    /// Who is told of them.
    publish: PublishReport,
}

/// State, source, counts of frames, rates.
#[utoipa::path(get, path = "/status", tag = STATE, responses((status = 200, description = "The state", body = StatusReport)))]
pub(super) async fn status(State(shared): State<Shared>) -> Json<StatusReport> {
    let watch = shared.hub.status(shared.clients.load(Ordering::Relaxed));
    Json(StatusReport { watch, history: shared.history.report(), publish: shared.publishers.report() })
}

/// Doorway, room, patches and facets. 404 before there is a calibration.
#[utoipa::path(
    get, path = "/geometry", tag = ROOM,
    responses((status = 200, description = "The geometry", body = Geometry), (status = 304, description = UNCHANGED), (status = 404, response = NotYet))
)]
pub(super) async fn geometry(State(shared): State<Shared>, asked: HeaderMap) -> Response {
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
    tag::json(&asked, &geometry)
}

/// The newest update: the same object that the live socket sends. 404 before the first.
#[utoipa::path(
    get, path = "/reconstruction", tag = ROOM,
    responses((status = 200, description = "The update", body = Update), (status = 404, response = NotYet))
)]
pub(super) async fn reconstruction(State(shared): State<Shared>) -> Response {
    match shared.hub.latest() {
        Some(latest) => ([(header::CONTENT_TYPE, "application/json")], latest.json.to_string()).into_response(),
        None => Problem::not_found("there is no update yet").into_response(),
    }
}

/// The newest update as a figure: the left and right views and the unified map, in the brightness that `scene.brightness`
/// of the configuration says.
#[utoipa::path(
    get, path = "/reconstruction.png", tag = PICTURES,
    responses(
        (status = 200, description = "A PNG", body = Picture, content_type = "image/png"),
        (status = 304, description = UNCHANGED),
        (status = 404, response = NotYet), (status = 500, response = Failed),
    )
)]
pub(super) async fn reconstruction_png(State(shared): State<Shared>, asked: HeaderMap) -> Response {
    picture(shared, &asked, |shared, latest| {
        let watched = shared.hub.watched().filter(|w| w.calibration == latest.update.calibration)?;
        shared.pictures.reconstruction(&watched.model, latest)
    })
    .await
}

/// The difference of the two floor patches from the empty room, magnified in colour.
#[utoipa::path(
    get, path = "/difference.png", tag = PICTURES,
    responses(
        (status = 200, description = "A PNG", body = Picture, content_type = "image/png"),
        (status = 304, description = UNCHANGED),
        (status = 404, response = NotYet), (status = 500, response = Failed),
    )
)]
pub(super) async fn difference_png(State(shared): State<Shared>, asked: HeaderMap) -> Response {
    picture(shared, &asked, |shared, latest| shared.pictures.difference(latest)).await
}

/// The two floor patches as they are measured, left and right.
#[utoipa::path(
    get, path = "/patches.png", tag = PICTURES,
    responses(
        (status = 200, description = "A PNG", body = Picture, content_type = "image/png"),
        (status = 304, description = UNCHANGED),
        (status = 404, response = NotYet), (status = 500, response = Failed),
    )
)]
pub(super) async fn patches_png(State(shared): State<Shared>, asked: HeaderMap) -> Response {
    picture(shared, &asked, |shared, latest| shared.pictures.patches(latest)).await
}

/// Draws the newest update on a thread that may take its time, unless the client has that picture already.
async fn picture(
    shared: Shared,
    asked: &HeaderMap,
    draw: impl FnOnce(&Shared, &Arc<Published>) -> Option<Result<Bytes, RenderError>> + Send + 'static,
) -> Response {
    let none = || Problem::not_found("there is no map yet: the empty room is being learned").into_response();
    let Some(latest) = shared.hub.latest() else { return none() };
    let tag = Tag::numbered(shared.run, latest.update.sequence);
    let drawn = match tag.is_known(asked) {
        true => Some(Ok(Bytes::new())),
        false => match tokio::task::spawn_blocking(move || draw(&shared, &latest)).await {
            Ok(drawn) => drawn,
            Err(_) => return Problem::internal("drawing the picture failed").into_response(),
        },
    };
    match drawn {
        Some(Ok(png)) => tag.answer(asked, || ([(header::CONTENT_TYPE, "image/png")], png)),
        Some(Err(e)) => Problem::internal(&e.to_string()).into_response(),
        None => none(),
    }
}

/// The configuration in use, defaults included and secrets left out.
#[utoipa::path(get, path = "/config", tag = SETUP, responses((status = 200, description = "The configuration", body = Config), (status = 304, description = UNCHANGED)))]
pub(super) async fn config(State(shared): State<Shared>, asked: HeaderMap) -> Response {
    // Nothing in it is secret: it names files with secrets, and a webhook's address is written without its path.
    tag::json(&asked, &*shared.config.borrow())
}

/// Learns the empty room anew, from the next frame on.
#[utoipa::path(
    post, path = "/background/reset", tag = SETUP,
    responses((status = 202, description = "It will be"), (status = 409, response = Conflicting))
)]
pub(super) async fn reset_background(State(shared): State<Shared>) -> Response {
    if shared.control.tell(Command::ResetBackground) {
        return StatusCode::ACCEPTED.into_response();
    }
    Problem::conflict("the source has ended: no frames will come to learn from").into_response()
}

/// Whether updates are of now.
#[utoipa::path(
    get, path = "/readyz", tag = STATE,
    responses((status = 200, description = "They are", body = String), (status = 503, response = NotReady))
)]
pub(super) async fn readyz(State(shared): State<Shared>) -> Response {
    if shared.hub.is_fresh() {
        return "ready\n".into_response();
    }
    Problem::unavailable("no fresh update: see /api/v1/status").into_response()
}

/// Whether the process answers at all.
#[utoipa::path(get, path = "/livez", tag = STATE, responses((status = 200, description = "It does", body = String)))]
pub(super) async fn livez() -> &'static str {
    "alive\n"
}

/// Figures for Prometheus, in its text format.
#[utoipa::path(get, path = "/metrics", tag = STATE, responses((status = 200, description = "The figures", body = String)))]
pub(super) async fn prometheus(State(shared): State<Shared>) -> Response {
    metrics::gauge!("doorcam_clients").set(shared.clients.load(Ordering::Relaxed) as f64);
    let kind = [(header::CONTENT_TYPE, "text/plain; version=0.0.4; charset=utf-8")];
    (kind, shared.metrics.as_ref().map(PrometheusHandle::render).unwrap_or_default()).into_response()
}
