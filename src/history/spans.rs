use jiff::{SignedDuration, Timestamp};
use serde::Serialize;
use utoipa::ToSchema;

use doorcam_core::tracking::Occupancy;

/// Longest span: a span is deleted as a whole once its beginning is too old.
const LONGEST: SignedDuration = SignedDuration::from_hours(1);
/// Times without updates for longer than this count as not watched.
const GAP: SignedDuration = SignedDuration::from_secs(5);

/// A time in which the number of people stayed the same. Times that no span covers were not watched.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, ToSchema)]
pub struct Span {
    /// Number of the span; spans are numbered in the order in which they began.
    pub id: u64,
    /// The zone; null for the whole room.
    #[schema(required)]
    pub zone: Option<String>,
    /// How many people.
    pub people: usize,
    /// Where it begins, RFC 3339.
    pub from: Timestamp,
    /// Where it ends.
    pub to: Timestamp,
}

/// Makes spans from the counts of successive updates.
#[derive(Debug)]
pub(super) struct Spans {
    /// The whole room, then each zone, with its open span.
    places: Vec<(Option<String>, Option<Span>)>,
    next: u64,
    last: Option<Timestamp>,
}

impl Spans {
    /// Numbers spans from `next` on.
    pub(super) fn new(next: u64) -> Self {
        Self { places: vec![(None, None)], next, last: None }
    }

    /// The number of the next span.
    pub(super) fn next(&self) -> u64 {
        self.next
    }

    /// Takes in how many people are in the room and in each zone, `None` if that is not known, and adds the spans that
    /// end to `over`.
    pub(super) fn observe(&mut self, time: Timestamp, people: Option<(usize, &[Occupancy])>, over: &mut Vec<Span>) {
        let interrupted = self.last.is_some_and(|last| {
            let elapsed = time.duration_since(last);
            elapsed.is_negative() || elapsed > GAP
        });
        if interrupted || people.is_none() {
            over.extend(self.places.iter_mut().filter_map(|(_, open)| open.take()).filter(|span| span.to > span.from));
        }
        self.last = Some(time);
        let Some((room, zones)) = people else { return };
        self.follow(zones, over);
        let counts = std::iter::once(room).chain(zones.iter().map(|zone| zone.people));
        for ((zone, open), people) in self.places.iter_mut().zip(counts) {
            if let Some(span) = open {
                span.to = time;
                if span.people == people && time.duration_since(span.from) < LONGEST {
                    continue;
                }
                over.extend(open.take().filter(|span| span.to > span.from));
            }
            *open = Some(Span { id: self.next, zone: zone.clone(), people, from: time, to: time });
            self.next += 1;
        }
    }

    /// Adapts `places` to the zones, which a user may redraw. The spans of removed zones end.
    fn follow(&mut self, zones: &[Occupancy], over: &mut Vec<Span>) {
        let names = self.places[1..].iter().map(|(name, _)| name.as_deref());
        if names.eq(zones.iter().map(|zone| Some(zone.name.as_str()))) {
            return;
        }
        let mut before = self.places.split_off(1);
        for zone in zones {
            let same = before.iter_mut().find(|(name, _)| name.as_ref() == Some(&zone.name));
            let open = same.and_then(|(_, open)| open.take());
            self.places.push((Some(zone.name.clone()), open));
        }
        over.extend(before.into_iter().filter_map(|(_, open)| open).filter(|span| span.to > span.from));
    }

    /// The spans that have not ended.
    pub(super) fn open(&self) -> impl Iterator<Item = &Span> {
        self.places.iter().filter_map(|(_, open)| open.as_ref()).filter(|span| span.to > span.from)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(seconds: i64) -> Timestamp {
        Timestamp::from_second(seconds).unwrap()
    }

    fn told(spans: &[Span]) -> Vec<(u64, Option<&str>, usize, i64, i64)> {
        spans.iter().map(|s| (s.id, s.zone.as_deref(), s.people, s.from.as_second(), s.to.as_second())).collect()
    }

    fn zone(name: &str, people: usize) -> Occupancy {
        Occupancy { name: name.into(), people, tracks: Vec::new() }
    }

    #[test]
    fn a_change_ends_one_span_and_begins_the_next() {
        let (mut spans, mut over) = (Spans::new(7), Vec::new());
        for (time, room, bed) in [(0, 0, 0), (1, 0, 0), (2, 1, 0), (4, 1, 1), (5, 0, 0)] {
            spans.observe(at(time), Some((room, &[zone("bed", bed)])), &mut over);
        }
        assert_eq!(
            told(&over),
            [(7, None, 0, 0, 2), (8, Some("bed"), 0, 0, 4), (9, None, 1, 2, 5), (10, Some("bed"), 1, 4, 5)]
        );
        spans.observe(at(6), Some((0, &[zone("bed", 0)])), &mut over);
        let open: Vec<Span> = spans.open().cloned().collect();
        assert_eq!(told(&open), [(11, None, 0, 5, 6), (12, Some("bed"), 0, 5, 6)]);
        assert_eq!(spans.next(), 13);
    }

    #[test]
    fn a_zone_that_stays_goes_on_when_others_are_drawn() {
        let (mut spans, mut over) = (Spans::new(0), Vec::new());
        spans.observe(at(0), Some((1, &[zone("bed", 1), zone("sofa", 0)])), &mut over);
        spans.observe(at(1), Some((1, &[zone("bed", 1), zone("sofa", 0)])), &mut over);
        spans.observe(at(2), Some((1, &[zone("desk", 0), zone("bed", 1)])), &mut over);
        assert_eq!(told(&over), [(2, Some("sofa"), 0, 0, 1)]);
        spans.observe(at(3), Some((1, &[])), &mut over);
        assert_eq!(told(&over)[1..], [(1, Some("bed"), 1, 0, 2)], "the desk was there for no time");
        assert_eq!(told(&spans.open().cloned().collect::<Vec<_>>()), [(0, None, 1, 0, 3)]);
    }

    #[test]
    fn nothing_is_said_of_times_without_updates_or_map_and_of_a_clock_that_was_put_back() {
        let (mut spans, mut over) = (Spans::new(0), Vec::new());
        for (time, count) in [
            (0, Some(1)),
            (3, Some(1)),
            (60, Some(1)),
            (61, Some(1)),
            (62, None),
            (64, Some(1)),
            (66, Some(1)),
            (30, Some(1)),
            (33, Some(1)),
        ] {
            spans.observe(at(time), count.map(|count| (count, [].as_slice())), &mut over);
        }
        over.extend(spans.open().cloned());
        assert_eq!(told(&over), [(0, None, 1, 0, 3), (1, None, 1, 60, 61), (2, None, 1, 64, 66), (3, None, 1, 30, 33)]);
    }

    #[test]
    fn no_span_is_much_longer_than_an_hour() {
        let (mut spans, mut over) = (Spans::new(0), Vec::new());
        (0..3 * 3600).for_each(|k| spans.observe(at(k), Some((0, &[])), &mut over));
        assert_eq!(told(&over), [(0, None, 0, 0, 3600), (1, None, 0, 3600, 7200)]);
    }
}
