use std::collections::BTreeMap;

use super::figures::CHI_SQUARE_95;
use super::{Estimate, Evaluation, FrameScore, TargetScore, Verdict};
use crate::render::{EstimatedPoint, Found, PersonPath, TrackPath, TruePoint};

impl Evaluation {
    /// True paths for a picture: one for each time that somebody was in the room.
    pub fn people(&self) -> Vec<PersonPath> {
        let mut paths: BTreeMap<(u64, usize), PersonPath> = BTreeMap::new();
        for frame in &self.frames {
            for target in &frame.targets {
                let id = target.target.id;
                let path = paths.entry((id, target.visit)).or_insert_with(|| PersonPath { id, points: Vec::new() });
                path.points.push(true_point(frame, target));
            }
        }
        paths.into_values().collect()
    }

    /// Estimated paths for a picture, in the order of their coming.
    pub fn estimated(&self) -> Vec<TrackPath> {
        let mut paths: Vec<TrackPath> = Vec::new();
        for frame in &self.frames {
            let found = frame.targets.iter().filter_map(|target| target.estimate.map(|e| (e, false)));
            for (estimate, stray) in found.chain(frame.strays.iter().map(|&e| (e, true))) {
                let Estimate { id, position, covariance } = estimate;
                let point = EstimatedPoint { seconds: frame.seconds, position, covariance, stray };
                match paths.iter_mut().find(|path| path.id == id) {
                    Some(path) => path.points.push(point),
                    None => paths.push(TrackPath { id, points: vec![point] }),
                }
            }
        }
        paths
    }
}

fn true_point(frame: &FrameScore, target: &TargetScore) -> TruePoint {
    let found = || {
        let (error_m, nees) = (target.error_m()?, target.nees()?);
        // On the ellipse eᵀ P⁻¹ e is 5.991, so that along e it reaches so far; without an error there is no direction.
        let reach = error_m * (CHI_SQUARE_95 / nees).sqrt();
        Some(Found { track: target.estimate?.id, error_m, reach_m: (reach > 0.0).then_some(reach) })
    };
    TruePoint {
        seconds: frame.seconds,
        position: target.position(),
        settling: target.verdict == Verdict::Settling,
        found: found(),
    }
}
