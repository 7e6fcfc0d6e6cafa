use pathfinding::kuhn_munkres::{Weights, kuhn_munkres};

/// Assigns detections to people: the matching with the largest sum of gains, where anyone without a partner gains
/// nothing.
///
/// A gain is the log likelihood ratio of the pair to both staying alone. Pairs without a positive gain are not made.
#[derive(Debug, Clone, Default)]
pub(super) struct Association {
    rows: usize,
    columns: usize,
    /// Row-major (people x detections); 0 for impossible pairs.
    gains: Vec<f64>,
    taken: Vec<bool>,
    partners: Vec<Option<usize>>,
}

impl Association {
    /// Starts over, with no pair possible.
    pub fn clear(&mut self, people: usize, detections: usize) {
        (self.rows, self.columns) = (people, detections);
        self.gains.clear();
        self.gains.resize(people * detections, 0.0);
        self.partners.clear();
        self.partners.resize(people, None);
        self.taken.clear();
        self.taken.resize(detections, false);
    }

    /// Sets the gain of a pair; only values above 0 count.
    pub fn set(&mut self, person: usize, detection: usize, gain: f64) {
        self.gains[person * self.columns + detection] = if gain.is_finite() { gain.max(0.0) } else { 0.0 };
    }

    /// The gain of a pair; 0 if it is impossible.
    pub fn gain(&self, person: usize, detection: usize) -> f64 {
        self.gains[person * self.columns + detection]
    }

    /// Each person's detection.
    pub fn partners(&self) -> &[Option<usize>] {
        &self.partners
    }

    /// Gives one person's detection to another who has none.
    pub fn hand_over(&mut self, from: usize, to: usize) {
        self.partners.swap(from, to);
    }

    /// Whether somebody has this detection.
    pub fn is_taken(&self, detection: usize) -> bool {
        self.taken[detection]
    }

    /// Finds the best matching.
    pub fn solve(&mut self) {
        if self.everyone_has_their_best() {
            return;
        }
        let weights = Wide { gains: self, transposed: self.rows > self.columns, sign: 1 };
        let transposed = weights.transposed;
        let (_, matched) = kuhn_munkres(&weights);
        self.partners.fill(None);
        self.taken.fill(false);
        for (short, long) in matched.into_iter().enumerate() {
            let (person, detection) = if transposed { (long, short) } else { (short, long) };
            self.pair(person, detection);
        }
    }

    /// Tries to give everyone their best detection. If no two people want the same one, this is the best matching. It
    /// is the usual case, and allocates nothing.
    fn everyone_has_their_best(&mut self) -> bool {
        for person in 0..self.rows {
            let row = &self.gains[person * self.columns..][..self.columns];
            let Some(best) = (0..self.columns).reduce(|a, b| if row[b] > row[a] { b } else { a }) else { continue };
            if row[best] > 0.0 && self.taken[best] {
                return false;
            }
            self.pair(person, best);
        }
        true
    }

    fn pair(&mut self, person: usize, detection: usize) {
        if self.gain(person, detection) > 0.0 {
            self.partners[person] = Some(detection);
            self.taken[detection] = true;
        }
    }
}

/// The gains as a matrix with at least as many columns as rows, in whole millionths, because the library needs totally
/// ordered numbers.
struct Wide<'a> {
    gains: &'a Association,
    transposed: bool,
    sign: i64,
}

impl Weights<i64> for Wide<'_> {
    fn rows(&self) -> usize {
        self.gains.rows.min(self.gains.columns)
    }

    fn columns(&self) -> usize {
        self.gains.rows.max(self.gains.columns)
    }

    fn at(&self, row: usize, column: usize) -> i64 {
        let (person, detection) = if self.transposed { (column, row) } else { (row, column) };
        // Gains are logs of ratios of doubles, far below this limit.
        self.sign * (self.gains.gain(person, detection).min(1e6) * 1e6).round() as i64
    }

    fn neg(&self) -> Self {
        Self { sign: -self.sign, ..*self }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// The largest sum over all ways to pair people from `person` on with free detections.
    fn best(gains: &[Vec<f64>], person: usize, used: &mut Vec<bool>) -> f64 {
        if person == gains.len() {
            return 0.0;
        }
        let mut sum = best(gains, person + 1, used);
        for detection in 0..used.len() {
            if !used[detection] && gains[person][detection] > 0.0 {
                used[detection] = true;
                sum = sum.max(gains[person][detection] + best(gains, person + 1, used));
                used[detection] = false;
            }
        }
        sum
    }

    fn solved(gains: &[Vec<f64>], detections: usize) -> Association {
        let mut association = Association::default();
        association.clear(gains.len(), detections);
        for (i, row) in gains.iter().enumerate() {
            for (j, &gain) in row.iter().enumerate() {
                association.set(i, j, gain);
            }
        }
        association.solve();
        association
    }

    proptest! {
        #[test]
        fn no_other_matching_gains_more(
            (people, detections, values) in (0..6_usize, 0..6_usize, prop::collection::vec(-3.0..8.0_f64, 36)),
        ) {
            let gains: Vec<Vec<f64>> = (0..people).map(|i| values[i * 6..][..detections].to_vec()).collect();
            let association = solved(&gains, detections);
            let mut sum = 0.0;
            let mut seen = vec![false; detections];
            for (person, partner) in association.partners().iter().enumerate() {
                if let Some(detection) = *partner {
                    prop_assert!(!seen[detection], "one detection for two");
                    prop_assert!(gains[person][detection] > 0.0, "a pair that does not gain");
                    seen[detection] = true;
                    sum += gains[person][detection];
                }
            }
            prop_assert!((0..detections).all(|j| association.is_taken(j) == seen[j]));
            prop_assert!((sum - best(&gains, 0, &mut vec![false; detections])).abs() < 1e-4);
        }
    }

    #[test]
    fn the_sum_decides_not_who_is_nearest() {
        // Greedily, the first person would take detection 0 and leave the second one nothing.
        let association = solved(&[vec![5.0, 4.0], vec![4.5, 0.0]], 2);
        assert_eq!(association.partners(), [Some(1), Some(0)]);
    }

    #[test]
    fn what_is_not_a_number_is_no_pair() {
        assert_eq!(solved(&[vec![f64::NAN, f64::INFINITY]], 2).partners(), [None]);
    }
}
