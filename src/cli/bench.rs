use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use doorcam_engine::simulation::luminous::{Scenario, write_recording};
use doorcam_engine::{BENCH_FRAMES, BenchReport, Looking, Quantiles, bench};
use doorcam_source::recording::{Entry, Recording};
use doorcam_source::{Purpose, RawFrame, SkipTally};

use super::skipping::Skipping;
use super::{ModelOptions, progress};
use doorcam::feed::open_recording;

/// Measure how long each stage of a frame takes
///
/// The stages are project (correlating a frame with every facet) and solving eq. 13, either cold from the empty map or
/// warm from the neighbouring frame's map. "Whole frame" is everything from the encoded image to the update, warm.
/// Files are read beforehand. For comparison, the authors' accelerated iteration in Gram form is run in the same
/// process: 500 of its 20,000 steps, with the time scaled up.
///
/// If the recording shows more than the patches, "with looking around" is the mean time of a frame with tracking, the
/// visible side and the watch over the camera, and "without" the same without these two.
///
/// The first 200 frames after background_frames are used, over and over, forwards and then backwards. Frames with an
/// empty map are quick to solve and are left out, unless there are no others.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
With --json, one object: project_ms, cold_ms, warm_ms, frame_ms (p50 and p99 each), looking (with_ms, without_ms,
ratio; null for recordings of patches), published_iteration_ms (p50), facets, and pixels (those used, in both patches
together).

Examples:
  doorcam bench
  doorcam bench recordings/lab-0 --preset published --json")]
pub(super) struct Arguments {
    /// The recording's directory [default: patches of a room of luminous walls and people, simulated in a temporary
    /// directory]
    recording: Option<PathBuf>,
    /// Print one JSON object on stdout instead of a table
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    model: ModelOptions,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let config = arguments.model.config()?;
    // Held until the end: dropping it removes the directory.
    let temporary;
    let path = match &arguments.recording {
        Some(path) => path.clone(),
        None => {
            temporary = tempfile::Builder::new().prefix("doorcam-").tempdir().context("no temporary directory")?;
            simulate(&temporary.path().join("demo"))?
        }
    };
    let recording = open_recording(&path)?;
    let frames = load(&recording)?;
    let bar = progress(0);
    let report = bench(&config.settings(), &recording.manifest, &frames, |done, all| {
        bar.set_length(all as u64);
        bar.set_position(done as u64);
    });
    bar.finish_and_clear();
    let report = report.with_context(|| path.display().to_string())?;
    let mut skipped = SkipTally::default();
    for frame in &report.skipped {
        skipped.add(frame);
    }
    if let Some(words) = skipped.words() {
        tracing::warn!("{}: {words}", path.display());
    }
    if arguments.json {
        println!("{}", serde_json::to_string(&report)?);
    } else {
        print!("{}", table(&report));
    }
    Ok(())
}

fn simulate(directory: &Path) -> anyhow::Result<PathBuf> {
    let frames = Scenario::DEMO_FRAMES;
    let bar = progress(frames);
    let written = write_recording(&Scenario::demo(), directory, frames, 1, || bar.inc(1));
    bar.finish_and_clear();
    written?;
    Ok(directory.to_owned())
}

/// The background frames and the frames after them, still encoded.
fn load(recording: &Recording) -> anyhow::Result<Vec<RawFrame>> {
    let manifest = recording.path.join("recording.json");
    let Some([_, background_end]) = recording.manifest.background_frames else {
        bail!("{}: background_frames is missing, expected [first, end) of the empty room", manifest.display());
    };
    let empty = recording.frames.iter().filter(|e| recording.purpose(e.index) == Purpose::Background);
    let after = recording.frames.iter().filter(|e| e.index >= background_end).take(BENCH_FRAMES);
    let mut skipping = Skipping::default();
    let mut read = |entry: &Entry| match doorcam_source::load(recording, entry) {
        Ok(frame) => Some(frame),
        Err(skipped) => {
            skipping.add(entry, &skipped, &indicatif::ProgressBar::hidden());
            None
        }
    };
    let frames: Vec<RawFrame> = empty.chain(after).filter_map(&mut read).collect();
    if frames.is_empty() {
        bail!("{}: no frame could be used{}", recording.path.display(), skipping.because());
    }
    Ok(frames)
}

fn table(report: &BenchReport) -> String {
    let BenchReport { project_ms, cold_ms, warm_ms, frame_ms, looking, published_iteration_ms, .. } = report;
    let row = |name: &str, ms: &Quantiles| format!("{name:<22}{:>10.3}{:>10.3}\n", ms.p50, ms.p99);
    let published = published_iteration_ms.p50;
    let ratio = |name: &str, p50: f64| format!("published iteration / {name}{:>10.0}\n", published / p50);
    let looking = looking.map_or_else(String::new, |Looking { with_ms, without_ms, ratio }| {
        format!(
            "{:<22}{:>10}\n{:<22}{with_ms:>10.3}\n{:<22}{without_ms:>10.3}\n{:<22}{ratio:>10.2}\n\n",
            "milliseconds, tracked", "mean", "with looking around", "without", "ratio"
        )
    });
    [
        format!("{} facets, {} pixels, {} frames\n\n", report.facets, report.pixels, report.frames),
        format!("{:<22}{:>10}{:>10}\n", "milliseconds", "p50", "p99"),
        row("project", project_ms),
        row("cold solve", cold_ms),
        row("warm solve", warm_ms),
        row("whole frame", frame_ms),
        format!("{:<22}{published:>10.0}\n", "published iteration"),
        format!("{:<22}{:>10.0}\n", "set up a doorway", report.model_ms),
        format!("{:<22}{:>10.0}\n\n", "set up a background", report.problem_ms),
        looking,
        ratio("cold", cold_ms.p50),
        ratio("warm", warm_ms.p50),
        "The published iteration is 20,000 steps; the time is scaled from 500.\n".into(),
    ]
    .concat()
}
