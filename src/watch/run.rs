use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use jiff::Timestamp;

use crate::watch::hub::Hub;
use crate::watch::skips::Unended;
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

/// A command to the running frame loop.
pub enum Command {
    /// Continues with this engine, built from another calibration or configuration.
    Use(Box<Engine>),
    /// Learns the empty room again, starting now.
    ResetBackground,
    /// Counts people in these zones from now on.
    UseZones(Vec<Zone>),
    /// The calibration that has followed the camera has this number.
    Revise(u32),
    /// Stops after saving the background.
    End,
}

/// A running frame loop.
pub struct Running {
    control: Control,
    solve: JoinHandle<()>,
}

impl Running {
    /// The handle that commands it.
    pub fn control(&self) -> &Control {
        &self.control
    }

    /// Stops it and waits until the background is saved.
    pub fn end(self) {
        self.control.tell(Command::End);
        // A panic has already been reported when it happened.
        let _ = self.solve.join();
    }
}

/// Sends commands to a running frame loop.
#[derive(Clone)]
pub struct Control(Sender<Command>);

impl Control {
    /// Sends a command, which takes effect before the next frame. Returns false if the loop has ended.
    pub fn tell(&self, command: Command) -> bool {
        self.0.send(command).is_ok()
    }
}

/// After this many panics in a row, calls are delayed.
const PANICS: u32 = 3;

/// While no frame can be used: how long to wait between two of them. At full speed a recording would otherwise be read
/// over and over, as fast as the disk gives it.
const AFTER_UNUSABLE: Duration = Duration::from_millis(20);

/// How often the solver thread looks for commands while no frames come.
const TICK: Duration = Duration::from_millis(100);

/// Starts the capture and the solver thread, which end with the source. Without an engine, frames are only shown
/// until [`Command::Use`] brings one.
///
/// # Errors
/// If a thread cannot be started.
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
            resume: Instant::now(),
            unended: Unended::default(),
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

/// Closes the mailbox when its thread ends, even by a panic, so that the other thread ends too.
struct Closing<'a>(&'a Mailbox<Captured>);

impl Drop for Closing<'_> {
    fn drop(&mut self) {
        self.0.close();
    }
}

fn ended(state: SourceState, reason: Option<String>) -> Condition {
    Condition { state, reason, granted: None }
}

/// What one call of a loop's body did.
enum Step<T> {
    /// The loop is over, with this result.
    Over(T),
    /// It did some work.
    Done,
    /// There was nothing to do.
    Idle,
}

/// Calls `once` until it returns a result. A panic costs only that call: `failed` gets its message, and how long to wait
/// before the next attempt. There is no need to wait before [`PANICS`] attempts in a row have failed.
fn repeat<T, S>(state: &mut S, once: impl Fn(&mut S) -> Step<T>, failed: impl Fn(&mut S, &str, Duration)) -> T {
    let mut backoff = Backoff::new(Duration::from_secs(1), Duration::from_secs(30), 0);
    let mut panics = 0;
    loop {
        // Unwind safety: `failed` marks the state, and the next call repairs what the panic left half-finished.
        match catch_unwind(AssertUnwindSafe(|| once(state))) {
            Ok(Step::Over(result)) => return result,
            Ok(Step::Idle) => {}
            Ok(Step::Done) => {
                panics = 0;
                backoff.reset();
            }
            Err(panic) => {
                panics += 1;
                let text = panic.downcast_ref::<&str>().copied();
                let text = text.or_else(|| panic.downcast_ref::<String>().map(String::as_str));
                let wait = if panics < PANICS { Duration::ZERO } else { backoff.next_delay() };
                failed(state, text.unwrap_or("no message"), wait);
            }
        }
    }
}

/// Reads the source and passes its frames to the solver.
struct Capture<'a> {
    source: Box<dyn Source>,
    mailbox: &'a Mailbox<Captured>,
    hub: &'a Hub,
}

impl Capture<'_> {
    fn run(&mut self) {
        repeat(self, Self::once, |capture, panic, wait| {
            capture.hub.failed(1);
            tracing::error!("the source failed on an internal error: {panic}");
            std::thread::sleep(wait);
        });
    }

    /// Handles one event of the source. Returns a value when the source or the solver has ended.
    fn once(&mut self) -> Step<()> {
        let Some(next) = self.source.next() else { return Step::Over(()) };
        if self.mailbox.is_closed() {
            return Step::Over(());
        }
        let Self { source, mailbox, hub } = self;
        match next {
            SourceEvent::Frame(frame) => {
                let time = frame.time.unwrap_or_else(Timestamp::now);
                hub.captured(&frame, time);
                match mailbox.put(Captured { frame, time }, source.lossless()) {
                    Put::Alone => {}
                    Put::Instead(_) => hub.dropped(1),
                    Put::Closed => return Step::Over(()),
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
            SourceEvent::Nothing => return Step::Idle,
        }
        Step::Done
    }
}

/// Logs a change of the source's condition; `before` is its previous state.
fn tell(condition: &Condition, before: SourceState) {
    let Some(granted) = &condition.granted else {
        condition.reason.iter().for_each(|reason| tracing::warn!("{reason}"));
        if condition.state == SourceState::Streaming && before == SourceState::Lost {
            tracing::info!("frames come again");
        }
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

/// Counts a frame that could not be used, and logs it unless a line about frames of its kind is less than a minute old.
fn skip(hub: &Hub, skipped: &SkippedFrame) {
    match hub.skipped(skipped) {
        None => {}
        Some((total, 1)) => tracing::warn!("skipped a frame, {total} by now: {skipped}"),
        Some((total, new)) => tracing::warn!("skipped {new} frames, {total} by now: the last is {skipped}"),
    }
}

/// Solves captured frames and carries out commands between them.
struct Solver<'a> {
    engine: Option<Engine>,
    mailbox: &'a Mailbox<Captured>,
    hub: &'a Hub,
    commands: Receiver<Command>,
    /// Whether frames of the empty room may have been missed, before a new engine or because of a panic.
    may_lack_background: bool,
    /// Whether a panic may have left the engine half-finished.
    rebuild: bool,
    /// No frame is worked on before this time.
    resume: Instant,
    /// JPEGs without an end marker.
    unended: Unended,
    /// Name of the current frame.
    frame: Option<Arc<str>>,
}

impl Solver<'_> {
    /// Solves frames until there are no more. Fails if there is no background for them.
    fn run(&mut self) -> Result<(), String> {
        repeat(self, Self::once, |solver, panic, wait| {
            (solver.rebuild, solver.may_lack_background) = (true, true);
            let frame = solver.frame.take();
            let frame = frame.as_deref().unwrap_or("between two frames");
            solver.hub.failed(1);
            solver.resume = Instant::now() + wait;
            tracing::error!("{frame}: an internal error ({panic}): this frame is lost, and the engine is rebuilt");
        })
    }

    /// Handles commands and at most one frame. Returns a value at the end.
    fn once(&mut self) -> Step<Result<(), String>> {
        // Of several engines that have come meanwhile, only the newest is started.
        let mut newest = None;
        while let Ok(command) = self.commands.try_recv() {
            if let Command::Use(next) = command {
                newest = Some(next);
                continue;
            }
            newest.take().into_iter().for_each(|next| self.go_on_with(*next));
            match command {
                Command::Use(_) => {}
                Command::UseZones(zones) => self.engine.iter_mut().for_each(|engine| engine.use_zones(zones.clone())),
                Command::Revise(revision) => {
                    if let Some(engine) = &mut self.engine {
                        engine.revise(revision);
                        self.hub.watch(engine.watched());
                    }
                }
                Command::ResetBackground => self.engine.iter_mut().for_each(Engine::reset_background),
                Command::End => return Step::Over(Ok(())),
            }
        }
        newest.into_iter().for_each(|next| self.go_on_with(*next));
        // Commands are carried out meanwhile, and the mailbox keeps what must be kept.
        let wait = self.resume.saturating_duration_since(Instant::now());
        if !wait.is_zero() {
            std::thread::sleep(wait.min(TICK));
            return Step::Idle;
        }
        if self.rebuild {
            self.engine.iter_mut().for_each(Engine::rebuild);
            self.engine.iter_mut().for_each(|engine| engine.use_zones(self.hub.zones()));
            self.rebuild = false;
        }
        let Captured { frame, time } = match self.mailbox.take(TICK) {
            Taken::Item(captured) => captured,
            Taken::Nothing => return Step::Idle,
            Taken::Closed => return Step::Over(Ok(())),
        };
        let Some(engine) = &mut self.engine else { return Step::Idle };
        self.frame = Some(Arc::clone(&frame.name));
        let solved = engine.step(&frame, time);
        if let Some(calibration) = engine.take_followed() {
            self.hub.followed(engine.watched().calibration, calibration);
        }
        if let Some(count) = self.unended.counted(engine.without_end_marker(), Instant::now()) {
            let name = &frame.name;
            tracing::warn!("{name}: JPEGs without their end marker: {count} more; all else is there, so they are used");
        }
        match solved {
            Ok(published) => self.hub.publish(published),
            Err(StepError::Skipped(skipped)) => {
                skip(self.hub, &skipped);
                let (trouble, news) = self.hub.unusable(&skipped);
                news.iter().for_each(|reason| tracing::warn!("{reason}"));
                if trouble {
                    self.resume = Instant::now() + AFTER_UNUSABLE;
                }
            }
            // A looped recording will show the empty room again.
            Err(StepError::NoBackground) if self.may_lack_background => {}
            Err(e @ StepError::NoBackground) => return Step::Over(Err(e.to_string())),
        }
        self.frame = None;
        Step::Done
    }

    fn go_on_with(&mut self, mut next: Engine) {
        self.hub.watch(next.watched());
        if let Some(engine) = self.engine.take() {
            next.continue_from(engine);
        }
        // The engine was built with the zones of the program's start.
        next.use_zones(self.hub.zones());
        self.engine = Some(next);
        (self.may_lack_background, self.rebuild) = (true, false);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_costs_one_call_and_only_many_in_a_row_make_it_wait() {
        // Calls 2, 3 and 5 fail in a row, for call 4 is idle. Call 8 fails alone.
        let mut state = (0, Vec::new());
        let end = repeat(
            &mut state,
            |(calls, _)| {
                *calls += 1;
                match calls {
                    2 => panic!("two"),
                    3 | 5 | 8 => panic!("call {calls}"),
                    4 => Step::Idle,
                    9 => Step::Over(*calls),
                    _ => Step::Done,
                }
            },
            |(_, told), panic, wait| told.push((panic.to_owned(), wait.is_zero())),
        );
        let told = |text: &str, at_once| (text.to_owned(), at_once);
        assert_eq!(state.1, [told("two", true), told("call 3", true), told("call 5", false), told("call 8", true)]);
        assert_eq!(end, 9);
    }
}
