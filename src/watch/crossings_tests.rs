use super::*;
use doorcam_core::tracking::EventKind;

fn at(text: &str) -> Timestamp {
    text.parse().unwrap()
}

/// A crossing at this time.
pub(in super::super) fn crossing(sequence: u64, kind: EventKind, time: Timestamp) -> Event {
    let (track, speed_m_s) = (sequence, Some(1.25));
    Event { sequence, kind, time, track, x_m: 0.1, y_m: 0.0, zone: None, through: None, reason: None, speed_m_s }
}

/// In, out, back and inside.
fn counts(crossings: &mut Crossings, now: &str) -> (u64, u64, u64, u32) {
    let CrossingsReport { came_in, out, back, inside, .. } = crossings.report(None, at(now));
    (came_in, out, back, inside)
}

fn eastern() -> TimeZone {
    TimeZone::fixed(jiff::tz::offset(-5))
}

fn counting(now: &str) -> Crossings {
    Crossings::new(eastern(), at(now))
}

fn walk(crossings: &mut Crossings, kind: EventKind, time: &str) {
    let event = crossing(0, kind, at(time));
    crossings.take(&event, at(time));
}

#[test]
fn the_estimate_goes_up_and_down_and_never_below_nobody() {
    use EventKind::{CrossBack, CrossIn, CrossOut, Enter, Exit};
    let mut crossings = counting("2026-03-01T12:00:00Z");
    let now = "2026-03-01T12:00:00Z";
    for (kind, told) in [
        (CrossIn, (1, 0, 0, 1)),
        (CrossBack, (1, 0, 1, 1)),
        (Enter, (1, 0, 1, 1)),
        (CrossIn, (2, 0, 1, 2)),
        (CrossOut, (2, 1, 1, 1)),
        (CrossOut, (2, 2, 1, 0)),
        (CrossOut, (2, 3, 1, 0)),
        (Exit, (2, 3, 1, 0)),
        (CrossIn, (3, 3, 1, 1)),
    ] {
        walk(&mut crossings, kind, now);
        assert_eq!(counts(&mut crossings, now), told, "{kind:?}");
    }
    crossings.set_inside(MOST_INSIDE, at(now));
    walk(&mut crossings, CrossIn, now);
    assert_eq!(counts(&mut crossings, now), (4, 3, 1, MOST_INSIDE), "it can be set to what it tells");
    crossings.set_inside(5, at(now));
    walk(&mut crossings, CrossOut, now);
    assert_eq!(counts(&mut crossings, now), (4, 4, 1, 4));
}

#[test]
fn counts_begin_at_midnight_local_time_and_the_estimate_goes_on() {
    let mut crossings = counting("2026-03-01T12:00:00Z");
    walk(&mut crossings, EventKind::CrossIn, "2026-03-01T12:00:00Z");
    let report = crossings.report(None, at("2026-03-02T04:59:59Z"));
    assert_eq!((report.since, report.came_in), (at("2026-03-01T05:00:00Z"), 1));
    let report = crossings.report(None, at("2026-03-02T05:00:00Z"));
    assert_eq!((report.since, report.came_in, report.inside), (at("2026-03-02T05:00:00Z"), 0, 1));
    assert_eq!(report.last.map(|last| last.time), Some(at("2026-03-01T12:00:00Z")), "the newest is of yesterday");
    // Told just after midnight of a moment before.
    let late = crossing(1, EventKind::CrossIn, at("2026-03-03T04:59:59.9Z"));
    crossings.take(&late, at("2026-03-03T05:00:00.1Z"));
    assert_eq!(counts(&mut crossings, "2026-03-03T05:00:01Z"), (0, 0, 0, 2));
    // A clock that is set back begins that day anew, rather than never again.
    walk(&mut crossings, EventKind::CrossOut, "2026-03-02T13:00:00Z");
    assert_eq!(counts(&mut crossings, "2026-03-02T13:00:00Z"), (0, 1, 0, 1));
}

#[test]
fn a_day_of_25_hours_is_one_day() {
    // The time goes back by an hour on the first Sunday of November at 2:00.
    let zone = TimeZone::posix("EST5EDT,M3.2.0,M11.1.0").unwrap();
    let mut crossings = Crossings::new(zone, at("2026-11-01T04:00:00Z"));
    for time in ["2026-11-01T04:00:00Z", "2026-11-02T04:59:59Z"] {
        walk(&mut crossings, EventKind::CrossIn, time);
        assert_eq!(crossings.report(None, at(time)).since, at("2026-11-01T04:00:00Z"));
    }
    assert_eq!(counts(&mut crossings, "2026-11-02T04:59:59Z"), (2, 0, 0, 2));
    assert_eq!(counts(&mut crossings, "2026-11-02T05:00:00Z"), (0, 0, 0, 2));
}

#[test]
fn another_run_goes_on_with_what_was_kept_and_what_the_history_has_beyond() {
    use EventKind::{CrossIn, CrossOut};
    let mut before = counting("2026-03-01T12:00:00Z");
    walk(&mut before, CrossIn, "2026-03-01T12:00:00Z");
    before.set_inside(3, at("2026-03-01T12:30:00Z"));
    walk(&mut before, CrossOut, "2026-03-01T13:00:00Z");
    let kept = before.tally(at("2026-03-01T13:00:00Z")).clone();
    assert_eq!(kept.inside, 2);
    let json = serde_json::to_string(&kept).unwrap();
    assert_eq!(serde_json::from_str::<Tally>(&json).unwrap(), kept, "{json}");
    // Written to the history, but the program was killed before it was in the tally.
    let history = [
        crossing(1, CrossIn, at("2026-03-01T12:00:00Z")),
        crossing(2, CrossOut, at("2026-03-01T13:00:00Z")),
        crossing(3, CrossOut, at("2026-03-01T13:00:01Z")),
    ];
    let resumed = |kept: Option<&Tally>, now: &str| {
        let mut crossings = counting(now);
        let midnight = crossings.midnight(at(now));
        let from = kept.map_or(midnight, |kept| kept.reread_from(midnight));
        let beyond: Vec<Event> = history.iter().filter(|event| event.time >= from).cloned().collect();
        crossings.go_on(kept.cloned(), &beyond, at(now));
        let counts = counts(&mut crossings, now);
        (counts, crossings.report(None, at(now)).last.map(|last| last.sequence))
    };
    assert_eq!(resumed(Some(&kept), "2026-03-01T14:00:00Z"), ((1, 2, 0, 1), Some(3)));
    assert_eq!(resumed(Some(&kept), "2026-03-02T14:00:00Z"), ((0, 0, 0, 1), Some(3)), "the next day");
    assert_eq!(resumed(None, "2026-03-01T14:00:00Z"), ((1, 2, 0, 0), Some(3)), "without a file");
    // Kept by a machine whose clock was in another time zone: the history has what is of this day.
    let elsewhere = Tally { since: at("2026-03-01T12:30:00Z"), ..kept };
    assert_eq!(resumed(Some(&elsewhere), "2026-03-01T14:00:00Z"), ((1, 2, 0, 1), Some(3)));
}

#[test]
fn who_is_inside_is_not_claimed_while_nobody_who_walks_through_is_seen() {
    let mut crossings = counting("2026-03-01T12:00:00Z");
    crossings.set_inside(3, at("2026-03-01T12:00:00Z"));
    let seen = crossings.report(None, at("2026-03-01T12:00:00Z"));
    let unseen = crossings.report(Some("why".into()), at("2026-03-01T12:00:00Z"));
    assert_eq!((seen.available, unseen.available, unseen.reason.as_deref()), (true, false, Some("why")));
    assert!(seen.exposition().ends_with("\ndoorcam_inside 3\n\n"));
    assert!(unseen.exposition().ends_with("\ndoorcam_inside NaN\n\n"));
}

#[test]
fn why_nobody_is_seen_to_walk_through_is_told_by_what_lasts_longest() {
    let never = || Some("the picture shows the patches only".to_owned());
    assert_eq!(why_not(true, None, None), None);
    for sees in [Reason::Obstructed, Reason::Learning, Reason::Relearning] {
        assert_eq!(why_not(true, None, Some(sees)), None);
    }
    let moved = why_not(true, None, Some(Reason::Misaligned));
    assert_eq!(moved.unwrap(), "not watching: the camera has moved since it was calibrated");
    assert_eq!(why_not(true, None, Some(Reason::Stale)).unwrap(), "not watching: no new frames");
    assert_eq!(why_not(true, never(), Some(Reason::Stale)), never());
    assert_eq!(why_not(true, never(), None), never());
    assert_eq!(why_not(false, never(), None).unwrap(), "crossings.enabled is false");
}
