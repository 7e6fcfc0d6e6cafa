use std::sync::Arc;
use std::thread::JoinHandle;

use jiff::Timestamp;

use super::Mailbox;
use super::engine::{Engine, StepError};
use super::hub::Hub;
use crate::source::{Condition, RawFrame, SkippedFrame, Source, SourceEvent, SourceState};

/// A captured frame and when it was captured.
struct Captured {
    frame: RawFrame,
    time: Timestamp,
}

/// Starts the capture and the solver thread; they end with the source.
pub fn start(source: Box<dyn Source>, engine: Engine, hub: Arc<Hub>) -> std::io::Result<[JoinHandle<()>; 2]> {
    let mailbox = Arc::new(Mailbox::default());
    let capture = {
        let (mailbox, hub) = (Arc::clone(&mailbox), Arc::clone(&hub));
        std::thread::Builder::new().name("capture".into()).spawn(move || {
            let _closing = Closing(&mailbox);
            capture(source, &mailbox, &hub);
        })?
    };
    let solve = std::thread::Builder::new().name("solve".into()).spawn(move || {
        let _closing = Closing(&mailbox);
        let guard = EndGuard { hub: &hub, done: false };
        let ended = solve(engine, &mailbox, &hub);
        guard.end(ended);
    })?;
    Ok([capture, solve])
}

/// Closes the mailbox however its thread ends, so that the other one ends too.
struct Closing<'a>(&'a Mailbox<Captured>);

impl Drop for Closing<'_> {
    fn drop(&mut self) {
        self.0.close();
    }
}

/// Reports how the solver thread ended, even if it panicked.
struct EndGuard<'a> {
    hub: &'a Hub,
    done: bool,
}

impl EndGuard<'_> {
    fn end(mut self, result: Result<(), String>) {
        self.done = true;
        match result {
            Ok(()) => self.hub.condition(ended(SourceState::Ended, None)),
            Err(error) => {
                tracing::error!("{error}");
                self.hub.condition(ended(SourceState::Failed, Some(error)));
            }
        }
    }
}

impl Drop for EndGuard<'_> {
    fn drop(&mut self) {
        if !self.done {
            let reason = "the frame loop stopped on an internal error".into();
            self.hub.condition(ended(SourceState::Failed, Some(reason)));
        }
    }
}

fn ended(state: SourceState, reason: Option<String>) -> Condition {
    Condition { state, reason, granted: None }
}

fn capture(mut source: Box<dyn Source>, mailbox: &Mailbox<Captured>, hub: &Hub) {
    let lossless = source.lossless();
    while let Some(next) = source.next() {
        if mailbox.is_closed() {
            return;
        }
        match next {
            SourceEvent::Frame(frame) => {
                hub.captured();
                let time = frame.time.unwrap_or_else(Timestamp::now);
                let captured = Captured { frame, time };
                if lossless {
                    if !mailbox.put_after(captured) {
                        return;
                    }
                } else if mailbox.replace(captured).is_some() {
                    hub.dropped(1);
                }
            }
            SourceEvent::Skipped(skipped) => skip(hub, &skipped),
            SourceEvent::Lost(count) => hub.lost(count),
            SourceEvent::Superseded(count) => hub.dropped(count),
            SourceEvent::Condition(condition) => hub.condition(condition),
            SourceEvent::Nothing => {}
        }
    }
}

fn skip(hub: &Hub, skipped: &SkippedFrame) {
    tracing::warn!("skipped a frame: {skipped}");
    hub.skipped(skipped.to_string());
}

/// Solves frames until there are no more; an error if none of them can be solved.
fn solve(mut engine: Engine, mailbox: &Mailbox<Captured>, hub: &Hub) -> Result<(), String> {
    while let Some(Captured { frame, time }) = mailbox.take() {
        match engine.step(&frame, time) {
            Ok(published) => hub.publish(published),
            Err(StepError::Skipped(skipped)) => skip(hub, &skipped),
            Err(e @ StepError::NoBackground) => return Err(e.to_string()),
        }
    }
    Ok(())
}
