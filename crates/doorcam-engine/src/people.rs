use jiff::Timestamp;

use crate::Settings;
use doorcam_core::tracking::{Detection, Event, Events, Occupancy, Prediction, Track, Tracker, Zone};

/// The tracking stage: from a frame's detections to who is where, and what they do.
pub struct People {
    tracker: Tracker,
    events: Events,
}

/// What an update says about people.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct PeopleReport {
    /// Everybody who is being tracked.
    pub tracks: Vec<Track>,
    /// What has happened since the previous update.
    pub events: Vec<Event>,
    /// Who is in which zone.
    pub zones: Vec<Occupancy>,
}

impl People {
    /// Starts with nobody present.
    pub fn new(settings: &Settings) -> Self {
        Self { tracker: Tracker::new(settings.tracker), events: Events::new(settings.dwelling, settings.zones.clone()) }
    }

    /// Assigns no track or event numbers below these.
    pub fn counting_from(self, track: u64, event: u64) -> Self {
        Self { tracker: self.tracker.counting_from(track), events: self.events.counting_from(event) }
    }

    /// Where people are expected at a frame's time, in seconds on the source's clock.
    pub fn predictions(&self, seconds: f64) -> impl Iterator<Item = Prediction> + '_ {
        self.tracker.predictions(seconds)
    }

    /// Seconds from the last frame to the given time; infinite before the first frame.
    pub fn elapsed_s(&self, seconds: f64) -> f64 {
        self.tracker.seconds().map_or(f64::INFINITY, |last| (seconds - last).max(0.0))
    }

    /// Processes a frame's detections; `seconds` is its time on the source's clock, `time` its time of capture.
    pub(super) fn step(&mut self, seconds: f64, time: Timestamp, detections: &[Detection]) -> PeopleReport {
        self.tracker.step(seconds, detections);
        self.report(time)
    }

    /// Processes a frame without a trustworthy map: all tracks end.
    pub(super) fn pause(&mut self, time: Timestamp) -> PeopleReport {
        self.tracker.reset();
        self.report(time)
    }

    /// Replaces `others`: tracks end, but track ids and event numbers continue.
    pub(super) fn continue_from(&mut self, others: Self) {
        self.tracker.continue_from(&others.tracker);
        self.events.continue_from(others.events);
    }

    /// Counts people in these zones from now on.
    pub(super) fn use_zones(&mut self, zones: Vec<Zone>) {
        self.events.use_zones(zones);
    }

    fn report(&mut self, time: Timestamp) -> PeopleReport {
        let mut events = Vec::new();
        self.events.observe(time, self.tracker.tracks(), self.tracker.unseen_s(), &mut events);
        PeopleReport { tracks: self.tracker.tracks().to_vec(), events, zones: self.events.occupancy().collect() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use doorcam_core::tracking::EventKind;

    fn at(tenths: i64) -> Timestamp {
        Timestamp::from_millisecond(100 * tenths).unwrap()
    }

    fn people() -> People {
        let polygon_m = vec![[-1.0, 1.0], [1.0, 1.0], [1.0, 2.0], [-1.0, 2.0]];
        People::new(&Settings { zones: vec![Zone { name: "bed".into(), id: None, polygon_m }], ..Settings::default() })
    }

    fn watch(people: &mut People, from: i64, count: i64) -> PeopleReport {
        let position = [0.0, 1.5];
        let seen = Detection { position, covariance: [[0.01, 0.0], [0.0, 0.02]], rgb: [-0.1; 3], significance: 50.0 };
        let mut report = PeopleReport::default();
        for k in from..from + count {
            let next = people.step(0.1 * k as f64, at(k), &[seen]);
            report.events.extend(next.events);
            (report.tracks, report.zones) = (next.tracks, next.zones);
        }
        report
    }

    fn kinds(events: &[Event]) -> Vec<(EventKind, u64, u64)> {
        events.iter().map(|e| (e.kind, e.sequence, e.track)).collect()
    }

    #[test]
    fn somebody_enters_and_is_in_the_zone_until_the_room_is_learned_anew() {
        let mut people = people();
        let report = watch(&mut people, 0, 10);
        assert_eq!(kinds(&report.events), [(EventKind::Enter, 0, 1), (EventKind::ZoneEnter, 1, 1)]);
        assert_eq!((report.events[0].time, report.tracks.len(), report.zones[0].people), (at(0), 1, 1));
        assert_eq!(people.predictions(1.0).count(), 1);
        let pause = people.pause(at(30));
        assert_eq!(kinds(&pause.events), [(EventKind::ZoneExit, 2, 1), (EventKind::Exit, 3, 1)]);
        assert_eq!((pause.events[1].time, pause.tracks.len(), pause.zones[0].people), (at(9), 0, 0));
        assert_eq!(watch(&mut people, 31, 10).tracks[0].id, 2);
    }

    #[test]
    fn after_another_calibration_ids_and_numbers_go_on() {
        let (mut before, mut after) = (people(), people());
        watch(&mut before, 0, 10);
        after.continue_from(before);
        let report = watch(&mut after, 10, 10);
        let expected = [(EventKind::ZoneExit, 2, 1), (EventKind::Exit, 3, 1), (EventKind::Enter, 4, 2)];
        assert_eq!(kinds(&report.events)[..3], expected);
    }
}
