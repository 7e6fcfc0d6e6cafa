use std::collections::{BTreeMap, HashMap, HashSet};

use super::crossings::Reports;
use super::directions::{Alone, assign_directions};
use super::gospa::squared;
use super::{CUTOFF_M, CrossingScore, Estimate, Gospa, Observed, StageTimes, assign};
use doorcam_core::geometry::Point;
use doorcam_source::truth::{Target, TrueCrossing, Truth};

/// Whether a target was found in one frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// It came in so recently that it need not be found: not counted.
    Settling,
    /// It should have been found but was not.
    Missed,
    /// A report tells the direction it is in, but not the place: not counted.
    Direction,
    /// It was found.
    Detected,
}

/// One target in one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TargetScore {
    /// The person and their true position.
    pub target: Target,
    /// Whether it was found.
    pub verdict: Verdict,
    /// What it was found as, settling or not; none if it was not found.
    pub estimate: Option<Estimate>,
    /// How many times it has come in, including this one.
    pub visit: usize,
    /// The Cramér-Rao bound, in metres: the least root mean square error of an unbiased estimate from this frame alone;
    /// none if unknown.
    pub bound_m: Option<f64>,
}

impl TargetScore {
    /// True position, in metres in the door frame.
    pub fn position(&self) -> Point {
        [self.target.x_m, self.target.y_m]
    }

    /// Distance from the true to the reported position, in metres; none if it was not found.
    pub fn error_m(&self) -> Option<f64> {
        self.estimate.map(|e| squared(self.position(), e.position).sqrt())
    }

    /// Normalised estimation error squared, eᵀ P⁻¹ e: χ² distributed with 2 degrees of freedom if the covariance P is
    /// right. None if it was not found; infinite if P is not positive definite.
    pub fn nees(&self) -> Option<f64> {
        self.estimate.map(|e| e.nees(self.position()))
    }
}

/// One scored frame.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameScore {
    /// Its number in the recording.
    pub index: u64,
    /// Its time in the truth, in seconds.
    pub seconds: f64,
    /// Whether there is a map of it. If not, everybody who counts is missed.
    pub watching: bool,
    /// Everybody who is really there.
    pub targets: Vec<TargetScore>,
    /// Reports of nobody.
    pub strays: Vec<Estimate>,
    /// Reports that are near nobody but tell the direction of somebody who has no report.
    pub directions: Vec<Estimate>,
    /// How long it took to reconstruct; none if the update does not tell.
    pub times: Option<StageTimes>,
}

impl FrameScore {
    /// Number of targets with this verdict.
    pub fn count(&self, verdict: Verdict) -> usize {
        self.targets.iter().filter(|t| t.verdict == verdict).count()
    }

    /// Targets that count and were found.
    pub fn detected(&self) -> impl Iterator<Item = &TargetScore> {
        self.targets.iter().filter(|t| t.verdict == Verdict::Detected)
    }

    /// GOSPA between the targets that count and the reports, without settling targets and their partners, nor directions
    /// and whose they are: removing a pair of an optimal assignment, or somebody without a partner, leaves the rest
    /// optimal.
    pub fn gospa(&self) -> Gospa {
        let errors = self.detected().filter_map(TargetScore::error_m).map(|e| e * e);
        Gospa::new(errors, self.count(Verdict::Missed), self.strays.len(), CUTOFF_M)
    }
}

/// Why a truth cannot be used.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum TruthProblem {
    /// A frame occurs twice.
    #[error("frames: index {0} is there twice")]
    FrameTwice(u64),
    /// A frame has two targets with the same id.
    #[error("frames: index {frame} has two targets with id {id}, expected each target once")]
    TargetTwice {
        /// The frame.
        frame: u64,
        /// The target.
        id: u64,
    },
}

/// Scores the frames of one recording.
pub struct Scorer {
    known: BTreeMap<u64, KnownFrame>,
    /// Times in the truth of the frames before the first to be scored.
    before: BTreeMap<u64, f64>,
    crossings: Vec<TrueCrossing>,
    frames: Vec<FrameScore>,
    /// All frames that had an update.
    met: HashSet<u64>,
    reports: Reports,
}

/// A frame of the truth, with who has just come in.
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
    /// Scores the frames of `truth` from `first` on. People do not count for `settle_s` seconds after they came in,
    /// which is the first known frame with them, or the first one after a known frame without them.
    ///
    /// # Errors
    ///
    /// If the truth has a frame twice, or a target twice in one frame.
    pub fn new(truth: &Truth, first: u64, settle_s: f64) -> Result<Self, TruthProblem> {
        let mut sorted: Vec<_> = truth.frames.iter().collect();
        sorted.sort_by_key(|frame| frame.index);
        let mut known = BTreeMap::new();
        // When somebody who is there came in, and how many times everybody has come in.
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
                // Tolerance for rounding: 2.2 - 1.2 is less than 1.
                let settling = frame.t - came < settle_s - 1e-6;
                targets.push(Known { target, settling, visit: *visit });
            }
            inside = now;
            if known.insert(frame.index, KnownFrame { seconds: frame.t, targets }).is_some() {
                return Err(TruthProblem::FrameTwice(frame.index));
            }
        }
        let scored = known.split_off(&first);
        Ok(Self {
            known: scored,
            before: known.into_iter().map(|(index, frame)| (index, frame.seconds)).collect(),
            crossings: truth.crossings.clone(),
            frames: Vec::new(),
            met: HashSet::new(),
            reports: Reports::default(),
        })
    }

    /// Scores what was reported for a frame. Ignores updates of no frame and of a frame that had one before. Of frames
    /// before the first to be scored, and of those that the truth does not contain, only crossings count.
    pub fn score(&mut self, observed: &Observed) {
        self.score_against(observed, |_, _| None);
    }

    /// Like [`Scorer::score`], with a bound: `bound_m` gives the least error, in metres, with which a person at the
    /// true position, found as that estimate, could have been located.
    pub fn score_against(&mut self, observed: &Observed, bound_m: impl Fn(Point, &Estimate) -> Option<f64>) {
        let Some(index) = observed.frame.filter(|&index| self.met.insert(index)) else { return };
        let known = self.known.get(&index);
        let seconds = known.map(|known| known.seconds).or_else(|| self.before.get(&index).copied());
        self.reports.add(&observed.crossings, observed.time, seconds);
        self.frames.extend(known.map(|known| known.score(index, observed, bound_m)));
    }

    /// All scored frames, in order.
    pub fn finish(mut self) -> Evaluation {
        self.frames.sort_by_key(|frame| frame.index);
        let unseen = self.known.len() - self.frames.len();
        let background_end = self.before.last_key_value().map(|(_, &seconds)| seconds);
        Evaluation { crossings: self.reports.score(&self.crossings, background_end), frames: self.frames, unseen }
    }
}

impl KnownFrame {
    fn score(&self, index: u64, observed: &Observed, bound_m: impl Fn(Point, &Estimate) -> Option<f64>) -> FrameScore {
        let Observed { watching, estimates, times, .. } = observed;
        let truth: Vec<Point> = self.targets.iter().map(Known::position).collect();
        let reported: Vec<Point> = estimates.iter().map(|e| e.position).collect();
        let pairs = assign(&truth, &reported, CUTOFF_M);
        let alone: Vec<usize> = (0..pairs.len()).filter(|&k| pairs[k].is_none()).collect();
        let unpaired: Vec<Estimate> =
            (0..estimates.len()).filter(|&k| !pairs.contains(&Some(k))).map(|k| estimates[k]).collect();
        let people: Vec<Alone> =
            alone.iter().map(|&k| Alone { place: truth[k], counts: !self.targets[k].settling }).collect();
        let pointed = assign_directions(&people, &unpaired);
        let mut directed = vec![false; pairs.len()];
        alone.iter().zip(&pointed).for_each(|(&k, report)| directed[k] = report.is_some());
        let target = |(k, known): (usize, &Known)| {
            // A report without a map of the frame is no finding, even if somebody is there.
            let found = pairs[k].filter(|_| *watching).map(|pair| &estimates[pair]);
            TargetScore {
                target: known.target,
                verdict: match found {
                    _ if known.settling => Verdict::Settling,
                    Some(_) => Verdict::Detected,
                    None if *watching && directed[k] => Verdict::Direction,
                    None => Verdict::Missed,
                },
                estimate: found.copied(),
                visit: known.visit,
                bound_m: found.and_then(|estimate| bound_m(known.position(), estimate)),
            }
        };
        let (directions, strays): (Vec<_>, Vec<_>) =
            unpaired.iter().enumerate().partition(|(k, _)| pointed.contains(&Some(*k)));
        FrameScore {
            index,
            seconds: self.seconds,
            watching: *watching,
            targets: self.targets.iter().enumerate().map(target).collect(),
            strays: strays.into_iter().map(|(_, estimate)| *estimate).collect(),
            directions: directions.into_iter().filter(|_| *watching).map(|(_, estimate)| *estimate).collect(),
            times: *times,
        }
    }
}

impl Known {
    fn position(&self) -> Point {
        [self.target.x_m, self.target.y_m]
    }
}

/// A scored recording.
#[derive(Debug, Clone, PartialEq)]
pub struct Evaluation {
    /// The scored frames, in order.
    pub frames: Vec<FrameScore>,
    /// Crossings of the threshold after the background's frames, true and reported, in order of time.
    pub crossings: Vec<CrossingScore>,
    /// Number of frames that should have been scored but had no update.
    pub unseen: usize,
}

#[cfg(test)]
#[path = "score_tests.rs"]
mod tests;
