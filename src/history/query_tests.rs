use super::super::Numbers;
use super::super::store::tests::event;
use super::super::store::{Batch, Store};
use super::*;
use jiff::SignedDuration;

fn at(seconds: i64) -> Timestamp {
    Timestamp::from_second(seconds).unwrap()
}

fn store(events: std::ops::Range<u64>, spans: &[(u64, Option<&str>, usize, i64, i64)]) -> Store {
    let mut store = Store::in_memory().unwrap();
    let span = |&(id, zone, people, from, to): &(u64, Option<&str>, usize, i64, i64)| Span {
        id,
        zone: zone.map(String::from),
        people,
        from: at(from),
        to: at(to),
    };
    let spans = spans.iter().map(span).collect();
    store.write(&Batch { events: events.map(event).collect(), spans, next: Numbers::default() }).unwrap();
    store
}

fn numbers(tables: &Tables<'_>, query: EventQuery) -> (Vec<u64>, Option<u64>) {
    let page = tables.events(&query).unwrap();
    (page.events.iter().map(|event| event.sequence).collect(), page.next)
}

#[test]
fn events_come_in_pages_of_what_was_asked_for() {
    let store = store(0..100, &[]);
    let tables = Tables { file: Some(&store.connection), memory: None };
    let any = EventQuery { limit: 3, ..EventQuery::default() };
    assert_eq!(tables.events(&EventQuery { after: Some(6), limit: 1, ..any.clone() }).unwrap().events, [event(7)]);
    assert_eq!(numbers(&tables, any.clone()), (vec![97, 98, 99], None), "the newest");
    let (events, next) = numbers(&tables, EventQuery { after: Some(9), ..any.clone() });
    assert_eq!((events, next), (vec![10, 11, 12], Some(12)));
    assert_eq!(numbers(&tables, EventQuery { after: Some(96), ..any.clone() }), (vec![97, 98, 99], None));
    assert_eq!(numbers(&tables, EventQuery { after: Some(u64::MAX), ..any.clone() }), (vec![], None));
    // One event a second.
    let range = EventQuery { from: Some(at(20)), to: Some(at(22)), ..any.clone() };
    assert_eq!(numbers(&tables, range), (vec![20, 21], None));
    assert_eq!(numbers(&tables, EventQuery { to: Some(at(22)), ..any.clone() }), (vec![19, 20, 21], None));
    let exits = EventQuery { after: Some(20), kinds: vec![EventKind::Exit, EventKind::Dwell], ..any.clone() };
    assert_eq!(numbers(&tables, exits), (vec![21, 23, 25], Some(25)));
    assert_eq!(numbers(&tables, EventQuery { track: Some(30), ..any.clone() }), (vec![60, 61], None));
    let bed = EventQuery { zone: Some("bed".into()), ..any };
    assert_eq!(numbers(&tables, bed), (vec![93, 96, 99], None));
}

#[test]
fn what_memory_keeps_follows_what_the_file_has() {
    let (file, memory) = (
        store(0..50, &[(0, Some("bed"), 0, 0, 8), (1, None, 1, 0, 5), (2, None, 2, 5, 8)]),
        store(45..60, &[(0, Some("bed"), 0, 0, 20), (2, None, 2, 5, 9), (3, None, 0, 9, 20)]),
    );
    let tables = Tables { file: Some(&file.connection), memory: Some(&memory.connection) };
    let any = EventQuery { limit: 100, ..EventQuery::default() };
    let all = (0..60).collect::<Vec<_>>();
    assert_eq!(numbers(&tables, any.clone()), (all.clone(), None));
    assert_eq!(numbers(&tables, EventQuery { from: Some(at(0)), ..any.clone() }), (all, None));
    assert_eq!(numbers(&tables, EventQuery { after: Some(42), limit: 5, ..any.clone() }).0, [43, 44, 45, 46, 47]);
    assert_eq!(numbers(&tables, EventQuery { limit: 17, ..any.clone() }).0, (43..60).collect::<Vec<_>>());
    let page = tables.events(&any).unwrap();
    assert_eq!((page.oldest, page.newest), (Some(0), Some(59)));
    let spans = tables.spans(&SpanQuery { after: None, from: at(0), to: at(99), zone: None, limit: 2 }).unwrap();
    assert_eq!((spans.spans.len(), spans.spans[1].to, spans.next), (2, at(9), Some(2)));
    for zone in [None, Some("bed".to_owned())] {
        let query = IntervalQuery { from: at(0), to: at(30), step: SignedDuration::from_secs(30), zone, limit: 1 };
        assert_eq!(tables.intervals(&query).unwrap().intervals[0].watched_s, 20.0, "no span counts twice");
    }
    // Without any tables.
    let none = Tables { file: None, memory: None };
    assert_eq!(none.events(&any).unwrap(), EventPage { events: vec![], oldest: None, newest: None, next: None });
}

#[test]
fn intervals_add_up_to_what_the_spans_say() {
    // Nobody, one, two; a gap; one. The bed counts by itself.
    let spans = [
        (1, None, 0, 0, 30),
        (2, None, 1, 30, 50),
        (3, Some("bed"), 1, 30, 31),
        (4, None, 2, 50, 70),
        (5, None, 1, 200, 240),
    ];
    let store = store(0..0, &spans);
    let tables = Tables { file: Some(&store.connection), memory: None };
    let minute = SignedDuration::from_secs(60);
    let query = IntervalQuery { from: at(0), to: at(250), step: minute, zone: None, limit: 100 };
    let page = tables.intervals(&query).unwrap();
    let told: Vec<_> = page.intervals.iter().map(|i| (i.most, i.mean, i.occupied_s, i.watched_s)).collect();
    let expected = [
        (Some(2), Some(40.0 / 60.0), 30.0, 60.0),
        (Some(2), Some(2.0), 10.0, 10.0),
        (None, None, 0.0, 0.0),
        (Some(1), Some(1.0), 40.0, 40.0),
        (None, None, 0.0, 0.0),
    ];
    assert_eq!(told, expected);
    assert_eq!((page.intervals[4].to, page.next), (at(250), None));
    let page = tables.intervals(&IntervalQuery { limit: 2, ..query.clone() }).unwrap();
    assert_eq!((page.intervals.len(), page.next), (2, Some(at(120))));
    let bed = tables.intervals(&IntervalQuery { zone: Some("bed".into()), ..query }).unwrap();
    assert_eq!((bed.intervals[0].occupied_s, bed.intervals[0].watched_s), (1.0, 1.0));
}

#[test]
fn a_page_is_cut_where_it_ends() {
    let spans: Vec<_> = (0..20).map(|k| (k, None, 1, k as i64, k as i64 + 1)).collect();
    let store = store(0..100, &spans);
    let tables = Tables { file: Some(&store.connection), memory: None };
    let any = EventQuery { limit: 10, ..EventQuery::default() };
    for query in [
        any.clone(),
        EventQuery { after: Some(6), ..any.clone() },
        EventQuery { after: Some(95), ..any.clone() },
        EventQuery { from: Some(at(0)), ..any.clone() },
        EventQuery { from: Some(at(1000)), ..any.clone() },
        EventQuery { zone: Some("bed".into()), ..any.clone() },
        EventQuery { zone: Some("bed".into()), after: Some(3), ..any.clone() },
        EventQuery { kinds: vec![EventKind::Exit], from: Some(at(5)), ..any.clone() },
        EventQuery { track: Some(7), ..any },
    ] {
        let page = tables.events(&query).unwrap();
        let ends = page.events.first().zip(page.events.last()).map(|(first, last)| [first.sequence, last.sequence]);
        assert_eq!(tables.events_cut(&query).unwrap(), Cut { ends, next: page.next }, "{query:?}");
    }
    for (after, limit) in [(None, 5), (Some(3), 5), (Some(16), 5), (Some(50), 5)] {
        let query = SpanQuery { after, from: at(0), to: at(99), zone: None, limit };
        let page = tables.spans(&query).unwrap();
        let ends = page.spans.first().zip(page.spans.last()).map(|(first, last)| [first.id, last.id]);
        assert_eq!(tables.spans_cut(&query).unwrap(), Cut { ends, next: page.next }, "{query:?}");
    }
    for limit in 1..8 {
        let query = IntervalQuery { from: at(0), to: at(30), step: SignedDuration::from_secs(5), zone: None, limit };
        assert_eq!(query.next(), tables.intervals(&query).unwrap().next, "{limit}");
    }
}

#[test]
fn every_statement_searches_an_index_that_has_the_order() {
    let store = store(0..10, &[(1, None, 1, 0, 5)]);
    let explain = |sql: &str| -> Vec<String> {
        let mut explain = store.connection.prepare(&format!("EXPLAIN QUERY PLAN {sql}")).unwrap();
        // Without values for the parameters, which make no difference.
        explain.raw_query().mapped(|row| row.get(3)).collect::<Result<_, _>>().unwrap()
    };
    let mut statements =
        vec![(spans_statement("id, people, from_ns, to_ns"), "occupancy_zone (zone=? AND rowid>? AND rowid<?)")];
    for (by, index) in [
        (By::Number, "INTEGER PRIMARY KEY (rowid>? AND rowid<?)"),
        (By::Kind, "events_kind (kind=? AND rowid>? AND rowid<?)"),
        (By::Zone, "events_zone (zone=? AND kind=? AND rowid>? AND rowid<?)"),
        (By::Track, "events_track (track=? AND rowid>? AND rowid<?)"),
        (By::TrackAndZone, "events_track (track=? AND rowid>? AND rowid<?)"),
    ] {
        for forwards in [true, false] {
            statements.push((events_statement(by, "sequence", forwards), index));
        }
    }
    for (statement, index) in statements {
        let plan = explain(&statement);
        assert!(plan.len() == 1 && plan[0].starts_with("SEARCH") && plan[0].ends_with(index), "{statement}: {plan:?}");
    }
}

/// Steps of SQLite's virtual machine: what a query costs on any machine.
fn steps(tables: &Tables<'_>, ask: impl Fn(&Tables<'_>)) -> usize {
    use std::sync::Arc;
    use std::sync::atomic::{AtomicUsize, Ordering};

    let count = Arc::new(AtomicUsize::new(0));
    let counted = Arc::clone(&count);
    let connection = tables.file.unwrap();
    let count_on = move || {
        counted.fetch_add(1, Ordering::Relaxed);
        false
    };
    connection.progress_handler(100, Some(count_on)).unwrap();
    ask(tables);
    connection.progress_handler(0, None::<fn() -> bool>).unwrap();
    100 * count.load(Ordering::Relaxed)
}

#[test]
fn a_page_costs_as_much_as_it_has_rows_however_many_there_are() {
    let rare = |sequence: u64| sequence < 20;
    let mut store = Store::in_memory().unwrap();
    let one = |sequence: u64| Event {
        kind: if rare(sequence) { EventKind::Dwell } else { EventKind::Enter },
        zone: Some(if rare(sequence) { "hall" } else { "bed" }.into()),
        track: sequence / 10,
        ..event(sequence)
    };
    let span = |id: u64| Span {
        id,
        zone: rare(id).then(|| "hall".into()),
        people: 1,
        from: at(id as i64),
        to: at(id as i64 + 1),
    };
    const ROWS: u64 = 100_000;
    let batch =
        Batch { events: (0..ROWS).map(one).collect(), spans: (0..ROWS).map(span).collect(), next: Numbers::default() };
    store.write(&batch).unwrap();
    let tables = Tables { file: Some(&store.connection), memory: None };
    let any = EventQuery { limit: 10, ..EventQuery::default() };
    let [early, middle, late] = [at(10), at(50_000), at(99_995)];
    let zone = |name: &str| EventQuery { zone: Some(name.into()), ..any.clone() };
    for query in [
        any.clone(),
        zone("hall"),
        zone("bed"),
        zone("nowhere"),
        EventQuery { from: Some(middle), ..zone("bed") },
        EventQuery { to: Some(middle), ..zone("bed") },
        EventQuery { from: Some(middle), to: Some(at(50_001)), ..zone("bed") },
        EventQuery { from: Some(late), ..zone("hall") },
        EventQuery { kinds: vec![EventKind::Dwell], ..any.clone() },
        EventQuery { kinds: vec![EventKind::Dwell, EventKind::Exit], ..any.clone() },
        EventQuery { kinds: vec![EventKind::Exit], ..zone("bed") },
        EventQuery { kinds: vec![EventKind::Enter], to: Some(early), ..any.clone() },
        EventQuery { track: Some(5), ..any.clone() },
        EventQuery { track: Some(5), ..zone("nowhere") },
        EventQuery { track: Some(1 << 40), ..any.clone() },
        EventQuery { from: Some(middle), ..any.clone() },
        EventQuery { to: Some(middle), ..any.clone() },
        EventQuery { to: Some(early), ..any.clone() },
        EventQuery { from: Some(late), ..any.clone() },
        EventQuery { after: Some(3), to: Some(late), ..any.clone() },
        EventQuery { from: Some(late), to: Some(early), ..any.clone() },
        EventQuery { from: Some(Timestamp::MIN), to: Some(Timestamp::MAX), ..any.clone() },
        EventQuery { from: Some(Timestamp::MAX), ..any },
    ] {
        let steps = steps(&tables, |tables| drop(tables.events(&query).unwrap()));
        assert!(steps < 15_000, "{steps} steps for {query:?}");
    }
    for (zone, from, to) in
        [(None, 50_000, 50_010), (None, 99_990, 200_000), (Some("hall"), 0, 200_000), (Some("x"), 0, 9)]
    {
        let zone = zone.map(String::from);
        let query = SpanQuery { after: None, from: at(from), to: at(to), zone: zone.clone(), limit: 10 };
        let whole =
            IntervalQuery { from: at(from), to: at(to), step: SignedDuration::from_secs(3600), zone, limit: 10 };
        let steps = [
            steps(&tables, |tables| drop(tables.spans(&query).unwrap())),
            steps(&tables, |tables| drop(tables.intervals(&whole).unwrap())),
        ];
        assert!(steps.iter().all(|&steps| steps < 15_000), "{steps:?} steps for {query:?}");
    }
}

#[test]
fn what_a_wrong_clock_stamped_is_found_by_its_time_and_comes_in_the_order_of_its_numbers() {
    let mut store = Store::in_memory().unwrap();
    // Two hours back, and then a month ahead for a while.
    let time = |k: u64| match k {
        1000..1100 => at(k as i64 - 7200),
        2000..2010 => at(k as i64 + 2_764_800),
        _ => at(k as i64),
    };
    let events: Vec<Event> = (0..5000).map(|k| Event { time: time(k), ..event(k) }).collect();
    store.write(&Batch { events: events.clone(), ..Batch::default() }).unwrap();
    let tables = Tables { file: Some(&store.connection), memory: None };
    for (from, to) in [(-7000, 10), (990, 1110), (1990, 2020), (2_000_000, 9_000_000), (-9000, 9_000_000), (5, 6)] {
        let query = EventQuery { from: Some(at(from)), to: Some(at(to)), limit: 10_000, ..EventQuery::default() };
        let all = (0..5000).filter(|&k| time(k) >= at(from) && time(k) < at(to)).collect::<Vec<_>>();
        assert_eq!(numbers(&tables, query), (all, None), "{from} to {to}");
    }
}
