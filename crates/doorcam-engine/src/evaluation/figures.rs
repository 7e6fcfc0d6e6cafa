use std::collections::{HashMap, HashSet};

use serde::Serialize;

use super::{CrossingCounts, DistanceRow, Evaluation, FrameScore, PersonRow, StageTimes, TargetScore, Verdict};
use crate::bench::Quantiles;

/// 95th percentile of χ² with 2 degrees of freedom.
pub(super) const CHI_SQUARE_95: f64 = 5.991;

/// The figures of one recording, as docs/evaluation.md defines them; as JSON, what `doorcam evaluate --json` prints. A
/// figure without data, such as the mean error if nobody was found, is none.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Report {
    /// The recording's name, as given.
    pub recording: String,
    /// Number of its frames, scored or not.
    pub frames: usize,
    /// Frames after the empty room that the truth contains and that have an update.
    pub scored_frames: usize,
    /// Targets that should have been found, counted in each scored frame.
    pub targets: usize,
    /// Targets that were found.
    pub detected: usize,
    /// Targets that were not found.
    pub missed: usize,
    /// Reports of nobody, counted in each scored frame.
    #[serde(rename = "false")]
    pub strays: usize,
    /// Mean distance between the true and reported places of the detected targets, in metres.
    pub mean_error_m: Option<f64>,
    /// Root mean square of that distance, in metres.
    pub rmse_m: Option<f64>,
    /// 95th percentile of that distance, in metres.
    pub p95_error_m: Option<f64>,
    /// Mean GOSPA distance over the scored frames, in metres.
    pub gospa_m: Option<f64>,
    /// How often a target was found as another track than when it was last found.
    pub id_switches: usize,
    /// Milliseconds per frame; none if the updates do not tell.
    pub timing_ms: Option<ReportTiming>,
    /// Contribution of each kind of error to the squared GOSPA distance, averaged over the scored frames.
    pub gospa: Option<GospaParts>,
    /// Number of different people who should have been found.
    pub people: usize,
    /// Missed targets as a share of all targets.
    pub missed_share: Option<f64>,
    /// Number of different tracks.
    pub tracks: usize,
    /// Tracks that are nobody in more than half of the scored frames that report them.
    pub false_tracks: usize,
    /// Share of the detected targets that are inside the reported 95 % ellipse.
    pub ellipse_share: Option<f64>,
    /// Median of eᵀ P⁻¹ e: 1.386 if the covariances P are right, less if they are too large.
    pub median_nees: Option<f64>,
    /// Root mean square of the detected targets' Cramér-Rao bounds, in metres: the least error attainable from single
    /// frames.
    pub bound_m: Option<f64>,
    /// That bound as a share of the same targets' root mean square error.
    pub efficiency: Option<f64>,
    /// How many crossings of the threshold were reported.
    pub crossings: CrossingCounts,
    /// Scored frames without a map, in which everybody who counts is missed.
    pub unwatched: usize,
    /// Reports that tell only the direction of somebody, counted in each scored frame: neither right nor false.
    pub directions: usize,
    /// Each person's figures, if they are wanted.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub by_person: Option<Vec<PersonRow>>,
    /// The figures for each metre of distance, if they are wanted.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub by_distance: Option<Vec<DistanceRow>>,
}

/// Times of the scored frames, in milliseconds.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ReportTiming {
    /// Solving eq. 13.
    pub solve: Quantiles,
    /// Detecting and tracking people.
    pub track: Quantiles,
    /// The whole frame.
    pub total: Quantiles,
}

/// Parts of the squared GOSPA distance, in m².
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct GospaParts {
    /// From targets that were found.
    pub localisation_m2: f64,
    /// From targets that were missed.
    pub missed_m2: f64,
    /// From reports of nobody.
    pub false_m2: f64,
}

impl Evaluation {
    /// Calculates the figures of a recording with `frames` frames.
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
            crossings: CrossingCounts::of(&self.crossings),
            unwatched: self.frames.iter().filter(|frame| !frame.watching).count(),
            directions: self.frames.iter().map(|frame| frame.directions.len()).sum(),
            by_person: None,
            by_distance: None,
        }
    }

    /// For each track, in how many scored frames it is somebody (settling or not, at least by direction) and in how
    /// many nobody.
    fn tracks(&self) -> HashMap<u64, Life> {
        let mut lives: HashMap<u64, Life> = HashMap::new();
        for frame in &self.frames {
            let found = frame.targets.iter().filter_map(|target| target.estimate);
            for id in found.chain(frame.directions.iter().copied()).filter_map(|estimate| estimate.id) {
                lives.entry(id).or_default().somebody += 1;
            }
            for id in frame.strays.iter().filter_map(|e| e.id) {
                lives.entry(id).or_default().nobody += 1;
            }
        }
        lives
    }

    /// Changes of the track that a target is found as, also across frames in which it is missed (CLEAR MOT). Each visit
    /// to the room counts as another person.
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

/// Scored frames of a track, by whether it was somebody.
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

/// The smallest of the sorted values that at least this share of them does not exceed.
fn quantile(sorted: &[f64], share: f64) -> Option<f64> {
    let rank = (share * sorted.len() as f64).ceil() as usize;
    sorted.get(rank.saturating_sub(1)).copied()
}

pub(super) fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (count, sum) = values.fold((0_usize, 0.0), |(count, sum), v| (count + 1, sum + v));
    (count > 0).then(|| sum / count as f64)
}

pub(super) fn share(part: usize, all: usize) -> Option<f64> {
    (all > 0).then(|| part as f64 / all as f64)
}
