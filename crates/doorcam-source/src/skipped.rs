use std::fmt::Write as _;

use crate::files::ReadError;
use crate::image::ImageError;

/// A frame that could not be read or decoded. The next one may be fine.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{name}: {reason}")]
pub struct SkippedFrame {
    /// The file or device.
    pub name: String,
    /// What was wrong with it.
    pub reason: String,
    /// What kind of reason that is. Two reasons of one kind may differ in their words, as these name files and numbers.
    pub kind: SkipKind,
}

/// Kinds of reasons why a frame is skipped.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SkipKind {
    /// Its number is missing from the recording's sequence.
    Absent,
    /// Its file was there but is gone.
    Gone,
    /// Its file cannot be read, for another reason.
    Unreadable,
    /// It is not an image, or a damaged one.
    Damaged,
    /// It is an image, but not of the expected size, orientation or kind.
    Unfit,
}

impl SkipKind {
    /// All kinds, in the order of their declaration.
    pub const ALL: [Self; 5] = [Self::Absent, Self::Gone, Self::Unreadable, Self::Damaged, Self::Unfit];

    /// What is wrong with frames of this kind, in a few words.
    pub fn words(self) -> &'static str {
        match self {
            Self::Absent => "missing from the sequence",
            Self::Gone => "gone",
            Self::Unreadable => "not readable",
            Self::Damaged => "damaged or no images",
            Self::Unfit => "of another size or kind",
        }
    }
}

impl SkippedFrame {
    /// A frame that is skipped: its file or device, and why.
    pub fn new(name: impl Into<String>, kind: SkipKind, reason: impl Into<String>) -> Self {
        Self { name: name.into(), reason: reason.into(), kind }
    }

    /// A frame whose file cannot be read.
    pub fn unread(name: impl Into<String>, error: &ReadError) -> Self {
        let kind = if error.is_missing() { SkipKind::Gone } else { SkipKind::Unreadable };
        Self::new(name, kind, error.words())
    }

    /// A frame whose image cannot be decoded.
    pub fn undecoded(name: impl Into<String>, error: &ImageError) -> Self {
        let kind = match error {
            ImageError::WrongSize { .. } | ImageError::TooLarge(..) => SkipKind::Unfit,
            _ => SkipKind::Damaged,
        };
        Self::new(name, kind, error.to_string())
    }
}

/// Counts skipped frames by the kind of reason.
#[derive(Debug, Clone, Default)]
pub struct SkipTally([(u64, Option<SkippedFrame>); SkipKind::ALL.len()]);

impl SkipTally {
    /// Counts a frame. Returns how many there were for reasons of its kind.
    pub fn add(&mut self, skipped: &SkippedFrame) -> u64 {
        let (count, first) = &mut self.0[skipped.kind as usize];
        *count += 1;
        first.get_or_insert_with(|| skipped.clone());
        *count
    }

    /// Number of frames.
    pub fn total(&self) -> u64 {
        self.0.iter().map(|(count, _)| count).sum()
    }

    /// How many were skipped and why, most frequent reason first, such as "3 frames skipped: 2 damaged or no images
    /// (the first is a.jpg: broken), 1 gone (b.jpg: no such file)". None if there were none.
    pub fn words(&self) -> Option<String> {
        let mut kinds: Vec<_> = SkipKind::ALL.iter().zip(&self.0).filter(|(_, (count, _))| *count > 0).collect();
        kinds.sort_by_key(|(_, (count, _))| std::cmp::Reverse(*count));
        let total = self.total();
        let mut text = format!("{total} frames skipped");
        for (n, (kind, (count, first))) in kinds.iter().enumerate() {
            let first = first.as_ref().map(ToString::to_string).unwrap_or_default();
            let which = if *count == 1 { "" } else { "the first is " };
            let _ = write!(text, "{} {count} {} ({which}{first})", if n == 0 { ":" } else { "," }, kind.words());
        }
        (total > 0).then_some(text)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_most_frequent_reason_comes_first() {
        let mut tally = SkipTally::default();
        assert_eq!(tally.words(), None);
        tally.add(&SkippedFrame::new("a.jpg", SkipKind::Gone, "no such file"));
        assert_eq!(tally.words().unwrap(), "1 frames skipped: 1 gone (a.jpg: no such file)");
        for name in ["b.jpg", "c.jpg"] {
            tally.add(&SkippedFrame::new(name, SkipKind::Damaged, "broken"));
        }
        assert_eq!(
            tally.words().unwrap(),
            "3 frames skipped: 2 damaged or no images (the first is b.jpg: broken), 1 gone (a.jpg: no such file)"
        );
        assert_eq!(tally.total(), 3);
    }

    #[test]
    fn every_kind_has_its_place() {
        for (place, kind) in SkipKind::ALL.into_iter().enumerate() {
            assert_eq!(kind as usize, place);
        }
    }
}
