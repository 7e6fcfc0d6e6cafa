//! A camera as far as the floor is concerned.

use crate::calibration::{Homography, LensMap};
use crate::geometry::Point;

/// From the floor (metres, door frame) to the image as the camera delivers it (pixels), its lens's distortion included, and
/// back. Pixel (0, 0) is the centre of the top-left pixel.
#[derive(Debug, Clone, PartialEq)]
pub struct Camera {
    homography: Homography,
    lens: Option<LensMap>,
}

impl Camera {
    /// A camera whose ideal image, without distortion, shows the floor through `homography`.
    pub fn new(homography: Homography, lens: Option<LensMap>) -> Self {
        Self { homography, lens }
    }

    /// Where a floor position is seen; none if it is not in front of the camera, or where the lens shows nothing.
    pub fn project(&self, floor: Point) -> Option<Point> {
        let ideal = self.homography.project(floor)?;
        self.lens.as_ref().map_or(Some(ideal), |lens| lens.distort(ideal))
    }

    /// The floor position that is seen at an image position; none at and above the horizon.
    pub fn floor(&self, pixel: Point) -> Option<Point> {
        self.homography.floor(self.ideal(pixel)?)
    }

    /// Where a pinhole would have what is seen at an image position.
    pub fn ideal(&self, pixel: Point) -> Option<Point> {
        self.lens.as_ref().map_or(Some(pixel), |lens| lens.undistort(pixel))
    }

    /// The floor in the ideal image.
    pub fn homography(&self) -> &Homography {
        &self.homography
    }

    /// The lens, if it distorts.
    pub fn lens(&self) -> Option<&LensMap> {
        self.lens.as_ref()
    }
}
