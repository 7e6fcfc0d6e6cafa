use std::io::{BufRead, Read as _};

use jiff::Timestamp;
use serde::Deserialize;

use crate::{Published, State, Timing};
use doorcam_core::geometry::Point;
use doorcam_core::tracking::{Covariance, Detection, Direction, Event, Track, TrackState};
use doorcam_source::files::text;

/// A person as reported in one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// The track; none for a detection, which comes from a single frame.
    pub id: Option<u64>,
    /// The body's axis, in metres in the door frame.
    pub position: Point,
    /// Covariance of the position, in m².
    pub covariance: Covariance,
}

impl From<&Detection> for Estimate {
    fn from(detection: &Detection) -> Self {
        Self { id: None, position: detection.position, covariance: detection.covariance }
    }
}

/// Processing times of a frame, in milliseconds.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
pub struct StageTimes {
    /// Solving eq. 13.
    pub solve: f64,
    /// Detecting and tracking people.
    #[serde(default)]
    pub track: f64,
    /// The whole frame.
    pub total: f64,
}

impl From<Timing> for StageTimes {
    fn from(Timing { solve, track, total, .. }: Timing) -> Self {
        Self { solve, track, total }
    }
}

/// Somebody who is reported to have crossed the threshold.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ReportedCrossing {
    /// When, by the same clock as the update.
    pub time: Timestamp,
    /// Which way.
    pub direction: Direction,
}

/// The parts of an update that can be scored.
#[derive(Debug, Clone, PartialEq)]
pub struct Observed {
    /// The frame's number in its recording; none for a live camera.
    pub frame: Option<u64>,
    /// When the frame was captured; none if the update does not tell.
    pub time: Option<Timestamp>,
    /// Whether there is a map of the frame.
    pub watching: bool,
    /// Everybody who is reported.
    pub estimates: Vec<Estimate>,
    /// Crossings that became known with the frame.
    pub crossings: Vec<ReportedCrossing>,
    /// How long the frame took; none if the update does not tell.
    pub times: Option<StageTimes>,
}

impl Default for Observed {
    /// A map without anybody, of no known frame.
    fn default() -> Self {
        Self { frame: None, time: None, watching: true, estimates: Vec::new(), crossings: Vec::new(), times: None }
    }
}

impl Observed {
    /// The confirmed and coasting tracks of an update.
    pub fn tracks(published: &Published) -> Self {
        let update = &published.update;
        let reported = |track: &&Track| track.state != TrackState::Tentative;
        let estimate = |track: &Track| Estimate {
            id: Some(track.id),
            position: [track.x_m, track.y_m],
            covariance: track.covariance_m2,
        };
        Self { estimates: update.tracks.iter().filter(reported).map(estimate).collect(), ..Self::of(published) }
    }

    /// The detections of the frame by itself, without its past.
    pub fn detections(published: &Published) -> Self {
        Self { estimates: published.detections.iter().map(Estimate::from).collect(), ..Self::of(published) }
    }

    fn of(published: &Published) -> Self {
        let update = &published.update;
        let crossing =
            |event: &Event| event.kind.direction().map(|direction| ReportedCrossing { time: event.time, direction });
        Self {
            frame: update.frame,
            time: Some(update.time),
            watching: update.state == State::Watching,
            estimates: Vec::new(),
            crossings: update.events.iter().filter_map(crossing).collect(),
            times: Some(update.timing_ms.into()),
        }
    }
}

/// Longest line of an update. One with thousands of facets has a megabyte.
const LONGEST_LINE: u64 = 64 << 20;

/// Most tracks in one update. Who is who among them takes a time that grows faster than their number.
const MOST_TRACKS: usize = 1024;

/// Why a file of updates cannot be scored.
#[derive(Debug, thiserror::Error)]
pub enum ObservedError {
    /// The file cannot be read.
    #[error(transparent)]
    Io(#[from] std::io::Error),
    /// A line does not end.
    #[error("line {} is longer than {} MB, expected an update", .0, LONGEST_LINE >> 20)]
    LongLine(usize),
    /// A line is not an update.
    #[error("line {line}: {key}: {message}")]
    Invalid {
        /// Line number, from 1.
        line: usize,
        /// The key within the line.
        key: String,
        /// What is wrong.
        message: String,
    },
}

/// The parts of an update (docs/api.md) that are scored; all others may be missing.
#[derive(Deserialize)]
struct UpdateLine {
    frame: Option<u64>,
    time: Option<Timestamp>,
    #[serde(default)]
    state: MapState,
    tracks: Vec<TrackLine>,
    #[serde(default)]
    events: Vec<EventLine>,
    timing_ms: Option<StageTimes>,
}

/// An update that has no state has a map; in every state but this one there is none.
#[derive(Deserialize, Default, PartialEq)]
#[serde(rename_all = "lowercase")]
enum MapState {
    #[default]
    Watching,
    #[serde(other)]
    Other,
}

#[derive(Deserialize)]
struct EventLine {
    kind: EventLineKind,
    time: Option<Timestamp>,
}

#[derive(Deserialize)]
#[serde(rename_all = "snake_case")]
enum EventLineKind {
    CrossIn,
    CrossOut,
    CrossBack,
    #[serde(other)]
    Other,
}

impl EventLineKind {
    fn direction(&self) -> Option<Direction> {
        match self {
            Self::CrossIn => Some(Direction::In),
            Self::CrossOut => Some(Direction::Out),
            Self::CrossBack => Some(Direction::Back),
            Self::Other => None,
        }
    }
}

#[derive(Deserialize)]
struct TrackLine {
    id: u64,
    state: TrackLineState,
    x_m: f64,
    y_m: f64,
    covariance_m2: Covariance,
}

#[derive(Deserialize, PartialEq)]
#[serde(rename_all = "lowercase")]
enum TrackLineState {
    Tentative,
    Confirmed,
    Coasting,
}

/// Reads updates, one JSON object per line, as `doorcam reconstruct` prints them and the live socket sends them. Skips
/// empty lines.
///
/// # Errors
///
/// If reading fails or a line is not an update.
pub fn read_updates(mut from: impl BufRead) -> Result<Vec<Observed>, ObservedError> {
    let mut updates = Vec::new();
    let mut line = Vec::new();
    for number in 1.. {
        line.clear();
        let read = from.by_ref().take(LONGEST_LINE).read_until(b'\n', &mut line)?;
        if read == 0 {
            break;
        }
        if read as u64 == LONGEST_LINE && !line.ends_with(b"\n") {
            return Err(ObservedError::LongLine(number));
        }
        let invalid = |key: String, message: String| ObservedError::Invalid { line: number, key, message };
        let text = text(&line).map_err(|e| invalid(".".into(), e.to_string()))?;
        if text.trim().is_empty() {
            continue;
        }
        let mut json = serde_json::Deserializer::from_str(text);
        let update: UpdateLine = serde_path_to_error::deserialize(&mut json)
            .map_err(|e| invalid(e.path().to_string(), e.into_inner().to_string()))?;
        if update.tracks.len() > MOST_TRACKS {
            let count = update.tracks.len();
            return Err(invalid("tracks".into(), format!("{count} tracks, expected at most {MOST_TRACKS}")));
        }
        let mut crossings = Vec::new();
        for (k, event) in update.events.iter().enumerate() {
            let Some(direction) = event.kind.direction() else { continue };
            let Some(time) = event.time else {
                let message = "missing, expected when somebody crossed (RFC 3339)".into();
                return Err(invalid(format!("events[{k}].time"), message));
            };
            crossings.push(ReportedCrossing { time, direction });
        }
        let reported = update.tracks.iter().filter(|track| track.state != TrackLineState::Tentative);
        let estimate = |track: &TrackLine| Estimate {
            id: Some(track.id),
            position: [track.x_m, track.y_m],
            covariance: track.covariance_m2,
        };
        updates.push(Observed {
            frame: update.frame,
            time: update.time,
            watching: update.state == MapState::Watching,
            estimates: reported.map(estimate).collect(),
            crossings,
            times: update.timing_ms,
        });
    }
    Ok(updates)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Update;
    use doorcam_core::tracking::EventKind;

    #[test]
    fn confirmed_and_coasting_tracks_are_read_and_tentative_ones_are_not_nor_is_a_map_where_none_is() {
        let track = |id: u64, state: &str| {
            format!(
                r#"{{"id": {id}, "state": "{state}", "x_m": 0.5, "y_m": 1, "covariance_m2": [[0.01, 0], [0, 0.04]], "rgb": [0, 0, 0]}}"#
            )
        };
        let tracks = [track(1, "tentative"), track(2, "confirmed"), track(3, "coasting")].join(", ");
        let text = format!(
            "{{\"frame\": 3, \"state\": \"learning\", \"tracks\": []}}\n\n\
             {{\"version\": 1, \"frame\": 4, \"state\": \"relearning\", \"tracks\": [{tracks}], \"timing_ms\": {{\"solve\": 1.5, \"total\": 3, \"track\": 0.25}}}}\n\
             {{\"frame\": null, \"tracks\": []}}\n"
        );
        let updates = read_updates(text.as_bytes()).unwrap();
        let estimate = |id| Estimate { id: Some(id), position: [0.5, 1.0], covariance: [[0.01, 0.0], [0.0, 0.04]] };
        let times = StageTimes { solve: 1.5, track: 0.25, total: 3.0 };
        assert_eq!(
            updates,
            [
                Observed { frame: Some(3), watching: false, ..Observed::default() },
                Observed {
                    frame: Some(4),
                    watching: false,
                    estimates: vec![estimate(2), estimate(3)],
                    times: Some(times),
                    ..Observed::default()
                },
                Observed::default(),
            ]
        );
        let states = ["watching", "learning", "relearning", "obstructed", "misaligned", "stale", "of another program"];
        let lines = states.map(|state| format!("{{\"frame\": 1, \"state\": \"{state}\", \"tracks\": []}}\n")).concat();
        let watching: Vec<bool> = read_updates(lines.as_bytes()).unwrap().iter().map(|u| u.watching).collect();
        assert_eq!(watching, [true, false, false, false, false, false, false]);
    }

    #[test]
    fn of_events_only_crossings_are_read_and_they_must_have_a_time() {
        let with = |events: &str| {
            format!("{{\"frame\": 9, \"time\": \"2026-11-29T20:00:00.9Z\", \"tracks\": [], \"events\": [{events}]}}\n")
        };
        let event = |kind: &str| format!(r#"{{"kind": "{kind}", "time": "2026-11-29T20:00:00.8Z", "track": 4}}"#);
        let kinds = ["enter", "cross_in", "zone_enter", "cross_back", "of_another_program", "cross_out"];
        let text = with(&kinds.map(event).join(", "));
        let [update] = &read_updates(text.as_bytes()).unwrap()[..] else { panic!("one update") };
        assert_eq!(update.time, Some("2026-11-29T20:00:00.9Z".parse().unwrap()));
        let time: Timestamp = "2026-11-29T20:00:00.8Z".parse().unwrap();
        let crossing = |direction| ReportedCrossing { time, direction };
        assert_eq!(update.crossings, [Direction::In, Direction::Back, Direction::Out].map(crossing));
        let without = with(r#"{"kind": "exit"}, {"kind": "cross_in"}"#);
        let message = read_updates(without.as_bytes()).unwrap_err().to_string();
        assert_eq!(message, "line 1: events[1].time: missing, expected when somebody crossed (RFC 3339)");
        let message = read_updates(with(r#"{"kind": "cross_in", "time": 7.1}"#).as_bytes()).unwrap_err().to_string();
        assert!(message.starts_with("line 1: events[0].time: "), "{message}");
    }

    #[test]
    fn an_update_of_the_engine_has_the_same_parts_as_the_line_that_it_becomes() {
        let time: Timestamp = "1970-01-01T00:00:07.2Z".parse().unwrap();
        let mut update = Update::blank("signed", 0, time, Some(72), Timing::default());
        let event = |kind: EventKind| Event {
            sequence: 0,
            kind,
            time: "1970-01-01T00:00:07.1Z".parse().unwrap(),
            track: 1,
            x_m: 0.0,
            y_m: 0.0,
            zone: None,
            through: None,
            reason: None,
            speed_m_s: Some(1.1),
        };
        update.events = EventKind::ALL.map(event).to_vec();
        for state in State::ALL {
            update.state = state;
            let published = Published::new(update.clone(), None, None);
            let observed = Observed::tracks(&published);
            assert_eq!(read_updates(published.json.as_bytes()).unwrap(), std::slice::from_ref(&observed));
            assert_eq!((observed.watching, observed.crossings.len()), (state == State::Watching, 3));
            assert_eq!(Observed::detections(&published).crossings, observed.crossings);
        }
    }

    #[test]
    fn too_many_tracks_are_refused_and_a_byte_order_mark_is_taken() {
        let track = r#"{"id": 1, "state": "confirmed", "x_m": 0.5, "y_m": 1, "covariance_m2": [[0.01, 0], [0, 0.04]]}"#;
        let update =
            |count: usize| format!("\u{feff}{{\"frame\": 1, \"tracks\": [{}]}}\n", vec![track; count].join(","));
        assert_eq!(read_updates(update(1024).as_bytes()).unwrap()[0].estimates.len(), 1024);
        let message = read_updates(update(100_000).as_bytes()).unwrap_err().to_string();
        assert_eq!(message, "line 1: tracks: 100000 tracks, expected at most 1024");
        let endless = std::io::BufReader::new(std::io::repeat(b' '));
        assert_eq!(read_updates(endless).unwrap_err().to_string(), "line 1 is longer than 64 MB, expected an update");
    }

    #[test]
    fn errors_name_the_line_and_the_key() {
        let text = "{\"frame\": 1, \"tracks\": []}\n{\"frame\": 2, \"tracks\": [{\"id\": \"one\"}]}\n";
        let message = read_updates(text.as_bytes()).unwrap_err().to_string();
        assert!(message.starts_with("line 2: tracks[0].id: invalid type"), "{message}");
    }
}
