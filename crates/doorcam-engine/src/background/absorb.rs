use doorcam_core::geometry::Side;
use doorcam_core::light::{Patch, PatchPair, RollingBackground};

/// Seconds between comparisons.
const EVERY_S: f64 = 0.25;
/// Seconds that a picture is kept without being seen again, beyond the time for which it was seen.
const PATIENCE_S: f64 = 2.0;

/// A picture that may become the new background: something is detected, but it may only be a chair that was moved.
///
/// It accumulates the time for which the room looks just like it. Time in which somebody hides it does not count. Time
/// in which the old background fits is subtracted, since furniture does not come and go. Once it has been seen for long
/// enough, it becomes the background.
#[derive(Debug, Clone)]
pub(super) struct Candidate {
    absorb_s: f64,
    adapt_s: f64,
    picture: Option<Picture>,
    since_s: f64,
}

#[derive(Debug, Clone)]
struct Picture {
    rolling: RollingBackground,
    seen_s: f64,
    /// Seconds for which nothing else has been seen.
    steady_s: f64,
    /// Seconds since it was last seen.
    missed_s: f64,
}

impl Candidate {
    /// Starts without a picture. What does not move for `absorb_s` seconds is absorbed; 0 means never.
    pub fn new(absorb_s: f64, adapt_s: f64) -> Self {
        Self { absorb_s, adapt_s, picture: None, since_s: 0.0 }
    }

    /// Forgets the picture.
    pub fn clear(&mut self) {
        self.picture = None;
    }

    /// Takes note of what lies on the floor now: one side's `pixels` show `patch`.
    pub fn replace_pixels(&mut self, side: Side, pixels: &[bool], patch: &Patch) {
        if let Some(picture) = &mut self.picture {
            let averaged = picture.rolling.averaged();
            picture.rolling.replace_pixels(side, pixels, patch, averaged);
        }
    }

    /// The picture, and how many frames it averages, if nothing else has been seen for this many seconds.
    pub fn steady_for(&self, seconds: f64) -> Option<(&PatchPair, f64)> {
        let picture = self.picture.as_ref().filter(|picture| picture.steady_s >= seconds)?;
        Some((picture.rolling.mean(), picture.rolling.averaged()))
    }

    /// Reports that the old background has fitted again for `step_s` seconds.
    pub fn refute(&mut self, step_s: f64) {
        if let Some(picture) = &mut self.picture {
            picture.seen_s -= step_s;
            if picture.seen_s < 0.0 {
                self.picture = None;
            }
        }
    }

    /// Takes a frame in which something is detected, `step_s` seconds after the previous frame.
    /// `alike(picture, frames)` tells whether the frame differs from `picture`, the mean of `frames` frames, by noise
    /// alone. Returns the new background and how many frames it averages once it has been seen for long enough.
    pub fn observe(
        &mut self,
        pair: &PatchPair,
        step_s: f64,
        mut alike: impl FnMut(&PatchPair, f64) -> bool,
    ) -> Option<(PatchPair, f64)> {
        self.since_s += step_s;
        if self.absorb_s == 0.0 || (self.since_s < EVERY_S && self.picture.is_some()) {
            return None;
        }
        let step_s = std::mem::take(&mut self.since_s);
        let first = || Picture {
            rolling: RollingBackground::from_picture(pair.clone()),
            seen_s: 0.0,
            steady_s: 0.0,
            missed_s: 0.0,
        };
        let picture = self.picture.get_or_insert_with(first);
        if alike(picture.rolling.mean(), picture.rolling.averaged()) {
            picture.seen_s += step_s;
            picture.steady_s += step_s;
            picture.missed_s = 0.0;
            picture.rolling.follow(pair, step_s, self.adapt_s);
        } else {
            picture.missed_s += step_s;
            picture.steady_s = 0.0;
            if picture.missed_s > picture.seen_s + PATIENCE_S {
                *picture = first();
            }
        }
        if picture.seen_s < self.absorb_s {
            return None;
        }
        let Picture { rolling, .. } = self.picture.take()?;
        Some((rolling.mean().clone(), rolling.averaged()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn room(value: f32) -> PatchPair {
        let mut pair = PatchPair::zeros(2);
        pair.left.data_mut().fill(value);
        pair
    }

    fn look(candidate: &mut Candidate, value: f32, seconds: usize) -> Option<usize> {
        let pair = room(value);
        let alike = |mean: &PatchPair, _: f64| (mean.left.data()[0] - value).abs() < 0.1;
        (0..seconds).find(|_| candidate.observe(&pair, 1.0, alike).is_some())
    }

    #[test]
    fn what_does_not_move_is_absorbed_though_people_pass() {
        let mut candidate = Candidate::new(100.0, 60.0);
        assert_eq!(look(&mut candidate, 1.0, 60), None);
        // Somebody passes, in a different place each second.
        (0..20).for_each(|k| assert_eq!(look(&mut candidate, 2.0 + k as f32, 1), None));
        let absorbed = look(&mut candidate, 1.0, 60);
        assert!(absorbed.is_some_and(|s| (38..43).contains(&s)), "{absorbed:?}");
    }

    #[test]
    fn who_comes_and_goes_and_who_walks_is_not() {
        let mut candidate = Candidate::new(100.0, 60.0);
        for _ in 0..10 {
            assert_eq!(look(&mut candidate, 1.0, 60), None);
            candidate.refute(60.0);
        }
        (0..500).for_each(|k| assert_eq!(look(&mut candidate, k as f32, 1), None));
        let mut never = Candidate::new(0.0, 60.0);
        assert_eq!(look(&mut never, 1.0, 10_000), None);
    }
}
