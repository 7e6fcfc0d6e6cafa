//! Feedback for the web page during calibration: everything that is wrong, and the resulting camera.

use serde::Serialize;

use crate::calibration::values::AREA_PX;
use crate::calibration::{
    ASSUMED_NOISE_PX, Accuracy, Calibration, CalibrationError, Camera, FloorFit, Overlay, PatchSight,
};
use crate::geometry::{Doorway, Point, Side};
use crate::transport::PatchGrid;

/// Assessment of a [`Calibration`], finished or not. It is filled in as far as the calibration allows.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct Check {
    /// Whether the calibration can be used.
    pub ok: bool,
    /// Why it cannot be used: messages that name the key at fault.
    pub errors: Vec<String>,
    /// What is possible but unusual: messages that name the key in doubt.
    pub warnings: Vec<String>,
    /// Residual of each floor point; empty if no camera fits.
    pub points: Vec<PointResidual>,
    /// Errors of the points and their effect on the patches; none if no camera fits.
    #[cfg_attr(feature = "schema", schema(required))]
    pub error: Option<PointErrors>,
    /// Floor lines in the image; empty if no camera fits.
    pub overlay: Overlay,
    /// How much of each patch the image shows.
    pub seen: PatchCoverage,
}

/// Residual of one floor point.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct PointResidual {
    /// Marked pixel minus the pixel where the fitted camera sees the point: (u, v), in pixels.
    #[cfg_attr(feature = "schema", schema(value_type = crate::schema::Pair))]
    pub residual_px: Point,
    /// Floor position of the marked pixel minus the point's stated position: (x, y), in millimetres. None if the marked
    /// pixel does not show the floor.
    #[cfg_attr(feature = "schema", schema(value_type = Option<crate::schema::Pair>, required))]
    pub residual_mm: Option<Point>,
}

/// Errors of the floor points and their effect on the patches.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct PointErrors {
    /// RMS distance between marked and fitted points in the image, in pixels.
    pub rms_px: f64,
    /// The same on the floor, in millimetres, over the points whose marked pixel shows the floor.
    pub rms_mm: f64,
    /// Estimated standard deviation of the marked points, per coordinate, in pixels: from the residuals, with 2n − 8
    /// degrees of freedom. None with four points; [`ASSUMED_NOISE_PX`] is used then.
    #[cfg_attr(feature = "schema", schema(required))]
    pub noise_px: Option<f64>,
    /// Expected RMS error of the patch pixels' positions on the floor, in millimetres.
    #[cfg_attr(feature = "schema", schema(required))]
    pub floor_mm: Option<f64>,
    /// Expected RMS error of the patch pixels' angles around their edge, in degrees. Pixels next to the edge's foot are
    /// left out.
    #[cfg_attr(feature = "schema", schema(required))]
    pub angle_deg: Option<f64>,
}

/// Fraction of each patch, 0 to 1, that the image shows.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema), schema(as = Seen))]
pub struct PatchCoverage {
    /// The patch at the left edge.
    pub left: f64,
    /// The patch at the right edge.
    pub right: f64,
}

/// Smallest fraction of a patch that the camera must show.
const LEAST_SEEN: f64 = 0.5;

impl Calibration {
    /// Checks the calibration for these patches: reports everything that is wrong, and the errors to expect. The
    /// calibration can be used for them if and only if the result is `ok`.
    pub fn check(&self, patch: &PatchGrid) -> Check {
        let mut check = Check::default();
        let doorway = self.doorway.validate();
        check.errors.extend(doorway.as_ref().err().map(ToString::to_string));
        check.errors.extend(self.transfer().validate().err().map(|e| e.to_string()));
        check.warnings.extend(doorway.is_ok().then(|| self.doorway.doubt()).flatten());
        let lens = self.lens_map();
        // A size that is wrong makes every pixel look wrong.
        let lens = lens.and_then(|lens| self.points_in_range().map(|()| lens));
        match lens {
            Err(error) => check.errors.push(error.to_string()),
            Ok(lens) => match FloorFit::new(&self.floor_points, lens.as_ref()) {
                Err(error) => {
                    let error = FloorFit::culprit(&self.floor_points, lens.as_ref()).unwrap_or(error);
                    check.errors.push(error.to_string());
                }
                Ok(fit) => {
                    check.errors.extend(fit.contradiction(self.size[0]).map(|e| e.to_string()));
                    check.points = residuals(&fit);
                    check.error = Some(PointErrors::of(&fit, doorway.is_ok().then_some((&self.doorway, patch))));
                    if doorway.is_ok() {
                        check.overlay = Overlay::new(fit.camera(), self.size, &self.doorway, patch);
                        let sights = self.patch_sights(patch, fit.camera());
                        let [left, right] = [0, 1].map(|s| sights[s].share());
                        check.seen = PatchCoverage { left, right };
                        check.errors.extend(self.unseen(patch, &sights).map(|e| e.to_string()));
                    }
                }
            },
        }
        check.ok = check.errors.is_empty();
        check
    }

    /// How `camera`, fitted to this calibration, sees the left and the right patch.
    pub fn patch_sights(&self, patch: &PatchGrid, camera: &Camera) -> [PatchSight; 2] {
        Side::BOTH.map(|side| PatchSight::new(&self.doorway, patch, side, camera, self.size))
    }

    /// Why the patches cannot be measured in the image: what [`Self::check`] says of each. Empty if they can.
    pub fn unseen<'a>(
        &self,
        patch: &PatchGrid,
        sights: &'a [PatchSight; 2],
    ) -> impl Iterator<Item = CalibrationError> + use<'a> {
        let fov_m = patch.fov_m;
        Side::BOTH.into_iter().zip(sights).filter_map(move |(side, sight)| {
            let (side, share, area_px) = (side.name(), sight.share(), sight.area_px);
            if share < LEAST_SEEN {
                return Some(CalibrationError::PatchNotSeen { side, share, fov_m });
            }
            (!AREA_PX.contains(&area_px)).then_some(CalibrationError::PatchArea { side, area_px, fov_m })
        })
    }
}

fn residuals(fit: &FloorFit) -> Vec<PointResidual> {
    let pairs = fit.residuals_px().iter().zip(fit.residuals_m());
    pairs
        .map(|(&residual_px, m)| PointResidual { residual_px, residual_mm: m.map(|r| r.map(|v| 1000.0 * v)) })
        .collect()
}

impl PointErrors {
    fn of(fit: &FloorFit, patches: Option<(&Doorway, &PatchGrid)>) -> Self {
        let rms = |residuals: &[Point]| {
            let sum: f64 = residuals.iter().map(|r| r[0] * r[0] + r[1] * r[1]).sum();
            (sum / residuals.len().max(1) as f64).sqrt()
        };
        let on_floor: Vec<Point> = fit.residuals_m().into_iter().flatten().collect();
        let noise_px = fit.noise_px();
        let accuracy = patches
            .and_then(|(doorway, patch)| Accuracy::of(fit, doorway, patch, noise_px.unwrap_or(ASSUMED_NOISE_PX)));
        Self {
            rms_px: rms(fit.residuals_px()),
            rms_mm: 1000.0 * rms(&on_floor),
            noise_px,
            floor_mm: accuracy.map(|a| 1000.0 * a.floor_m),
            angle_deg: accuracy.map(|a| a.angle_rad.to_degrees()),
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::calibration::pinhole::Pinhole;
    use crate::optics::{FloorPoint, Lens, Transfer};
    use crate::transport::PixelLayout;

    const PATCH: PatchGrid = PatchGrid { size: 64, fov_m: 0.3, layout: PixelLayout::Cells };

    /// Points marked to about half a pixel.
    fn calibration(points: usize) -> Calibration {
        let doorway = Doorway { width_m: 0.8, wall_thickness_m: 0.12, height_m: None, leaf: None };
        let pinhole =
            Pinhole { at: [0.1, -1.3, 1.1], tilt: 0.8, turn: -0.1, roll: 0.05, focal: 480.0, centre: [319.5, 179.5] };
        let floor = [[-0.4, -0.12], [0.4, -0.12], [0.45, -0.5], [-0.4, -0.45], [0.05, -0.5], [-0.1, -0.2]];
        let off = [[0.3, -0.6], [-0.5, 0.2], [0.4, 0.5], [-0.4, -0.3], [0.6, 0.1], [-0.3, 0.4]];
        let mark = |k: usize| {
            let seen = pinhole.see(floor[k]).unwrap();
            FloorPoint { pixel: [seen[0] + off[k][0], seen[1] + off[k][1]], floor_m: floor[k] }
        };
        Calibration {
            size: [640, 360],
            doorway,
            floor_points: (0..points).map(mark).collect(),
            lens: None,
            transfer: None,
        }
    }

    #[test]
    fn a_good_calibration_is_told_how_good_it_is() {
        let check = calibration(6).check(&PATCH);
        assert!(check.ok && check.errors.is_empty(), "{:?}", check.errors);
        let error = check.error.unwrap();
        let noise = error.noise_px.unwrap();
        // rms per point over n, noise per coordinate over 2n - 8.
        assert!((error.rms_px.powi(2) * 6.0 - noise.powi(2) * 4.0).abs() < 1e-9);
        assert!((0.1..0.8).contains(&noise) && (0.3..6.0).contains(&error.floor_mm.unwrap()), "{error:?}");
        assert!((0.05..3.0).contains(&error.angle_deg.unwrap()), "{error:?}");
        assert_eq!(check.points.len(), 6);
        assert_eq!(check.seen, PatchCoverage { left: 1.0, right: 1.0 });
    }

    #[test]
    fn four_points_leave_no_residual_but_an_error_to_expect() {
        let check = calibration(4).check(&PATCH);
        assert!(check.ok, "{:?}", check.errors);
        let error = check.error.unwrap();
        assert!(error.noise_px.is_none() && error.rms_px < 1e-6 && error.rms_mm < 1e-6, "{error:?}");
        let told = serde_json::to_value(error).unwrap();
        assert!(told["noise_px"].is_null() && told["floor_mm"].as_f64().is_some_and(|mm| mm > 0.5), "{told}");
    }

    #[test]
    fn each_error_is_told_and_names_its_key() {
        let mut calibration = calibration(6);
        calibration.transfer = Some(Transfer::Gamma(-1.0));
        calibration.doorway.width_m = 0.0;
        calibration.floor_points[4].floor_m[0] += 0.2;
        let check = calibration.check(&PATCH);
        assert!(!check.ok);
        assert_eq!(check.errors.len(), 3, "{:?}", check.errors);
        assert!(check.errors[0].starts_with("doorway.width_m is 0"));
        assert!(check.errors[1].starts_with("transfer.gamma is -1"));
        assert!(check.errors[2].starts_with("floor_points: point 5 is "), "{}", check.errors[2]);
        assert!(!check.points.is_empty(), "residuals show where to look");
        assert_eq!(check.overlay, Overlay::default());
    }

    #[test]
    fn patches_out_of_sight_are_told() {
        let mut calibration = calibration(6);
        calibration.floor_points.iter_mut().for_each(|p| p.pixel[0] -= 200.0);
        let check = calibration.check(&PATCH);
        assert!(check.seen.left < 0.5 && check.seen.right == 1.0);
        assert!(check.errors[0].starts_with("patch.fov_m is 0.3: the camera sees "), "{:?}", check.errors);
    }

    proptest! {
        #[test]
        fn it_always_answers(
            points in proptest::collection::vec((any::<[f64; 2]>(), any::<[f64; 2]>(), any::<bool>()), 0..9),
            size in any::<[usize; 2]>(), small in any::<bool>(), k1 in any::<Option<f64>>(), width_m in any::<f64>(),
        ) {
            let mut calibration = calibration(6);
            let tame = |v: [f64; 2], scale: f64| v.map(|x| (x.fract() + 1.0) * scale);
            let point = |(pixel, floor_m, wild): ([f64; 2], [f64; 2], bool)| {
                if wild { FloorPoint { pixel, floor_m } } else { FloorPoint { pixel: tame(pixel, 200.0), floor_m: tame(floor_m, 1.0) } }
            };
            calibration.floor_points.extend(points.into_iter().map(point));
            calibration.size = if small { size.map(|n| n % 2000) } else { size };
            calibration.lens = k1.map(|k1| Lens { k1: if small { k1.fract() } else { k1 }, k2: 0.0, focal_px: None });
            if !small {
                calibration.doorway.width_m = width_m;
            }
            let check = calibration.check(&PATCH);
            prop_assert_eq!(check.ok, check.errors.is_empty());
            prop_assert_eq!(check.ok, calibration.camera().is_ok() && check.seen.left >= 0.5 && check.seen.right >= 0.5);
            serde_json::to_string(&check).unwrap();
        }
    }
}
