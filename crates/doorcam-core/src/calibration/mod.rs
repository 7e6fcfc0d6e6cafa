//! Camera calibration: fits the camera to marked points whose position on the floor is known.

mod accuracy;
mod camera;
mod check;
mod fit;
mod footprint;
mod homography;
mod lens;
mod overlay;
#[cfg(test)]
pub(crate) mod pinhole;
mod values;

pub use accuracy::Accuracy;
pub use camera::Camera;
pub use check::{Check, PatchCoverage, PointErrors, PointResidual};
pub use fit::{ASSUMED_NOISE_PX, FloorFit};
pub use footprint::PatchSight;
pub(crate) use footprint::{Footprint, footprints};
pub use homography::{Homography, HomographyError, MOST_POINTS};
pub use lens::{LensError, LensMap};
pub use overlay::{Outlines, Overlay};
pub use values::{Calibration, CalibrationError, image_size};
