use super::*;
use doorcam_core::tracking::EventKind;

pub(in super::super) fn event(sequence: u64) -> Event {
    let time = Timestamp::from_millisecond(1000 * sequence as i64).unwrap();
    let zone = sequence.is_multiple_of(3).then(|| String::from("bed"));
    let kind = if sequence.is_multiple_of(2) { EventKind::Enter } else { EventKind::Exit };
    Event {
        sequence,
        kind,
        time,
        track: sequence / 2,
        x_m: 0.5,
        y_m: 1.25,
        zone,
        through: None,
        reason: None,
        speed_m_s: None,
    }
}

fn count(store: &Store, table: &str) -> usize {
    store.connection.query_row(&format!("SELECT count(*) FROM {table}"), (), |row| row.get(0)).unwrap()
}

#[test]
fn numbers_go_on_after_an_end_and_leap_after_a_crash() {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("deep/history.sqlite");
    let next = Numbers { event: 3, track: 2, span: 9 };
    let batch = Batch { events: (0..3).map(event).collect(), spans: Vec::new(), next };
    let mut store = Store::open(&file).unwrap();
    assert_eq!(store.next(), Numbers::default());
    store.write(&batch).unwrap();
    store.close(next).unwrap();
    assert!(!beside(&file, "-wal").exists(), "everything is in one file");
    let mut store = Store::open(&file).unwrap();
    assert_eq!((store.next(), count(&store, "events")), (next, 3));
    store.write(&batch).unwrap();
    assert_eq!(count(&store, "events"), 3, "events that exist stay as they are");
    drop(store);
    let store = Store::open(&file).unwrap();
    assert_eq!(store.next(), Numbers { event: 1003, track: 1002, span: 1009 });
}

#[test]
fn what_somebody_left_through_and_how_fast_they_crossed_is_kept() {
    let mut events = vec![
        Event { kind: EventKind::CrossOut, speed_m_s: Some(1.25), ..event(0) },
        Event { kind: EventKind::Exit, through: Some(Through::Door), reason: Some(ExitReason::Door), ..event(1) },
        event(2),
    ];
    events.extend((3..).zip(ExitReason::ALL).map(|(k, reason)| Event { reason: Some(reason), ..event(k) }));
    let mut store = Store::in_memory().unwrap();
    store.write(&Batch { events: events.clone(), ..Batch::default() }).unwrap();
    assert_eq!(store.everything(Numbers::default()).unwrap().events, events);
}

#[test]
fn two_do_not_keep_the_same_file() {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("history.sqlite");
    let first = Store::open(&file).unwrap();
    let second = Store::open(&file).unwrap_err().to_string();
    assert_eq!(second, format!("{}: another doorcam keeps its history there", file.display()));
    drop(first);
    Store::open(&file).unwrap();
}

#[test]
fn a_broken_file_is_put_aside_and_a_newer_one_left_alone() {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("history.sqlite");
    let next = Numbers::default();
    let mut store = Store::open(&file).unwrap();
    store.write(&Batch { events: (0..500).map(event).collect(), spans: Vec::new(), next }).unwrap();
    store.close(next).unwrap();
    // Overwrite pages in the middle.
    let mut bytes = fs::read(&file).unwrap();
    bytes[8192..16384].fill(0x5a);
    for bad in
        [bytes.as_slice(), b"not a database, whatever its name says, but long enough to be looked at as one".as_slice()]
    {
        fs::write(&file, bad).unwrap();
        assert!(matches!(Store::open(&file), Err(StoreError::Broken { .. })));
        let (mut store, aside) = Store::open_or_replace(&file).unwrap();
        let kept = fs::read(aside.unwrap()).unwrap();
        let differs = kept.iter().zip(bad).position(|(kept, bad)| kept != bad);
        assert_eq!((kept.len(), differs), (bad.len(), None));
        store.write(&Batch { events: vec![event(1)], spans: Vec::new(), next }).unwrap();
        assert_eq!(count(&store, "events"), 1);
    }
    let store = Store::open(&file).unwrap();
    store.connection.pragma_update(None, "user_version", 99).unwrap();
    drop(store);
    let error = Store::open_or_replace(&file).unwrap_err().to_string();
    assert_eq!(error, format!("{}: made by a newer doorcam", file.display()));
}

#[test]
fn what_is_no_file_is_refused_at_once() {
    let directory = tempfile::tempdir().unwrap();
    let pipe = directory.path().join("pipe");
    assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    for path in [directory.path(), &pipe, Path::new("/dev/null")] {
        let error = Store::open(path).unwrap_err().to_string();
        assert_eq!(error, format!("{}: not a regular file", path.display()));
    }
    // Nor does a pipe in place of the lock make it wait.
    let file = directory.path().join("history.sqlite");
    assert!(std::process::Command::new("mkfifo").arg(beside(&file, "-lock")).status().unwrap().success());
    Store::open(&file).unwrap();
}

#[test]
fn two_broken_files_of_one_second_are_both_kept() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a");
    assert_eq!(free_name(&path), path);
    for name in ["a-2", "a-3"] {
        fs::write(free_name(&path), "").unwrap();
        assert_eq!(free_name(&path), directory.path().join(name));
    }
}
