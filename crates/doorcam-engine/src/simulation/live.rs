use std::sync::Arc;
use std::time::Duration;

use super::Simulator;
use doorcam_source::{Clock, Pace, Source, SourceEvent};

/// How a scenario is played.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LiveOptions {
    /// At the scenario's pace, or as fast as frames are made and consumed.
    pub pace: Pace,
    /// Whether to end after one round.
    pub once: bool,
}

/// A scenario as a camera: frame k is delivered k / fps seconds after the start. Frames that would be late are left
/// out.
pub struct LiveSimulation<C> {
    simulator: Arc<Simulator>,
    options: LiveOptions,
    clock: C,
    start: Option<Duration>,
    next: u64,
}

impl<C: Clock> LiveSimulation<C> {
    /// The time starts with the first frame that is asked for.
    pub fn new(simulator: Arc<Simulator>, options: LiveOptions, clock: C) -> Self {
        Self { simulator, options, clock, start: None, next: 0 }
    }
}

impl<C: Clock> Source for LiveSimulation<C> {
    fn next(&mut self) -> Option<SourceEvent> {
        let scenario = self.simulator.scenario();
        let end = if self.options.once { scenario.frames() } else { u64::MAX };
        let start = *self.start.get_or_insert_with(|| self.clock.now());
        let fps = scenario.fps;
        if self.options.pace == Pace::Recorded {
            // Skip to the frame that is due now; earlier ones are never made.
            let due = (self.clock.now().saturating_sub(start).as_secs_f64() * fps) as u64;
            let newest = due.min(end.saturating_sub(1));
            if newest > self.next {
                let late = newest - self.next;
                self.next = newest;
                return Some(SourceEvent::Superseded(late));
            }
        }
        if self.next >= end {
            return None;
        }
        let number = self.next;
        self.next += 1;
        let frame = self.simulator.frame(number);
        if self.options.pace == Pace::Recorded {
            // Counted from the start, so that rounding errors do not add up.
            self.clock.wait_until(start + Duration::from_secs_f64(number as f64 / fps));
        }
        Some(frame.map_or_else(SourceEvent::Skipped, SourceEvent::Frame))
    }

    fn lossless(&self) -> bool {
        self.options.pace == Pace::Max
    }
}

#[cfg(test)]
mod tests {
    use super::super::Scenario;
    use super::super::scenario::SMALLEST;
    use super::*;
    use doorcam_source::{ManualClock, Purpose};

    fn source(pace: Pace, once: bool) -> (LiveSimulation<ManualClock>, ManualClock) {
        let text = SMALLEST.replace("[camera]", "[camera]\nsize = [32, 32]\nlayout = \"patches\"");
        let simulator = Simulator::new(Scenario::parse(&text).unwrap(), 1).unwrap();
        let clock = ManualClock::default();
        clock.advance(Duration::from_secs(50));
        (LiveSimulation::new(Arc::new(simulator), LiveOptions { pace, once }, clock.clone()), clock)
    }

    /// Index, purpose, and milliseconds since the start.
    fn frame(source: &mut LiveSimulation<ManualClock>, clock: &ManualClock) -> (u64, Purpose, u128) {
        match source.next() {
            Some(SourceEvent::Frame(frame)) => (frame.index.unwrap(), frame.purpose, clock.now().as_millis() - 50_000),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn frames_come_at_their_times_and_rounds_begin_with_the_empty_room() {
        let (mut source, clock) = source(Pace::Recorded, false);
        let seen: Vec<_> = (0..21).map(|_| frame(&mut source, &clock)).collect();
        assert_eq!(seen[0], (0, Purpose::Background, 0));
        assert_eq!(seen[4], (4, Purpose::Background, 800));
        assert_eq!(seen[5], (5, Purpose::Watch, 1000));
        assert_eq!(seen[20], (0, Purpose::Background, 4000));
    }

    #[test]
    fn who_is_late_gets_the_newest_frame_and_the_number_of_those_left_out() {
        let (mut source, clock) = source(Pace::Recorded, false);
        frame(&mut source, &clock);
        clock.advance(Duration::from_millis(1300));
        assert_eq!(source.next(), Some(SourceEvent::Superseded(5)));
        assert_eq!(frame(&mut source, &clock), (6, Purpose::Watch, 1300));
        assert_eq!(frame(&mut source, &clock), (7, Purpose::Watch, 1400));
    }

    #[test]
    fn at_full_rate_every_frame_of_a_round_comes_and_then_none() {
        let (mut source, clock) = source(Pace::Max, true);
        for index in 0..20 {
            assert_eq!(frame(&mut source, &clock).0, index);
        }
        assert_eq!((source.next(), clock.now().as_millis()), (None, 50_000));
    }
}
