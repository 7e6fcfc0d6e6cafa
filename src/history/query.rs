use std::collections::{BTreeMap, HashSet, VecDeque};

use jiff::{SignedDuration, Timestamp};
use rusqlite::types::Value;
use rusqlite::{Connection, Row, named_params};
use serde::Serialize;
use utoipa::ToSchema;

use super::Span;
use super::spans::LONGEST;
use super::store::{integer, nanoseconds};
use doorcam_core::tracking::{Event, EventKind};

/// Selects events.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct EventQuery {
    /// Only events with larger numbers than this.
    pub after: Option<u64>,
    /// Only events at or after this time.
    pub from: Option<Timestamp>,
    /// Only events before this time.
    pub to: Option<Timestamp>,
    /// Only events of these kinds; empty for all kinds.
    pub kinds: Vec<EventKind>,
    /// Only events of this track.
    pub track: Option<u64>,
    /// Only events of this zone.
    pub zone: Option<String>,
    /// At most this many.
    pub limit: usize,
}

/// Some of the kept events.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct EventPage {
    /// The events that match, in the order of their numbers.
    pub events: Vec<Event>,
    /// Number of the oldest event that is kept; null if none is kept.
    #[schema(required)]
    pub oldest: Option<u64>,
    /// Number of the newest event; null if none is kept.
    #[schema(required)]
    pub newest: Option<u64>,
    /// `after` of the next page; null if there are no more events.
    #[schema(required)]
    pub next: Option<u64>,
}

/// Selects spans.
#[derive(Debug, Clone, PartialEq)]
pub struct SpanQuery {
    /// Only spans with larger numbers than this.
    pub after: Option<u64>,
    /// Only spans that end after this time.
    pub from: Timestamp,
    /// Only spans that begin before this time.
    pub to: Timestamp,
    /// Only spans of this zone; `None` for those of the whole room.
    pub zone: Option<String>,
    /// At most this many.
    pub limit: usize,
}

/// Some of the kept spans.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct SpanPage {
    /// The spans that match, in the order in which they began.
    pub spans: Vec<Span>,
    /// `after` of the next page; null if there are no more spans.
    #[schema(required)]
    pub next: Option<u64>,
}

/// The intervals over which occupancy is summed up.
#[derive(Debug, Clone, PartialEq)]
pub struct IntervalQuery {
    /// Where the first interval begins.
    pub from: Timestamp,
    /// Where the last interval ends.
    pub to: Timestamp,
    /// Length of each interval; the last may be shorter.
    pub step: SignedDuration,
    /// The zone; `None` for the whole room.
    pub zone: Option<String>,
    /// At most this many intervals.
    pub limit: usize,
}

/// Occupancy over an interval.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct Interval {
    /// Where it begins, RFC 3339.
    pub from: Timestamp,
    /// Where it ends.
    pub to: Timestamp,
    /// Most people at once; null if none of it was watched.
    #[schema(required)]
    pub most: Option<usize>,
    /// Mean number of people over the time that was watched; null if none of it was.
    #[schema(required)]
    pub mean: Option<f64>,
    /// Seconds with somebody there.
    pub occupied_s: f64,
    /// Seconds that were watched.
    pub watched_s: f64,
}

/// Some intervals.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct IntervalPage {
    /// The intervals, in their order.
    pub intervals: Vec<Interval>,
    /// `from` of the next page; null if there are no more intervals.
    #[schema(required)]
    pub next: Option<Timestamp>,
}

/// The tables to search, in the file and in memory. What is in both is taken from memory.
pub(super) struct Tables<'a> {
    pub(super) file: Option<&'a Connection>,
    pub(super) memory: Option<&'a Connection>,
}

impl Tables<'_> {
    /// The connections, file first, each with a bound: only events with smaller numbers are taken from it.
    fn of_events(&self) -> rusqlite::Result<Vec<(&Connection, i64)>> {
        let mut below = i64::MAX;
        let mut each = Vec::new();
        if let Some(memory) = self.memory {
            each.push((memory, i64::MAX));
            let first = memory.query_row("SELECT min(sequence) FROM events", (), |row| row.get::<_, Option<i64>>(0))?;
            below = first.unwrap_or(i64::MAX);
        }
        each.extend(self.file.map(|file| (file, below)));
        each.reverse();
        Ok(each)
    }

    /// The events that match: with `after` or `from` the first of them, otherwise the newest.
    pub(super) fn events(&self, query: &EventQuery) -> rusqlite::Result<EventPage> {
        let forwards = query.after.is_some() || query.from.is_some();
        let tables = self.of_events()?;
        // One more than the limit shows whether there is another page.
        let most = if forwards { query.limit + 1 } else { query.limit };
        let mut events = VecDeque::new();
        let mut ends: (Option<u64>, Option<u64>) = (None, None);
        for (connection, below) in &tables {
            let sql = "SELECT min(sequence), max(sequence) FROM events WHERE sequence < ?1";
            let (first, last): (Option<u64>, Option<u64>) =
                connection.query_row(sql, [below], |row| Ok((row.get(0)?, row.get(1)?)))?;
            ends = (ends.0.or(first), last.or(ends.1));
        }
        if forwards {
            for (connection, below) in tables {
                events.extend(select_events(connection, query, below, "ASC", most - events.len())?);
            }
        } else {
            for (connection, below) in tables.into_iter().rev() {
                for event in select_events(connection, query, below, "DESC", most - events.len())? {
                    events.push_front(event);
                }
            }
        }
        let more = events.len() > query.limit;
        events.truncate(query.limit);
        let next = events.back().map(|event| event.sequence).filter(|_| more);
        Ok(EventPage { events: events.into(), oldest: ends.0, newest: ends.1, next })
    }

    /// The first spans that match.
    pub(super) fn spans(&self, query: &SpanQuery) -> rusqlite::Result<SpanPage> {
        let SpanQuery { after, from, to, zone, limit } = query;
        // A span that was open when the file became unwritable is in both; the one in memory is longer, and overwrites.
        let mut known = BTreeMap::new();
        for connection in self.file.into_iter().chain(self.memory) {
            each_span(connection, (*from, *to), zone.as_deref(), *after, limit + 1, |span| {
                known.insert(span.id, span);
            })?;
        }
        let mut spans: Vec<Span> = known.into_values().take(limit + 1).collect();
        let more = spans.len() > *limit;
        spans.truncate(*limit);
        let next = spans.last().map(|span| span.id).filter(|_| more);
        Ok(SpanPage { spans, next })
    }

    /// Occupancy, summed up over each interval.
    pub(super) fn intervals(&self, query: &IntervalQuery) -> rusqlite::Result<IntervalPage> {
        let IntervalQuery { from, to, step, zone, limit } = query;
        let mut intervals = Vec::new();
        let mut begin = *from;
        while begin < *to && intervals.len() < *limit {
            let end = begin.checked_add(*step).unwrap_or(Timestamp::MAX).min(*to);
            intervals.push(Interval { from: begin, to: end, most: None, mean: None, occupied_s: 0.0, watched_s: 0.0 });
            begin = end;
        }
        let mut people_s = vec![0.0; intervals.len()];
        let mut counted = HashSet::new();
        // Memory first, because of a span that is in both it has the longer version. It never holds many spans.
        for (connection, in_memory) in self.memory.map(|m| (m, true)).into_iter().chain(self.file.map(|f| (f, false))) {
            each_span(connection, (*from, begin), zone.as_deref(), None, usize::MAX, |span| {
                if in_memory {
                    counted.insert(span.id);
                } else if counted.contains(&span.id) {
                    return;
                }
                let first = intervals.partition_point(|interval| interval.to <= span.from);
                for (interval, people_s) in intervals[first..].iter_mut().zip(&mut people_s[first..]) {
                    let overlap = span.to.min(interval.to).duration_since(span.from.max(interval.from)).as_secs_f64();
                    if overlap <= 0.0 {
                        break;
                    }
                    interval.watched_s += overlap;
                    interval.occupied_s += if span.people > 0 { overlap } else { 0.0 };
                    interval.most = interval.most.max(Some(span.people));
                    *people_s += overlap * span.people as f64;
                }
            })?;
        }
        for (interval, people_s) in intervals.iter_mut().zip(people_s) {
            interval.mean = (interval.watched_s > 0.0).then(|| people_s / interval.watched_s);
        }
        Ok(IntervalPage { intervals, next: (begin < *to).then_some(begin) })
    }
}

fn select_events(
    connection: &Connection,
    query: &EventQuery,
    below: i64,
    order: &str,
    limit: usize,
) -> rusqlite::Result<Vec<Event>> {
    let EventQuery { after, from, to, kinds, track, zone, .. } = query;
    let mut select = connection.prepare_cached(&format!(
        "SELECT sequence, kind, time_ns, track, x_m, y_m, zone FROM events
         WHERE sequence > :after AND sequence < :below AND time_ns >= :from AND time_ns < :to
           AND (:kinds = '' OR instr(:kinds, ',' || kind || ',') > 0)
           AND (:track IS NULL OR track = :track) AND (:zone IS NULL OR zone = :zone)
         ORDER BY sequence {order} LIMIT :limit"
    ))?;
    // ",enter,exit,"
    let kinds: String = kinds.iter().map(|kind| format!(",{},", kind.name())).collect();
    let parameters = named_params! {
        ":after": after.map_or(-1, integer),
        ":below": below,
        ":from": from.map_or(i64::MIN, nanoseconds),
        ":to": to.map_or(i64::MAX, nanoseconds),
        ":kinds": kinds,
        ":track": track.map(integer),
        ":zone": zone,
        ":limit": integer(limit as u64),
    };
    let events = select.query_map(parameters, read_event)?;
    events.collect()
}

pub(super) fn read_event(row: &Row<'_>) -> rusqlite::Result<Event> {
    let kind: String = row.get(1)?;
    let kind = EventKind::ALL.into_iter().find(|k| k.name() == kind);
    let wrong = || rusqlite::Error::InvalidColumnType(1, "kind".into(), rusqlite::types::Type::Text);
    Ok(Event {
        sequence: row.get(0)?,
        kind: kind.ok_or_else(wrong)?,
        time: time(row, 2)?,
        track: row.get(3)?,
        x_m: row.get::<_, Option<f64>>(4)?.unwrap_or(f64::NAN),
        y_m: row.get::<_, Option<f64>>(5)?.unwrap_or(f64::NAN),
        zone: row.get(6)?,
    })
}

/// Calls `each` for the spans that overlap a time, in the order of their numbers, beginning after the number `after`.
fn each_span(
    connection: &Connection,
    (from, to): (Timestamp, Timestamp),
    zone: Option<&str>,
    after: Option<u64>,
    limit: usize,
    mut each: impl FnMut(Span),
) -> rusqlite::Result<()> {
    let mut select = connection.prepare_cached(
        "SELECT id, zone, people, from_ns, to_ns FROM occupancy
         WHERE id > :after AND from_ns > :earliest AND from_ns < :to AND to_ns > :from AND zone IS :zone
         ORDER BY id LIMIT :limit",
    )?;
    // A span may be a few seconds longer than LONGEST.
    let earliest = from.checked_sub(LONGEST * 2).unwrap_or(Timestamp::MIN);
    let parameters = named_params! {
        ":after": after.map_or(-1, integer),
        ":earliest": nanoseconds(earliest),
        ":from": nanoseconds(from),
        ":to": nanoseconds(to),
        ":zone": zone.map_or(Value::Null, |zone| Value::Text(zone.into())),
        ":limit": integer(limit as u64),
    };
    let mut rows = select.query(parameters)?;
    while let Some(row) = rows.next()? {
        each(read_span(row)?);
    }
    Ok(())
}

pub(super) fn read_span(row: &Row<'_>) -> rusqlite::Result<Span> {
    let (id, zone, people) = (row.get(0)?, row.get(1)?, row.get(2)?);
    Ok(Span { id, zone, people, from: time(row, 3)?, to: time(row, 4)? })
}

fn time(row: &Row<'_>, column: usize) -> rusqlite::Result<Timestamp> {
    let nanoseconds: i64 = row.get(column)?;
    Timestamp::from_nanosecond(nanoseconds.into())
        .map_err(|e| rusqlite::Error::FromSqlConversionFailure(column, rusqlite::types::Type::Integer, e.into()))
}

#[cfg(test)]
mod tests {
    use super::super::Numbers;
    use super::super::store::tests::event;
    use super::super::store::{Batch, Store};
    use super::*;

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
}
