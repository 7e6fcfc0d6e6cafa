//! What somebody who installs a camera can choose.

use super::person::PersonSetup;
use super::point::Setup;

/// A choice in planning. Along each, light is counted as photons are: a pixel that gets k times the light, by its area or by
/// the exposure, has √k times the noise.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Choice {
    /// Side of the patches, in metres, with the same number of pixels.
    Patch,
    /// Pixels along each side of a patch.
    Pixels,
    /// Exposure, or frames averaged, against what the noise is given for.
    Exposure,
    /// Width of the opening, in metres.
    Door,
    /// Thickness of the wall, in metres.
    Wall,
}

impl Choice {
    /// All of them.
    pub const ALL: [Choice; 5] = [Choice::Patch, Choice::Pixels, Choice::Exposure, Choice::Door, Choice::Wall];

    /// The word used on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Choice::Patch => "patch",
            Choice::Pixels => "pixels",
            Choice::Exposure => "exposure",
            Choice::Door => "door",
            Choice::Wall => "wall",
        }
    }

    /// What its values are.
    pub fn unit(self) -> &'static str {
        match self {
            Choice::Patch => "side of the patches [m]",
            Choice::Pixels => "pixels along a side",
            Choice::Exposure => "exposure, relative",
            Choice::Door => "width of the door [m]",
            Choice::Wall => "thickness of the wall [m]",
        }
    }

    /// Values worth a look.
    pub fn usual(self) -> &'static [f64] {
        match self {
            Choice::Patch => &[0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5],
            Choice::Pixels => &[4.0, 8.0, 16.0, 32.0, 64.0, 128.0],
            Choice::Exposure => &[0.1, 0.3, 1.0, 3.0, 10.0, 30.0],
            Choice::Door => &[0.4, 0.5, 0.7, 0.85, 1.0, 1.5, 2.0],
            Choice::Wall => &[0.0, 0.05, 0.1, 0.15, 0.2, 0.3],
        }
    }
}

impl Setup {
    /// The same setup with another choice. A point's pixel is an integral over its area, and so is its noise: √k.
    pub fn with(self, choice: Choice, value: f64) -> Self {
        let other = self.chosen(choice, value);
        Self { noise: other.noise * other.cell() / self.cell(), ..other }
    }

    /// The choice made; the noise of a pixel changes with the exposure alone.
    fn chosen(self, choice: Choice, value: f64) -> Self {
        let mut other = self;
        match choice {
            Choice::Patch => other.patch_m = value,
            // Below 1 or not a number: 0, which is refused.
            Choice::Pixels => other.pixels = value as usize,
            Choice::Exposure => other.noise /= value.sqrt(),
            Choice::Door => other.doorway.width_m = value,
            Choice::Wall => other.doorway.wall_thickness_m = value,
        }
        other
    }

    fn cell(&self) -> f64 {
        self.patch_m / self.pixels as f64
    }
}

impl PersonSetup {
    /// The same setup with another choice. A person's pixel is a mean over its area: the noise is less, by √k.
    pub fn with(self, choice: Choice, value: f64) -> Self {
        let mut other = self.measured.chosen(choice, value);
        // Against the light that is there, the exposure's √k is one over it, as for a point.
        other.noise *= self.measured.cell() / other.cell();
        Self { measured: other, ..self }
    }
}
