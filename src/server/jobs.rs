//! Work that waits for a disk or keeps a processor busy: on threads beside the async workers, and little at a time.

use std::sync::Arc;
use std::time::Duration;

use tokio::sync::Semaphore;
use tokio::time::timeout;

use super::problem::ProblemDetails;

/// How long a request waits until others of its kind are done, before it is refused.
const PATIENCE: Duration = Duration::from_secs(10);

/// What a job does. Each kind has its own places, so that slow ones of one kind do not hold up the others.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    /// Draws or encodes a picture or a map. Most requests get one that was drawn already.
    Drawing,
    /// Checks or changes the calibration, which takes a processor and up to some hundred megabytes.
    Calibrating,
    /// Reads the history, which mostly waits for the disk, or the calibration with its files.
    Reading,
    /// Changes files: zones and recordings.
    Writing,
}

impl Kind {
    /// How many of them run at the same time.
    const fn places(self) -> usize {
        match self {
            Self::Drawing | Self::Calibrating | Self::Writing => 2,
            Self::Reading => 8,
        }
    }

    const fn name(self) -> &'static str {
        match self {
            Self::Drawing => "drawing the picture",
            Self::Calibrating => "the calibration",
            Self::Reading => "reading",
            Self::Writing => "the change",
        }
    }
}

/// Runs jobs. What the server must always tell (`/livez`, `/readyz`, `/metrics`, the status) is no job.
#[derive(Debug)]
pub(super) struct Jobs {
    drawing: Arc<Semaphore>,
    calibrating: Arc<Semaphore>,
    reading: Arc<Semaphore>,
    writing: Arc<Semaphore>,
    patience: Duration,
}

impl Default for Jobs {
    fn default() -> Self {
        Self::new(PATIENCE)
    }
}

impl Jobs {
    fn new(patience: Duration) -> Self {
        let places = |kind: Kind| Arc::new(Semaphore::new(kind.places()));
        Self {
            drawing: places(Kind::Drawing),
            calibrating: places(Kind::Calibrating),
            reading: places(Kind::Reading),
            writing: places(Kind::Writing),
            patience,
        }
    }

    fn places(&self, kind: Kind) -> Arc<Semaphore> {
        Arc::clone(match kind {
            Kind::Drawing => &self.drawing,
            Kind::Calibrating => &self.calibrating,
            Kind::Reading => &self.reading,
            Kind::Writing => &self.writing,
        })
    }

    /// Runs `work` on a blocking thread as soon as there is a place for it. The place is taken until the work has
    /// really ended, also if nobody waits for it any more: requests that are given up cannot pile up work.
    ///
    /// # Errors
    ///
    /// If no place becomes free in time (503), or if the work panics.
    pub(super) async fn run<T: Send + 'static>(
        &self,
        kind: Kind,
        work: impl FnOnce() -> T + Send + 'static,
    ) -> Result<T, ProblemDetails> {
        let Ok(Ok(place)) = timeout(self.patience, self.places(kind).acquire_owned()).await else {
            return Err(ProblemDetails::busy(&format!("{}: too much at the same time", kind.name())));
        };
        let job = tokio::task::spawn_blocking(move || {
            let done = work();
            drop(place);
            done
        });
        // The panic itself is in the log.
        job.await.map_err(|_| ProblemDetails::internal(&format!("{} failed on an internal error", kind.name())))
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc;

    use axum::http::{StatusCode, header};
    use axum::response::IntoResponse;

    use super::*;

    #[tokio::test]
    async fn a_job_has_its_place_until_it_ends_and_other_kinds_go_on() {
        let jobs = Arc::new(Jobs::new(Duration::from_millis(50)));
        let (begun, begins) = mpsc::channel();
        let ends: Vec<_> = (0..2)
            .map(|_| {
                let (jobs, begun) = (Arc::clone(&jobs), begun.clone());
                let (end, ended) = mpsc::channel::<()>();
                let request = tokio::spawn(async move {
                    jobs.run(Kind::Calibrating, move || {
                        begun.send(()).unwrap();
                        let _ = ended.recv();
                    })
                    .await
                });
                (end, request)
            })
            .collect();
        tokio::task::spawn_blocking(move || (0..2).for_each(|_| begins.recv().unwrap())).await.unwrap();
        // Nobody waits for them any more, but they still work.
        ends.iter().for_each(|(_, request)| request.abort());
        let refused = jobs.run(Kind::Calibrating, || ()).await.unwrap_err().into_response();
        assert_eq!(refused.status(), StatusCode::SERVICE_UNAVAILABLE);
        assert!(refused.headers().contains_key(header::RETRY_AFTER));
        for kind in [Kind::Drawing, Kind::Reading, Kind::Writing] {
            assert_eq!(jobs.run(kind, || 7).await.unwrap(), 7, "{kind:?}");
        }
        drop(ends);
        let calibrating = Arc::clone(&jobs.calibrating);
        let patient = Jobs { patience: Duration::from_secs(60), calibrating, ..Jobs::default() };
        assert_eq!(patient.run(Kind::Calibrating, || 8).await.unwrap(), 8);
    }

    #[tokio::test]
    async fn a_panic_frees_its_place() {
        let jobs = Jobs::new(Duration::from_secs(60));
        for _ in 0..3 {
            let failed = jobs.run(Kind::Drawing, || panic!("as the test wants")).await.unwrap_err();
            assert_eq!(failed.into_response().status(), StatusCode::INTERNAL_SERVER_ERROR);
        }
        assert_eq!(jobs.run(Kind::Drawing, || 7).await.unwrap(), 7);
    }
}
