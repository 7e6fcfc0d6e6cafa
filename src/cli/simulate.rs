use std::path::PathBuf;

use anyhow::bail;
use doorcam_engine::simulation::{Scenario, Simulator, record_simulation};

use super::progress;

/// Render a simulated doorway into a recording with truth
///
/// Lamps light a hidden room with people in it. Light that comes through the doorway falls on the floor, which a camera
/// with noise, an exposure and JPEGs looks at. The places of all people, and who goes through the doorway, are written to
/// OUT/truth.json. The same seed gives the same files.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
SCENARIO is a name shown by --list, or a TOML file; config/scenarios has commented ones to start from, and
docs/simulator.md describes every key. Of walk-through, pass-by, bag, bump and random, each seed gives another one: another
room, door, light, path and clothes.

Examples:
  doorcam simulate --list
  doorcam simulate two-crossing walk
  doorcam simulate walk-through in-and-out --seed 7
  doorcam simulate random room --seed 1001 --people 2
  doorcam simulate my-hall.toml hall --seed 7 --frames 300
  doorcam reconstruct walk --output pictures
  doorcam serve --source simulate:two-crossing          the same, live and without files")]
pub(super) struct Arguments {
    /// The scenario: a name or a TOML file
    #[arg(required_unless_present = "list")]
    scenario: Option<String>,
    /// Directory to write to; must be empty or not exist yet
    #[arg(required_unless_present = "list")]
    out: Option<PathBuf>,
    /// Seed of the noise, and of what varies in a scenario that varies
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// People in the room of `random` [default: one to four, as the seed says]
    #[arg(long, value_name = "K", value_parser = clap::value_parser!(u64).range(1..=4))]
    people: Option<u64>,
    /// Number of frames; after the scenario's end it begins again [default: one round of the scenario]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    frames: Option<u64>,
    /// Leave out the bumps of the camera, to compare with a recording of the same seed with them
    #[arg(long, conflicts_with = "people")]
    without_bumps: bool,
    /// List the scenarios that come with doorcam
    #[arg(long, conflicts_with_all = ["scenario", "out", "frames", "people", "without_bumps"])]
    list: bool,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    if arguments.list {
        return list();
    }
    let (Some(scenario), Some(out)) = (&arguments.scenario, &arguments.out) else {
        bail!("expected SCENARIO and OUT");
    };
    let seed = arguments.seed;
    let simulator = match (arguments.people, arguments.without_bumps) {
        (None, false) => return write(scenario, out, seed, arguments.frames),
        (None, true) => doorcam::feed::simulator_without_bumps(scenario, seed)?,
        (Some(people), false) if scenario == "random" => doorcam::feed::random_room(seed, people as usize)?,
        (Some(people), _) => {
            bail!("--people {people}: only the scenario random has as many people as one likes, not {scenario}")
        }
    };
    record(&simulator, scenario, out, arguments.frames)
}

fn list() -> anyhow::Result<()> {
    let names = Scenario::names();
    let width = names.iter().map(String::len).max().unwrap_or(0);
    for name in &names {
        let Scenario { description, duration_s, fps, .. } = Scenario::load(name)?;
        println!("{name:<width$}  {description} ({duration_s} s, {fps} frames a second)");
    }
    Ok(())
}

/// Writes a recording of a scenario.
pub(super) fn write(scenario: &str, out: &std::path::Path, seed: u64, frames: Option<u64>) -> anyhow::Result<()> {
    record(&doorcam::feed::simulator(scenario, seed)?, scenario, out, frames)
}

fn record(simulator: &Simulator, scenario: &str, out: &std::path::Path, frames: Option<u64>) -> anyhow::Result<()> {
    doorcam_source::recorder::RecordingWriter::check_free(out)?;
    let frames = frames.unwrap_or(simulator.scenario().frames());
    tracing::info!("simulating {frames} frames of {scenario} in {}", out.display());
    let progress = progress(frames);
    let written = record_simulation(simulator, out, frames, || progress.inc(1));
    progress.finish_and_clear();
    written?;
    let (first, description) = (simulator.scenario().background_frames(), &simulator.scenario().description);
    tracing::info!("recording in {}: {description}; the first {first} frames show the empty room", out.display());
    Ok(())
}
