use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;
use std::time::Duration;

use jiff::Timestamp;

use crate::watch::hub::Hub;
use crate::watch::{Mailbox, Taken};
use doorcam_core::tracking::Zone;
use doorcam_engine::{Engine, StepError};
use doorcam_source::{Condition, Granted, RawFrame, SkippedFrame, Source, SourceEvent, SourceState};

/// A captured frame and when it was captured.
struct Captured {
    frame: RawFrame,
    time: Timestamp,
}

/// What the frame loop is told while it runs.
pub enum Command {
    /// Goes on with this engine, of a new calibration.
    Use(Box<Engine>),
    /// Learns the empty room anew, from now on.
    ResetBackground,
    /// Counts people in these zones from now on.
    UseZones(Vec<Zone>),
    /// Ends, with what is to be kept put away.
    End,
}

/// A frame loop that runs.
pub struct Running {
    control: Control,
    solve: JoinHandle<()>,
}

impl Running {
    /// What tells it what to do.
    pub fn control(&self) -> &Control {
        &self.control
    }

    /// Ends it; returns when what it keeps is put away.
    pub fn end(self) {
        self.control.tell(Command::End);
        // A panic has been reported when it happened.
        let _ = self.solve.join();
    }
}

/// Tells a running frame loop what to do.
#[derive(Clone)]
pub struct Control(Sender<Command>);

impl Control {
    /// What is told takes effect before the next frame; false if the loop has ended.
    pub fn tell(&self, command: Command) -> bool {
        self.0.send(command).is_ok()
    }
}

/// How often the solver thread looks for commands while no frames come.
const TICK: Duration = Duration::from_millis(100);

/// Starts the capture and the solver thread; they end with the source. Without an engine, frames are only looked at, until
/// [`Command::Use`] brings one.
pub fn start(source: Box<dyn Source>, engine: Option<Engine>, hub: Arc<Hub>) -> std::io::Result<Running> {
    let mailbox = Arc::new(Mailbox::default());
    let (tell, commands) = channel();
    {
        let (mailbox, hub) = (Arc::clone(&mailbox), Arc::clone(&hub));
        std::thread::Builder::new().name("capture".into()).spawn(move || {
            let _closing = Closing(&mailbox);
            capture(source, &mailbox, &hub);
        })?
    };
    let solve = std::thread::Builder::new().name("solve".into()).spawn(move || {
        let _closing = Closing(&mailbox);
        let guard = EndGuard { hub: &hub, done: false };
        let ended = solve(engine, &mailbox, &hub, &commands);
        guard.end(ended);
    })?;
    Ok(Running { control: Control(tell), solve })
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
    while let Some(next) = source.next() {
        if mailbox.is_closed() {
            return;
        }
        match next {
            SourceEvent::Frame(frame) => {
                let time = frame.time.unwrap_or_else(Timestamp::now);
                hub.captured(&frame, time);
                let captured = Captured { frame, time };
                if source.lossless() {
                    if !mailbox.put_after(captured) {
                        return;
                    }
                } else if mailbox.replace(captured).is_some() {
                    hub.dropped(1);
                }
            }
            SourceEvent::Skipped(skipped) => {
                hub.tap().missing(1);
                skip(hub, &skipped);
            }
            SourceEvent::Lost(count) => {
                hub.tap().missing(count);
                hub.lost(count);
            }
            SourceEvent::Superseded(count) => {
                hub.tap().missing(count);
                hub.dropped(count);
            }
            SourceEvent::Condition(condition) => {
                tell(&condition, hub.source_state());
                hub.condition(condition);
            }
            SourceEvent::Nothing => {}
        }
    }
}

/// Says in the log what the page shows, with the state `before`.
fn tell(condition: &Condition, before: SourceState) {
    let Some(granted) = &condition.granted else {
        condition.reason.iter().for_each(|reason| tracing::warn!("{reason}"));
        return;
    };
    let Granted { card, node, format, size: [width, height], fps, mismatches, .. } = granted;
    let fps = (fps * 100.0).round() / 100.0;
    match (&condition.reason, condition.state) {
        (Some(reason), _) => tracing::warn!("{reason}"),
        (None, SourceState::Opening) => {
            tracing::info!("{node}: {card}, {format} {width}x{height}, {fps} frames a second");
        }
        (None, state) if state != before => tracing::info!("{node}: frames come"),
        (None, _) => {}
    }
    mismatches.iter().for_each(|mismatch| tracing::warn!("{node}: {mismatch}"));
}

/// Counts a frame that could not be used. A camera that gives nothing else for weeks must not fill the log: what is the same
/// again is said ever more rarely.
fn skip(hub: &Hub, skipped: &SkippedFrame) {
    let (count, same_again) = hub.skipped(skipped.to_string());
    if !same_again || count.is_power_of_two() {
        tracing::warn!("skipped a frame, {count} by now: {skipped}");
    }
}

/// Solves frames until there are no more; an error if none of them can be solved.
fn solve(
    mut engine: Option<Engine>,
    mailbox: &Mailbox<Captured>,
    hub: &Hub,
    commands: &Receiver<Command>,
) -> Result<(), String> {
    let mut recalibrated = false;
    loop {
        while let Ok(command) = commands.try_recv() {
            match command {
                Command::Use(mut next) => {
                    hub.watch(next.watched());
                    if let Some(engine) = engine.take() {
                        next.continue_from(engine);
                    }
                    // It was made with the zones of the start.
                    next.use_zones(hub.zones());
                    engine = Some(*next);
                    recalibrated = true;
                }
                Command::UseZones(zones) => engine.iter_mut().for_each(|engine| engine.use_zones(zones.clone())),
                Command::End => return Ok(()),
                Command::ResetBackground => engine.iter_mut().for_each(|engine| {
                    engine.reset_background();
                }),
            }
        }
        let Captured { frame, time } = match mailbox.take(TICK) {
            Taken::Item(captured) => captured,
            Taken::Nothing => continue,
            Taken::Closed => return Ok(()),
        };
        let Some(engine) = &mut engine else { continue };
        match engine.step(&frame, time) {
            Ok(published) => hub.publish(published),
            Err(StepError::Skipped(skipped)) => skip(hub, &skipped),
            // A recording that begins again shows the empty room again.
            Err(StepError::NoBackground) if recalibrated => {}
            Err(e @ StepError::NoBackground) => return Err(e.to_string()),
        }
    }
}
