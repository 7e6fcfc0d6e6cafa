use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::{IntoResponse, Response};
use serde::Serialize;
use utoipa::ToSchema;

use super::Shared;
use super::answers::{NotYet, ROOM, UNCHANGED};
use super::problem::ProblemDetails;
use super::tag;
use doorcam_core::geometry::{FoundLight, Leaf, Room, RoomLight};
use doorcam_engine::Watched;

/// What is known of the hidden room, in metres in the door frame.
#[derive(Serialize, ToSchema)]
pub(super) struct RoomReport {
    /// Number of the calibration that this belongs to.
    calibration: u32,
    /// The part of the room that the map covers.
    mapped: Room,
    /// The part where people are looked for and followed.
    searched: Room,
    /// How far outside it people may also be, in metres.
    margin_m: f64,
    /// The door, if it stands open into the room: from the calibration, the recording or `[doorway.leaf]`.
    #[schema(required)]
    leaf: Option<Leaf>,
    /// Windows, lamps and screens of `room.lights`.
    lights: Vec<RoomLight>,
    /// Bright things that doorcam found by itself.
    found: Vec<FoundLight>,
}

/// What is known of the hidden room: where people are looked for, the door's leaf, and the room's lights. 404 without a
/// calibration.
#[utoipa::path(
    get, path = "/room", tag = ROOM,
    responses(
        (status = 200, description = "The room", body = RoomReport), (status = 304, description = UNCHANGED),
        (status = 404, response = NotYet),
    )
)]
pub(super) async fn room(State(shared): State<Shared>, asked: HeaderMap) -> Response {
    let Some(Watched { model, calibration, .. }) = shared.hub.watched() else {
        return ProblemDetails::not_found("the camera is not calibrated yet: see /api/v1/calibration").into_response();
    };
    let latest = shared.hub.latest().filter(|latest| latest.update.calibration == calibration);
    let room = RoomReport {
        calibration,
        mapped: model.grid.room,
        searched: model.searched,
        margin_m: model.margin_m,
        leaf: model.doorway.leaf,
        lights: model.lights.clone(),
        found: latest.and_then(|latest| latest.still.as_ref().map(|still| still.found())).unwrap_or_default(),
    };
    tag::json(&asked, &room)
}
