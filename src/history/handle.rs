//! The history as the rest of the program sees it: takes what happens, answers queries, and tells how it is kept.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use jiff::Timestamp;
use rusqlite::{Connection, ErrorCode};
use serde::Serialize;
use utoipa::ToSchema;

use super::bounds::{Bounded, Until};
use super::clock::{Clocks, System};
use super::pages::{Cut, EventPage, EventQuery, IntervalPage, IntervalQuery, SpanPage, SpanQuery};
use super::query::Tables;
use super::spans::Spans;
use super::store::{Batch, Store, StoreError, failed, open_reader};
use super::writer::Writer;
use super::{Kept, Numbers, Retention};
use doorcam_core::tracking::{Event, Occupancy};
use doorcam_engine::{State, Update};

/// Most events, and most spans, that wait to be written: a disk that hangs must not fill the memory.
pub(super) const MOST_PENDING: usize = 10_000;
/// How long a query waits for pending events and spans to be written.
const SETTLE: Duration = Duration::from_secs(1);
/// Most readers that are kept open between queries.
const IDLE_READERS: usize = 4;

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
    /// "stored": in the file. "memory": in memory, so only until the program ends or the file can be written again.
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
    pub(super) shared: Arc<Shared>,
    writer: Arc<Mutex<Option<JoinHandle<()>>>>,
    numbers: Numbers,
}

pub(super) struct Shared {
    pub(super) pending: Mutex<Pending>,
    /// Signalled to have what is pending written at once.
    pub(super) wanted: Condvar,
    /// Signalled after each write.
    pub(super) written: Condvar,
    pub(super) reading: Mutex<Reading>,
    pub(super) report: Mutex<HistoryReport>,
    /// Whether the history is being closed: queries end at once.
    ending: Arc<AtomicBool>,
}

/// What waits to be written.
pub(super) struct Pending {
    pub(super) batch: Batch,
    pub(super) spans: Spans,
    /// Whether there was an observation since the last write.
    pub(super) fresh: bool,
    pub(super) lost: u64,
    /// New limits since the last write, if any.
    pub(super) limits: Option<Retention>,
    /// What a query found wrong with the file.
    pub(super) damage: Option<String>,
    /// Number of requests to write at once.
    pub(super) asked: u64,
    /// How many of these requests have been served.
    pub(super) answered: u64,
    pub(super) ending: bool,
}

/// What queries are answered from.
pub(super) struct Reading {
    /// The file, once this run has used it and as long as it is in its place.
    pub(super) file: Option<PathBuf>,
    /// Readers of the file that no query uses.
    idle: Vec<Connection>,
    /// Changes with the file: readers of an earlier one are not used again.
    generation: u64,
    pub(super) memory: Store,
    pub(super) in_memory: bool,
}

impl Reading {
    pub(super) fn new(memory: Store) -> Self {
        Self { file: None, idle: Vec::new(), generation: 0, memory, in_memory: true }
    }

    /// Answers from this file from now on, or from none.
    pub(super) fn use_file(&mut self, file: Option<&Path>) {
        self.generation += 1;
        // One is opened ahead of need, because on a full disk it could not be opened.
        self.idle = file.and_then(|file| open_reader(file).ok()).into_iter().collect();
        self.file = file.map(Path::to_owned);
    }

    /// Closes the readers that no query uses.
    pub(super) fn close_readers(&mut self) {
        self.generation += 1;
        self.idle.clear();
    }

    fn give_back(&mut self, reader: Connection, generation: u64) {
        if generation == self.generation && self.idle.len() < IDLE_READERS {
            self.idle.push(reader);
        }
    }
}

impl History {
    /// Opens the file and starts the thread that writes it. A file that cannot be used is no error: the history is then
    /// kept in memory, and the report says so.
    ///
    /// # Errors
    ///
    /// If not even memory can be used, or the thread cannot be started.
    pub fn start(kept: Kept) -> Result<Self, HistoryError> {
        let (history, mut writer) = Self::open_with(kept, Box::new(System))?;
        let thread = std::thread::Builder::new().name("history".into()).spawn(move || writer.run());
        *lock(&history.writer) = Some(thread.map_err(HistoryError::Thread)?);
        Ok(history)
    }

    pub(super) fn open_with(kept: Kept, clocks: Box<dyn Clocks>) -> Result<(Self, Writer), HistoryError> {
        let memory = Store::in_memory().map_err(HistoryError::Memory)?;
        let report = HistoryReport { state: "memory", reason: None, file: kept.file.clone().ok(), bytes: 0, lost: 0 };
        let pending = Pending {
            batch: Batch::default(),
            spans: Spans::new(0),
            fresh: false,
            lost: 0,
            limits: None,
            damage: None,
            asked: 0,
            answered: 0,
            ending: false,
        };
        let shared = Arc::new(Shared {
            pending: Mutex::new(pending),
            wanted: Condvar::new(),
            written: Condvar::new(),
            reading: Mutex::new(Reading::new(memory)),
            report: Mutex::new(report),
            ending: Arc::default(),
        });
        let (writer, numbers) = Writer::open(kept, Arc::clone(&shared), clocks);
        {
            let mut pending = lock(&shared.pending);
            pending.batch.next = numbers;
            pending.spans = Spans::new(numbers.span);
        }
        Ok((Self { shared, writer: Arc::default(), numbers }, writer))
    }

    /// The first numbers of this run.
    pub fn numbers(&self) -> Numbers {
        self.numbers
    }

    /// Records an update. Never waits for the disk.
    pub fn take_update(&self, update: &Update) {
        self.take(&Observation {
            time: update.time,
            people: (update.state == State::Watching).then_some((update.people(), update.zones.as_slice())),
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
    /// If the history cannot be read, or `until` is over.
    pub fn events(&self, query: &EventQuery, until: &Until) -> Result<EventPage, StoreError> {
        self.read(until, |tables| tables.events(query))
    }

    /// Where the page that answers `query` begins and ends, to read it in parts.
    ///
    /// # Errors
    ///
    /// If the history cannot be read, or `until` is over.
    pub fn events_cut(&self, query: &EventQuery, until: &Until) -> Result<Cut, StoreError> {
        self.read(until, |tables| tables.events_cut(query))
    }

    /// The spans that match. May wait for the disk.
    ///
    /// # Errors
    ///
    /// If the history cannot be read, or `until` is over.
    pub fn spans(&self, query: &SpanQuery, until: &Until) -> Result<SpanPage, StoreError> {
        self.read(until, |tables| tables.spans(query))
    }

    /// Where the page that answers `query` begins and ends, to read it in parts.
    ///
    /// # Errors
    ///
    /// If the history cannot be read, or `until` is over.
    pub fn spans_cut(&self, query: &SpanQuery, until: &Until) -> Result<Cut, StoreError> {
        self.read(until, |tables| tables.spans_cut(query))
    }

    /// Occupancy, summed up over each interval. May wait for the disk.
    ///
    /// # Errors
    ///
    /// If the history cannot be read, or `until` is over.
    pub fn intervals(&self, query: &IntervalQuery, until: &Until) -> Result<IntervalPage, StoreError> {
        self.read(until, |tables| tables.intervals(query))
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
        self.shared.ending.store(true, Ordering::Relaxed);
        self.shared.wanted.notify_all();
        if let Some(thread) = lock(&self.writer).take() {
            // A panic was already reported when it happened.
            let _ = thread.join();
        }
    }

    fn read<T>(&self, until: &Until, ask: impl Fn(&Tables<'_>) -> rusqlite::Result<T>) -> Result<T, StoreError> {
        // If the disk hangs, the answer lacks what has not been written yet.
        self.settle();
        let bounded = |tables: &Tables<'_>| {
            let connections = tables.file.into_iter().chain(tables.memory);
            let bounds = connections.map(|connection| Bounded::new(connection, until, &self.shared.ending));
            let _bounds = bounds.collect::<rusqlite::Result<Vec<_>>>()?;
            // All statements of a query see the same rows.
            let _transaction = tables.file.map(Connection::unchecked_transaction).transpose()?;
            ask(tables)
        };
        let mut reading = lock(&self.shared.reading);
        let (file, generation) = (reading.file.clone(), reading.generation);
        let reader = reading.idle.pop();
        let Some(file) = file else {
            let memory = Some(&reading.memory.connection);
            return bounded(&Tables { file: None, memory }).map_err(|e| failed(Path::new("memory"), e));
        };
        if !reading.in_memory {
            // Nobody waits for a query of the file.
            drop(reading);
            let reader = reader.map_or_else(|| open_reader(&file), Ok);
            let answer = reader.and_then(|reader| {
                let answer = bounded(&Tables { file: Some(&reader), memory: None })?;
                lock(&self.shared.reading).give_back(reader, generation);
                Ok(answer)
            });
            return answer.map_err(|e| self.unreadable(&file, e));
        }
        let memory = Some(&reading.memory.connection);
        let reader = reader.or_else(|| open_reader(&file).ok());
        let answer = match bounded(&Tables { file: reader.as_ref(), memory }) {
            // A file that cannot be written may not be readable either.
            Err(e) if reader.is_some() && e.sqlite_error_code() != Some(ErrorCode::OperationInterrupted) => {
                return bounded(&Tables { file: None, memory }).map_err(|e| failed(&file, e));
            }
            answer => answer.map_err(|e| failed(&file, e)),
        };
        if let Some(reader) = reader.filter(|_| answer.is_ok()) {
            reading.give_back(reader, generation);
        }
        answer
    }

    /// Tells the writer if the file itself is at fault: what it has in its own memory may hide that.
    fn unreadable(&self, file: &Path, error: rusqlite::Error) -> StoreError {
        let error = failed(file, error);
        if let StoreError::Broken { reason, .. } = &error {
            lock(&self.shared.pending).damage = Some(reason.clone());
        }
        error
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

pub(super) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
