//! What can be chosen when a camera is installed.

use super::person::PersonSetup;
use super::point::Setup;

/// A quantity that can be chosen in planning. Noise follows photon counting: a pixel that gets k times the light,
/// through its area or the exposure, has √k times the noise.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Choice {
    /// Side of the patches, in metres; the number of pixels stays the same.
    Patch,
    /// Pixels along each side of a patch.
    Pixels,
    /// Exposure or number of averaged frames, relative to what the noise is given for.
    Exposure,
    /// Width of the opening, in metres.
    Door,
    /// Thickness of the wall, in metres.
    Wall,
}

impl Choice {
    /// All choices.
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

    /// What the values are, with their unit.
    pub fn unit(self) -> &'static str {
        match self {
            Choice::Patch => "side of the patches [m]",
            Choice::Pixels => "pixels along a side",
            Choice::Exposure => "exposure, relative",
            Choice::Door => "width of the door [m]",
            Choice::Wall => "thickness of the wall [m]",
        }
    }

    /// Values to compare by default.
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
    /// This setup with one quantity changed. For a point, a pixel is an integral over its area, so k times the area
    /// gives √k times the noise.
    pub fn with(self, choice: Choice, value: f64) -> Self {
        let other = self.chosen(choice, value);
        Self { noise: other.noise * other.cell() / self.cell(), ..other }
    }

    /// Sets the quantity; the noise changes only with the exposure.
    fn chosen(self, choice: Choice, value: f64) -> Self {
        let mut other = self;
        match choice {
            Choice::Patch => other.patch_m = value,
            // Values below 1 and NaN become 0, which `validate` refuses.
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
    /// This setup with one quantity changed. For a person, a pixel is a mean over its area, so k times the area divides
    /// the noise by √k.
    pub fn with(self, choice: Choice, value: f64) -> Self {
        let mut other = self.measured.chosen(choice, value);
        // Noise is relative to the light, so k times the exposure divides it by √k, as for a point; `chosen` does that.
        other.noise *= self.measured.cell() / other.cell();
        Self { measured: other, ..self }
    }
}
