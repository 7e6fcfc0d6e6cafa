use std::collections::{HashMap, HashSet};

use serde::Serialize;

use super::{Evaluation, FrameScore, StageTimes, TargetScore, Verdict};
use crate::bench::Quantiles;

/// 95 % of χ² with 2 degrees of freedom are below this.
pub(super) const CHI_SQUARE_95: f64 = 5.991;

/// The figures of one recording; as JSON, what `doorcam evaluate --json` prints (DESIGN: the evaluation contract). A figure of
/// nothing, as the mean error where nobody was found, is none.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Report {
    /// The recording, as it was named.
    pub recording: String,
    /// Its frames, scored or not.
    pub frames: usize,
    /// Frames after the empty room that the truth knows and that have an update.
    pub scored_frames: usize,
    /// Targets that should have been found, counted in every scored frame anew.
    pub targets: usize,
    /// Those that were.
    pub detected: usize,
    /// Those that were not.
    pub missed: usize,
    /// What was reported and is nobody, counted in every frame anew.
    #[serde(rename = "false")]
    pub strays: usize,
    /// Mean distance from the true to the reported place of those detected, in metres.
    pub mean_error_m: Option<f64>,
    /// Root of its mean square.
    pub rmse_m: Option<f64>,
    /// 95 of 100 are at most this.
    pub p95_error_m: Option<f64>,
    /// Mean GOSPA distance of the scored frames, in metres.
    pub gospa_m: Option<f64>,
    /// How often a target was found as another track than before.
    pub id_switches: usize,
    /// Milliseconds a frame; none where the updates do not say.
    pub timing_ms: Option<ReportTiming>,
    /// Of the squared GOSPA distance, what each kind of error has, mean over the scored frames.
    pub gospa: Option<GospaParts>,
    /// Different people who should have been found.
    pub people: usize,
    /// Missed, of targets.
    pub missed_share: Option<f64>,
    /// Different tracks.
    pub tracks: usize,
    /// Tracks that are nobody in more than half of the scored frames that report them.
    pub false_tracks: usize,
    /// Of those detected, how many stand inside the reported 95 % ellipse.
    pub ellipse_share: Option<f64>,
    /// Median of eᵀ P⁻¹ e: 1.386 if the covariances P are right; less if they are too large.
    pub median_nees: Option<f64>,
    /// Root of the mean squared bound of those detected, in metres: what could be attained from each frame alone.
    pub bound_m: Option<f64>,
    /// That bound as a share of the root of the mean square of the same targets' errors.
    pub efficiency: Option<f64>,
}

/// Times of the scored frames.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ReportTiming {
    /// Solving eq. 13.
    pub solve: Quantiles,
    /// Detections and tracking.
    pub track: Quantiles,
    /// All of the frame.
    pub total: Quantiles,
}

/// Parts of the squared GOSPA distance, in m².
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct GospaParts {
    /// Of those found.
    pub localisation_m2: f64,
    /// Of those missed.
    pub missed_m2: f64,
    /// Of what is nobody.
    pub false_m2: f64,
}

impl Evaluation {
    /// The figures of a recording of `frames` frames.
    pub fn report(&self, recording: &str, frames: usize) -> Report {
        let count = |verdict| self.frames.iter().map(|frame| frame.count(verdict)).sum::<usize>();
        let (detected, missed) = (count(Verdict::Detected), count(Verdict::Missed));
        let targets = detected + missed;
        let found = || self.frames.iter().flat_map(FrameScore::detected);
        let errors = sorted(found().filter_map(TargetScore::error_m));
        let nees = sorted(found().filter_map(TargetScore::nees));
        let inside = nees.iter().filter(|&&v| v <= CHI_SQUARE_95).count();
        let gospa: Vec<_> = self.frames.iter().map(FrameScore::gospa).collect();
        let part = |of: fn(&super::Gospa) -> f64| mean(gospa.iter().map(of));
        let counted = self.frames.iter().flat_map(|f| &f.targets).filter(|t| t.verdict != Verdict::Settling);
        let tracks = self.tracks();
        let bounded = || found().filter_map(|target| Some((target.bound_m?, target.error_m()?)));
        let bound_m = mean(bounded().map(|(bound, _)| bound * bound)).map(f64::sqrt);
        let bounded_rmse_m = mean(bounded().map(|(_, error)| error * error)).map(f64::sqrt);
        Report {
            recording: recording.to_owned(),
            frames,
            scored_frames: self.frames.len(),
            targets,
            detected,
            missed,
            strays: self.frames.iter().map(|frame| frame.strays.len()).sum(),
            mean_error_m: mean(errors.iter().copied()),
            rmse_m: mean(errors.iter().map(|e| e * e)).map(f64::sqrt),
            p95_error_m: quantile(&errors, 0.95),
            gospa_m: part(|g| g.distance_m()),
            id_switches: self.id_switches(),
            timing_ms: self.timing(),
            gospa: match [part(|g| g.localisation_m2), part(|g| g.missed_m2), part(|g| g.false_m2)] {
                [Some(localisation_m2), Some(missed_m2), Some(false_m2)] => {
                    Some(GospaParts { localisation_m2, missed_m2, false_m2 })
                }
                _ => None,
            },
            people: counted.map(|t| t.target.id).collect::<HashSet<_>>().len(),
            missed_share: share(missed, targets),
            tracks: tracks.len(),
            false_tracks: tracks.values().filter(|track| track.nobody > track.somebody).count(),
            ellipse_share: share(inside, nees.len()),
            median_nees: quantile(&nees, 0.5),
            bound_m,
            efficiency: bound_m.zip(bounded_rmse_m).filter(|(_, rmse)| *rmse > 0.0).map(|(bound, rmse)| bound / rmse),
        }
    }

    /// In how many scored frames each track is somebody, settling or not, and nobody.
    fn tracks(&self) -> HashMap<u64, Life> {
        let mut lives: HashMap<u64, Life> = HashMap::new();
        for frame in &self.frames {
            for id in frame.targets.iter().filter_map(|t| t.estimate?.id) {
                lives.entry(id).or_default().somebody += 1;
            }
            for id in frame.strays.iter().filter_map(|e| e.id) {
                lives.entry(id).or_default().nobody += 1;
            }
        }
        lives
    }

    /// Changes of the track that a target is found as, over frames in which it is missed too (CLEAR MOT). Who leaves the room
    /// is a stranger when they come back.
    fn id_switches(&self) -> usize {
        let mut last: HashMap<(u64, usize), u64> = HashMap::new();
        let mut switches = 0;
        for found in self.frames.iter().flat_map(FrameScore::detected) {
            if let Some(track) = found.estimate.and_then(|e| e.id)
                && last.insert((found.target.id, found.visit), track).is_some_and(|before| before != track)
            {
                switches += 1;
            }
        }
        switches
    }

    fn timing(&self) -> Option<ReportTiming> {
        let stage = |of: fn(&StageTimes) -> f64| {
            let times = sorted(self.frames.iter().filter_map(|frame| frame.times.as_ref()).map(of));
            Some(Quantiles { p50: quantile(&times, 0.5)?, p99: quantile(&times, 0.99)? })
        };
        Some(ReportTiming { solve: stage(|t| t.solve)?, track: stage(|t| t.track)?, total: stage(|t| t.total)? })
    }
}

/// Scored frames of a track.
#[derive(Debug, Clone, Copy, Default)]
struct Life {
    somebody: usize,
    nobody: usize,
}

fn sorted(values: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values
}

/// The smallest of sorted values that so large a share of them does not exceed.
fn quantile(sorted: &[f64], share: f64) -> Option<f64> {
    let rank = (share * sorted.len() as f64).ceil() as usize;
    sorted.get(rank.saturating_sub(1)).copied()
}

fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (count, sum) = values.fold((0_usize, 0.0), |(count, sum), v| (count + 1, sum + v));
    (count > 0).then(|| sum / count as f64)
}

fn share(part: usize, all: usize) -> Option<f64> {
    (all > 0).then(|| part as f64 / all as f64)
}
