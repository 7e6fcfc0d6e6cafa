//! What somebody who installs a camera can choose.

use super::person::PersonSetup;
use super::point::Setup;

/// A choice in planning. Along each, light is counted as photons are: a pixel that gets k times the light, by its area or by
/// the exposure, has √k times the noise.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Knob {
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

impl Knob {
    /// All of them.
    pub const ALL: [Knob; 5] = [Knob::Patch, Knob::Pixels, Knob::Exposure, Knob::Door, Knob::Wall];

    /// The word used on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Knob::Patch => "patch",
            Knob::Pixels => "pixels",
            Knob::Exposure => "exposure",
            Knob::Door => "door",
            Knob::Wall => "wall",
        }
    }

    /// What its values are.
    pub fn unit(self) -> &'static str {
        match self {
            Knob::Patch => "side of the patches [m]",
            Knob::Pixels => "pixels along a side",
            Knob::Exposure => "exposure, relative",
            Knob::Door => "width of the door [m]",
            Knob::Wall => "thickness of the wall [m]",
        }
    }

    /// Values worth a look.
    pub fn usual(self) -> &'static [f64] {
        match self {
            Knob::Patch => &[0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5],
            Knob::Pixels => &[4.0, 8.0, 16.0, 32.0, 64.0, 128.0],
            Knob::Exposure => &[0.1, 0.3, 1.0, 3.0, 10.0, 30.0],
            Knob::Door => &[0.4, 0.5, 0.7, 0.85, 1.0, 1.5, 2.0],
            Knob::Wall => &[0.0, 0.05, 0.1, 0.15, 0.2, 0.3],
        }
    }
}

impl Setup {
    /// The same setup with another choice. A point's pixel is an integral over its area, and so is its noise: √k.
    pub fn with(self, knob: Knob, value: f64) -> Self {
        let other = self.chosen(knob, value);
        Self { noise: other.noise * other.cell() / self.cell(), ..other }
    }

    /// The choice made; the noise of a pixel changes with the exposure alone.
    fn chosen(self, knob: Knob, value: f64) -> Self {
        let mut other = self;
        match knob {
            Knob::Patch => other.patch_m = value,
            // Below 1 or not a number: 0, which is refused.
            Knob::Pixels => other.pixels = value as usize,
            Knob::Exposure => other.noise /= value.sqrt(),
            Knob::Door => other.doorway.width_m = value,
            Knob::Wall => other.doorway.wall_thickness_m = value,
        }
        other
    }

    fn cell(&self) -> f64 {
        self.patch_m / self.pixels as f64
    }
}

impl PersonSetup {
    /// The same setup with another choice. A person's pixel is a mean over its area: the noise is less, by √k.
    pub fn with(self, knob: Knob, value: f64) -> Self {
        let mut other = self.measured.chosen(knob, value);
        // Against the light that is there, the exposure's √k is one over it, as for a point.
        other.noise *= self.measured.cell() / other.cell();
        Self { measured: other, ..self }
    }
}
