use std::sync::Arc;
use std::time::Instant;

use jiff::Timestamp;

use super::hub::{Published, Watched};
use super::{FrameReader, ReadTimes, Reconstruction, Reconstructor, Timing, Update};
use crate::measurement::PatchPair;
use crate::scene::Brightness;
use crate::solver::Audit;
use crate::source::{Purpose, RawFrame, SkippedFrame};

/// The whole way of a frame, from encoded images to an update: the same online and offline.
pub struct Engine {
    reader: FrameReader,
    reconstructor: Reconstructor,
    pair: PatchPair,
    sequence: u64,
    calibration: u32,
    /// Once the first map was made, frames of the empty room are no longer learned from: a looped recording shows them
    /// again, and they should then be seen to be empty.
    watching: bool,
}

/// Why a frame made no update.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum StepError {
    /// This frame is unusable; the next one may be fine.
    #[error(transparent)]
    Skipped(#[from] SkippedFrame),
    /// There is nothing to compare frames with.
    #[error("no frame of the empty room could be read (recording.json: background_frames), so there is no background")]
    NoBackground,
}

impl Engine {
    /// With nothing learned yet.
    pub fn new(reader: FrameReader, reconstructor: Reconstructor) -> Self {
        let pair = PatchPair::zeros(reader.patch().size);
        Self { reader, reconstructor, pair, sequence: 0, calibration: 0, watching: false }
    }

    /// Gives its updates the number of the calibration that they are of.
    pub fn of_calibration(mut self, revision: u32) -> Self {
        self.calibration = revision;
        self
    }

    /// What its updates are of.
    pub fn watched(&self) -> Watched {
        Watched { model: Arc::clone(self.reconstructor.model()), calibration: self.calibration }
    }

    /// Number of the next update.
    pub fn sequence(&self) -> u64 {
        self.sequence
    }

    /// Goes on counting updates from `sequence`.
    pub fn continue_from(&mut self, sequence: u64) {
        self.sequence = sequence;
    }

    /// Learns the empty room anew, from now on.
    pub fn reset_background(&mut self) {
        self.watching = false;
    }

    /// How good the last frame's solution is among those from `starts` random starts; none before the first one.
    pub fn audit(&self, starts: usize) -> Option<Audit> {
        self.reconstructor.audit(starts)
    }

    /// Until the first frame after the background: learns from what shows the empty room. From then on: reconstructs.
    pub fn step(&mut self, frame: &RawFrame, time: Timestamp) -> Result<Published, StepError> {
        let start = Instant::now();
        let read = self.reader.read(frame, &mut self.pair)?;
        let model = self.reconstructor.model().clone();
        let (mut update, scene) = if !self.watching && frame.purpose != Purpose::Watch {
            if frame.purpose == Purpose::Background {
                self.reconstructor.learn(&self.pair);
            }
            (Update::learning(&model, self.sequence, time, frame.index, timing(read, None, start)), None)
        } else {
            let mut reconstruction = self
                .reconstructor
                .reconstruct(&self.pair)
                .map_err(|e| SkippedFrame { name: frame.name.to_string(), reason: e.to_string() })?
                .ok_or(StepError::NoBackground)?;
            self.watching = true;
            let timing = timing(read, Some(&reconstruction), start);
            let update = Update::watching(&model, self.sequence, time, frame.index, &reconstruction, timing);
            // The update has the refit's factors beside the light; figures show one of both.
            if model.brightness == Brightness::Measured {
                reconstruction.scene.multiply(&reconstruction.refit);
            }
            (update, Some(reconstruction.scene))
        };
        update.calibration = self.calibration;
        self.sequence += 1;
        let difference = scene.is_some().then(|| self.reconstructor.difference().clone());
        Ok(Published::new(update, scene, difference))
    }
}

fn timing(read: ReadTimes, solved: Option<&Reconstruction>, start: Instant) -> Timing {
    let ms = |d: std::time::Duration| d.as_secs_f64() * 1e3;
    Timing {
        decode: ms(read.decode),
        rectify: ms(read.rectify),
        background: solved.map_or(0.0, |r| ms(r.background_time)),
        project: solved.map_or(0.0, |r| ms(r.project_time)),
        solve: solved.map_or(0.0, |r| ms(r.solve_time)),
        track: 0.0,
        total: ms(start.elapsed()),
    }
}
