//! Assembly of engines from settings and a doorway.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use doorcam_core::calibration::{Calibration, Check};
use doorcam_core::geometry::Doorway;
use doorcam_source::RawFrame;
use doorcam_source::recording::Manifest;

use crate::alignment::Alignment;
use crate::background::BackgroundStore;
use crate::visible_side::VisibleSide;
use crate::{Engine, FrameReader, Model, People, Reconstructor, Settings, SetupError, Work};

/// A builder of engines: set options in any order, then give the doorway. It can build any number of engines.
///
/// By default an engine tracks people, starts each solution from the previous one, and uses the mean of a recording's
/// frames of the empty room as a fixed background.
#[derive(Clone)]
pub struct Assembly {
    settings: Arc<Settings>,
    warm_start: bool,
    following: bool,
    looking: bool,
    background: BackgroundPlan,
    kept: Option<KeptBackground>,
    /// The first track id and event number.
    first: [u64; 2],
    calibration: u32,
    fault: Option<Fault>,
}

/// Called with each frame before the engine works on it; it may panic.
type Fault = Arc<dyn Fn(&RawFrame) + Send + Sync>;

/// How the background is obtained.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum BackgroundPlan {
    /// Fixed: the mean of the recording's frames of the empty room.
    Given,
    /// Learned and then updated. The value says where long work runs.
    Rolling(Work),
}

#[derive(Clone)]
struct KeptBackground {
    file: PathBuf,
    settings: Arc<dyn Fn() -> String + Send + Sync>,
}

/// The doorway as seen by one source.
struct View {
    reader: FrameReader,
    doorway: Doorway,
    /// The camera properties that a saved background depends on, as text.
    words: String,
    /// Complete; none for recordings of rectified patches.
    calibration: Option<Calibration>,
}

impl Assembly {
    /// A builder with these settings and the defaults above.
    pub fn new(settings: Settings) -> Self {
        Self {
            settings: Arc::new(settings),
            warm_start: true,
            following: true,
            looking: true,
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

    /// The same options with other settings.
    pub fn with(&self, settings: Settings) -> Self {
        Self { settings: Arc::new(settings), ..self.clone() }
    }

    /// Solves each frame from the empty map, so that its update does not depend on the frames before.
    pub fn cold_starts(mut self) -> Self {
        self.warm_start = false;
        self
    }

    /// Makes maps only, without looking for people.
    pub fn without_people(mut self) -> Self {
        self.following = false;
        self
    }

    /// Does not look at more than the patches, to measure what the rest costs.
    pub(crate) fn without_looking_around(mut self) -> Self {
        self.looking = false;
        self
    }

    /// Uses a rolling background: it is learned from a live camera's first seconds (or a recording's frames of the
    /// empty room), follows slow changes, and is learned again when the light changes. `work` says where long work
    /// runs.
    pub fn rolling(mut self, work: Work) -> Self {
        self.background = BackgroundPlan::Rolling(work);
        self
    }

    /// Keeps a rolling background in `file` between runs, as long as the text that `settings` returns (exposure, gain,
    /// white balance) stays the same. It is called for each save and load, because some of these are only known once
    /// frames arrive.
    pub fn keeping(mut self, file: impl Into<PathBuf>, settings: impl Fn() -> String + Send + Sync + 'static) -> Self {
        self.kept = Some(KeptBackground { file: file.into(), settings: Arc::new(settings) });
        self
    }

    /// Sets the first track id and event number.
    pub fn counting_from(mut self, track: u64, event: u64) -> Self {
        self.first = [track, event];
        self
    }

    /// Sets the calibration's revision, which updates carry.
    pub fn of_calibration(mut self, revision: u32) -> Self {
        self.calibration = revision;
        self
    }

    /// Calls `fault` with each frame before the engine works on it. Tests make it panic to see how the engine recovers.
    pub fn with_fault(mut self, fault: impl Fn(&RawFrame) + Send + Sync + 'static) -> Self {
        self.fault = Some(Arc::new(fault));
        self
    }

    pub(crate) fn meet(&self, frame: &RawFrame) {
        if let Some(fault) = &self.fault {
            fault(frame);
        }
    }

    /// Checks a calibration without building an engine: it is `ok` if and only if [`Self::for_camera`] accepts it.
    pub fn check(&self, calibration: &Calibration) -> Check {
        let calibration = self.complete(calibration);
        let patch = Model::patch_grid(&self.settings, None);
        let mut check = calibration.check(&patch);
        if let Some(camera) = check.ok.then(|| calibration.camera().ok()).flatten() {
            let seen = calibration.patch_sights(&patch, &camera).map(|sight| sight.whole);
            let refused = Model::check(&self.settings, &calibration.doorway, &patch, Some(seen)).err();
            check.errors.extend(refused.map(|e| e.to_string()));
            check.ok = check.errors.is_empty();
        }
        check
    }

    /// The calibration, with the settings' lens, transfer function and door leaf where it has none of its own.
    pub fn complete(&self, calibration: &Calibration) -> Calibration {
        let mut complete = calibration.clone();
        complete.lens = complete.lens.or(self.settings.lens);
        complete.doorway.leaf = complete.doorway.leaf.or(self.settings.leaf);
        complete.transfer = complete.transfer.or_else(|| Some(self.settings.transfer.clone()));
        complete
    }

    /// Builds an engine for the frames of a recording. Takes a few tenths of a second.
    ///
    /// # Errors
    /// If the room, the grid or the patches do not fit the recording's doorway, or its floor points do not determine a
    /// camera.
    pub fn for_recording(&self, manifest: &Manifest) -> Result<Engine, SetupError> {
        let reader = FrameReader::for_recording(&self.settings, manifest)?;
        let calibration = manifest.calibration();
        let words = format!("{calibration:?}");
        let leaf = manifest.doorway.leaf.or(self.settings.leaf);
        let doorway = Doorway { leaf, ..manifest.doorway };
        self.build(View { reader, doorway, words, calibration })
    }

    /// Builds an engine for a calibrated camera. Takes a few tenths of a second.
    ///
    /// # Errors
    /// If the room, the grid or the patches do not fit the doorway, or the floor points do not determine a camera.
    pub fn for_camera(&self, calibration: &Calibration) -> Result<Engine, SetupError> {
        let calibration = self.complete(calibration);
        let reader = FrameReader::for_calibration(&self.settings, &calibration)?;
        let words = format!("{calibration:?}");
        self.build(View { reader, doorway: calibration.doorway, words, calibration: Some(calibration) })
    }

    fn build(&self, view: View) -> Result<Engine, SetupError> {
        let View { reader, doorway, words, calibration } = view;
        let model = Model::new(&self.settings, doorway, reader.patch(), reader.seen())?;
        let words = Arc::new(Mutex::new(words));
        Ok(Engine::assemble(Parts { plan: self.clone(), reader, model: Arc::new(model), words, calibration }))
    }
}

/// What depends on where the camera looks.
pub(crate) struct Sight {
    pub(crate) reader: FrameReader,
    /// In words why not, if the camera's own side is not looked at.
    pub(crate) visible: Result<VisibleSide, String>,
}

fn visible_side(reader: &FrameReader, model: &Model) -> Result<VisibleSide, String> {
    let (camera, size) = reader.camera().ok_or("the recording shows only the patches")?;
    VisibleSide::new(camera, size, &model.doorway, &reader.patch()).map_err(str::to_owned)
}

/// The parts that an engine is built from, and rebuilt from after a panic.
#[derive(Clone)]
pub(crate) struct Parts {
    pub(crate) plan: Assembly,
    pub(crate) reader: FrameReader,
    pub(crate) model: Arc<Model>,
    /// Shared with the store of the background: they change when the calibration follows a camera that moved.
    words: Arc<Mutex<String>>,
    calibration: Option<Calibration>,
}

impl Parts {
    pub(crate) fn reconstructor(&self) -> Reconstructor {
        Reconstructor::new(Arc::clone(&self.model), self.plan.warm_start)
    }

    pub(crate) fn people(&self) -> Option<People> {
        let [track, event] = self.plan.first;
        self.plan.following.then(|| People::new(&self.plan.settings).counting_from(track, event))
    }

    /// The camera's own side.
    ///
    /// # Errors
    /// In words, why it is not looked at.
    pub(crate) fn visible_side(&self) -> Result<VisibleSide, String> {
        if !self.plan.looking {
            return Err("it is not looked at".into());
        }
        visible_side(&self.reader, &self.model)
    }

    /// Where long work runs.
    pub(crate) fn work(&self) -> Work {
        match self.plan.background {
            BackgroundPlan::Given => Work::InPlace,
            BackgroundPlan::Rolling(work) => work,
        }
    }

    /// Sets up, when called, what depends on where the camera looks, for the same camera with another calibration:
    /// `None` if it does not show all that it should. Takes longer than a frame.
    pub(crate) fn sight(&self, calibration: &Calibration) -> impl FnOnce() -> Option<Sight> + Clone + Send + 'static {
        let (settings, model) = (Arc::clone(&self.plan.settings), Arc::clone(&self.model));
        let calibration = calibration.clone();
        move || {
            let reader = FrameReader::for_calibration(&settings, &calibration).ok()?;
            let unseen =
                |now: &[bool], counted: &[bool]| counted.iter().zip(now).any(|(&counted, &seen)| counted && !seen);
            let seen = reader.seen()?;
            let lost = seen.iter().zip(&model.counted).any(|(now, counted)| unseen(now, counted));
            (!lost).then(|| Sight { visible: visible_side(&reader, &model), reader })
        }
    }

    pub(crate) fn background(&self) -> BackgroundPlan {
        self.plan.background
    }

    pub(crate) fn calibration(&self) -> u32 {
        self.plan.calibration
    }

    /// The store of the background, if it is kept. `averaging` is part of its key, because averaging changes the noise
    /// of a frame.
    pub(crate) fn store(&self, averaging: &str) -> Option<BackgroundStore> {
        let KeptBackground { file, settings } = self.plan.kept.clone()?;
        let (words, averaging) = (Arc::clone(&self.words), averaging.to_owned());
        Some(BackgroundStore::new(file, move || {
            let words = words.lock().unwrap_or_else(PoisonError::into_inner);
            format!("{words}; {}; {averaging}", settings())
        }))
    }

    /// What watches whether the camera moves; none for recordings of rectified patches. The reference picture is kept
    /// beside the background.
    pub(crate) fn alignment(&self) -> Option<Alignment> {
        if !self.plan.looking {
            return None;
        }
        let work = self.work();
        let store = self.plan.kept.as_ref().map(|kept| (kept.file.with_file_name("reference.bin"), work));
        let patch = self.reader.patch();
        Alignment::new(self.calibration.as_ref()?, &patch, self.plan.settings.follow_px, store)
    }

    /// Builds engines for another calibration and reader from now on.
    pub(crate) fn follow(&mut self, calibration: Calibration, reader: FrameReader) {
        *self.words.lock().unwrap_or_else(PoisonError::into_inner) = format!("{calibration:?}");
        (self.calibration, self.reader) = (Some(calibration), reader);
    }
}
