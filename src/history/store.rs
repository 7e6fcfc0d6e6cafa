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

/// Why a history cannot be kept in a file.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// Another process writes it.
    #[error("{}: another doorcam keeps its history there", .0.display())]
    Busy(PathBuf),
    /// Made by a newer version.
    #[error("{}: made by a newer doorcam", .0.display())]
    Newer(PathBuf),
    /// It cannot be made, read or written.
    #[error("{}: {source}", file.display())]
    Io {
        /// The file.
        file: PathBuf,
        /// Why not.
        source: io::Error,
    },
    /// The same, as SQLite says it.
    #[error("{}: {source}", file.display())]
    Sql {
        /// The file.
        file: PathBuf,
        /// Why not.
        source: rusqlite::Error,
    },
    /// It is not what SQLite wrote.
    #[error("{}: {reason}", file.display())]
    Broken {
        /// The file.
        file: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
}

/// How long a statement waits for another process that looks at the file with a tool of its own.
const PATIENCE: Duration = Duration::from_secs(1);
/// Numbers are reserved so many at a time.
const AHEAD: u64 = 1000;

/// The tables, in a file or in memory.
#[derive(Debug)]
pub(super) struct Store {
    pub(super) connection: Connection,
    /// What numbers the tables have as the next; none if not even that was written yet.
    reserved: Numbers,
    /// Holds off other processes for as long as it is open.
    _lock: Option<File>,
}

/// What is written at once.
#[derive(Debug, Clone, Default)]
pub(super) struct Batch {
    pub(super) events: Vec<Event>,
    pub(super) spans: Vec<Span>,
    /// The numbers that were not used yet.
    pub(super) next: Numbers,
}

/// Nanoseconds since 1970; those of the ends of the 64 bits for times beyond 1677 and 2262.
pub(super) fn nanoseconds(time: Timestamp) -> i64 {
    let beyond = if time.as_second() < 0 { i64::MIN } else { i64::MAX };
    i64::try_from(time.as_nanosecond()).unwrap_or(beyond)
}

/// A number as SQLite has it, which ends at 2⁶³ − 1.
pub(super) fn integer(number: u64) -> i64 {
    i64::try_from(number).unwrap_or(i64::MAX)
}

impl Batch {
    pub(super) fn is_empty(&self) -> bool {
        self.events.is_empty() && self.spans.is_empty()
    }
}

impl Store {
    /// Tables that are gone with the process.
    pub(super) fn in_memory() -> rusqlite::Result<Self> {
        let mut connection = Connection::open_in_memory()?;
        migrate(&mut connection, MIGRATIONS)?;
        Ok(Self { connection, reserved: Numbers::default(), _lock: None })
    }

    /// Opens a file or makes it, with its directory, and brings its tables up to date.
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
            // So that the file shrinks when old rows go. Said again, it would write into a file that may be broken.
            connection.pragma_update(None, "auto_vacuum", "INCREMENTAL").map_err(sql)?;
        }
        connection.pragma_update(None, "journal_mode", "WAL").map_err(sql)?;
        // In WAL mode a killed process loses nothing that was committed; after a power cut the newest commits may be missing.
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

    /// The same, but a file that is broken is put aside first, under a name that ends in `.broken-` and the time, and returned.
    pub(super) fn open_or_replace(file: &Path) -> Result<(Self, Option<PathBuf>), StoreError> {
        let reason = match Self::open(file) {
            Err(StoreError::Broken { reason, .. }) => reason,
            opened => return opened.map(|store| (store, None)),
        };
        let aside = beside(file, &format!(".broken-{}", Timestamp::now().strftime("%Y%m%dT%H%M%SZ")));
        tracing::warn!("{}: {reason}; it is put aside as {}", file.display(), aside.display());
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

    /// The numbers that were surely not used yet.
    pub(super) fn next(&self) -> Numbers {
        self.reserved
    }

    /// Writes all of it or nothing. What is there already stays; a span that goes on is made longer.
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

    /// All that is there, to be written elsewhere.
    pub(super) fn everything(&self, next: Numbers) -> rusqlite::Result<Batch> {
        let mut select =
            self.connection.prepare("SELECT sequence, kind, time_ns, track, x_m, y_m, zone FROM events")?;
        let events = select.query_map((), read_event)?.collect::<Result<_, _>>()?;
        let mut select = self.connection.prepare("SELECT id, zone, people, from_ns, to_ns FROM occupancy")?;
        let spans = select.query_map((), read_span)?.collect::<Result<_, _>>()?;
        Ok(Batch { events, spans, next })
    }

    /// Gives back the numbers that were reserved and not used, and puts everything into the one file.
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

/// What went wrong; whether the file itself is at fault.
pub(super) fn failed(file: &Path, source: rusqlite::Error) -> StoreError {
    match source.sqlite_error_code() {
        Some(ErrorCode::DatabaseCorrupt | ErrorCode::NotADatabase) => {
            StoreError::Broken { file: file.into(), reason: source.to_string() }
        }
        _ => StoreError::Sql { file: file.into(), source },
    }
}

/// The file of that name with more at its end.
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
        assert!(!beside(&file, "-wal").exists(), "all is in one file");
        let mut store = Store::open(&file).unwrap();
        assert_eq!((store.next(), count(&store, "events")), (next, 3));
        store.write(&batch).unwrap();
        assert_eq!(count(&store, "events"), 3, "what is there stays as it is");
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
        // Pages in the middle were overwritten.
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
