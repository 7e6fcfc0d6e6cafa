use std::collections::{BTreeMap, BTreeSet, HashSet};

use jiff::Timestamp;
use rusqlite::{Connection, OptionalExtension, Row, ToSql, named_params};

use super::Span;
use super::blocks::{EVENTS, OCCUPANCY};
use super::pages::{Cut, EventPage, EventQuery, Interval, IntervalPage, IntervalQuery, SpanPage, SpanQuery};
use super::store::{integer, nanoseconds};
use doorcam_core::tracking::{Event, EventKind, ExitReason, Through};

/// The columns that [`read_event`] reads.
pub(super) const EVENT_COLUMNS: &str = "sequence, kind, time_ns, track, x_m, y_m, zone, through, reason, speed_m_s";

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
        let mut events = self.some_events(query, EVENT_COLUMNS, read_event, |event| event.sequence)?;
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
        // A span that was open when the file became unwritable is in both; the one in memory is longer, and overwrites.
        let mut known = BTreeMap::new();
        for connection in self.file.into_iter().chain(self.memory) {
            each_span(connection, &Asked::of(query), "id, zone, people, from_ns, to_ns", |row| {
                let span = read_span(row)?;
                known.insert(span.id, span);
                Ok(())
            })?;
        }
        let mut spans: Vec<Span> = known.into_values().collect();
        let more = spans.len() > query.limit;
        spans.truncate(query.limit);
        let next = spans.last().map(|span| span.id).filter(|_| more);
        Ok(SpanPage { spans, next })
    }

    /// Where the page of spans begins and ends.
    pub(super) fn spans_cut(&self, query: &SpanQuery) -> rusqlite::Result<Cut> {
        let mut numbers = BTreeSet::new();
        for connection in self.file.into_iter().chain(self.memory) {
            each_span(connection, &Asked::of(query), "id", |row| {
                numbers.insert(row.get(0)?);
                Ok(())
            })?;
        }
        Ok(Cut::of(numbers.into_iter(), query.limit))
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
        let mut sums = vec![Sum::default(); intervals.len()];
        let ends: Vec<i64> = intervals.iter().map(|interval| nanoseconds(interval.to)).collect();
        let from = nanoseconds(*from);
        let asked = Asked { zone: zone.as_deref(), after: None, times: [from, nanoseconds(begin)], limit: usize::MAX };
        let mut counted = HashSet::new();
        // Memory first, because of a span that is in both it has the longer version. It never holds many spans.
        for (connection, in_memory) in self.memory.map(|m| (m, true)).into_iter().chain(self.file.map(|f| (f, false))) {
            // As numbers: this may be every span of a year.
            each_span(connection, &asked, "id, people, from_ns, to_ns", |row| {
                let [id, people, begins, ends_at]: [i64; 4] = [row.get(0)?, row.get(1)?, row.get(2)?, row.get(3)?];
                if in_memory {
                    counted.insert(id);
                } else if counted.contains(&id) {
                    return Ok(());
                }
                for k in ends.partition_point(|&end| end <= begins)..ends.len() {
                    let start = if k == 0 { from } else { ends[k - 1] };
                    let overlap_ns = ends_at.min(ends[k]).saturating_sub(begins.max(start));
                    if overlap_ns <= 0 {
                        break;
                    }
                    sums[k].add(people, overlap_ns);
                }
                Ok(())
            })?;
        }
        for (interval, sum) in intervals.iter_mut().zip(&sums) {
            sum.tell(interval);
        }
        Ok(IntervalPage { intervals, next: (begin < *to).then_some(begin) })
    }
}

/// What spans add up to in an interval.
#[derive(Debug, Clone, Copy, Default)]
struct Sum {
    most: Option<i64>,
    watched_s: f64,
    occupied_s: f64,
    people_s: f64,
}

impl Sum {
    fn add(&mut self, people: i64, nanoseconds: i64) {
        let seconds = nanoseconds as f64 / 1e9;
        self.most = self.most.max(Some(people));
        self.watched_s += seconds;
        self.occupied_s += if people > 0 { seconds } else { 0.0 };
        self.people_s += seconds * people as f64;
    }

    fn tell(&self, interval: &mut Interval) {
        interval.most = self.most.and_then(|most| usize::try_from(most).ok());
        interval.mean = (self.watched_s > 0.0).then(|| self.people_s / self.watched_s);
        (interval.occupied_s, interval.watched_s) = (self.occupied_s, self.watched_s);
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

/// The statement for some columns of spans.
fn spans_statement(columns: &str) -> String {
    format!(
        "SELECT {columns} FROM occupancy INDEXED BY occupancy_zone
         WHERE zone IS :zone AND id > :after AND id < :below AND from_ns < :to AND to_ns > :from
         ORDER BY id LIMIT :limit"
    )
}

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
    Ok(Event {
        sequence: row.get(0)?,
        kind: kind.ok_or_else(|| unknown(1, "kind"))?,
        time: time(row, 2)?,
        track: row.get(3)?,
        x_m: row.get::<_, Option<f64>>(4)?.unwrap_or(f64::NAN),
        y_m: row.get::<_, Option<f64>>(5)?.unwrap_or(f64::NAN),
        zone: row.get(6)?,
        through: one_of(row, 7, "through", &[Through::Door], Through::name)?,
        reason: one_of(row, 8, "reason", &ExitReason::ALL, ExitReason::name)?,
        speed_m_s: row.get(9)?,
    })
}

/// The value that has the name in this column, if there is a name.
fn one_of<T: Copy>(
    row: &Row<'_>,
    column: usize,
    called: &str,
    all: &[T],
    name: impl Fn(T) -> &'static str,
) -> rusqlite::Result<Option<T>> {
    let Some(found) = row.get::<_, Option<String>>(column)? else { return Ok(None) };
    let known = all.iter().copied().find(|&value| name(value) == found);
    known.map(Some).ok_or_else(|| unknown(column, called))
}

/// The error for a name that this version does not know.
fn unknown(column: usize, called: &str) -> rusqlite::Error {
    rusqlite::Error::InvalidColumnType(column, called.into(), rusqlite::types::Type::Text)
}

/// Which spans are asked for.
struct Asked<'a> {
    zone: Option<&'a str>,
    after: Option<u64>,
    /// Those that overlap the time between these, in nanoseconds since 1970.
    times: [i64; 2],
    limit: usize,
}

impl<'a> Asked<'a> {
    /// One more than the limit, which shows whether there is another page.
    fn of(query: &'a SpanQuery) -> Self {
        let SpanQuery { after, from, to, zone, limit } = query;
        let times = [nanoseconds(*from), nanoseconds(*to)];
        Self { zone: zone.as_deref(), after: *after, times, limit: limit + 1 }
    }
}

/// Calls `each` with some columns of the spans, in the order of their numbers.
fn each_span(
    connection: &Connection,
    asked: &Asked<'_>,
    columns: &str,
    mut each: impl FnMut(&Row<'_>) -> rusqlite::Result<()>,
) -> rusqlite::Result<()> {
    let Asked { zone, after, times: [from, to], limit } = *asked;
    let numbers = OCCUPANCY.between(connection, from, to)?;
    let mut select = connection.prepare_cached(&spans_statement(columns))?;
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
        each(row)?;
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
