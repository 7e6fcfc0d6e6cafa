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
use super::answers::{Busy, Conflicting, Failed, NotReady, NotYet, PICTURES, Picture, ROOM, SETUP, STATE, UNCHANGED};
use super::jobs::Kind;
use super::problem::ProblemDetails;
use super::tag::{self, Tag};
use crate::config::Config;
use crate::history::HistoryReport;
use crate::publish::PublishReport;
use crate::watch::{Command, Status, Watching};
use doorcam_core::geometry::{Doorway, Point, Room};
use doorcam_core::schema;
use doorcam_core::tracking::Zone;
use doorcam_engine::figures::RenderError;
use doorcam_engine::{Published, Update, Watched};

/// The doorway, the hidden room and the facets of the map, in metres in the door frame.
#[derive(Serialize, ToSchema)]
pub(super) struct Geometry {
    /// Number of the calibration that this geometry belongs to. Updates with another number have another geometry.
    calibration: u32,
    /// The opening.
    doorway: Doorway,
    /// The part of the hidden room that the map covers.
    room: Room,
    /// The part where people are looked for and followed.
    searched: Room,
    /// The floor patches.
    patch: PatchReport,
    /// The two ends of each facet on the floor plan. The `index` of an update's facets counts in this list.
    #[schema(value_type = Vec<schema::Segment>)]
    facets: Vec<[Point; 2]>,
    /// Per facet, whether it is in the foreground, where people are; the others show the walls.
    foreground: Vec<bool>,
    /// How often the zones have changed in this run.
    zones_revision: u32,
    /// The named parts of the room.
    zones: Vec<Zone>,
}

/// The floor patches: one at each edge, on the visible side.
#[derive(Serialize, ToSchema)]
struct PatchReport {
    /// Side of the square patch, in metres.
    fov_m: f64,
    /// Pixels along each side.
    pixels: usize,
}

/// The state of doorcam.
#[derive(Serialize, ToSchema)]
pub(super) struct StatusReport {
    /// The frame loop and its source.
    #[serde(flatten)]
    watch: Status,
    /// How events and occupancy are kept.
    history: HistoryReport,
    /// How they are published to MQTT and webhooks.
    publish: PublishReport,
}

/// State, source, frame counts and rates.
#[utoipa::path(
    get, path = "/status", tag = STATE,
    responses((status = 200, description = "The state", body = StatusReport))
)]
pub(super) async fn status(State(shared): State<Shared>) -> Json<StatusReport> {
    let watch = shared.hub.status(shared.clients.load(Ordering::Relaxed));
    Json(StatusReport { watch, history: shared.history.report(), publish: shared.publishers.report() })
}

/// The doorway, the room, the patches and the facets. 404 without a calibration.
#[utoipa::path(
    get, path = "/geometry", tag = ROOM,
    responses(
        (status = 200, description = "The geometry", body = Geometry), (status = 304, description = UNCHANGED),
        (status = 404, response = NotYet),
    )
)]
pub(super) async fn geometry(State(shared): State<Shared>, asked: HeaderMap) -> Response {
    let Some(Watched { model, calibration, .. }) = shared.hub.watched() else {
        return ProblemDetails::not_found("the camera is not calibrated yet: see /api/v1/calibration").into_response();
    };
    let geometry = Geometry {
        calibration,
        doorway: model.doorway,
        room: model.grid.room,
        searched: model.searched,
        patch: PatchReport { fov_m: model.patch.fov_m, pixels: model.patch.size },
        facets: model.grid.facets.iter().map(|f| [f.from, f.to]).collect(),
        foreground: model.grid.foreground.clone(),
        zones_revision: shared.hub.zones_revision(),
        zones: shared.hub.zones(),
    };
    tag::json(&asked, &geometry)
}

/// The newest update, the same object that the live socket sends. 404 before the first.
#[utoipa::path(
    get, path = "/reconstruction", tag = ROOM,
    responses((status = 200, description = "The update", body = Update), (status = 404, response = NotYet))
)]
pub(super) async fn reconstruction(State(shared): State<Shared>) -> Response {
    match shared.hub.latest() {
        Some(latest) => {
            ([(header::CONTENT_TYPE, "application/json")], shared.hub.json(&latest).to_string()).into_response()
        }
        None => ProblemDetails::not_found("there is no update yet").into_response(),
    }
}

/// The newest update as a figure: the left and right views and the unified map, at the brightness that
/// `scene.brightness` sets.
#[utoipa::path(
    get, path = "/reconstruction.png", tag = PICTURES,
    responses(
        (status = 200, description = "A PNG", body = Picture, content_type = "image/png"),
        (status = 304, description = UNCHANGED),
        (status = 404, response = NotYet), (status = 500, response = Failed), (status = 503, response = Busy),
    )
)]
pub(super) async fn reconstruction_png(State(shared): State<Shared>, asked: HeaderMap) -> Response {
    picture(shared, &asked, |shared, latest| {
        let watched = shared.hub.watched().filter(|w| w.calibration == latest.update.calibration)?;
        shared.pictures.reconstruction(&watched.model, latest)
    })
    .await
}

/// The difference between the two floor patches and those of the empty room, with magnified colours.
#[utoipa::path(
    get, path = "/difference.png", tag = PICTURES,
    responses(
        (status = 200, description = "A PNG", body = Picture, content_type = "image/png"),
        (status = 304, description = UNCHANGED),
        (status = 404, response = NotYet), (status = 500, response = Failed), (status = 503, response = Busy),
    )
)]
pub(super) async fn difference_png(State(shared): State<Shared>, asked: HeaderMap) -> Response {
    picture(shared, &asked, |shared, latest| shared.pictures.difference(latest)).await
}

/// The two floor patches as measured, left and right.
#[utoipa::path(
    get, path = "/patches.png", tag = PICTURES,
    responses(
        (status = 200, description = "A PNG", body = Picture, content_type = "image/png"),
        (status = 304, description = UNCHANGED),
        (status = 404, response = NotYet), (status = 500, response = Failed), (status = 503, response = Busy),
    )
)]
pub(super) async fn patches_png(State(shared): State<Shared>, asked: HeaderMap) -> Response {
    picture(shared, &asked, |shared, latest| shared.pictures.patches(latest)).await
}

/// Draws the newest update on a blocking thread, unless the client already has that picture.
async fn picture(
    shared: Shared,
    asked: &HeaderMap,
    draw: impl FnOnce(&Shared, &Arc<Published>) -> Option<Result<Bytes, RenderError>> + Send + 'static,
) -> Response {
    let none = || ProblemDetails::not_found("there is no map yet: the empty room is being learned").into_response();
    let Some(latest) = shared.hub.latest() else { return none() };
    let tag = Tag::numbered(shared.run, latest.update.sequence);
    let drawn = match tag.is_known(asked) {
        true => Some(Ok(Bytes::new())),
        false => match Arc::clone(&shared.jobs).run(Kind::Drawing, move || draw(&shared, &latest)).await {
            Ok(drawn) => drawn,
            Err(problem) => return problem.into_response(),
        },
    };
    match drawn {
        Some(Ok(png)) => tag.answer(asked, || ([(header::CONTENT_TYPE, "image/png")], png)),
        Some(Err(e)) => ProblemDetails::internal(&e.to_string()).into_response(),
        None => none(),
    }
}

/// The configuration in use, including defaults but no secrets.
#[utoipa::path(
    get, path = "/config", tag = SETUP,
    responses(
        (status = 200, description = "The configuration", body = Config), (status = 304, description = UNCHANGED),
    )
)]
pub(super) async fn config(State(shared): State<Shared>, asked: HeaderMap) -> Response {
    // Nothing in it is secret: it only names files with secrets, and a webhook's URL is serialised without its path.
    tag::json(&asked, &*shared.config.borrow())
}

/// Learns the empty room again, from the next frame on.
#[utoipa::path(
    post, path = "/background/reset", tag = SETUP,
    responses((status = 202, description = "Accepted"), (status = 409, response = Conflicting))
)]
pub(super) async fn reset_background(State(shared): State<Shared>) -> Response {
    if shared.control.tell(Command::ResetBackground) {
        return StatusCode::ACCEPTED.into_response();
    }
    ProblemDetails::conflict("the source has ended: no frames will come to learn from").into_response()
}

/// Whether doorcam is watching, as `watching` in the status says; the problem names the reason.
#[utoipa::path(
    get, path = "/readyz", tag = STATE,
    responses((status = 200, description = "It is watching, learning the empty room, or obstructed for the moment, and says which", body = String), (status = 503, response = NotReady))
)]
pub(super) async fn readyz(State(shared): State<Shared>) -> Response {
    let Watching { reason, since, .. } = shared.hub.watching();
    match reason {
        None => "ready\n".into_response(),
        Some(reason) if reason.passes() => format!("ready: {}\n", reason.words()).into_response(),
        Some(reason) => {
            let (name, words) = (reason.name(), reason.words());
            let detail = format!("{name}: not watching since {since:.0}: {words}; see /api/v1/status");
            ProblemDetails::unavailable(&detail).into_response()
        }
    }
}

/// Whether the process answers at all.
#[utoipa::path(
    get, path = "/livez", tag = STATE,
    responses((status = 200, description = "The process answers", body = String))
)]
pub(super) async fn livez() -> &'static str {
    "alive\n"
}

/// Metrics in the text format of Prometheus.
#[utoipa::path(
    get, path = "/metrics", tag = STATE,
    responses((status = 200, description = "The metrics", body = String))
)]
pub(super) async fn prometheus(State(shared): State<Shared>) -> Response {
    metrics::gauge!("doorcam_clients").set(shared.clients.load(Ordering::Relaxed) as f64);
    let kind = [(header::CONTENT_TYPE, "text/plain; version=0.0.4; charset=utf-8")];
    let mut text = shared.metrics.as_ref().map(PrometheusHandle::render).unwrap_or_default();
    // Not by way of the recorder: whether doorcam is watching changes with time alone, and is one answer.
    text.push_str(&shared.hub.exposition());
    (kind, text).into_response()
}
