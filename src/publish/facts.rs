use jiff::{SignedDuration, Timestamp};
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

/// How long after both patches were covered, mostly by somebody who walks through, what was known still counts.
const HELD: SignedDuration = SignedDuration::from_secs(30);

/// Whether values about the room are known.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Knowledge {
    /// They are current.
    Current,
    /// Those of a moment ago still count.
    Held,
    /// Nothing is known.
    Nothing,
}

impl Knowledge {
    /// What is known at a time.
    fn of(watching: &Watching, now: Timestamp) -> Self {
        match watching.state {
            State::Watching => Self::Current,
            State::Obstructed if now.duration_since(watching.since) < HELD => Self::Held,
            _ => Self::Nothing,
        }
    }
}

impl Facts {
    /// Whether what is said about the room is known now.
    pub(super) fn knowledge(&self) -> Knowledge {
        Knowledge::of(&self.watching, Timestamp::now())
    }

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_known_counts_for_a_moment_while_the_patches_are_covered() {
        let since = Timestamp::UNIX_EPOCH;
        let after = |state: State, seconds: i64| {
            let watching = Watching { watching: state == State::Watching, reason: None, since, until: None, state };
            Knowledge::of(&watching, since + SignedDuration::from_secs(seconds))
        };
        assert_eq!(after(State::Watching, 9999), Knowledge::Current);
        assert_eq!(after(State::Obstructed, 5), Knowledge::Held);
        assert_eq!(after(State::Obstructed, 31), Knowledge::Nothing);
        assert_eq!(after(State::Misaligned, 0), Knowledge::Nothing);
    }
}
