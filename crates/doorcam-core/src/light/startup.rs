use std::collections::VecDeque;

use crate::light::stillness::{Cells, noise_variance, restlessness};
use crate::light::{Background, PatchPair};

/// Moments kept for the background's statistics, for the last seconds and for the whole time each.
const MOMENTS: usize = 48;
/// Largest restlessness of a still room. Above 1, because lamps drift a little.
const STILL: f64 = 2.0;
/// Largest squared difference, in units of twice the noise variance, between two moments of the same room.
const SAME: f64 = 2.5;
/// Fewest moments that give useful statistics.
const FEW: usize = 4;

/// How long to learn the empty room.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StartupSpec {
    /// Seconds for which the room must have been still.
    pub still_s: f64,
    /// Smallest number of frames in that time.
    pub frames: usize,
    /// Seconds after which learning ends even if the room was never still.
    pub most_s: f64,
    /// Seconds between frames with independent noise; 0 if frames are not averaged.
    pub apart_s: f64,
}

/// Learns the empty room from a live camera, without being told when it is empty: from the first seconds without
/// motion.
///
/// While somebody walks through, it waits. If the room is never still, it takes the picture that came back most often
/// when the time is up, since people move and rooms do not. Only somebody who stands perfectly still the whole time is
/// taken for furniture.
#[derive(Debug, Clone)]
pub struct Startup {
    spec: StartupSpec,
    counted: [Vec<bool>; 2],
    began: Option<f64>,
    last_s: f64,
    /// Moments of the last seconds.
    recent: VecDeque<Moment>,
    /// Moments since the beginning, thinned out as time goes on.
    sparse: Vec<Moment>,
    sparse_step_s: f64,
}

#[derive(Debug, Clone)]
struct Moment {
    seconds: f64,
    cells: Cells,
    pair: PatchPair,
}

/// Result of [`Startup`].
#[derive(Debug, Clone)]
pub struct Learned {
    /// The empty room.
    pub background: Background,
    /// Whether the room was still. Otherwise the background is the picture that came back most often.
    pub still: bool,
}

impl Startup {
    /// Starts learning. `counted` says per side which pixels count.
    pub fn new(spec: StartupSpec, counted: [Vec<bool>; 2]) -> Self {
        Self {
            sparse_step_s: spec.apart_s.max(spec.most_s / (2 * MOMENTS) as f64),
            spec,
            counted,
            began: None,
            last_s: f64::NEG_INFINITY,
            recent: VecDeque::new(),
            sparse: Vec::new(),
        }
    }

    /// Adds a frame, captured at `seconds` on the source's clock. Restarts learning if time runs backwards.
    pub fn push(&mut self, pair: &PatchPair, seconds: f64) {
        if seconds < self.last_s {
            *self = Self::new(self.spec, std::mem::take(&mut self.counted));
        }
        self.began.get_or_insert(seconds);
        self.last_s = seconds;
        let step = (self.needed_s() / MOMENTS as f64).max(self.spec.apart_s);
        // Slightly less than the step: otherwise, with capture jitter, frames one step apart would be thinned to every
        // second one.
        let due = |last: Option<&Moment>, step: f64| last.is_none_or(|m| seconds - m.seconds >= 0.9 * step);
        let (now, later) = (due(self.recent.back(), step), due(self.sparse.last(), self.sparse_step_s));
        if !now && !later {
            return;
        }
        let moment = Moment { seconds, cells: Cells::of(pair, &self.counted), pair: pair.clone() };
        if later {
            self.sparse.push(moment.clone());
            if self.sparse.len() > MOMENTS {
                let mut k = 0;
                self.sparse.retain(|_| {
                    k += 1;
                    k % 2 == 1
                });
                self.sparse_step_s *= 2.0;
            }
        }
        if now {
            self.recent.push_back(moment);
            let from = seconds - self.needed_s() - step / 2.0;
            while self.recent.front().is_some_and(|m| m.seconds < from) && self.recent.len() > self.spec.frames {
                self.recent.pop_front();
            }
            // A limit on memory, however irregularly frames arrive.
            while self.recent.len() > 2 * MOMENTS.max(self.spec.frames) {
                self.recent.pop_front();
            }
        }
    }

    /// The learned background, once the room was still for long enough or the time is up.
    pub fn learned(&self) -> Option<Learned> {
        let (first, last) = (self.recent.front()?, self.recent.back()?);
        // n frames span only n − 1 steps, so one step is added below.
        let step = (last.seconds - first.seconds) / (self.recent.len() - 1).max(1) as f64;
        let long =
            self.recent.len() >= self.spec.frames && last.seconds - first.seconds + step >= self.needed_s() - 1e-6;
        if long && restlessness(self.recent.iter().map(|m| &m.cells)) < STILL {
            return Some(Learned { background: background(self.recent.iter()), still: true });
        }
        (self.passed_s() >= self.spec.most_s.max(self.needed_s()) && self.recent.len() >= self.spec.frames)
            .then(|| Learned { background: self.most_often(), still: false })
    }

    /// A first picture of the room for use until it is learned: from the newest moments, once they span half the time
    /// without motion. Whoever stands still for so short a time is in it.
    pub fn preliminary(&self) -> Option<Background> {
        let last = self.recent.back()?.seconds;
        let long = 0.5 * self.needed_s();
        let from = self.recent.iter().rposition(|m| last - m.seconds >= long - 1e-6)?;
        let moments = self.recent.range(from..);
        let still = moments.len() >= FEW && restlessness(moments.clone().map(|m| &m.cells)) < STILL;
        still.then(|| background(moments))
    }

    /// Progress through the time that a still room takes, 0 to 1; stays 1 while waiting for the room to be still.
    pub fn progress(&self) -> f64 {
        let frames = self.recent.len() as f64 / self.spec.frames.max(1) as f64;
        (self.passed_s() / self.needed_s()).min(frames).clamp(0.0, 1.0)
    }

    /// Number of frames in the current window.
    pub fn frames(&self) -> u64 {
        self.recent.len() as u64
    }

    fn passed_s(&self) -> f64 {
        self.began.map_or(0.0, |began| self.last_s - began)
    }

    /// Seconds for which the room must be still: long enough for `frames` independent frames.
    fn needed_s(&self) -> f64 {
        self.spec.still_s.max(self.spec.apart_s * self.spec.frames as f64)
    }

    /// The background from the moments nearest to the one that most other moments resemble.
    fn most_often(&self) -> Background {
        let noise = noise_variance(self.recent.iter().map(|m| &m.cells));
        let moments: Vec<&Moment> =
            if self.sparse.len() < FEW { self.recent.iter().collect() } else { self.sparse.iter().collect() };
        let like = |a: &Moment| moments.iter().filter(|b| a.cells.distance2(&b.cells) <= SAME * 2.0 * noise).count();
        // Ties go to the latest.
        let Some(middle) = moments.iter().max_by_key(|m| like(m)) else {
            return background(self.recent.iter());
        };
        let mut nearest = moments.clone();
        nearest.sort_by(|a, b| middle.cells.distance2(&a.cells).total_cmp(&middle.cells.distance2(&b.cells)));
        nearest.truncate(like(middle).max(FEW));
        // Statistics expect frames in order of time.
        nearest.sort_by(|a, b| a.seconds.total_cmp(&b.seconds));
        background(nearest.into_iter())
    }
}

fn background<'a>(moments: impl Iterator<Item = &'a Moment> + Clone) -> Background {
    let size = moments.clone().next().map_or(0, |m| m.pair.left.size());
    let mut background = Background::new(size);
    moments.for_each(|m| background.learn(&m.pair));
    background
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Side;
    use crate::light::NoiseModel;
    use crate::light::noise::tests::{SIZE, all, frames};

    const NOISE: NoiseModel = NoiseModel { read: 4e-6, shot: 0.0 };
    const SPEC: StartupSpec = StartupSpec { still_s: 5.0, frames: 12, most_s: 30.0, apart_s: 0.0 };

    /// The empty room with somebody at a position along the columns, 0 to 1.
    fn with_person(empty: &PatchPair, person: Option<f64>) -> PatchPair {
        let mut pair = empty.clone();
        for side in Side::BOTH {
            for (k, value) in pair.side_mut(side).data_mut().iter_mut().enumerate() {
                let column = (k % SIZE) as f64 / SIZE as f64;
                *value -= person.map_or(0.0, |at| 0.01 / (1.0 + (-20.0 * (column - at)).exp())) as f32;
            }
        }
        pair
    }

    /// Runs a start at 10 frames a second; returns when it was done and what it learned.
    fn run(spec: StartupSpec, person: impl Fn(f64) -> Option<f64>) -> (f64, Learned) {
        let empty = frames(600, NOISE, 0.0);
        let mut startup = Startup::new(spec, all());
        for (k, empty) in empty.iter().enumerate() {
            let seconds = 100.0 + 0.1 * k as f64;
            startup.push(&with_person(empty, person(seconds - 100.0)), seconds);
            assert!(startup.recent.len() <= 2 * MOMENTS && startup.sparse.len() <= MOMENTS);
            if let Some(learned) = startup.learned() {
                assert!(startup.progress() > 0.9);
                return (seconds - 100.0, learned);
            }
        }
        panic!("never done");
    }

    /// Largest trace of the person in the learned background, relative to their full strength.
    fn baked_in(learned: &Learned) -> f64 {
        let truth = &frames(1, NoiseModel { read: 0.0, shot: 0.0 }, 0.0)[0];
        let column = |pair: &PatchPair, j: usize| {
            let rows = (0..SIZE).map(|i| f64::from(pair.left.plane(0)[i * SIZE + j]));
            rows.sum::<f64>() / SIZE as f64
        };
        let mean = learned.background.mean();
        (0..SIZE).map(|j| (column(mean, j) - column(truth, j)).abs() / 0.01).fold(0.0, f64::max)
    }

    #[test]
    fn a_still_room_takes_the_time_that_is_asked_for() {
        let (seconds, learned) = run(SPEC, |_| None);
        assert!((4.8..5.4).contains(&seconds), "{seconds}");
        assert!(learned.still && learned.background.frames() >= 40, "{learned:?}");
    }

    #[test]
    fn who_walks_through_at_the_start_is_waited_for_and_not_learned() {
        let walk = |t: f64| (1.0..4.0).contains(&t).then_some((t - 1.0) / 3.0);
        let (seconds, learned) = run(SPEC, walk);
        assert!((8.0..10.0).contains(&seconds), "{seconds}");
        assert!(learned.still && baked_in(&learned) < 0.15, "{}", baked_in(&learned));
    }

    #[test]
    fn who_keeps_walking_through_ends_the_wait_and_is_not_learned() {
        // In sight for three of every five seconds, each time at a different place.
        let walk = |t: f64| (t % 5.0 < 3.0).then(|| (0.5 + 0.37 * t) % 1.0);
        let (seconds, learned) = run(SPEC, walk);
        assert!((30.0..31.0).contains(&seconds), "{seconds}");
        assert!(!learned.still && learned.background.frames() >= 4);
        assert!(baked_in(&learned) < 0.2, "{}", baked_in(&learned));
    }

    #[test]
    fn half_the_time_without_motion_gives_a_first_picture() {
        let empty = frames(100, NOISE, 0.0);
        let mut startup = Startup::new(SPEC, all());
        let mut first = None;
        for (k, frame) in empty.iter().enumerate() {
            let seconds = 0.1 * k as f64;
            // In sight for the first second and a half.
            let person = (seconds < 1.5).then_some(seconds / 1.5);
            startup.push(&with_person(frame, person), seconds);
            if let Some(background) = startup.preliminary() {
                first.get_or_insert((seconds, background));
            }
        }
        let (seconds, background) = first.expect("a first picture");
        assert!((3.8..4.5).contains(&seconds), "{seconds}");
        let learned = Learned { background, still: true };
        assert!(baked_in(&learned) < 0.3, "{}", baked_in(&learned));
    }

    #[test]
    fn independent_frames_take_their_time() {
        let (seconds, learned) = run(StartupSpec { apart_s: 0.7, ..SPEC }, |_| None);
        assert!((7.5..9.2).contains(&seconds), "{seconds}");
        assert!((12..14).contains(&learned.background.frames()));
    }

    #[test]
    fn few_frames_a_second_are_enough_and_time_that_runs_backwards_begins_anew() {
        let empty = frames(30, NOISE, 0.0);
        let mut startup = Startup::new(SPEC, all());
        for (k, frame) in empty.iter().enumerate() {
            startup.push(frame, k as f64);
            assert_eq!(startup.learned().is_some(), k >= 11, "frame {k}");
        }
        startup.push(&empty[0], 0.0);
        assert!(startup.learned().is_none() && startup.frames() == 1);
    }
}
