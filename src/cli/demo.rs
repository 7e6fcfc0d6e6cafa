use std::net::SocketAddr;
use std::path::{Path, PathBuf};

use anyhow::Context;
use doorcam::config::Config;
use doorcam::simulation::{Scenario, write_recording};
use doorcam::source::{Pace, ReplayOptions};

use super::progress;
use super::serve::serve_recording;

/// Show a simulated doorway, live, with the page: no camera needed
///
/// Two simulated people walk through a simulated room; a recording of the floor in front of its doorway is made and
/// replayed again and again.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  doorcam demo
  doorcam demo --listen 0.0.0.0:8000
  doorcam demo --only-record walk && doorcam reconstruct walk --output pictures")]
pub(super) struct Arguments {
    /// Address and port of the page [default: 127.0.0.1:8080]
    #[arg(long, value_name = "ADDR:PORT")]
    listen: Option<SocketAddr>,
    /// Make the recording in DIR and leave it there, rather than in a temporary directory
    #[arg(long, value_name = "DIR")]
    keep: Option<PathBuf>,
    /// Write the recording to DIR and stop
    #[arg(long, value_name = "DIR", conflicts_with_all = ["keep", "listen"])]
    only_record: Option<PathBuf>,
    /// Seed of the noise: the same seed gives the same recording
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    if let Some(directory) = arguments.only_record.as_ref() {
        return record(directory, arguments.seed);
    }
    // Held until the end: it is removed when it goes.
    let temporary;
    let directory = match &arguments.keep {
        Some(directory) => directory.clone(),
        None => {
            temporary = tempfile::Builder::new().prefix("doorcam-").tempdir().context("no temporary directory")?;
            temporary.path().join("demo")
        }
    };
    record(&directory, arguments.seed)?;
    let looped = ReplayOptions { pace: Pace::Recorded, looped: true };
    serve_recording(&Config::default(), &directory, looped, "demo", arguments.listen)
}

fn record(directory: &Path, seed: u64) -> anyhow::Result<()> {
    let frames = Scenario::DEMO_FRAMES;
    tracing::info!("simulating {frames} frames of a doorway in {}", directory.display());
    let progress = progress(frames);
    let written = write_recording(&Scenario::demo(), directory, frames, seed, || progress.inc(1));
    progress.finish_and_clear();
    written?;
    tracing::info!(
        "recording in {}: two people, not on the reconstruction's grid, known in truth.json",
        directory.display()
    );
    Ok(())
}
