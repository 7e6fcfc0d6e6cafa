use std::sync::{Arc, Mutex, PoisonError};

use axum::body::Bytes;
use axum::extract::State;
use axum::http::header;
use axum::response::{IntoResponse, Response};
use serde::Serialize;

use super::Shared;
use super::problem::Problem;
use crate::analysis::bound::{PersonSetup, RoomBound, UncertaintyMap};
use crate::measurement::Sensing;
use crate::pipeline::Model;

/// Above this error, in metres, somebody counts as not observable: people would be mistaken for one another.
const THRESHOLD_M: f64 = 0.5;

/// GET /api/v1/uncertainty.
#[derive(Serialize)]
struct Uncertainty {
    calibration: u32,
    threshold_m: f64,
    person: Person,
    #[serde(flatten)]
    map: UncertaintyMap,
}

/// Whom the map is for.
#[derive(Serialize)]
struct Person {
    radius_m: f64,
    height_m: f64,
    contrast: f64,
    visible_share: f64,
}

/// The last map and what it is of: it changes with the background and the noise, not with each frame. The lock is held while one
/// is made, so that many who ask at once wait for one.
pub(super) type Mapped = Mutex<Option<(Arc<Sensing>, Bytes)>>;

/// The least error of a person's place over the room, by the noise that is measured now.
pub(super) async fn uncertainty(State(shared): State<Shared>) -> Response {
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
        Ok(Some(json)) => ([(header::CONTENT_TYPE, "application/json")], json).into_response(),
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
