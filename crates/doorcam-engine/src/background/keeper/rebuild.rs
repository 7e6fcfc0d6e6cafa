//! When the problem is rebuilt because the background has changed.

use super::{Keeper, Phase, Uncovered};
use crate::Reconstructor;
use crate::background::frame::FrameLight;
use crate::background::job::{Job, Work};
use crate::background::light::light;
use crate::reconstructor::Prepared;
use doorcam_core::geometry::Side;
use doorcam_core::light::{PatchPair, Usable};

/// Seconds between checks whether the current problem still fits.
const CHECK_S: f64 = 1.0;
/// The problem is rebuilt when the background has moved by this share of what would be detected, or its light by
/// `MOVED_LIGHT`.
const MOVED: f64 = 0.25;
const MOVED_LIGHT: f64 = 0.02;
/// Minimum seconds between two rebuilds, and as a multiple of the time one takes, so that a slow machine keeps time for
/// its frames.
pub(super) const REBUILT_S: f64 = 5.0;
pub(super) const REBUILT_SHARE: f64 = 10.0;
/// How long after something was put down the floor around it is learned, as a multiple of `cover_s`.
const AROUND: f64 = 3.0;
/// How long all must have looked the same for that, in seconds: nobody who walks does. Less than `cover_s` usually is, since
/// whoever put it down had to leave.
const SETTLED_S: f64 = 5.0;
/// Frames from which the noise can be measured well enough to rebuild the problem.
const ENOUGH: usize = 4;

impl Keeper {
    /// Uses the problem that has been rebuilt, if one has.
    pub(super) fn take_rebuilt(&mut self, reconstructor: &mut Reconstructor) {
        match self.rebuilding.take().map(Job::poll) {
            None => {}
            Some(Err(running)) => self.rebuilding = Some(running),
            // It failed and has reported the reason: the old problem stays.
            Some(Ok(None)) => self.uncovered = Uncovered::None,
            Some(Ok(Some(prepared))) => {
                if self.work == Work::Aside {
                    self.rebuilt_s = REBUILT_S.max(REBUILT_SHARE * prepared.took.as_secs_f64());
                }
                reconstructor.install(prepared);
                self.use_reference(reconstructor);
                self.uncovered = match std::mem::replace(&mut self.uncovered, Uncovered::None) {
                    Uncovered::Rebuilding(pixels) => Uncovered::Done(pixels),
                    other => other,
                };
            }
        }
    }

    /// Rebuilds the problem as soon as it can be.
    pub(super) fn rebuild_soon(&mut self) {
        (self.timers.built, self.timers.checked) = (self.settings.rebuild_s.max(self.rebuilt_s), CHECK_S);
    }

    /// Watches what lies on the floor, and makes it part of the background once it stays.
    pub(super) fn follow_cover(
        &mut self,
        seen: &FrameLight,
        usable: &Usable,
        step_s: f64,
        reconstructor: &mut Reconstructor,
    ) {
        let (Phase::Watching, Some(rolling)) = (&self.phase, &mut self.rolling) else { return };
        if let Uncovered::Rebuilding(_) = self.uncovered {
            return;
        }
        let counted = &reconstructor.model().counted;
        self.cover.observe(seen.pair, usable, counted, step_s, self.noise);
        // Otherwise the problem cannot be rebuilt yet.
        if self.timers.built < self.rebuilt_s || rolling.deviations() < ENOUGH {
            return;
        }
        let mut pixels: Option<Usable> = None;
        for side in Side::BOTH {
            if !self.cover.stays(side) {
                continue;
            }
            let pixels = pixels.get_or_insert_with(|| Usable::none(counted));
            let (picture, averaged) = self.cover.take(side, pixels.side_mut(side));
            rolling.replace_pixels(side, pixels.side(side), picture, averaged);
            self.candidate.replace_pixels(side, pixels.side(side), picture);
            self.shaded_until_s[side as usize] = self.age_s + AROUND * self.settings.cover_s;
            let count = pixels.count(side);
            tracing::info!(
                "what has lain on the {} patch for {} s is now part of the background: {count} pixels",
                side.name(),
                self.settings.cover_s
            );
        }
        let shade = self.follow_shade();
        if shade || pixels.is_some() {
            // One that is under way does not know it.
            self.rebuilding = None;
            self.rebuild(reconstructor);
        }
        if let Some(pixels) = pixels {
            self.uncovered = Uncovered::Rebuilding(pixels);
        }
    }

    /// Whether what was put down may shade a patch, and that is not learned yet: it may look like somebody.
    pub(crate) fn awaits_shade(&self) -> bool {
        self.shaded_until_s.iter().any(|&until_s| self.age_s < until_s)
    }

    /// What was put down shades the floor around it, softly. Takes that in once nothing else has been seen for a while; says
    /// whether it did.
    fn follow_shade(&mut self) -> bool {
        let (Some(rolling), Some((picture, averaged))) = (&mut self.rolling, self.candidate.steady_for(SETTLED_S))
        else {
            return false;
        };
        let mut learned = false;
        for side in Side::BOTH {
            let until_s = std::mem::replace(&mut self.shaded_until_s[side as usize], f64::NEG_INFINITY);
            if self.age_s < until_s {
                let picture = picture.side(side);
                rolling.replace_pixels(side, &vec![true; picture.pixels()], picture, averaged);
                learned = true;
                tracing::info!("the light around what lies on the {} patch is now part of the background", side.name());
            }
        }
        learned
    }

    /// Rebuilds the problem for the present background, on another thread, when the current one no longer fits.
    pub(super) fn rebuild_if_due(&mut self, reconstructor: &mut Reconstructor) {
        let Some(rolling) = &self.rolling else { return };
        let early = self.timers.checked < CHECK_S || self.timers.built < self.rebuilt_s;
        // The noise of a background with fewer frames was guessed from a frame's difference, which a rebuild lacks.
        if self.rebuilding.is_some() || early || rolling.deviations() < ENOUGH {
            return;
        }
        self.timers.checked = 0.0;
        let counted = reconstructor.model().counted.each_ref().map(Vec::as_slice);
        let lit = light(rolling.mean(), counted);
        let relative = |k: usize| (lit[k / 3][k % 3] / self.reference[k / 3][k % 3].max(f64::MIN_POSITIVE) - 1.0).abs();
        let moved = (0..6).any(|k| relative(k) > MOVED_LIGHT)
            || reconstructor.departure(rolling.mean(), None).is_some_and(|share| share > MOVED);
        if moved || self.timers.built >= self.settings.rebuild_s {
            self.rebuild(reconstructor);
        }
    }

    /// Rebuilds the problem now.
    pub(super) fn rebuild(&mut self, reconstructor: &Reconstructor) {
        let Some(rolling) = &self.rolling else { return };
        self.timers.built = 0.0;
        let (model, snapshot) = (reconstructor.model().clone(), rolling.snapshot());
        self.rebuilding = Some(Job::in_turn(self.work, "background", move || {
            let background = snapshot.background();
            let nothing = PatchPair::zeros(model.patch.size);
            Prepared::new(&model, &background, &nothing)
        }));
    }
}
