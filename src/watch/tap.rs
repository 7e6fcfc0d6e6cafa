use std::sync::{Mutex, MutexGuard, PoisonError};

use doorcam_source::RawFrame;
use doorcam_source::recorder::{Recorder, RecordingState, RecordingStatus};

/// Where the frames of a running source can be recorded. Handing over a frame never waits: the recorder has its own
/// thread and counts the frames that do not fit into its queue.
#[derive(Debug, Default)]
pub(super) struct Tap(Mutex<Tapped>);

#[derive(Debug, Default)]
struct Tapped {
    recorder: Option<Recorder>,
    /// The previous recording, or the one that is being written out.
    last: Option<RecordingStatus>,
}

impl Tap {
    /// Offers a frame to the recorder.
    pub(super) fn frame(&self, frame: &RawFrame) {
        if let Some(recorder) = &self.tapped().recorder {
            recorder.offer(frame);
        }
    }

    /// Reports that `count` frames are missing before the next one.
    pub(super) fn missing(&self, count: u64) {
        if let Some(recorder) = &self.tapped().recorder {
            recorder.lost(count);
        }
    }

    /// Progress of the recording, or how the last one ended; `None` before the first.
    pub(super) fn status(&self) -> Option<RecordingStatus> {
        let tapped = self.tapped();
        tapped.recorder.as_ref().map(Recorder::status).or_else(|| tapped.last.clone())
    }

    /// Whether frames are being recorded.
    pub(super) fn is_recording(&self) -> bool {
        self.tapped().recorder.as_ref().is_some_and(|recorder| !recorder.has_ended())
    }

    /// Hands frames to this recorder from now on.
    pub(super) fn begin(&self, recorder: Recorder) {
        let before = self.tapped().recorder.replace(recorder);
        // Drop it outside the lock, because it may still be writing to disk.
        drop(before);
    }

    /// Stops the recording and waits until it is on disk; `None` if there is none.
    pub(super) fn end(&self) -> Option<RecordingStatus> {
        let mut recorder = {
            let mut tapped = self.tapped();
            let recorder = tapped.recorder.take()?;
            tapped.last = Some(RecordingStatus { state: RecordingState::Finishing, ..recorder.status() });
            recorder
        };
        let status = recorder.stop();
        self.tapped().last = Some(status.clone());
        Some(status)
    }

    fn tapped(&self) -> MutexGuard<'_, Tapped> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
