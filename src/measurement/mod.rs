//! From a camera frame to the difference measurement of eq. 4.

mod accuracy;
mod albedo;
mod background;
mod calibration;
mod camera;
mod check;
mod drift;
mod fit;
mod homography;
mod lens;
mod mask;
mod noise;
mod overlay;
mod patch;
#[cfg(test)]
mod pinhole;
mod radiometry;
mod rectify;
mod resample;
mod texture;

pub use accuracy::Accuracy;
pub use albedo::{Floor, light_window};
pub use background::Background;
pub use calibration::{Calibration, CalibrationError};
pub use camera::Camera;
pub use check::{Check, PointErrors, PointResidual, Seen};
pub use drift::drift_patterns;
pub use fit::{ASSUMED_NOISE_PX, FloorFit};
pub use homography::{Homography, HomographyError};
pub use lens::{LensError, LensMap};
pub use mask::edge_foot_mask;
pub use noise::NoiseModel;
pub use overlay::{Outlines, Overlay};
pub use patch::{Patch, PatchPair};
pub use radiometry::{Decoding, LightTable};
pub use rectify::{CameraRectifier, PatchRectifier, WrongSize};
pub use resample::{Filter, PatchResampler};
pub use texture::texture_strength;
