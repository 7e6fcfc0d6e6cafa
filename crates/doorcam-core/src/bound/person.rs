//! The bound for a person in a lit room, when their strength, the camera's gain and the change of the visible side's
//! light are all unknown.

use nalgebra::{Matrix3, Vector3};

use super::nuisance::Patterns;
use super::point::{Bound, Setup, SetupError, Strategy, within};
use crate::geometry::{Doorway, Point, Room, Side};
use crate::transport::{Body, FloorView, PatchGrid, PixelLayout};

/// A person, as a vertical cylinder of uniform radiance, in front of a room that is equally bright in every direction.
///
/// Pixels are means over their area, relative to the mean level of the empty room's floor in the patches. In each
/// patch, the still picture (gain) and even light (from the visible side) may be present at any strength.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PersonSetup {
    /// Doorway, patches and pixels; the noise of a pixel is a share of the floor's level.
    pub measured: Setup,
    /// Height of the person, in metres.
    pub height_m: f64,
    /// Radius of the person, in metres.
    pub radius_m: f64,
    /// How much brighter the person is than the room behind them, as a share of the latter; negative if darker.
    pub contrast: f64,
    /// Share of the floor's light that comes from the visible side.
    pub visible_share: f64,
}

impl PersonSetup {
    /// A person of average size at a common door, half as bright as the room behind them. Half of the floor's light
    /// comes from the visible side, and a pixel's noise is 0.5 % of the floor's level.
    pub const USUAL: PersonSetup = PersonSetup {
        measured: Setup {
            doorway: Doorway { width_m: 0.85, wall_thickness_m: 0.12, height_m: None, leaf: None },
            patch_m: 0.3,
            pixels: 64,
            noise: 0.005,
        },
        height_m: 1.7,
        radius_m: 0.2,
        contrast: -0.5,
        visible_share: 0.5,
    };

    /// Checks that all values are in range.
    ///
    /// # Errors
    ///
    /// If a value is out of range or the contrast is 0; the error names it.
    pub fn validate(&self) -> Result<(), SetupError> {
        self.measured.validate()?;
        within("height", self.height_m, 0.1..=3.0, "metres")?;
        within("radius", self.radius_m, 0.01..=1.0, "metres")?;
        within("visible", self.visible_share, 0.0..=0.999, "a share")?;
        if self.contrast.is_finite() && self.contrast != 0.0 {
            return Ok(());
        }
        Err(SetupError { key: "contrast", value: self.contrast, expected: "a share other than 0".into() })
    }

    /// The bound of one strategy for a person whose axis is at a point with y > 0, in metres in the door frame. `sd_c`
    /// is relative to the person's strength.
    pub fn bound(&self, strategy: Strategy, place: Point) -> Bound {
        let information = strategy.sides().iter().map(|&side| self.information(strategy, side, place)).sum();
        Bound::new(&self.measured.doorway, place, &information)
    }

    /// The bounds of all strategies, in the order of [`Strategy::ALL`].
    pub fn bounds(&self, place: Point) -> [Bound; 4] {
        Strategy::ALL.map(|strategy| self.bound(strategy, place))
    }

    /// Fisher information on (c, x, y) in one patch.
    fn information(&self, strategy: Strategy, side: Side, place: Point) -> Matrix3<f64> {
        let Setup { doorway, patch_m, pixels, noise } = self.measured;
        let aperture = Aperture::new(&doorway, strategy);
        // A pixel is the mean over sample points in its area.
        let within = FINE.div_ceil(pixels);
        let fine = PatchGrid { size: pixels * within, fov_m: patch_m, layout: PixelLayout::Cells };
        let (mut room, mut person) = (vec![0.0; pixels * pixels], vec![Vector3::zeros(); pixels * pixels]);
        let share = 1.0 / (within * within) as f64;
        for (k, point) in fine.points(&doorway, side).into_iter().enumerate() {
            let pixel = k / fine.size / within * pixels + k % fine.size / within;
            let view = aperture.view(point);
            room[pixel] += share * aperture.room(&view);
            person[pixel] += share * aperture.person(&view, self.radius_m, self.height_m, place);
        }
        let level = room.iter().sum::<f64>() / room.len() as f64;
        // The floor's level is 1; the hidden room provides what the visible side does not.
        let hidden = (1.0 - self.visible_share) / level;
        let still: Vec<f64> = room.iter().map(|light| hidden * light + self.visible_share).collect();
        let even = vec![1.0; room.len()];
        let strength = self.contrast * hidden / noise;
        person.iter_mut().for_each(|gradient| *gradient *= strength);
        Patterns::new(&[even, still]).information(&person)
    }
}

/// Smallest number of sample points along each side of a patch, however few pixels it has.
const FINE: usize = 64;

/// The aperture that a strategy's light passes: the doorway with its leaf, or the part of it that the strategy has.
#[derive(Debug, Clone)]
pub(super) struct Aperture {
    opening: Doorway,
    /// Added to x to convert from the door frame to the frame of `opening`.
    shift: f64,
}

/// Width of an opening whose far edges block nothing.
const WIDE_M: f64 = 200.0;
/// Height of a wall that fills all elevations.
const HIGH_M: f64 = 1e6;
/// Step of numerical derivatives, in metres. The light of a body with a width is a continuous function of its place.
const STEP_M: f64 = 1e-4;

impl Aperture {
    pub(super) fn new(doorway: &Doorway, strategy: Strategy) -> Self {
        let wide = Doorway { width_m: WIDE_M, height_m: None, leaf: None, ..*doorway };
        match strategy {
            Strategy::Doorway => Self { opening: *doorway, shift: 0.0 },
            // The left edge stays in place.
            Strategy::SingleCorner => Self { opening: wide, shift: doorway.half_width() - WIDE_M / 2.0 },
            Strategy::SinglePatch | Strategy::DoublePatch => Self { opening: wide, shift: 0.0 },
        }
    }

    pub(super) fn view(&self, [x, y]: Point) -> FloorView {
        FloorView::new(&self.opening, [x + self.shift, y])
    }

    /// Light from a room of unit radiance in every direction.
    pub(super) fn room(&self, view: &FloorView) -> f64 {
        let anywhere = Room { half_width_m: 1.0, depth_m: 1.0 };
        let mut even = [0.0];
        view.walls(&self.opening, &anywhere, HIGH_M, &mut even);
        even[0]
    }

    /// Light from a person of unit radiance, and its derivatives by x and y.
    pub(super) fn person(&self, view: &FloorView, radius_m: f64, height_m: f64, [x, y]: Point) -> Vector3<f64> {
        let light = |dx: f64, dy: f64| {
            let body = Body { centre: [x + self.shift + dx, y + dy], radius_m, height_m };
            view.body(&self.opening, &body)
        };
        let by = |dx: f64, dy: f64| (light(dx, dy) - light(-dx, -dy)) / (2.0 * STEP_M);
        Vector3::new(light(0.0, 0.0), by(STEP_M, 0.0), by(0.0, STEP_M))
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::DMatrix;
    use proptest::prelude::*;

    use super::super::information::covariance;
    use super::{Aperture, FINE, PersonSetup, Setup, Strategy};
    use crate::geometry::Side;
    use crate::transport::{FloorView, PatchGrid, PixelLayout};

    const SETUP: PersonSetup =
        PersonSetup { measured: Setup { pixels: FINE, ..PersonSetup::USUAL.measured }, ..PersonSetup::USUAL };

    /// Compares with the full information matrix of all seven parameters: c, x, y, and gain and even light of both
    /// patches.
    #[test]
    fn nuisances_cost_what_the_whole_matrix_says() {
        for place in [[0.3, 1.2], [-0.8, 2.0], [0.0, 0.6]] {
            let Setup { doorway, patch_m, noise, pixels } = SETUP.measured;
            let mut information = DMatrix::<f64>::zeros(7, 7);
            for (s, side) in Side::BOTH.into_iter().enumerate() {
                let patch = PatchGrid { size: pixels, fov_m: patch_m, layout: PixelLayout::Cells };
                let aperture = Aperture::new(&doorway, Strategy::Doorway);
                let views: Vec<FloorView> =
                    patch.points(&doorway, side).into_iter().map(|p| aperture.view(p)).collect();
                let mean = views.iter().map(|v| aperture.room(v)).sum::<f64>() / views.len() as f64;
                for view in views {
                    let person = aperture.person(&view, 0.2, 1.7, place) * -0.5 * 0.5 / mean;
                    let mut row = DMatrix::zeros(1, 7);
                    (0..3).for_each(|k| row[k] = person[k]);
                    (row[3 + 2 * s], row[4 + 2 * s]) = (0.5 * aperture.room(&view) / mean + 0.5, 1.0);
                    information += row.transpose() * row / (noise * noise);
                }
            }
            let expected = covariance(&information).unwrap();
            let found = SETUP.bound(Strategy::Doorway, place);
            assert!((found.sd_c / expected[(0, 0)].sqrt() - 1.0).abs() < 1e-6);
            for (i, j) in [(0, 0), (0, 1), (1, 1)] {
                let error = found.covariance_m2[i][j] - expected[(i + 1, j + 1)];
                assert!(error.abs() < 1e-6 * found.error_m().powi(2), "{place:?}");
            }
        }
    }

    proptest! {
        #![proptest_config(crate::testing::cases(16))]
        #[test]
        fn people_are_as_uncertain_as_their_mirror_images_and_more_so_in_noise(
            x in -1.2..1.2f64, y in 0.4..2.8f64, factor in 0.1..10.0f64,
        ) {
            let here = SETUP.bound(Strategy::Doorway, [x, y]);
            prop_assume!(here.error_m().is_finite());
            let mirrored = SETUP.bound(Strategy::Doorway, [-x, y]);
            // In the mirror image, a kink of the penumbra may fall elsewhere within a step of the derivative.
            prop_assert!((here.sd_phi1 / mirrored.sd_phi2 - 1.0).abs() < 1e-3, "{here:?} {mirrored:?}");
            prop_assert!((here.error_m() / mirrored.error_m() - 1.0).abs() < 1e-3);
            let noisy = PersonSetup { measured: Setup { noise: factor * 0.005, ..SETUP.measured }, ..SETUP };
            prop_assert!(
                (noisy.bound(Strategy::Doorway, [x, y]).error_m() / (factor * here.error_m()) - 1.0).abs() < 1e-9
            );
            let faint = PersonSetup { contrast: -0.5 / factor, ..SETUP };
            prop_assert!(
                (faint.bound(Strategy::Doorway, [x, y]).error_m() / (factor * here.error_m()) - 1.0).abs() < 1e-9
            );
        }

        /// An edge can only help, and so can another patch. Not so where the wall hides a body close to it from most of
        /// the patch: there an edge takes more light away than it tells.
        #[test]
        fn more_measurements_are_never_worse(x in -0.6..0.6f64, y in 0.8..2.8f64) {
            let [single, corner, double, door] = SETUP.bounds([x, y]);
            prop_assert!(double.error_m() <= single.error_m() * (1.0 + 1e-9));
            prop_assert!(corner.error_m() <= single.error_m(), "{corner:?} {single:?}");
            prop_assert!(door.error_m() <= corner.error_m(), "{door:?} {corner:?}");
        }
    }

    #[test]
    fn numbers_that_nobody_has_are_named() {
        let refused = |setup: PersonSetup| setup.validate().unwrap_err().to_string();
        assert_eq!(PersonSetup::USUAL.validate(), Ok(()));
        assert_eq!(refused(PersonSetup { height_m: 17.0, ..SETUP }), "height is 17, expected metres from 0.1 to 3");
        assert_eq!(refused(PersonSetup { contrast: 0.0, ..SETUP }), "contrast is 0, expected a share other than 0");
    }
}
