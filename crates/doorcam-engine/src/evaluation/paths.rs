//! True and estimated paths, for drawing.

use std::collections::BTreeMap;

use super::figures::CHI_SQUARE_95;
use super::{Estimate, Evaluation, FrameScore, TargetScore, Verdict};
use doorcam_core::geometry::Point;

/// The true path of one person during one visit.
#[derive(Debug, Clone, PartialEq)]
pub struct PersonPath {
    /// The person.
    pub id: u64,
    /// The points in order of time.
    pub points: Vec<TruePoint>,
}

/// One point of a true path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TruePoint {
    /// Time in seconds.
    pub seconds: f64,
    /// Position in metres in the door frame.
    pub position: Point,
    /// Whether the person came in so recently that they need not be found.
    pub settling: bool,
    /// Whether a report tells the person's direction, though not the place.
    pub directed: bool,
    /// What the person was found as, if found.
    pub found: Option<Found>,
}

impl TruePoint {
    /// Whether the person should have been found here and was not.
    pub fn missed(&self) -> bool {
        self.found.is_none() && !self.settling && !self.directed
    }
}

/// What a person was found as.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Found {
    /// The track; none for a detection.
    pub track: Option<u64>,
    /// Distance to the reported place, in metres.
    pub error_m: f64,
    /// Distance from the reported place to the 95 % ellipse in that direction, in metres; none if there is no ellipse.
    pub reach_m: Option<f64>,
}

/// The estimated path of one track.
#[derive(Debug, Clone, PartialEq)]
pub struct TrackPath {
    /// The track; none for all detections together, which form no path.
    pub id: Option<u64>,
    /// The points in order of time.
    pub points: Vec<EstimatedPoint>,
}

/// One point of an estimated path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EstimatedPoint {
    /// Time in seconds.
    pub seconds: f64,
    /// Position in metres in the door frame.
    pub position: Point,
    /// Covariance of the position, in m².
    pub covariance: [[f64; 2]; 2],
    /// Whether nobody is there.
    pub stray: bool,
    /// Whether it follows the previous point without a gap.
    pub joined: bool,
}

impl Evaluation {
    /// True paths, one for each visit of a person to the room.
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

    /// Estimated paths, in order of first appearance.
    pub fn estimated(&self) -> Vec<TrackPath> {
        let mut paths: Vec<TrackPath> = Vec::new();
        let mut before: Vec<Option<u64>> = Vec::new();
        for frame in &self.frames {
            let found = frame.targets.iter().filter_map(|target| target.estimate);
            let somebody = found.chain(frame.directions.iter().copied()).map(|e| (e, false));
            let reported: Vec<_> = somebody.chain(frame.strays.iter().map(|&e| (e, true))).collect();
            for &(Estimate { id, position, covariance }, stray) in &reported {
                let joined = before.contains(&id);
                let point = EstimatedPoint { seconds: frame.seconds, position, covariance, stray, joined };
                match paths.iter_mut().find(|path| path.id == id) {
                    Some(path) => path.points.push(point),
                    None => paths.push(TrackPath { id, points: vec![point] }),
                }
            }
            before = reported.iter().map(|(estimate, _)| estimate.id).collect();
        }
        paths
    }
}

fn true_point(frame: &FrameScore, target: &TargetScore) -> TruePoint {
    let found = || {
        let (error_m, nees) = (target.error_m()?, target.nees()?);
        // On the ellipse eᵀ P⁻¹ e = 5.991, which gives its reach along e. Without an error there is no direction.
        let reach = error_m * (CHI_SQUARE_95 / nees).sqrt();
        Some(Found { track: target.estimate?.id, error_m, reach_m: (reach > 0.0).then_some(reach) })
    };
    TruePoint {
        seconds: frame.seconds,
        position: target.position(),
        settling: target.verdict == Verdict::Settling,
        directed: target.verdict == Verdict::Direction,
        found: found(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluation::{Observed, Scorer};
    use doorcam_source::truth::{Target, TrueFrame, Truth};

    #[test]
    fn paths_break_where_somebody_was_away_and_tracks_where_they_were_not_reported() {
        let target = Target { id: 1, x_m: 0.0, y_m: 1.0, radius_m: 0.2, rgb: [0.0; 3] };
        let there = [true, true, false, true];
        let frame = |(index, there): (u64, bool)| TrueFrame {
            index,
            t: index as f64,
            targets: if there { vec![target] } else { vec![] },
        };
        let truth = Truth { frames: (0..).zip(there).map(frame).collect(), crossings: Vec::new() };
        let mut scorer = Scorer::new(&truth, 0, 0.0).unwrap();
        // 0.3 m to the right, with a standard deviation of 0.1 m in x: the ellipse reaches 0.245 m.
        let estimate = Estimate { id: Some(7), position: [0.3, 1.0], covariance: [[0.01, 0.0], [0.0, 0.04]] };
        for (index, estimates) in [(0, vec![estimate]), (1, vec![]), (2, vec![estimate]), (3, vec![estimate])] {
            scorer.score(&Observed { frame: Some(index), estimates, ..Observed::default() });
        }
        let evaluation = scorer.finish();
        let people = evaluation.people();
        assert_eq!(people.iter().map(|p| (p.id, p.points.len())).collect::<Vec<_>>(), [(1, 2), (1, 1)]);
        let found = people[0].points[0].found.unwrap();
        assert!((found.error_m - 0.3).abs() < 1e-12 && (found.reach_m.unwrap() - 0.1 * 5.991f64.sqrt()).abs() < 1e-12);
        assert_eq!(people[0].points[1].found, None);
        let tracks = evaluation.estimated();
        let points: Vec<_> = tracks[0].points.iter().map(|p| (p.seconds, p.stray, p.joined)).collect();
        assert_eq!((tracks.len(), points), (1, vec![(0.0, false, false), (2.0, true, false), (3.0, false, true)]));
    }
}
