use jiff::{SignedDuration, Timestamp};
use serde::{Deserialize, Serialize};

use super::event_kind::{Direction, EventKind, ExitReason, Through};
use super::zones::Zone;
use super::{Track, TrackState};
use crate::geometry::Point;

/// Something that a person did, or that happened to the camera.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct Event {
    /// Number of the event, in the order in which events became known: from 0, or continued from earlier runs if the
    /// history is kept.
    pub sequence: u64,
    /// What happened.
    pub kind: EventKind,
    /// When it happened, RFC 3339.
    pub time: Timestamp,
    /// Id of the person's track; 0, which no track has, if the event is of no person.
    pub track: u64,
    /// Position to the right, in metres in the door frame.
    pub x_m: f64,
    /// Position into the hidden room, in metres in the door frame.
    pub y_m: f64,
    /// Name of the zone; none for events without a zone.
    #[cfg_attr(feature = "schema", schema(required))]
    pub zone: Option<String>,
    /// What somebody who left went through; none if nobody saw it, and for other events.
    #[cfg_attr(feature = "schema", schema(required))]
    pub through: Option<Through>,
    /// Why an `exit` was reported; none for other events.
    #[cfg_attr(feature = "schema", schema(required))]
    pub reason: Option<ExitReason>,
    /// Speed across the threshold, in m/s; none for events that are no crossings.
    #[cfg_attr(feature = "schema", schema(required))]
    pub speed_m_s: Option<f64>,
}

/// Who is in a zone.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct Occupancy {
    /// The zone's name.
    pub name: String,
    /// Number of people in the zone.
    pub people: usize,
    /// Ids of their tracks.
    pub tracks: Vec<u64>,
}

/// When somebody dwells: for at least `seconds` within `radius_m`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dwelling {
    /// Shortest stay, in seconds.
    pub seconds: f64,
    /// Largest distance from where the stay began, in metres.
    pub radius_m: f64,
}

/// Derives events from the tracks of successive updates.
#[derive(Debug, Clone)]
pub struct Events {
    dwelling: Dwelling,
    zones: Vec<Zone>,
    names: Vec<String>,
    present: Vec<Present>,
    /// Events to report with the next update.
    pending: Vec<Event>,
    /// Why tracks end.
    reasons: Vec<(u64, ExitReason)>,
    next: u64,
}

/// What is known about a track.
#[derive(Debug, Clone)]
struct Present {
    id: u64,
    entered: bool,
    first: Moment,
    last: Moment,
    /// When and where the current stay began.
    stay: Moment,
    /// Whether the current stay was reported as a dwell.
    told: bool,
    /// For each zone, whether the person is in it.
    inside: Vec<bool>,
    /// Whether the latest update has this track.
    there: bool,
}

#[derive(Debug, Clone, Copy)]
struct Moment {
    time: Timestamp,
    place: Point,
}

impl Events {
    /// Starts with nobody seen.
    pub fn new(dwelling: Dwelling, zones: Vec<Zone>) -> Self {
        let names = zones.iter().map(|zone| zone.name.clone()).collect();
        Self { dwelling, zones, names, present: Vec::new(), pending: Vec::new(), reasons: Vec::new(), next: 0 }
    }

    /// Numbers events from `next` on.
    pub fn counting_from(mut self, next: u64) -> Self {
        self.next = next;
        self
    }

    /// The event that says that the camera has moved. It has a number, but neither person nor place.
    pub fn camera_moved(&mut self, time: Timestamp) -> Event {
        let mut events = Vec::with_capacity(1);
        push(&mut events, &mut self.next, EventKind::CameraMoved, 0, Moment { time, place: [0.0; 2] }, None);
        events.swap_remove(0)
    }

    /// Replaces `others`: continues their numbering, and everyone they saw leaves with the next update.
    pub fn continue_from(&mut self, others: Self) {
        self.next = others.next;
        self.pending = others.pending;
        self.present = others.present;
        // Zones come from the configuration and stay the same. If there are more, nobody is in the added ones.
        self.present.iter_mut().for_each(|present| present.inside.resize(self.zones.len(), false));
    }

    /// Replaces the zones. People in a zone whose name remains stay in it if its new border still holds them; people in
    /// a removed zone leave it.
    pub fn use_zones(&mut self, zones: Vec<Zone>) {
        let names: Vec<String> = zones.iter().map(|zone| zone.name.clone()).collect();
        for person in &mut self.present {
            let inside = |name: &String| self.names.iter().position(|n| n == name).is_some_and(|k| person.inside[k]);
            let now = names.iter().map(inside).collect();
            for (name, _) in
                self.names.iter().zip(&person.inside).filter(|(name, inside)| **inside && !names.contains(name))
            {
                let gone = Some(name.clone());
                push(&mut self.pending, &mut self.next, EventKind::ZoneExit, person.id, person.last, gone);
            }
            person.inside = now;
        }
        (self.zones, self.names) = (zones, names);
    }

    /// Somebody crossed the threshold, at `place` (m, door frame), with a speed in m/s. Reported with the next update.
    pub fn crossed(&mut self, time: Timestamp, track: u64, direction: Direction, place: Point, speed_m_s: f64) {
        push(&mut self.pending, &mut self.next, direction.kind(), track, Moment { time, place }, None);
        if let Some(event) = self.pending.last_mut() {
            event.speed_m_s = Some(speed_m_s);
        }
    }

    /// Says why the tracks that are missing from the next update have ended; without a word it is
    /// [`ExitReason::Unseen`].
    pub fn leaves(&mut self, track: u64, reason: ExitReason) {
        self.reasons.push((track, reason));
    }

    /// Processes the tracks of an update and, for each, the seconds since its last detection; appends what happened to
    /// `events`. A person whose track is missing has left.
    pub fn observe(&mut self, time: Timestamp, tracks: &[Track], unseen_s: &[f64], events: &mut Vec<Event>) {
        events.append(&mut self.pending);
        self.present.iter_mut().for_each(|present| present.there = false);
        for (track, &unseen_s) in tracks.iter().zip(unseen_s) {
            self.follow(time, track, unseen_s, events);
        }
        for gone in self.present.extract_if(.., |present| !present.there) {
            if gone.entered {
                for zone in (0..gone.inside.len()).filter(|&zone| gone.inside[zone]) {
                    let name = Some(self.names[zone].clone());
                    push(events, &mut self.next, EventKind::ZoneExit, gone.id, gone.last, name);
                }
                push(events, &mut self.next, EventKind::Exit, gone.id, gone.last, None);
                let reason = self.reasons.iter().find(|(track, _)| *track == gone.id).map(|(_, reason)| *reason);
                if let (Some(exit), Some(reason)) = (events.last_mut(), reason) {
                    exit.through = (reason == ExitReason::Door).then_some(Through::Door);
                    exit.reason = Some(reason);
                }
            }
        }
        self.reasons.clear();
    }

    /// The occupancy of each zone.
    pub fn occupancy(&self) -> impl Iterator<Item = Occupancy> + '_ {
        self.names.iter().enumerate().map(|(zone, name)| {
            let tracks: Vec<u64> = self.present.iter().filter(|p| p.inside[zone]).map(|p| p.id).collect();
            Occupancy { name: name.clone(), people: tracks.len(), tracks }
        })
    }

    fn follow(&mut self, time: Timestamp, track: &Track, unseen_s: f64, events: &mut Vec<Event>) {
        let now = Moment { time, place: [track.x_m, track.y_m] };
        let index = self.present.iter().position(|p| p.id == track.id).unwrap_or_else(|| {
            let first = Moment { time: before(time, track.age_s), ..now };
            self.present.push(Present {
                id: track.id,
                entered: false,
                first,
                last: now,
                stay: first,
                told: false,
                inside: vec![false; self.zones.len()],
                there: true,
            });
            self.present.len() - 1
        });
        let Self { present, zones, names, next, dwelling, .. } = self;
        let person = &mut present[index];
        person.there = true;
        let seen = unseen_s <= 0.0;
        person.last = Moment { time: before(time, unseen_s), place: if seen { now.place } else { person.last.place } };
        let moved = (now.place[0] - person.stay.place[0]).hypot(now.place[1] - person.stay.place[1]);
        if seen && moved > dwelling.radius_m {
            (person.stay, person.told) = (now, false);
        }
        if track.state == TrackState::Tentative {
            return;
        }
        if !person.entered {
            person.entered = true;
            push(events, next, EventKind::Enter, track.id, person.first, None);
        }
        for (zone, inside) in person.inside.iter_mut().enumerate() {
            let before = *inside;
            *inside = zones[zone].holds(now.place, before);
            if *inside != before {
                let kind = if before { EventKind::ZoneExit } else { EventKind::ZoneEnter };
                push(events, next, kind, track.id, now, Some(names[zone].clone()));
            }
        }
        let stayed_s = person.last.time.duration_since(person.stay.time).as_secs_f64();
        if !person.told && stayed_s >= dwelling.seconds {
            person.told = true;
            push(events, next, EventKind::Dwell, track.id, now, None);
        }
    }
}

fn push(
    events: &mut Vec<Event>,
    next: &mut u64,
    kind: EventKind,
    track: u64,
    Moment { time, place }: Moment,
    zone: Option<String>,
) {
    let (through, reason, speed_m_s) = (None, (kind == EventKind::Exit).then_some(ExitReason::Unseen), None);
    events.push(Event {
        sequence: *next,
        kind,
        time,
        track,
        x_m: place[0],
        y_m: place[1],
        zone,
        through,
        reason,
        speed_m_s,
    });
    *next += 1;
}

/// `time` minus `seconds`, or `time` itself if that is out of range.
fn before(time: Timestamp, seconds: f64) -> Timestamp {
    SignedDuration::try_from_secs_f64(seconds).ok().and_then(|ago| time.checked_sub(ago).ok()).unwrap_or(time)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn track(id: u64, state: TrackState, [x_m, y_m]: Point, age_s: f64) -> Track {
        let covariance_m2 = [[0.01, 0.0], [0.0, 0.01]];
        Track { id, state, x_m, y_m, vx_m_s: 0.0, vy_m_s: 0.0, covariance_m2, rgb: [0.0; 3], age_s }
    }

    fn at(seconds: f64) -> Timestamp {
        before(Timestamp::UNIX_EPOCH, -seconds)
    }

    fn bed() -> Zone {
        Zone { name: "bed".into(), id: None, polygon_m: vec![[0.5, 1.0], [1.5, 1.0], [1.5, 2.0], [0.5, 2.0]] }
    }

    fn events() -> Events {
        Events::new(Dwelling { seconds: 5.0, radius_m: 0.4 }, vec![bed()])
    }

    #[test]
    fn other_zones_keep_who_is_in_them_and_let_go_who_was_in_one_that_is_gone() {
        let desk = || Zone { name: "desk".into(), id: None, polygon_m: bed().polygon_m };
        let mut log = Events::new(Dwelling { seconds: 5.0, radius_m: 0.4 }, vec![bed(), desk()]);
        let mut happened = Vec::new();
        let mut observe = |log: &mut Events, t: f64| {
            log.observe(at(t), &[track(1, TrackState::Confirmed, [1.0, 1.5], t)], &[0.0], &mut happened);
            happened.drain(..).map(|e| (e.kind, e.zone, e.sequence)).collect::<Vec<_>>()
        };
        assert_eq!(observe(&mut log, 0.0).len(), 3, "enter, and both zones");
        // The desk is removed, the bed moves away from them, and a sofa is added where they are.
        let far = vec![[-1.5, 1.0], [-0.5, 1.0], [-0.5, 2.0]];
        let sofa = Zone { name: "sofa".into(), id: None, polygon_m: desk().polygon_m };
        log.use_zones(vec![sofa, Zone { name: "bed".into(), id: None, polygon_m: far }]);
        let named = |name: &str| Some(name.to_owned());
        let expected = vec![
            (EventKind::ZoneExit, named("desk"), 3),
            (EventKind::ZoneEnter, named("sofa"), 4),
            (EventKind::ZoneExit, named("bed"), 5),
        ];
        assert_eq!(observe(&mut log, 0.1), expected);
        let occupied: Vec<_> = log.occupancy().map(|zone| (zone.name, zone.people)).collect();
        assert_eq!(occupied, [("sofa".into(), 1), ("bed".into(), 0)]);
        assert_eq!(observe(&mut log, 0.2), [], "told once");
    }

    /// Events of one track at `place(t)`, confirmed at time `confirmed`, in steps of 0.1 s until `until`, unseen in the
    /// last second.
    fn happened(confirmed: f64, until: f64, place: impl Fn(f64) -> Point) -> Vec<(EventKind, f64)> {
        let (mut log, mut events) = (events(), Vec::new());
        let mut k = 0;
        while f64::from(k) * 0.1 <= until {
            let t = f64::from(k) * 0.1;
            let unseen_s = (t - (until - 1.0)).max(0.0);
            let state = match t {
                t if t < confirmed => TrackState::Tentative,
                _ if unseen_s > 0.0 => TrackState::Coasting,
                _ => TrackState::Confirmed,
            };
            log.observe(at(t), &[track(1, state, place(t), t)], &[unseen_s], &mut events);
            k += 1;
        }
        log.observe(at(until + 0.1), &[], &[], &mut events);
        assert!(events.iter().enumerate().all(|(k, e)| e.sequence == k as u64 && e.track == 1));
        events.iter().map(|e| (e.kind, e.time.duration_since(at(0.0)).as_secs_f64())).collect()
    }

    #[test]
    fn a_visit_has_an_entry_and_an_exit_at_the_times_it_was_seen() {
        let visit = happened(0.45, 3.0, |t| [-1.0 + 0.3 * t, 2.5]);
        assert_eq!(visit, [(EventKind::Enter, 0.0), (EventKind::Exit, 2.0)]);
        assert_eq!(happened(9.0, 3.0, |t| [-1.0 + 0.3 * t, 2.5]), [], "a false alarm is nobody");
    }

    #[test]
    fn who_stays_dwells_once_a_place() {
        // More than six seconds in one place, then as long in another.
        let visit = happened(0.45, 14.0, |t| if t < 6.5 { [-1.0, 2.5] } else { [-0.2, 2.5] });
        let kinds: Vec<_> = visit.iter().map(|v| v.0).collect();
        assert_eq!(kinds, [EventKind::Enter, EventKind::Dwell, EventKind::Dwell, EventKind::Exit]);
        assert!((visit[1].1 - 5.0).abs() < 0.11 && (visit[2].1 - 11.5).abs() < 0.11, "{visit:?}");
        // Never within 0.4 m for 5 s.
        let walk = happened(0.45, 14.0, |t| [-1.0 + 0.1 * t, 2.5]);
        assert_eq!(walk.len(), 2);
    }

    #[test]
    fn a_zone_is_entered_and_left_and_who_is_lost_in_it_has_left() {
        let through = happened(0.45, 6.0, |t| [0.3 * t, 1.5]);
        let kinds: Vec<_> = through.iter().map(|v| v.0).collect();
        assert_eq!(kinds, [EventKind::Enter, EventKind::ZoneEnter, EventKind::ZoneExit, EventKind::Exit]);
        // x = 0.5 is reached after 1.67 s; it is left at 1.65 after 5.5 s, or when last seen.
        assert!((through[1].1 - 1.7).abs() < 0.01 && (through[2].1 - 5.6).abs() < 0.11, "{through:?}");
        let lost = happened(0.45, 4.0, |t| [0.3 * t, 1.5]);
        assert_eq!(lost[2..], [(EventKind::ZoneExit, 3.0), (EventKind::Exit, 3.0)]);
    }

    #[test]
    fn occupancy_counts_who_is_confirmed() {
        let (mut log, mut events) = (events(), Vec::new());
        let state = [TrackState::Confirmed, TrackState::Coasting, TrackState::Tentative, TrackState::Confirmed];
        let places = [[1.0, 1.5], [0.6, 1.2], [1.2, 1.2], [0.0, 1.0]];
        let tracks: Vec<Track> = (0..4).map(|k| track(k as u64, state[k], places[k], 1.0)).collect();
        log.observe(at(1.0), &tracks, &[0.0; 4], &mut events);
        let occupancy: Vec<_> = log.occupancy().collect();
        assert_eq!(occupancy, [Occupancy { name: "bed".into(), people: 2, tracks: vec![0, 1] }]);
        log.observe(at(1.1), &[], &[], &mut events);
        assert_eq!(log.occupancy().map(|o| o.people).sum::<usize>(), 0);
        let mut next = Events::new(Dwelling { seconds: 5.0, radius_m: 0.4 }, Vec::new());
        log.observe(at(1.2), &tracks[..1], &[0.0], &mut events);
        let count = events.len();
        next.continue_from(log);
        next.observe(at(2.0), &[track(9, TrackState::Confirmed, [0.0, 1.0], 0.5)], &[0.0], &mut events);
        let after: Vec<_> = events[count..].iter().map(|e| (e.sequence, e.kind, e.track)).collect();
        let count = count as u64;
        assert_eq!(after, [(count, EventKind::Enter, 9), (count + 1, EventKind::Exit, 0)]);
    }
}
