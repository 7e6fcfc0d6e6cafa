mod figure;
mod options;
mod text;

use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use doorcam_core::bound::{Bound, Choice, plotted_angles};
use doorcam_core::geometry::{Biangular, Point};
use doorcam_engine::figures::png;
use rayon::prelude::*;

use options::{Angles, Sweep, Target, TargetOptions};

/// Compute how well a hidden target can be located at best: the Cramér-Rao bound (figure 5 of the paper)
///
/// No unbiased estimate from the same pixels has smaller standard deviations. Four ways to measure are compared: the
/// left patch of floor without an edge (single-patch) and with it (single-corner), both patches without edges
/// (double-patch) and with them (doorway). Without --output, a table is printed, also in metres.
///
/// The target is a point of brightness 1 on the hidden floor, as in the paper, or with --person a person in a lit room.
/// Angles are measured at the left and the right edge, from the side of the opening, in degrees.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
The file's extension sets its format: .svg and .png show the figure, or the curves of a sweep; .csv has the numbers:
  strategy, phi1_deg, phi2_deg, sd_c, sd_phi1_rad, sd_phi2_rad
With --sweep, the swept value comes first, and x_m, y_m, sd_x_m, sd_y_m, corr_xy, error_m last. A value that the
pixels do not determine is inf, or a dash in the table.

corr is the correlation of x and y; error is the root of the mean squared distance from the true place (the RMSE of
an evaluation).

With --sweep, noise follows photon statistics: a pixel that gets k times the light, by its area or the exposure, has
the square root of k times the noise.

Examples:
  doorcam crb --output figure5.png
  doorcam crb --width-sd 500 --output magnified.svg        figure 5 as in the paper's Supplementary Note 1
  doorcam crb --at 60,60 90,45
  doorcam crb --door 0.85 --wall 0.12 --patch 0.3 --pixels 64 --place 0,2
  doorcam crb --person --place 0,2                         a person two metres behind a door of 0.85 m
  doorcam crb --person --place 0,2 --sweep patch=0.1,0.2,0.3,0.5
  doorcam crb --person --place 0,2 --sweep exposure --output exposure.csv
docs/planning.md explains what this means for an installation.")]
pub(super) struct Arguments {
    #[command(flatten)]
    target: TargetOptions,
    /// Targets at these angles, both above 0 and less than 180 together [default: a grid with steps of 15 degrees]
    #[arg(long, value_name = "PHI1,PHI2", num_args = 1.., value_parser = options::angles)]
    at: Vec<Angles>,
    /// A target at this place, in metres to the right of the door's middle and into the hidden room; may be repeated
    #[arg(long, value_name = "X,Y", allow_hyphen_values = true, value_parser = options::place, conflicts_with = "at")]
    place: Vec<Point>,
    /// Width of the figure's regions, in standard deviations; 500 in the paper's Supplementary Note 1
    #[arg(long, value_name = "N", default_value_t = 2.0, allow_hyphen_values = true)]
    width_sd: f64,
    /// The target of the figure's sample measurements (the red dot)
    #[arg(long, value_name = "PHI1,PHI2", default_value = "45,75", value_parser = options::angles)]
    sample: Angles,
    /// Vary one choice and keep the others as given: patch, pixels, exposure, door or wall; without values, over a
    /// default range
    #[arg(long, value_name = "WHAT[=V,V..]", value_parser = options::sweep)]
    sweep: Option<Sweep>,
    /// Write a file instead of a table on stdout
    #[arg(long, value_name = "FILE", value_parser = options::output)]
    output: Option<PathBuf>,
}

/// The bounds of all strategies at one place, for one swept value.
struct Row {
    value: Option<f64>,
    angles: Biangular,
    place: Point,
    bounds: [Bound; 4],
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let target = arguments.target.target();
    check(&target)?;
    if !(arguments.width_sd.is_finite() && arguments.width_sd > 0.0) {
        bail!("--width-sd is {}, expected a number above 0", arguments.width_sd);
    }
    let places = places(arguments, &target)?;
    let rows = rows(arguments, &target, &places)?;
    let choice = arguments.sweep.as_ref().map(|sweep| sweep.choice);
    let Some(path) = &arguments.output else {
        write!(std::io::stdout().lock(), "{}", text::table(choice, &rows))?;
        return Ok(());
    };
    match extension(path) {
        "csv" => save(path, text::csv(choice, &rows).as_bytes()),
        kind => {
            let svg = figure::svg(arguments, &target, &rows)?;
            if kind == "png" { save(path, &png(&svg, figure::WIDTH)?) } else { save(path, svg.as_bytes()) }
        }
    }
}

fn check(target: &Target) -> anyhow::Result<()> {
    // The keys in the error are the names of the options.
    target.validate().map_err(|e| anyhow::anyhow!("--{e}"))
}

/// The places of the targets, in the door frame (m).
fn places(arguments: &Arguments, target: &Target) -> anyhow::Result<Vec<Point>> {
    let doorway = &target.measured().doorway;
    if !arguments.place.is_empty() {
        return Ok(arguments.place.clone());
    }
    let angles: Vec<Biangular> = match (&arguments.at[..], &arguments.sweep) {
        // A sweep needs a single place: two metres behind the door.
        ([], Some(_)) => return Ok(vec![[0.0, 2.0]]),
        ([], None) => plotted_angles(doorway),
        (at, _) => at.iter().map(|angles| angles.0).collect(),
    };
    let place = |angles: &Biangular| {
        doorcam_core::bound::place_of(doorway, *angles).context("--at: the two rays do not meet in the hidden room")
    };
    angles.iter().map(place).collect()
}

fn rows(arguments: &Arguments, target: &Target, places: &[Point]) -> anyhow::Result<Vec<Row>> {
    let targets: Vec<(Option<f64>, Target)> = match &arguments.sweep {
        None => vec![(None, *target)],
        Some(Sweep { choice, values }) => {
            let swept = |&value: &f64| {
                let other = target.with(*choice, value);
                let named = || format!("--sweep {}", choice.name());
                other.validate().map_err(anyhow::Error::new).with_context(named)?;
                Ok((Some(value), other))
            };
            values.iter().map(swept).collect::<anyhow::Result<_>>()?
        }
    };
    let each: Vec<_> = places.iter().flat_map(|place| targets.iter().map(move |target| (*place, target))).collect();
    let row = |&(place, (value, target)): &(Point, &(Option<f64>, Target))| Row {
        value: *value,
        angles: Biangular::from_point(&target.measured().doorway, place),
        place,
        bounds: target.bounds(place),
    };
    Ok(each.par_iter().map(row).collect())
}

fn extension(path: &Path) -> &str {
    path.extension().and_then(|e| e.to_str()).unwrap_or_default()
}

fn save(path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    std::fs::write(path, bytes).with_context(|| path.display().to_string())
}

impl Row {
    /// The swept choice and its value in this row.
    fn value(&self, choice: Option<Choice>) -> Option<(Choice, f64)> {
        choice.zip(self.value)
    }
}
