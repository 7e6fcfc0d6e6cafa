//! How many queries of the history run at once: those of one client must not hold up everybody else's.

use std::sync::Arc;
use std::time::Duration;

use axum::response::{IntoResponse, Response};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio::time::timeout;

use super::super::Shared;
use super::super::problem::ProblemDetails;
use crate::history::{History, StoreError, Until};

/// Most queries for pages at once: each reads little more than it answers. More would share the same processors.
const PAGES: usize = 3;
/// Most sums over intervals at once: each may read the whole history, and must not hold up pages or frames.
const SUMS: usize = 1;
/// Most queries that wait for their turn: most take a millisecond.
const WAITING: usize = 64;
/// How long a query waits for its turn, so that whoever is refused hears of it within a second.
const PATIENCE: Duration = Duration::from_millis(500);

/// Who may ask the history now.
#[derive(Debug, Clone)]
pub(in super::super) struct Turns {
    pages: Queue,
    sums: Queue,
}

impl Default for Turns {
    fn default() -> Self {
        Self { pages: Queue::new(PAGES), sums: Queue::new(SUMS) }
    }
}

/// What is asked for.
#[derive(Debug, Clone, Copy)]
pub(super) enum Asking {
    /// Events or spans as they are.
    Page,
    /// Sums over intervals.
    Sum,
}

impl Turns {
    fn queue(&self, asking: Asking) -> &Queue {
        match asking {
            Asking::Page => &self.pages,
            Asking::Sum => &self.sums,
        }
    }
}

/// Those who ask and those who wait.
#[derive(Debug, Clone)]
struct Queue {
    running: Arc<Semaphore>,
    waiting: Arc<Semaphore>,
}

impl Queue {
    fn new(at_once: usize) -> Self {
        Self { running: Arc::new(Semaphore::new(at_once)), waiting: Arc::new(Semaphore::new(WAITING)) }
    }

    /// A turn, or `None` if too many wait for theirs.
    async fn take(&self) -> Option<OwnedSemaphorePermit> {
        let _place = self.waiting.try_acquire().ok()?;
        timeout(PATIENCE, Arc::clone(&self.running).acquire_owned()).await.ok()?.ok()
    }

    /// A turn for an answer that has begun already, so that it cannot be refused any more.
    async fn wait(&self) -> Option<OwnedSemaphorePermit> {
        Arc::clone(&self.running).acquire_owned().await.ok()
    }
}

/// Why a query has no answer.
#[derive(Debug)]
pub(super) enum Refused {
    /// Too many queries wait.
    Busy,
    /// The history cannot be read, or not in time.
    Store(StoreError),
    /// The query panicked.
    Failed,
}

impl IntoResponse for Refused {
    fn into_response(self) -> Response {
        match self {
            Self::Busy => {
                ProblemDetails::unavailable("too many ask for the history now, try again in 1 s").retry_after(1)
            }
            Self::Store(e) => ProblemDetails::unavailable(&e.to_string()).retry_after(1),
            Self::Failed => ProblemDetails::internal("reading the history failed"),
        }
        .into_response()
    }
}

/// Ends a query when its client has gone away: the future that waits for it is dropped then.
struct Waiting(Until);

impl Drop for Waiting {
    fn drop(&mut self) {
        self.0.give_up();
    }
}

/// Asks the history, in turn.
pub(super) async fn answer<T: Send + 'static>(
    shared: Shared,
    asking: Asking,
    ask: impl FnOnce(&History, &Until) -> Result<T, StoreError> + Send + 'static,
) -> Result<T, Refused> {
    let turn = shared.turns.queue(asking).take().await.ok_or(Refused::Busy)?;
    asked(shared, turn, ask).await
}

/// Asks the history for a further part of an answer, however long that takes.
pub(super) async fn further<T: Send + 'static>(
    shared: Shared,
    asking: Asking,
    ask: impl FnOnce(&History, &Until) -> Result<T, StoreError> + Send + 'static,
) -> Result<T, Refused> {
    let turn = shared.turns.queue(asking).wait().await.ok_or(Refused::Busy)?;
    asked(shared, turn, ask).await
}

/// On a blocking thread, because it may wait for the disk. The turn ends with the query, not with the client.
async fn asked<T: Send + 'static>(
    shared: Shared,
    turn: OwnedSemaphorePermit,
    ask: impl FnOnce(&History, &Until) -> Result<T, StoreError> + Send + 'static,
) -> Result<T, Refused> {
    let until = Until::default();
    let _waiting = Waiting(until.clone());
    let asking = tokio::task::spawn_blocking(move || {
        let _turn = turn;
        ask(&shared.history, &until)
    });
    asking.await.map_err(|_| Refused::Failed)?.map_err(Refused::Store)
}

#[cfg(test)]
mod tests {
    use axum::http::header;

    use super::*;

    #[tokio::test]
    async fn beyond_some_queries_at_once_others_wait_and_beyond_those_they_are_refused() {
        let turns = Queue::new(PAGES);
        let mut running = Vec::new();
        for _ in 0..PAGES {
            running.push(turns.take().await.unwrap());
        }
        let waiting: Vec<_> = (0..WAITING)
            .map(|_| {
                let turns = turns.clone();
                tokio::spawn(async move { turns.take().await.is_some() })
            })
            .collect();
        while turns.waiting.available_permits() > 0 {
            tokio::task::yield_now().await;
        }
        assert!(turns.take().await.is_none(), "at once");
        running.clear();
        for waiting in waiting {
            assert!(waiting.await.unwrap());
        }
        let response = Refused::Busy.into_response();
        assert_eq!(
            (response.status().as_u16(), &response.headers()[header::RETRY_AFTER]),
            (503, &"1".parse().unwrap())
        );
    }
}
