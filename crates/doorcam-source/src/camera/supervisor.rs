use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::Duration;

use super::{Backoff, Capture, Fault, FaultKind, Opener, Session};
use crate::{Clock, Condition, Granted, Source, SourceEvent, SourceState};

/// Longest wait in one call, after which the caller can check whether to stop.
const TICK: Duration = Duration::from_millis(200);
/// First and longest delay between attempts to open a camera that is present.
const RETRY: [Duration; 2] = [Duration::from_millis(250), Duration::from_secs(2)];
/// How often to check whether an absent camera is back.
const PROBE: Duration = Duration::from_millis(300);
/// How often a session may check its controls.
const RECHECK: Duration = Duration::from_secs(1);
/// A camera that just started may take this long for its first frame.
const FIRST_FRAME: Duration = Duration::from_millis(1800);
/// A stall is this many frame periods without a frame, but at least a second.
const STALL_PERIODS: f64 = 5.0;
/// A stalled camera is closed and reopened after this many times the limit that made it count as stalled.
const REOPEN_AFTER: u32 = 3;

/// Delivers a camera's frames for as long as the program runs: no fault of the camera ends the source.
pub struct Supervisor<O: Opener, C> {
    opener: O,
    clock: C,
    session: Option<O::Session>,
    /// Events that arose together with the one returned last.
    pending: VecDeque<SourceEvent>,
    condition: Condition,
    backoff: Backoff,
    retry_at: Duration,
    /// Time of the last good frame, or of opening.
    alive_at: Duration,
    recheck_at: Duration,
    patience: Duration,
}

impl<O: Opener, C: Clock> Supervisor<O, C> {
    /// The camera is opened by the first [`Source::next`]. `seed` spreads the attempts of several daemons in time.
    pub fn new(opener: O, clock: C, seed: u64) -> Self {
        let now = clock.now();
        Self {
            opener,
            clock,
            session: None,
            pending: VecDeque::new(),
            condition: Condition { state: SourceState::Opening, reason: None, granted: None },
            backoff: Backoff::new(RETRY[0], RETRY[1], seed),
            retry_at: now,
            alive_at: now,
            recheck_at: now,
            patience: FIRST_FRAME,
        }
    }

    fn open(&mut self) -> SourceEvent {
        let now = self.clock.now();
        if now < self.retry_at {
            self.clock.wait_until(self.retry_at.min(now + TICK));
            return SourceEvent::Nothing;
        }
        let opener = &mut self.opener;
        match guarded(|| opener.open()) {
            Ok(session) => {
                let granted = session.granted().clone();
                self.session = Some(session);
                self.alive_at = self.clock.now();
                self.recheck_at = self.alive_at + RECHECK;
                self.patience = FIRST_FRAME;
                // A camera that is reopened after a stall stays stalled until it delivers a frame.
                let state = match self.condition.state {
                    SourceState::Stalled => SourceState::Stalled,
                    _ => SourceState::Opening,
                };
                let reason = self.condition.reason.take().filter(|_| state == SourceState::Stalled);
                self.now_is(Condition { state, reason, granted: Some(granted) })
            }
            Err(fault) => self.fail(&fault),
        }
    }

    /// Closes the camera and sets the time of the next attempt.
    fn fail(&mut self, fault: &Fault) -> SourceEvent {
        self.close();
        let (state, delay) = match fault.kind {
            FaultKind::Absent => (SourceState::Lost, PROBE),
            FaultKind::Unusable => (SourceState::BackingOff, self.backoff.next_delay()),
        };
        self.retry_at = self.clock.now() + delay;
        self.now_is(Condition { state, reason: Some(fault.reason.clone()), granted: None })
    }

    fn close(&mut self) {
        if let Some(session) = self.session.take() {
            // The v4l crate may panic when a dying device cannot be stopped; the device is closed all the same.
            let _ = guarded(move || {
                drop(session);
                Ok(())
            });
        }
    }

    fn captured(&mut self, capture: Capture) -> SourceEvent {
        if capture.lost > 0 {
            self.pending.push_back(SourceEvent::Lost(capture.lost));
        }
        if capture.superseded > 0 {
            self.pending.push_back(SourceEvent::Superseded(capture.superseded));
        }
        match capture.frame {
            Err(skipped) => self.pending.push_back(SourceEvent::Skipped(skipped)),
            Ok(frame) => {
                self.alive_at = self.clock.now();
                if self.condition.state != SourceState::Streaming {
                    let granted = self.session.as_ref().map(|s| s.granted().clone());
                    self.backoff.reset();
                    self.patience = stall_limit(granted.as_ref());
                    let streaming = self.now_is(Condition { state: SourceState::Streaming, reason: None, granted });
                    self.pending.push_back(streaming);
                }
                self.pending.push_back(SourceEvent::Frame(frame));
            }
        }
        self.pending.pop_front().unwrap_or(SourceEvent::Nothing)
    }

    /// Reports a stall if no good frame has come for too long, and closes the camera for a restart if it goes on.
    fn wanting(&mut self) -> SourceEvent {
        let silent = self.clock.now().saturating_sub(self.alive_at);
        let name = self.opener.name();
        if silent >= self.patience * REOPEN_AFTER {
            // A restart may recover what the driver cannot.
            self.close();
            self.retry_at = self.clock.now();
            return SourceEvent::Nothing;
        }
        if silent >= self.patience && self.condition.state != SourceState::Stalled {
            let reason = format!("{name}: no frame for {:.1} s", silent.as_secs_f64());
            let granted = self.condition.granted.clone();
            return self.now_is(Condition { state: SourceState::Stalled, reason: Some(reason), granted });
        }
        SourceEvent::Nothing
    }

    /// Reports a condition unless it is the current one.
    fn now_is(&mut self, condition: Condition) -> SourceEvent {
        if self.condition == condition {
            return SourceEvent::Nothing;
        }
        self.condition = condition.clone();
        SourceEvent::Condition(condition)
    }

    fn recheck(&mut self) -> Option<SourceEvent> {
        let session = self.session.as_mut().filter(|_| self.clock.now() >= self.recheck_at)?;
        self.recheck_at = self.clock.now() + RECHECK;
        match guarded(|| session.recheck()) {
            Ok(false) => None,
            Ok(true) => {
                let granted = Some(session.granted().clone());
                let condition = Condition { granted, ..self.condition.clone() };
                Some(self.now_is(condition))
            }
            Err(fault) => Some(self.fail(&fault)),
        }
    }
}

impl<O: Opener, C: Clock> Source for Supervisor<O, C> {
    fn next(&mut self) -> Option<SourceEvent> {
        if let Some(event) = self.pending.pop_front() {
            return Some(event);
        }
        if let Some(event) = self.recheck() {
            return Some(event);
        }
        let Some(session) = &mut self.session else { return Some(self.open()) };
        Some(match guarded(|| session.next(TICK)) {
            Ok(Some(capture)) => {
                let event = self.captured(capture);
                // Damaged frames alone count as none.
                match self.wanting() {
                    SourceEvent::Nothing => event,
                    stalled => {
                        self.pending.push_back(stalled);
                        event
                    }
                }
            }
            Ok(None) => self.wanting(),
            Err(fault) => self.fail(&fault),
        })
    }
}

fn stall_limit(granted: Option<&Granted>) -> Duration {
    let fps = granted.map_or(1.0, |g| g.fps.max(0.1));
    Duration::from_secs_f64((STALL_PERIODS / fps).max(1.0))
}

/// Runs a driver library's code: a panic in it is a fault of the camera, not of the program.
fn guarded<T>(work: impl FnOnce() -> Result<T, Fault>) -> Result<T, Fault> {
    catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|_| Err(Fault::unusable("the camera's driver library failed")))
}

#[cfg(test)]
mod tests {
    use std::sync::{Arc, Mutex};

    use super::*;
    use crate::{ManualClock, Purpose, RawFrame, RawImages, SkipKind, SkippedFrame};

    /// What a simulated camera does from a given time on.
    #[derive(Debug, Clone, Copy, PartialEq)]
    enum Doing {
        Frames,
        Silence,
        Damaged,
        Unplugged,
        Busy,
        Panics,
    }

    #[derive(Clone)]
    struct Camera {
        clock: ManualClock,
        plan: Arc<Vec<(u64, Doing)>>,
        sessions: Arc<Mutex<[usize; 2]>>,
        granted: Granted,
    }

    impl Camera {
        fn new(plan: &[(u64, Doing)]) -> Self {
            let granted = Granted {
                node: "/dev/video0".into(),
                card: "Simulated".into(),
                format: "YUYV".into(),
                size: [640, 480],
                fps: 10.0,
                controls: Default::default(),
                mismatches: Vec::new(),
            };
            let sessions = Arc::new(Mutex::new([0, 0]));
            Self { clock: ManualClock::default(), plan: Arc::new(plan.to_vec()), sessions, granted }
        }

        fn doing(&self) -> Doing {
            let now = self.clock.now().as_millis() as u64;
            self.plan.iter().take_while(|&&(from, _)| from <= now).last().unwrap().1
        }

        fn gone(&self) -> Fault {
            Fault::absent("/dev/video0: unplugged")
        }
    }

    struct Open(Camera);

    impl Opener for Camera {
        type Session = Open;

        fn open(&mut self) -> Result<Open, Fault> {
            match self.doing() {
                Doing::Unplugged => Err(self.gone()),
                Doing::Busy => Err(Fault::unusable("/dev/video0: in use")),
                Doing::Panics => panic!("as the driver library does"),
                _ => {
                    self.sessions.lock().unwrap()[0] += 1;
                    Ok(Open(self.clone()))
                }
            }
        }

        fn name(&self) -> &str {
            "/dev/video0"
        }
    }

    impl Drop for Open {
        fn drop(&mut self) {
            self.0.sessions.lock().unwrap()[1] += 1;
            if self.0.doing() == Doing::Panics {
                panic!("as the driver library does");
            }
        }
    }

    impl Session for Open {
        fn granted(&self) -> &Granted {
            &self.0.granted
        }

        fn next(&mut self, wait: Duration) -> Result<Option<Capture>, Fault> {
            let frame = |frame| Ok(Some(Capture { frame, lost: 0, superseded: 0 }));
            let skipped = || SkippedFrame::new("/dev/video0", SkipKind::Damaged, "damaged");
            match self.0.doing() {
                Doing::Frames => {
                    self.0.clock.advance(Duration::from_millis(100));
                    frame(Ok(RawFrame {
                        index: None,
                        purpose: Purpose::Live,
                        seconds: self.0.clock.now().as_secs_f64(),
                        images: RawImages::Camera(Arc::default()),
                        time: None,
                        name: "camera".into(),
                    }))
                }
                Doing::Damaged => {
                    self.0.clock.advance(Duration::from_millis(100));
                    frame(Err(skipped()))
                }
                Doing::Silence | Doing::Busy => {
                    self.0.clock.advance(wait);
                    Ok(None)
                }
                Doing::Unplugged => Err(self.0.gone()),
                Doing::Panics => panic!("as the driver library does"),
            }
        }

        fn recheck(&mut self) -> Result<bool, Fault> {
            Ok(false)
        }
    }

    /// Times, in milliseconds, at which the state changed, and the time of each frame.
    fn run(plan: &[(u64, Doing)], until: u64) -> (Vec<(u64, SourceState)>, Vec<u64>, [usize; 2]) {
        let camera = Camera::new(plan);
        let (clock, sessions) = (camera.clock.clone(), Arc::clone(&camera.sessions));
        let mut source = Supervisor::new(camera, clock.clone(), 7);
        let (mut states, mut frames) = (Vec::new(), Vec::new());
        while (clock.now().as_millis() as u64) < until {
            let event = source.next().expect("it never ends");
            let now = clock.now().as_millis() as u64;
            match event {
                SourceEvent::Frame(_) => frames.push(now),
                SourceEvent::Condition(condition) => {
                    assert_eq!(
                        condition.reason.is_some(),
                        !matches!(condition.state, SourceState::Opening | SourceState::Streaming),
                        "{condition:?}"
                    );
                    if states.last().is_none_or(|&(_, state)| state != condition.state) {
                        states.push((now, condition.state));
                    }
                }
                _ => {}
            }
        }
        drop(source);
        let counts = *sessions.lock().unwrap();
        (states, frames, counts)
    }

    fn states(run: &[(u64, SourceState)]) -> Vec<SourceState> {
        run.iter().map(|&(_, state)| state).collect()
    }

    #[test]
    fn each_fault_is_told_within_two_seconds_and_frames_come_within_three_of_its_end() {
        use SourceState::{BackingOff, Lost, Opening, Stalled, Streaming};
        for (fault, expected) in [
            (Doing::Unplugged, vec![Opening, Streaming, Lost, Opening, Streaming]),
            (Doing::Silence, vec![Opening, Streaming, Stalled, Streaming]),
            (Doing::Damaged, vec![Opening, Streaming, Stalled, Streaming]),
            (Doing::Panics, vec![Opening, Streaming, BackingOff, Opening, Streaming]),
        ] {
            for length in [2000, 7000, 61_000] {
                let plan = [(0, Doing::Frames), (5000, fault), (5000 + length, Doing::Frames)];
                let (seen, frames, [opened, closed]) = run(&plan, 5000 + length + 10_000);
                // A camera that stays silent is also closed and reopened.
                let mut distinct = states(&seen);
                distinct.dedup();
                assert_eq!(distinct, expected, "{fault:?} {length}: {seen:?}");
                let told = seen.iter().find(|&&(_, state)| state == distinct[2]).unwrap().0;
                assert!((5000..=7000).contains(&told), "{fault:?} told at {told}");
                let resumed = *frames.iter().find(|&&t| t >= 5000 + length).unwrap();
                assert!(resumed <= 5000 + length + 3000, "{fault:?} resumed at {resumed}");
                assert_eq!(opened, closed, "{fault:?}");
            }
        }
    }

    #[test]
    fn a_camera_that_is_in_use_is_tried_again_ever_more_rarely() {
        let (seen, frames, _) = run(&[(0, Doing::Busy), (60_000, Doing::Frames)], 65_000);
        assert_eq!(states(&seen)[0], SourceState::BackingOff);
        assert!(frames[0] <= 63_000);
    }

    #[test]
    fn a_slow_start_is_no_stall() {
        let (seen, frames, _) = run(&[(0, Doing::Silence), (1500, Doing::Frames)], 3000);
        assert!(!states(&seen).contains(&SourceState::Stalled) && !frames.is_empty());
    }
}
