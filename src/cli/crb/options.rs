//! The options of `crb` and their parsers.

use std::path::PathBuf;

use doorcam_core::bound::{Bound, Choice, PersonSetup, Setup, SetupError};
use doorcam_core::geometry::{Biangular, Doorway, Point};

/// The target and the setup that measures it.
#[derive(Debug, clap::Args)]
pub(super) struct TargetOptions {
    /// Width of the opening [default: 1; with --person 0.85]
    #[arg(long, value_name = "M", allow_hyphen_values = true)]
    door: Option<f64>,
    /// Thickness of the wall [default: 0; with --person 0.12]
    #[arg(long, value_name = "M", allow_hyphen_values = true)]
    wall: Option<f64>,
    /// Side of each patch of floor [default: 0.2; with --person 0.3]
    #[arg(long, value_name = "M", allow_hyphen_values = true)]
    patch: Option<f64>,
    /// Pixels along each side of a patch [default: 125; with --person 64]
    #[arg(long, value_name = "N")]
    pixels: Option<usize>,
    /// Standard deviation of a pixel's noise, in the unit of eq. 9: light times square metres, for a brightness of 1
    /// [default: 1e-6]; with --person, as a share of the floor's level [default: 0.005]
    #[arg(long, value_name = "S", allow_hyphen_values = true)]
    noise: Option<f64>,
    /// Locate a person in a lit room, with the camera's gain and the visible side's light unknown in each patch
    #[arg(long)]
    person: bool,
    /// Brightness of the person relative to the room behind, as a share; below 0 is darker [default: -0.5]
    #[arg(long, value_name = "SHARE", allow_hyphen_values = true, requires = "person")]
    contrast: Option<f64>,
    /// Share of the floor's light that comes from the visible side [default: 0.5]
    #[arg(long, value_name = "SHARE", allow_hyphen_values = true, requires = "person")]
    visible: Option<f64>,
    /// Height of the person [default: 1.7]
    #[arg(long, value_name = "M", allow_hyphen_values = true, requires = "person")]
    height: Option<f64>,
    /// Radius of the person [default: 0.2]
    #[arg(long, value_name = "M", allow_hyphen_values = true, requires = "person")]
    radius: Option<f64>,
}

/// What to locate: a point or a person.
#[derive(Debug, Clone, Copy)]
pub(super) enum Target {
    Point(Setup),
    Person(PersonSetup),
}

impl TargetOptions {
    pub(super) fn target(&self) -> Target {
        let usual = PersonSetup::USUAL;
        let default = if self.person { usual.measured } else { Setup::PUBLISHED };
        let measured = Setup {
            doorway: Doorway {
                width_m: self.door.unwrap_or(default.doorway.width_m),
                wall_thickness_m: self.wall.unwrap_or(default.doorway.wall_thickness_m),
                height_m: None,
                leaf: None,
            },
            patch_m: self.patch.unwrap_or(default.patch_m),
            pixels: self.pixels.unwrap_or(default.pixels),
            noise: self.noise.unwrap_or(default.noise),
        };
        if !self.person {
            return Target::Point(measured);
        }
        Target::Person(PersonSetup {
            measured,
            height_m: self.height.unwrap_or(usual.height_m),
            radius_m: self.radius.unwrap_or(usual.radius_m),
            contrast: self.contrast.unwrap_or(usual.contrast),
            visible_share: self.visible.unwrap_or(usual.visible_share),
        })
    }
}

impl Target {
    pub(super) fn measured(&self) -> &Setup {
        match self {
            Target::Point(setup) => setup,
            Target::Person(setup) => &setup.measured,
        }
    }

    pub(super) fn validate(&self) -> Result<(), SetupError> {
        match self {
            Target::Point(setup) => setup.validate(),
            Target::Person(setup) => setup.validate(),
        }
    }

    pub(super) fn bounds(&self, place: Point) -> [Bound; 4] {
        match self {
            Target::Point(setup) => setup.bounds(place),
            Target::Person(setup) => setup.bounds(place),
        }
    }

    pub(super) fn with(&self, choice: Choice, value: f64) -> Self {
        match self {
            Target::Point(setup) => Target::Point(setup.with(choice, value)),
            Target::Person(setup) => Target::Person(setup.with(choice, value)),
        }
    }
}

/// A pair of angles, given in degrees.
#[derive(Debug, Clone, Copy)]
pub(super) struct Angles(pub(super) Biangular);

/// The choice to vary and the values to try.
#[derive(Debug, Clone)]
pub(super) struct Sweep {
    pub(super) choice: Choice,
    pub(super) values: Vec<f64>,
}

fn pair(text: &str) -> Option<[f64; 2]> {
    let (first, second) = text.split_once(',')?;
    let number = |text: &str| text.trim().parse().ok().filter(|v: &f64| v.is_finite());
    Some([number(first)?, number(second)?])
}

pub(super) fn angles(text: &str) -> Result<Angles, String> {
    let [alpha1, alpha2] = pair(text)
        .filter(|[a, b]| *a > 0.0 && *b > 0.0 && a + b < 180.0)
        .ok_or("expected two angles in degrees, both above 0 and less than 180 together, as 60,45")?;
    Ok(Angles(Biangular { alpha1: alpha1.to_radians(), alpha2: alpha2.to_radians() }))
}

pub(super) fn place(text: &str) -> Result<Point, String> {
    // No target is closer to the door line than a centimetre or farther away than 100 m.
    pair(text)
        .filter(|[x, y]| x.abs() <= 100.0 && (0.01..=100.0).contains(y))
        .ok_or_else(|| "expected metres to the right and into the room, as -0.5,2, the latter from 0.01 to 100".into())
}

pub(super) fn sweep(text: &str) -> Result<Sweep, String> {
    let (name, values) = text.split_once('=').map_or((text, None), |(name, values)| (name, Some(values)));
    let choice = Choice::ALL.into_iter().find(|choice| choice.name() == name);
    let choice = choice.ok_or("expected patch, pixels, exposure, door or wall")?;
    let Some(values) = values else { return Ok(Sweep { choice, values: choice.usual().to_vec() }) };
    let values: Result<Vec<f64>, _> = values.split(',').map(|v| v.trim().parse()).collect();
    let expected = || format!("expected numbers after {name}=, as {name}={},{}", choice.usual()[1], choice.usual()[3]);
    let values = values.map_err(|_| expected())?;
    if values.iter().any(|v| !v.is_finite()) || (choice == Choice::Pixels && values.iter().any(|v| v.fract() != 0.0)) {
        return Err(expected());
    }
    Ok(Sweep { choice, values })
}

pub(super) fn output(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    match path.extension().and_then(|e| e.to_str()) {
        Some("svg" | "png" | "csv") => Ok(path),
        _ => Err("expected a name that ends in .svg, .png or .csv".into()),
    }
}
