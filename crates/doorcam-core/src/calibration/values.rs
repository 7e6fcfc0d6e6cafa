//! The values that determine a camera over a doorway.

use std::ops::RangeInclusive;

use serde::de::{Error, Unexpected};
use serde::{Deserialize, Deserializer, Serialize};

use crate::calibration::homography::MOST_POINTS;
use crate::calibration::{Camera, FloorFit, HomographyError, LensError, LensMap};
use crate::geometry::{Doorway, GeometryError, unit_hint};
use crate::image::MOST_PIXELS;
use crate::optics::{FloorPoint, Lens, Transfer, TransferError};

/// Calibration of a camera over a doorway, with the keys of a recording's manifest. Unknown keys are ignored.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct Calibration {
    /// Width and height of the camera's images, in pixels.
    #[serde(deserialize_with = "image_size")]
    #[cfg_attr(feature = "schema", schema(value_type = crate::schema::Size))]
    pub size: [usize; 2],
    /// The doorway.
    pub doorway: Doorway,
    /// Image positions of points whose floor position is known, at least four.
    #[serde(default)]
    pub floor_points: Vec<FloorPoint>,
    /// Lens distortion; none if straight lines look straight.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lens: Option<Lens>,
    /// Transfer function of the camera; none for sRGB, which webcams approximate.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub transfer: Option<Transfer>,
}

/// Why a calibration cannot be used: one line that names the key and says what was expected.
#[derive(Debug, PartialEq, thiserror::Error)]
pub enum CalibrationError {
    /// A size that no image can have.
    #[error(
        "size is [{}, {}], expected [width, height] in pixels, each from 1 to {LARGEST_SIDE} and together at most \
         {MOST_PIXELS} pixels", .0[0], .0[1]
    )]
    Size([usize; 2]),
    /// A marked pixel that is not in the image or beside it. Points are counted from 1.
    #[error(
        "floor_points: point {point} is at pixel [{}, {}], expected a position in or near the image of {} x {} pixels",
        .pixel[0], .pixel[1], .size[0], .size[1]
    )]
    FarPixel {
        /// Number of the point.
        point: usize,
        /// The marked position.
        pixel: [f64; 2],
        /// Size of the image.
        size: [usize; 2],
    },
    /// A place too far from the doorway. Points are counted from 1.
    #[error(
        "floor_points: point {point} has floor_m {value}, expected metres within {FARTHEST_M} of the doorway{hint}",
        hint = unit_hint(*.value, FARTHEST_M)
    )]
    FarFloor {
        /// Number of the point.
        point: usize,
        /// The coordinate.
        value: f64,
    },
    /// The image shows too little of a patch.
    #[error("patch.fov_m is {fov_m}: the camera sees {:.0} % of the {side} patch, expected at least half", 100.0 * share)]
    PatchNotSeen {
        /// Which patch.
        side: &'static str,
        /// Fraction of the patch that the image shows.
        share: f64,
        /// Side of the patch, in metres.
        fov_m: f64,
    },
    /// A patch covers too few or too many pixels of the image.
    #[error(
        "the {side} patch (patch.fov_m is {fov_m}) covers {area_px:.0} pixels of the image, expected {} to {}: {}",
        AREA_PX.start(), AREA_PX.end(),
        if *area_px < *AREA_PX.start() { "are doorway and floor_points in metres?" } else { "use smaller images" }
    )]
    PatchArea {
        /// Which patch.
        side: &'static str,
        /// Pixels of the image that it covers.
        area_px: f64,
        /// Side of the patch, in metres.
        fov_m: f64,
    },
    /// Dimensions that no doorway can have.
    #[error(transparent)]
    Doorway(#[from] GeometryError),
    /// A transfer function that no camera has.
    #[error(transparent)]
    Transfer(#[from] TransferError),
    /// A distortion that cannot be inverted.
    #[error(transparent)]
    Lens(#[from] LensError),
    /// Floor points that do not determine the floor.
    #[error(transparent)]
    FloorPoints(#[from] HomographyError),
}

/// No camera delivers images with longer sides than this: JPEGs cannot be larger.
const LARGEST_SIDE: usize = 65_535;

/// Floor farther from the doorway than this helps nobody, in metres.
const FARTHEST_M: f64 = 20.0;

/// How many pixels of the image a patch may cover: enough to measure with, and not more than are read with every frame.
pub(super) const AREA_PX: RangeInclusive<f64> = 64.0..=2e6;

/// Reads the size of an image: two whole numbers. 640.0 counts as one, because JSON makes no difference.
///
/// # Errors
///
/// If there are not two numbers, or one is negative or not whole.
pub fn image_size<'de, D: Deserializer<'de>>(deserializer: D) -> Result<[usize; 2], D::Error> {
    let numbers = <[f64; 2]>::deserialize(deserializer)?;
    // Numbers that are too large are refused by `Calibration::lens_map`, which can name the key.
    let is_whole = |number: f64| number >= 0.0 && number.fract() == 0.0;
    match numbers.into_iter().find(|&number| !is_whole(number)) {
        Some(number) => Err(D::Error::invalid_value(Unexpected::Float(number), &"a whole number")),
        None => Ok(numbers.map(|number| number as usize)),
    }
}

impl Calibration {
    /// The camera's transfer function.
    pub fn transfer(&self) -> &Transfer {
        self.transfer.as_ref().unwrap_or(&Transfer::Srgb)
    }

    /// Checks each value by itself, at a cost that hardly grows with what is in it.
    ///
    /// # Errors
    ///
    /// If there are too many floor points, or a value is out of range.
    pub fn validate(&self) -> Result<(), CalibrationError> {
        self.doorway.validate()?;
        self.transfer().validate()?;
        self.lens_map()?;
        self.points_in_range()
    }

    /// Checks the number of floor points, and each by itself.
    pub(super) fn points_in_range(&self) -> Result<(), CalibrationError> {
        if self.floor_points.len() > MOST_POINTS {
            return Err(HomographyError::TooMany(self.floor_points.len()).into());
        }
        for (point, FloorPoint { pixel, floor_m }) in (1..).zip(&self.floor_points) {
            if pixel.iter().chain(floor_m).any(|v| !v.is_finite()) {
                return Err(HomographyError::NotFinite(point).into());
            }
            if let Some(&value) = floor_m.iter().find(|v| v.abs() > FARTHEST_M) {
                return Err(CalibrationError::FarFloor { point, value });
            }
            // A point beside the image can be known from a larger one, as with a recording that was cropped.
            let near = |at: f64, size: usize| (-(size as f64)..=2.0 * size as f64).contains(&at);
            if !(0..2).all(|c| near(pixel[c], self.size[c])) {
                return Err(CalibrationError::FarPixel { point, pixel: *pixel, size: self.size });
            }
        }
        Ok(())
    }

    /// Fits the camera to the floor points.
    ///
    /// # Errors
    ///
    /// If a value is not valid, or if the floor points do not determine a camera or contradict each other.
    pub fn camera(&self) -> Result<Camera, CalibrationError> {
        self.validate()?;
        let lens = self.lens_map()?;
        let fit = FloorFit::new(&self.floor_points, lens.as_ref());
        let fit = fit.map_err(|e| FloorFit::culprit(&self.floor_points, lens.as_ref()).unwrap_or(e))?;
        fit.contradiction(self.size[0]).map_or_else(|| Ok(fit.camera().clone()), |e| Err(e.into()))
    }

    /// The lens distortion, if any.
    pub(super) fn lens_map(&self) -> Result<Option<LensMap>, CalibrationError> {
        let [width, height] = self.size;
        let possible = |n: usize| (1..=LARGEST_SIDE).contains(&n);
        if !(possible(width) && possible(height) && width * height <= MOST_PIXELS) {
            return Err(CalibrationError::Size(self.size));
        }
        Ok(self.lens.map(|lens| LensMap::new(&lens, self.size)).transpose()?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = r#"{"size": [600, 200], "doorway": {"width_m": 0.6, "wall_thickness_m": 0.1, "height_m": null},
        "floor_points": [{"pixel": [50, 20], "floor_m": [-0.5, -0.1]}, {"pixel": [550, 20], "floor_m": [0.5, -0.1]},
            {"pixel": [550, 170], "floor_m": [0.5, -0.4]}, {"pixel": [50, 170], "floor_m": [-0.5, -0.4]}], "shutter": 1}"#;

    fn calibration() -> Calibration {
        serde_json::from_str(TEXT).unwrap()
    }

    #[test]
    fn floor_points_make_a_camera() {
        let camera = calibration().camera().unwrap();
        let seen = camera.project([0.0, -0.2]).unwrap();
        assert!((seen[0] - 300.0).abs() < 1e-6 && (seen[1] - 70.0).abs() < 1e-6, "{seen:?}");
        let floor = camera.floor(seen).unwrap();
        assert!(floor[0].abs() < 1e-9 && (floor[1] + 0.2).abs() < 1e-9, "{floor:?}");
    }

    #[test]
    fn a_distorting_lens_is_undone() {
        let mut bent = calibration();
        bent.lens = Some(Lens { k1: -0.2, k2: 0.05, focal_px: Some(600.0) });
        let lens = LensMap::new(&bent.lens.unwrap(), bent.size).unwrap();
        // The same camera, with this lens, sees the points at their distorted positions.
        bent.floor_points.iter_mut().for_each(|p| p.pixel = lens.distort(p.pixel).unwrap());
        let (straight, bent) = (calibration().camera().unwrap(), bent.camera().unwrap());
        for floor in [[0.3, -0.2], [-0.45, -0.11], [0.0, -0.39]] {
            let (expected, got) =
                (lens.distort(straight.project(floor).unwrap()).unwrap(), bent.project(floor).unwrap());
            assert!((expected[0] - got[0]).hypot(expected[1] - got[1]) < 1e-6);
            let back = bent.floor(got).unwrap();
            assert!((back[0] - floor[0]).hypot(back[1] - floor[1]) < 1e-9);
        }
    }

    #[test]
    fn what_is_wrong_is_said_by_key() {
        let error = |change: fn(&mut Calibration)| {
            let mut calibration = calibration();
            change(&mut calibration);
            calibration.camera().expect_err("refused").to_string()
        };
        assert_eq!(
            error(|c| c.size = [0, 3]),
            "size is [0, 3], expected [width, height] in pixels, each from 1 to 65535 and together at most 33177600 \
             pixels"
        );
        assert!(error(|c| c.size = [65_535, 65_535]).starts_with("size is [65535, 65535], expected"));
        let centimetres = error(|c| c.floor_points.iter_mut().for_each(|p| p.floor_m = p.floor_m.map(|v| 100.0 * v)));
        assert!(centimetres.ends_with("within 20 of the doorway (is it in centimetres or inches?)"), "{centimetres}");
        let far = error(|c| c.floor_points[1].pixel[0] = 1e9);
        assert!(far.starts_with("floor_points: point 2 is at pixel [1000000000, 20], expected a position in"), "{far}");
        let many = error(|c| c.floor_points = vec![c.floor_points[0]; 100_000]);
        assert_eq!(many, "floor_points has 100000 points, expected at most 64");
        assert!(error(|c| c.doorway.width_m = -1.0).starts_with("doorway.width_m is -1"));
        assert!(error(|c| c.transfer = Some(Transfer::Gamma(0.0))).starts_with("transfer.gamma is 0"));
        assert!(error(|c| c.lens = Some(Lens { k1: -9.0, k2: 0.0, focal_px: None })).starts_with("lens.k1 = -9"));
        assert!(error(|c| c.floor_points.truncate(3)).starts_with("floor_points"));
        assert!(error(|c| c.floor_points.iter_mut().for_each(|p| p.floor_m[0] *= -1.0)).contains("mirrored"));
    }
}
