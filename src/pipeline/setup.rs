use std::path::PathBuf;
use std::sync::Arc;

use super::{BackgroundStore, Engine, FrameReader, Model, People, Reconstructor, SetupError};
use crate::config::Config;
use crate::measurement::{Calibration, Check};

/// What makes an engine of a calibration: the configuration, and where the background is kept.
#[derive(Clone)]
pub struct Setup {
    config: Config,
    kept: Option<KeptBackground>,
    /// The first numbers of tracks and events.
    first: [u64; 2],
}

#[derive(Clone)]
struct KeptBackground {
    file: PathBuf,
    settings: Arc<dyn Fn() -> String + Send + Sync>,
}

impl Setup {
    /// With everything but the calibration.
    pub fn new(config: Config) -> Self {
        Self { config, kept: None, first: [1, 0] }
    }

    /// Keeps the background in `file`, for as long as what `settings` says of the camera stays the same.
    pub fn keeping(mut self, file: PathBuf, settings: impl Fn() -> String + Send + Sync + 'static) -> Self {
        self.kept = Some(KeptBackground { file, settings: Arc::new(settings) });
        self
    }

    /// Gives no numbers of tracks and events below these.
    pub fn counting_from(mut self, track: u64, event: u64) -> Self {
        self.first = [track, event];
        self
    }

    /// The same with another configuration; what is kept where stays.
    pub fn with(&self, config: Config) -> Self {
        Self { config, ..self.clone() }
    }

    /// What a calibration would be worth.
    pub fn check(&self, calibration: &Calibration) -> Check {
        self.complete(calibration).check(&Model::patch_grid(&self.config, None))
    }

    /// An engine for a camera that is calibrated so. Takes some tenths of a second.
    pub fn engine(&self, calibration: &Calibration) -> Result<Engine, SetupError> {
        let calibration = self.complete(calibration);
        let reader = FrameReader::for_calibration(&self.config, &calibration)?;
        let model = Model::new(&self.config, calibration.doorway, reader.patch(), reader.seen())?;
        let store = self.kept.clone().map(|KeptBackground { file, settings }| {
            BackgroundStore::new(file, move || format!("{calibration:?}; {}", settings()))
        });
        let [track, event] = self.first;
        let people = People::new(&self.config).counting_from(track, event);
        let engine = Engine::new(reader, Reconstructor::new(Arc::new(model), true)).following(people);
        Ok(engine.averaging(&self.config.averaging).rolling(&self.config.background, store))
    }

    /// With the lens and the transfer function of the configuration, where the calibration does not tell.
    pub(super) fn complete(&self, calibration: &Calibration) -> Calibration {
        let mut complete = calibration.clone();
        complete.lens = complete.lens.or(self.config.camera.lens());
        complete.transfer = complete.transfer.or(Some(self.config.camera.transfer.clone()));
        complete
    }
}
