mod rebuild;

use self::rebuild::REBUILT_S;
use super::absorb::Candidate;
use super::cover::Cover;
use super::frame::{FrameLight, fill};
use super::job::{Job, Work};
use super::learning::{Learning, Meanwhile, UNSURE, prepare};
use super::light::{Change, Light, LightWatch, light};
use super::store::BackgroundStore;
use crate::engine::StepError;
use crate::reconstructor::Prepared;
use crate::settings::BackgroundSettings;
use crate::{BackgroundReport, Reconstruction, Reconstructor, State};
use doorcam_core::light::{Learned, PatchPair, RollingBackground, Snapshot, Startup, StartupSpec, Usable};
use doorcam_core::solver::{ModelKind, ProjectionError};
use doorcam_source::{Purpose, SkipKind, SkippedFrame};

/// Maintains the background over time: learns it, follows slow changes and decides when it must be learned anew.
///
/// The one rule: the background changes only where that cannot hide anybody. It follows frames in which nothing is
/// detected; any other change needs a reason: a change of the light, or something that did not move for the set time.
pub(crate) struct Keeper {
    settings: BackgroundSettings,
    work: Work,
    store: Option<BackgroundStore>,
    /// Seconds between frames whose noise is independent.
    apart_s: f64,
    phase: Phase,
    rolling: Option<RollingBackground>,
    light: LightWatch,
    /// Light of the picture that frames are compared with.
    reference: Light,
    candidate: Candidate,
    cover: Cover,
    /// Pixels that have just become part of the background: while the problem is rebuilt for it, and after that until
    /// somebody asks.
    uncovered: Uncovered,
    /// Per side, until when what was put down may have changed the light around it, by `age_s`.
    shaded_until_s: [f64; 2],
    /// The floor's noise on each side (standard deviation of a pixel's grey level).
    noise: [f64; 2],
    /// The frame with every pixel showing the floor.
    filled: Option<PatchPair>,
    frames: usize,
    rebuilding: Option<Job<Prepared>>,
    /// Minimum seconds between two rebuilds of the problem.
    rebuilt_s: f64,
    last_s: Option<f64>,
    age_s: f64,
    timers: Timers,
}

/// Nothing was put down lately.
const NOT_SHADED: [f64; 2] = [f64::NEG_INFINITY; 2];

/// Pixels of what lies on the floor, on their way into the background.
enum Uncovered {
    None,
    /// They are in the mean, and the problem is being rebuilt for it.
    Rebuilding(Usable),
    /// Frames are compared with them.
    Done(Usable),
}

enum Phase {
    /// Nothing is known yet.
    Before,
    Learning(Box<Learning>),
    Watching,
}

/// Seconds since each was last done or seen.
#[derive(Debug, Clone, Copy, Default)]
struct Timers {
    detected: f64,
    adapted: f64,
    checked: f64,
    built: f64,
    saved: f64,
}

/// A longer gap between frames interrupts everything that is observed over time.
const GAP_S: f64 = 10.0;
/// Seconds after a detection before the background follows again: somebody may still be there, too faint to detect.
const CALM_S: f64 = 2.0;
/// A frame is followed only if its energy is at most this multiple of the noise's.
const NOISY: f64 = 1.5;
/// Frames needed to learn the first background, and to learn it anew.
const FRAMES: usize = 12;
const FRAMES_AGAIN: usize = 8;

impl Keeper {
    /// Starts with the stored background if it is valid for this model, otherwise with none. Frames at least `apart_s`
    /// seconds apart have independent noise.
    pub fn new(
        settings: &BackgroundSettings,
        store: Option<BackgroundStore>,
        work: Work,
        apart_s: f64,
        reconstructor: &mut Reconstructor,
    ) -> Self {
        let mut keeper = Self {
            light: LightWatch::new(settings.light_step, true, true),
            candidate: Candidate::new(settings.absorb_s, settings.adapt_s),
            cover: Cover::new(settings.cover_s, reconstructor.model().patch.size),
            uncovered: Uncovered::None,
            shaded_until_s: NOT_SHADED,
            noise: [0.0; 2],
            filled: None,
            frames: 0,
            settings: *settings,
            work,
            store,
            apart_s,
            phase: Phase::Before,
            rolling: None,
            reference: Light::default(),
            rebuilding: None,
            rebuilt_s: REBUILT_S,
            last_s: None,
            age_s: 0.0,
            timers: Timers::default(),
        };
        let model = reconstructor.model().clone();
        if let Some(saved) = keeper.store.as_mut().and_then(|store| store.load(&model, settings.keep_s)) {
            keeper.watch_from(saved, reconstructor);
        }
        keeper
    }

    /// Continues with another keeper's background, if it was watching with one.
    pub fn resume(&mut self, before: Self, reconstructor: &mut Reconstructor) {
        if let (Phase::Watching, Some(rolling)) = (before.phase, before.rolling) {
            self.watch_from(rolling.snapshot(), reconstructor);
        }
    }

    fn watch_from(&mut self, known: Snapshot, reconstructor: &mut Reconstructor) {
        let model = reconstructor.model().clone();
        let nothing = PatchPair::zeros(model.patch.size);
        reconstructor.install(Prepared::new(&model, &known.background(), &nothing));
        self.watch(known.into(), reconstructor, false);
    }

    /// Whether a recording's own frames of the empty room are still needed.
    pub fn wants_given(&self) -> bool {
        matches!(self.phase, Phase::Before)
    }

    /// The background's state for an update.
    pub fn report(&self) -> BackgroundReport {
        let averaged = |rolling: &RollingBackground| rolling.averaged().round() as u64;
        match &self.phase {
            Phase::Before => BackgroundReport { frames: 0, age_s: None, progress: Some(0.0) },
            Phase::Learning(learning) => BackgroundReport {
                frames: learning.startup.frames(),
                age_s: None,
                progress: Some(learning.startup.progress()),
            },
            Phase::Watching => BackgroundReport {
                frames: self.rolling.as_ref().map_or(0, averaged),
                age_s: Some(self.age_s),
                progress: None,
            },
        }
    }

    /// Whether the map can be trusted.
    pub fn state(&self) -> State {
        match &self.phase {
            Phase::Before => State::Learning,
            Phase::Learning(learning) if !learning.again => State::Learning,
            Phase::Learning(learning) => match &learning.meanwhile {
                Some(meanwhile) if meanwhile.explained() => State::Watching,
                _ => State::Relearning,
            },
            Phase::Watching => State::Watching,
        }
    }

    /// How much more uncertain than usual the map is, as a factor on standard deviations.
    pub fn unsure(&self) -> f64 {
        if let Phase::Watching = self.phase { 1.0 } else { UNSURE }
    }

    /// The pixels that did not show the floor and have just become part of the background, so that they can be used
    /// again; none but for the first call after that.
    pub fn take_uncovered(&mut self) -> Option<Usable> {
        match std::mem::replace(&mut self.uncovered, Uncovered::None) {
            Uncovered::Done(pixels) => Some(pixels),
            other => {
                self.uncovered = other;
                None
            }
        }
    }

    /// Learns the background anew from now on, with whatever is in the room.
    pub fn reset(&mut self, reconstructor: &Reconstructor) {
        tracing::info!("the background is learned anew, as asked");
        self.learn_anew(reconstructor, true, false);
    }

    /// Processes a frame; returns its map, or none while learning. Pixels that are not usable are taken to show the
    /// floor as it was, and change nothing.
    pub fn step(
        &mut self,
        seen: &FrameLight,
        reconstructor: &mut Reconstructor,
    ) -> Result<Option<Reconstruction>, KeeperError> {
        let step_s = self.advance(seen.seconds);
        self.frames = self.frames.wrapping_add(1);
        // Before the frame is filled with the picture in use.
        self.take_rebuilt(reconstructor);
        let (Some(usable), Some(floor)) = (seen.usable, reconstructor.reference()) else {
            return self.step_filled(seen, step_s, reconstructor);
        };
        let mut filled = self.filled.take().unwrap_or_else(|| PatchPair::zeros(floor.left.size()));
        fill(seen.pair, usable, floor, self.rolling.as_ref(), self.frames, &mut filled);
        let map = self.step_filled(&FrameLight { pair: &filled, ..*seen }, step_s, reconstructor);
        self.filled = Some(filled);
        self.follow_cover(seen, usable, step_s, reconstructor);
        map
    }

    fn step_filled(
        &mut self,
        seen: &FrameLight,
        step_s: f64,
        reconstructor: &mut Reconstructor,
    ) -> Result<Option<Reconstruction>, KeeperError> {
        if let Phase::Before = self.phase {
            if reconstructor.background().frames() > 0 {
                // The recording says which frames show the empty room.
                let map = reconstructor.reconstruct_in_noise(seen.pair, seen.excess)?;
                let background = reconstructor.take_background();
                self.watch(RollingBackground::from_background(&background), reconstructor, true);
                return Ok(map);
            }
            if seen.purpose == Purpose::Watch {
                return Err(KeeperError::NoBackground);
            }
            self.learn_anew(reconstructor, false, false);
        }
        if let Phase::Learning(_) = self.phase {
            let map = self.learn(seen, step_s, reconstructor)?;
            if let Phase::Learning(_) = self.phase {
                return Ok(map);
            }
        }
        let Some(map) = reconstructor.reconstruct_in_noise(seen.pair, seen.excess)? else {
            return Err(KeeperError::NoBackground);
        };
        if !seen.is_disturbed(&reconstructor.model().counted) {
            let [now, then] = seen.lights(self.reference, reconstructor);
            if let Some(change) = self.light.observe(seen.seconds, step_s, now, then, &map) {
                self.light_changed(change, reconstructor);
                return Ok(self.learn(seen, step_s, reconstructor)?);
            }
            self.follow(seen, step_s, &map, reconstructor);
        }
        self.rebuild_if_due(reconstructor);
        self.save_if_due(reconstructor);
        Ok(Some(map))
    }

    /// Saves the background and waits until that is done.
    pub fn save(&mut self, reconstructor: &Reconstructor) {
        // While learning, there is nothing worth saving: the new background is unfinished and the old one is obsolete.
        if let (Phase::Watching, Some(store), Some(rolling)) = (&self.phase, &mut self.store, &self.rolling) {
            store.save(reconstructor.model(), rolling.snapshot(), Work::InPlace);
        }
    }

    /// Seconds since the previous frame; 0 after a gap.
    fn advance(&mut self, seconds: f64) -> f64 {
        let step = self.last_s.replace(seconds).map(|last| seconds - last);
        let Some(step) = step.filter(|step| (0.0..=GAP_S).contains(step)) else {
            self.light.restart();
            // A recording that starts again repeats its frames; the candidate must not count them twice.
            self.candidate.clear();
            self.cover.clear();
            self.shaded_until_s = NOT_SHADED;
            return 0.0;
        };
        self.age_s += step;
        let Timers { detected, adapted, checked, built, saved } = &mut self.timers;
        [detected, adapted, checked, built, saved].into_iter().for_each(|timer| *timer += step);
        step
    }

    fn light_changed(&mut self, change: Change, reconstructor: &Reconstructor) {
        tracing::warn!("{change}: the background is learned anew");
        self.learn_anew(reconstructor, true, true);
    }

    fn learn_anew(&mut self, reconstructor: &Reconstructor, again: bool, may_return: bool) {
        let spec = StartupSpec {
            still_s: if again { self.settings.relearn_s } else { self.settings.learn_s },
            frames: if again { FRAMES_AGAIN } else { FRAMES },
            most_s: self.settings.learn_max_s,
            apart_s: self.apart_s,
        };
        let startup = Startup::new(spec, reconstructor.model().counted.clone());
        let meanwhile = may_return.then(|| Meanwhile::new(self.reference));
        self.phase = Phase::Learning(Box::new(Learning { startup, again, meanwhile, building: None }));
        self.rebuilding = None;
        self.candidate.clear();
        self.cover.clear();
    }

    /// Learns from a frame. Returns its map if something explains it meanwhile.
    fn learn(
        &mut self,
        seen: &FrameLight,
        step_s: f64,
        reconstructor: &mut Reconstructor,
    ) -> Result<Option<Reconstruction>, ProjectionError> {
        let Phase::Learning(learning) = &mut self.phase else { return Ok(None) };
        let mut map = None;
        if let Some(meanwhile) = &mut learning.meanwhile {
            map = meanwhile.explain(seen, step_s, &self.light, self.settings.light_step, reconstructor)?;
            if meanwhile.old_fits() {
                tracing::info!("the light is what it was before: the old background is used again");
                self.watch_old(reconstructor);
                return Ok(map);
            }
        }
        if learning.building.is_none() {
            // An average that is not full yet is noisier than the ones to come.
            if seen.excess == 1.0 && !seen.is_disturbed(&reconstructor.model().counted) {
                learning.startup.push(seen.pair, seen.seconds);
            }
            if let Some(Learned { background, still }) = learning.startup.learned() {
                if learning.meanwhile.as_ref().is_some_and(Meanwhile::old_is_right) {
                    tracing::info!("people and the old background explain what is seen: it is used again");
                    self.watch_old(reconstructor);
                    return Ok(map);
                }
                if still {
                    tracing::info!("the empty room is learned from {} frames", background.frames());
                } else {
                    tracing::warn!(
                        "something moved for {} s: the picture that came back most often is taken for the empty room \
                         (background.learn_max_s)",
                        self.settings.learn_max_s
                    );
                }
                let rolling = RollingBackground::from_background(&background);
                learning.building = Some((prepare(self.work, background, seen.pair.clone(), reconstructor), rolling));
            } else if let Some(meanwhile) = &mut learning.meanwhile {
                meanwhile.prepare(&learning.startup, seen, self.work, reconstructor);
            }
        }
        if let Some((job, rolling)) = learning.building.take() {
            match job.poll() {
                Err(running) => learning.building = Some((running, rolling)),
                Ok(Some(prepared)) => {
                    reconstructor.install(prepared);
                    self.watch(rolling, reconstructor, true);
                }
                // The thread has reported the reason. Later frames may succeed.
                Ok(None) => {}
            }
        }
        Ok(map)
    }

    /// Watches with the background from before it was to be learned anew.
    fn watch_old(&mut self, reconstructor: &mut Reconstructor) {
        if let Phase::Learning(learning) = &mut self.phase
            && let Some(meanwhile) = &mut learning.meanwhile
        {
            meanwhile.use_old(reconstructor);
        }
        self.phase = Phase::Watching;
        self.light.restart();
        if let Uncovered::Rebuilding(_) = self.uncovered {
            // It was interrupted.
            self.rebuild(reconstructor);
        }
    }

    /// Starts to watch with this background, whose problem is already installed.
    fn watch(&mut self, rolling: RollingBackground, reconstructor: &Reconstructor, verified: bool) {
        let known_noise = reconstructor.model().kind == ModelKind::Signed;
        self.light = LightWatch::new(self.settings.light_step, known_noise, verified);
        self.rolling = Some(rolling);
        self.cover.clear();
        self.uncovered = Uncovered::None;
        self.shaded_until_s = NOT_SHADED;
        self.use_reference(reconstructor);
        self.candidate.clear();
        self.age_s = 0.0;
        self.timers = Timers { detected: CALM_S, ..Timers::default() };
        self.phase = Phase::Watching;
    }

    fn use_reference(&mut self, reconstructor: &Reconstructor) {
        let counted = reconstructor.model().counted.each_ref().map(Vec::as_slice);
        self.reference = reconstructor.reference().map_or(Light::default(), |reference| light(reference, counted));
        self.noise = self.rolling.as_ref().map_or([0.0; 2], RollingBackground::noise);
    }

    /// Lets the background follow the frame if nobody can be in it, and absorbs what does not move.
    fn follow(&mut self, seen: &FrameLight, step_s: f64, map: &Reconstruction, reconstructor: &mut Reconstructor) {
        let Some(rolling) = &mut self.rolling else { return };
        if let Uncovered::Rebuilding(_) = self.uncovered {
            // The frame is filled with the floor that the mean no longer shows.
            return;
        }
        if map.is_empty() {
            self.candidate.refute(step_s);
            self.shaded_until_s = NOT_SHADED;
            if self.light.is_noise(map.energy, NOISY) {
                self.light.quiet(map.energy, step_s);
                let due = self.timers.adapted >= 0.95 * self.apart_s && seen.excess == 1.0;
                if self.timers.detected >= CALM_S && due {
                    // After a pause, one frame must not stand for all the time that was missed.
                    let since_s = self.timers.adapted.min(self.apart_s.max(step_s));
                    rolling.adapt(seen.pair, since_s, self.settings.adapt_s);
                    self.timers.adapted = 0.0;
                }
            }
            return;
        }
        (self.timers.detected, self.timers.adapted) = (0.0, 0.0);
        let excess = seen.excess;
        let absorbed = self.candidate.observe(seen.pair, step_s, |picture, averaged| {
            let allowed = excess * (1.0 + 1.0 / averaged).sqrt();
            reconstructor.departure(seen.pair, Some(picture)).is_some_and(|share| share <= allowed)
        });
        if let Some((picture, averaged)) = absorbed {
            tracing::info!("what has not moved for {} s is now part of the background", self.settings.absorb_s);
            rolling.replace(&picture, averaged);
            self.rebuild_soon();
        }
    }

    fn save_if_due(&mut self, reconstructor: &Reconstructor) {
        if let (Some(store), Some(rolling)) = (&mut self.store, &self.rolling)
            && self.timers.saved >= self.settings.save_s
        {
            self.timers.saved = 0.0;
            store.save(reconstructor.model(), rolling.snapshot(), self.work);
        }
    }
}

/// Why a frame yielded neither a map nor progress.
#[derive(Debug, thiserror::Error)]
pub(crate) enum KeeperError {
    #[error(transparent)]
    Projection(#[from] ProjectionError),
    #[error("there is nothing to compare frames with")]
    NoBackground,
}

impl KeeperError {
    /// Turns it into the error of the frame called `name`.
    pub fn of(self, name: &str) -> StepError {
        match self {
            Self::Projection(e) => SkippedFrame::new(name, SkipKind::Unfit, e.to_string()).into(),
            Self::NoBackground => StepError::NoBackground,
        }
    }
}
