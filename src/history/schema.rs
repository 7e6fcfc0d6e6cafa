use rusqlite::{Connection, TransactionBehavior};

/// The steps that make the tables; the file's `user_version` counts the steps taken. A step that was released is never
/// changed; changes are made by a further step.
///
/// Times are nanoseconds since 1970, UTC. A null `zone` of `occupancy` is the whole room. `numbers` has numbers some
/// way ahead of those in use, so that a number that was published and then lost in a crash is not used again; its
/// `clock` is a time ([`super::clock`]).
///
/// Rows are asked for in the order of their numbers, and times mostly follow numbers but need not. So there is no index
/// of times, but the range of times of each block of 256 numbers: it says which numbers to look at, and an index of
/// what else is asked for (zone, kind, track) gives them in order. A query then reads little more than what it answers.
pub(super) const MIGRATIONS: &[&str] = &[
    "
    CREATE TABLE events (
        sequence INTEGER PRIMARY KEY,
        kind TEXT NOT NULL,
        time_ns INTEGER NOT NULL,
        track INTEGER NOT NULL,
        x_m REAL,
        y_m REAL,
        zone TEXT
    ) STRICT;
    CREATE INDEX events_time ON events (time_ns);
    CREATE TABLE occupancy (
        id INTEGER PRIMARY KEY,
        zone TEXT,
        people INTEGER NOT NULL,
        from_ns INTEGER NOT NULL,
        to_ns INTEGER NOT NULL
    ) STRICT;
    CREATE INDEX occupancy_from ON occupancy (from_ns);
    CREATE TABLE numbers (name TEXT PRIMARY KEY, next INTEGER NOT NULL) STRICT, WITHOUT ROWID;
",
    "
    DROP INDEX events_time;
    DROP INDEX occupancy_from;
    CREATE INDEX events_kind ON events (kind);
    CREATE INDEX events_track ON events (track);
    CREATE INDEX events_zone ON events (zone, kind) WHERE zone IS NOT NULL;
    CREATE INDEX occupancy_zone ON occupancy (zone);
    CREATE TABLE events_blocks (
        block INTEGER PRIMARY KEY,
        first_ns INTEGER NOT NULL,
        last_ns INTEGER NOT NULL
    ) STRICT;
    CREATE INDEX events_blocks_first ON events_blocks (first_ns);
    INSERT INTO events_blocks
        SELECT sequence >> 8, min(time_ns), max(time_ns) FROM events GROUP BY sequence >> 8;
    CREATE TABLE occupancy_blocks (
        block INTEGER PRIMARY KEY,
        first_ns INTEGER NOT NULL,
        last_ns INTEGER NOT NULL
    ) STRICT;
    CREATE INDEX occupancy_blocks_first ON occupancy_blocks (first_ns);
    INSERT INTO occupancy_blocks
        SELECT id >> 8, min(from_ns), max(to_ns) FROM occupancy GROUP BY id >> 8;
",
    "
    ALTER TABLE events ADD COLUMN through TEXT;
    ALTER TABLE events ADD COLUMN reason TEXT;
    ALTER TABLE events ADD COLUMN speed_m_s REAL;
",
];

/// Takes the missing steps, all or none. Returns false for the tables of a newer doorcam, which it leaves alone.
pub(super) fn migrate(connection: &mut Connection, steps: &[&str]) -> rusqlite::Result<bool> {
    let transaction = connection.transaction_with_behavior(TransactionBehavior::Immediate)?;
    let taken: usize = transaction.pragma_query_value(None, "user_version", |row| row.get(0))?;
    if taken > steps.len() {
        return Ok(false);
    }
    if taken < steps.len() {
        for step in &steps[taken..] {
            transaction.execute_batch(step)?;
        }
        transaction.pragma_update(None, "user_version", steps.len())?;
    }
    transaction.commit()?;
    Ok(true)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn version(connection: &Connection) -> usize {
        connection.pragma_query_value(None, "user_version", |row| row.get(0)).unwrap()
    }

    #[test]
    fn steps_are_taken_once_and_keep_what_is_there() {
        let mut connection = Connection::open_in_memory().unwrap();
        assert!(migrate(&mut connection, MIGRATIONS).unwrap());
        let insert = "INSERT INTO events VALUES (5, 'enter', 1, 2, 0.5, 1.5, NULL, NULL, NULL, NULL)";
        connection.execute(insert, ()).unwrap();
        assert!(migrate(&mut connection, MIGRATIONS).unwrap());
        let longer = [MIGRATIONS, &["ALTER TABLE events ADD COLUMN note TEXT NOT NULL DEFAULT 'none'"]].concat();
        assert!(migrate(&mut connection, &longer).unwrap());
        let row = connection.query_row("SELECT sequence, note FROM events", (), |row| Ok((row.get(0)?, row.get(1)?)));
        assert_eq!(row, Ok((5, String::from("none"))));
        assert_eq!(version(&connection), MIGRATIONS.len() + 1);
        assert!(!migrate(&mut connection, MIGRATIONS).unwrap(), "the tables are a newer version's");
    }

    #[test]
    fn a_file_of_the_first_version_keeps_its_rows_and_gets_the_blocks_of_their_times() {
        let mut connection = Connection::open_in_memory().unwrap();
        assert!(migrate(&mut connection, &MIGRATIONS[..1]).unwrap());
        let insert = "WITH RECURSIVE n (k) AS (SELECT 0 UNION ALL SELECT k + 1 FROM n WHERE k < 599)
            INSERT INTO events SELECT k, 'enter', 1000 * k, k, 0.5, 1.5, 'bed' FROM n";
        connection.execute(insert, ()).unwrap();
        connection.execute("INSERT INTO occupancy VALUES (7, NULL, 1, 50, 90), (8, NULL, 0, 90, 95)", ()).unwrap();
        assert!(migrate(&mut connection, MIGRATIONS).unwrap());
        let blocks = |of: &str| -> Vec<(i64, i64, i64)> {
            let mut select = connection.prepare(&format!("SELECT * FROM {of}_blocks ORDER BY block")).unwrap();
            let rows = select.query_map((), |row| Ok((row.get(0)?, row.get(1)?, row.get(2)?))).unwrap();
            rows.collect::<Result<_, _>>().unwrap()
        };
        assert_eq!(blocks("events"), [(0, 0, 255_000), (1, 256_000, 511_000), (2, 512_000, 599_000)]);
        assert_eq!(blocks("occupancy"), [(0, 50, 95)]);
        let events: u64 = connection.query_row("SELECT count(*) FROM events", (), |row| row.get(0)).unwrap();
        assert_eq!((events, version(&connection)), (600, MIGRATIONS.len()));
    }

    #[test]
    fn a_file_of_any_version_before_keeps_its_events_which_say_nothing_of_doors() {
        for steps in 1..MIGRATIONS.len() {
            let mut connection = Connection::open_in_memory().unwrap();
            assert!(migrate(&mut connection, &MIGRATIONS[..steps]).unwrap());
            connection.execute("INSERT INTO events VALUES (5, 'exit', 1, 2, 0.5, 1.5, 'bed')", ()).unwrap();
            assert!(migrate(&mut connection, MIGRATIONS).unwrap());
            let sql = "SELECT sequence, zone, through, reason, speed_m_s FROM events";
            let row = connection.query_row(sql, (), |row| {
                Ok((row.get::<_, u64>(0)?, row.get::<_, String>(1)?, row.get(2)?, row.get(3)?, row.get(4)?))
            });
            let nothing: (Option<String>, Option<String>, Option<f64>) = (None, None, None);
            assert_eq!(row, Ok((5, "bed".into(), nothing.0, nothing.1, nothing.2)), "from version {steps}");
            assert_eq!(version(&connection), 3);
        }
    }

    #[test]
    fn of_steps_that_fail_none_is_taken() {
        let mut connection = Connection::open_in_memory().unwrap();
        let broken =
            [MIGRATIONS, &["CREATE TABLE more (id INTEGER) STRICT; CREATE TABLE events (id INTEGER) STRICT"]].concat();
        assert!(migrate(&mut connection, &broken).is_err());
        assert_eq!(version(&connection), 0);
        let tables: usize = connection.query_row("SELECT count(*) FROM sqlite_schema", (), |row| row.get(0)).unwrap();
        assert_eq!(tables, 0);
    }
}
