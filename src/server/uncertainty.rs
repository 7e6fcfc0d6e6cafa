use std::sync::{Arc, Mutex, PoisonError};

use axum::body::Bytes;
use axum::extract::State;
use axum::http::{HeaderMap, header};
use axum::response::{IntoResponse, Response};
use serde::Serialize;
use utoipa::ToSchema;

use super::Shared;
use super::openapi::{Failed, NotYet, PEOPLE, UNCHANGED};
use super::problem::Problem;
use super::tag::Tag;
use doorcam_core::bound::{PersonSetup, RoomBound, UncertaintyMap};
use doorcam_core::light::Sensing;
use doorcam_engine::Model;

/// Above this error, in metres, somebody counts as not observable: people would be mistaken for one another.
const THRESHOLD_M: f64 = 0.5;

/// The least error of a person's place, over the room.
#[derive(Serialize, ToSchema)]
struct Uncertainty {
    /// Which calibration it is of.
    calibration: u32,
    /// Above this error, in metres, nobody is observable.
    threshold_m: f64,
    /// Whom it is for.
    person: Person,
    /// The map.
    #[serde(flatten)]
    map: UncertaintyMap,
}

/// Whom the map is for.
#[derive(Serialize, ToSchema)]
struct Person {
    /// Radius, in metres.
    radius_m: f64,
    /// Height, in metres.
    height_m: f64,
    /// Their radiance against the room's.
    contrast: f64,
    /// Share of the floor's light that comes from the visible side.
    visible_share: f64,
}

/// The last map and what it is of: it changes with the background and the noise, not with each frame. The lock is held while one
/// is made, so that many who ask at once wait for one.
pub(super) type Mapped = Mutex<Option<(Arc<Sensing>, Bytes)>>;

/// How exactly one frame can locate a person at all, over the room, by the noise that is measured now: the Cramér-Rao bound.
///
/// 404 while the empty room is being learned, and with the published model. It changes with the background only.
#[utoipa::path(
    get, path = "/uncertainty", tag = PEOPLE,
    responses(
        (status = 200, description = "The map", body = Uncertainty), (status = 304, description = UNCHANGED),
        (status = 404, response = NotYet), (status = 500, response = Failed),
    )
)]
pub(super) async fn uncertainty(State(shared): State<Shared>, asked: HeaderMap) -> Response {
    let made = tokio::task::spawn_blocking(move || {
        let latest = shared.hub.latest()?;
        let watched = shared.hub.watched().filter(|w| w.calibration == latest.update.calibration)?;
        let sensing = latest.sensing.as_ref()?;
        let mut cache = shared.uncertain.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, json)) = cache.as_ref().filter(|(of, _)| Arc::ptr_eq(of, sensing)) {
            return Some(json.clone());
        }
        let json = Bytes::from(map(&watched.model, watched.calibration, sensing));
        *cache = Some((Arc::clone(sensing), json.clone()));
        Some(json)
    });
    match made.await {
        Ok(Some(json)) => {
            Tag::of(&json).answer(&asked, || ([(header::CONTENT_TYPE, "application/json")], json.clone()))
        }
        Ok(None) => Problem::not_found(
            "the camera's noise is not known: the empty room is being learned, or the model is the published one",
        )
        .into_response(),
        Err(_) => Problem::internal("working out the map failed").into_response(),
    }
}

fn map(model: &Model, calibration: u32, sensing: &Sensing) -> String {
    let bound = RoomBound::new(&model.doorway, &model.patch, model.body_radius_m, sensing);
    let PersonSetup { height_m, contrast, visible_share, .. } = PersonSetup::USUAL;
    let person = Person { radius_m: model.body_radius_m, height_m, contrast, visible_share };
    let uncertainty = Uncertainty { calibration, threshold_m: THRESHOLD_M, person, map: bound.map(&model.grid.room) };
    // It has no map with keys other than strings, the one thing that serialisation refuses.
    serde_json::to_string(&uncertainty).unwrap_or_default()
}
