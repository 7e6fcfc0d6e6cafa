use std::path::{Path, PathBuf};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use jiff::Timestamp;
use rusqlite::Connection;
use serde::Serialize;
use utoipa::ToSchema;

use super::query::{EventPage, EventQuery, IntervalPage, IntervalQuery, SpanPage, SpanQuery, Tables};
use super::spans::Spans;
use super::store::{Batch, Store, StoreError, failed, open_reader};
use super::{Kept, Numbers, Retention};
use doorcam_core::tracking::{Event, Occupancy, TrackState};
use doorcam_engine::{State, Update};
use doorcam_source::camera::Backoff;

/// How often new events and spans are written.
const EVERY: Duration = Duration::from_millis(500);
/// Most events, and most spans, that wait to be written: a disk that hangs must not fill the memory.
const MOST_PENDING: usize = 10_000;
/// Most bytes kept in memory while the file cannot be written.
const MEMORY_BYTES: u64 = 8_000_000;
/// First and longest delay before the file is tried again after a failure.
const RETRY: [Duration; 2] = [Duration::from_secs(1), Duration::from_secs(30)];
/// How long a query waits for pending events and spans to be written.
const SETTLE: Duration = Duration::from_secs(1);

/// The part of an update that goes into the history.
#[derive(Debug, Clone, Copy)]
pub struct Observation<'a> {
    /// Time of capture.
    pub time: Timestamp,
    /// How many people are in the room, and who is in each zone; `None` while that is not known.
    pub people: Option<(usize, &'a [Occupancy])>,
    /// The events of the update.
    pub events: &'a [Event],
    /// The largest track id of the update; `None` without tracks.
    pub track: Option<u64>,
}

/// How the history is kept.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, ToSchema)]
pub struct HistoryReport {
    /// "stored": in the file. "memory": in memory, so only until the program ends.
    pub state: &'static str,
    /// Why it is in memory.
    #[schema(required)]
    pub reason: Option<String>,
    /// The file that the history is meant to be in; null if it is meant to be in memory.
    #[schema(value_type = Option<String>, required)]
    pub file: Option<PathBuf>,
    /// Bytes that the file and its log take; 0 in memory.
    pub bytes: u64,
    /// Events and spans that were lost because neither file nor memory could take them.
    pub lost: u64,
}

/// The history of a running doorcam: records what happens and answers queries. Clones share one history.
#[derive(Clone)]
pub struct History {
    shared: Arc<Shared>,
    writer: Arc<Mutex<Option<JoinHandle<()>>>>,
    numbers: Numbers,
}

struct Shared {
    pending: Mutex<Pending>,
    /// Signalled to have what is pending written at once.
    wanted: Condvar,
    /// Signalled after each write.
    written: Condvar,
    reading: Mutex<Reading>,
    report: Mutex<HistoryReport>,
}

/// What waits to be written.
struct Pending {
    batch: Batch,
    spans: Spans,
    /// Whether there was an observation since the last write.
    fresh: bool,
    lost: u64,
    /// New limits since the last write, if any.
    limits: Option<Retention>,
    /// Number of requests to write at once.
    asked: u64,
    /// How many of these requests have been served.
    answered: u64,
    ending: bool,
}

/// What queries are answered from.
struct Reading {
    /// The file, once this run has used it.
    file: Option<PathBuf>,
    connection: Option<Connection>,
    memory: Store,
    in_memory: bool,
}

struct Writer {
    shared: Arc<Shared>,
    kept: Kept,
    store: Option<Store>,
    backoff: Backoff,
    retry_at: Instant,
    /// Whether to prune even if nothing was written: rows may still be beyond the limits.
    full: bool,
}

impl History {
    /// Opens the file and starts the thread that writes it. A file that cannot be used is no error: the history is then
    /// kept in memory, and the report says so.
    ///
    /// # Errors
    ///
    /// If not even memory can be used, or the thread cannot be started.
    pub fn start(kept: Kept) -> Result<Self, HistoryError> {
        let (history, mut writer) = Self::open(kept)?;
        let thread = std::thread::Builder::new().name("history".into()).spawn(move || writer.run());
        *lock(&history.writer) = Some(thread.map_err(HistoryError::Thread)?);
        Ok(history)
    }

    fn open(kept: Kept) -> Result<(Self, Writer), HistoryError> {
        let memory = Store::in_memory().map_err(HistoryError::Memory)?;
        let mut reading = Reading { file: None, connection: None, memory, in_memory: true };
        let mut report =
            HistoryReport { state: "memory", reason: None, file: kept.file.clone().ok(), bytes: 0, lost: 0 };
        let mut store = None;
        let begin = |file: &Path| -> Result<(Store, Numbers), StoreError> {
            let (mut opened, aside) = Store::open_or_replace(file)?;
            let next = if aside.is_some() { Numbers::unknown(Timestamp::now()) } else { opened.next() };
            // Reserve the numbers before the first is used, so that none is used twice even if the process is killed
            // before its first write.
            opened.write(&Batch { next, ..Batch::default() }).map_err(|e| failed(file, e))?;
            Ok((opened, next))
        };
        let numbers = match kept.file.as_deref().map(begin) {
            Ok(Ok((opened, next))) => {
                // Opened ahead of need, because on a full disk it could not be opened.
                reading.connection = kept.file.as_deref().ok().and_then(|file| open_reader(file).ok());
                (reading.file, reading.in_memory) = (kept.file.clone().ok(), false);
                (report.state, report.bytes) = ("stored", opened.bytes().unwrap_or(0));
                store = Some(opened);
                next
            }
            Ok(Err(e)) => {
                tracing::warn!("{e}: the history is kept in memory until that works");
                report.reason = Some(e.to_string());
                Numbers::unknown(Timestamp::now())
            }
            Err(why) => {
                report.reason = Some(why.clone());
                Numbers::default()
            }
        };
        let spans = Spans::new(numbers.span);
        let batch = Batch { next: numbers, ..Batch::default() };
        let pending =
            Pending { batch, spans, fresh: false, lost: 0, limits: None, asked: 0, answered: 0, ending: false };
        let shared = Arc::new(Shared {
            pending: Mutex::new(pending),
            wanted: Condvar::new(),
            written: Condvar::new(),
            reading: Mutex::new(reading),
            report: Mutex::new(report),
        });
        let [first, longest] = RETRY;
        let mut backoff = Backoff::new(first, longest, u64::from(std::process::id()));
        let retry_at = Instant::now() + backoff.next_delay();
        let writer = Writer { shared: Arc::clone(&shared), kept, store, backoff, retry_at, full: true };
        Ok((Self { shared, writer: Arc::default(), numbers }, writer))
    }

    /// The first numbers of this run.
    pub fn numbers(&self) -> Numbers {
        self.numbers
    }

    /// Records an update. Never waits for the disk.
    pub fn take_update(&self, update: &Update) {
        let people = update.tracks.iter().filter(|track| track.state != TrackState::Tentative).count();
        self.take(&Observation {
            time: update.time,
            people: (update.state == State::Watching).then_some((people, update.zones.as_slice())),
            events: &update.events,
            track: update.tracks.iter().map(|track| track.id).max(),
        });
    }

    /// Records an observation. Never waits for the disk.
    pub fn take(&self, observation: &Observation<'_>) {
        let Observation { time, people, events, track } = *observation;
        let mut pending = lock(&self.shared.pending);
        let Pending { batch, spans, lost, fresh, .. } = &mut *pending;
        *fresh = true;
        spans.observe(time, people, &mut batch.spans);
        batch.next.span = spans.next();
        batch.next.track = track.map_or(batch.next.track, |track| batch.next.track.max(track + 1));
        batch.next.event = events.last().map_or(batch.next.event, |event| batch.next.event.max(event.sequence + 1));
        let taken = MOST_PENDING.saturating_sub(batch.events.len()).min(events.len());
        batch.events.extend_from_slice(&events[..taken]);
        *lost += (events.len() - taken + batch.spans.len().saturating_sub(MOST_PENDING)) as u64;
        batch.spans.truncate(MOST_PENDING);
    }

    /// The events that match. May wait for the disk.
    ///
    /// # Errors
    ///
    /// If the history cannot be read.
    pub fn events(&self, query: &EventQuery) -> Result<EventPage, StoreError> {
        self.read(|tables| tables.events(query))
    }

    /// The spans that match. May wait for the disk.
    ///
    /// # Errors
    ///
    /// If the history cannot be read.
    pub fn spans(&self, query: &SpanQuery) -> Result<SpanPage, StoreError> {
        self.read(|tables| tables.spans(query))
    }

    /// Occupancy, summed up over each interval. May wait for the disk.
    ///
    /// # Errors
    ///
    /// If the history cannot be read.
    pub fn intervals(&self, query: &IntervalQuery) -> Result<IntervalPage, StoreError> {
        self.read(|tables| tables.intervals(query))
    }

    /// Changes how much is kept.
    pub fn limit(&self, limits: Retention) {
        lock(&self.shared.pending).limits = Some(limits);
    }

    /// How it is kept.
    pub fn report(&self) -> HistoryReport {
        lock(&self.shared.report).clone()
    }

    /// Waits until everything recorded so far is written, to the file or to memory; false if that takes too long.
    pub fn settle(&self) -> bool {
        let mut pending = lock(&self.shared.pending);
        pending.asked += 1;
        let mine = pending.asked;
        self.shared.wanted.notify_all();
        let waiting = |pending: &mut Pending| pending.answered < mine;
        let waited = self.shared.written.wait_timeout_while(pending, SETTLE, waiting);
        !waited.unwrap_or_else(PoisonError::into_inner).1.timed_out()
    }

    /// Writes the rest and closes the file.
    pub fn end(&self) {
        lock(&self.shared.pending).ending = true;
        self.shared.wanted.notify_all();
        if let Some(thread) = lock(&self.writer).take() {
            // A panic was already reported when it happened.
            let _ = thread.join();
        }
    }

    fn read<T>(&self, ask: impl Fn(&Tables<'_>) -> rusqlite::Result<T>) -> Result<T, StoreError> {
        // If the disk hangs, the answer lacks what has not been written yet.
        self.settle();
        let mut reading = lock(&self.shared.reading);
        let reading = &mut *reading;
        let memory = reading.in_memory.then_some(&reading.memory.connection);
        let Some(file) = &reading.file else {
            return ask(&Tables { file: None, memory }).map_err(|e| failed(Path::new("memory"), e));
        };
        if reading.connection.is_none() {
            reading.connection = open_reader(file).ok();
        }
        let tables = Tables { file: reading.connection.as_ref(), memory };
        let answer = ask(&tables);
        if answer.is_err() {
            reading.connection = None;
        }
        match answer {
            // A file that cannot be written may not be readable either.
            Err(_) if memory.is_some() => ask(&Tables { file: None, memory }),
            answer => answer,
        }
        .map_err(|e| failed(file, e))
    }
}

/// Why there is no history at all.
#[derive(Debug, thiserror::Error)]
pub enum HistoryError {
    /// The tables in memory cannot be created.
    #[error("cannot keep a history in memory: {0}")]
    Memory(rusqlite::Error),
    /// The thread that writes the history cannot be started.
    #[error("cannot start the thread that writes the history: {0}")]
    Thread(std::io::Error),
}

impl Writer {
    fn run(&mut self) {
        while self.turn() {}
        let next = lock(&self.shared.pending).batch.next;
        // An open reader would keep SQLite from moving the log into the file.
        lock(&self.shared.reading).connection = None;
        if let Some(store) = self.store.take()
            && let Err(e) = store.close(next)
        {
            tracing::warn!("the history was not closed properly: {e}");
        }
    }

    /// Waits for the next regular write, or until one is requested, and writes; false after the last write.
    fn turn(&mut self) -> bool {
        let idle = |pending: &mut Pending| pending.asked == pending.answered && !pending.ending;
        let waited = self.shared.wanted.wait_timeout_while(lock(&self.shared.pending), EVERY, idle);
        drop(waited.unwrap_or_else(PoisonError::into_inner));
        self.put_away()
    }

    /// Writes what is pending; false if that was the last write.
    fn put_away(&mut self) -> bool {
        let mut pending = lock(&self.shared.pending);
        let (asked, ending) = (pending.asked, pending.ending);
        let next = pending.batch.next;
        let mut batch = std::mem::replace(&mut pending.batch, Batch { next, ..Batch::default() });
        if std::mem::take(&mut pending.fresh) {
            batch.spans.extend(pending.spans.open().cloned());
        }
        let lost = std::mem::take(&mut pending.lost);
        if let Some(limits) = pending.limits.take() {
            (self.kept.limits, self.full) = (limits, true);
        }
        drop(pending);
        lock(&self.shared.report).lost += lost;
        self.write(&batch);
        if !ending && (self.full || !batch.is_empty()) {
            self.prune();
        }
        lock(&self.shared.pending).answered = asked;
        self.shared.written.notify_all();
        !ending
    }

    fn write(&mut self, batch: &Batch) {
        if self.store.is_none() && self.kept.file.is_ok() && Instant::now() >= self.retry_at {
            self.restore();
        }
        if batch.is_empty() {
            return;
        }
        if let Some(store) = &mut self.store {
            match store.write(batch) {
                Ok(()) => return,
                Err(e) => self.degrade(&e),
            }
        }
        if lock(&self.shared.reading).memory.write(batch).is_err() {
            lock(&self.shared.report).lost += (batch.events.len() + batch.spans.len()) as u64;
        }
    }

    /// Switches to memory after an error.
    fn degrade(&mut self, error: &rusqlite::Error) {
        let Ok(file) = &self.kept.file else { return };
        let reason = format!("{}: {error}", file.display());
        tracing::warn!("{reason}: the history is kept in memory until that works");
        self.store = None;
        lock(&self.shared.reading).in_memory = true;
        self.in_memory_because(reason);
        self.retry_at = Instant::now() + self.backoff.next_delay();
    }

    fn in_memory_because(&self, reason: String) {
        let mut report = lock(&self.shared.report);
        (report.state, report.reason) = ("memory", Some(reason));
    }

    /// Tries the file again, and moves what is in memory to it.
    fn restore(&mut self) {
        let Ok(file) = self.kept.file.clone() else { return };
        let mut reading = lock(&self.shared.reading);
        let opened = match Store::open(&file) {
            Err(StoreError::Broken { .. }) => {
                // The file is about to be renamed, so queries must no longer read it. Otherwise the reader stays open,
                // because on a full disk it could not be opened again.
                reading.connection = None;
                Store::open_or_replace(&file).map(|(store, _)| store)
            }
            opened => opened,
        };
        let restored = opened.and_then(|mut store| {
            let next = lock(&self.shared.pending).batch.next;
            let kept = reading.memory.everything(next).map_err(|e| failed(Path::new("memory"), e))?;
            store.write(&kept).map_err(|e| failed(&file, e))?;
            Ok(store)
        });
        match restored {
            Ok(store) => {
                if let Ok(empty) = Store::in_memory() {
                    reading.memory = empty;
                }
                reading.connection = open_reader(&file).ok();
                (reading.file, reading.in_memory) = (Some(file.clone()), false);
                self.store = Some(store);
                self.backoff.reset();
                let mut report = lock(&self.shared.report);
                (report.state, report.reason) = ("stored", None);
                tracing::info!("{}: the history is kept in this file again", file.display());
            }
            Err(e) => {
                drop(reading);
                self.in_memory_because(e.to_string());
                self.retry_at = Instant::now() + self.backoff.next_delay();
            }
        }
    }

    /// Deletes some of the rows that are too old or too many.
    fn prune(&mut self) {
        let limits = self.kept.limits;
        let pruned = match &mut self.store {
            Some(store) => store.prune(limits, Timestamp::now()).and_then(|gone| Ok((gone, store.bytes()?))),
            None => {
                let limits = Retention { bytes: limits.bytes.min(MEMORY_BYTES), ..limits };
                let pruned = lock(&self.shared.reading).memory.prune(limits, Timestamp::now());
                if let (Ok(gone), Ok(_)) = (&pruned, &self.kept.file) {
                    lock(&self.shared.report).lost += *gone as u64;
                }
                pruned.map(|gone| (gone, 0))
            }
        };
        match pruned {
            Ok((gone, bytes)) => {
                self.full = gone > 0;
                lock(&self.shared.report).bytes = bytes;
            }
            Err(e) => self.degrade(&e),
        }
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
#[path = "writer_tests.rs"]
mod tests;
