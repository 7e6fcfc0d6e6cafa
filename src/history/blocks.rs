//! The range of times of each block of 256 rows: how a time is found among rows that are ordered by number.
//!
//! Times mostly grow with the numbers, but need not: an exit is known late, and a clock may be put back.

use std::ops::Range;

use rusqlite::{Connection, params};

/// A block's number is a row's number without its last bits.
const BITS: u32 = 8;
/// Most blocks from which old rows are deleted at once, so that nothing waits for long.
const AT_ONCE: usize = 8;

/// A table with blocks: its name, its number, and the columns with a row's first and last time.
pub(super) struct Blocked {
    pub(super) table: &'static str,
    pub(super) number: &'static str,
    first: &'static str,
    last: &'static str,
}

pub(super) const EVENTS: Blocked = Blocked { table: "events", number: "sequence", first: "time_ns", last: "time_ns" };
pub(super) const OCCUPANCY: Blocked = Blocked { table: "occupancy", number: "id", first: "from_ns", last: "to_ns" };

impl Blocked {
    /// Widens the block of a row that was written.
    pub(super) fn note(&self, connection: &Connection, number: i64, times: [i64; 2]) -> rusqlite::Result<()> {
        let Self { table, .. } = self;
        let mut put = connection.prepare_cached(&format!(
            "INSERT INTO {table}_blocks (block, first_ns, last_ns) VALUES (?1, ?2, ?3)
             ON CONFLICT (block) DO UPDATE
                SET first_ns = min(first_ns, excluded.first_ns), last_ns = max(last_ns, excluded.last_ns)
                WHERE excluded.first_ns < first_ns OR excluded.last_ns > last_ns"
        ))?;
        put.execute(params![number >> BITS, times[0], times[1]])?;
        Ok(())
    }

    /// The numbers outside of which no row touches the times from `from` to before `to`. A few rows within may not
    /// either.
    pub(super) fn between(&self, connection: &Connection, from: i64, to: i64) -> rusqlite::Result<Range<i64>> {
        if from == i64::MIN && to == i64::MAX {
            return Ok(0..i64::MAX);
        }
        // This reads one small row for 256 of the table, from one end on until the first that fits.
        let find = |order: &str| {
            let Self { table, .. } = self;
            let sql = format!(
                "SELECT block FROM {table}_blocks WHERE last_ns >= ?1 AND +first_ns < ?2 ORDER BY block {order} LIMIT 1"
            );
            let mut select = connection.prepare_cached(&sql)?;
            let mut rows = select.query([from, to])?;
            rows.next()?.map(|row| row.get::<_, i64>(0)).transpose()
        };
        match (find("ASC")?, find("DESC")?) {
            (Some(first), Some(last)) => Ok(first << BITS..last.saturating_add(1).saturating_mul(1 << BITS)),
            _ => Ok(0..0),
        }
    }

    /// Deletes some of the rows that begin before a time; returns how many.
    pub(super) fn delete_before(&self, connection: &Connection, before: i64) -> rusqlite::Result<usize> {
        let Self { table, number, first, last } = self;
        let blocks: Vec<i64> = connection
            .prepare_cached(&format!(
                "SELECT block FROM {table}_blocks WHERE first_ns < ?1 ORDER BY first_ns LIMIT ?2"
            ))?
            .query_map(params![before, AT_ONCE], |row| row.get(0))?
            .collect::<Result<_, _>>()?;
        let mut gone = 0;
        for block in blocks {
            let rows = [block << BITS, (block << BITS) + (1 << BITS)];
            let sql = format!("DELETE FROM {table} WHERE {number} >= ?1 AND {number} < ?2 AND {first} < ?3");
            gone += connection.prepare_cached(&sql)?.execute(params![rows[0], rows[1], before])?;
            let sql = format!("SELECT min({first}), max({last}) FROM {table} WHERE {number} >= ?1 AND {number} < ?2");
            let left: (Option<i64>, Option<i64>) =
                connection.prepare_cached(&sql)?.query_row(rows, |row| Ok((row.get(0)?, row.get(1)?)))?;
            if let (Some(first), Some(last)) = left {
                let sql = format!("UPDATE {table}_blocks SET first_ns = ?2, last_ns = ?3 WHERE block = ?1");
                connection.prepare_cached(&sql)?.execute([block, first, last])?;
            } else {
                let sql = format!("DELETE FROM {table}_blocks WHERE block = ?1");
                connection.prepare_cached(&sql)?.execute([block])?;
            }
        }
        Ok(gone)
    }

    /// Deletes so many rows with the smallest numbers; returns how many.
    pub(super) fn delete_first(&self, connection: &Connection, rows: u64) -> rusqlite::Result<usize> {
        let Self { table, number, .. } = self;
        let gone = connection.execute(
            &format!("DELETE FROM {table} WHERE {number} IN (SELECT {number} FROM {table} ORDER BY {number} LIMIT ?1)"),
            [rows],
        )?;
        connection.execute(
            &format!(
                "DELETE FROM {table}_blocks
                 WHERE block < coalesce((SELECT min({number}) >> {BITS} FROM {table}), {})",
                i64::MAX
            ),
            (),
        )?;
        Ok(gone)
    }
}

#[cfg(test)]
mod tests {
    use super::super::store::Store;
    use super::*;

    /// Event k happens at ten times k, but for those of a clock that was wrong for a while.
    fn store(wrong: Range<i64>, by: i64) -> Store {
        let store = Store::in_memory().unwrap();
        for k in 0..2000 {
            let time = 10 * k + if wrong.contains(&k) { by } else { 0 };
            let sql = "INSERT INTO events VALUES (?1, 'enter', ?2, 1, 0, 0, NULL, NULL, NULL, NULL)";
            store.connection.execute(sql, [k, time]).unwrap();
            EVENTS.note(&store.connection, k, [time, time]).unwrap();
        }
        store
    }

    fn numbers(store: &Store, condition: &str) -> Vec<i64> {
        let sql = format!("SELECT sequence FROM events WHERE {condition} ORDER BY sequence");
        let mut select = store.connection.prepare(&sql).unwrap();
        select.query_map((), |row| row.get(0)).unwrap().collect::<Result<_, _>>().unwrap()
    }

    #[test]
    fn every_row_of_a_time_is_between_the_numbers_even_if_the_clock_was_wrong() {
        for (wrong, by) in [(0..0, 0), (700..720, 1_000_000), (700..720, -1_000_000), (900..1400, -5000)] {
            let store = store(wrong.clone(), by);
            for (from, to) in [(0, 10), (-1, 0), (5000, 5001), (6990, 7300), (0, 30_000), (1_000_000, 2_000_000)] {
                let between = EVENTS.between(&store.connection, from, to).unwrap();
                let all = numbers(&store, &format!("time_ns >= {from} AND time_ns < {to}"));
                assert!(all.iter().all(|number| between.contains(number)), "{wrong:?} {by} {from} {between:?}");
                if by == 0 && !all.is_empty() {
                    assert!(between.end - between.start <= all.len() as i64 + 2 * 256, "{from} to {to}: {between:?}");
                }
            }
        }
    }

    #[test]
    fn old_rows_go_wherever_they_are_and_their_blocks_with_them() {
        let store = store(1500..1510, -20_000);
        while EVENTS.delete_before(&store.connection, 10_000).unwrap() > 0 {}
        assert_eq!(numbers(&store, "TRUE"), (1000..1500).chain(1510..2000).collect::<Vec<_>>());
        let sql = "SELECT min(first_ns), count(*) FROM events_blocks";
        let blocks: (i64, i64) = store.connection.query_row(sql, (), |row| Ok((row.get(0)?, row.get(1)?))).unwrap();
        assert_eq!(blocks, (10_000, 5));
        assert_eq!(EVENTS.delete_first(&store.connection, 600).unwrap(), 600);
        let left: i64 =
            store.connection.query_row("SELECT min(block) FROM events_blocks", (), |row| row.get(0)).unwrap();
        assert_eq!(left, 1610 >> 8);
        EVENTS.delete_first(&store.connection, 5000).unwrap();
        let left: i64 = store.connection.query_row("SELECT count(*) FROM events_blocks", (), |row| row.get(0)).unwrap();
        assert_eq!(left, 0);
    }
}
