use std::collections::VecDeque;

use jiff::{SignedDuration, Timestamp};
use serde::Serialize;
use utoipa::ToSchema;

use doorcam_core::tracking::{Event, Track};
use doorcam_engine::Update;

/// Most events that are kept.
const MOST_EVENTS: usize = 1000;
/// Most tracks whose paths are kept.
const MOST_TRACKS: usize = 64;
/// Most points that are kept of a path.
const MOST_PLACES: usize = 2048;

/// Recent events and the paths of recent tracks.
#[derive(Debug)]
pub(super) struct Recent {
    history: SignedDuration,
    events: VecDeque<Event>,
    tracks: Vec<Followed>,
}

#[derive(Debug)]
struct Followed {
    last: Track,
    path: VecDeque<PathPoint>,
}

/// Where a track was in one update.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, ToSchema)]
pub struct PathPoint {
    /// Time of capture, RFC 3339.
    pub time: Timestamp,
    /// x in metres in the door frame.
    pub x_m: f64,
    /// y in metres in the door frame, into the hidden room.
    pub y_m: f64,
}

/// A track with its recent path and events.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct TrackHistory {
    /// The track as last reported.
    pub track: Track,
    /// Whether it has ended.
    pub ended: bool,
    /// Where it was in the last seconds, oldest first.
    pub path: Vec<PathPoint>,
    /// Its events, oldest first.
    pub events: Vec<Event>,
}

impl Recent {
    /// Keeps `history_s` seconds of each path.
    pub fn new(history_s: f64) -> Self {
        let mut recent = Self { history: SignedDuration::ZERO, events: VecDeque::new(), tracks: Vec::new() };
        recent.keep(history_s);
        recent
    }

    /// Keeps `history_s` seconds of each path from now on.
    pub fn keep(&mut self, history_s: f64) {
        self.history = SignedDuration::try_from_secs_f64(history_s).unwrap_or(SignedDuration::ZERO);
    }

    /// Records an update.
    pub fn take(&mut self, update: &Update) {
        for event in &update.events {
            if self.events.len() == MOST_EVENTS {
                self.events.pop_front();
            }
            self.events.push_back(event.clone());
        }
        for track in &update.tracks {
            let index = self.tracks.iter().position(|t| t.last.id == track.id).unwrap_or_else(|| {
                self.tracks.push(Followed { last: *track, path: VecDeque::new() });
                self.tracks.len() - 1
            });
            let followed = &mut self.tracks[index];
            followed.last = *track;
            if followed.path.len() == MOST_PLACES {
                followed.path.pop_front();
            }
            followed.path.push_back(PathPoint { time: update.time, x_m: track.x_m, y_m: track.y_m });
        }
        let history = self.history;
        for followed in &mut self.tracks {
            while followed.path.front().is_some_and(|p| update.time.duration_since(p.time) > history) {
                followed.path.pop_front();
            }
        }
        // Tracks are in order of appearance, so the oldest ended ones are removed first.
        let is_followed = |followed: &Followed| update.tracks.iter().any(|t| t.id == followed.last.id);
        self.tracks.retain(|followed| !followed.path.is_empty() || is_followed(followed));
        while let Some(ended) =
            (self.tracks.len() > MOST_TRACKS).then(|| self.tracks.iter().position(|t| !is_followed(t))).flatten()
        {
            self.tracks.remove(ended);
        }
    }

    /// The first `limit` events after number `after`, or the newest `limit` if it is `None`.
    pub fn events(&self, after: Option<u64>, limit: usize) -> Vec<Event> {
        let first = match after {
            Some(after) => self.events.partition_point(|event| event.sequence <= after),
            None => self.events.len().saturating_sub(limit),
        };
        self.events.range(first..).take(limit).cloned().collect()
    }

    /// What is kept of a track, or `None` if nothing is. It has ended unless it is among the newest update's `current`
    /// tracks.
    pub fn track(&self, id: u64, current: &[Track]) -> Option<TrackHistory> {
        let followed = self.tracks.iter().find(|t| t.last.id == id)?;
        Some(TrackHistory {
            track: followed.last,
            ended: current.iter().all(|track| track.id != id),
            path: followed.path.iter().copied().collect(),
            events: self.events.iter().filter(|event| event.track == id).cloned().collect(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use doorcam_core::tracking::{EventKind, TrackState};
    use doorcam_engine::Timing;

    fn at(seconds: i64) -> Timestamp {
        Timestamp::from_second(seconds).unwrap()
    }

    fn update(seconds: i64, ids: &[u64], events: std::ops::Range<u64>) -> Update {
        let mut update = Update::blank("signed", seconds as u64, at(seconds), None, Timing::default());
        update.tracks.extend(ids.iter().map(|&id| Track {
            id,
            state: TrackState::Confirmed,
            x_m: seconds as f64,
            y_m: 1.0,
            vx_m_s: 0.0,
            vy_m_s: 0.0,
            covariance_m2: [[0.01, 0.0], [0.0, 0.01]],
            rgb: [0.0; 3],
            age_s: 0.0,
        }));
        let event = |sequence| {
            let (kind, time) = (EventKind::Dwell, at(seconds));
            Event {
                sequence,
                kind,
                time,
                track: sequence % 2,
                x_m: 0.0,
                y_m: 1.0,
                zone: None,
                through: None,
                reason: None,
                speed_m_s: None,
            }
        };
        update.events.extend(events.map(event));
        update
    }

    #[test]
    fn events_are_told_of_the_last_thousand() {
        let mut recent = Recent::new(10.0);
        assert_eq!(recent.events(None, 5), []);
        for k in 0..300 {
            recent.take(&update(k, &[], 5 * k as u64..5 * (k as u64 + 1)));
        }
        let numbers = |after, limit| recent.events(after, limit).iter().map(|e| e.sequence).collect::<Vec<_>>();
        assert_eq!(numbers(None, 3), [1497, 1498, 1499]);
        assert_eq!(numbers(Some(1200), 2), [1201, 1202]);
        assert_eq!(numbers(Some(3), 2), [500, 501], "older events are no longer kept");
        assert_eq!(numbers(Some(1499), 2), [0; 0]);
        assert_eq!(numbers(Some(u64::MAX), 2), [0; 0]);
    }

    #[test]
    fn a_path_is_of_the_last_seconds_and_outlives_its_track_by_as_much() {
        let mut recent = Recent::new(10.0);
        for k in 0..20 {
            recent.take(&update(k, &[1], 0..0));
        }
        let history = recent.track(1, &update(19, &[1], 0..0).tracks).unwrap();
        let xs: Vec<f64> = history.path.iter().map(|p| p.x_m).collect();
        assert_eq!(xs, (9..20).map(f64::from).collect::<Vec<_>>());
        assert!(!history.ended);
        recent.take(&update(25, &[], 0..1));
        assert!(recent.track(1, &[]).is_some_and(|t| t.ended && t.path.len() == 5));
        assert_eq!(recent.track(2, &[]), None);
        recent.take(&update(30, &[], 1..2));
        assert_eq!(recent.track(1, &[]), None);
        recent.take(&update(31, &[1], 2..4));
        assert_eq!(recent.track(1, &[]).unwrap().events.iter().map(|e| e.sequence).collect::<Vec<_>>(), [1, 3]);
    }

    #[test]
    fn what_is_kept_is_bounded() {
        let mut recent = Recent::new(600.0);
        for k in 0..3 * MOST_TRACKS as u64 {
            recent.take(&update(1, &[1_000_000, k], 0..0));
        }
        assert_eq!(recent.tracks.len(), MOST_TRACKS);
        assert!(recent.track(1_000_000, &[]).is_some(), "a current track is never removed");
        for _ in 0..2 * MOST_PLACES {
            recent.take(&update(2, &[1_000_000], 0..0));
        }
        assert_eq!(recent.track(1_000_000, &[]).unwrap().path.len(), MOST_PLACES);
    }
}
