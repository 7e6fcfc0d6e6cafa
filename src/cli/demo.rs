use std::path::PathBuf;

use doorcam::config::Config;
use doorcam::feed::{Place, Simulated, SourceSpec};
use doorcam_source::{Pace, ReplayOptions};

use super::listening::ListenOptions;
use super::serve::{access, show};
use super::simulate;

/// Show a simulated doorway live on the page; no camera needed
///
/// Simulated people walk through a simulated room, over and over, and a simulated camera looks at the floor in front of
/// its doorway.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  doorcam demo
  doorcam demo busy-doorway --listen 127.0.0.1:8000
  doorcam demo --only-record walk && doorcam reconstruct walk --output pictures

`doorcam simulate --list` shows the scenarios.")]
pub(super) struct Arguments {
    /// The scenario to show: a name or a TOML file
    #[arg(default_value = "two-crossing")]
    scenario: String,
    #[command(flatten)]
    listening: ListenOptions,
    /// Record one round into DIR first, then replay that recording in a loop; it is kept
    #[arg(long, value_name = "DIR")]
    keep: Option<PathBuf>,
    /// Record one round into DIR and exit
    #[arg(long, value_name = "DIR", conflicts_with_all = ["keep", "listen"])]
    only_record: Option<PathBuf>,
    /// Seed of the noise; the same seed gives the same frames
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let Arguments { scenario, listening, keep, only_record, seed } = arguments;
    if let Some(directory) = only_record {
        return simulate::write(scenario, directory, *seed, None);
    }
    let mut config = Config::default();
    listening.apply(&mut config);
    let access = access(&config)?;
    let spec = |place| SourceSpec { text: "demo".into(), place };
    if let Some(directory) = keep {
        simulate::write(scenario, directory, *seed, None)?;
        let looped = ReplayOptions { pace: Pace::Recorded, looped: true };
        return show(&config, &spec(Place::Replay(directory.clone(), looped)), access);
    }
    let simulated = Simulated { scenario: scenario.clone(), seed: *seed, pace: Pace::Recorded, once: false };
    show(&config, &spec(Place::Simulate(simulated)), access)
}
