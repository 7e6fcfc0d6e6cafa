use super::*;
use crate::watch::crossings::tests::crossing;
use doorcam_core::tracking::{EventKind, Track, TrackState};
use doorcam_source::SkipKind;

fn skipped(name: &str, kind: SkipKind) -> SkippedFrame {
    SkippedFrame::new(name, kind, "bad")
}

fn hub() -> Hub {
    let kind = crate::feed::SourceKind::V4l2;
    Hub::new(None, None, SourceInfo { spec: "v4l2:cam".into(), kind, notes: String::new(), fps: 15.0 })
}

#[test]
fn reasons_of_one_kind_have_one_line_whatever_their_names() {
    let hub = hub();
    let said: Vec<_> =
        [("a", SkipKind::Unfit), ("b", SkipKind::Unfit), ("c", SkipKind::Damaged), ("d", SkipKind::Unfit)]
            .map(|(name, kind)| hub.skipped(&skipped(name, kind)))
            .into();
    assert_eq!(said, [Some((1, 1)), None, Some((3, 1)), None]);
    let status = hub.status(0);
    assert_eq!((status.frames.skipped, status.frames.last_skipped.as_deref()), (4, Some("d: bad")));
}

/// Publishes an update in this state, with these events.
fn publish(hub: &Hub, state: State, events: &[Event]) {
    let mut update = Update::blank("signed", 0, Timestamp::now(), None, doorcam_engine::Timing::default());
    update.state = state;
    update.events.extend_from_slice(events);
    hub.publish(Published::new(update, None, None));
}

#[test]
fn who_walks_through_is_counted_once_for_everybody_who_asks() {
    let hub = hub();
    let mut changes = hub.crossing_changes();
    let report = hub.crossings();
    assert_eq!((report.available, report.reason.as_deref()), (false, Some("not watching: the source is being opened")));
    publish(&hub, State::Watching, &[]);
    assert!(hub.crossings().available && !changes.has_changed().unwrap());
    let kinds = [EventKind::CrossIn, EventKind::Enter, EventKind::CrossIn, EventKind::CrossBack, EventKind::CrossOut];
    let events: Vec<Event> = (7..).zip(kinds).map(|(k, kind)| crossing(k, kind, Timestamp::now())).collect();
    publish(&hub, State::Watching, &events);
    let report = hub.crossings();
    assert_eq!((report.came_in, report.out, report.back, report.inside), (2, 1, 1, 1));
    assert_eq!(report.last.as_ref(), events.last());
    assert_eq!(hub.status(0).crossings, report);
    assert!(hub.exposition().contains("\ndoorcam_inside 1\n"), "{}", hub.exposition());
    assert!(changes.has_changed().unwrap());
    changes.mark_unchanged();
    // Who walks through covers both patches, and is seen in the whole picture.
    publish(&hub, State::Obstructed, &[crossing(12, EventKind::CrossIn, Timestamp::now())]);
    let report = hub.crossings();
    assert_eq!((report.available, report.inside), (true, 2));
    publish(&hub, State::Misaligned, &[]);
    let report = hub.crossings();
    let why = "not watching: the camera has moved since it was calibrated";
    assert_eq!((report.available, report.reason.as_deref(), report.inside), (false, Some(why), 2));
    assert!(hub.exposition().contains("\ndoorcam_inside NaN\n"));
}

fn track(id: u64, state: TrackState) -> Track {
    let [x_m, y_m, vx_m_s, vy_m_s] = [0.5, 1.25, 0.0, 0.0];
    let covariance_m2 = [[0.01, 0.0], [0.0, 0.01]];
    Track { id, state, x_m, y_m, vx_m_s, vy_m_s, covariance_m2, rgb: [0.0; 3], age_s: 2.0 }
}

#[test]
fn no_fewer_are_inside_than_are_followed_there() {
    let hub = hub();
    let mut changes = hub.crossing_changes();
    let follow = |state, tracks: &[TrackState]| {
        let mut update = Update::blank("signed", 0, Timestamp::now(), None, doorcam_engine::Timing::default());
        update.state = state;
        update.tracks.extend((1..).zip(tracks).map(|(id, &state)| track(id, state)));
        hub.publish(Published::new(update, None, None));
    };
    use TrackState::{Coasting, Confirmed, Tentative};
    for (state, tracks, inside, is_news) in [
        (State::Watching, &[][..], 0, false),
        // They came in by another way, or before anybody looked.
        (State::Watching, &[Confirmed, Tentative, Coasting], 2, true),
        (State::Obstructed, &[Confirmed, Coasting], 2, false),
        // Nobody can be followed, and nobody has left.
        (State::Relearning, &[], 2, false),
        (State::Watching, &[Confirmed], 1, true),
    ] {
        follow(state, tracks);
        assert_eq!((hub.crossings().inside, changes.has_changed().unwrap()), (inside, is_news), "{state:?} {tracks:?}");
        assert_eq!(hub.status(0).crossings.inside, inside);
        changes.mark_unchanged();
    }
    assert!(hub.exposition().contains("\ndoorcam_inside 1\n"));
    // Set below that, it goes on telling those who are there, and is what was set once they are not.
    hub.set_inside(0, Timestamp::now());
    assert_eq!(hub.crossings().inside, 1);
    follow(State::Watching, &[]);
    assert_eq!(hub.crossings().inside, 0);
    // Above, it is what was set.
    hub.set_inside(5, Timestamp::now());
    follow(State::Watching, &[Confirmed]);
    assert_eq!(hub.crossings().inside, 5);
}

#[test]
fn crossings_that_are_turned_off_say_so() {
    let hub = hub().configured(&Config::parse("[crossings]\nenabled = false\n").unwrap());
    publish(&hub, State::Watching, &[]);
    let report = hub.crossings();
    assert_eq!((report.available, report.reason.as_deref()), (false, Some("crossings.enabled is false")));
}

#[test]
fn a_source_whose_frames_cannot_be_used_does_not_stream() {
    let hub = hub();
    let streaming = Condition { state: SourceState::Streaming, reason: None, granted: None };
    hub.condition(streaming.clone());
    let news: Vec<_> = (0..12).map(|n| hub.unusable(&skipped(&n.to_string(), SkipKind::Damaged))).collect();
    assert!(news[..9].iter().all(|news| *news == (false, None)));
    let reason = "10 frames in a row cannot be used: 9: bad".to_owned();
    assert_eq!(news[9..], [(true, Some(reason.clone())), (true, None), (true, None)]);
    let source = hub.status(0).source;
    assert_eq!((source.state, source.error), (SourceState::Stalled, Some(reason)));
    // What the source itself reports comes first.
    hub.condition(streaming);
    assert_eq!(hub.status(0).source.state, SourceState::Streaming);
}
