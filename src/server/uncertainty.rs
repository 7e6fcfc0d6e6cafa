use std::sync::{Arc, Mutex, PoisonError};

use axum::body::Bytes;
use axum::extract::State;
use axum::http::{HeaderMap, header};
use axum::response::{IntoResponse, Response};
use serde::Serialize;
use utoipa::ToSchema;

use super::Shared;
use super::answers::{Busy, Failed, NotYet, PEOPLE, UNCHANGED};
use super::jobs::Kind;
use super::problem::ProblemDetails;
use super::tag::Tag;
use doorcam_core::bound::{PersonSetup, RoomBound, UncertaintyMap};
use doorcam_core::light::Sensing;
use doorcam_engine::Model;

/// Above this error, in metres, nobody counts as observable: people would be mistaken for one another.
const THRESHOLD_M: f64 = 0.5;

/// The least possible error of a person's position, over the room.
#[derive(Serialize, ToSchema)]
struct Uncertainty {
    /// Number of the calibration that the map belongs to.
    calibration: u32,
    /// Above this error, in metres, nobody is observable.
    threshold_m: f64,
    /// The person that the map assumes.
    person: Person,
    /// The map.
    #[serde(flatten)]
    map: UncertaintyMap,
}

/// The person that an uncertainty map assumes.
#[derive(Serialize, ToSchema)]
struct Person {
    /// Radius, in metres.
    radius_m: f64,
    /// Height, in metres.
    height_m: f64,
    /// How much brighter they are than the room behind them, as a share of that; negative is darker.
    contrast: f64,
    /// Share of the floor's light that comes from the visible side.
    visible_share: f64,
}

/// The last map and what it was made from, which changes with the background and the noise, not with each frame. The
/// lock is held while a map is made, so that simultaneous requests share one.
pub(super) type Mapped = Mutex<Option<(Arc<Sensing>, Bytes)>>;

/// How precisely one frame can locate a person at best, over the room: the Cramér-Rao bound for the noise measured now.
///
/// 404 while the empty room is being learned, and with the published model. The map changes only with the background.
#[utoipa::path(
    get, path = "/uncertainty", tag = PEOPLE,
    responses(
        (status = 200, description = "The map", body = Uncertainty), (status = 304, description = UNCHANGED),
        (status = 404, response = NotYet), (status = 500, response = Failed), (status = 503, response = Busy),
    )
)]
pub(super) async fn uncertainty(State(shared): State<Shared>, asked: HeaderMap) -> Response {
    let jobs = Arc::clone(&shared.jobs);
    let made = jobs.run(Kind::Drawing, move || {
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
        Ok(None) => ProblemDetails::not_found(
            "the camera's noise is not known: the empty room is being learned, or the model is the published one",
        )
        .into_response(),
        Err(problem) => problem.into_response(),
    }
}

fn map(model: &Model, calibration: u32, sensing: &Sensing) -> String {
    let bound = RoomBound::new(&model.doorway, &model.patch, model.body_radius_m, sensing);
    let PersonSetup { height_m, contrast, visible_share, .. } = PersonSetup::USUAL;
    let person = Person { radius_m: model.body_radius_m, height_m, contrast, visible_share };
    let uncertainty = Uncertainty { calibration, threshold_m: THRESHOLD_M, person, map: bound.map(&model.grid.room) };
    // Serialisation cannot fail, because all keys are strings.
    serde_json::to_string(&uncertainty).unwrap_or_default()
}
