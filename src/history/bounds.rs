//! When a query has to end.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use rusqlite::Connection;

/// Longest query. One over the whole history takes some tenths of a second; a slow disk may take some seconds.
pub(super) const LONGEST: Duration = Duration::from_secs(5);
/// Steps of SQLite's virtual machine between two looks at the clock: some tens of microseconds.
const STEPS: i32 = 2000;

/// When a query ends without an answer. Clones share one end.
#[derive(Debug, Clone)]
pub struct Until {
    deadline: Instant,
    given_up: Arc<AtomicBool>,
}

impl Default for Until {
    /// The usual deadline, from now on.
    fn default() -> Self {
        Self { deadline: Instant::now() + LONGEST, given_up: Arc::default() }
    }
}

impl Until {
    /// Ends the query now, because nobody waits for its answer.
    pub fn give_up(&self) {
        self.given_up.store(true, Ordering::Relaxed);
    }

    fn is_over(&self) -> bool {
        self.given_up.load(Ordering::Relaxed) || Instant::now() >= self.deadline
    }
}

/// Makes a connection's statements fail once a query has to end, as long as this exists.
pub(super) struct Bounded<'a>(&'a Connection);

impl<'a> Bounded<'a> {
    /// Also ends them when `ending` is true.
    pub(super) fn new(connection: &'a Connection, until: &Until, ending: &Arc<AtomicBool>) -> rusqlite::Result<Self> {
        let (until, ending) = (until.clone(), Arc::clone(ending));
        connection.progress_handler(STEPS, Some(move || until.is_over() || ending.load(Ordering::Relaxed)))?;
        Ok(Self(connection))
    }
}

impl Drop for Bounded<'_> {
    fn drop(&mut self) {
        // It cannot fail for a connection of our own.
        let _ = self.0.progress_handler(0, None::<fn() -> bool>);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ENDLESS: &str = "WITH RECURSIVE n (k) AS (SELECT 0 UNION ALL SELECT k + 1 FROM n) SELECT count(*) FROM n";

    #[test]
    fn an_endless_statement_ends_at_its_deadline_or_when_it_is_given_up() {
        let connection = Connection::open_in_memory().unwrap();
        let count = || connection.query_row(ENDLESS, (), |row| row.get::<_, i64>(0));
        let interrupted = |result: rusqlite::Result<i64>| {
            let code = result.unwrap_err().sqlite_error_code();
            assert_eq!(code, Some(rusqlite::ErrorCode::OperationInterrupted));
        };
        let ending = Arc::new(AtomicBool::new(false));
        let soon = Until { deadline: Instant::now() + Duration::from_millis(20), ..Until::default() };
        let bounded = Bounded::new(&connection, &soon, &ending).unwrap();
        interrupted(count());
        drop(bounded);
        let late = Until::default();
        let bounded = Bounded::new(&connection, &late, &ending).unwrap();
        std::thread::scope(|scope| {
            scope.spawn(|| late.give_up());
            interrupted(count());
        });
        drop(bounded);
        ending.store(true, Ordering::Relaxed);
        let bounded = Bounded::new(&connection, &Until::default(), &ending).unwrap();
        interrupted(count());
        drop(bounded);
        assert_eq!(connection.query_row("SELECT 1", (), |row| row.get(0)), Ok(1), "free again");
    }
}
