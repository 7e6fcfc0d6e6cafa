use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::Simulator;
use doorcam_source::recorder::{RecordError, RecordingLimits, RecordingPlan, RecordingWriter};
use doorcam_source::truth::Truth;

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
    let truth = Truth { frames: (0..frames).map(rounds).collect(), crossings: Vec::new() };
    let text = serde_json::to_vec(&truth).map_err(Into::into);
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
