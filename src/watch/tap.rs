use std::sync::{Mutex, MutexGuard, PoisonError};

use doorcam_source::RawFrame;
use doorcam_source::recorder::{Recorder, RecordingState, RecordingStatus};

/// Where the frames of a running source can be recorded. Whoever has them hands them over in passing and never waits: the
/// recorder has its own thread and counts what it has no room for.
#[derive(Debug, Default)]
pub(super) struct Tap(Mutex<Tapped>);

#[derive(Debug, Default)]
struct Tapped {
    recorder: Option<Recorder>,
    /// The recording before, or the one that is being brought to the disk.
    last: Option<RecordingStatus>,
}

impl Tap {
    /// A frame has come.
    pub(super) fn frame(&self, frame: &RawFrame) {
        if let Some(recorder) = &self.tapped().recorder {
            recorder.offer(frame);
        }
    }

    /// So many frames should have come before the next one.
    pub(super) fn missing(&self, count: u64) {
        if let Some(recorder) = &self.tapped().recorder {
            recorder.lost(count);
        }
    }

    /// How the recording is doing, or how the last one ended; none before the first.
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
        // Outside of the lock: what has ended may still be on its way to the disk.
        drop(before);
    }

    /// Ends the recording and waits until it is on the disk; none if there is none.
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
