use std::collections::{BTreeMap, HashMap, HashSet};

use super::gospa::squared;
use super::{CUTOFF_M, Estimate, Gospa, Observed, StageTimes, assign};
use doorcam_core::geometry::Point;
use doorcam_source::truth::{Target, Truth};

/// What became of a target in one frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// It came in so lately that it may be found or not.
    Settling,
    /// It should have been found, and was not.
    Missed,
    /// It was found.
    Detected,
}

/// One target in one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TargetScore {
    /// Who, and where really.
    pub target: Target,
    /// What became of it.
    pub verdict: Verdict,
    /// What it was found as; none where it was not.
    pub estimate: Option<Estimate>,
    /// How often it has come in, this time included.
    pub visit: usize,
    /// The least root of the mean squared error of an unbiased estimate from this frame alone (the Cramér-Rao bound), in
    /// metres; none where it is not known.
    pub bound_m: Option<f64>,
}

impl TargetScore {
    /// Where it really is, in metres in the door frame.
    pub fn position(&self) -> Point {
        [self.target.x_m, self.target.y_m]
    }

    /// From the true to the reported place, in metres; none if it was not found.
    pub fn error_m(&self) -> Option<f64> {
        self.estimate.map(|e| squared(self.position(), e.position).sqrt())
    }

    /// Normalised estimation error squared, eᵀ P⁻¹ e: of χ² with 2 degrees of freedom if the covariance P is right. None if
    /// it was not found; infinite for a P that is not positive definite.
    pub fn nees(&self) -> Option<f64> {
        let Estimate { position, covariance: [[xx, xy], [_, yy]], .. } = self.estimate?;
        let [x, y] = [position[0] - self.target.x_m, position[1] - self.target.y_m];
        let determinant = xx * yy - xy * xy;
        if xx > 0.0 && determinant > 0.0 {
            Some((yy * x * x - 2.0 * xy * x * y + xx * y * y) / determinant)
        } else {
            Some(f64::INFINITY)
        }
    }
}

/// One scored frame.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameScore {
    /// Its number in the recording.
    pub index: u64,
    /// Its time by the truth, in seconds.
    pub seconds: f64,
    /// Everybody who is there.
    pub targets: Vec<TargetScore>,
    /// What was reported and is nobody.
    pub strays: Vec<Estimate>,
    /// How long it took to reconstruct; none if the update did not say.
    pub times: Option<StageTimes>,
}

impl FrameScore {
    /// Targets with this verdict.
    pub fn count(&self, verdict: Verdict) -> usize {
        self.targets.iter().filter(|t| t.verdict == verdict).count()
    }

    /// Targets that were found and count.
    pub fn detected(&self) -> impl Iterator<Item = &TargetScore> {
        self.targets.iter().filter(|t| t.verdict == Verdict::Detected)
    }

    /// GOSPA between the targets that count and what was reported, without those who settle and what they were found as:
    /// taking out a pair of an optimal assignment, or somebody without a partner, leaves the rest optimal.
    pub fn gospa(&self) -> Gospa {
        let errors = self.detected().filter_map(TargetScore::error_m).map(|e| e * e);
        Gospa::new(errors, self.count(Verdict::Missed), self.strays.len(), CUTOFF_M)
    }
}

/// Why a truth cannot be compared with.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum TruthProblem {
    /// A frame is there twice.
    #[error("frames: index {0} is there twice")]
    FrameTwice(u64),
    /// A frame has two targets of one name.
    #[error("frames: index {frame} has two targets with id {id}, expected each target once")]
    TargetTwice {
        /// The frame.
        frame: u64,
        /// The target.
        id: u64,
    },
}

/// Scores the frames of one recording, in their order.
pub struct Scorer {
    known: BTreeMap<u64, KnownFrame>,
    frames: Vec<FrameScore>,
    scored: HashSet<u64>,
}

/// A frame of the truth, and who in it has just come in.
struct KnownFrame {
    seconds: f64,
    targets: Vec<Known>,
}

struct Known {
    target: Target,
    settling: bool,
    visit: usize,
}

impl Scorer {
    /// For the frames of `truth` from `first` on. Nobody counts for `settle_s` seconds after they came in: after the first
    /// known frame with them, or the first one after a known frame without them.
    pub fn new(truth: &Truth, first: u64, settle_s: f64) -> Result<Self, TruthProblem> {
        let mut sorted: Vec<_> = truth.frames.iter().collect();
        sorted.sort_by_key(|frame| frame.index);
        let mut known = BTreeMap::new();
        // Since when somebody is there, and how often they came in.
        let mut inside: HashMap<u64, f64> = HashMap::new();
        let mut visits: HashMap<u64, usize> = HashMap::new();
        for frame in sorted {
            let mut now = HashMap::new();
            let mut targets = Vec::with_capacity(frame.targets.len());
            for &target in &frame.targets {
                let visit = visits.entry(target.id).or_default();
                let came = inside.get(&target.id).copied().unwrap_or_else(|| {
                    *visit += 1;
                    frame.t
                });
                if now.insert(target.id, came).is_some() {
                    return Err(TruthProblem::TargetTwice { frame: frame.index, id: target.id });
                }
                // A hair of slack: 2.2 - 1.2 is less than 1.
                let settling = frame.t - came < settle_s - 1e-6;
                targets.push(Known { target, settling, visit: *visit });
            }
            inside = now;
            if known.insert(frame.index, KnownFrame { seconds: frame.t, targets }).is_some() {
                return Err(TruthProblem::FrameTwice(frame.index));
            }
        }
        Ok(Self { known: known.split_off(&first), frames: Vec::new(), scored: HashSet::new() })
    }

    /// Scores what was reported for a frame. Frames that are not to be scored, that the truth does not know or that were
    /// scored before are left out.
    pub fn score(&mut self, observed: &Observed) {
        self.score_against(observed, |_, _| None);
    }

    /// The same, with a yardstick: `bound_m` tells the least error, in metres, with which somebody at a true place could have been
    /// located who was found as that estimate.
    pub fn score_against(&mut self, observed: &Observed, bound_m: impl Fn(Point, &Estimate) -> Option<f64>) {
        let Some((index, known)) = observed.frame.and_then(|index| Some((index, self.known.get(&index)?))) else {
            return;
        };
        if !self.scored.insert(index) {
            return;
        }
        let truth: Vec<Point> = known.targets.iter().map(|k| [k.target.x_m, k.target.y_m]).collect();
        let reported: Vec<Point> = observed.estimates.iter().map(|e| e.position).collect();
        let pairs = assign(&truth, &reported, CUTOFF_M);
        let target = |(known, pair): (&Known, &Option<usize>)| TargetScore {
            target: known.target,
            verdict: match pair {
                _ if known.settling => Verdict::Settling,
                None => Verdict::Missed,
                Some(_) => Verdict::Detected,
            },
            estimate: pair.map(|k| observed.estimates[k]),
            visit: known.visit,
            bound_m: pair.and_then(|k| bound_m([known.target.x_m, known.target.y_m], &observed.estimates[k])),
        };
        let strays = observed.estimates.iter().enumerate().filter(|(k, _)| !pairs.contains(&Some(*k)));
        self.frames.push(FrameScore {
            index,
            seconds: known.seconds,
            targets: known.targets.iter().zip(&pairs).map(target).collect(),
            strays: strays.map(|(_, estimate)| *estimate).collect(),
            times: observed.times,
        });
    }

    /// Everything that was scored, in the order of the frames.
    pub fn finish(mut self) -> Evaluation {
        self.frames.sort_by_key(|frame| frame.index);
        let unseen = self.known.len() - self.frames.len();
        Evaluation { frames: self.frames, unseen }
    }
}

/// A scored recording.
#[derive(Debug, Clone, PartialEq)]
pub struct Evaluation {
    /// The scored frames, in order.
    pub frames: Vec<FrameScore>,
    /// Frames that should have been scored and for which there was no update.
    pub unseen: usize,
}

#[cfg(test)]
#[path = "score_tests.rs"]
mod tests;
