//! The camera model: the mapping between floor and image.

use crate::calibration::{Homography, LensMap};
use crate::geometry::Point;

/// Maps between the floor (metres, door frame) and the image as the camera delivers it (pixels, lens distortion
/// included), in both directions. Position (0, 0) is the centre of the top-left pixel.
#[derive(Debug, Clone, PartialEq)]
pub struct Camera {
    homography: Homography,
    lens: Option<LensMap>,
}

impl Camera {
    /// A camera whose ideal (undistorted) image shows the floor through `homography`.
    pub fn new(homography: Homography, lens: Option<LensMap>) -> Self {
        Self { homography, lens }
    }

    /// Image position of a floor point; `None` if the point is behind the camera or outside the lens's image circle.
    pub fn project(&self, floor: Point) -> Option<Point> {
        let ideal = self.homography.project(floor)?;
        self.lens.as_ref().map_or(Some(ideal), |lens| lens.distort(ideal))
    }

    /// Floor point seen at an image position; `None` at and above the horizon.
    pub fn floor(&self, pixel: Point) -> Option<Point> {
        self.homography.floor(self.ideal(pixel)?)
    }

    /// Undistorts an image position: where a pinhole camera would show the same thing. `None` outside the lens's image
    /// circle.
    pub fn ideal(&self, pixel: Point) -> Option<Point> {
        self.lens.as_ref().map_or(Some(pixel), |lens| lens.undistort(pixel))
    }

    /// The map from the floor to the ideal image.
    pub fn homography(&self) -> &Homography {
        &self.homography
    }

    /// The lens distortion, if any.
    pub fn lens(&self) -> Option<&LensMap> {
        self.lens.as_ref()
    }
}
