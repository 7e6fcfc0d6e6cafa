//! Measures the light on the floor: from images to patch pairs in linear light and the difference measurement of eq. 4.

mod albedo;
mod averaging;
mod background;
mod drift;
mod fan;
mod noise;
mod patch;
mod radiometry;
mod rectify;
mod resample;
mod rolling;
mod saved;
mod sensing;
mod signal;
mod startup;
mod stillness;
mod texture;
mod usable;

pub use albedo::{Floor, light_window};
pub use averaging::{Averager, Averaging};
pub use background::Background;
pub use drift::drift_patterns;
pub use fan::{Fan, FanPair};
pub use noise::NoiseModel;
pub use patch::{Patch, PatchPair};
pub use radiometry::{Decoding, LightTable};
pub use rectify::{CameraRectifier, PatchRectifier, WrongSize};
pub use resample::{Filter, PatchResampler};
pub use rolling::{RollingBackground, Snapshot};
pub use saved::{Fingerprint, LoadError};
pub use sensing::Sensing;
pub use signal::Signal;
pub use startup::{Learned, Startup, StartupSpec};
pub use texture::texture_strength;
pub use usable::Usable;
