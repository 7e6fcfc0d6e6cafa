//! The figures person by person, and metre by metre of distance.

use std::collections::BTreeMap;

use serde::Serialize;

use super::figures::{CHI_SQUARE_95, mean, share};
use super::{Evaluation, TargetScore, Verdict};

/// One person's figures, over all their visits to the room.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PersonRow {
    /// The person, as truth.json names them.
    pub id: u64,
    /// How they were found.
    #[serde(flatten)]
    pub figures: RowFigures,
}

/// The figures of everybody who stands at about the same distance.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct DistanceRow {
    /// Least distance from the middle of the opening, in metres.
    pub from_m: u32,
    /// Distance at which the next row begins, in metres.
    pub to_m: u32,
    /// How they were found.
    #[serde(flatten)]
    pub figures: RowFigures,
}

/// Figures of some of the targets, as docs/evaluation.md defines them.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RowFigures {
    /// Targets that should have been found, counted in each scored frame.
    pub targets: usize,
    /// Targets that were found.
    pub detected: usize,
    /// Targets that were not found.
    pub missed: usize,
    /// Targets of whom only the direction was reported.
    pub directions: usize,
    /// Mean distance between the true and reported places of the detected targets, in metres.
    pub mean_error_m: Option<f64>,
    /// Share of the detected targets that are inside the reported 95 % ellipse.
    pub ellipse_share: Option<f64>,
}

impl Evaluation {
    /// A row for each person who counts in a scored frame, by their ids.
    pub fn by_person(&self) -> Vec<PersonRow> {
        let rows = self.grouped(|target| target.target.id);
        rows.into_iter().map(|(id, figures)| PersonRow { id, figures }).collect()
    }

    /// A row for each metre of distance from the middle of the opening at which somebody counts in a scored frame, the
    /// nearest first.
    pub fn by_distance(&self) -> Vec<DistanceRow> {
        let rows = self.grouped(|target| target.target.x_m.hypot(target.target.y_m) as u32);
        rows.into_iter().map(|(from_m, figures)| DistanceRow { from_m, to_m: from_m + 1, figures }).collect()
    }

    fn grouped<K: Ord>(&self, key: impl Fn(&TargetScore) -> K) -> BTreeMap<K, RowFigures> {
        let mut groups: BTreeMap<K, Vec<&TargetScore>> = BTreeMap::new();
        let counting = self.frames.iter().flat_map(|f| &f.targets).filter(|t| t.verdict != Verdict::Settling);
        for target in counting {
            groups.entry(key(target)).or_default().push(target);
        }
        groups.into_iter().map(|(key, targets)| (key, RowFigures::of(&targets))).collect()
    }
}

impl RowFigures {
    fn of(targets: &[&TargetScore]) -> Self {
        let with = |verdict| targets.iter().filter(move |target| target.verdict == verdict);
        let count = |verdict| with(verdict).count();
        let (detected, missed) = (count(Verdict::Detected), count(Verdict::Missed));
        let inside = with(Verdict::Detected).filter(|t| t.nees().is_some_and(|v| v <= CHI_SQUARE_95)).count();
        Self {
            targets: detected + missed,
            detected,
            missed,
            directions: count(Verdict::Direction),
            mean_error_m: mean(with(Verdict::Detected).filter_map(|target| target.error_m())),
            ellipse_share: share(inside, detected),
        }
    }
}
