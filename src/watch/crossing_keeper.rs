//! Keeps how many people are inside, and how many walked through since midnight, between runs.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use jiff::Timestamp;

use crate::history::{EventQuery, History, Until};
use crate::watch::Hub;
use crate::watch::crossings::{MOST_INSIDE, Tally};
use doorcam_core::tracking::{Event, EventKind};
use doorcam_source::files::{self, FileKind, replace};

/// The file: one crossing and some numbers.
const FILE: FileKind = FileKind::new("counts of crossings", 1 << 16);
/// How long to wait after a change, so that several in a row are written once.
const GATHER: Duration = Duration::from_millis(500);
/// How long to wait after a failure.
const RETRY: Duration = Duration::from_secs(30);
/// Events that are read from the history at once, and most such parts: a day with a hundred thousand crossings does not
/// hold up the start for long.
const PART: usize = 1000;
const MOST_PARTS: usize = 100;

/// Why the estimate of how many are inside was not set.
#[derive(Debug, thiserror::Error)]
pub enum InsideRefused {
    /// It is no number of people.
    #[error("inside is {0}, expected a whole number from 0 to {MOST_INSIDE}")]
    Unfit(serde_json::Number),
    /// Its file cannot be read or written.
    #[error("{}: {reason}", .file.display())]
    Store {
        /// The file.
        file: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
}

/// Writes what a [`Hub`] counts to a file, and sets it right.
pub struct CrossingKeeper {
    file: Option<PathBuf>,
    hub: Arc<Hub>,
    /// What need not be written. Held while it is written, so that the last change is the one that is kept.
    saved: Mutex<Option<Tally>>,
}

impl CrossingKeeper {
    /// Goes on with what the file and the history have of earlier runs. Without a file the estimate is of this run
    /// alone. A file that cannot be used is said in the log, and the counts begin with what the history has.
    pub fn new(file: Option<PathBuf>, hub: Arc<Hub>, history: &History) -> Self {
        let kept = file.as_deref().map(load).transpose().unwrap_or_else(|e| {
            tracing::warn!("{e}: how many are inside is not known from before");
            None
        });
        let kept = kept.flatten();
        let now = Timestamp::now();
        let crossings = crossings(history, hub.reread_crossings_from(kept.as_ref(), now));
        hub.resume_crossings(kept.clone(), &crossings, now);
        // Where nobody has ever walked through, there is nothing to keep.
        let saved = kept.or_else(|| crossings.is_empty().then(|| hub.tally(now)));
        Self { file, hub, saved: Mutex::new(saved) }
    }

    /// Sets the estimate of how many are inside.
    ///
    /// # Errors
    /// If it is no whole number from 0 to [`MOST_INSIDE`], or cannot be saved. It stays as it was then.
    pub fn set_inside(&self, inside: &serde_json::Number) -> Result<(), InsideRefused> {
        // A whole number may be written as 2.0.
        let whole = inside.as_f64().filter(|n| n.fract() == 0.0 && (0.0..=f64::from(MOST_INSIDE)).contains(n));
        let whole = whole.ok_or_else(|| InsideRefused::Unfit(inside.clone()))? as u32;
        let now = Timestamp::now();
        let mut saved = lock(&self.saved);
        if let Some(file) = &self.file {
            let next = self.hub.tally(now).with_inside(whole, now);
            write(file, &next)?;
            *saved = Some(next);
        }
        self.hub.set_inside(whole, now);
        Ok(())
    }

    /// Writes the counts, if they have changed and there is a file.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn save(&self) -> Result<(), InsideRefused> {
        let Some(file) = &self.file else { return Ok(()) };
        let mut saved = lock(&self.saved);
        let tally = self.hub.tally(Timestamp::now());
        if saved.as_ref() != Some(&tally) {
            write(file, &tally)?;
            *saved = Some(tally);
        }
        Ok(())
    }

    /// Writes the counts whenever they have changed. Never ends.
    pub async fn keep(self: Arc<Self>) {
        let mut changes = self.hub.crossing_changes();
        let mut is_well = true;
        while changes.changed().await.is_ok() {
            tokio::time::sleep(GATHER).await;
            loop {
                changes.mark_unchanged();
                let keeper = Arc::clone(&self);
                // An error of the task is a panic, which was reported when it happened.
                let Ok(Err(e)) = tokio::task::spawn_blocking(move || keeper.save()).await else { break };
                if std::mem::take(&mut is_well) {
                    tracing::warn!("{e}: how many walked through is kept for this run only until that works");
                }
                tokio::time::sleep(RETRY).await;
            }
            is_well = true;
        }
    }
}

/// The crossings that the history has from a time on, in their order.
fn crossings(history: &History, from: Timestamp) -> Vec<Event> {
    let kinds = EventKind::ALL.into_iter().filter(|kind| kind.direction().is_some()).collect();
    let mut query = EventQuery { from: Some(from), kinds, limit: PART, ..EventQuery::default() };
    let mut events = Vec::new();
    for _ in 0..MOST_PARTS {
        match history.events(&query, &Until::default()) {
            Ok(page) => {
                events.extend(page.events);
                let Some(next) = page.next else { break };
                query.after = Some(next);
            }
            Err(e) => {
                tracing::warn!("{e}: who walked through before is not counted");
                break;
            }
        }
    }
    events
}

fn load(file: &Path) -> Result<Option<Tally>, InsideRefused> {
    let failed = |reason: String| InsideRefused::Store { file: file.to_owned(), reason };
    let text = match files::read_text(file, FILE) {
        Ok(text) => text,
        Err(e) if e.is_missing() => return Ok(None),
        Err(e) => return Err(failed(format!("cannot be read: {e}"))),
    };
    let tally: Tally = serde_json::from_str(&text).map_err(|e| failed(format!("has no counts of crossings: {e}")))?;
    tally.check().map_err(failed)?;
    Ok(Some(tally))
}

fn write(file: &Path, tally: &Tally) -> Result<(), InsideRefused> {
    // Serialisation cannot fail, because all keys are strings.
    let mut text = serde_json::to_vec_pretty(tally).unwrap_or_default();
    text.push(b'\n');
    let failed = |reason: String| InsideRefused::Store { file: file.to_owned(), reason };
    replace(file, &text).map_err(|e| failed(format!("cannot be written: {e}")))
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;
    use crate::feed::{SourceInfo, SourceKind};
    use crate::history::Kept;
    use crate::watch::crossings::tests::crossing;
    use doorcam_engine::{Published, Timing, Update};

    fn a_hub() -> Arc<Hub> {
        let source = SourceInfo { spec: "replay:x".into(), kind: SourceKind::Replay, notes: String::new(), fps: 10.0 };
        Arc::new(Hub::new(None, None, source))
    }

    fn history(text: &str) -> History {
        History::start(Kept::of(&Config::parse(text).unwrap(), SourceKind::Replay)).unwrap()
    }

    fn publish(hub: &Hub, history: &History, events: &[(u64, EventKind)]) {
        let mut update = Update::blank("signed", 0, Timestamp::now(), None, Timing::default());
        update.events.extend(events.iter().map(|&(number, kind)| crossing(number, kind, Timestamp::now())));
        history.take_update(&update);
        hub.publish(Published::new(update, None, None));
    }

    /// In, out and inside.
    fn counts(hub: &Hub) -> (u64, u64, u32) {
        let report = hub.crossings();
        (report.came_in, report.out, report.inside)
    }

    fn number(inside: serde_json::Value) -> serde_json::Number {
        serde_json::from_value(inside).unwrap()
    }

    #[test]
    fn a_restart_goes_on_from_the_file_without_a_history() {
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("deep/crossings.json");
        let memory = history("[history]\nenabled = false\n");
        let hub = a_hub();
        let keeper = CrossingKeeper::new(Some(file.clone()), Arc::clone(&hub), &memory);
        keeper.save().unwrap();
        assert!(!file.exists(), "nobody has ever walked through");
        keeper.set_inside(&number(3.into())).unwrap();
        publish(&hub, &memory, &[(0, EventKind::CrossIn), (1, EventKind::CrossIn), (2, EventKind::CrossOut)]);
        assert_eq!(counts(&hub), (2, 1, 4));
        keeper.save().unwrap();
        let again = a_hub();
        CrossingKeeper::new(Some(file), Arc::clone(&again), &history("[history]\nenabled = false\n"));
        assert_eq!(counts(&again), (2, 1, 4));
        assert_eq!(again.crossings().last, hub.crossings().last);
    }

    #[test]
    fn a_restart_counts_what_only_the_history_has() {
        let directory = tempfile::tempdir().unwrap();
        let config = format!("[history]\nfile = {:?}\n", directory.path().join("history.sqlite"));
        let file = directory.path().join("crossings.json");
        let (stored, hub) = (history(&config), a_hub());
        let keeper = CrossingKeeper::new(Some(file.clone()), Arc::clone(&hub), &stored);
        keeper.set_inside(&number(5.into())).unwrap();
        publish(&hub, &stored, &[(0, EventKind::CrossOut)]);
        keeper.save().unwrap();
        // Not saved any more: the program is killed.
        publish(&hub, &stored, &[(1, EventKind::CrossOut), (2, EventKind::Enter), (3, EventKind::CrossIn)]);
        publish(&hub, &stored, &[(4, EventKind::CrossOut)]);
        assert_eq!(counts(&hub), (1, 3, 3));
        stored.end();
        let (stored, again) = (history(&config), a_hub());
        CrossingKeeper::new(Some(file), Arc::clone(&again), &stored);
        assert_eq!(counts(&again), (1, 3, 3));
        assert_eq!(again.crossings().last.unwrap().sequence, 4);
        let anew = a_hub();
        CrossingKeeper::new(None, Arc::clone(&anew), &stored);
        assert_eq!(counts(&anew), (1, 3, 0), "without a file, from nobody on");
        stored.end();
    }

    #[test]
    fn what_is_no_number_of_people_changes_nothing() {
        let (hub, memory) = (a_hub(), history("[history]\nenabled = false\n"));
        let keeper = CrossingKeeper::new(None, Arc::clone(&hub), &memory);
        for (good, inside) in [(0.into(), 0), (1000.into(), 1000), (2.0.into(), 2)] {
            keeper.set_inside(&number(good)).unwrap();
            assert_eq!(hub.crossings().inside, inside);
        }
        for wrong in [(-1).into(), 1001.into(), 1.5.into(), u64::MAX.into(), 1e300.into()] {
            let wrong = number(wrong);
            let error = keeper.set_inside(&wrong).unwrap_err().to_string();
            assert_eq!(error, format!("inside is {wrong}, expected a whole number from 0 to 1000"));
            assert_eq!(hub.crossings().inside, 2);
        }
    }

    #[test]
    fn an_estimate_that_cannot_be_kept_is_refused_and_a_damaged_file_is_no_reason_not_to_start() {
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("crossings.json");
        for damaged in [
            "",
            "[]",
            "{\"inside\":5}",
            "{\"inside\":2000,\"since\":\"2026-03-01T05:00:00Z\",\"in\":0,\"out\":0,\"back\":0,\"last\":null,\"until\":\"2026-03-01T05:00:00Z\"}",
        ] {
            std::fs::write(&file, damaged).unwrap();
            let error = load(&file).unwrap_err().to_string();
            assert!(error.starts_with(&format!("{}: ", file.display())) && !error.contains('\n'), "{error}");
            let (hub, memory) = (a_hub(), history("[history]\nenabled = false\n"));
            let keeper = CrossingKeeper::new(Some(file.clone()), Arc::clone(&hub), &memory);
            assert_eq!(hub.crossings().inside, 0);
            keeper.set_inside(&number(4.into())).unwrap();
            assert_eq!(load(&file).unwrap(), Some(hub.tally(Timestamp::now())));
        }
        // A directory in its place: nothing can be written.
        std::fs::remove_file(&file).unwrap();
        std::fs::create_dir(&file).unwrap();
        let (hub, memory) = (a_hub(), history("[history]\nenabled = false\n"));
        let keeper = CrossingKeeper::new(Some(file.clone()), Arc::clone(&hub), &memory);
        let error = keeper.set_inside(&number(4.into())).unwrap_err().to_string();
        assert!(error.starts_with(&format!("{}: cannot be written: ", file.display())), "{error}");
        assert_eq!(hub.crossings().inside, 0, "as it was");
    }
}
