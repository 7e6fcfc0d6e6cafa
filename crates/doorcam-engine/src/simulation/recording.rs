use std::path::{Path, PathBuf};

use rayon::prelude::*;
use serde::Serialize;

use super::Simulator;
use super::ordinary::TrueRoom;
use doorcam_source::recorder::{RecordError, RecordingLimits, RecordingPlan, RecordingWriter};
use doorcam_source::truth::{TrueCrossing, Truth};

/// Why a recording was not written.
#[derive(Debug, thiserror::Error)]
pub enum SimulationError {
    /// The directory already contains a recording.
    #[error("{0}: there is a recording already; remove it or name another directory")]
    Exists(PathBuf),
    /// A file cannot be written.
    #[error("{0}: {1}")]
    Io(PathBuf, std::io::Error),
    /// An image cannot be encoded.
    #[error("{0}: {1}")]
    Image(PathBuf, image::ImageError),
    /// A frame cannot be made.
    #[error(transparent)]
    Frame(#[from] doorcam_source::SkippedFrame),
    /// The recording cannot be written.
    #[error(transparent)]
    Record(#[from] RecordError),
}

/// Number of frames that are made at a time, in parallel.
const AT_A_TIME: u64 = 8;

/// What is written to `truth.json`.
#[derive(Serialize)]
struct Written<'a> {
    #[serde(flatten)]
    truth: Truth,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    bumps: Vec<TrueBump>,
    #[serde(skip_serializing_if = "Option::is_none")]
    room: Option<TrueRoom<'a>>,
}

/// A bump of the camera: where its picture is from then on, from where it was at first.
#[derive(Serialize)]
struct TrueBump {
    /// In seconds.
    t: f64,
    /// To the right and down, in pixels.
    shift_px: [f64; 2],
    /// Clockwise about the middle of the picture, in degrees.
    turn_deg: f64,
}

/// The times of a round's events in each of the rounds of a recording, up to its last frame.
fn in_rounds(simulator: &Simulator, frames: u64, times: &[f64]) -> Vec<(f64, usize)> {
    let scenario = simulator.scenario();
    let round = scenario.frames();
    let starts = (0..frames.div_ceil(round)).map(|k| (k * round) as f64 / scenario.fps);
    let end = frames as f64 / scenario.fps;
    let all = starts.flat_map(|start| times.iter().enumerate().map(move |(k, t)| (start + t, k)));
    all.take_while(|(t, _)| *t < end).collect()
}

fn crossings(simulator: &Simulator, frames: u64) -> Vec<TrueCrossing> {
    let once = simulator.true_crossings();
    let times: Vec<f64> = once.iter().map(|crossing| crossing.t).collect();
    in_rounds(simulator, frames, &times).into_iter().map(|(t, k)| TrueCrossing { t, ..once[k] }).collect()
}

fn bumps(simulator: &Simulator, frames: u64) -> Vec<TrueBump> {
    let scenario = simulator.scenario();
    let once = &scenario.camera.bump;
    let empty = scenario.background_frames() as f64 / scenario.fps;
    let times: Vec<f64> = once.iter().map(|(t, ..)| t + empty).collect();
    let bump = |(t, k): (f64, usize)| {
        let (_, right, down, turn_deg) = once[k];
        TrueBump { t, shift_px: [right, down], turn_deg }
    };
    in_rounds(simulator, frames, &times).into_iter().map(bump).collect()
}

/// Writes the first `frames` frames of a simulator as a recording with truth (docs/recordings.md).
///
/// `each` is called after each frame. The same scenario and seed give the same files.
///
/// # Errors
///
/// If `out` already contains a recording, or a frame cannot be made or written.
pub fn record_simulation(
    simulator: &Simulator,
    out: &Path,
    frames: u64,
    mut each: impl FnMut(),
) -> Result<(), SimulationError> {
    let mut manifest = simulator.manifest().clone();
    manifest.background_frames = manifest.background_frames.map(|[first, end]| [first, end.min(frames)]);
    let plan = RecordingPlan { manifest, empty_seconds: None, calibrated: true, limits: RecordingLimits::default() };
    let mut writer = RecordingWriter::create(out, plan)?;
    let rounds = |number: u64| {
        let mut truth = simulator.truth(number % simulator.scenario().frames());
        truth.t = number as f64 / simulator.scenario().fps;
        truth.index = number;
        truth
    };
    let path = out.join(Truth::FILE);
    let truth = Truth { frames: (0..frames).map(rounds).collect(), crossings: crossings(simulator, frames) };
    let bumps = bumps(simulator, frames);
    let text = serde_json::to_vec(&Written { truth, bumps, room: simulator.true_room() }).map_err(Into::into);
    text.and_then(|text| std::fs::write(&path, text)).map_err(|e| SimulationError::Io(path, e))?;
    for first in (0..frames).step_by(AT_A_TIME as usize) {
        let numbers = first..(first + AT_A_TIME).min(frames);
        let made: Vec<_> = numbers.into_par_iter().map(|number| simulator.frame(number)).collect();
        for (number, frame) in (first..).zip(made) {
            let mut frame = frame?;
            frame.index = Some(number);
            writer.write(&frame)?;
            each();
        }
    }
    writer.finish()?;
    Ok(())
}
