use super::frame::FrameLight;
use super::job::{Job, Work};
use super::light::{Explained, Light, LightWatch, light};
use crate::reconstructor::Prepared;
use crate::{Reconstruction, Reconstructor};
use doorcam_core::light::{Background, PatchPair, RollingBackground, Startup};
use doorcam_core::solver::ProjectionError;

/// The background that is being learned.
pub(super) struct Learning {
    pub startup: Startup,
    /// Whether there was a background before.
    pub again: bool,
    /// What shows the room until it is learned; none if there was no background before, or it must not return.
    pub meanwhile: Option<Meanwhile>,
    pub building: Option<(Job<Prepared>, RollingBackground)>,
}

/// Shows the room while its background is learned anew: against the old background where that explains the frame, as it
/// does if the light has not changed after all; otherwise against a first picture of the room in the new light.
///
/// The old background comes first even if both explain a frame, because somebody who stood still for a moment is in the
/// first picture and would be hidden by it.
pub(super) struct Meanwhile {
    /// Light of the picture that is in use.
    reference: Light,
    /// Whether that is the old one.
    old_in_use: bool,
    /// The one that is not in use, with its light.
    other: Option<(Prepared, Light)>,
    building: Option<Job<Prepared>>,
    /// Consecutive frames that fit the old background.
    fits: usize,
    explained: bool,
    /// Seconds for which the last frames have not been explained.
    unexplained_s: f64,
    /// Seconds for which the old background was right, and for which it was not.
    old_right_s: [f64; 2],
}

/// Consecutive frames that must fit the old background before it is used again.
const FITTING: usize = 3;
/// A frame fits only if its energy is at most this multiple of the noise's.
const NOISY: f64 = 1.5;
/// The light may differ from the old background's by at most this many `light_step`s.
const NEAR: f64 = 2.0;
/// Noise of frames that are shown meanwhile, as a multiple of the usual: what makes the light look changed is no noise
/// that the background knows.
pub(super) const UNSURE: f64 = 1.5;
/// Seconds after which a first picture that explains nothing is discarded, so that there can be another.
const USELESS_S: f64 = 1.0;

impl Meanwhile {
    /// Starts with the old background, which has the light `reference` and is in use.
    pub fn new(reference: Light) -> Self {
        Self {
            reference,
            old_in_use: true,
            other: None,
            building: None,
            fits: 0,
            explained: false,
            unexplained_s: 0.0,
            old_right_s: [0.0; 2],
        }
    }

    /// Whether the last frame could be explained.
    pub fn explained(&self) -> bool {
        self.explained
    }

    /// Whether people and the old background explain most of what was seen since it was doubted.
    pub fn old_is_right(&self) -> bool {
        self.old_right_s[0] > self.old_right_s[1]
    }

    /// Whether the old background fits again, with nobody in the room.
    pub fn old_fits(&self) -> bool {
        self.fits >= FITTING
    }

    /// The map of a frame `step_s` seconds after the previous one, from the background that explains it; none if none
    /// does. `light_step` as in the settings.
    pub fn explain(
        &mut self,
        seen: &FrameLight,
        step_s: f64,
        watch: &LightWatch,
        light_step: f64,
        reconstructor: &mut Reconstructor,
    ) -> Result<Option<Reconstruction>, ProjectionError> {
        self.take_prepared(reconstructor);
        self.use_old(reconstructor);
        let (found, explained) = self.attempt(seen, watch, reconstructor)?;
        let [now, then] = seen.lights(self.reference, reconstructor);
        let near = || {
            let of = |light: Light, k: usize| light[k / 3][k % 3];
            (0..6).all(|k| (of(now, k) - of(then, k)).abs() <= NEAR * light_step * of(then, k))
        };
        let fits = found.as_ref().is_some_and(|map| map.is_empty() && watch.is_noise(map.energy, NOISY)) && near();
        self.fits = if fits { self.fits + 1 } else { 0 };
        self.old_right_s[usize::from(explained != Explained::Right)] += step_s;
        let found = match found {
            None if self.exchange(reconstructor) => self.attempt(seen, watch, reconstructor)?.0,
            found => found,
        };
        self.explained = found.is_some();
        self.unexplained_s = if self.explained { 0.0 } else { self.unexplained_s + step_s };
        if self.unexplained_s >= USELESS_S {
            self.use_old(reconstructor);
            self.other = None;
        }
        match found {
            Some(map) if !map.is_empty() => reconstructor.reconstruct_in_noise(seen.pair, UNSURE * seen.excess),
            found => Ok(found),
        }
    }

    /// The map against the background in use, if that explains the frame.
    fn attempt(
        &self,
        seen: &FrameLight,
        watch: &LightWatch,
        reconstructor: &mut Reconstructor,
    ) -> Result<(Option<Reconstruction>, Explained), ProjectionError> {
        let [now, then] = seen.lights(self.reference, reconstructor);
        let Some(map) = reconstructor.reconstruct_in_noise(seen.pair, seen.excess)? else {
            return Ok((None, Explained::Not));
        };
        let explained = watch.explained(now, then, &map);
        Ok(((explained != Explained::Not).then_some(map), explained))
    }

    /// Sets up a first picture of the room, if there is none yet and it is needed.
    pub fn prepare(&mut self, startup: &Startup, seen: &FrameLight, work: Work, reconstructor: &Reconstructor) {
        if self.explained || self.other.is_some() || self.building.is_some() {
            return;
        }
        self.building =
            startup.preliminary().map(|background| prepare(work, background, seen.pair.clone(), reconstructor));
    }

    /// Takes the first picture, if it has been set up.
    fn take_prepared(&mut self, reconstructor: &Reconstructor) {
        match self.building.take().map(Job::poll) {
            Some(Err(running)) => self.building = Some(running),
            Some(Ok(Some(prepared))) => {
                let light = light(&prepared.reference, reconstructor.model().counted.each_ref().map(Vec::as_slice));
                self.unexplained_s = 0.0;
                self.other = Some((prepared, light));
            }
            // It failed and has reported the reason.
            Some(Ok(None)) | None => {}
        }
    }

    /// Uses the old background.
    pub fn use_old(&mut self, reconstructor: &mut Reconstructor) {
        if !self.old_in_use {
            self.exchange(reconstructor);
        }
    }

    /// Uses the other background, if there is one.
    fn exchange(&mut self, reconstructor: &mut Reconstructor) -> bool {
        let Some((prepared, light)) = &mut self.other else { return false };
        reconstructor.exchange(prepared);
        std::mem::swap(&mut self.reference, light);
        self.old_in_use = !self.old_in_use;
        true
    }
}

/// Builds the problem for a background to which `frame` belongs.
pub(super) fn prepare(
    work: Work,
    background: Background,
    frame: PatchPair,
    reconstructor: &Reconstructor,
) -> Job<Prepared> {
    let model = reconstructor.model().clone();
    Job::in_turn(work, "background", move || {
        let mut difference = PatchPair::zeros(model.patch.size);
        background.difference(&frame, &mut difference);
        Prepared::new(&model, &background, &difference)
    })
}
