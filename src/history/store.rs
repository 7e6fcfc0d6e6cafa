use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};
use std::time::Duration;

use jiff::Timestamp;
use rusqlite::{Connection, ErrorCode, OpenFlags, TransactionBehavior, params};

use super::query::{read_event, read_span};
use super::retention::LOG_PAGES;
use super::schema::{MIGRATIONS, migrate};
use super::{Numbers, Span};
use doorcam_core::tracking::Event;

/// Why the history's file cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// Another process keeps its history there.
    #[error("{}: another doorcam keeps its history there", .0.display())]
    Busy(PathBuf),
    /// The file was made by a newer version.
    #[error("{}: made by a newer doorcam", .0.display())]
    Newer(PathBuf),
    /// The file cannot be created, read or written.
    #[error("{}: {source}", file.display())]
    Io {
        /// The file.
        file: PathBuf,
        /// Why not.
        source: io::Error,
    },
    /// SQLite failed.
    #[error("{}: {source}", file.display())]
    Sql {
        /// The file.
        file: PathBuf,
        /// Why not.
        source: rusqlite::Error,
    },
    /// The file is damaged, or is no SQLite database.
    #[error("{}: {reason}", file.display())]
    Broken {
        /// The file.
        file: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
}

/// How long a statement waits for another process that has the file in use.
const PATIENCE: Duration = Duration::from_secs(1);
/// How far ahead numbers are reserved.
const AHEAD: u64 = 1000;

/// The tables, in a file or in memory.
#[derive(Debug)]
pub(super) struct Store {
    pub(super) connection: Connection,
    /// The next numbers as the tables have them; zeros if none have been written yet.
    reserved: Numbers,
    /// Keeps other doorcams away from the file.
    _lock: Option<File>,
}

/// What is written in one transaction.
#[derive(Debug, Clone, Default)]
pub(super) struct Batch {
    pub(super) events: Vec<Event>,
    pub(super) spans: Vec<Span>,
    /// The first numbers not used yet.
    pub(super) next: Numbers,
}

/// Nanoseconds since 1970, saturated to 64 bits: they reach from 1677 to 2262.
pub(super) fn nanoseconds(time: Timestamp) -> i64 {
    let beyond = if time.as_second() < 0 { i64::MIN } else { i64::MAX };
    i64::try_from(time.as_nanosecond()).unwrap_or(beyond)
}

/// A number as an integer of SQLite, saturated at 2⁶³ − 1.
pub(super) fn integer(number: u64) -> i64 {
    i64::try_from(number).unwrap_or(i64::MAX)
}

impl Batch {
    pub(super) fn is_empty(&self) -> bool {
        self.events.is_empty() && self.spans.is_empty()
    }
}

impl Store {
    /// Tables in memory, which are lost when the process ends.
    pub(super) fn in_memory() -> rusqlite::Result<Self> {
        let mut connection = Connection::open_in_memory()?;
        migrate(&mut connection, MIGRATIONS)?;
        Ok(Self { connection, reserved: Numbers::default(), _lock: None })
    }

    /// Opens the file, or creates it and its directory, and brings its tables up to date.
    pub(super) fn open(file: &Path) -> Result<Self, StoreError> {
        let io = |source| StoreError::Io { file: file.into(), source };
        if let Some(directory) = file.parent().filter(|directory| !directory.as_os_str().is_empty()) {
            fs::create_dir_all(directory).map_err(io)?;
        }
        let lock = File::options().create(true).append(true).open(beside(file, "-lock")).map_err(io)?;
        match rustix::fs::flock(&lock, rustix::fs::FlockOperation::NonBlockingLockExclusive) {
            Err(rustix::io::Errno::WOULDBLOCK) => return Err(StoreError::Busy(file.into())),
            result => result.map_err(|e| io(e.into()))?,
        }
        let sql = |source| failed(file, source);
        let mut connection = Connection::open(file).map_err(sql)?;
        connection.busy_timeout(PATIENCE).map_err(sql)?;
        let pages: u64 = connection.pragma_query_value(None, "page_count", |row| row.get(0)).map_err(sql)?;
        if pages == 0 {
            // Lets the file shrink when rows are deleted. Only for a new file, because it would write to a broken one.
            connection.pragma_update(None, "auto_vacuum", "INCREMENTAL").map_err(sql)?;
        }
        connection.pragma_update(None, "journal_mode", "WAL").map_err(sql)?;
        // In WAL mode a killed process loses no commits; after a power cut the newest ones may be missing.
        connection.pragma_update(None, "synchronous", "NORMAL").map_err(sql)?;
        connection.pragma_update(None, "wal_autocheckpoint", LOG_PAGES / 2).map_err(sql)?;
        connection.pragma_update(None, "journal_size_limit", 4096 * LOG_PAGES / 2).map_err(sql)?;
        let found: String = connection.pragma_query_value(None, "quick_check", |row| row.get(0)).map_err(sql)?;
        if found != "ok" {
            let reason = found.split_whitespace().collect::<Vec<_>>().join(" ");
            return Err(StoreError::Broken { file: file.into(), reason });
        }
        if !migrate(&mut connection, MIGRATIONS).map_err(sql)? {
            return Err(StoreError::Newer(file.into()));
        }
        let reserved = numbers(&connection).map_err(sql)?;
        Ok(Self { connection, reserved, _lock: Some(lock) })
    }

    /// Like [`Store::open`], but first renames a broken file, appending `.broken-` and the time; returns the new name.
    pub(super) fn open_or_replace(file: &Path) -> Result<(Self, Option<PathBuf>), StoreError> {
        let reason = match Self::open(file) {
            Err(StoreError::Broken { reason, .. }) => reason,
            opened => return opened.map(|store| (store, None)),
        };
        let aside = beside(file, &format!(".broken-{}", Timestamp::now().strftime("%Y%m%dT%H%M%SZ")));
        tracing::warn!("{}: {reason}; renaming it to {}", file.display(), aside.display());
        let io = |source| StoreError::Io { file: file.into(), source };
        fs::rename(file, &aside).map_err(io)?;
        for part in ["-wal", "-shm"] {
            match fs::rename(beside(file, part), beside(&aside, part)) {
                Err(e) if e.kind() != io::ErrorKind::NotFound => return Err(io(e)),
                _ => {}
            }
        }
        Ok((Self::open(file)?, Some(aside)))
    }

    /// The first numbers that certainly were not used yet.
    pub(super) fn next(&self) -> Numbers {
        self.reserved
    }

    /// Writes the whole batch or nothing. Events that exist stay as they are; spans that exist are extended.
    pub(super) fn write(&mut self, batch: &Batch) -> rusqlite::Result<()> {
        let Batch { events, spans, next } = batch;
        let mut reserved = self.reserved;
        for (reserved, next) in
            [(&mut reserved.event, next.event), (&mut reserved.track, next.track), (&mut reserved.span, next.span)]
        {
            if *reserved < next.saturating_add(AHEAD / 2) {
                *reserved = next.saturating_add(AHEAD);
            }
        }
        let transaction = self.connection.transaction_with_behavior(TransactionBehavior::Immediate)?;
        {
            let mut insert = transaction.prepare_cached(
                "INSERT INTO events (sequence, kind, time_ns, track, x_m, y_m, zone) VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7)
                 ON CONFLICT DO NOTHING",
            )?;
            for Event { sequence, kind, time, track, x_m, y_m, zone } in events {
                let (sequence, track) = (integer(*sequence), integer(*track));
                insert.execute(params![sequence, kind.name(), nanoseconds(*time), track, x_m, y_m, zone])?;
            }
            let mut insert = transaction.prepare_cached(
                "INSERT INTO occupancy (id, zone, people, from_ns, to_ns) VALUES (?1, ?2, ?3, ?4, ?5)
                 ON CONFLICT DO UPDATE SET to_ns = max(to_ns, excluded.to_ns)",
            )?;
            for Span { id, zone, people, from, to } in spans {
                insert.execute(params![integer(*id), zone, people, nanoseconds(*from), nanoseconds(*to)])?;
            }
            if reserved != self.reserved {
                reserve(&transaction, reserved)?;
            }
        }
        transaction.commit()?;
        self.reserved = reserved;
        Ok(())
    }

    /// All rows, to be written elsewhere.
    pub(super) fn everything(&self, next: Numbers) -> rusqlite::Result<Batch> {
        let mut select =
            self.connection.prepare("SELECT sequence, kind, time_ns, track, x_m, y_m, zone FROM events")?;
        let events = select.query_map((), read_event)?.collect::<Result<_, _>>()?;
        let mut select = self.connection.prepare("SELECT id, zone, people, from_ns, to_ns FROM occupancy")?;
        let spans = select.query_map((), read_span)?.collect::<Result<_, _>>()?;
        Ok(Batch { events, spans, next })
    }

    /// Releases the reserved numbers that were not used, and closes the file, which moves the log into it.
    pub(super) fn close(self, next: Numbers) -> rusqlite::Result<()> {
        reserve(&self.connection, next)?;
        self.connection.close().map_err(|(_, e)| e)
    }
}

/// A connection that only reads.
pub(super) fn open_reader(file: &Path) -> rusqlite::Result<Connection> {
    let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_NO_MUTEX;
    let connection = Connection::open_with_flags(file, flags)?;
    connection.busy_timeout(PATIENCE)?;
    Ok(connection)
}

/// An error of SQLite; `Broken` if the file itself is at fault.
pub(super) fn failed(file: &Path, source: rusqlite::Error) -> StoreError {
    match source.sqlite_error_code() {
        Some(ErrorCode::DatabaseCorrupt | ErrorCode::NotADatabase) => {
            StoreError::Broken { file: file.into(), reason: source.to_string() }
        }
        _ => StoreError::Sql { file: file.into(), source },
    }
}

/// The file's path with `more` appended to its name.
pub(super) fn beside(file: &Path, more: &str) -> PathBuf {
    let mut name = file.as_os_str().to_owned();
    name.push(more);
    name.into()
}

fn reserve(connection: &Connection, Numbers { event, track, span }: Numbers) -> rusqlite::Result<()> {
    let mut put = connection.prepare_cached("INSERT OR REPLACE INTO numbers (name, next) VALUES (?1, ?2)")?;
    for (name, next) in [("event", event), ("track", track), ("span", span)] {
        put.execute(params![name, integer(next)])?;
    }
    Ok(())
}

fn numbers(connection: &Connection) -> rusqlite::Result<Numbers> {
    let mut numbers = Numbers::default();
    let mut get = connection.prepare("SELECT name, next FROM numbers")?;
    let mut rows = get.query(())?;
    while let Some(row) = rows.next()? {
        let (name, next): (String, u64) = (row.get(0)?, row.get(1)?);
        match name.as_str() {
            "event" => numbers.event = next,
            "track" => numbers.track = next,
            "span" => numbers.span = next,
            _ => {}
        }
    }
    Ok(numbers)
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use doorcam_core::tracking::EventKind;

    pub(in super::super) fn event(sequence: u64) -> Event {
        let time = Timestamp::from_millisecond(1000 * sequence as i64).unwrap();
        let zone = sequence.is_multiple_of(3).then(|| String::from("bed"));
        let kind = if sequence.is_multiple_of(2) { EventKind::Enter } else { EventKind::Exit };
        Event { sequence, kind, time, track: sequence / 2, x_m: 0.5, y_m: 1.25, zone }
    }

    fn count(store: &Store, table: &str) -> usize {
        store.connection.query_row(&format!("SELECT count(*) FROM {table}"), (), |row| row.get(0)).unwrap()
    }

    #[test]
    fn numbers_go_on_after_an_end_and_leap_after_a_crash() {
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("deep/history.sqlite");
        let next = Numbers { event: 3, track: 2, span: 9 };
        let batch = Batch { events: (0..3).map(event).collect(), spans: Vec::new(), next };
        let mut store = Store::open(&file).unwrap();
        assert_eq!(store.next(), Numbers::default());
        store.write(&batch).unwrap();
        store.close(next).unwrap();
        assert!(!beside(&file, "-wal").exists(), "everything is in one file");
        let mut store = Store::open(&file).unwrap();
        assert_eq!((store.next(), count(&store, "events")), (next, 3));
        store.write(&batch).unwrap();
        assert_eq!(count(&store, "events"), 3, "events that exist stay as they are");
        drop(store);
        let store = Store::open(&file).unwrap();
        assert_eq!(store.next(), Numbers { event: 1003, track: 1002, span: 1009 });
    }

    #[test]
    fn two_do_not_keep_the_same_file() {
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("history.sqlite");
        let first = Store::open(&file).unwrap();
        let second = Store::open(&file).unwrap_err().to_string();
        assert_eq!(second, format!("{}: another doorcam keeps its history there", file.display()));
        drop(first);
        Store::open(&file).unwrap();
    }

    #[test]
    fn a_broken_file_is_put_aside_and_a_newer_one_left_alone() {
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("history.sqlite");
        let next = Numbers::default();
        let mut store = Store::open(&file).unwrap();
        store.write(&Batch { events: (0..500).map(event).collect(), spans: Vec::new(), next }).unwrap();
        store.close(next).unwrap();
        // Overwrite pages in the middle.
        let mut bytes = fs::read(&file).unwrap();
        bytes[8192..16384].fill(0x5a);
        for bad in [
            bytes.as_slice(),
            b"not a database, whatever its name says, but long enough to be looked at as one".as_slice(),
        ] {
            fs::write(&file, bad).unwrap();
            assert!(matches!(Store::open(&file), Err(StoreError::Broken { .. })));
            let (mut store, aside) = Store::open_or_replace(&file).unwrap();
            let kept = fs::read(aside.unwrap()).unwrap();
            let differs = kept.iter().zip(bad).position(|(kept, bad)| kept != bad);
            assert_eq!((kept.len(), differs), (bad.len(), None));
            store.write(&Batch { events: vec![event(1)], spans: Vec::new(), next }).unwrap();
            assert_eq!(count(&store, "events"), 1);
        }
        let store = Store::open(&file).unwrap();
        store.connection.pragma_update(None, "user_version", 99).unwrap();
        drop(store);
        let error = Store::open_or_replace(&file).unwrap_err().to_string();
        assert_eq!(error, format!("{}: made by a newer doorcam", file.display()));
    }
}
