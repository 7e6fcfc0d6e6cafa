use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use jiff::Timestamp;
use jiff::tz::TimeZone;
use tokio::sync::watch;

use crate::config::{Config, Preset, TrackerConfig};
use crate::feed::SourceInfo;
use crate::watch::crossings::{Crossings, Tally, why_not};
use crate::watch::meters::Meters;
use crate::watch::rate::Rate;
use crate::watch::recent::Recent;
use crate::watch::skips::Skips;
use crate::watch::status::{Frames, LastUpdate, Rates, SourceStatus, Status};
use crate::watch::tap::Tap;
use crate::watch::watching::{Observed, Watching};
use crate::watch::{CrossingsReport, TrackHistory, ZoneIds};
use doorcam_core::calibration::Calibration;
use doorcam_core::tracking::{Event, Zone};
use doorcam_engine::{Published, State, Update, Watched};
use doorcam_source::recorder::RecordingStatus;
use doorcam_source::{Condition, RawFrame, RawImages, SkippedFrame, SourceState};

/// The newest images, as the source delivered them.
#[derive(Debug, Clone)]
pub struct CapturedImages {
    /// Number of the frame in this run, from 0.
    pub number: u64,
    /// The images.
    pub images: RawImages,
    /// When they were captured.
    pub time: Timestamp,
    /// When they arrived.
    pub at: Instant,
}

/// An update older than this, in seconds, is stale however slowly its source gives frames.
const LONGEST_FRESH_S: f64 = 3600.0;

/// Called with every update on the solver thread, so it must return at once.
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
    /// Whether crossings are configured to be told.
    tells_crossings: bool,
    crossings: Mutex<Crossings>,
    /// Told when what is kept of them has changed.
    crossed: watch::Sender<()>,
    listeners: Vec<Listener>,
    counters: Mutex<Counters>,
    tap: Tap,
    meters: Meters,
    followers: Mutex<Followers>,
    started: Instant,
}

/// Called with a calibration that has followed the camera and the revision that it replaces, on the solver thread.
type Follower = Box<dyn Fn(u32, Calibration) + Send + Sync>;

/// Who keeps a calibration that has followed the camera, and what was not told yet because there was nobody.
#[derive(Default)]
struct Followers {
    keeper: Option<Follower>,
    waiting: Option<(u32, Calibration)>,
}

#[derive(Default)]
struct Zoned {
    zones: Vec<Zone>,
    revision: u32,
}

struct Counters {
    observed: Observed,
    condition: Condition,
    frames: Frames,
    captured: Rate,
    solved: Rate,
    skips: Skips,
    /// The source's own condition, while `condition` says that its frames cannot be used.
    reported: Option<Condition>,
}

impl Hub {
    /// A hub without updates. `watched` is `None` as long as there is no calibration.
    pub fn new(watched: Option<Watched>, preset: Option<Preset>, source: SourceInfo) -> Self {
        // The same rule as on the page: stale after five frame intervals, but not before two seconds.
        let fresh_s = if source.fps > 0.0 { (5.0 / source.fps).clamp(2.0, LONGEST_FRESH_S) } else { LONGEST_FRESH_S };
        let stale_after = Duration::from_secs_f64(fresh_s);
        let started = Instant::now();
        let counters = Counters {
            observed: Observed::new(stale_after, watched.is_some(), started, Timestamp::now()),
            condition: Condition { state: SourceState::Opening, reason: None, granted: None },
            frames: Frames::default(),
            captured: Rate::default(),
            solved: Rate::default(),
            skips: Skips::default(),
            reported: None,
        };
        Self {
            watched: Mutex::new(watched),
            seen: watch::Sender::new(None),
            preset,
            source,
            latest: watch::Sender::new(None),
            recent: Mutex::new(Recent::new(TrackerConfig::default().history_s)),
            zones: Mutex::default(),
            tells_crossings: true,
            crossings: Mutex::new(Crossings::new(TimeZone::system(), Timestamp::now())),
            crossed: watch::Sender::new(()),
            listeners: Vec::new(),
            counters: Mutex::new(counters),
            tap: Tap::default(),
            meters: Meters::new(),
            followers: Mutex::default(),
            started,
        }
    }

    /// Takes the zones, the length of the paths to keep and whether crossings are told from the configuration.
    pub fn configured(mut self, config: &Config) -> Self {
        self.tells_crossings = config.crossings.enabled;
        self.recent = Mutex::new(Recent::new(config.tracker.history_s));
        lock(&self.zones).zones = ZoneIds::default().identified(&config.zones);
        self
    }

    /// Keeps `history_s` seconds of each track's path from now on.
    pub fn keep_paths(&self, history_s: f64) {
        lock(&self.recent).keep(history_s);
    }

    /// Calls `listener` with every update; it must return at once.
    pub fn telling(mut self, listener: impl Fn(&Update) + Send + Sync + 'static) -> Self {
        self.listeners.push(Box::new(listener));
        self
    }

    /// Calls `keeper` with each calibration that has followed the camera and the revision that it replaces; it must
    /// return at once.
    pub(super) fn on_followed(&self, keeper: impl Fn(u32, Calibration) + Send + Sync + 'static) {
        let mut followers = lock(&self.followers);
        followers.waiting.take().into_iter().for_each(|(revision, calibration)| keeper(revision, calibration));
        followers.keeper = Some(Box::new(keeper));
    }

    pub(super) fn followed(&self, revision: u32, calibration: Calibration) {
        let mut followers = lock(&self.followers);
        match &followers.keeper {
            Some(keeper) => keeper(revision, calibration),
            None => followers.waiting = Some((revision, calibration)),
        }
    }

    /// The zones in use, each with its id.
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

    /// What is kept of a track; `None` if there is no such track or it ended too long ago.
    pub fn track(&self, id: u64) -> Option<TrackHistory> {
        let latest = self.latest();
        lock(&self.recent).track(id, latest.as_ref().map_or(&[], |latest| &latest.update.tracks))
    }

    /// The first `limit` events after number `after`, or the newest `limit` if it is `None`. The last thousand events
    /// are kept.
    pub fn events(&self, after: Option<u64>, limit: usize) -> Vec<Event> {
        lock(&self.recent).events(after, limit)
    }

    /// Whether doorcam is watching now, and if not, why: the one answer for everybody who asks.
    pub fn watching(&self) -> Watching {
        lock(&self.counters).observed.watching(Instant::now())
    }

    /// Whether doorcam is watching, and the number of people, for `/metrics`.
    pub fn exposition(&self) -> String {
        let people = self.latest().map_or(0, |latest| latest.update.people());
        let mut text = self.watching().exposition(people);
        text.push_str(&self.crossings().exposition());
        text
    }

    /// Who walked through the doorway: the one answer for everybody who asks.
    pub fn crossings(&self) -> CrossingsReport {
        let never = lock(&self.watched).as_ref().and_then(|watched| watched.no_crossings.clone());
        let unavailable = why_not(self.tells_crossings, never, self.watching().reason);
        lock(&self.crossings).report(unavailable, Timestamp::now())
    }

    /// What is counted of them at `now`.
    pub(super) fn tally(&self, now: Timestamp) -> Tally {
        lock(&self.crossings).tally(now).clone()
    }

    /// From when on an earlier run may have seen crossings that are not in its `kept` tally.
    pub(super) fn reread_crossings_from(&self, kept: Option<&Tally>, now: Timestamp) -> Timestamp {
        let midnight = lock(&self.crossings).midnight(now);
        kept.map_or(midnight, |kept| kept.reread_from(midnight))
    }

    /// Goes on counting where an earlier run has ended.
    pub(super) fn resume_crossings(&self, kept: Option<Tally>, crossings: &[Event], now: Timestamp) {
        lock(&self.crossings).go_on(kept, crossings, now);
        self.crossed.send_replace(());
    }

    /// Sets the estimate of how many people are inside.
    pub(super) fn set_inside(&self, inside: u32, now: Timestamp) {
        lock(&self.crossings).set_inside(inside, now);
        self.crossed.send_replace(());
    }

    /// A receiver that is notified when what is counted of them has changed.
    pub(super) fn crossing_changes(&self) -> watch::Receiver<()> {
        self.crossed.subscribe()
    }

    /// Counts the crossings among an update's events, mostly none, and those who are followed in the room.
    fn count_crossings(&self, update: &Update) {
        let crossings = update.events.iter().filter(|event| event.kind.direction().is_some());
        // Without a map nobody is followed, and whoever is inside stays there.
        let maps = matches!(update.state, State::Watching | State::Obstructed);
        let mut changed = maps && lock(&self.crossings).see(update.people());
        for event in crossings {
            let direction = lock(&self.crossings).take(event, Timestamp::now());
            direction.into_iter().for_each(|direction| self.meters.crossed(direction));
            changed = true;
        }
        if changed {
            self.crossed.send_replace(());
        }
    }

    /// Whether the map can be trusted.
    pub fn state(&self) -> State {
        self.watching().state
    }

    /// What the updates describe; `None` before there is a calibration.
    pub fn watched(&self) -> Option<Watched> {
        lock(&self.watched).clone()
    }

    /// Width and height of the camera's images in pixels; `None` while no camera is open and for other sources.
    pub fn size(&self) -> Option<[usize; 2]> {
        lock(&self.counters).condition.granted.as_ref().map(|granted| granted.size)
    }

    /// Frames per second that the camera granted, or else the source's nominal rate.
    pub fn fps(&self) -> f64 {
        lock(&self.counters).condition.granted.as_ref().map_or(self.source.fps, |granted| granted.fps)
    }

    /// Progress of the recording, or how the last one ended; `None` before the first.
    pub fn recording(&self) -> Option<RecordingStatus> {
        self.tap.status()
    }

    pub(super) fn tap(&self) -> &Tap {
        &self.tap
    }

    /// The newest images; `None` before the first frame.
    pub fn seen(&self) -> Option<CapturedImages> {
        self.seen.borrow().clone()
    }

    /// A receiver that is notified of each frame; a slow reader sees only the newest.
    pub fn frames(&self) -> watch::Receiver<Option<CapturedImages>> {
        self.seen.subscribe()
    }

    /// The newest update.
    pub fn latest(&self) -> Option<Arc<Published>> {
        self.latest.borrow().clone()
    }

    /// An update as JSON. One that does not show the present any more says so in its `state`.
    pub fn json(&self, published: &Published) -> Arc<str> {
        match self.state() {
            // Serialisation cannot fail, because all keys are strings.
            state @ State::Stale => serde_json::to_string(&Update { state, ..published.update.clone() })
                .map_or_else(|_| Arc::clone(&published.json), Arc::from),
            _ => Arc::clone(&published.json),
        }
    }

    /// A receiver that is notified of each update; a slow reader sees only the newest.
    pub fn subscribe(&self) -> watch::Receiver<Option<Arc<Published>>> {
        self.latest.subscribe()
    }

    /// The complete status, with `clients` as the number of live clients.
    pub fn status(&self, clients: usize) -> Status {
        let now = Instant::now();
        let last = self.latest();
        let watched = self.watched();
        let crossings = self.crossings();
        let mut counters = lock(&self.counters);
        let counters = &mut *counters;
        let watching = counters.observed.watching(now);
        Status {
            version: env!("CARGO_PKG_VERSION"),
            state: watching.state,
            watching,
            time: Timestamp::now(),
            uptime_s: self.started.elapsed().as_secs_f64(),
            model: watched.as_ref().map(|w| w.model.kind.name()),
            preset: self.preset,
            calibrated: watched.is_some(),
            calibration_revision: watched.map_or(0, |w| w.calibration),
            zones_revision: self.zones_revision(),
            crossings,
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
            camera_moved: last.as_ref().and_then(|p| p.update.camera_moved),
            last_update: last.map(|p| LastUpdate { sequence: p.update.sequence, age_s: p.at.elapsed().as_secs_f64() }),
            recording: self.recording(),
            clients,
        }
    }

    pub(crate) fn publish(&self, published: Published) {
        let mut counters = lock(&self.counters);
        counters.observed.updated(published.update.state, published.at, Timestamp::now());
        counters.frames.solved += 1;
        counters.solved.count(published.at);
        counters.skips.end();
        if let Some(reported) = counters.reported.take() {
            self.meters.source_is(reported.state);
            counters.condition = reported;
        }
        drop(counters);
        self.meters.publish(&published.update);
        lock(&self.recent).take(&published.update);
        self.count_crossings(&published.update);
        self.listeners.iter().for_each(|listen| listen(&published.update));
        self.latest.send_replace(Some(Arc::new(published)));
    }

    pub(super) fn watch(&self, watched: Watched) {
        *lock(&self.watched) = Some(watched);
        lock(&self.counters).observed.calibrated(Instant::now(), Timestamp::now());
    }

    pub(super) fn captured(&self, frame: &RawFrame, time: Timestamp) {
        self.tap.frame(frame);
        let mut counters = lock(&self.counters);
        let number = counters.frames.captured;
        self.seen.send_replace(Some(CapturedImages { number, images: frame.images.clone(), time, at: Instant::now() }));
        counters.frames.captured += 1;
        if counters.condition.state == SourceState::Opening {
            counters.condition.state = SourceState::Streaming;
            counters.observed.source_is(SourceState::Streaming, Instant::now(), Timestamp::now());
            self.meters.source_is(SourceState::Streaming);
        }
        self.meters.captured.increment(1);
        counters.captured.count(Instant::now());
    }

    pub(super) fn dropped(&self, count: u64) {
        lock(&self.counters).frames.dropped += count;
        self.meters.dropped.increment(count);
    }

    /// Counts a skipped frame. If it is time for a line about frames of its kind, returns the total, and the number of
    /// its kind since the last line.
    pub(super) fn skipped(&self, skipped: &SkippedFrame) -> Option<(u64, u64)> {
        self.meters.skipped.increment(1);
        let counters = &mut *lock(&self.counters);
        counters.frames.skipped += 1;
        counters.frames.last_skipped = Some(skipped.to_string());
        let new = counters.skips.add(skipped, Instant::now())?;
        Some((counters.frames.skipped, new))
    }

    /// Counts a frame that arrived but could not be used. After many in a row the source counts as stalled until one can
    /// be used again. Returns whether it does, and the reason if that is news.
    pub(super) fn unusable(&self, skipped: &SkippedFrame) -> (bool, Option<String>) {
        let counters = &mut *lock(&self.counters);
        counters.skips.unusable();
        let Some(count) = counters.skips.trouble() else { return (false, None) };
        if counters.condition.state != SourceState::Streaming {
            return (true, None);
        }
        let reason = format!("{count} frames in a row cannot be used: {skipped}");
        let Condition { granted, .. } = counters.condition.clone();
        let stalled = Condition { state: SourceState::Stalled, reason: Some(reason.clone()), granted };
        counters.reported = Some(std::mem::replace(&mut counters.condition, stalled));
        self.meters.source_is(SourceState::Stalled);
        (true, Some(reason))
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
        // Keep an error visible when the end of the source follows it.
        if counters.condition.state != SourceState::Failed {
            self.meters.source_is(condition.state);
            counters.observed.source_is(condition.state, Instant::now(), Timestamp::now());
            counters.condition = condition;
            counters.reported = None;
            counters.skips.end();
        }
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
#[path = "hub_tests.rs"]
mod tests;
