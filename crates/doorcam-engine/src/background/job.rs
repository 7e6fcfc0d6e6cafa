use std::sync::{Arc, Mutex, PoisonError};
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

/// Held by the job whose turn it is. Each such job uses all cores and much memory, so several at once would only take
/// more of both.
static TURN: Mutex<()> = Mutex::new(());

/// Work in progress. Dropping the job abandons work that has not begun: it never will.
#[derive(Debug)]
pub(crate) struct Job<T> {
    state: State<T>,
    /// The thread does not begin once this is gone.
    _wanted: Arc<()>,
}

#[derive(Debug)]
enum State<T> {
    /// On its own thread, which returns `None` if the job was abandoned.
    Running(JoinHandle<Option<T>>),
    Done(T),
}

impl<T: Send + 'static> Job<T> {
    /// Starts the work; on the calling thread if no other can be started.
    pub fn start(how: Work, name: &str, work: impl FnOnce() -> T + Clone + Send + 'static) -> Self {
        Self::spawn(how, name, work, None)
    }

    /// As [`Self::start`], for heavy work: aside, one such job runs at a time in the whole process.
    pub fn in_turn(how: Work, name: &str, work: impl FnOnce() -> T + Clone + Send + 'static) -> Self {
        Self::spawn(how, name, work, Some(&TURN))
    }

    fn spawn(
        how: Work,
        name: &str,
        work: impl FnOnce() -> T + Clone + Send + 'static,
        turn: Option<&'static Mutex<()>>,
    ) -> Self {
        let wanted = Arc::new(());
        if how == Work::Aside {
            let (work, still_wanted) = (work.clone(), Arc::downgrade(&wanted));
            let thread = std::thread::Builder::new().name(name.into()).spawn(move || {
                let _turn = turn.map(|turn| turn.lock().unwrap_or_else(PoisonError::into_inner));
                still_wanted.upgrade().map(|_| work())
            });
            match thread {
                Ok(handle) => return Self { state: State::Running(handle), _wanted: wanted },
                Err(e) => tracing::warn!("cannot start a background thread ({e}): frames wait for the work"),
            }
        }
        Self { state: State::Done(work()), _wanted: wanted }
    }

    /// The result if the work is done (`None` if it panicked; the panic was reported by its thread), otherwise the job
    /// itself.
    pub fn poll(self) -> Result<Option<T>, Self> {
        match self.state {
            State::Running(handle) if !handle.is_finished() => {
                Err(Self { state: State::Running(handle), _wanted: self._wanted })
            }
            _ => Ok(self.wait()),
        }
    }

    /// Waits for the result; `None` if the work panicked.
    pub fn wait(self) -> Option<T> {
        match self.state {
            State::Done(result) => Some(result),
            State::Running(handle) => handle.join().ok().flatten(),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};
    use std::sync::mpsc::channel;

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

    #[test]
    fn heavy_work_takes_turns_and_what_is_abandoned_meanwhile_never_begins() {
        let begun = Arc::new(AtomicUsize::new(0));
        let (release, released) = channel::<()>();
        let released = Arc::new(Mutex::new(released));
        let work = |wait: bool| {
            let (begun, released) = (Arc::clone(&begun), Arc::clone(&released));
            move || {
                begun.fetch_add(1, Ordering::SeqCst);
                if wait {
                    released.lock().unwrap().recv().unwrap();
                }
            }
        };
        let first = Job::in_turn(Work::Aside, "first", work(true));
        while begun.load(Ordering::SeqCst) == 0 {
            std::thread::yield_now();
        }
        // Each is replaced by the next before its turn has come.
        (0..50).for_each(|_| drop(Job::in_turn(Work::Aside, "abandoned", work(false))));
        let last = Job::in_turn(Work::Aside, "last", work(false));
        assert_eq!(begun.load(Ordering::SeqCst), 1);
        release.send(()).unwrap();
        assert_eq!((first.wait(), last.wait()), (Some(()), Some(())));
        assert_eq!(begun.load(Ordering::SeqCst), 2);
    }
}
