use jiff::Timestamp;
use serde::Serialize;

use crate::watch::{CrossingsReport, Hub, Watching};
use doorcam_core::tracking::Track;
use doorcam_engine::{State, Update, ViewReport};

/// What is published about one moment.
#[derive(Debug, Clone)]
pub(super) struct Facts {
    pub(super) watching: Watching,
    pub(super) time: Option<Timestamp>,
    /// How many people are in the room.
    pub(super) people: usize,
    /// How many people are in each zone, in the order of [`Hub::zones`].
    pub(super) zones: Vec<usize>,
    pub(super) tracks: Vec<Track>,
    /// What each patch contributes; none before the first update.
    pub(super) view: Option<ViewReport>,
    /// Who walked through the doorway.
    pub(super) crossings: CrossingsReport,
}

/// The tracks as they are published.
#[derive(Serialize)]
struct Tracks<'a> {
    time: Option<Timestamp>,
    state: State,
    tracks: &'a [Track],
}

impl Facts {
    /// The present facts.
    pub(super) fn of(hub: &Hub) -> Self {
        let latest = hub.latest();
        let update = latest.as_ref().map(|latest| &latest.update);
        let tracks = update.map_or_else(Vec::new, |update| update.tracks.clone());
        let count = |name: &String| {
            let zone = update.and_then(|update| update.zones.iter().find(|zone| zone.name == *name));
            zone.map_or(0, |zone| zone.people)
        };
        Self {
            watching: hub.watching(),
            time: update.map(|update| update.time),
            people: update.map_or(0, Update::people),
            zones: hub.zones().iter().map(|zone| count(&zone.name)).collect(),
            tracks,
            view: update.map(|update| update.view),
            crossings: hub.crossings(),
        }
    }

    /// Who walked through the doorway as JSON, as over REST.
    pub(super) fn crossings_json(&self) -> String {
        serde_json::to_string(&self.crossings).unwrap_or_default()
    }

    /// The tracks as JSON.
    pub(super) fn tracks_json(&self) -> String {
        let tracks = Tracks { time: self.time, state: self.watching.state, tracks: &self.tracks };
        // Serialisation cannot fail, because all keys are strings.
        serde_json::to_string(&tracks).unwrap_or_default()
    }

    /// Whether doorcam is watching, as JSON, as in the status.
    pub(super) fn watching_json(&self) -> String {
        serde_json::to_string(&self.watching).unwrap_or_default()
    }
}
