//! The thread that writes the history: to the file, or to memory while the file cannot be written.

use std::path::Path;
use std::sync::{Arc, PoisonError};
use std::time::{Duration, Instant};

use jiff::{SignedDuration, Timestamp};

use super::clock::{Believed, Clocks, PERSISTS};
use super::handle::{Pending, Shared, lock};
use super::sparing::Sparing;
use super::store::{Batch, Store, StoreError, failed};
use super::{Kept, Numbers, Retention};
use doorcam_source::camera::Backoff;

/// How often new events and spans are written.
const EVERY: Duration = Duration::from_millis(500);
/// Most bytes kept in memory while the file cannot be written.
const MEMORY_BYTES: u64 = 8_000_000;
/// First and longest delay before the file is tried again after a failure.
const RETRY: [Duration; 2] = [Duration::from_secs(1), Duration::from_secs(30)];
/// How long the file has to work before a failure counts as the first one again.
const HEALTHY: Duration = Duration::from_secs(60);
/// How often the file is checked, at most, after others have written to it: that reads all of it.
const CHECK_EVERY: Duration = Duration::from_secs(10);
/// How often the time that is believed is kept in the file.
const CLOCK_EVERY: Duration = Duration::from_secs(60);

pub(super) struct Writer {
    shared: Arc<Shared>,
    kept: Kept,
    store: Option<Store>,
    clocks: Box<dyn Clocks>,
    believed: Believed,
    /// When the time that is believed is next kept in the file.
    keep_clock_at: Instant,
    backoff: Backoff,
    retry_at: Instant,
    /// Since when the file works.
    works_since: Instant,
    /// Whether others have written to it since it was checked, and when it may be checked again.
    touched: bool,
    check_at: Instant,
    said: Sparing,
    /// Whether to prune even if nothing was written: rows may still be beyond the limits.
    full: bool,
}

impl Writer {
    /// Opens the file, if it can be opened, and returns the first numbers of this run.
    pub(super) fn open(kept: Kept, shared: Arc<Shared>, clocks: Box<dyn Clocks>) -> (Self, Numbers) {
        let [first, longest] = RETRY;
        let mut backoff = Backoff::new(first, longest, u64::from(std::process::id()));
        let now = Instant::now();
        let retry_at = now + backoff.next_delay();
        let believed = Believed::new(clocks.wall(), clocks.running());
        let mut writer = Self {
            shared,
            kept,
            store: None,
            clocks,
            believed,
            keep_clock_at: now,
            backoff,
            retry_at,
            works_since: now,
            touched: false,
            check_at: now,
            said: Sparing::default(),
            full: true,
        };
        let numbers = writer.begin();
        (writer, numbers)
    }

    fn begin(&mut self) -> Numbers {
        let unknown = Numbers::unknown(self.clocks.wall());
        let opened = match &self.kept.file {
            Ok(file) => Store::open_or_replace(file).and_then(|(mut store, aside)| {
                let next = if aside.is_some() { unknown } else { store.next() };
                // Reserve the numbers before the first is used, so that none is used twice even if the process is
                // killed before its first write.
                store.write(&Batch { next, ..Batch::default() }).map_err(|e| failed(file, e))?;
                let before = store.clock().map_err(|e| failed(file, e))?;
                Ok((store, next, before))
            }),
            Err(why) => {
                lock(&self.shared.report).reason = Some(why.clone());
                return Numbers::default();
            }
        };
        match opened {
            Ok((store, next, before)) => {
                if let Some(before) = before {
                    // How long doorcam did not run is not known: the clock has to stay for a while to be believed.
                    self.believed = Believed::new(before, self.clocks.running());
                    self.believed.look(self.clocks.as_ref());
                }
                self.stored(store);
                next
            }
            Err(e) => {
                tracing::warn!("{e}: the history is kept in memory until that works");
                self.in_memory_because(e.to_string());
                unknown
            }
        }
    }

    /// Writes until the end.
    pub(super) fn run(&mut self) {
        while self.turn() {}
        let next = lock(&self.shared.pending).batch.next;
        // An open reader would keep SQLite from moving the log into the file.
        lock(&self.shared.reading).close_readers();
        let believed = self.believed.expected(self.clocks.running());
        if let Some(store) = self.store.take()
            && let Err(e) = store.keep_clock(believed).and_then(|()| store.close(next))
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
    pub(super) fn put_away(&mut self) -> bool {
        let mut pending = lock(&self.shared.pending);
        let (asked, ending) = (pending.asked, pending.ending);
        let next = pending.batch.next;
        let mut batch = std::mem::replace(&mut pending.batch, Batch { next, ..Batch::default() });
        if std::mem::take(&mut pending.fresh) {
            batch.spans.extend(pending.spans.open().cloned());
        }
        let lost = std::mem::take(&mut pending.lost);
        let damage = pending.damage.take();
        if let Some(limits) = pending.limits.take() {
            (self.kept.limits, self.full) = (limits, true);
        }
        drop(pending);
        lock(&self.shared.report).lost += lost;
        self.look_at_the_file();
        self.look_at_the_clock();
        if let Some(damage) = damage.filter(|_| self.store.is_some()) {
            self.fail(&damage);
        }
        self.write(&batch, ending);
        if !ending && (self.full || !batch.is_empty()) {
            self.prune();
        }
        if let Some(store) = &mut self.store
            && !self.touched
        {
            store.remember();
        }
        lock(&self.shared.pending).answered = asked;
        self.shared.written.notify_all();
        !ending
    }

    /// Notices what others have written to the file while it is open.
    fn look_at_the_file(&mut self) {
        let Some(store) = &self.store else { return };
        self.touched |= store.was_touched();
        let now = Instant::now();
        if self.touched && now >= self.check_at {
            (self.touched, self.check_at) = (false, now + CHECK_EVERY);
            if let Some(damage) = store.damage() {
                self.fail(&damage);
            }
        }
    }

    fn look_at_the_clock(&mut self) {
        if let Some(off) = self.believed.look(self.clocks.as_ref())
            && self.said.may("clock")
        {
            let direction = if off.is_negative() { "back" } else { "ahead" };
            let (off, hours) = (SignedDuration::from_secs(off.abs().as_secs()), PERSISTS.as_secs() / 3600);
            tracing::warn!(
                "the clock was put {direction} by {off:#}: no history is deleted for its age by it until it has stayed \
                 so for {hours} h"
            );
        }
        let now = Instant::now();
        if now >= self.keep_clock_at
            && let Some(store) = &self.store
        {
            self.keep_clock_at = now + CLOCK_EVERY;
            if let Err(e) = store.keep_clock(self.believed.expected(self.clocks.running())) {
                self.fail(&e.to_string());
            }
        }
    }

    fn write(&mut self, batch: &Batch, last: bool) {
        if let Some(why) = self.store.as_ref().and_then(Store::lost) {
            self.leave(why);
        }
        if self.store.is_none() && self.kept.file.is_ok() && !last && Instant::now() >= self.retry_at {
            self.restore();
        }
        if !batch.is_empty() {
            self.put(batch);
        }
        if last && self.store.is_none() && self.kept.file.is_ok() {
            self.restore();
            if self.store.is_none() {
                tracing::warn!("what the history's file could not take is lost");
            }
        }
    }

    fn put(&mut self, batch: &Batch) {
        if let Some(store) = &mut self.store {
            match store.write(batch) {
                // What was written to a file that has just been deleted is written once more, to memory.
                Ok(()) => match store.lost() {
                    None => return,
                    Some(why) => self.leave(why),
                },
                Err(e) => self.fail(&e.to_string()),
            }
        }
        if lock(&self.shared.reading).memory.write(batch).is_err() {
            lock(&self.shared.report).lost += (batch.events.len() + batch.spans.len()) as u64;
        }
    }

    /// Switches to memory because the file is not where it was.
    fn leave(&mut self, why: String) {
        // Queries must not find another file there, and what is in the old one is with whoever has it now.
        lock(&self.shared.reading).use_file(None);
        if let Some(store) = self.store.take() {
            store.abandon();
        }
        self.degrade("moved", why);
    }

    /// Switches to memory because the file cannot be read or written.
    fn fail(&mut self, error: &str) {
        let Ok(file) = &self.kept.file else { return };
        self.degrade("failed", format!("{}: {error}", file.display()));
    }

    fn degrade(&mut self, kind: &'static str, reason: String) {
        if self.works_since.elapsed() >= HEALTHY {
            self.backoff.reset();
        }
        self.retry_at = Instant::now() + self.backoff.next_delay();
        self.store = None;
        lock(&self.shared.reading).in_memory = true;
        if self.said.may(kind) {
            tracing::warn!("{reason}: the history is kept in memory until a file can be written");
        }
        self.in_memory_because(reason);
    }

    fn in_memory_because(&self, reason: String) {
        let mut report = lock(&self.shared.report);
        (report.state, report.reason) = ("memory", Some(reason));
    }

    /// Uses this store from now on.
    fn stored(&mut self, store: Store) {
        let mut reading = lock(&self.shared.reading);
        reading.use_file(self.kept.file.as_deref().ok());
        reading.in_memory = false;
        let mut report = lock(&self.shared.report);
        (report.state, report.reason) = ("stored", None);
        report.bytes = store.bytes().unwrap_or(report.bytes);
        self.store = Some(store);
        let now = Instant::now();
        (self.works_since, self.keep_clock_at, self.touched) = (now, now, false);
    }

    /// Tries the file again, and moves what is in memory to it.
    fn restore(&mut self) {
        let Ok(file) = self.kept.file.clone() else { return };
        match self.reopened(&file) {
            Ok(store) => {
                self.stored(store);
                if let Ok(empty) = Store::in_memory() {
                    lock(&self.shared.reading).memory = empty;
                }
                if self.said.may("restored") {
                    tracing::info!("{}: the history is kept in this file again", file.display());
                }
            }
            Err(e) => {
                self.in_memory_because(e.to_string());
                self.retry_at = Instant::now() + self.backoff.next_delay();
            }
        }
    }

    /// The file with what memory holds.
    fn reopened(&mut self, file: &Path) -> Result<Store, StoreError> {
        let mut store = match Store::open(file) {
            Err(StoreError::Broken { .. }) => {
                // The file is about to be renamed, so queries must no longer read it. Otherwise the readers stay open,
                // because on a full disk none could be opened again.
                lock(&self.shared.reading).use_file(None);
                Store::open_or_replace(file)?.0
            }
            opened => opened?,
        };
        let next = lock(&self.shared.pending).batch.next;
        store.check_numbers(next, file)?;
        // Only this thread writes to memory, so nothing is added meanwhile.
        let kept = lock(&self.shared.reading).memory.everything(next).map_err(|e| failed(Path::new("memory"), e))?;
        store.write(&kept).map_err(|e| failed(file, e))?;
        Ok(store)
    }

    /// Deletes some of the rows that are too old or too many.
    fn prune(&mut self) {
        let limits = self.kept.limits;
        let now: Timestamp = self.believed.now(self.clocks.as_ref());
        let pruned = match &mut self.store {
            Some(store) => store.prune(limits, now).and_then(|gone| Ok((gone, store.bytes()?))),
            None => {
                let limits = Retention { bytes: limits.bytes.min(MEMORY_BYTES), ..limits };
                let pruned = lock(&self.shared.reading).memory.prune(limits, now);
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
            Err(e) => self.fail(&e.to_string()),
        }
    }
}

#[cfg(test)]
#[path = "writer_tests.rs"]
mod tests;
