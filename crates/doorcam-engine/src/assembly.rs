//! How an engine is put together: one place, whoever needs one.

use std::path::PathBuf;
use std::sync::Arc;

use doorcam_core::calibration::{Calibration, Check};
use doorcam_core::geometry::Doorway;
use doorcam_source::RawFrame;
use doorcam_source::recording::Manifest;

use crate::background::BackgroundStore;
use crate::{Engine, FrameReader, Model, People, Reconstructor, Settings, SetupError, Work};

/// A plan of an engine: say what it should do, in any order, then for which doorway. One plan makes any number of engines.
///
/// Without further words an engine follows people, starts each solution from the one before, and takes the mean of the frames
/// of the empty room that a recording names for the background, from the first map on for ever.
#[derive(Clone)]
pub struct Assembly {
    settings: Arc<Settings>,
    warm_start: bool,
    following: bool,
    background: BackgroundPlan,
    kept: Option<KeptBackground>,
    /// The first numbers of tracks and events.
    first: [u64; 2],
    calibration: u32,
    fault: Option<Fault>,
}

/// Told of each frame before it is worked on; it may panic.
type Fault = Arc<dyn Fn(&RawFrame) + Send + Sync>;

/// What becomes of the background.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum BackgroundPlan {
    /// The recording's frames of the empty room, for ever.
    Given,
    /// Learned and followed; long work is done there.
    Rolling(Work),
}

#[derive(Clone)]
struct KeptBackground {
    file: PathBuf,
    settings: Arc<dyn Fn() -> String + Send + Sync>,
}

/// What an engine's parts are made for: the doorway as one source shows it.
struct View {
    reader: FrameReader,
    doorway: Doorway,
    /// In words, all of the camera that a saved background depends on.
    words: String,
}

impl Assembly {
    /// A plan with these settings.
    pub fn new(settings: Settings) -> Self {
        Self {
            settings: Arc::new(settings),
            warm_start: true,
            following: true,
            background: BackgroundPlan::Given,
            kept: None,
            first: [1, 0],
            calibration: 0,
            fault: None,
        }
    }

    /// The settings.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// The same plan with other settings.
    pub fn with(&self, settings: Settings) -> Self {
        Self { settings: Arc::new(settings), ..self.clone() }
    }

    /// Solves each frame from the empty map, so that its update does not depend on the frames before.
    pub fn cold_starts(mut self) -> Self {
        self.warm_start = false;
        self
    }

    /// Makes maps only: nobody is looked for between the facets.
    pub fn without_people(mut self) -> Self {
        self.following = false;
        self
    }

    /// Lets the background follow the room: it is learned from a live camera's first seconds (or a recording's frames of the
    /// empty room), follows slow changes, and is learned anew when the light changes. `work` says where long work is done.
    pub fn rolling(mut self, work: Work) -> Self {
        self.background = BackgroundPlan::Rolling(work);
        self
    }

    /// Keeps a rolling background in `file` from run to run, as long as what `settings` says of the camera (exposure, gain,
    /// white balance) stays the same. It is asked each time, because some of it is found while frames come.
    pub fn keeping(mut self, file: impl Into<PathBuf>, settings: impl Fn() -> String + Send + Sync + 'static) -> Self {
        self.kept = Some(KeptBackground { file: file.into(), settings: Arc::new(settings) });
        self
    }

    /// Gives no numbers of tracks and events below these.
    pub fn counting_from(mut self, track: u64, event: u64) -> Self {
        self.first = [track, event];
        self
    }

    /// Gives updates the number of the calibration that they are of.
    pub fn of_calibration(mut self, revision: u32) -> Self {
        self.calibration = revision;
        self
    }

    /// Tells `fault` of each frame before it is worked on. Tests make it panic, to see what becomes of the engine.
    pub fn with_fault(mut self, fault: impl Fn(&RawFrame) + Send + Sync + 'static) -> Self {
        self.fault = Some(Arc::new(fault));
        self
    }

    pub(crate) fn meet(&self, frame: &RawFrame) {
        if let Some(fault) = &self.fault {
            fault(frame);
        }
    }

    /// What a calibration would be worth.
    pub fn check(&self, calibration: &Calibration) -> Check {
        self.complete(calibration).check(&Model::patch_grid(&self.settings, None))
    }

    /// A calibration with the lens and the transfer function of the settings where it does not tell.
    pub fn complete(&self, calibration: &Calibration) -> Calibration {
        let mut complete = calibration.clone();
        complete.lens = complete.lens.or(self.settings.lens);
        complete.transfer = complete.transfer.or_else(|| Some(self.settings.transfer.clone()));
        complete
    }

    /// An engine for the frames of a recording. Takes some tenths of a second.
    ///
    /// # Errors
    /// If the room, the grid or the patches do not fit the recording's doorway, or its floor points fix no camera.
    pub fn for_recording(&self, manifest: &Manifest) -> Result<Engine, SetupError> {
        let reader = FrameReader::for_recording(&self.settings, manifest)?;
        let words = format!("{:?}", manifest.calibration());
        self.build(View { reader, doorway: manifest.doorway, words })
    }

    /// An engine for a camera that is calibrated so. Takes some tenths of a second.
    ///
    /// # Errors
    /// If the room, the grid or the patches do not fit the doorway, or the floor points fix no camera.
    pub fn for_camera(&self, calibration: &Calibration) -> Result<Engine, SetupError> {
        let calibration = self.complete(calibration);
        let reader = FrameReader::for_calibration(&self.settings, &calibration)?;
        self.build(View { reader, doorway: calibration.doorway, words: format!("{calibration:?}") })
    }

    fn build(&self, view: View) -> Result<Engine, SetupError> {
        let View { reader, doorway, words } = view;
        let model = Model::new(&self.settings, doorway, reader.patch(), reader.seen())?;
        Ok(Engine::assemble(Parts { plan: self.clone(), reader, model: Arc::new(model), words }))
    }
}

/// What an engine is made of, and can be made of again.
#[derive(Clone)]
pub(crate) struct Parts {
    pub(crate) plan: Assembly,
    pub(crate) reader: FrameReader,
    pub(crate) model: Arc<Model>,
    words: String,
}

impl Parts {
    pub(crate) fn reconstructor(&self) -> Reconstructor {
        Reconstructor::new(Arc::clone(&self.model), self.plan.warm_start)
    }

    pub(crate) fn people(&self) -> Option<People> {
        let [track, event] = self.plan.first;
        self.plan.following.then(|| People::new(&self.plan.settings).counting_from(track, event))
    }

    pub(crate) fn background(&self) -> BackgroundPlan {
        self.plan.background
    }

    pub(crate) fn calibration(&self) -> u32 {
        self.plan.calibration
    }

    /// Where the background is kept, if anywhere. Frames averaged as `averaging` says have a noise of their own.
    pub(crate) fn store(&self, averaging: &str) -> Option<BackgroundStore> {
        let KeptBackground { file, settings } = self.plan.kept.clone()?;
        let (words, averaging) = (self.words.clone(), averaging.to_owned());
        Some(BackgroundStore::new(file, move || format!("{words}; {}; {averaging}", settings())))
    }
}
