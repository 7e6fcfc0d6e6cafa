//! Pictures of true and estimated paths, for `--output`.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use doorcam::config::Config;
use doorcam_engine::evaluation::{CrossingCounts, Evaluation, Report};
use doorcam_engine::figures::{EvaluationPicture, evaluation_svg, png};
use doorcam_source::recording::Recording;

/// Width of the PNG, in pixels.
const WIDTH: u32 = 2000;

/// Creates the directory; refuses recordings whose pictures would have the same name.
pub(super) fn prepare(directory: &Path, recordings: &[PathBuf]) -> anyhow::Result<()> {
    for (k, path) in recordings.iter().enumerate() {
        if let Some(other) = recordings[..k].iter().find(|other| name(other) == name(path)) {
            bail!(
                "--output: {} and {} have the same name, so their pictures would too",
                other.display(),
                path.display()
            );
        }
    }
    std::fs::create_dir_all(directory).with_context(|| directory.display().to_string())
}

fn name(recording: &Path) -> String {
    recording.file_name().map_or_else(|| "recording".into(), |name| name.to_string_lossy().into_owned())
}

pub(super) fn write(
    directory: &Path,
    recording: &Recording,
    config: &Config,
    evaluation: &Evaluation,
    report: &Report,
) -> anyhow::Result<()> {
    let (people, tracks) = (evaluation.people(), evaluation.estimated());
    let name = name(&recording.path);
    let svg = evaluation_svg(&EvaluationPicture {
        doorway: &recording.manifest.doorway,
        room: &config.room.mapped(),
        people: &people,
        tracks: &tracks,
        crossings: &evaluation.crossings,
        caption: &caption(&name, report),
    });
    for (extension, bytes) in [("svg", svg.as_bytes()), ("png", &png(&svg, WIDTH)?)] {
        let path = directory.join(format!("evaluation_{name}.{extension}"));
        std::fs::write(&path, bytes).with_context(|| path.display().to_string())?;
    }
    Ok(())
}

fn caption(name: &str, report: &Report) -> String {
    let mut caption = format!("{name}: {} frames", report.scored_frames);
    if let Some(missed) = report.missed_share {
        caption += &format!(", {} targets, {:.1} % missed", report.targets, 100.0 * missed);
    }
    if let (Some(mean), Some(rmse), Some(p95)) = (report.mean_error_m, report.rmse_m, report.p95_error_m) {
        caption += &format!("; error: mean {mean:.3} m, RMSE {rmse:.3} m, 95 % below {p95:.3} m");
    }
    caption += &format!(
        "; false reports: {}, false tracks: {}, identity switches: {}",
        report.strays, report.false_tracks, report.id_switches
    );
    for (count, name) in [(report.unwatched, "frames without a map"), (report.directions, "only the direction")] {
        if count > 0 {
            caption += &format!("; {name}: {count}");
        }
    }
    if report.crossings != CrossingCounts::default() {
        let CrossingCounts { right, missed, strays } = report.crossings;
        caption += &format!("; crossings: {right} right, {missed} missed, {strays} false");
    }
    if let Some(inside) = report.ellipse_share {
        caption += &format!("; inside the 95 % ellipse: {:.1} %", 100.0 * inside);
    }
    if let Some(gospa) = report.gospa_m {
        caption += &format!("; GOSPA {gospa:.3} m");
    }
    caption + "."
}
