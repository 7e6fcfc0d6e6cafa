use std::thread::JoinHandle;

/// Where work goes that takes longer than a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Work {
    /// To a thread of its own, while frames go on.
    #[default]
    Aside,
    /// It is done at once, and frames wait: for tests, in which the same must happen every time.
    InPlace,
}

/// Work under way.
#[derive(Debug)]
pub(crate) enum Job<T> {
    /// On its thread.
    Running(JoinHandle<T>),
    /// Done already.
    Done(T),
}

impl<T: Send + 'static> Job<T> {
    /// Starts it; in place if there is no thread to be had.
    pub fn start(how: Work, name: &str, work: impl FnOnce() -> T + Clone + Send + 'static) -> Self {
        if how == Work::Aside {
            match std::thread::Builder::new().name(name.into()).spawn(work.clone()) {
                Ok(handle) => return Self::Running(handle),
                Err(e) => tracing::warn!("no thread for work beside the frames ({e}): they wait"),
            }
        }
        Self::Done(work())
    }

    /// Its result if it is done, itself if not; nothing if it failed, which it has said itself.
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
