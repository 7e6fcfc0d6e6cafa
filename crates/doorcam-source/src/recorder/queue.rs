use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use serde::Serialize;

use super::{End, RecordError, RecordingLimits, RecordingPlan, RecordingWriter, Written};
use crate::{RawFrame, RawImages};

/// Most frames that wait for the disk.
const QUEUE: usize = 256;
/// Most bytes of frames that wait: more than a second of large raw pictures.
const QUEUE_BYTES: usize = 128 << 20;
/// How often the writing thread checks whether to end while no frames arrive.
const TICK: Duration = Duration::from_millis(100);
/// How long past its time limit a recording waits for a frame whose time ends it.
const GRACE: Duration = Duration::from_secs(1);

/// Writes a recording on its own thread. None of its errors affects the source of the frames.
#[derive(Debug)]
pub struct Recorder {
    sender: Option<SyncSender<Queued>>,
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

/// The state of a recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[serde(rename_all = "kebab-case")]
pub enum RecordingState {
    /// Frames are being written.
    Recording,
    /// No more frames are accepted; the files are being synced to the disk.
    Finishing,
    /// It is complete.
    Complete,
    /// It ended on an error; what was written before opens as a recording.
    Failed,
}

/// The status of a recording.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct RecordingStatus {
    /// The recording's directory.
    #[cfg_attr(feature = "schema", schema(value_type = String))]
    pub directory: PathBuf,
    /// Its state.
    pub state: RecordingState,
    /// What has been written.
    #[serde(flatten)]
    pub written: Written,
    /// Frames that never arrived, or arrived damaged.
    pub lost: u64,
    /// Frames that were dropped because they came faster than they could be written.
    pub overflowed: u64,
    /// Why it ended; none while it is running, and after an error.
    #[cfg_attr(feature = "schema", schema(required))]
    pub ended: Option<End>,
    /// The error that ended it.
    #[cfg_attr(feature = "schema", schema(required))]
    pub error: Option<String>,
}

/// A frame, and the number of frames missing before it.
#[derive(Debug)]
struct Queued {
    frame: RawFrame,
    missing: u64,
}

#[derive(Debug)]
struct Shared {
    status: Mutex<RecordingStatus>,
    /// Number of frames missing since the last one that was queued.
    missing: AtomicU64,
    queued_bytes: AtomicUsize,
    stop: AtomicBool,
}

impl Shared {
    fn status(&self) -> MutexGuard<'_, RecordingStatus> {
        self.status.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Recorder {
    /// Begins a recording in a directory without one, creating it if needed.
    ///
    /// # Errors
    /// If the directory has a recording or cannot be written, or the thread cannot be started.
    pub fn start(directory: &Path, plan: RecordingPlan) -> Result<Self, RecordError> {
        let limits = plan.limits;
        let writer = RecordingWriter::create(directory, plan)?;
        let status = RecordingStatus {
            directory: directory.to_owned(),
            state: RecordingState::Recording,
            written: writer.written().clone(),
            lost: 0,
            overflowed: 0,
            ended: None,
            error: None,
        };
        let shared = Arc::new(Shared {
            status: Mutex::new(status),
            missing: AtomicU64::new(0),
            queued_bytes: AtomicUsize::new(0),
            stop: AtomicBool::new(false),
        });
        let (sender, receiver) = sync_channel(QUEUE);
        let theirs = Arc::clone(&shared);
        let thread = std::thread::Builder::new()
            .name("record".into())
            .spawn(move || work(writer, limits, &receiver, &theirs))
            .map_err(RecordError::Thread)?;
        Ok(Self { sender: Some(sender), shared, thread: Some(thread) })
    }

    /// Queues a frame, or counts it as overflowed if the queue is full; never waits. False once the recording has
    /// ended.
    pub fn offer(&self, frame: &RawFrame) -> bool {
        let Some(sender) = &self.sender else { return false };
        if self.shared.queued_bytes.load(Ordering::Relaxed) > QUEUE_BYTES {
            self.overflowed();
            return !self.has_ended();
        }
        match sender.try_send(self.queued(frame)) {
            Ok(()) => true,
            Err(TrySendError::Full(queued)) => {
                self.taken_back(&queued);
                self.overflowed();
                true
            }
            Err(TrySendError::Disconnected(_)) => false,
        }
    }

    /// Queues a frame, waiting while the queue is full. False once the recording has ended.
    pub fn put(&self, frame: &RawFrame) -> bool {
        self.sender.as_ref().is_some_and(|sender| sender.send(self.queued(frame)).is_ok())
    }

    /// Counts frames that never arrived, or arrived damaged, before the next one: the recording shows them as missing.
    pub fn lost(&self, count: u64) {
        self.shared.missing.fetch_add(count, Ordering::Relaxed);
        self.shared.status().lost += count;
    }

    /// The current status.
    pub fn status(&self) -> RecordingStatus {
        self.shared.status().clone()
    }

    /// Whether it accepts no more frames.
    pub fn has_ended(&self) -> bool {
        self.shared.status().state != RecordingState::Recording
    }

    /// Ends the recording after the frames that were queued, and waits until all of it is on the disk.
    pub fn stop(&mut self) -> RecordingStatus {
        self.sender = None;
        if let Some(thread) = self.thread.take() {
            // The thread panics only on a bug; it has not updated the status then.
            if thread.join().is_err() {
                let mut status = self.shared.status();
                status.state = RecordingState::Failed;
                status.error.get_or_insert_with(|| "the recording stopped on an internal error".into());
            }
        }
        self.status()
    }

    fn queued(&self, frame: &RawFrame) -> Queued {
        self.shared.queued_bytes.fetch_add(size(frame), Ordering::Relaxed);
        Queued { frame: frame.clone(), missing: self.shared.missing.swap(0, Ordering::Relaxed) }
    }

    fn taken_back(&self, queued: &Queued) {
        self.shared.queued_bytes.fetch_sub(size(&queued.frame), Ordering::Relaxed);
        self.shared.missing.fetch_add(queued.missing, Ordering::Relaxed);
    }

    fn overflowed(&self) {
        self.shared.missing.fetch_add(1, Ordering::Relaxed);
        self.shared.status().overflowed += 1;
    }
}

impl Drop for Recorder {
    fn drop(&mut self) {
        // The queue is discarded, so that dropping does not wait long for a slow disk.
        self.shared.stop.store(true, Ordering::Relaxed);
        self.stop();
    }
}

fn size(frame: &RawFrame) -> usize {
    match &frame.images {
        RawImages::Camera(bytes) | RawImages::Sensor(_, bytes) => bytes.len(),
        RawImages::Patches([left, right]) => left.len() + right.len(),
    }
}

/// Writes frames until the recording ends, and sets the status accordingly.
fn work(mut writer: RecordingWriter, limits: RecordingLimits, frames: &Receiver<Queued>, shared: &Shared) {
    let ended = write(&mut writer, limits, frames, shared);
    shared.status().state = RecordingState::Finishing;
    let (written, finished) = (writer.written().clone(), writer.finish());
    let mut status = shared.status();
    status.written = finished.as_ref().map_or(written, Clone::clone);
    match ended.and_then(|end| finished.map(|_| end)) {
        Ok(end) => (status.state, status.ended) = (RecordingState::Complete, Some(end)),
        Err(e) => (status.state, status.error) = (RecordingState::Failed, Some(e.to_string())),
    }
}

fn write(
    writer: &mut RecordingWriter,
    limits: RecordingLimits,
    frames: &Receiver<Queued>,
    shared: &Shared,
) -> Result<End, RecordError> {
    let mut deadline = None;
    loop {
        if shared.stop.load(Ordering::Relaxed) {
            return Ok(End::Stopped);
        }
        let Queued { frame, missing } = match frames.recv_timeout(TICK) {
            Ok(queued) => queued,
            // A camera that stops delivering frames must not keep the recording from ending.
            Err(RecvTimeoutError::Timeout) if deadline.is_some_and(|d| Instant::now() >= d) => return Ok(End::Seconds),
            Err(RecvTimeoutError::Timeout) => continue,
            Err(RecvTimeoutError::Disconnected) => return Ok(End::Stopped),
        };
        shared.queued_bytes.fetch_sub(size(&frame), Ordering::Relaxed);
        let limit = limits.seconds.and_then(|s| Duration::try_from_secs_f64(s).ok());
        deadline = deadline.or_else(|| Instant::now().checked_add(limit? + GRACE));
        writer.pass_over(missing);
        let skipped = writer.written().skipped;
        let ended = writer.write(&frame)?;
        if let Some(reason) = writer.written().last_skipped.as_ref().filter(|_| writer.written().skipped > skipped) {
            tracing::warn!("skipped a frame: {reason}");
        }
        shared.status().written = writer.written().clone();
        if let Some(end) = ended {
            return Ok(end);
        }
    }
}

#[cfg(test)]
#[path = "queue_tests.rs"]
mod tests;
