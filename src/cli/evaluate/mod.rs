mod picture;
mod table;
mod yardstick;

use std::io::{BufReader, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, anyhow, bail};
use clap::CommandFactory;
use doorcam::config::Config;
use doorcam_engine::Assembly;
use doorcam_engine::evaluation::{Observed, Report, Scorer, read_updates};
use doorcam_engine::{Model, Published, StepError};
use doorcam_source::Purpose;
use doorcam_source::files::{self, FileKind};
use doorcam_source::recording::{Entry, Recording};
use doorcam_source::truth::Truth;

use self::yardstick::{Yardstick, bound_m};
use super::reconstruct::recording_time;
use super::skipping::Skipping;
use super::{ModelOptions, manifest_of, progress};
use doorcam::feed::open_recording;

/// Score tracks against the truth of recordings: a table, JSON, pictures of the paths
///
/// Each recording is reconstructed frame by frame as if it were live. In each frame after background_frames, the
/// confirmed and coasting tracks are optimally assigned to the people in truth.json who are less than 0.5 m away.
/// Whoever is in a frame without a map is missed.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Columns:
  frames           scored frames: those after background_frames that are in truth.json
  targets          people to be found, counted in each scored frame
  mean, RMSE, p95  distance from the true to the reported place of those found; 95 of 100 are at most p95
  bound            Cramer-Rao: the least RMSE that one frame's pixels allow, given the noise measured in the recording
  efficiency       bound / RMSE; above 100 % where a track's past helps more than everything else harms
  missed           share of targets that were not found
  false            reports that match nobody, counted in each scored frame
  false tracks     tracks that match nobody in more than half of their scored frames
  switches         changes of the track that a person is found as
  in ellipse       share of those found who are inside the reported 95 % ellipse; 95 % if the ellipses are right
  GOSPA            mean distance with p = 2, alpha = 2, c = 0.5 m: errors, missed and false in one figure
  unwatched        scored frames without a map: everybody in them is missed
  directions       reports that only tell in which direction somebody is: neither missed nor false
  crossings        of the threshold: right (within 0.5 s, same direction), missed, false
docs/evaluation.md defines them all.

With --json, one object per recording, one per line: recording, frames, scored_frames, targets, detected, missed,
false, mean_error_m, rmse_m, p95_error_m, gospa_m, id_switches, timing_ms, crossings, unwatched, directions, and more;
with --by-person also by_person and by_distance.

Examples:
  doorcam evaluate recordings/D1 recordings/D2 --output pictures
  doorcam evaluate recordings/D1 --json | python3 -m json.tool
  doorcam evaluate recordings/D5 --by-person
  doorcam evaluate recordings/syn-1 --detections
  doorcam evaluate recordings/D1 --updates updates.jsonl")]
pub(super) struct Arguments {
    /// Directories of recordings that have a truth.json
    #[arg(required = true, value_name = "RECORDING")]
    recordings: Vec<PathBuf>,
    /// Print one JSON object per recording on stdout instead of a table
    #[arg(long)]
    json: bool,
    /// Write a picture of each recording's paths here: evaluation_NAME.svg and .png
    #[arg(long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// People who came in less than S seconds ago count neither as found nor as missed [default: 1; with --detections
    /// 0]
    #[arg(long, value_name = "S", allow_hyphen_values = true, value_parser = parse_settle)]
    settle: Option<f64>,
    /// Add rows: each person's figures, and those of each metre of distance from the middle of the opening
    #[arg(long)]
    by_person: bool,
    /// Score the detections of each frame instead of tracks
    #[arg(long)]
    detections: bool,
    /// Score the updates in FILE (one JSON object per line, as reconstruct prints and the live socket sends them)
    /// instead of reconstructing the one RECORDING
    #[arg(long, value_name = "FILE", conflicts_with = "detections")]
    updates: Option<PathBuf>,
    #[command(flatten)]
    model: ModelOptions,
}

fn parse_settle(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|s: &f64| s.is_finite() && *s >= 0.0).ok_or_else(|| "expected 0 or more seconds".into())
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    if arguments.updates.is_some() && arguments.recordings.len() > 1 {
        let message = "--updates FILE takes only one RECORDING\n";
        super::Arguments::command().error(clap::error::ErrorKind::TooManyValues, message).exit();
    }
    let config = arguments.model.config()?;
    if let Some(directory) = &arguments.output {
        picture::prepare(directory, &arguments.recordings)?;
    }
    let mut reports = Vec::new();
    let done = arguments.recordings.iter().try_for_each(|path| {
        let report = evaluate(arguments, &config, path)?;
        if arguments.json {
            let mut stdout = std::io::stdout().lock();
            writeln!(stdout, "{}", serde_json::to_string(&report)?)?;
            stdout.flush()?;
        }
        reports.push(report);
        Ok(())
    });
    // After a failure, show the recordings that were done before it.
    if !arguments.json && !reports.is_empty() {
        write!(std::io::stdout().lock(), "{}", table::table(&reports))?;
    }
    done
}

fn evaluate(arguments: &Arguments, config: &Config, path: &Path) -> anyhow::Result<Report> {
    let recording = open_recording(path)?;
    let truth_file = path.join(Truth::FILE);
    let Some(truth) = Truth::of_recording(path)? else {
        bail!("{}: no such file, expected the true places of everybody (docs/recordings.md)", truth_file.display());
    };
    let Some([_, first]) = recording.manifest.background_frames else {
        let manifest = path.join("recording.json");
        bail!("{}: background_frames is missing, expected [first, end) of the empty room", manifest.display());
    };
    if truth.frames.iter().all(|frame| frame.index < first) {
        bail!(
            "{}: no frame after background_frames (index {first} or more), so nothing to score",
            truth_file.display()
        );
    }
    let settle = arguments.settle.unwrap_or(if arguments.detections { 0.0 } else { 1.0 });
    truth.check_times(recording.manifest.fps).map_err(|e| anyhow!("{}: {e}", truth_file.display()))?;
    let mut scorer = Scorer::new(&truth, first, settle).with_context(|| truth_file.display().to_string())?;
    let mut skipping = Skipping::default();
    match &arguments.updates {
        Some(file) => {
            let opened = files::open(file, FileKind::UPDATES).with_context(|| file.display().to_string())?;
            let updates = read_updates(BufReader::new(opened)).with_context(|| file.display().to_string())?;
            updates.iter().for_each(|update| scorer.score(update));
        }
        None => {
            let observed = if arguments.detections { Observed::detections } else { Observed::tracks };
            let mut yardstick = Yardstick::default();
            reconstruct(config, &recording, &mut skipping, |model, published| {
                let bound = yardstick.of(model, published);
                scorer
                    .score_against(&observed(published), |place, estimate| bound_m(bound, published, place, estimate));
            })?;
        }
    }
    let evaluation = scorer.finish();
    if evaluation.frames.is_empty() {
        let from = arguments.updates.as_deref().unwrap_or(path);
        let truth = truth_file.display();
        bail!("{}: no update of a frame that is in {truth}{}", from.display(), skipping.because());
    }
    if evaluation.unseen > 0 {
        tracing::warn!(
            "{}: {} frames of truth.json have no update and are not scored",
            path.display(),
            evaluation.unseen
        );
    }
    let mut report = evaluation.report(&path.display().to_string(), recording.frames.len());
    if arguments.by_person {
        (report.by_person, report.by_distance) = (Some(evaluation.by_person()), Some(evaluation.by_distance()));
    }
    if let Some(directory) = &arguments.output {
        picture::write(directory, &recording, config, &evaluation, &report)?;
    }
    Ok(report)
}

/// Processes the frames of a recording as if they were live; calls `each` with the update of every frame after the
/// background, with a map or without.
fn reconstruct(
    config: &Config,
    recording: &Recording,
    skipping: &mut Skipping,
    mut each: impl FnMut(&Model, &Published),
) -> anyhow::Result<()> {
    let named = || manifest_of(&recording.path);
    let mut engine = Assembly::new(config.settings()).for_recording(&recording.manifest).with_context(named)?;
    let model = engine.watched().model;
    let entries: Vec<&Entry> =
        recording.frames.iter().filter(|e| recording.purpose(e.index) != Purpose::Before).collect();
    let progress = progress(entries.len() as u64);
    for entry in entries {
        let stepped = doorcam_source::load(recording, entry)
            .map_err(StepError::Skipped)
            .and_then(|frame| engine.step(&frame, recording_time(entry.seconds)));
        match stepped {
            Ok(published) if recording.purpose(entry.index) == Purpose::Watch => each(&model, &published),
            Ok(_) => {}
            Err(StepError::Skipped(skipped)) => skipping.add(entry, &skipped, &progress),
            Err(e @ StepError::NoBackground) => bail!("{}: {e}{}", recording.path.display(), skipping.because()),
        }
        progress.inc(1);
    }
    progress.finish_and_clear();
    skipping.finish(recording, &engine);
    Ok(())
}
