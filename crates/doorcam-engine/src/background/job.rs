use std::thread::JoinHandle;

/// Where work runs that takes longer than a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Work {
    /// On a thread of its own, while frames go on.
    #[default]
    Aside,
    /// On the calling thread, while frames wait: for tests, which must be reproducible.
    InPlace,
}

/// Work in progress.
#[derive(Debug)]
pub(crate) enum Job<T> {
    /// On its own thread.
    Running(JoinHandle<T>),
    /// Finished.
    Done(T),
}

impl<T: Send + 'static> Job<T> {
    /// Starts the work; on the calling thread if no other can be started.
    pub fn start(how: Work, name: &str, work: impl FnOnce() -> T + Clone + Send + 'static) -> Self {
        if how == Work::Aside {
            match std::thread::Builder::new().name(name.into()).spawn(work.clone()) {
                Ok(handle) => return Self::Running(handle),
                Err(e) => tracing::warn!("cannot start a background thread ({e}): frames wait for the work"),
            }
        }
        Self::Done(work())
    }

    /// The result if the work is done (`None` if it panicked; the panic was reported by its thread), otherwise the job
    /// itself.
    pub fn poll(self) -> Result<Option<T>, Self> {
        match self {
            Self::Done(result) => Ok(Some(result)),
            Self::Running(handle) if handle.is_finished() => Ok(handle.join().ok()),
            running => Err(running),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_is_done_aside_or_in_place() {
        let here = std::thread::current().id();
        for (how, same) in [(Work::Aside, false), (Work::InPlace, true)] {
            let mut job = Job::start(how, "test", || std::thread::current().id());
            let result = loop {
                match job.poll() {
                    Ok(result) => break result,
                    Err(running) => job = running,
                }
                std::thread::yield_now();
            };
            assert_eq!(result.map(|id| id == here), Some(same));
        }
    }
}
