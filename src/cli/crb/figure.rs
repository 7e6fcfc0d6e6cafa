//! Figure 5 of the paper for any setup, and the curves of a sweep.

use anyhow::Context;
use doorcam_core::bound::{Choice, Strategy, place_of, sample_measurement};
use doorcam_engine::figures::{
    BoundPanel, BoundPicture, Curve, CurvesPanel, CurvesPicture, Region, bound_svg, curves_svg,
};

use super::options::Target;
use super::{Arguments, Row};

/// Width of the PNG, in pixels.
pub(super) const WIDTH: u32 = 2000;
/// Seed of the samples' noise.
const SEED: u64 = 1;

pub(super) fn svg(arguments: &Arguments, target: &Target, rows: &[Row]) -> anyhow::Result<String> {
    if let Some(sweep) = &arguments.sweep {
        return Ok(curves(target, sweep.choice, sweep.values.len(), rows));
    }
    let doorway = target.measured().doorway;
    let dot =
        place_of(&doorway, arguments.sample.0).context("--sample: the two rays do not meet in the hidden room")?;
    let samples = |strategy| match target {
        Target::Point(setup) => sample_measurement(setup, strategy, dot, SEED),
        Target::Person(_) => Vec::new(),
    };
    let panels = Strategy::ALL.map(|strategy| BoundPanel {
        title: title(strategy).into(),
        sides: strategy.sides().to_vec(),
        walled: strategy.has_edge(),
        regions: regions(arguments, strategy, rows),
        samples: samples(strategy),
    });
    let picture = BoundPicture {
        doorway: &doorway,
        patch_m: target.measured().patch_m,
        panels: &panels,
        target: matches!(target, Target::Point(_)).then_some(dot),
        caption: &caption(arguments, target),
    };
    Ok(bound_svg(&picture))
}

fn title(strategy: Strategy) -> &'static str {
    match strategy {
        Strategy::SinglePatch => "single patch, no edge",
        Strategy::SingleCorner => "single corner",
        Strategy::DoublePatch => "two patches, no edges",
        Strategy::Doorway => "doorway",
    }
}

fn regions(arguments: &Arguments, strategy: Strategy, rows: &[Row]) -> Vec<Region> {
    let k = Strategy::ALL.iter().position(|s| *s == strategy).unwrap_or(0);
    let region = |row: &Row| Region {
        angles: row.angles,
        widths: [row.bounds[k].sd_phi1, row.bounds[k].sd_phi2].map(|sd| arguments.width_sd * sd),
    };
    rows.iter().map(region).collect()
}

/// The error against the swept value, one panel per place.
fn curves(target: &Target, choice: Choice, values: usize, rows: &[Row]) -> String {
    let panel = |rows: &[Row]| {
        let curve = |(k, strategy): (usize, Strategy)| Curve {
            name: title(strategy).into(),
            points: rows.iter().map(|row| [row.value.unwrap_or(0.0), row.bounds[k].error_m()]).collect(),
        };
        let [x, y] = rows[0].place;
        CurvesPanel {
            title: format!("at x = {x:.2} m, y = {y:.2} m"),
            curves: Strategy::ALL.into_iter().enumerate().map(curve).collect(),
        }
    };
    let panels: Vec<CurvesPanel> = rows.chunks(values.max(1)).map(panel).collect();
    let caption =
        format!("Least error of an unbiased estimate. Before the {} changes: {}", choice.name(), setting(target));
    let (x_label, y_label) = (choice.unit(), "error of the position [m]");
    curves_svg(&CurvesPicture { x_label, y_label, panels: &panels, caption: &caption })
}

fn caption(arguments: &Arguments, target: &Target) -> String {
    let mut caption = format!(
        "Regions are {} standard deviations of the Cramér-Rao bound wide in each angle. {}",
        arguments.width_sd,
        setting(target)
    );
    if let Target::Point(_) = target {
        caption += " Below: samples at this noise of a target at the red dot.";
    }
    caption
}

/// The setup in words.
fn setting(target: &Target) -> String {
    let measured = target.measured();
    let mut caption = format!("Edges {} m apart, ", measured.doorway.width_m);
    if measured.doorway.wall_thickness_m > 0.0 {
        caption += &format!("wall {} m thick, ", measured.doorway.wall_thickness_m);
    }
    caption += &format!("patches of {} m, {1} x {1} pixels", measured.patch_m, measured.pixels);
    caption
        + &match target {
            Target::Point(setup) => format!("; noise {:e}, brightness 1.", setup.noise),
            Target::Person(setup) => format!(
                "; noise {} % of the floor's level. A person {} m high with a contrast of {} %; gain and even light of \
                 each patch unknown, {} % of the light from the visible side.",
                100.0 * setup.measured.noise,
                setup.height_m,
                format!("{}", 100.0 * setup.contrast).replace('-', "−"),
                100.0 * setup.visible_share
            ),
        }
}
