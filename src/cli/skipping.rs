use doorcam_engine::Engine;
use doorcam_source::recording::{Entry, Recording};
use doorcam_source::{SkipTally, SkippedFrame};
use indicatif::ProgressBar;

/// So many skipped frames of one kind have a line each; the summary counts all.
const NAMED: u64 = 5;

/// Tells which frames of a recording were not used, and why.
#[derive(Default)]
pub(super) struct Skipping(SkipTally);

impl Skipping {
    /// Counts a frame that is skipped, and names it if it is one of the first.
    pub(super) fn add(&mut self, entry: &Entry, skipped: &SkippedFrame, progress: &ProgressBar) {
        let count = self.0.add(skipped);
        if count <= NAMED {
            progress.suspend(|| tracing::warn!("skipped frame {}: {skipped}", entry.index));
        }
    }

    /// How many frames were skipped and why, with a colon before it; empty if there were none.
    pub(super) fn because(&self) -> String {
        self.0.words().map_or_else(String::new, |words| format!(": {words}"))
    }

    /// Sums up.
    pub(super) fn finish(&self, recording: &Recording, engine: &Engine) {
        let path = recording.path.display();
        if let Some(words) = self.0.words() {
            tracing::warn!("{path}: {words}");
        }
        match engine.without_end_marker() {
            0 => {}
            count => tracing::warn!(
                "{path}: the JPEGs of {count} frames lack their end marker; all else is there, so they are used"
            ),
        }
    }
}
