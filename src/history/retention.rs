use jiff::{SignedDuration, Timestamp};
use rusqlite::Connection;

use super::blocks::{EVENTS, OCCUPANCY};
use super::store::{Store, nanoseconds};

/// How much is kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Retention {
    /// Anything older is deleted, as far as the clock can be believed.
    pub age: SignedDuration,
    /// Most bytes on disk; beyond them, the oldest rows are deleted.
    pub bytes: u64,
}

/// Most pages that the write-ahead log is allowed; it counts as part of the bytes.
pub(super) const LOG_PAGES: u64 = 200;
/// Most rows deleted at once, so that nothing waits for long.
const AT_ONCE: u64 = 2000;

impl Store {
    /// Deletes some of the rows beyond the limits and returns how many; 0 if everything is within the limits.
    pub(super) fn prune(&mut self, limits: Retention, now: Timestamp) -> rusqlite::Result<usize> {
        let size = Size::of(&self.connection)?;
        let transaction = self.connection.transaction()?;
        let gone = if size.used() > limits.bytes { oldest(&transaction)? } else { expired(&transaction, limits, now)? };
        transaction.commit()?;
        if gone > 0 {
            // The pragma frees one page for each row that is read from it.
            let mut vacuum = self.connection.prepare("PRAGMA incremental_vacuum")?;
            let mut rows = vacuum.query(())?;
            while rows.next()?.is_some() {}
        }
        Ok(gone)
    }

    /// Bytes of the tables and of the log at its longest.
    pub(super) fn bytes(&self) -> rusqlite::Result<u64> {
        Ok(Size::of(&self.connection)?.used())
    }
}

struct Size {
    page: u64,
    pages: u64,
    free: u64,
}

impl Size {
    fn of(connection: &Connection) -> rusqlite::Result<Self> {
        let get = |name: &str| connection.pragma_query_value(None, name, |row| row.get(0));
        Ok(Self { page: get("page_size")?, pages: get("page_count")?, free: get("freelist_count")? })
    }

    fn used(&self) -> u64 {
        self.page * (self.pages.saturating_sub(self.free) + LOG_PAGES)
    }
}

/// Deletes the oldest twentieth of each table, within limits.
fn oldest(connection: &Connection) -> rusqlite::Result<usize> {
    let mut gone = 0;
    for blocked in [EVENTS, OCCUPANCY] {
        let table = blocked.table;
        let count: u64 = connection.query_row(&format!("SELECT count(*) FROM {table}"), (), |row| row.get(0))?;
        gone += blocked.delete_first(connection, (count / 20).clamp(100, AT_ONCE))?;
    }
    Ok(gone)
}

fn expired(connection: &Connection, limits: Retention, now: Timestamp) -> rusqlite::Result<usize> {
    let before = now.checked_sub(limits.age).map_or(i64::MIN, nanoseconds);
    Ok(EVENTS.delete_before(connection, before)? + OCCUPANCY.delete_before(connection, before)?)
}

#[cfg(test)]
mod tests {
    use super::super::store::tests::event;
    use super::super::store::{Batch, beside};
    use super::super::{Numbers, Span};
    use super::*;

    const FOR_EVER: SignedDuration = SignedDuration::from_hours(24 * 365 * 200);

    fn fill(store: &mut Store, from: u64, count: u64) {
        let events = (from..from + count).map(event).collect();
        let at = |second: u64| Timestamp::from_second(second as i64).unwrap();
        let span = |id| Span { id, zone: None, people: 1, from: at(id), to: at(id + 1) };
        let spans = (from..from + count).map(span).collect();
        store.write(&Batch { events, spans, next: Numbers::default() }).unwrap();
    }

    fn kept(store: &Store, of: &str) -> (u64, u64, u64) {
        store.connection.query_row(of, (), |row| Ok((row.get(0)?, row.get(1)?, row.get(2)?))).unwrap()
    }

    const EVENTS: &str = "SELECT count(*), min(sequence), max(sequence) FROM events";
    const SPANS: &str = "SELECT count(*), min(id), max(id) FROM occupancy";

    #[test]
    fn what_is_too_old_goes() {
        let mut store = Store::in_memory().unwrap();
        fill(&mut store, 0, 9000);
        let limits = Retention { age: SignedDuration::from_secs(1000), bytes: u64::MAX };
        let now = Timestamp::from_second(9000).unwrap();
        while store.prune(limits, now).unwrap() > 0 {}
        assert_eq!((kept(&store, EVENTS), kept(&store, SPANS)), ((1000, 8000, 8999), (1000, 8000, 8999)));
    }

    #[test]
    fn files_stay_within_the_bytes_and_keep_the_newest() {
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("history.sqlite");
        let mut store = Store::open(&file).unwrap();
        let limits = Retention { age: FOR_EVER, bytes: 2_000_000 };
        let on_disk = || {
            let length = |more| std::fs::metadata(beside(&file, more)).map_or(0, |m| m.len());
            length("") + length("-wal")
        };
        for k in 0..150 {
            fill(&mut store, 300 * k, 300);
            while store.prune(limits, Timestamp::UNIX_EPOCH).unwrap() > 0 {}
            assert!(on_disk() <= limits.bytes, "{} after {k}", on_disk());
        }
        let (count, first, last) = kept(&store, EVENTS);
        assert_eq!((last, first), (44_999, 45_000 - count));
        assert!(
            store.bytes().unwrap() > 1_500_000 && count > 5000,
            "{count} events in {} bytes",
            store.bytes().unwrap()
        );
    }
}
