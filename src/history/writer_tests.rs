use jiff::SignedDuration;

use super::super::store::tests::event;
use super::*;

const LIMITS: Retention = Retention { age: SignedDuration::MAX, bytes: 50_000_000 };

fn kept(file: Result<PathBuf, String>) -> Kept {
    Kept { file, limits: LIMITS }
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
    let (history, mut writer) = History::open(kept(Ok(file.clone()))).unwrap();
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
    let (history, _writer) = History::open(kept(Ok(file))).unwrap();
    assert_eq!(told(&history), all(2200), "what was in memory is in the file now");
    assert!(history.numbers().event >= 2200);
}

#[test]
fn a_place_that_cannot_be_written_is_no_error_and_its_numbers_do_not_repeat() {
    let directory = tempfile::tempdir().unwrap();
    let place = directory.path().join("place");
    std::fs::write(&place, "a file, where a directory should be").unwrap();
    let file = place.join("history.sqlite");
    let (history, mut writer) = History::open(kept(Ok(file.clone()))).unwrap();
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
    let (history, mut writer) = History::open(kept(Ok(file.clone()))).unwrap();
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
    let (history, mut writer) = History::open(kept(Err("none".into()))).unwrap();
    live(&history, 0..MOST_PENDING as u64 + 50);
    assert_eq!(lock(&history.shared.pending).batch.events.len(), MOST_PENDING);
    writer.put_away();
    assert!(history.report().lost >= 50);
    assert_eq!(history.numbers(), Numbers::default());
}
