//! `[storage]` and `[camera]`: the camera, and where state is kept between runs.

use std::path::PathBuf;
use std::time::Duration;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::{ConfigError, within};
use doorcam_core::optics::{Lens, Transfer};
use doorcam_core::schema;
use doorcam_engine::Settings;
use doorcam_source::camera::{CameraOptions, ControlSettings, PixelFormat, Setting, Wish};

/// `[storage]`
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields)]
pub struct StorageConfig {
    /// Directory for the calibration, the learned background, drawn zones and recordings; empty for the default.
    #[schema(value_type = String)]
    pub directory: PathBuf,
}

impl StorageConfig {
    /// The directory as configured, else the service manager's (`$STATE_DIRECTORY`), else the user's
    /// (`$XDG_STATE_HOME/doorcam`, `~/.local/state/doorcam`). None if `$HOME` is not set either.
    pub fn directory(&self) -> Option<PathBuf> {
        let variable = |name: &str| std::env::var_os(name).filter(|v| !v.is_empty()).map(PathBuf::from);
        if !self.directory.as_os_str().is_empty() {
            return Some(self.directory.clone());
        }
        variable("STATE_DIRECTORY")
            .or_else(|| variable("XDG_STATE_HOME").map(|state| state.join("doorcam")))
            .or_else(|| variable("HOME").map(|home| home.join(".local/state/doorcam")))
    }
}

/// `[camera]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields)]
pub struct CameraConfig {
    /// Width and height in pixels; once calibrated, the calibration's size is used instead.
    #[schema(value_type = schema::Size)]
    pub size: [u32; 2],
    /// Frames per second.
    pub fps: f64,
    /// Pixel formats, the preferred one first.
    pub formats: Vec<PixelFormat>,
    /// Exposure time, in units of 100 µs.
    #[schema(value_type = schema::NumberOrWord)]
    pub exposure: Setting,
    /// Gain, in the driver's units.
    #[schema(value_type = schema::NumberOrWord)]
    pub gain: Setting,
    /// White balance, in kelvin.
    #[schema(value_type = schema::NumberOrWord)]
    pub white_balance: Setting,
    /// Focus, in the driver's units.
    #[schema(value_type = schema::NumberOrWord)]
    pub focus: Setting,
    /// Mains frequency that automatic exposure allows for: 0 off, 1 50 Hz, 2 60 Hz.
    #[schema(value_type = schema::NumberOrWord)]
    pub power_line: Setting,
    /// How long the camera's automatic controls run before they are locked, in seconds.
    pub settle_s: f64,
    /// How the camera encodes light.
    pub transfer: Transfer,
    /// Radial distortion of the lens, k1 and k2 as in OpenCV.
    #[schema(value_type = schema::Pair)]
    pub distortion: [f64; 2],
    /// Focal length that goes with `distortion`, in pixels; 0: the width of the image.
    pub focal_px: f64,
    /// How far the camera may be moved, in pixels of its image, for the calibration to follow it by itself; 0 for never.
    pub follow_px: f64,
}

impl Default for CameraConfig {
    fn default() -> Self {
        let Settings { transfer, follow_px, .. } = Settings::default();
        Self {
            size: [640, 480],
            fps: 15.0,
            formats: PixelFormat::ALL.to_vec(),
            exposure: Setting::Lock,
            gain: Setting::Lock,
            white_balance: Setting::Lock,
            focus: Setting::Lock,
            power_line: Setting::Leave,
            settle_s: 2.0,
            transfer,
            // No lens: an image without distortion.
            distortion: [0.0; 2],
            focal_px: 0.0,
            follow_px,
        }
    }
}

impl CameraConfig {
    pub(super) fn check(&self) -> Result<(), ConfigError> {
        for (k, side) in ["width", "height"].into_iter().enumerate() {
            within(&format!("camera.size ({side})"), f64::from(self.size[k]), 16.0, 8192.0, "pixels")?;
        }
        within("camera.fps", self.fps, 0.1, 240.0, "frames a second")?;
        if self.formats.is_empty() {
            let all = PixelFormat::ALL.map(|f| format!("\"{f}\"")).join(", ");
            return Err(ConfigError(format!("camera.formats is empty, expected some of {all}")));
        }
        within("camera.settle_s", self.settle_s, 0.0, 600.0, "seconds")?;
        self.transfer.validate().map_err(|e| ConfigError(format!("camera.{e}")))?;
        for k in self.distortion {
            within("camera.distortion", k, -10.0, 10.0, "(k1 and k2)")?;
        }
        within("camera.focal_px", self.focal_px, 0.0, 1e5, "pixels")?;
        within("camera.follow_px", self.follow_px, 0.0, 100.0, "pixels, or 0 for never")
    }

    /// The lens, if it distorts.
    pub fn lens(&self) -> Option<Lens> {
        let [k1, k2] = self.distortion;
        let focal_px = (self.focal_px > 0.0).then_some(self.focal_px);
        (self.distortion != [0.0; 2]).then_some(Lens { k1, k2, focal_px })
    }

    /// What to ask the camera for. When frames pile up, only the newest is used.
    pub fn options(&self) -> CameraOptions {
        CameraOptions {
            wish: Wish { size: self.size, fps: self.fps, formats: self.formats.clone() },
            controls: ControlSettings {
                exposure: self.exposure,
                gain: self.gain,
                white_balance: self.white_balance,
                focus: self.focus,
                power_line: self.power_line,
                settle: Duration::from_secs_f64(self.settle_s),
            },
            newest_only: true,
        }
    }
}
