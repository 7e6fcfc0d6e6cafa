use axum::Json;
use axum::extract::rejection::PathRejection;
use axum::extract::{Path, State};
use axum::http::HeaderMap;
use axum::response::{IntoResponse, Response};
use jiff::Timestamp;
use serde::Serialize;
use utoipa::ToSchema;

use super::Shared;
use super::answers::{PEOPLE, UNCHANGED, Unknown};
use super::problem::ProblemDetails;
use super::tag::Edition;
use crate::watch::{Hub, TrackHistory, ZoneOrigin};
use doorcam_core::geometry::Point;
use doorcam_core::schema;
use doorcam_core::tracking::{Track, Zone};

/// The people in the room.
#[derive(Serialize, ToSchema)]
struct Tracks {
    /// Number of the update; null before the first.
    #[schema(required)]
    sequence: Option<u64>,
    /// When its frame was captured, RFC 3339.
    #[schema(required)]
    time: Option<Timestamp>,
    /// Whether the map can be trusted.
    state: doorcam_engine::State,
    /// Everybody who is being tracked.
    tracks: Vec<Placed>,
}

/// A track and the zones it is in.
#[derive(Serialize, ToSchema)]
struct Placed {
    /// The track, as in an update.
    #[serde(flatten)]
    track: Track,
    /// Names of the zones that it is in.
    zones: Vec<String>,
}

/// The zones in use and who is in them.
#[derive(Serialize, ToSchema)]
pub(super) struct Zones {
    /// Number of the update; null before the first.
    #[schema(required)]
    sequence: Option<u64>,
    /// When its frame was captured, RFC 3339.
    #[schema(required)]
    time: Option<Timestamp>,
    /// Whether the map can be trusted.
    state: doorcam_engine::State,
    /// Where the zones come from.
    origin: ZoneOrigin,
    /// The zones.
    zones: Vec<Occupied>,
}

/// A zone and who is in it.
#[derive(Serialize, ToSchema)]
struct Occupied {
    /// Identifies it, also after it was renamed.
    id: String,
    /// Its name.
    name: String,
    /// Its corners in order, in metres in the door frame.
    #[schema(value_type = Vec<schema::Point>)]
    polygon_m: Vec<Point>,
    /// How many people are in it.
    people: usize,
    /// The ids of their tracks.
    tracks: Vec<u64>,
}

/// The people in the room and the zones they are in.
#[utoipa::path(
    get, path = "/tracks", tag = PEOPLE,
    responses((status = 200, description = "The tracks", body = Tracks))
)]
pub(super) async fn tracks(State(shared): State<Shared>) -> Response {
    Json(current(&shared.hub)).into_response()
}

/// One track with its path and events, also for some time after it has ended.
///
/// 404 for a track that never existed, or whose whole path is older than `tracker.history_s` seconds.
#[utoipa::path(
    get, path = "/tracks/{id}", tag = PEOPLE, params(("id" = u64, Path, description = "The track's id")),
    responses((status = 200, description = "The track", body = TrackHistory), (status = 404, response = Unknown))
)]
pub(super) async fn track(State(shared): State<Shared>, id: Result<Path<u64>, PathRejection>) -> Response {
    let unknown = |id: &str| ProblemDetails::not_found(&format!("there is no track {id}, or it ended too long ago"));
    match id {
        Ok(Path(id)) => match shared.hub.track(id) {
            Some(history) => Json(history).into_response(),
            None => unknown(&id.to_string()).into_response(),
        },
        Err(_) => ProblemDetails::not_found("a track's id is a whole number").into_response(),
    }
}

/// The zones in use and who is in them.
#[utoipa::path(
    get, path = "/zones", tag = PEOPLE,
    responses((status = 200, description = "The zones", body = Zones), (status = 304, description = UNCHANGED))
)]
pub(super) async fn zones(State(shared): State<Shared>, asked: HeaderMap) -> Response {
    // Before the zones are read: a tag that is too old prevents a change, one that is too new would allow it.
    let edition = Edition::new(shared.run, shared.hub.zones_revision());
    edition.json(&asked, &occupied(&shared.hub, shared.zones.origin()))
}

fn current(hub: &Hub) -> Tracks {
    let latest = hub.latest();
    let update = latest.as_ref().map(|latest| &latest.update);
    let placed = |track: &Track| {
        let zones = update.iter().flat_map(|update| &update.zones);
        let zones = zones.filter(|zone| zone.tracks.contains(&track.id)).map(|zone| zone.name.clone()).collect();
        Placed { track: *track, zones }
    };
    Tracks {
        sequence: update.map(|update| update.sequence),
        time: update.map(|update| update.time),
        state: hub.state(),
        tracks: update.iter().flat_map(|update| &update.tracks).map(placed).collect(),
    }
}

fn occupied(hub: &Hub, origin: ZoneOrigin) -> Zones {
    let latest = hub.latest();
    let update = latest.as_ref().map(|latest| &latest.update);
    let occupied = |Zone { name, id, polygon_m }: &Zone| {
        let now = update.and_then(|update| update.zones.iter().find(|zone| zone.name == *name));
        Occupied {
            id: id.clone().unwrap_or_default(),
            name: name.clone(),
            polygon_m: polygon_m.clone(),
            people: now.map_or(0, |zone| zone.people),
            tracks: now.map_or_else(Vec::new, |zone| zone.tracks.clone()),
        }
    };
    Zones {
        sequence: update.map(|update| update.sequence),
        time: update.map(|update| update.time),
        state: hub.state(),
        origin,
        zones: hub.zones().iter().map(occupied).collect(),
    }
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    use super::*;
    use crate::config::Config;
    use crate::feed::{SourceInfo, SourceKind};
    use doorcam_core::tracking::{Occupancy, TrackState};
    use doorcam_engine::{Published, Timing, Update};

    fn hub() -> Hub {
        let zones = "[[zones]]\nname = \"bed\"\npolygon_m = [[-1, 1], [1, 1], [1, 2]]\n";
        let source = SourceInfo { spec: "replay:x".into(), kind: SourceKind::Replay, notes: String::new(), fps: 10.0 };
        Hub::new(None, None, source).configured(&Config::parse(zones).unwrap())
    }

    fn text(value: impl Serialize) -> Value {
        serde_json::to_value(value).unwrap()
    }

    #[test]
    fn before_the_first_update_nobody_is_there() {
        let tracks = json!({"sequence": null, "time": null, "state": "learning", "tracks": []});
        assert_eq!(text(current(&hub())), tracks);
        let zone = json!({"id": "bed", "name": "bed", "polygon_m": [[-1.0, 1.0], [1.0, 1.0], [1.0, 2.0]], "people": 0, "tracks": []});
        assert_eq!(
            text(occupied(&hub(), ZoneOrigin::Config)),
            json!({"sequence": null, "time": null, "state": "learning", "origin": "config", "zones": [zone]})
        );
    }

    #[test]
    fn tracks_tell_their_zones_and_zones_their_people() {
        let hub = hub();
        let mut update = Update::blank("signed", 7, Timestamp::UNIX_EPOCH, None, Timing::default());
        update.state = doorcam_engine::State::Watching;
        let track = Track {
            id: 3,
            state: TrackState::Confirmed,
            x_m: 0.5,
            y_m: 1.25,
            vx_m_s: 0.0,
            vy_m_s: 0.0,
            covariance_m2: [[0.01, 0.0], [0.0, 0.01]],
            rgb: [0.0; 3],
            age_s: 2.0,
        };
        update.tracks = vec![track, Track { id: 4, ..track }];
        update.zones = vec![Occupancy { name: "bed".into(), people: 1, tracks: vec![3] }];
        hub.publish(Published::new(update, None, None));
        let tracks = text(current(&hub));
        assert_eq!((&tracks["sequence"], &tracks["state"]), (&json!(7), &json!("watching")));
        assert_eq!((&tracks["tracks"][0]["id"], &tracks["tracks"][0]["zones"]), (&json!(3), &json!(["bed"])));
        assert_eq!(tracks["tracks"][1]["zones"], json!([]));
        let zones = text(occupied(&hub, ZoneOrigin::Saved));
        assert_eq!((&zones["zones"][0]["people"], &zones["zones"][0]["tracks"]), (&json!(1), &json!([3])));
        let history = text(hub.track(3));
        assert_eq!((&history["ended"], &history["path"][0]["x_m"]), (&json!(false), &json!(0.5)));
        assert!(hub.track(5).is_none());
    }
}
