//! How often a frame that was skipped is worth a line in the log.

use std::time::{Duration, Instant};

use doorcam_source::{SkipKind, SkippedFrame};

/// At most one line in this time for each kind of reason. A source that gives nothing else for weeks must not fill the
/// log, and the lines of one kind differ in their file names only.
const QUIET: Duration = Duration::from_secs(60);

/// So many frames in a row that could not be used mean that something is wrong with their source.
const TROUBLE: u64 = 10;

impl Said {
    /// What is untold, if it is time for a line.
    fn due(&mut self, now: Instant) -> Option<u64> {
        if self.at.is_some_and(|at| now.duration_since(at) < QUIET) {
            return None;
        }
        self.at = Some(now);
        Some(std::mem::take(&mut self.untold))
    }
}

/// What is known of the frames that were skipped.
#[derive(Debug, Default)]
pub(super) struct Skips {
    kinds: [Said; SkipKind::ALL.len()],
    /// Frames in a row that could not be used.
    in_a_row: u64,
}

#[derive(Debug, Default)]
struct Said {
    at: Option<Instant>,
    /// Frames that no line has told yet.
    untold: u64,
}

impl Skips {
    /// Counts a frame that arrived but could not be used, besides [`Self::add`].
    pub fn unusable(&mut self) {
        self.in_a_row += 1;
    }

    /// Counts a skipped frame. Returns how many of its kind there were since the last line about it, itself included, if
    /// it is time for another one.
    pub fn add(&mut self, skipped: &SkippedFrame, now: Instant) -> Option<u64> {
        let said = &mut self.kinds[skipped.kind as usize];
        said.untold += 1;
        said.due(now)
    }

    /// Takes note of a frame that could be used.
    pub fn end(&mut self) {
        self.in_a_row = 0;
    }

    /// How many frames in a row could not be used, if they are so many that something is wrong.
    pub fn trouble(&self) -> Option<u64> {
        Some(self.in_a_row).filter(|&count| count >= TROUBLE)
    }
}

/// How often JPEGs without an end marker are worth a line. They are used.
#[derive(Debug, Default)]
pub(super) struct Unended {
    seen: u64,
    said: Said,
}

impl Unended {
    /// Takes an engine's count of them. Returns how many there were since the last line, if it is time for another one.
    pub fn counted(&mut self, count: u64, now: Instant) -> Option<u64> {
        // Another engine counts from 0 again.
        let new = count.checked_sub(self.seen).unwrap_or(count);
        self.seen = count;
        self.said.untold += new;
        if new == 0 { None } else { self.said.due(now) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_kind_has_a_line_a_minute_that_counts_those_without() {
        let (mut skips, start) = (Skips::default(), Instant::now());
        let mut at = |seconds: u64, name: &str, kind| {
            skips.add(&SkippedFrame::new(name, kind, format!("{name} is bad")), start + Duration::from_secs(seconds))
        };
        assert_eq!(at(0, "a.jpg", SkipKind::Gone), Some(1));
        for n in 0..1000 {
            assert_eq!(at(n % 60, &format!("{n}.jpg"), SkipKind::Gone), None);
        }
        assert_eq!(at(30, "b.jpg", SkipKind::Damaged), Some(1));
        assert_eq!(at(60, "c.jpg", SkipKind::Gone), Some(1001));
        assert_eq!(at(61, "d.jpg", SkipKind::Gone), None);
        assert_eq!(at(89, "e.jpg", SkipKind::Damaged), None);
        assert_eq!(at(500, "f.jpg", SkipKind::Damaged), Some(2));
    }

    #[test]
    fn another_engine_counts_from_the_beginning() {
        let (mut unended, start) = (Unended::default(), Instant::now());
        let mut at = |seconds: u64, count| unended.counted(count, start + Duration::from_secs(seconds));
        assert_eq!(
            [at(0, 0), at(1, 3), at(2, 3), at(3, 10), at(70, 10), at(71, 11)],
            [None, Some(3), None, None, None, Some(8)]
        );
        assert_eq!([at(72, 2), at(200, 3)], [None, Some(3)]);
    }

    #[test]
    fn only_many_in_a_row_are_trouble() {
        let mut skips = Skips::default();
        for n in 0..30 {
            skips.unusable();
            assert_eq!(skips.trouble(), None);
            if n % 9 == 8 {
                skips.end();
            }
        }
        (0..10).for_each(|_| skips.unusable());
        assert!(skips.trouble().is_some());
        skips.end();
        assert_eq!(skips.trouble(), None);
    }
}
