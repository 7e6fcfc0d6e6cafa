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
}

#[derive(Clone)]
struct KeptBackground {
    file: PathBuf,
    settings: Arc<dyn Fn() -> String + Send + Sync>,
}

impl Setup {
    /// With everything but the calibration.
    pub fn new(config: Config) -> Self {
        Self { config, kept: None }
    }

    /// Keeps the background in `file`, for as long as what `settings` says of the camera stays the same.
    pub fn keeping(mut self, file: PathBuf, settings: impl Fn() -> String + Send + Sync + 'static) -> Self {
        self.kept = Some(KeptBackground { file, settings: Arc::new(settings) });
        self
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
        let engine =
            Engine::new(reader, Reconstructor::new(Arc::new(model), true)).following(People::new(&self.config));
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
