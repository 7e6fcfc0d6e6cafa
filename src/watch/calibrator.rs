//! The calibration in use: reported, checked, replaced and saved while frames keep coming.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use serde::Serialize;
use utoipa::ToSchema;

use crate::config::Config;
use crate::watch::calibration_store::{CalibrationStore, StoreError};
use crate::watch::{Command, Control, Hub};
use doorcam_core::calibration::{Calibration, Check};
use doorcam_core::schema;
use doorcam_engine::{Assembly, Engine, SetupError};

/// Where a run's calibration is stored, if it may be changed at all.
#[derive(Debug)]
pub enum Keeping {
    /// In a file.
    File(CalibrationStore),
    /// Not stored. The text says in one line why it cannot be changed.
    Fixed(String),
}

/// Checks, applies and saves calibrations.
pub struct Calibrator {
    keeping: Keeping,
    hub: Arc<Hub>,
    control: Control,
    state: Mutex<State>,
}

struct State {
    assembly: Assembly,
    calibration: Option<Calibration>,
    revision: u32,
}

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
}

impl Calibrator {
    /// For the run that `control` commands; `calibration` is the one in use.
    pub fn new(
        assembly: Assembly,
        keeping: Keeping,
        calibration: Option<Calibration>,
        hub: Arc<Hub>,
        control: Control,
    ) -> Self {
        Self { keeping, hub, control, state: Mutex::new(State { assembly, calibration, revision: 0 }) }
    }

    /// The calibration in use and what can be done with it.
    pub fn report(&self) -> CalibrationReport {
        let calibration = self.state().calibration.clone();
        let (editable, reason, previous) = match &self.keeping {
            Keeping::File(store) => (true, None, store.has_previous()),
            Keeping::Fixed(reason) => (false, Some(reason.clone()), false),
        };
        let size = self.hub.size().or(calibration.as_ref().map(|c| c.size));
        CalibrationReport {
            editable,
            reason,
            size,
            check: calibration.as_ref().map(|c| self.check(c)),
            calibration,
            previous,
        }
    }

    /// The calibration in use, with the configuration's lens and transfer function where it has none of its own.
    pub fn calibration(&self) -> Option<Calibration> {
        let state = self.state();
        state.calibration.as_ref().map(|calibration| state.assembly.complete(calibration))
    }

    /// Checks a calibration without using it.
    pub fn check(&self, calibration: &Calibration) -> Check {
        // Checking takes a while: work on a copy instead of holding the lock.
        let assembly = self.state().assembly.clone();
        self.check_with(&assembly, calibration)
    }

    fn check_with(&self, assembly: &Assembly, calibration: &Calibration) -> Check {
        let mut check = assembly.check(calibration);
        if let Some(size) = self.hub.size().filter(|size| *size != calibration.size) {
            let ([w, h], [cw, ch]) = (calibration.size, size);
            check.ok = false;
            check.errors.push(format!("size: the calibration is for {w} x {h} pixels, the camera gives {cw} x {ch}"));
        }
        check
    }

    /// Uses a calibration from the next frame on and saves it, keeping the one before as the previous one.
    ///
    /// # Errors
    /// If it may not be changed, fails its check or cannot be saved, or the source has ended.
    pub fn replace(&self, calibration: Calibration) -> Result<(), CalibrationRefused> {
        let Keeping::File(store) = &self.keeping else { return Err(self.fixed()) };
        let mut state = self.state();
        let engine = self.engine(&state.assembly, &calibration, state.revision + 1)?;
        store.save(&calibration)?;
        self.go_on_with(&mut state, calibration, engine)
    }

    /// Swaps the calibration in use with the previous one.
    ///
    /// # Errors
    /// As [`Self::replace`], and if there is no previous calibration.
    pub fn restore(&self) -> Result<(), CalibrationRefused> {
        let Keeping::File(store) = &self.keeping else { return Err(self.fixed()) };
        let mut state = self.state();
        let calibration = store.previous()?.ok_or(CalibrationRefused::NoPrevious)?;
        let engine = self.engine(&state.assembly, &calibration, state.revision + 1)?;
        store.save(&calibration)?;
        self.go_on_with(&mut state, calibration, engine)
    }

    /// Uses another configuration of room, grid, model and tracker from the next frame on. The calibration stays the
    /// same, but its revision changes because the map does.
    ///
    /// # Errors
    /// If it may not be changed, does not fit the calibration, or the source has ended.
    pub fn reconfigure(&self, config: &Config) -> Result<(), CalibrationRefused> {
        let Keeping::File(_) = &self.keeping else { return Err(self.fixed()) };
        let mut state = self.state();
        let assembly = state.assembly.with(config.settings());
        if let Some(calibration) = state.calibration.clone() {
            let engine = self.engine(&assembly, &calibration, state.revision + 1)?;
            self.go_on_with(&mut state, calibration, engine)?;
        }
        state.assembly = assembly;
        Ok(())
    }

    fn engine(
        &self,
        assembly: &Assembly,
        calibration: &Calibration,
        revision: u32,
    ) -> Result<Engine, CalibrationRefused> {
        let check = self.check_with(assembly, calibration);
        if let Some(error) = check.errors.first() {
            return Err(CalibrationRefused::Unfit(error.clone()));
        }
        let unfit = |e: SetupError| CalibrationRefused::Unfit(e.to_string());
        assembly.clone().of_calibration(revision).for_camera(calibration).map_err(unfit)
    }

    fn go_on_with(
        &self,
        state: &mut State,
        calibration: Calibration,
        engine: Engine,
    ) -> Result<(), CalibrationRefused> {
        state.revision += 1;
        state.calibration = Some(calibration);
        if self.control.tell(Command::Use(Box::new(engine))) { Ok(()) } else { Err(CalibrationRefused::Ended) }
    }

    fn fixed(&self) -> CalibrationRefused {
        let reason = match &self.keeping {
            Keeping::Fixed(reason) => reason.clone(),
            Keeping::File(_) => String::new(),
        };
        CalibrationRefused::Fixed(reason)
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
