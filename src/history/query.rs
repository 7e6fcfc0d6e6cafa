use std::collections::{BTreeMap, BTreeSet, HashSet};

use jiff::{SignedDuration, Timestamp};
use rusqlite::{Connection, OptionalExtension, Row, ToSql, named_params};
use serde::Serialize;
use utoipa::ToSchema;

use super::Span;
use super::blocks::{EVENTS, OCCUPANCY};
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

impl IntervalQuery {
    /// `from` of the next page; `None` if there are no more intervals.
    pub fn next(&self) -> Option<Timestamp> {
        let length = i32::try_from(self.limit).ok().and_then(|limit| self.step.checked_mul(limit))?;
        self.from.checked_add(length).ok().filter(|next| *next < self.to)
    }
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

/// Where a page of events or spans begins and ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Cut {
    /// Numbers of the first and of the last row; `None` if there is none.
    pub ends: Option<[u64; 2]>,
    /// `after` of the next page; `None` if this is the last.
    pub next: Option<u64>,
}

impl Cut {
    /// Of numbers in their order, of which the last one may be beyond the limit.
    fn of(numbers: impl Iterator<Item = u64>, limit: usize) -> Self {
        let (mut ends, mut next) = (None, None);
        for (k, number) in numbers.enumerate() {
            if k == limit {
                next = ends.map(|[_, last]: [u64; 2]| last);
                break;
            }
            ends = Some([ends.map_or(number, |[first, _]| first), number]);
        }
        Self { ends, next }
    }
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
            below = end_of_events(memory, "ASC", i64::MAX)?.unwrap_or(i64::MAX);
        }
        each.extend(self.file.map(|file| (file, below)));
        each.reverse();
        Ok(each)
    }

    /// The events that match: with `after` or `from` the first of them, otherwise the newest.
    pub(super) fn events(&self, query: &EventQuery) -> rusqlite::Result<EventPage> {
        let mut events =
            self.some_events(query, "sequence, kind, time_ns, track, x_m, y_m, zone", read_event, |event| {
                event.sequence
            })?;
        let mut ends: (Option<u64>, Option<u64>) = (None, None);
        for (connection, below) in self.of_events()? {
            let first = end_of_events(connection, "ASC", below)?.and_then(|number| u64::try_from(number).ok());
            let last = end_of_events(connection, "DESC", below)?.and_then(|number| u64::try_from(number).ok());
            ends = (ends.0.or(first), last.or(ends.1));
        }
        let more = events.len() > query.limit;
        events.truncate(query.limit);
        let next = events.last().map(|event| event.sequence).filter(|_| more);
        Ok(EventPage { events, oldest: ends.0, newest: ends.1, next })
    }

    /// Where the page of events begins and ends.
    pub(super) fn events_cut(&self, query: &EventQuery) -> rusqlite::Result<Cut> {
        let numbers = self.some_events(query, "sequence", |row| row.get(0), |number| *number)?;
        Ok(Cut::of(numbers.into_iter(), query.limit))
    }

    /// What `read` makes of some columns of the events that match, in the order of their numbers. There may be one more
    /// than the limit, which shows that there is another page.
    fn some_events<T>(
        &self,
        query: &EventQuery,
        columns: &str,
        read: impl Fn(&Row<'_>) -> rusqlite::Result<T>,
        number: impl Fn(&T) -> u64,
    ) -> rusqlite::Result<Vec<T>> {
        let forwards = query.after.is_some() || query.from.is_some();
        let mut tables = self.of_events()?;
        if !forwards {
            tables.reverse();
        }
        let most = if forwards { query.limit + 1 } else { query.limit };
        let mut events = Vec::new();
        for (connection, below) in tables {
            let left = most - events.len();
            let selection = Selection { columns, below, forwards, limit: left };
            let mut more = select_events(connection, query, &selection, &read)?;
            // Those of each kind come in their order, and then those of the next kind.
            more.sort_by_key(&number);
            if !forwards {
                more.reverse();
            }
            more.truncate(left);
            events.extend(more);
        }
        if !forwards {
            events.reverse();
        }
        Ok(events)
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

    /// Where the page of spans begins and ends.
    pub(super) fn spans_cut(&self, query: &SpanQuery) -> rusqlite::Result<Cut> {
        let SpanQuery { after, from, to, zone, limit } = query;
        let mut numbers = BTreeSet::new();
        for connection in self.file.into_iter().chain(self.memory) {
            each_span(connection, (*from, *to), zone.as_deref(), *after, limit + 1, |span| {
                numbers.insert(span.id);
            })?;
        }
        Ok(Cut::of(numbers.into_iter(), *limit))
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

/// What events are looked up by.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum By {
    Number,
    Kind,
    Zone,
    Track,
    TrackAndZone,
}

impl By {
    fn what(query: &EventQuery) -> Self {
        match (&query.track, &query.zone) {
            (Some(_), Some(_)) => Self::TrackAndZone,
            (Some(_), None) => Self::Track,
            (None, Some(_)) => Self::Zone,
            (None, None) if !query.kinds.is_empty() => Self::Kind,
            (None, None) => Self::Number,
        }
    }
}

/// The statement for some columns of events. The index is named because SQLite would guess which one is the best.
fn events_statement(by: By, columns: &str, forwards: bool) -> String {
    let order = if forwards { "ASC" } else { "DESC" };
    let (index, condition) = match by {
        By::Number => ("", ""),
        By::Kind => ("INDEXED BY events_kind", "AND kind = :kind"),
        By::Zone => ("INDEXED BY events_zone", "AND zone = :zone AND kind = :kind"),
        // A track has few events, so the rest is compared with each of them.
        By::Track => ("INDEXED BY events_track", "AND track = :track AND kind = :kind"),
        By::TrackAndZone => ("INDEXED BY events_track", "AND track = :track AND zone = :zone AND kind = :kind"),
    };
    format!(
        "SELECT {columns} FROM events {index}
         WHERE sequence > :after AND sequence < :below AND time_ns >= :from AND time_ns < :to {condition}
         ORDER BY sequence {order} LIMIT :limit"
    )
}

/// The statement for spans.
const SPANS_STATEMENT: &str = "SELECT id, zone, people, from_ns, to_ns FROM occupancy INDEXED BY occupancy_zone
     WHERE zone IS :zone AND id > :after AND id < :below AND from_ns < :to AND to_ns > :from
     ORDER BY id LIMIT :limit";

/// The smallest (`ASC`) or largest (`DESC`) number of an event below a bound. One statement for both would read them all.
fn end_of_events(connection: &Connection, order: &str, below: i64) -> rusqlite::Result<Option<i64>> {
    let sql = format!("SELECT sequence FROM events WHERE sequence < ?1 ORDER BY sequence {order} LIMIT 1");
    connection.prepare_cached(&sql)?.query_row([below], |row| row.get(0)).optional()
}

/// What to select of the events that match.
struct Selection<'a> {
    columns: &'a str,
    /// Only smaller numbers than this.
    below: i64,
    /// The first of them, or the last.
    forwards: bool,
    /// At most this many of each kind.
    limit: usize,
}

/// The first, or the last, events that match, sorted only within each kind.
fn select_events<T>(
    connection: &Connection,
    query: &EventQuery,
    selection: &Selection<'_>,
    read: impl Fn(&Row<'_>) -> rusqlite::Result<T>,
) -> rusqlite::Result<Vec<T>> {
    let EventQuery { after, from, to, kinds, track, zone, .. } = query;
    let (from, to) = (from.map_or(i64::MIN, nanoseconds), to.map_or(i64::MAX, nanoseconds));
    let numbers = EVENTS.between(connection, from, to)?;
    let after = after.map_or(-1, integer).max(numbers.start.saturating_sub(1));
    let below = selection.below.min(numbers.end);
    let (track, most) = (track.map(integer), integer(selection.limit as u64));
    let mut given: Vec<(&str, &dyn ToSql)> =
        vec![(":after", &after), (":below", &below), (":from", &from), (":to", &to), (":limit", &most)];
    let by = By::what(query);
    let mut select = connection.prepare_cached(&events_statement(by, selection.columns, selection.forwards))?;
    if track.is_some() {
        given.push((":track", &track));
    }
    if zone.is_some() {
        given.push((":zone", zone));
    }
    if by == By::Number {
        return select.query_map(given.as_slice(), read)?.collect();
    }
    // One kind after the other, because an index has only those of one kind in the order of their numbers.
    let mut events = Vec::new();
    for kind in EventKind::ALL.into_iter().filter(|kind| kinds.is_empty() || kinds.contains(kind)) {
        let name = kind.name();
        let mut given = given.clone();
        given.push((":kind", &name));
        for event in select.query_map(given.as_slice(), &read)? {
            events.push(event?);
        }
    }
    Ok(events)
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
    let (from, to) = (nanoseconds(from), nanoseconds(to));
    let numbers = OCCUPANCY.between(connection, from, to)?;
    let mut select = connection.prepare_cached(SPANS_STATEMENT)?;
    let parameters = named_params! {
        ":zone": zone,
        ":after": after.map_or(-1, integer).max(numbers.start.saturating_sub(1)),
        ":below": numbers.end,
        ":from": from,
        ":to": to,
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
#[path = "query_tests.rs"]
mod tests;
