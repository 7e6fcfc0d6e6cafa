//! Crossings of the threshold: which of the true ones were reported.

use jiff::Timestamp;
use serde::Serialize;

use super::ReportedCrossing;
use doorcam_core::tracking::Direction;
use doorcam_source::truth::TrueCrossing;

/// A crossing is right if it is reported within this many seconds of when it happened, and with its direction.
pub const CROSSING_WITHIN_S: f64 = 0.5;

/// Tolerance for rounding: 7.6 s − 7.1 s may be more than 0.5 s by a few units of the last place.
const ROUNDING_S: f64 = 1e-6;

/// Whether a crossing was reported.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CrossingVerdict {
    /// It happened and was reported.
    Right,
    /// It happened and was not reported.
    Missed,
    /// It was reported and did not happen.
    False,
}

/// A crossing that happened, or a report of one that did not.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CrossingScore {
    /// When it happened, or when it was said to have happened, in seconds on the truth's clock.
    pub seconds: f64,
    /// Which way.
    pub direction: Direction,
    /// Whether it was reported.
    pub verdict: CrossingVerdict,
}

/// Numbers of crossings.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct CrossingCounts {
    /// Crossings that were reported with their direction, within [`CROSSING_WITHIN_S`].
    pub right: usize,
    /// Crossings that were not.
    pub missed: usize,
    /// Reports of no crossing.
    #[serde(rename = "false")]
    pub strays: usize,
}

impl CrossingCounts {
    /// Counts the verdicts.
    pub(super) fn of(crossings: &[CrossingScore]) -> Self {
        let count = |verdict| crossings.iter().filter(|c| c.verdict == verdict).count();
        Self {
            right: count(CrossingVerdict::Right),
            missed: count(CrossingVerdict::Missed),
            strays: count(CrossingVerdict::False),
        }
    }
}

/// Reported crossings, and what tells their times on the truth's clock.
#[derive(Debug, Default)]
pub(super) struct Reports {
    /// Each with whether its update tells its own time.
    crossings: Vec<(ReportedCrossing, bool)>,
    /// Times of updates by their own clock and, in seconds, by the truth's.
    clocks: Vec<(Timestamp, f64)>,
}

impl Reports {
    /// Adds what an update of `time` reports. `seconds` is its frame's time in the truth, if that contains the frame.
    pub fn add(&mut self, crossings: &[ReportedCrossing], time: Option<Timestamp>, seconds: Option<f64>) {
        self.crossings.extend(crossings.iter().map(|&crossing| (crossing, time.is_some())));
        self.clocks.extend(time.zip(seconds));
    }

    /// The crossings on the truth's clock. Live, a report's time is a time of day: what counts is how long before or
    /// after a frame of the truth it is, and the nearest frame says it best. Without a time of the update, it is taken
    /// for the recording's own clock from 1970-01-01T00:00:00Z.
    fn on_the_truths_clock(mut self) -> Vec<(f64, Direction)> {
        self.clocks.sort_by_key(|(time, _)| *time);
        let clocks = &self.clocks;
        let seconds = |time: Timestamp, timed: bool| {
            let since = |from: Timestamp| time.duration_since(from).as_secs_f64();
            let after = clocks.partition_point(|(of, _)| *of < time);
            let beside = clocks[after.saturating_sub(1)..].iter().take(2);
            let nearest = beside.min_by(|(a, _), (b, _)| since(*a).abs().total_cmp(&since(*b).abs()));
            match nearest {
                Some((of, seconds)) if timed => seconds + since(*of),
                _ => since(Timestamp::UNIX_EPOCH),
            }
        };
        self.crossings.iter().map(|(crossing, timed)| (seconds(crossing.time, *timed), crossing.direction)).collect()
    }

    /// Pairs the reports with what happened; both only `after` that time, if there is one. In order of time.
    pub fn score(self, truth: &[TrueCrossing], after: Option<f64>) -> Vec<CrossingScore> {
        let reported = self.on_the_truths_clock();
        let mut scores = Vec::new();
        for direction in [Direction::In, Direction::Out, Direction::Back] {
            let happened = sorted(truth.iter().filter(|c| c.direction == direction).map(|c| c.t));
            let told = sorted(reported.iter().filter(|(_, of)| *of == direction).map(|(seconds, _)| *seconds));
            let verdicts = pair(&happened, &told);
            scores.extend(verdicts.map(|(seconds, verdict)| CrossingScore { seconds, direction, verdict }));
        }
        scores.retain(|score| after.is_none_or(|after| score.seconds > after));
        scores.sort_by(|a, b| a.seconds.total_cmp(&b.seconds));
        scores
    }
}

fn sorted(times: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut times: Vec<f64> = times.collect();
    times.sort_by(f64::total_cmp);
    times
}

/// Pairs sorted times one to one, so that as many as possible have a partner within [`CROSSING_WITHIN_S`]. Whichever
/// of the two earliest is too early for the other is too early for all that follow, and to pair the two earliest if
/// they can be paired leaves the most to the rest, since all may be apart equally far.
fn pair(happened: &[f64], told: &[f64]) -> impl Iterator<Item = (f64, CrossingVerdict)> {
    let (mut happened, mut told) = (happened, told);
    let mut verdicts = Vec::with_capacity(happened.len() + told.len());
    while let ([at, later @ ..], [said, more @ ..]) = (happened, told) {
        if (at - said).abs() <= CROSSING_WITHIN_S + ROUNDING_S {
            verdicts.push((*at, CrossingVerdict::Right));
            (happened, told) = (later, more);
        } else if at < said {
            verdicts.push((*at, CrossingVerdict::Missed));
            happened = later;
        } else {
            verdicts.push((*said, CrossingVerdict::False));
            told = more;
        }
    }
    verdicts.extend(happened.iter().map(|&at| (at, CrossingVerdict::Missed)));
    verdicts.extend(told.iter().map(|&said| (said, CrossingVerdict::False)));
    verdicts.into_iter()
}

#[cfg(test)]
mod tests {
    use jiff::SignedDuration;
    use proptest::collection::vec;
    use proptest::prelude::*;

    use super::*;

    fn true_crossings(crossings: &[(f64, Direction)]) -> Vec<TrueCrossing> {
        crossings.iter().map(|&(t, direction)| TrueCrossing { t, direction }).collect()
    }

    fn clock(seconds: f64) -> Timestamp {
        Timestamp::UNIX_EPOCH + SignedDuration::from_secs_f64(seconds)
    }

    /// Reports on the recording's own clock.
    fn reports(crossings: &[(f64, Direction)]) -> Reports {
        let mut reports = Reports::default();
        for &(seconds, direction) in crossings {
            reports.add(&[ReportedCrossing { time: clock(seconds), direction }], None, None);
        }
        reports
    }

    fn counts(truth: &[(f64, Direction)], told: &[(f64, Direction)]) -> [usize; 3] {
        let CrossingCounts { right, missed, strays } =
            CrossingCounts::of(&reports(told).score(&true_crossings(truth), None));
        [right, missed, strays]
    }

    /// The most pairs, from trying every assignment.
    fn by_brute_force(truth: &[(f64, Direction)], told: &[(f64, Direction)], taken: &mut Vec<bool>) -> usize {
        let Some((&(at, direction), rest)) = truth.split_first() else { return 0 };
        let mut most = by_brute_force(rest, told, taken);
        for k in 0..told.len() {
            if !taken[k] && told[k].1 == direction && (told[k].0 - at).abs() <= 0.5 {
                taken[k] = true;
                most = most.max(1 + by_brute_force(rest, told, taken));
                taken[k] = false;
            }
        }
        most
    }

    fn crossings() -> impl Strategy<Value = Vec<(f64, Direction)>> {
        // In hundredths away from the limit, so that rounding decides nothing; dense enough for chains of partners.
        let direction = prop_oneof![Just(Direction::In), Just(Direction::Out), Just(Direction::Back)];
        vec(((0..300).prop_map(|k| f64::from(k) * 0.0101), direction), 0..7)
    }

    proptest! {
        #[test]
        fn as_many_are_right_as_in_the_best_of_all_assignments(truth in crossings(), told in crossings()) {
            let right = by_brute_force(&truth, &told, &mut vec![false; told.len()]);
            prop_assert_eq!(counts(&truth, &told), [right, truth.len() - right, told.len() - right]);
        }
    }

    #[test]
    fn right_is_the_same_direction_within_half_a_second() {
        use Direction::{Back, In, Out};
        let truth = [(7.1, In), (15.25, Out)];
        assert_eq!(counts(&truth, &[(7.3, In), (15.0, Out)]), [2, 0, 0]);
        assert_eq!(counts(&truth, &[(7.6, In), (14.75, Out)]), [2, 0, 0]);
        assert_eq!(counts(&truth, &[(7.61, In), (15.0, Out)]), [1, 1, 1]);
        assert_eq!(counts(&truth, &[(7.1, Out), (15.25, Back)]), [0, 2, 2]);
        // Told twice, one of them is false; told by nobody, both are missed.
        assert_eq!(counts(&truth, &[(7.0, In), (7.2, In)]), [1, 1, 1]);
        assert_eq!(counts(&truth, &[]), [0, 2, 0]);
        assert_eq!(counts(&[], &[(7.0, In)]), [0, 0, 1]);
        // The first report is near both, the second only near the first: each has one all the same.
        assert_eq!(counts(&[(1.0, In), (1.4, In)], &[(1.2, In), (0.6, In)]), [2, 0, 0]);
    }

    #[test]
    fn what_happened_before_the_background_ended_does_not_count() {
        use Direction::{In, Out};
        let truth = true_crossings(&[(1.0, Out), (1.9, In), (2.1, Out)]);
        let told = [(0.5, In), (2.2, In), (2.2, Out), (2.6, In)];
        let scores = reports(&told).score(&truth, Some(2.0));
        // The second report tells of what happened just before.
        let expected = [(2.1, Out, CrossingVerdict::Right), (2.6, In, CrossingVerdict::False)];
        assert_eq!(scores.iter().map(|s| (s.seconds, s.direction, s.verdict)).collect::<Vec<_>>(), expected);
    }

    #[test]
    fn the_time_of_day_of_a_live_report_becomes_the_truths() {
        // Frame k of the truth is at 3 + k / 10 s, and the daemon saw it at noon or so.
        let noon: Timestamp = "2026-11-29T12:00:00Z".parse().unwrap();
        let tell = |told_in: u64, seconds: f64| {
            let mut reports = Reports::default();
            for k in 0..20 {
                let time = noon + SignedDuration::from_millis(100 * k as i64);
                let crossing =
                    ReportedCrossing { time: noon + SignedDuration::from_secs_f64(seconds), direction: Direction::In };
                let known = (k != 4).then_some(3.0 + 0.1 * k as f64);
                reports.add(if k == told_in { std::slice::from_ref(&crossing) } else { &[] }, Some(time), known);
            }
            reports.score(&[], None)[0].seconds
        };
        // Told at once, in the frame after, long after, in a frame that the truth does not know, before the first.
        for (frame, seconds) in [(7, 0.7), (8, 0.73), (19, 0.2), (4, 0.41), (0, -0.25), (19, 2.5)] {
            assert!((tell(frame, seconds) - (3.0 + seconds)).abs() < 1e-9, "{frame} {seconds}");
        }
    }
}
