//! By which time history is too old: a clock that was set must not erase it.

use std::time::Duration;

use jiff::{SignedDuration, Timestamp};

/// Readings of a wall clock closer than this, relative to the time that has passed, are of the same clock.
const SAME: SignedDuration = SignedDuration::from_secs(60);
/// How long a clock that was set has to stay as it is before history is deleted by it: long enough for somebody, or for
/// the network's time, to put it right, and short enough that a machine that runs only by day still deletes.
pub(super) const PERSISTS: Duration = Duration::from_secs(6 * 3600);

/// The machine's clocks, or simulated ones in tests.
pub(super) trait Clocks: Send {
    /// The time of day, which anybody may set.
    fn wall(&self) -> Timestamp;

    /// Time since some moment, which nobody can set; it goes on while the machine sleeps.
    fn running(&self) -> Duration;
}

/// The machine's.
#[derive(Debug)]
pub(super) struct System;

impl Clocks for System {
    fn wall(&self) -> Timestamp {
        Timestamp::now()
    }

    fn running(&self) -> Duration {
        use rustix::time::{ClockId, clock_gettime};

        #[cfg(target_os = "linux")]
        let time = clock_gettime(ClockId::Boottime);
        #[cfg(not(target_os = "linux"))]
        let time = clock_gettime(ClockId::Monotonic);
        Duration::try_from(time).unwrap_or_default()
    }
}

/// Knows the time of day by what it was before and how long ago that was, and believes a clock that says otherwise only
/// after it has said so for [`PERSISTS`].
#[derive(Debug, Clone)]
pub(super) struct Believed {
    time: Timestamp,
    at: Duration,
    /// How far the wall clock is off, and since when.
    off: Option<(SignedDuration, Duration)>,
}

impl Believed {
    /// `time` is what it was when this clock had been `running` for so long.
    pub(super) fn new(time: Timestamp, running: Duration) -> Self {
        Self { time, at: running, off: None }
    }

    /// What the time should be.
    pub(super) fn expected(&self, running: Duration) -> Timestamp {
        let passed = SignedDuration::try_from(running.saturating_sub(self.at)).unwrap_or(SignedDuration::MAX);
        self.time.checked_add(passed).unwrap_or(Timestamp::MAX)
    }

    /// Looks at the clocks. Returns how far the wall clock is off, if that is new.
    pub(super) fn look(&mut self, clocks: &dyn Clocks) -> Option<SignedDuration> {
        let (wall, running) = (clocks.wall(), clocks.running());
        let off = wall.duration_since(self.expected(running));
        if off.abs() <= SAME {
            *self = Self::new(wall, running);
            return None;
        }
        match self.off {
            Some((before, since)) if (off - before).abs() <= SAME => {
                if running.saturating_sub(since) >= PERSISTS {
                    *self = Self::new(wall, running);
                }
                None
            }
            _ => {
                self.off = Some((off, running));
                Some(off)
            }
        }
    }

    /// The time by which history is too old: the earlier one in doubt.
    pub(super) fn now(&self, clocks: &dyn Clocks) -> Timestamp {
        self.expected(clocks.running()).min(clocks.wall())
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use std::sync::{Arc, Mutex};

    /// Clocks that a test sets.
    #[derive(Debug, Clone)]
    pub(in super::super) struct Manual(Arc<Mutex<(Timestamp, Duration)>>);

    impl Manual {
        pub(in super::super) fn at(wall: Timestamp) -> Self {
            Self(Arc::new(Mutex::new((wall, Duration::from_secs(1000)))))
        }

        /// Time passes.
        pub(in super::super) fn pass(&self, by: Duration) {
            let mut clocks = self.0.lock().unwrap();
            clocks.0 += by;
            clocks.1 += by;
        }

        /// Somebody sets the wall clock.
        pub(in super::super) fn set(&self, wall: Timestamp) {
            self.0.lock().unwrap().0 = wall;
        }
    }

    impl Clocks for Manual {
        fn wall(&self) -> Timestamp {
            self.0.lock().unwrap().0
        }

        fn running(&self) -> Duration {
            self.0.lock().unwrap().1
        }
    }

    fn at(seconds: i64) -> Timestamp {
        Timestamp::from_second(seconds).unwrap()
    }

    const NOW: i64 = 1_700_000_000;
    const MONTH: i64 = 32 * 86_400;

    #[test]
    fn a_clock_that_leaps_for_a_while_is_not_believed_and_one_that_stays_is() {
        for leap in [MONTH, -MONTH, 3600, -3600, 70 * 12 * MONTH] {
            let clocks = Manual::at(at(NOW));
            let mut believed = Believed::new(at(NOW), clocks.running());
            let mut after = |seconds: u64| {
                clocks.pass(Duration::from_secs(seconds));
                believed.look(&clocks);
                believed.now(&clocks)
            };
            assert_eq!(after(10), at(NOW + 10));
            clocks.set(at(NOW + 10 + leap));
            assert_eq!(after(5), at(NOW + 15 + leap.min(0)), "the earlier one in doubt, {leap}");
            clocks.set(at(NOW + 15));
            assert_eq!(after(5), at(NOW + 20), "as if nothing had been, {leap}");
            clocks.set(at(NOW + 20 + leap));
            after(1);
            let persists = PERSISTS.as_secs();
            assert_eq!(after(persists - 1), at(NOW + 20 + persists as i64 + leap.min(0)), "{leap}");
            assert_eq!(after(1), at(NOW + 21 + persists as i64 + leap), "believed, {leap}");
        }
    }

    #[test]
    fn a_sleep_and_small_corrections_are_no_leap() {
        let clocks = Manual::at(at(NOW));
        let mut believed = Believed::new(at(NOW), clocks.running());
        clocks.pass(Duration::from_secs(3 * 86_400));
        assert_eq!(believed.look(&clocks), None);
        clocks.set(clocks.wall() - SignedDuration::from_secs(20));
        assert_eq!(believed.look(&clocks), None);
        assert_eq!(believed.now(&clocks), clocks.wall());
        clocks.set(clocks.wall() + SignedDuration::from_secs(7200));
        assert_eq!(believed.look(&clocks), Some(SignedDuration::from_secs(7200)));
        assert_eq!(believed.look(&clocks), None, "said once");
    }
}
