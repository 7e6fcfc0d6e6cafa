//! What looking at the whole picture costs: who is on the camera's own side, and whether the camera has moved.

use std::time::{Duration, Instant};

use jiff::Timestamp;
use serde::Serialize;

use super::{BenchError, milliseconds};
use crate::{Assembly, Engine, Settings};
use doorcam_source::RawFrame;
use doorcam_source::recording::Manifest;

/// Fewest times that the frames are gone through: the middle one of several rounds counts, so that another program that
/// runs for a moment does not.
pub(super) const ROUNDS: usize = 5;

/// Mean times of a frame, over all frames as they follow one another, with tracking. As the whole picture is looked at
/// only a few times a second, the mean depends on the recording's rate.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Looking {
    /// With the visible side and the watch over the camera, in milliseconds.
    pub with_ms: f64,
    /// Without them, in milliseconds.
    pub without_ms: f64,
    /// The first divided by the second.
    pub ratio: f64,
}

/// Measures it on frames after `empty` ones; `None` if the recording shows only patches. Both engines take each frame in
/// turn, so that whatever else the machine does slows both.
pub(super) fn measure(
    settings: &Settings,
    manifest: &Manifest,
    empty: &[&RawFrame],
    frames: &[&RawFrame],
    rounds: usize,
    mut each: impl FnMut(),
) -> Result<Option<Looking>, BenchError> {
    if manifest.calibration().is_none() {
        return Ok(None);
    }
    let assembly = Assembly::new(settings.clone());
    let mut engines = [assembly.for_recording(manifest)?, assembly.without_looking_around().for_recording(manifest)?];
    for engine in &mut engines {
        for frame in empty.iter().chain(frames.first()) {
            engine.step(frame, Timestamp::UNIX_EPOCH)?;
        }
    }
    let step_s = 1.0 / manifest.fps;
    let begin_s = frames.first().map_or(0.0, |frame| frame.seconds) + step_s;
    let length_s = frames.last().map_or(0.0, |frame| frame.seconds + step_s) - begin_s + step_s;
    let mut means = [Vec::new(), Vec::new()];
    for round in 0..rounds {
        let mut sums = [Duration::ZERO; 2];
        for frame in frames {
            // Time goes on, or every frame would be due for a look.
            let frame = RawFrame { seconds: frame.seconds + step_s + length_s * round as f64, ..(*frame).clone() };
            for (engine, sum) in engines.iter_mut().zip(&mut sums) {
                *sum += timed(engine, &frame)?;
            }
            each();
        }
        for (means, sum) in means.iter_mut().zip(sums) {
            means.push(milliseconds(sum) / frames.len() as f64);
        }
    }
    let [with_ms, without_ms] = means.map(middle);
    Ok(Some(Looking { with_ms, without_ms, ratio: with_ms / without_ms.max(f64::MIN_POSITIVE) }))
}

fn timed(engine: &mut Engine, frame: &RawFrame) -> Result<Duration, BenchError> {
    let start = Instant::now();
    std::hint::black_box(engine.step(frame, Timestamp::UNIX_EPOCH)?);
    Ok(start.elapsed())
}

fn middle(mut values: Vec<f64>) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}
