use std::sync::Arc;

use super::{Engine, FrameReader, Model, Reconstructor, SetupError};
use crate::config::Config;
use crate::measurement::{Calibration, Check};

/// What makes an engine of a calibration: the configuration.
#[derive(Debug, Clone)]
pub struct Setup {
    config: Config,
}

impl Setup {
    /// With everything but the calibration.
    pub fn new(config: Config) -> Self {
        Self { config }
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
        Ok(Engine::new(reader, Reconstructor::new(Arc::new(model), true)))
    }

    /// With the lens and the transfer function of the configuration, where the calibration does not tell.
    fn complete(&self, calibration: &Calibration) -> Calibration {
        let mut complete = calibration.clone();
        complete.lens = complete.lens.or(self.config.camera.lens());
        complete.transfer = complete.transfer.or(Some(self.config.camera.transfer.clone()));
        complete
    }
}
