use std::collections::VecDeque;

use crate::Reconstruction;
use doorcam_core::geometry::Side;
use doorcam_core::light::PatchPair;

/// Light of each patch's three colours: the mean of the pixels that count, relative to full scale; left, then right.
pub(super) type Light = [[f64; 3]; 2];

/// Measures a patch pair's light.
pub(super) fn light(pair: &PatchPair, counted: [&[bool]; 2]) -> Light {
    [0, 1].map(|s| {
        let patch = pair.side(Side::BOTH[s]);
        [0, 1, 2].map(|p| {
            let pixels = patch.plane(p).iter().zip(counted[s]);
            let (sum, count) =
                pixels.fold(
                    (0.0, 0.0),
                    |(sum, count), (&value, &counts)| {
                        if counts { (sum + f64::from(value), count + 1.0) } else { (sum, count) }
                    },
                );
            if count > 0.0 { sum / count } else { 0.0 }
        })
    })
}

/// Why the background has to be learned anew.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub(super) enum Change {
    /// A step within [`AT_ONCE_S`], with nothing moving before or after.
    #[error("the light on the floor changed by {:+.0} % at once", 100.0 * .0)]
    Step(f64),
    /// More than anybody in the room can cause, while the map stays empty.
    #[error("the light on the floor is {:+.0} % off, and nobody is there", 100.0 * .0)]
    Even(f64),
    /// For seconds, much of what is seen cannot be explained by anything in the room.
    #[error("{:.0} % of what changed cannot come from the room, for seconds", 100.0 * .0)]
    Unexplained(f64),
    /// A saved background does not fit the first frames.
    #[error("the light on the floor is {:+.0} % off what it was when the background was saved", 100.0 * .0)]
    Saved(f64),
}

/// How well a background explains a frame although the light seems to have changed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Explained {
    /// Not at all.
    Not,
    /// Its map can be shown, but a lamp may be what has changed.
    Shown,
    /// By people: there is no need for another background.
    Right,
}

/// Tells a change of the light from people.
///
/// Nobody can change the light suddenly: a walker takes most of a second for what a switch does from one frame to the
/// next, and does not stand still before and after. So a step counts as soon as a few frames after it agree, unless the
/// map explains it: a screen that is switched on in the room is something in the room. A slower change counts as light
/// if it is strong and leaves the map empty, or if for seconds much of it is explained by nothing in the room and it
/// stands still.
#[derive(Debug, Clone)]
pub(super) struct LightWatch {
    /// The smallest change that counts, as a share of the light.
    step: f64,
    recent: VecDeque<Moment>,
    /// Frames since the background was learned or loaded; only the first few matter.
    frames: usize,
    /// Whether the background is known to match the present light: it was learned in this run, or verified.
    verified: bool,
    /// Energy of a frame that shows only noise; none before there was one, if the model does not know the noise.
    noise: Option<f64>,
    even_s: f64,
    unexplained_s: f64,
}

#[derive(Debug, Clone, Copy)]
struct Moment {
    seconds: f64,
    light: Light,
    /// Gain of each patch's colours apart from what the facets explain; of all light if the model has no gain.
    gain: Light,
}

/// A step must be complete from one frame to the next or within this time, since it may fall into an exposure. Nobody
/// starts, goes anywhere and stops within a quarter of a second.
const AT_ONCE_S: f64 = 0.25;
/// The light must be still before and after for this long, with at least this many frames.
const STILL_S: f64 = 0.25;
const STILL_FRAMES: usize = 3;
/// How much the light may vary before and after, as a share of the step (twice the standard deviation).
const STILL: f64 = 0.2;
/// Moments that are kept: enough for both sides of a step at any frame rate.
const MOMENTS: usize = 256;
const MEMORY_S: f64 = 3.0;
/// Slow changes must be this many times as strong as sudden ones: clouds pass, and a gain does not disturb the map.
const SLOW: f64 = 7.5;
/// The part of a step that facets do not explain must be at least this share of one that counts.
const GAIN: f64 = 0.5;
/// An even change must last this long, an unexplained one this long.
const EVEN_S: f64 = 0.5;
const UNEXPLAINED_S: f64 = 3.0;
/// People leave less than this share of a strong change unexplained.
const UNEXPLAINED: f64 = 0.25;
/// Although the light seems to have changed, a frame is explained if facets leave at most this many `step`s to a gain,
/// which does not disturb the map, or this share of the change, and explain at least `EXPLAINED` of the rest.
const EXPLAINED_GAIN: f64 = 2.0;
const EXPLAINED_SHARE: f64 = 0.5;
const EXPLAINED: f64 = 0.5;
/// Of the change of the light, people leave at most this part to a gain, and lamps nearly all.
const OF_PEOPLE: f64 = 0.7;
/// Frames until a saved background is checked against the light.
const VERIFIED: usize = 3;
/// Time constant of the noise energy, in seconds.
const NOISE_S: f64 = 10.0;

impl LightWatch {
    /// Watches for changes of the light by the share `step`. `known_noise`: frames are weighted by the noise, so that a
    /// quiet frame's energy is about 1. `verified`: the background was learned in the present light.
    pub fn new(step: f64, known_noise: bool, verified: bool) -> Self {
        Self {
            step,
            recent: VecDeque::new(),
            frames: 0,
            verified,
            noise: known_noise.then_some(1.0),
            even_s: 0.0,
            unexplained_s: 0.0,
        }
    }

    /// Forgets earlier moments: frames are missing, or another background is in use.
    pub fn restart(&mut self) {
        self.recent.clear();
        (self.even_s, self.unexplained_s) = (0.0, 0.0);
    }

    /// Whether a frame's energy is no more than `factor` times that of noise.
    pub fn is_noise(&self, energy: f64, factor: f64) -> bool {
        self.noise.is_none_or(|noise| energy <= factor * noise)
    }

    /// Learns the noise energy from a frame that shows nothing.
    pub fn quiet(&mut self, energy: f64, step_s: f64) {
        let share = 1.0 - (-step_s / NOISE_S).exp();
        self.noise = Some(self.noise.map_or(energy, |noise| noise + share * (energy - noise)));
    }

    /// Takes a frame, `step_s` seconds after the previous one, with the light `light`; `reference` is the empty room's.
    pub fn observe(
        &mut self,
        seconds: f64,
        step_s: f64,
        light: Light,
        reference: Light,
        found: &Reconstruction,
    ) -> Option<Change> {
        let relative = ratio(light, reference);
        let gain = found.gain.unwrap_or(relative);
        self.frames += 1;
        while self.recent.len() >= MOMENTS || self.recent.front().is_some_and(|m| seconds - m.seconds > MEMORY_S) {
            if self.recent.len() <= 4 * STILL_FRAMES && self.recent.len() < MOMENTS {
                break;
            }
            self.recent.pop_front();
        }
        self.recent.push_back(Moment { seconds, light: relative, gain });
        self.unfit(relative)
            .or_else(|| self.sudden(found))
            .or_else(|| self.even(step_s, relative, found))
            .or_else(|| self.odd(step_s, relative, found))
    }

    /// Whether a saved background was learned in another light.
    fn unfit(&mut self, relative: Light) -> Option<Change> {
        if self.verified {
            return None;
        }
        self.verified = self.frames >= VERIFIED;
        let off = strongest(relative);
        (self.verified && off.abs() > SLOW * self.step).then_some(Change::Saved(off))
    }

    fn sudden(&self, found: &Reconstruction) -> Option<Change> {
        let all = self.recent.as_slices();
        let at = |k: usize| if k < all.0.len() { &all.0[k] } else { &all.1[k - all.0.len()] };
        // Start of the shortest run of frames before `end` that spans the time.
        let span = |end: usize| {
            (0..end.saturating_sub(STILL_FRAMES - 1))
                .rev()
                .find(|&from| at(end - 1).seconds - at(from).seconds >= STILL_S)
        };
        let after = span(self.recent.len())?;
        let at_once = |&end: &usize| end == after || at(after).seconds - at(end - 1).seconds <= AT_ONCE_S;
        (1..=after).rev().take_while(at_once).find_map(|end| {
            let before = span(end)?;
            let (old, new) = (Stretch::of(before..end, at), Stretch::of(after..self.recent.len(), at));
            let change = ratio(new.light, old.light);
            let off = strongest(change);
            let still = 2.0 * old.deviation.max(new.deviation) <= STILL * off.abs();
            // A change on one patch alone is hardly a change of the light.
            let both = change.iter().all(|rgb| mean(rgb) * off > 0.0 && mean(rgb).abs() > self.step / 4.0);
            let unexplained = strongest(ratio(new.gain, old.gain)).abs() > GAIN * self.step
                || self.unexplained(found).is_some_and(|share| share > UNEXPLAINED);
            (off.abs() > self.step && still && both && unexplained).then_some(Change::Step(off))
        })
    }

    /// How well a frame with the light `light` is explained by people and a background with the light `reference`,
    /// although the light seems to have changed.
    pub fn explained(&self, light: Light, reference: Light, found: &Reconstruction) -> Explained {
        let off = strongest(ratio(light, reference)).abs();
        let gain = found.gain.map_or(off, |gain| strongest(gain).abs());
        let gain_allowed = (EXPLAINED_GAIN * self.step).max(EXPLAINED_SHARE * off);
        if gain > gain_allowed || self.unexplained(found).is_some_and(|share| share > 1.0 - EXPLAINED) {
            Explained::Not
        } else if gain > OF_PEOPLE * off {
            Explained::Shown
        } else {
            Explained::Right
        }
    }

    fn even(&mut self, step_s: f64, relative: Light, found: &Reconstruction) -> Option<Change> {
        let off = strongest(relative);
        let strong = off.abs() > SLOW * self.step && found.is_empty();
        self.even_s = if strong { self.even_s + step_s } else { 0.0 };
        (self.even_s >= EVEN_S).then_some(Change::Even(off))
    }

    fn odd(&mut self, step_s: f64, relative: Light, found: &Reconstruction) -> Option<Change> {
        let off = strongest(relative);
        let strong = off.abs() > SLOW * self.step;
        let share = self.unexplained(found).filter(|&share| share > UNEXPLAINED && strong);
        self.unexplained_s = if share.is_some() { self.unexplained_s + step_s } else { 0.0 };
        let from =
            self.recent.iter().position(|m| self.recent.back().is_some_and(|now| now.seconds - m.seconds <= 1.0));
        let still = || 2.0 * Stretch::of(from.unwrap_or(0)..self.recent.len(), |k| &self.recent[k]).deviation;
        share.filter(|_| self.unexplained_s >= UNEXPLAINED_S && still() <= STILL * off.abs()).map(Change::Unexplained)
    }

    /// The share of the frame's energy beyond noise that facets and lamps do not explain; none if that energy is small.
    fn unexplained(&self, found: &Reconstruction) -> Option<f64> {
        let noise = self.noise?;
        (found.residual > 2.0 * noise).then(|| (found.residual - noise) / (found.energy - noise))
    }
}

/// Statistics of consecutive moments.
struct Stretch {
    light: Light,
    gain: Light,
    /// Largest standard deviation of a colour's light.
    deviation: f64,
}

impl Stretch {
    fn of<'a>(moments: std::ops::Range<usize>, at: impl Fn(usize) -> &'a Moment) -> Self {
        let count = moments.len() as f64;
        let mean = |value: &dyn Fn(&Moment) -> f64| moments.clone().map(|k| value(at(k))).sum::<f64>() / count;
        let each = |value: &dyn Fn(&Moment, usize, usize) -> f64| -> Light {
            [0, 1].map(|s| [0, 1, 2].map(|p| mean(&|m| value(m, s, p))))
        };
        let light = each(&|m, s, p| m.light[s][p]);
        let variance = each(&|m, s, p| (m.light[s][p] - light[s][p]).powi(2));
        let deviation = variance.iter().flatten().fold(0.0_f64, |largest, v| largest.max(*v)).sqrt();
        Self { gain: each(&|m, s, p| m.gain[s][p]), light, deviation }
    }
}

fn mean(rgb: &[f64; 3]) -> f64 {
    (rgb.iter().sum::<f64>() / 3.0) - 1.0
}

/// The relative change of grey light on the patch that changed more.
fn strongest(relative: Light) -> f64 {
    let [left, right] = [0, 1].map(|s| mean(&relative[s]));
    if left.abs() > right.abs() { left } else { right }
}

/// a / b per value; 1 where b is not positive.
fn ratio(a: Light, b: Light) -> Light {
    [0, 1].map(|s| [0, 1, 2].map(|p| if b[s][p] > 0.0 { a[s][p] / b[s][p] } else { 1.0 }))
}
