use jiff::Timestamp;
use serde::Serialize;

use crate::config::topic_level;
use crate::watch::Hub;
use doorcam_core::tracking::{Track, TrackState};
use doorcam_engine::State;

/// What is published about one moment.
#[derive(Debug, Clone)]
pub(super) struct Facts {
    pub(super) state: State,
    pub(super) time: Option<Timestamp>,
    /// How many people are in the room.
    pub(super) people: usize,
    /// How many people are in each zone, in the order of [`Hub::zones`].
    pub(super) zones: Vec<usize>,
    pub(super) tracks: Vec<Track>,
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
            state: hub.state(),
            time: update.map(|update| update.time),
            people: tracks.iter().filter(|track| track.state != TrackState::Tentative).count(),
            zones: hub.zones().iter().map(|zone| count(&zone.name)).collect(),
            tracks,
        }
    }

    /// The tracks as JSON.
    pub(super) fn tracks_json(&self) -> String {
        // Serialisation cannot fail, because all keys are strings.
        serde_json::to_string(&Tracks { time: self.time, state: self.state, tracks: &self.tracks }).unwrap_or_default()
    }

    /// The state's name in topics.
    pub(super) fn state_name(&self) -> &'static str {
        match self.state {
            State::Learning => "learning",
            State::Watching => "watching",
            State::Relearning => "relearning",
            State::Stale => "stale",
        }
    }
}

/// A topic level for each zone, all different.
pub(super) fn zone_levels(names: &[&str]) -> Vec<String> {
    let mut levels: Vec<String> = Vec::new();
    for name in names {
        let plain = topic_level(name).to_ascii_lowercase();
        let numbered = (1..).map(|k| if k == 1 { plain.clone() } else { format!("{plain}-{k}") });
        levels.extend(numbered.into_iter().find(|level| !levels.contains(level)));
    }
    levels
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn zones_whose_names_look_alike_keep_topics_of_their_own() {
        assert_eq!(zone_levels(&["Bed 1", "bed/1", "bed_1", "sofa"]), ["bed_1", "bed_1-2", "bed_1-3", "sofa"]);
    }
}
