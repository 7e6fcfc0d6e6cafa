//! The calibration in use: reported, checked, replaced and saved while frames keep coming.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

use serde::Serialize;
use tokio::sync::oneshot;
use utoipa::ToSchema;

use crate::config::Config;
use crate::watch::calibration_store::{CalibrationStore, StoreError};
use crate::watch::{Command, Control, Hub};
use doorcam_core::calibration::{Calibration, Check};
use doorcam_core::schema;
use doorcam_engine::{Assembly, Engine, Settings, SetupError};

/// Where a run's calibration is stored, if it may be changed at all.
#[derive(Debug)]
pub enum Keeping {
    /// In a file.
    File(CalibrationStore),
    /// Not stored. The text says in one line why it cannot be changed.
    Fixed(String),
}

/// Checks, applies and saves calibrations.
///
/// Engines are built one at a time on a thread of its own. A change that waits for its turn when the next one comes is
/// not built at all, so that any number of them costs no more than the newest.
pub struct Calibrator {
    shared: Arc<Shared>,
}

struct Shared {
    keeping: Keeping,
    /// Size of the images, where it is known beforehand.
    size: Option<[usize; 2]>,
    hub: Arc<Hub>,
    control: Control,
    /// Held for moments only: nothing is built or read from a disk meanwhile.
    state: Mutex<State>,
    waiting: Mutex<Waiting>,
    changed: Condvar,
}

struct State {
    assembly: Assembly,
    calibration: Option<Calibration>,
    revision: u32,
}

/// What the builder has to do next.
#[derive(Default)]
struct Waiting {
    change: Option<(Change, Answer)>,
    settings: Option<(Box<Settings>, Answer)>,
    /// A calibration that has followed the camera by itself, and the revision that it replaces.
    followed: Option<(u32, Calibration)>,
    closed: bool,
}

/// A change of the calibration, and what must still be true of the one in use when it is made.
struct Change {
    to: To,
    only_if: Precondition,
}

enum To {
    This(Calibration),
    Previous,
}

/// Says whether a report is the one that a client knows.
pub type Precondition = Box<dyn Fn(&CalibrationReport) -> bool + Send>;

type Answer = oneshot::Sender<Result<(), CalibrationRefused>>;

/// The calibration in use and what can be done with it.
#[derive(Debug, Serialize, ToSchema)]
pub struct CalibrationReport {
    /// Whether it can be changed.
    pub editable: bool,
    /// Why it cannot be changed.
    #[schema(required)]
    pub reason: Option<String>,
    /// Width and height of the camera's images now, in pixels; null before its first frame.
    #[schema(value_type = Option<schema::Size>, required)]
    pub size: Option<[usize; 2]>,
    /// The calibration in use; null if there is none yet.
    #[schema(required)]
    pub calibration: Option<Calibration>,
    /// The result of checking it.
    #[schema(required)]
    pub check: Option<Check>,
    /// Whether the previous calibration is stored and can be restored.
    pub previous: bool,
}

/// Why a calibration was not put into use.
#[derive(Debug, thiserror::Error)]
pub enum CalibrationRefused {
    /// The calibration of this run may not be changed.
    #[error("{0}")]
    Fixed(String),
    /// It does not determine where the camera sees the floor.
    #[error("{0}")]
    Unfit(String),
    /// There is no previous calibration.
    #[error("there is no previous calibration")]
    NoPrevious,
    /// It could not be read or saved.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The source ended.
    #[error("the source has ended: no frames will come")]
    Ended,
    /// The one in use is not the one that the client knows.
    #[error("the calibration in use is not the one that If-Match names: read it again")]
    Stale,
    /// Another change came before this one was made.
    #[error("another change of the calibration came before this one was made: this one is not used")]
    Superseded,
    /// It failed on an internal error.
    #[error("the calibration failed on an internal error")]
    Internal,
}

impl Calibrator {
    /// For the run that `control` commands; `calibration` is the one in use. `size` is that of the images where it is
    /// known beforehand, as with recordings; a camera tells it once it is open.
    ///
    /// # Errors
    /// If the builder's thread cannot be started.
    pub fn new(
        assembly: Assembly,
        keeping: Keeping,
        calibration: Option<Calibration>,
        size: Option<[usize; 2]>,
        hub: Arc<Hub>,
        control: Control,
    ) -> std::io::Result<Self> {
        let state = Mutex::new(State { assembly, calibration, revision: 0 });
        let (waiting, changed) = (Mutex::default(), Condvar::new());
        let shared = Arc::new(Shared { keeping, size, hub, control, state, waiting, changed });
        std::thread::Builder::new().name("calibrate".into()).spawn({
            let shared = Arc::clone(&shared);
            move || shared.build()
        })?;
        let follower = Arc::downgrade(&shared);
        shared.hub.on_followed(move |revision, calibration| {
            if let Some(shared) = follower.upgrade() {
                shared.hand_over(|waiting| waiting.followed = Some((revision, calibration)));
            }
        });
        Ok(Self { shared })
    }

    /// The calibration in use and what can be done with it.
    pub fn report(&self) -> CalibrationReport {
        self.shared.report()
    }

    /// The calibration in use, with the configuration's lens and transfer function where it has none of its own.
    pub fn calibration(&self) -> Option<Calibration> {
        let state = self.shared.state();
        state.calibration.as_ref().map(|calibration| state.assembly.complete(calibration))
    }

    /// Checks a calibration without using it: it is `ok` if and only if [`Self::replace`] would use it.
    pub fn check(&self, calibration: &Calibration) -> Check {
        self.shared.check(calibration)
    }

    /// Uses a calibration from the next frame on and saves it, keeping the one before as the previous one. Nothing
    /// changes unless `only_if` holds for the report at that moment.
    ///
    /// # Errors
    /// If it may not be changed, fails its check or cannot be saved, if `only_if` does not hold, if another change
    /// comes before this one is made, or the source has ended.
    pub async fn replace(&self, calibration: Calibration, only_if: Precondition) -> Result<(), CalibrationRefused> {
        self.ask(To::This(calibration), only_if).await
    }

    /// Swaps the calibration in use with the previous one.
    ///
    /// # Errors
    /// As [`Self::replace`], and if there is no previous calibration.
    pub async fn restore(&self, only_if: Precondition) -> Result<(), CalibrationRefused> {
        self.ask(To::Previous, only_if).await
    }

    async fn ask(&self, to: To, only_if: Precondition) -> Result<(), CalibrationRefused> {
        let (tell, told) = oneshot::channel();
        let superseded = self.shared.hand_over(|waiting| waiting.change.replace((Change { to, only_if }, tell)));
        if let Some((_, before)) = superseded {
            // Nobody may be waiting for it any more.
            let _ = before.send(Err(CalibrationRefused::Superseded));
        }
        told.await.unwrap_or(Err(CalibrationRefused::Internal))
    }

    /// Uses another configuration of room, grid, model and tracker from the next frame on. The calibration stays the
    /// same, but its revision changes because the map does. Waits until that is done: not to be called on an async
    /// worker.
    ///
    /// # Errors
    /// If it may not be changed, does not fit the calibration, or the source has ended.
    pub fn reconfigure(&self, config: &Config) -> Result<(), CalibrationRefused> {
        let (tell, told) = oneshot::channel();
        let settings = Box::new(config.settings());
        let superseded = self.shared.hand_over(|waiting| waiting.settings.replace((settings, tell)));
        if let Some((_, before)) = superseded {
            let _ = before.send(Err(CalibrationRefused::Superseded));
        }
        told.blocking_recv().unwrap_or(Err(CalibrationRefused::Internal))
    }
}

impl Drop for Calibrator {
    fn drop(&mut self) {
        self.shared.hand_over(|waiting| waiting.closed = true);
    }
}

impl Shared {
    /// Changes what waits for the builder, and wakes it.
    fn hand_over<T>(&self, change: impl FnOnce(&mut Waiting) -> T) -> T {
        let result = change(&mut self.waiting.lock().unwrap_or_else(PoisonError::into_inner));
        self.changed.notify_one();
        result
    }

    /// The builder: makes one change after the other until the calibrator is dropped.
    fn build(&self) {
        let idle = |waiting: &mut Waiting| {
            let nothing = waiting.change.is_none() && waiting.settings.is_none() && waiting.followed.is_none();
            nothing && !waiting.closed
        };
        loop {
            let waiting = self.waiting.lock().unwrap_or_else(PoisonError::into_inner);
            let mut waiting = self.changed.wait_while(waiting, idle).unwrap_or_else(PoisonError::into_inner);
            let (settings, change, followed) =
                (waiting.settings.take(), waiting.change.take(), waiting.followed.take());
            if waiting.closed {
                return;
            }
            drop(waiting);
            if let Some((revision, calibration)) = followed {
                // A panic, which is reported when it happens, costs this change only.
                let _ = catch_unwind(AssertUnwindSafe(|| self.follow(revision, &calibration)));
            }
            if let Some((settings, answer)) = settings {
                self.answer(answer, || self.use_settings(*settings));
            }
            if let Some((change, answer)) = change {
                self.answer(answer, || self.make(change));
            }
        }
    }

    /// Sends the result of a change. A panic, which has been reported when it happened, costs this change only.
    fn answer(&self, answer: Answer, make: impl FnOnce() -> Result<(), CalibrationRefused>) {
        let made = catch_unwind(AssertUnwindSafe(make)).unwrap_or(Err(CalibrationRefused::Internal));
        // The client may have gone.
        let _ = answer.send(made);
    }

    fn make(&self, Change { to, only_if }: Change) -> Result<(), CalibrationRefused> {
        let store = self.store()?;
        if !only_if(&self.report()) {
            return Err(CalibrationRefused::Stale);
        }
        let calibration = match to {
            To::This(calibration) => calibration,
            To::Previous => store.previous()?.ok_or(CalibrationRefused::NoPrevious)?,
        };
        let (assembly, revision) = self.next();
        let engine = self.engine(&assembly, &calibration, revision)?;
        store.save(&calibration)?;
        self.go_on_with(assembly, Some(calibration), Some(engine))
    }

    /// Keeps a calibration that has followed the camera, and the one before as the previous one. The engine uses it
    /// already.
    fn follow(&self, replaced: u32, followed: &Calibration) {
        let calibration = {
            let mut state = self.state();
            // Another one may have come meanwhile.
            let Some(before) = state.calibration.as_ref().filter(|_| state.revision == replaced) else { return };
            // The engine's has the configuration's lens, where it has none of its own.
            let calibration = Calibration { floor_points: followed.floor_points.clone(), ..before.clone() };
            state.calibration = Some(calibration.clone());
            state.revision += 1;
            self.control.tell(Command::Revise(state.revision));
            calibration
        };
        if let Keeping::File(store) = &self.keeping
            && let Err(e) = store.save(&calibration)
        {
            tracing::warn!("{e}: the calibration that has followed the camera is kept for this run only");
        }
    }

    fn use_settings(&self, settings: Settings) -> Result<(), CalibrationRefused> {
        self.store()?;
        let (assembly, revision) = self.next();
        let assembly = assembly.with(settings);
        let calibration = self.state().calibration.clone();
        let engine = calibration.as_ref().map(|c| self.engine(&assembly, c, revision)).transpose()?;
        self.go_on_with(assembly, calibration, engine)
    }

    /// Where the calibration is kept, if it may be changed.
    fn store(&self) -> Result<&CalibrationStore, CalibrationRefused> {
        match &self.keeping {
            Keeping::File(store) => Ok(store),
            Keeping::Fixed(reason) => Err(CalibrationRefused::Fixed(reason.clone())),
        }
    }

    /// The assembly in use, and the next calibration's revision.
    fn next(&self) -> (Assembly, u32) {
        let state = self.state();
        (state.assembly.clone(), state.revision + 1)
    }

    fn engine(
        &self,
        assembly: &Assembly,
        calibration: &Calibration,
        revision: u32,
    ) -> Result<Engine, CalibrationRefused> {
        if let Some(error) = self.check_with(assembly, calibration).errors.first() {
            return Err(CalibrationRefused::Unfit(error.clone()));
        }
        let unfit = |e: SetupError| CalibrationRefused::Unfit(e.to_string());
        assembly.clone().of_calibration(revision).for_camera(calibration).map_err(unfit)
    }

    fn go_on_with(
        &self,
        assembly: Assembly,
        calibration: Option<Calibration>,
        engine: Option<Engine>,
    ) -> Result<(), CalibrationRefused> {
        let mut state = self.state();
        (state.assembly, state.calibration) = (assembly, calibration);
        let Some(engine) = engine else { return Ok(()) };
        state.revision += 1;
        if self.control.tell(Command::Use(Box::new(engine))) { Ok(()) } else { Err(CalibrationRefused::Ended) }
    }

    fn report(&self) -> CalibrationReport {
        let calibration = self.state().calibration.clone();
        let (editable, reason, previous) = match &self.keeping {
            Keeping::File(store) => (true, None, store.has_previous()),
            Keeping::Fixed(reason) => (false, Some(reason.clone()), false),
        };
        let size = self.image_size().or(calibration.as_ref().map(|c| c.size));
        CalibrationReport {
            editable,
            reason,
            size,
            check: calibration.as_ref().map(|c| self.check(c)),
            calibration,
            previous,
        }
    }

    fn check(&self, calibration: &Calibration) -> Check {
        let assembly = self.state().assembly.clone();
        self.check_with(&assembly, calibration)
    }

    fn check_with(&self, assembly: &Assembly, calibration: &Calibration) -> Check {
        let mut check = assembly.check(calibration);
        if let Some(size) = self.image_size().filter(|size| *size != calibration.size) {
            let ([w, h], [cw, ch]) = (calibration.size, size);
            check.ok = false;
            check.errors.push(format!("size: the calibration is for {w} x {h} pixels, the camera gives {cw} x {ch}"));
        }
        check
    }

    /// Size of the images that come.
    fn image_size(&self) -> Option<[usize; 2]> {
        self.hub.size().or(self.size)
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
