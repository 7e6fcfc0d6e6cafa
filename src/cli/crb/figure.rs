//! Figure 5 of the paper, for any setup.

use anyhow::Context;
use doorcam::analysis::bound::{Strategy, place_of, sample_measurement};
use doorcam::render::{BoundPanel, BoundPicture, Region, bound_svg};

use super::options::Target;
use super::{Arguments, Row};

/// Width of the PNG, in pixels.
pub(super) const WIDTH: u32 = 2000;
/// Seed of the samples' noise.
const SEED: u64 = 1;

pub(super) fn svg(arguments: &Arguments, target: &Target, rows: &[Row]) -> anyhow::Result<String> {
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

fn caption(arguments: &Arguments, target: &Target) -> String {
    let measured = target.measured();
    let mut caption = format!(
        "Regions are {} standard deviations of the Cramér-Rao bound wide in each angle. Edges {} m apart, ",
        arguments.width_sd, measured.doorway.width_m
    );
    if measured.doorway.wall_thickness_m > 0.0 {
        caption += &format!("wall {} m thick, ", measured.doorway.wall_thickness_m);
    }
    caption += &format!("patches of {} m, {1} x {1} pixels", measured.patch_m, measured.pixels);
    match target {
        Target::Point(setup) => {
            caption += &format!(
                "; noise {:e}, brightness 1. Below: samples at this noise of a target at the red dot.",
                setup.noise
            );
        }
        Target::Person(setup) => {
            caption += &format!(
                "; noise {} % of the floor's level. A person {} m high with a contrast of {} %; gain and even light of each \
                 patch unknown, {} % of it from the visible side.",
                100.0 * setup.measured.noise,
                setup.height_m,
                100.0 * setup.contrast,
                100.0 * setup.visible_share
            );
        }
    }
    caption
}
