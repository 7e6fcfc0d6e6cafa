use doorcam_core::geometry::Side;
use doorcam_core::light::{Patch, PatchPair, Usable};

/// A covered pixel is still while its grey level differs from its mean by at most this many standard deviations of the
/// floor's noise, plus `UNEVEN` of the level: light and people in the room change what lies on the floor, too.
const NOISY: f32 = 6.0;
const UNEVEN: f32 = 0.04;
/// What covers a patch stays if this share of its covered pixels is still. Legs show little else than still pixels,
/// but for their edges.
const STAYS: f64 = 0.8;
/// A pixel that shows the floor loses this many seconds for each second for which it was covered: edges flicker.
const FORGET: f32 = 2.0;

/// What lies on the floor: a picture of the pixels that do not show it, until they have been still for the set time and
/// become part of the background, patch by patch.
#[derive(Debug, Clone)]
pub(super) struct Cover {
    cover_s: f32,
    sides: [Covered; 2],
}

#[derive(Debug, Clone)]
struct Covered {
    /// Mean picture since each pixel was last seen to change.
    mean: Patch,
    /// Seconds for which each pixel has been covered and still; 0 if it is not covered.
    still_s: Vec<f32>,
    /// Frames in the newest pixel's mean, at least.
    frames: f64,
    covered: usize,
    ready: usize,
}

impl Cover {
    /// Starts with nothing covered, for patches of `size` x `size` pixels. What is still for `cover_s` seconds stays.
    pub fn new(cover_s: f64, size: usize) -> Self {
        let none =
            || Covered { mean: Patch::zeros(size), still_s: vec![0.0; size * size], frames: 0.0, covered: 0, ready: 0 };
        Self { cover_s: cover_s as f32, sides: [none(), none()] }
    }

    /// Forgets everything: frames are missing, or another background is in use.
    pub fn clear(&mut self) {
        self.sides.iter_mut().for_each(Covered::clear);
    }

    /// Takes a frame, `step_s` seconds after the previous one. `usable` are the pixels that show the floor, of those
    /// that are `counted`; `noise` is the standard deviation of each side's grey level.
    pub fn observe(
        &mut self,
        pair: &PatchPair,
        usable: &Usable,
        counted: &[Vec<bool>; 2],
        step_s: f64,
        noise: [f64; 2],
    ) {
        let (step_s, cover_s) = (step_s as f32, self.cover_s);
        for (s, side) in Side::BOTH.into_iter().enumerate() {
            let floor = usable.side(side);
            self.sides[s].observe(pair.side(side), floor, &counted[s], step_s, cover_s, NOISY * noise[s] as f32);
        }
    }

    /// Whether what covers one side's patch stays.
    pub fn stays(&self, side: Side) -> bool {
        let Covered { ready, covered, .. } = self.sides[side as usize];
        ready > 0 && ready as f64 >= STAYS * covered as f64
    }

    /// Says in `pixels` which of one side's have been still for long enough. Returns their picture and the number of
    /// frames that it averages. They count as not covered from now on.
    pub fn take(&mut self, side: Side, pixels: &mut [bool]) -> (&Patch, f64) {
        let covered = &mut self.sides[side as usize];
        for (pixel, still_s) in pixels.iter_mut().zip(&mut covered.still_s) {
            *pixel = *still_s >= self.cover_s;
            if *pixel {
                *still_s = 0.0;
            }
        }
        (covered.ready, covered.covered) = (0, 0);
        (&covered.mean, covered.frames)
    }
}

impl Covered {
    fn clear(&mut self) {
        self.still_s.fill(0.0);
        (self.covered, self.ready, self.frames) = (0, 0, 0.0);
    }

    fn observe(&mut self, patch: &Patch, floor: &[bool], counted: &[bool], step_s: f32, cover_s: f32, noise: f32) {
        (self.covered, self.ready) = (0, 0);
        for k in (0..floor.len()).filter(|&k| counted[k]) {
            let still_s = self.still_s[k];
            if floor[k] {
                self.still_s[k] = (still_s - FORGET * step_s).max(0.0);
                continue;
            }
            self.covered += 1;
            let rgb = [0, 1, 2].map(|p| patch.plane(p)[k]);
            let mean = [0, 1, 2].map(|p| self.mean.plane(p)[k]);
            let level = mean.iter().sum::<f32>() / 3.0;
            let changed = (rgb.iter().sum::<f32>() / 3.0 - level).abs() > noise + UNEVEN * level;
            let (share, still_s) = if still_s == 0.0 || changed {
                // Not 0, which would mean that it is not covered.
                (1.0, f32::MIN_POSITIVE)
            } else {
                let still_s = still_s + step_s;
                (step_s / still_s.min(cover_s), still_s)
            };
            for (p, now) in rgb.into_iter().enumerate() {
                let value = &mut self.mean.plane_mut(p)[k];
                *value += share * (now - *value);
            }
            self.still_s[k] = still_s;
            self.ready += usize::from(still_s >= cover_s);
        }
        if step_s > 0.0 {
            self.frames = f64::from(cover_s / step_s).max(1.0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: usize = 4;

    /// One frame of a patch of which the first `covered` pixels show `value`.
    fn see(cover: &mut Cover, covered: usize, value: f32) {
        let counted = [vec![true; SIZE * SIZE], vec![true; SIZE * SIZE]];
        let mut usable = Usable::all(&counted);
        usable.side_mut(Side::Left)[..covered].fill(false);
        let mut pair = PatchPair::zeros(SIZE);
        (0..3).for_each(|p| pair.left.plane_mut(p).fill(value));
        cover.observe(&pair, &usable, &counted, 0.5, [0.001; 2]);
    }

    #[test]
    fn what_is_still_for_long_enough_stays() {
        let mut cover = Cover::new(5.0, SIZE);
        for k in 0..30 {
            // Noise, and once a change.
            let value = if k < 10 { 0.2 } else { 0.3 };
            see(&mut cover, 6, value + 0.001 * (k % 3) as f32);
            assert_eq!(cover.stays(Side::Left), k >= 20, "frame {k}");
            assert!(!cover.stays(Side::Right));
        }
        let mut pixels = vec![false; SIZE * SIZE];
        let (picture, averaged) = cover.take(Side::Left, &mut pixels);
        assert_eq!(averaged, 10.0);
        assert!((0..16).all(|k| pixels[k] == (k < 6)));
        assert!((picture.plane(1)[2] - 0.301).abs() < 1e-3, "{picture:?}");
        assert!(!cover.stays(Side::Left));
    }

    #[test]
    fn legs_beside_it_are_waited_for_and_edges_may_flicker() {
        let mut cover = Cover::new(5.0, SIZE);
        for k in 0..40 {
            // Four pixels of a bag, now and then one less, and for a while two more of somebody who moves.
            let covered = if k < 20 { 6 } else { 4 - usize::from(k % 6 == 0) };
            let counted = [vec![true; SIZE * SIZE], vec![true; SIZE * SIZE]];
            let mut usable = Usable::all(&counted);
            usable.side_mut(Side::Left)[..covered].fill(false);
            let mut pair = PatchPair::zeros(SIZE);
            (0..3).for_each(|p| pair.left.plane_mut(p)[..4].fill(0.2));
            (0..3).for_each(|p| pair.left.plane_mut(p)[4..].fill(0.1 + 0.02 * (k % 4) as f32));
            cover.observe(&pair, &usable, &counted, 0.5, [0.001; 2]);
            assert_eq!(cover.stays(Side::Left), k >= 20, "frame {k}");
        }
    }
}
