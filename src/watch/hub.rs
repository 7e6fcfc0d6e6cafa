use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use jiff::Timestamp;
use serde::Serialize;
use tokio::sync::watch;
use utoipa::ToSchema;

use crate::config::{Config, Preset, TrackerConfig};
use crate::feed::SourceInfo;
use crate::watch::TrackHistory;
use crate::watch::meters::Meters;
use crate::watch::recent::Recent;
use crate::watch::tap::Tap;
use doorcam_core::solver::ModelKind;
use doorcam_core::tracking::{Event, Zone};
use doorcam_engine::{BackgroundReport, Published, State, Update, Watched};
use doorcam_source::recorder::RecordingStatus;
use doorcam_source::{Condition, Granted, RawFrame, RawImages, SourceState};

/// The newest images, as they came.
#[derive(Debug, Clone)]
pub struct CapturedImages {
    /// Counts frames of this run.
    pub number: u64,
    /// The images.
    pub images: RawImages,
    /// When they were captured.
    pub time: Timestamp,
    /// When they came.
    pub at: Instant,
}

/// What is told every single update, on the thread of the frames: it must return at once.
type Listener = Box<dyn Fn(&Update) + Send + Sync>;

/// Hands updates and status from the frame loop to everyone who asks.
pub struct Hub {
    watched: Mutex<Option<Watched>>,
    seen: watch::Sender<Option<CapturedImages>>,
    preset: Option<Preset>,
    source: SourceInfo,
    latest: watch::Sender<Option<Arc<Published>>>,
    recent: Mutex<Recent>,
    zones: Mutex<Zoned>,
    listeners: Vec<Listener>,
    counters: Mutex<Counters>,
    tap: Tap,
    meters: Meters,
    started: Instant,
    stale_after: Duration,
}

#[derive(Default)]
struct Zoned {
    zones: Vec<Zone>,
    revision: u32,
}

struct Counters {
    state: State,
    condition: Condition,
    frames: Frames,
    captured: Rate,
    solved: Rate,
}

/// Counts of frames since the start.
#[derive(Debug, Clone, PartialEq, Default, Serialize, ToSchema)]
pub struct Frames {
    /// Frames that the source gave.
    pub captured: u64,
    /// Frames that became updates.
    pub solved: u64,
    /// Frames that a newer one replaced.
    pub dropped: u64,
    /// Frames that the camera made and that never arrived, by its numbering.
    pub lost: u64,
    /// Frames that were missing or broken.
    pub skipped: u64,
    /// Frames that were lost to an internal error of doorcam's.
    pub failed: u64,
    /// The last one that was skipped: file and reason.
    #[schema(required)]
    pub last_skipped: Option<String>,
}

/// How doorcam is doing.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct Status {
    /// Version of the program.
    pub version: &'static str,
    /// Whether the map can be trusted.
    pub state: State,
    /// The daemon's clock, for who wants to know how old an update is.
    pub time: Timestamp,
    /// Seconds since the start.
    pub uptime_s: f64,
    /// The model in use; none before there is a calibration.
    #[schema(value_type = Option<ModelKind>, required)]
    pub model: Option<&'static str>,
    /// The preset in use.
    #[schema(required)]
    pub preset: Option<Preset>,
    /// λ of eq. 13 in the newest update; 0 before there is a map.
    pub lambda: f64,
    /// Whether it is known where the camera sees the floor: without, there is no map.
    pub calibrated: bool,
    /// Counts calibrations of this run; updates have the number of theirs.
    pub calibration_revision: u32,
    /// Counts changes of the zones in this run.
    pub zones_revision: u32,
    /// Where frames come from.
    pub source: SourceStatus,
    /// Counts of frames.
    pub frames: Frames,
    /// Frames a second over the last seconds.
    pub rate_hz: Rates,
    /// What the newest update is a change against; none before the first, and where the background is fixed.
    #[schema(required)]
    pub background: Option<BackgroundReport>,
    /// The newest update; none before the first.
    #[schema(required)]
    pub last_update: Option<LastUpdate>,
    /// The recording under way, or the last one; none before the first.
    #[schema(required)]
    pub recording: Option<RecordingStatus>,
    /// Clients of the live socket.
    pub clients: usize,
}

/// Where frames come from and how that goes.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct SourceStatus {
    /// What is fixed.
    #[serde(flatten)]
    pub info: SourceInfo,
    /// Where it stands.
    pub state: SourceState,
    /// Why it is not streaming; none while all is well.
    #[schema(required)]
    pub error: Option<String>,
    /// What the camera granted; none for what is no camera, and while it is not open.
    #[schema(required)]
    pub granted: Option<Granted>,
}

/// Frames a second.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, ToSchema)]
pub struct Rates {
    /// From the source.
    pub captured: f64,
    /// To updates.
    pub solved: f64,
}

/// The newest update's number and age.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, ToSchema)]
pub struct LastUpdate {
    /// Its sequence number.
    pub sequence: u64,
    /// Seconds since it was published.
    pub age_s: f64,
}

/// Events in the last seconds.
#[derive(Debug, Default)]
struct Rate(VecDeque<Instant>);

impl Rate {
    const WINDOW: Duration = Duration::from_secs(3);
    const MOST: usize = 4096;

    fn count(&mut self, now: Instant) {
        self.trim(now);
        if self.0.len() < Self::MOST {
            self.0.push_back(now);
        }
    }

    fn trim(&mut self, now: Instant) {
        while self.0.front().is_some_and(|&t| now.duration_since(t) > Self::WINDOW) {
            self.0.pop_front();
        }
    }

    fn hz(&mut self, now: Instant) -> f64 {
        self.trim(now);
        match (self.0.front(), self.0.back()) {
            (Some(&first), Some(&last)) if last > first => {
                (self.0.len() - 1) as f64 / last.duration_since(first).as_secs_f64()
            }
            _ => 0.0,
        }
    }
}

impl Hub {
    /// A hub without updates; `watched` is none as long as there is no calibration.
    pub fn new(watched: Option<Watched>, preset: Option<Preset>, source: SourceInfo) -> Self {
        // As the page does it: a picture is not of now once five frames are overdue, or two seconds passed.
        let stale_after = Duration::from_secs_f64((5.0 / source.fps).max(2.0));
        let counters = Counters {
            state: State::Learning,
            condition: Condition { state: SourceState::Opening, reason: None, granted: None },
            frames: Frames::default(),
            captured: Rate::default(),
            solved: Rate::default(),
        };
        Self {
            watched: Mutex::new(watched),
            seen: watch::Sender::new(None),
            preset,
            source,
            latest: watch::Sender::new(None),
            recent: Mutex::new(Recent::new(TrackerConfig::default().history_s)),
            zones: Mutex::default(),
            listeners: Vec::new(),
            counters: Mutex::new(counters),
            tap: Tap::default(),
            meters: Meters::new(),
            started: Instant::now(),
            stale_after,
        }
    }

    /// Knows the zones and keeps as much of people's paths as is configured.
    pub fn configured(mut self, config: &Config) -> Self {
        self.recent = Mutex::new(Recent::new(config.tracker.history_s));
        lock(&self.zones).zones.clone_from(&config.zones);
        self
    }

    /// Keeps so many seconds of each track's path from now on.
    pub fn keep_paths(&self, history_s: f64) {
        lock(&self.recent).keep(history_s);
    }

    /// Tells every single update to `listener`, which must return at once.
    pub fn telling(mut self, listener: impl Fn(&Update) + Send + Sync + 'static) -> Self {
        self.listeners.push(Box::new(listener));
        self
    }

    /// The zones in use.
    pub fn zones(&self) -> Vec<Zone> {
        lock(&self.zones).zones.clone()
    }

    /// Counts changes of the zones in this run.
    pub fn zones_revision(&self) -> u32 {
        lock(&self.zones).revision
    }

    pub(super) fn use_zones(&self, zones: Vec<Zone>) {
        let mut zoned = lock(&self.zones);
        zoned.zones = zones;
        zoned.revision += 1;
    }

    /// What is kept of a track; none if there is no such track, or it ended too long ago.
    pub fn track(&self, id: u64) -> Option<TrackHistory> {
        let latest = self.latest();
        lock(&self.recent).track(id, latest.as_ref().map_or(&[], |latest| &latest.update.tracks))
    }

    /// Of the last thousand events, the first `limit` after number `after`; without one, the newest.
    pub fn events(&self, after: Option<u64>, limit: usize) -> Vec<Event> {
        lock(&self.recent).events(after, limit)
    }

    /// Whether the map can be trusted.
    pub fn state(&self) -> State {
        if self.latest().is_some() && !self.is_fresh() { State::Stale } else { lock(&self.counters).state }
    }

    /// What the updates are of; none before there is a calibration.
    pub fn watched(&self) -> Option<Watched> {
        lock(&self.watched).clone()
    }

    /// Width and height of the camera's images; none while no camera is open, and for other sources.
    pub fn size(&self) -> Option<[usize; 2]> {
        lock(&self.counters).condition.granted.as_ref().map(|granted| granted.size)
    }

    /// Frames a second that the camera granted, or that the source should give.
    pub fn fps(&self) -> f64 {
        lock(&self.counters).condition.granted.as_ref().map_or(self.source.fps, |granted| granted.fps)
    }

    /// How the recording is doing, or how the last one ended; none before the first.
    pub fn recording(&self) -> Option<RecordingStatus> {
        self.tap.status()
    }

    pub(super) fn tap(&self) -> &Tap {
        &self.tap
    }

    /// The newest images; none before the first frame.
    pub fn seen(&self) -> Option<CapturedImages> {
        self.seen.borrow().clone()
    }

    /// To be told of each frame; who is slow sees the newest only.
    pub fn frames(&self) -> watch::Receiver<Option<CapturedImages>> {
        self.seen.subscribe()
    }

    /// The newest update.
    pub fn latest(&self) -> Option<Arc<Published>> {
        self.latest.borrow().clone()
    }

    /// To be told of each update; who is slow sees the newest only.
    pub fn subscribe(&self) -> watch::Receiver<Option<Arc<Published>>> {
        self.latest.subscribe()
    }

    /// Whether the newest update is of now.
    pub fn is_fresh(&self) -> bool {
        self.latest().is_some_and(|p| p.at.elapsed() <= self.stale_after)
    }

    /// Everything there is to say, for `clients` listeners.
    pub fn status(&self, clients: usize) -> Status {
        let now = Instant::now();
        let last = self.latest();
        let state = self.state();
        let watched = self.watched();
        let mut counters = lock(&self.counters);
        let counters = &mut *counters;
        Status {
            version: env!("CARGO_PKG_VERSION"),
            state,
            time: Timestamp::now(),
            uptime_s: self.started.elapsed().as_secs_f64(),
            model: watched.as_ref().map(|w| w.model.kind.name()),
            preset: self.preset,
            calibrated: watched.is_some(),
            calibration_revision: watched.map_or(0, |w| w.calibration),
            zones_revision: self.zones_revision(),
            lambda: last.as_ref().map_or(0.0, |p| p.update.solution.lambda),
            source: SourceStatus {
                info: self.source.clone(),
                state: counters.condition.state,
                error: counters.condition.reason.clone(),
                granted: counters.condition.granted.clone(),
            },
            frames: counters.frames.clone(),
            rate_hz: Rates { captured: counters.captured.hz(now), solved: counters.solved.hz(now) },
            background: last.as_ref().and_then(|p| p.update.background),
            last_update: last.map(|p| LastUpdate { sequence: p.update.sequence, age_s: p.at.elapsed().as_secs_f64() }),
            recording: self.recording(),
            clients,
        }
    }

    pub(crate) fn publish(&self, published: Published) {
        let mut counters = lock(&self.counters);
        counters.state = published.update.state;
        counters.frames.solved += 1;
        counters.solved.count(published.at);
        drop(counters);
        self.meters.publish(&published.update);
        lock(&self.recent).take(&published.update);
        self.listeners.iter().for_each(|listen| listen(&published.update));
        self.latest.send_replace(Some(Arc::new(published)));
    }

    pub(super) fn watch(&self, watched: Watched) {
        *lock(&self.watched) = Some(watched);
    }

    pub(super) fn captured(&self, frame: &RawFrame, time: Timestamp) {
        self.tap.frame(frame);
        let mut counters = lock(&self.counters);
        let number = counters.frames.captured;
        self.seen.send_replace(Some(CapturedImages { number, images: frame.images.clone(), time, at: Instant::now() }));
        counters.frames.captured += 1;
        if counters.condition.state == SourceState::Opening {
            counters.condition.state = SourceState::Streaming;
            self.meters.source_is(SourceState::Streaming);
        }
        self.meters.captured.increment(1);
        counters.captured.count(Instant::now());
    }

    pub(super) fn dropped(&self, count: u64) {
        lock(&self.counters).frames.dropped += count;
        self.meters.dropped.increment(count);
    }

    /// Counts a skipped frame; returns how many there are and whether the reason is that of the one before.
    pub(super) fn skipped(&self, why: String) -> (u64, bool) {
        self.meters.skipped.increment(1);
        let frames = &mut lock(&self.counters).frames;
        frames.skipped += 1;
        let same_again = frames.last_skipped.as_ref() == Some(&why);
        frames.last_skipped = Some(why);
        (frames.skipped, same_again)
    }

    /// Counts frames that were lost to internal errors.
    pub(super) fn failed(&self, count: u64) {
        lock(&self.counters).frames.failed += count;
        self.meters.failed.increment(count);
    }

    pub(super) fn lost(&self, count: u64) {
        lock(&self.counters).frames.lost += count;
        self.meters.lost.increment(count);
    }

    pub(super) fn source_state(&self) -> SourceState {
        lock(&self.counters).condition.state
    }

    pub(super) fn condition(&self, condition: Condition) {
        let mut counters = lock(&self.counters);
        // An error is not covered up by the end that follows it.
        if counters.condition.state != SourceState::Failed {
            self.meters.source_is(condition.state);
            counters.condition = condition;
        }
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_reason_again_is_known_as_such() {
        let source = SourceInfo {
            spec: "v4l2:cam".into(),
            kind: crate::feed::SourceKind::V4l2,
            notes: String::new(),
            fps: 15.0,
        };
        let hub = Hub::new(None, None, source);
        let said: Vec<_> = ["small", "small", "broken", "small"].map(|why| hub.skipped(why.into())).into();
        assert_eq!(said, [(1, false), (2, true), (3, false), (4, false)]);
        let status = hub.status(0);
        assert_eq!((status.frames.skipped, status.frames.last_skipped.as_deref()), (4, Some("small")));
    }
}
