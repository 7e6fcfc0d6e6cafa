use super::absorb::Candidate;
use super::job::{Job, Work};
use super::light::{Change, Light, LightWatch, light};
use super::store::BackgroundStore;
use crate::engine::StepError;
use crate::reconstructor::Prepared;
use crate::settings::BackgroundSettings;
use crate::{BackgroundReport, Reconstruction, Reconstructor, State};
use doorcam_core::light::{Background, Learned, PatchPair, RollingBackground, Snapshot, Startup, StartupSpec};
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
    rebuilding: Option<Job<Prepared>>,
    /// Minimum seconds between two rebuilds of the problem.
    rebuilt_s: f64,
    last_s: Option<f64>,
    age_s: f64,
    timers: Timers,
}

/// What the keeper needs to know of a frame.
pub(crate) struct FrameLight<'a> {
    /// As captured.
    pub raw: &'a PatchPair,
    /// Averaged in time; the same as `raw` without averaging.
    pub pair: &'a PatchPair,
    /// Noise of this average as a multiple of a full average's.
    pub excess: f64,
    /// Capture time on the source's clock.
    pub seconds: f64,
    pub purpose: Purpose,
}

enum Phase {
    /// Nothing is known yet.
    Before,
    Learning(Box<Learning>),
    Watching,
}

struct Learning {
    startup: Startup,
    /// Whether there was a background before.
    again: bool,
    /// Consecutive frames that fit the old background, which is then used again; none if it must not return.
    fits: Option<usize>,
    building: Option<(Job<Prepared>, RollingBackground)>,
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
/// Seconds between checks whether the current problem still fits.
const CHECK_S: f64 = 1.0;
/// The problem is rebuilt when the background has moved by this share of what would be detected, or its light by
/// `MOVED_LIGHT`.
const MOVED: f64 = 0.25;
const MOVED_LIGHT: f64 = 0.02;
/// Minimum seconds between two rebuilds, and as a multiple of the time one takes, so that a slow machine keeps time for
/// its frames.
const REBUILT_S: f64 = 5.0;
const REBUILT_SHARE: f64 = 10.0;
/// Frames from which the noise can be measured well enough to rebuild the problem.
const ENOUGH: usize = 4;
/// Frames needed to learn the first background, and to learn it anew.
const FRAMES: usize = 12;
const FRAMES_AGAIN: usize = 8;
/// Consecutive frames that must fit the old background before it is used again.
const FITTING: usize = 3;
/// The light may differ from the old background's by at most this many `light_step`s.
const NEAR: f64 = 2.0;

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
            Phase::Learning(_) => State::Relearning,
            Phase::Watching => State::Watching,
        }
    }

    /// Learns the background anew from now on, with whatever is in the room.
    pub fn reset(&mut self, reconstructor: &Reconstructor) {
        tracing::info!("the background is learned anew, as asked");
        self.learn_anew(reconstructor, true, false);
    }

    /// Processes a frame; returns its map, or none while learning.
    pub fn step(
        &mut self,
        seen: &FrameLight,
        reconstructor: &mut Reconstructor,
    ) -> Result<Option<Reconstruction>, KeeperError> {
        let step_s = self.advance(seen.seconds);
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
            self.learn(seen, reconstructor)?;
            if let Phase::Learning(_) = self.phase {
                return Ok(None);
            }
        }
        self.take_rebuilt(reconstructor);
        let Some(map) = reconstructor.reconstruct_in_noise(seen.pair, seen.excess)? else {
            return Err(KeeperError::NoBackground);
        };
        let now = light(seen.raw, &reconstructor.model().counted);
        if let Some(change) = self.light.observe(seen.seconds, step_s, now, self.reference, &map) {
            self.light_changed(change, reconstructor);
            return Ok(None);
        }
        self.follow(seen, step_s, &map, reconstructor);
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
        let fits = may_return.then_some(0);
        self.phase = Phase::Learning(Box::new(Learning { startup, again, fits, building: None }));
        self.rebuilding = None;
        self.candidate.clear();
    }

    fn learn(&mut self, seen: &FrameLight, reconstructor: &mut Reconstructor) -> Result<(), KeeperError> {
        let Phase::Learning(learning) = &mut self.phase else { return Ok(()) };
        if let Some(fits) = &mut learning.fits {
            let map = reconstructor.reconstruct_in_noise(seen.pair, seen.excess)?;
            let fitting = map.is_some_and(|map| map.is_empty() && self.light.is_noise(map.energy, NOISY));
            let now = light(seen.raw, &reconstructor.model().counted);
            let near = (0..6).all(|k| {
                let (now, then) = (now[k / 3][k % 3], self.reference[k / 3][k % 3]);
                (now - then).abs() <= NEAR * self.settings.light_step * then
            });
            *fits = if fitting && near { *fits + 1 } else { 0 };
            if *fits >= FITTING {
                tracing::info!("the light is what it was before: the old background is used again");
                self.phase = Phase::Watching;
                self.light.restart();
                return Ok(());
            }
        }
        if let Some((job, rolling)) = learning.building.take() {
            match job.poll() {
                Err(running) => learning.building = Some((running, rolling)),
                Ok(Some(prepared)) => {
                    reconstructor.install(prepared);
                    self.watch(rolling, reconstructor, true);
                    return Ok(());
                }
                // The thread has reported the reason. Later frames may succeed.
                Ok(None) => {}
            }
            return Ok(());
        }
        // An average that is not full yet is noisier than the ones to come.
        if seen.excess == 1.0 {
            learning.startup.push(seen.pair, seen.seconds);
        }
        if let Some(Learned { background, still }) = learning.startup.learned() {
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
            if self.work == Work::InPlace {
                return self.learn(seen, reconstructor);
            }
        }
        Ok(())
    }

    /// Starts to watch with this background, whose problem is already installed.
    fn watch(&mut self, rolling: RollingBackground, reconstructor: &Reconstructor, verified: bool) {
        let known_noise = reconstructor.model().kind == ModelKind::Signed;
        self.light = LightWatch::new(self.settings.light_step, known_noise, verified);
        self.rolling = Some(rolling);
        self.use_reference(reconstructor);
        self.candidate.clear();
        self.age_s = 0.0;
        self.timers = Timers { detected: CALM_S, ..Timers::default() };
        self.phase = Phase::Watching;
    }

    fn use_reference(&mut self, reconstructor: &Reconstructor) {
        let counted = &reconstructor.model().counted;
        self.reference = reconstructor.reference().map_or(Light::default(), |reference| light(reference, counted));
    }

    /// Lets the background follow the frame if nobody can be in it, and absorbs what does not move.
    fn follow(&mut self, seen: &FrameLight, step_s: f64, map: &Reconstruction, reconstructor: &mut Reconstructor) {
        let Some(rolling) = &mut self.rolling else { return };
        if map.is_empty() {
            self.candidate.refute(step_s);
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
            // Rebuild at once.
            (self.timers.built, self.timers.checked) = (self.settings.rebuild_s.max(self.rebuilt_s), CHECK_S);
        }
    }

    fn take_rebuilt(&mut self, reconstructor: &mut Reconstructor) {
        match self.rebuilding.take().map(Job::poll) {
            None => {}
            Some(Err(running)) => self.rebuilding = Some(running),
            // It failed and has reported the reason: the old problem stays.
            Some(Ok(None)) => {}
            Some(Ok(Some(prepared))) => {
                if self.work == Work::Aside {
                    self.rebuilt_s = REBUILT_S.max(REBUILT_SHARE * prepared.took.as_secs_f64());
                }
                reconstructor.install(prepared);
                self.use_reference(reconstructor);
            }
        }
    }

    /// Rebuilds the problem for the present background, on another thread, when the current one no longer fits.
    fn rebuild_if_due(&mut self, reconstructor: &mut Reconstructor) {
        let Some(rolling) = &self.rolling else { return };
        let early = self.timers.checked < CHECK_S || self.timers.built < self.rebuilt_s;
        // The noise of a background with fewer frames was guessed from a frame's difference, which a rebuild lacks.
        if self.rebuilding.is_some() || early || rolling.deviations() < ENOUGH {
            return;
        }
        self.timers.checked = 0.0;
        let lit = light(rolling.mean(), &reconstructor.model().counted);
        let relative = |k: usize| (lit[k / 3][k % 3] / self.reference[k / 3][k % 3].max(f64::MIN_POSITIVE) - 1.0).abs();
        let moved = (0..6).any(|k| relative(k) > MOVED_LIGHT)
            || reconstructor.departure(rolling.mean(), None).is_some_and(|share| share > MOVED);
        if moved || self.timers.built >= self.settings.rebuild_s {
            self.timers.built = 0.0;
            let (model, snapshot) = (reconstructor.model().clone(), rolling.snapshot());
            self.rebuilding = Some(Job::in_turn(self.work, "background", move || {
                let background = snapshot.background();
                let nothing = PatchPair::zeros(model.patch.size);
                Prepared::new(&model, &background, &nothing)
            }));
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

/// Builds the problem for a background to which `frame` belongs.
fn prepare(work: Work, background: Background, frame: PatchPair, reconstructor: &Reconstructor) -> Job<Prepared> {
    let model = reconstructor.model().clone();
    Job::in_turn(work, "background", move || {
        let mut difference = PatchPair::zeros(model.patch.size);
        background.difference(&frame, &mut difference);
        Prepared::new(&model, &background, &difference)
    })
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
