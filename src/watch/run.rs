use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;
use std::time::Duration;

use jiff::Timestamp;

use crate::watch::hub::Hub;
use crate::watch::{Mailbox, Put, Taken};
use doorcam_core::tracking::Zone;
use doorcam_engine::{Engine, StepError};
use doorcam_source::camera::Backoff;
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

/// So many panics in a row are not bad luck any more.
const PANICS: u32 = 3;

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
            Capture { source, mailbox: &mailbox, hub: &hub }.run();
        })?
    };
    let solve = std::thread::Builder::new().name("solve".into()).spawn(move || {
        let _closing = Closing(&mailbox);
        let mut solver = Solver {
            engine,
            mailbox: &mailbox,
            hub: &hub,
            commands,
            may_lack_background: false,
            rebuild: false,
            frame: None,
        };
        match solver.run() {
            Ok(()) => hub.condition(ended(SourceState::Ended, None)),
            Err(error) => {
                tracing::error!("{error}");
                hub.condition(ended(SourceState::Failed, Some(error)));
            }
        }
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

fn ended(state: SourceState, reason: Option<String>) -> Condition {
    Condition { state, reason, granted: None }
}

/// Runs `once` until it says how it ended. A panic in it costs that one call: `failed` is told of it, with its message, and
/// after [`PANICS`] in a row each further call waits longer.
fn repeat<T, S>(state: &mut S, once: impl Fn(&mut S) -> Option<T>, failed: impl Fn(&mut S, &str)) -> T {
    let mut backoff = Backoff::new(Duration::from_secs(1), Duration::from_secs(30), 0);
    let mut panics = 0;
    loop {
        // What a panic may have left half done is the state's to mend: `failed` says so.
        match catch_unwind(AssertUnwindSafe(|| once(state))) {
            Ok(Some(end)) => return end,
            Ok(None) => {
                panics = 0;
                backoff.reset();
            }
            Err(panic) => {
                panics += 1;
                let text = panic.downcast_ref::<&str>().copied();
                let text = text.or_else(|| panic.downcast_ref::<String>().map(String::as_str));
                failed(state, text.unwrap_or("no message"));
                if panics >= PANICS {
                    std::thread::sleep(backoff.next_delay());
                }
            }
        }
    }
}

/// Takes what the source gives and hands it on.
struct Capture<'a> {
    source: Box<dyn Source>,
    mailbox: &'a Mailbox<Captured>,
    hub: &'a Hub,
}

impl Capture<'_> {
    fn run(&mut self) {
        repeat(self, Self::once, |capture, panic| {
            capture.hub.failed(1);
            tracing::error!("the source failed on an internal error: {panic}");
        });
    }

    /// The next thing that the source says; something when there will be no more, or nobody wants it.
    fn once(&mut self) -> Option<()> {
        let Some(next) = self.source.next() else { return Some(()) };
        if self.mailbox.is_closed() {
            return Some(());
        }
        let Self { source, mailbox, hub } = self;
        match next {
            SourceEvent::Frame(frame) => {
                let time = frame.time.unwrap_or_else(Timestamp::now);
                hub.captured(&frame, time);
                match mailbox.put(Captured { frame, time }, source.lossless()) {
                    Put::Alone => {}
                    Put::Instead(_) => hub.dropped(1),
                    Put::Closed => return Some(()),
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
        None
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

/// Works on captured frames, and does what it is told between two of them.
struct Solver<'a> {
    engine: Option<Engine>,
    mailbox: &'a Mailbox<Captured>,
    hub: &'a Hub,
    commands: Receiver<Command>,
    /// Whether frames of the empty room may have gone by unlearned: before another calibration, or in a panic.
    may_lack_background: bool,
    /// Whether a panic may have left the engine half done.
    rebuild: bool,
    /// The frame that is worked on.
    frame: Option<Arc<str>>,
}

impl Solver<'_> {
    /// Solves frames until there are no more; an error if none of them can be solved.
    fn run(&mut self) -> Result<(), String> {
        repeat(self, Self::once, |solver, panic| {
            (solver.rebuild, solver.may_lack_background) = (true, true);
            let frame = solver.frame.take();
            let frame = frame.as_deref().unwrap_or("between two frames");
            solver.hub.failed(1);
            tracing::error!("{frame}: an internal error ({panic}): this frame is lost, and the engine is built anew");
        })
    }

    /// At most one frame; something when it is over.
    fn once(&mut self) -> Option<Result<(), String>> {
        if self.rebuild {
            self.engine.iter_mut().for_each(Engine::rebuild);
            self.engine.iter_mut().for_each(|engine| engine.use_zones(self.hub.zones()));
            self.rebuild = false;
        }
        while let Ok(command) = self.commands.try_recv() {
            match command {
                Command::Use(next) => self.go_on_with(*next),
                Command::UseZones(zones) => self.engine.iter_mut().for_each(|engine| engine.use_zones(zones.clone())),
                Command::ResetBackground => self.engine.iter_mut().for_each(Engine::reset_background),
                Command::End => return Some(Ok(())),
            }
        }
        let Captured { frame, time } = match self.mailbox.take(TICK) {
            Taken::Item(captured) => captured,
            Taken::Nothing => return None,
            Taken::Closed => return Some(Ok(())),
        };
        let engine = self.engine.as_mut()?;
        self.frame = Some(Arc::clone(&frame.name));
        let solved = engine.step(&frame, time);
        match solved {
            Ok(published) => self.hub.publish(published),
            Err(StepError::Skipped(skipped)) => skip(self.hub, &skipped),
            // A recording that begins again shows the empty room again.
            Err(StepError::NoBackground) if self.may_lack_background => {}
            Err(e @ StepError::NoBackground) => return Some(Err(e.to_string())),
        }
        self.frame = None;
        None
    }

    fn go_on_with(&mut self, mut next: Engine) {
        self.hub.watch(next.watched());
        if let Some(engine) = self.engine.take() {
            next.continue_from(engine);
        }
        // It was made with the zones of the start.
        next.use_zones(self.hub.zones());
        self.engine = Some(next);
        self.may_lack_background = true;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_costs_one_call_and_is_told_with_its_message() {
        // Calls 2 and 3 fail, the second with a formatted message; the fifth is the end.
        let mut state = (0, Vec::new());
        let end = repeat(
            &mut state,
            |(calls, _)| {
                *calls += 1;
                match calls {
                    2 => panic!("two"),
                    3 => panic!("call {calls}"),
                    5 => Some(*calls),
                    _ => None,
                }
            },
            |(_, told), panic| told.push(panic.to_owned()),
        );
        assert_eq!((end, state.1), (5, vec!["two".to_owned(), "call 3".to_owned()]));
    }
}
