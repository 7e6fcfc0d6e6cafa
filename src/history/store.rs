use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};
use std::time::Duration;

use jiff::Timestamp;
use rusqlite::config::DbConfig;
use rusqlite::{Connection, ErrorCode, OpenFlags, OptionalExtension, TransactionBehavior, params};

use super::blocks::{EVENTS, OCCUPANCY};
use super::bounds::LONGEST;
use super::place::{Look, Place};
use super::query::{EVENT_COLUMNS, read_event, read_span};
use super::retention::LOG_PAGES;
use super::schema::{MIGRATIONS, migrate};
use super::{Numbers, Span};
use doorcam_core::tracking::{Event, ExitReason, Through};

/// Why the history's file cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// Another process keeps its history there.
    #[error("{}: another doorcam keeps its history there", .0.display())]
    Busy(PathBuf),
    /// The file has numbers that this run may give to something else.
    #[error("{}: has events of another run, with numbers that are not used up here; a restart continues there", .0.display())]
    Foreign(PathBuf),
    /// A query was ended before it had its answer.
    #[error("the answer takes longer than {} s, expected a shorter time or fewer rows", LONGEST.as_secs())]
    TooLong,
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
/// Most prepared statements that a reader keeps: one for each combination of filters and direction.
const STATEMENTS: usize = 32;
/// How far ahead numbers are reserved.
const AHEAD: u64 = 1000;

/// The tables, in a file or in memory.
#[derive(Debug)]
pub(super) struct Store {
    pub(super) connection: Connection,
    /// The next numbers as the tables have them; zeros if none have been written yet.
    reserved: Numbers,
    /// The file, what SQLite keeps beside it, and the lock: all have to stay where they are.
    places: Vec<Place>,
    /// What the file looked like after this program had last written to it.
    written: Option<Look>,
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
        Ok(Self { connection, reserved: Numbers::default(), places: Vec::new(), written: None, _lock: None })
    }

    /// Opens the file, or creates it and its directory, and brings its tables up to date.
    pub(super) fn open(file: &Path) -> Result<Self, StoreError> {
        let io = |source| StoreError::Io { file: file.into(), source };
        if let Some(directory) = file.parent().filter(|directory| !directory.as_os_str().is_empty()) {
            fs::create_dir_all(directory).map_err(io)?;
        }
        if file.metadata().is_ok_and(|found| !found.is_file()) {
            return Err(io(io::Error::other("not a regular file")));
        }
        // Read as well, so that opening a pipe of that name would not wait for a reader.
        let lock = File::options().create(true).read(true).append(true).open(beside(file, "-lock")).map_err(io)?;
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
        let places = ["", "-wal", "-shm", "-lock"].map(|part| Place::of(beside(file, part)));
        let places = places.into_iter().collect::<Result<_, _>>().map_err(io)?;
        let mut store = Self { connection, reserved, places, written: None, _lock: Some(lock) };
        store.remember();
        Ok(store)
    }

    /// What happened to the file, or to what is beside it, if it is not where it was opened any more: what is written
    /// to it from then on may be gone with it.
    pub(super) fn lost(&self) -> Option<String> {
        self.places.iter().find_map(|place| Some(format!("{}: {}", place.path().display(), place.lost()?)))
    }

    /// Remembers what the file looks like now, because this program has written to it.
    pub(super) fn remember(&mut self) {
        self.written = self.places.first().and_then(Place::look);
    }

    /// Whether somebody else has written to the file since: another program that may, or one that knows nothing of
    /// SQLite.
    pub(super) fn was_touched(&self) -> bool {
        self.written.is_some() && self.places.first().and_then(Place::look) != self.written
    }

    /// What is wrong with the file, as somebody sees it who opens it now: this connection remembers what was there.
    pub(super) fn damage(&self) -> Option<String> {
        let file = self.places.first()?.path();
        let check = |reader: Connection| reader.query_row("PRAGMA quick_check(1)", (), |row| row.get::<_, String>(0));
        match open_reader(file).and_then(check) {
            Ok(found) if found == "ok" => None,
            Ok(found) => Some(found.split_whitespace().collect::<Vec<_>>().join(" ")),
            Err(e) => match failed(file, e) {
                StoreError::Broken { reason, .. } => Some(reason),
                // It may be well: there was no memory, or no file could be opened.
                _ => None,
            },
        }
    }

    /// Closes a file that is not in its place any more. Everything written is in it then, wherever it is; of what is at
    /// its path, nothing is touched that is not its own.
    pub(super) fn abandon(self) {
        // If this fails, because the disk is full or a query still reads, the newest rows stay in the log.
        let _ = self.connection.query_row("PRAGMA wal_checkpoint(TRUNCATE)", (), |_| Ok(()));
        // Closing deletes the log by its name, which may be that of another file's log by now.
        let log_is_there = self.places.get(1).is_some_and(|log| log.lost().is_none());
        let keep = self.connection.set_db_config(DbConfig::SQLITE_DBCONFIG_NO_CKPT_ON_CLOSE, !log_is_there);
        if let Err(e) = keep.and_then(|_| self.connection.close().map_err(|(_, e)| e)) {
            tracing::debug!("the old history was not closed properly: {e}");
        }
    }

    /// The largest numbers of the rows.
    fn newest(&self) -> rusqlite::Result<[Option<u64>; 2]> {
        let newest = |sql| self.connection.query_row(sql, (), |row| row.get(0));
        Ok([newest("SELECT max(sequence) FROM events")?, newest("SELECT max(id) FROM occupancy")?])
    }

    /// Checks that no row has a number that is still to be used.
    pub(super) fn check_numbers(&self, next: Numbers, file: &Path) -> Result<(), StoreError> {
        let [event, span] = self.newest().map_err(|e| failed(file, e))?;
        if event >= Some(next.event) || span >= Some(next.span) {
            return Err(StoreError::Foreign(file.into()));
        }
        Ok(())
    }

    /// The time that was believed when the file was last written; that of the newest row in a file that does not say,
    /// `None` in an empty one.
    pub(super) fn clock(&self) -> rusqlite::Result<Option<Timestamp>> {
        let get = |sql| self.connection.query_row(sql, (), |row| row.get::<_, i64>(0)).optional();
        let time = match get("SELECT next FROM numbers WHERE name = 'clock'")? {
            None => get("SELECT time_ns FROM events ORDER BY sequence DESC LIMIT 1")?
                .max(get("SELECT to_ns FROM occupancy ORDER BY id DESC LIMIT 1")?),
            kept => kept,
        };
        Ok(time.and_then(|time| Timestamp::from_nanosecond(time.into()).ok()))
    }

    /// Keeps the time that is believed now.
    pub(super) fn keep_clock(&self, time: Timestamp) -> rusqlite::Result<()> {
        let mut put =
            self.connection.prepare_cached("INSERT OR REPLACE INTO numbers (name, next) VALUES ('clock', ?1)")?;
        put.execute([nanoseconds(time).max(0)])?;
        Ok(())
    }

    /// Like [`Store::open`], but first renames a broken file, appending `.broken-` and the time; returns the new name.
    pub(super) fn open_or_replace(file: &Path) -> Result<(Self, Option<PathBuf>), StoreError> {
        let reason = match Self::open(file) {
            Err(StoreError::Broken { reason, .. }) => reason,
            opened => return opened.map(|store| (store, None)),
        };
        let aside = free_name(&beside(file, &format!(".broken-{}", Timestamp::now().strftime("%Y%m%dT%H%M%SZ"))));
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
                "INSERT INTO events (sequence, kind, time_ns, track, x_m, y_m, zone, through, reason, speed_m_s)
                 VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10)
                 ON CONFLICT DO NOTHING",
            )?;
            for Event { sequence, kind, time, track, x_m, y_m, zone, through, reason, speed_m_s } in events {
                let (sequence, track) = (integer(*sequence), integer(*track));
                let time = nanoseconds(*time);
                let (through, reason) = (through.map(Through::name), reason.map(ExitReason::name));
                let kind = kind.name();
                insert.execute(params![sequence, kind, time, track, x_m, y_m, zone, through, reason, speed_m_s])?;
                EVENTS.note(&transaction, sequence, [time, time])?;
            }
            let mut insert = transaction.prepare_cached(
                "INSERT INTO occupancy (id, zone, people, from_ns, to_ns) VALUES (?1, ?2, ?3, ?4, ?5)
                 ON CONFLICT DO UPDATE SET to_ns = max(to_ns, excluded.to_ns)",
            )?;
            for Span { id, zone, people, from, to } in spans {
                let (id, from, to) = (integer(*id), nanoseconds(*from), nanoseconds(*to));
                insert.execute(params![id, zone, people, from, to])?;
                OCCUPANCY.note(&transaction, id, [from, to])?;
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
        let mut select = self.connection.prepare(&format!("SELECT {EVENT_COLUMNS} FROM events"))?;
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
    connection.set_prepared_statement_cache_capacity(STATEMENTS);
    Ok(connection)
}

/// An error of SQLite; `Broken` if the file itself is at fault.
pub(super) fn failed(file: &Path, source: rusqlite::Error) -> StoreError {
    match source.sqlite_error_code() {
        Some(ErrorCode::DatabaseCorrupt | ErrorCode::NotADatabase) => {
            StoreError::Broken { file: file.into(), reason: source.to_string() }
        }
        Some(ErrorCode::OperationInterrupted) => StoreError::TooLong,
        _ => StoreError::Sql { file: file.into(), source },
    }
}

/// The path, or the first of those with a number behind it that does not exist yet.
fn free_name(path: &Path) -> PathBuf {
    let numbered = (2..1000).map(|number| beside(path, &format!("-{number}")));
    std::iter::once(path.to_owned()).chain(numbered).find(|name| !name.exists()).unwrap_or_else(|| path.to_owned())
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
        let (name, next): (String, i64) = (row.get(0)?, row.get(1)?);
        let next = u64::try_from(next).unwrap_or(0);
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
#[path = "store_tests.rs"]
pub(super) mod tests;
