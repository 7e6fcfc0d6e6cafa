use std::fs::File;
use std::path::PathBuf;

use jiff::SignedDuration;
use rusqlite::Connection;

use super::super::clock::System;
use super::super::clock::tests::Manual;
use super::super::handle::{History, MOST_PENDING, Observation};
use super::super::pages::{EventQuery, SpanQuery};
use super::super::query::Tables;
use super::super::store::beside;
use super::super::store::open_reader;
use super::super::store::tests::event;
use super::*;
use doorcam_core::tracking::Occupancy;

const LIMITS: Retention = Retention { age: SignedDuration::MAX, bytes: 50_000_000 };

fn kept(file: Result<PathBuf, String>) -> Kept {
    Kept { file, limits: LIMITS }
}

fn open(kept: Kept) -> Result<(History, Writer), super::super::HistoryError> {
    History::open_with(kept, Box::new(System))
}

fn at(seconds: u64) -> Timestamp {
    Timestamp::from_second(seconds as i64).unwrap()
}

/// Records one observation a second, each with one event; somebody is there in every other second.
fn live(history: &History, seconds: std::ops::Range<u64>) {
    for second in seconds {
        let events = [event(second)];
        let bed = [Occupancy { name: "bed".into(), people: 0, tracks: Vec::new() }];
        let people = Some((usize::from(second % 2 == 1), bed.as_slice()));
        history.take(&Observation { time: at(second), people, events: &events, track: Some(second / 2) });
    }
}

/// The numbers of all events, and the seconds in which spans of the room with somebody in it begin.
fn told(history: &History) -> (Vec<u64>, Vec<u64>) {
    let query = EventQuery { after: Some(0), limit: 100_000, ..EventQuery::default() };
    let reading = lock(&history.shared.reading);
    let memory = reading.in_memory.then_some(&reading.memory.connection);
    let file = reading.file.as_deref().map(|file| open_reader(file).unwrap());
    let tables = Tables { file: file.as_ref(), memory };
    let events = tables.events(&query).unwrap().events;
    let query = SpanQuery { after: None, from: at(0), to: at(1 << 32), zone: None, limit: 100_000 };
    let spans = tables.spans(&query).unwrap().spans;
    let occupied = spans.iter().filter(|span| span.people > 0).map(|span| span.from.as_second() as u64);
    (events.iter().map(|event| event.sequence).collect(), occupied.collect())
}

/// What `told` should be after so many seconds. The last span has not ended.
fn all(seconds: u64) -> (Vec<u64>, Vec<u64>) {
    ((1..seconds).collect(), (0..seconds - 1).filter(|s| s % 2 == 1).collect())
}

#[test]
fn a_full_disk_makes_memory_take_over_until_there_is_room_again() {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("history.sqlite");
    let (history, mut writer) = open(kept(Ok(file.clone()))).unwrap();
    live(&history, 0..200);
    writer.put_away();
    assert_eq!((history.report().state, history.report().reason), ("stored", None));
    // Allow no more pages than there are, so that the next one is refused as on a full disk.
    let connection = &writer.store.as_ref().unwrap().connection;
    let pages: u64 = connection.pragma_query_value(None, "page_count", |row| row.get(0)).unwrap();
    connection.query_row(&format!("PRAGMA max_page_count = {pages}"), (), |_| Ok(())).unwrap();
    live(&history, 200..2000);
    writer.put_away();
    let report = history.report();
    let reason = format!("{}: database or disk is full", file.display());
    assert_eq!((report.state, report.reason, report.lost), ("memory", Some(reason), 0));
    live(&history, 2000..2100);
    writer.put_away();
    assert_eq!(told(&history), all(2100), "file and memory together have everything");
    // The limit applied only to that connection, so a new one can write.
    writer.retry_at = Instant::now();
    live(&history, 2100..2200);
    writer.put_away();
    assert_eq!((history.report().state, history.report().reason), ("stored", None));
    assert_eq!(told(&history), all(2200));
    drop(writer);
    let (history, _writer) = open(kept(Ok(file))).unwrap();
    assert_eq!(told(&history), all(2200), "what was in memory is in the file now");
    assert!(history.numbers().event >= 2200);
}

#[test]
fn a_place_that_cannot_be_written_is_no_error_and_its_numbers_do_not_repeat() {
    let directory = tempfile::tempdir().unwrap();
    let place = directory.path().join("place");
    std::fs::write(&place, "a file, where a directory should be").unwrap();
    let file = place.join("history.sqlite");
    let (history, mut writer) = open(kept(Ok(file.clone()))).unwrap();
    let first = history.numbers().event;
    assert!(first > 1_700_000_000, "{first} may have been used before");
    assert!(history.report().reason.is_some_and(|reason| reason.starts_with(file.to_str().unwrap())));
    live(&history, first..first + 10);
    writer.put_away();
    assert_eq!(told(&history).0.len(), 10);
    std::fs::remove_file(&place).unwrap();
    writer.retry_at = Instant::now();
    live(&history, first + 10..first + 20);
    writer.put_away();
    assert_eq!((history.report().state, told(&history).0.len()), ("stored", 20));
}

#[test]
fn a_file_that_breaks_while_it_is_used_is_put_aside() {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("history.sqlite");
    let (history, mut writer) = open(kept(Ok(file.clone()))).unwrap();
    live(&history, 0..2000);
    writer.put_away();
    writer.store.as_ref().unwrap().connection.query_row("PRAGMA wal_checkpoint(TRUNCATE)", (), |_| Ok(())).unwrap();
    let mut bytes = std::fs::read(&file).unwrap();
    bytes[4096..].fill(0x5a);
    std::fs::write(&file, &bytes).unwrap();
    // The old connection still has the pages in its cache; a new one sees the damage.
    writer.store = None;
    writer.retry_at = Instant::now();
    lock(&history.shared.reading).in_memory = true;
    live(&history, 2000..2010);
    writer.put_away();
    writer.put_away();
    assert_eq!(history.report().state, "stored");
    assert_eq!(told(&history).0, (2000..2010).collect::<Vec<_>>());
    let entries = std::fs::read_dir(directory.path()).unwrap();
    let names: Vec<String> = entries.filter_map(|entry| entry.ok()?.file_name().into_string().ok()).collect();
    assert!(names.iter().any(|name| name.starts_with("history.sqlite.broken-")), "{names:?}");
}

#[test]
fn a_disk_that_hangs_costs_no_more_than_a_bounded_amount_of_memory() {
    let (history, mut writer) = open(kept(Err("none".into()))).unwrap();
    live(&history, 0..MOST_PENDING as u64 + 50);
    assert_eq!(lock(&history.shared.pending).batch.events.len(), MOST_PENDING);
    writer.put_away();
    assert!(history.report().lost >= 50);
    assert_eq!(history.numbers(), Numbers::default());
}

fn state(history: &History) -> (&'static str, String) {
    let report = history.report();
    (report.state, report.reason.unwrap_or_default())
}

/// The numbers of the events in a file that nobody has open.
fn in_file(file: &Path) -> Vec<u64> {
    let connection = Connection::open(file).unwrap();
    let mut select = connection.prepare("SELECT sequence FROM events ORDER BY sequence").unwrap();
    select.query_map((), |row| row.get(0)).unwrap().collect::<Result<_, _>>().unwrap()
}

fn numbers(range: std::ops::Range<u64>) -> Vec<u64> {
    range.collect()
}

#[test]
fn a_file_that_is_deleted_is_noticed_and_made_anew_with_what_came_since() {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("kept/history.sqlite");
    let (history, mut writer) = open(kept(Ok(file.clone()))).unwrap();
    live(&history, 0..50);
    writer.put_away();
    // With all that is beside it, or alone.
    for (gone, from) in
        [(vec!["", "-wal", "-shm", "-lock"], 50), (vec![""], 60), (vec!["-wal"], 70), (vec!["-shm"], 80)]
    {
        gone.iter().for_each(|part| std::fs::remove_file(beside(&file, part)).unwrap());
        live(&history, from..from + 5);
        writer.put_away();
        let (state_then, reason) = state(&history);
        assert_eq!(state_then, "memory", "{gone:?}");
        assert!(reason.starts_with(&format!("{}{}: it was deleted", file.display(), gone[0])), "{reason}");
        live(&history, from + 5..from + 10);
        writer.retry_at = Instant::now();
        writer.put_away();
        assert_eq!(state(&history), ("stored", String::new()), "{gone:?}");
        // What was in a file that was deleted is gone with it; what was beside it was not needed.
        let first = if from >= 60 { 60 } else { 50 };
        assert_eq!(told(&history).0, numbers(first..from + 10), "{gone:?}");
    }
    // The directory, with everything in it.
    std::fs::remove_dir_all(directory.path().join("kept")).unwrap();
    live(&history, 90..95);
    writer.put_away();
    assert_eq!(state(&history).0, "memory");
    writer.retry_at = Instant::now();
    writer.put_away();
    assert_eq!((state(&history).0, told(&history).0), ("stored", numbers(90..95)));
    assert_eq!(history.report().lost, 0);
    drop(writer);
    assert_eq!(in_file(&file), numbers(90..95));
}

#[test]
fn a_file_that_is_moved_away_takes_everything_until_then_with_it() {
    let directory = tempfile::tempdir().unwrap();
    let place = directory.path().join("kept");
    let file = place.join("history.sqlite");
    let (history, mut writer) = open(kept(Ok(file.clone()))).unwrap();
    live(&history, 0..50);
    writer.put_away();
    let away = directory.path().join("away");
    std::fs::rename(&place, &away).unwrap();
    live(&history, 50..60);
    writer.put_away();
    assert_eq!(state(&history).0, "memory");
    writer.retry_at = Instant::now();
    writer.put_away();
    assert_eq!((state(&history).0, told(&history).0), ("stored", numbers(50..60)));
    assert_eq!(in_file(&away.join("history.sqlite")), numbers(0..50), "the log was moved into it");
    // The file alone: its log stays behind, and must not be taken for that of the new one.
    std::fs::rename(&file, away.join("second.sqlite")).unwrap();
    live(&history, 60..70);
    writer.put_away();
    writer.retry_at = Instant::now();
    writer.put_away();
    assert_eq!((state(&history).0, told(&history).0), ("stored", numbers(60..70)));
    assert_eq!(in_file(&away.join("second.sqlite")), numbers(50..60));
    drop(writer);
    assert_eq!(in_file(&file), numbers(60..70));
}

#[test]
fn a_file_that_is_put_in_its_place_goes_on_only_if_no_number_would_be_used_twice() {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("history.sqlite");
    let other = directory.path().join("other.sqlite");
    let mut store = Store::open(&other).unwrap();
    store.write(&Batch { events: vec![event(500)], ..Batch::default() }).unwrap();
    store.close(Numbers::default()).unwrap();
    let (history, mut writer) = open(kept(Ok(file.clone()))).unwrap();
    live(&history, 0..50);
    writer.put_away();
    std::fs::rename(&other, &file).unwrap();
    live(&history, 50..60);
    writer.put_away();
    let (then, reason) = state(&history);
    assert!(then == "memory" && reason.contains("it was replaced by another file"), "{reason}");
    writer.retry_at = Instant::now();
    writer.put_away();
    let (then, reason) = state(&history);
    assert!(then == "memory" && reason.contains("has events of another run"), "{reason}");
    assert_eq!(told(&history).0, numbers(50..60));
    // An own backup.
    std::fs::remove_file(&file).unwrap();
    let mut store = Store::open(&file).unwrap();
    store.write(&Batch { events: numbers(1..30).into_iter().map(event).collect(), ..Batch::default() }).unwrap();
    store.close(Numbers::default()).unwrap();
    writer.retry_at = Instant::now();
    writer.put_away();
    let all: Vec<u64> = (1..30).chain(50..60).collect();
    assert_eq!((state(&history).0, told(&history).0), ("stored", all));
}

#[test]
fn while_no_file_can_be_made_memory_keeps_what_comes_and_the_last_write_tries_once_more() {
    let directory = tempfile::tempdir().unwrap();
    let place = directory.path().join("kept");
    let file = place.join("history.sqlite");
    let (history, mut writer) = open(kept(Ok(file.clone()))).unwrap();
    live(&history, 0..50);
    writer.put_away();
    std::fs::remove_dir_all(&place).unwrap();
    std::fs::write(&place, "a file, where the directory was").unwrap();
    for second in 50..60 {
        live(&history, second..second + 1);
        writer.retry_at = Instant::now();
        writer.put_away();
        let (then, reason) = state(&history);
        assert!(then == "memory" && reason.contains("history.sqlite"), "{reason}");
    }
    assert!(writer.backoff.next_delay() >= Duration::from_secs(10), "it is tried less and less often");
    std::fs::remove_file(&place).unwrap();
    live(&history, 60..61);
    history.end();
    assert!(!writer.put_away(), "the last");
    drop(writer);
    assert_eq!(in_file(&file), numbers(50..61));
}

#[test]
fn a_query_that_finds_damage_has_the_file_put_aside() {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("history.sqlite");
    let (history, mut writer) = open(kept(Ok(file.clone()))).unwrap();
    live(&history, 0..2000);
    writer.put_away();
    writer.store.as_ref().unwrap().connection.query_row("PRAGMA wal_checkpoint(TRUNCATE)", (), |_| Ok(())).unwrap();
    lock(&history.shared.reading).close_readers();
    let mut bytes = std::fs::read(&file).unwrap();
    bytes.fill(0x5a);
    std::fs::write(&file, &bytes).unwrap();
    // As if the file's times did not show it.
    writer.store.as_mut().unwrap().remember();
    let (query, until) = (EventQuery { limit: 5, ..EventQuery::default() }, Default::default());
    std::thread::scope(|scope| {
        let asking = scope.spawn(|| history.events(&query, &until));
        while !asking.is_finished() {
            writer.put_away();
        }
        asking.join().unwrap().unwrap_err();
    });
    live(&history, 2000..2010);
    writer.put_away();
    writer.retry_at = Instant::now();
    writer.put_away();
    assert_eq!((state(&history).0, told(&history).0), ("stored", numbers(2000..2010)));
}

#[test]
fn what_another_program_writes_over_the_file_is_noticed_without_a_query() {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("history.sqlite");
    let (history, mut writer) = open(kept(Ok(file.clone()))).unwrap();
    live(&history, 0..2000);
    writer.put_away();
    writer.store.as_ref().unwrap().connection.query_row("PRAGMA wal_checkpoint(TRUNCATE)", (), |_| Ok(())).unwrap();
    writer.put_away();
    assert!(writer.check_at > Instant::now() && !writer.touched, "the checkpoint was looked at, and was well");
    writer.check_at = Instant::now();
    writer.put_away();
    assert_eq!(state(&history).0, "stored");
    // The same file, cut off.
    File::options().write(true).open(&file).unwrap().set_len(8192).unwrap();
    live(&history, 2000..2010);
    writer.put_away();
    let (then, reason) = state(&history);
    assert!(then == "memory" && reason.contains("page"), "{reason}");
    writer.retry_at = Instant::now();
    writer.put_away();
    assert_eq!((state(&history).0, told(&history).0), ("stored", numbers(2000..2010)));
}

/// A month of events, one in three quarters of an hour, until the clocks' time.
fn month(clocks: &Manual, file: &Path) -> (History, Writer, Vec<u64>) {
    let limits = Retention { age: SignedDuration::from_hours(24 * 31), bytes: 50_000_000 };
    let kept = Kept { file: Ok(file.to_owned()), limits };
    let (history, writer) = History::open_with(kept, Box::new(clocks.clone())).unwrap();
    let first = clocks.wall() - SignedDuration::from_secs(1000 * 2600);
    for number in 1..=1000 {
        let time = first + SignedDuration::from_secs(number * 2600);
        let events = [doorcam_core::tracking::Event { time, ..event(number as u64) }];
        let people = Some((number as usize % 2, [].as_slice()));
        history.take(&Observation { time, people, events: &events, track: None });
    }
    (history, writer, numbers(1..1001))
}

const NOW: u64 = 1_800_000_000;

#[test]
fn a_clock_that_leaps_erases_nothing_and_one_that_stays_does() {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("history.sqlite");
    let clocks = Manual::at(at(NOW));
    let (history, mut writer, all) = month(&clocks, &file);
    // Whatever is old is deleted in a few writes.
    let mut settle = || assert!((0..20).all(|_| writer.put_away()));
    settle();
    assert_eq!(told(&history).0, all);
    for leap in [at(NOW + 32 * 86_400), at(NOW + 3000 * 86_400), at(0), at(NOW)] {
        clocks.set(leap);
        for _ in 0..5 {
            clocks.pass(Duration::from_secs(1));
            let time = clocks.wall();
            history.take(&Observation { time, people: Some((1, [].as_slice())), events: &[], track: None });
            settle();
        }
        assert_eq!(told(&history).0, all, "{leap}");
    }
    // The same clock, for longer than anybody would let it be wrong.
    clocks.set(at(NOW + 20 * 86_400));
    settle();
    clocks.pass(PERSISTS + Duration::from_secs(60));
    settle();
    history.take(&Observation { time: clocks.wall(), people: Some((1, [].as_slice())), events: &[], track: None });
    settle();
    let left = told(&history).0;
    assert!(left.len() < 400 && left.last() == Some(&1000), "{} left", left.len());
}

#[test]
fn a_start_with_a_wrong_clock_erases_nothing_and_neither_does_the_next() {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("history.sqlite");
    let clocks = Manual::at(at(NOW));
    let (history, mut writer, all) = month(&clocks, &file);
    history.end();
    writer.run();
    drop((history, writer));
    for wrong in [at(0), at(4_070_908_800), at(4_070_908_900), at(NOW + 40 * 86_400), at(NOW + 60)] {
        let clocks = Manual::at(wrong);
        let limits = Retention { age: SignedDuration::from_hours(24 * 31), bytes: 50_000_000 };
        let (history, mut writer) =
            History::open_with(Kept { file: Ok(file.clone()), limits }, Box::new(clocks.clone())).unwrap();
        for _ in 0..20 {
            clocks.pass(Duration::from_secs(1));
            let time = clocks.wall();
            history.take(&Observation { time, people: Some((1, [].as_slice())), events: &[], track: None });
            writer.put_away();
        }
        assert_eq!(told(&history).0, all, "{wrong}");
        history.end();
        writer.run();
    }
}
