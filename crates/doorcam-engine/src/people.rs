use jiff::{SignedDuration, Timestamp};

use crate::Settings;
use doorcam_core::geometry::Point;
use doorcam_core::tracking::{
    Detection, Direction, Event, Events, ExitReason, Occupancy, Prediction, Track, TrackState, Tracker, Zone,
};
use doorcam_core::visible::{Crossing, Walker, Walkers};

/// The tracking stage: from a frame's detections to who is where, and what they do.
pub struct People {
    tracker: Tracker,
    events: Events,
    /// Walkers on the threshold, by number, and who they are in the room.
    known: Vec<(u64, u64)>,
    /// Detections of a frame, and of walkers whom the camera itself sees.
    seen: Vec<Detection>,
    /// The tracks of the last report.
    before: Vec<Track>,
    /// Where people were in the last [`WALK_S`] seconds, oldest first.
    passed: Vec<Passed>,
    /// Half the width and the depth of what the map covers, in metres.
    walls: [f64; 2],
}

/// Where somebody was at a time.
#[derive(Debug, Clone, Copy)]
struct Passed {
    track: u64,
    seconds: f64,
    position: Point,
}

/// What the camera sees on its own side in one frame.
#[derive(Clone, Copy)]
pub(super) struct Threshold<'a> {
    /// Who is there.
    pub walkers: &'a Walkers,
    /// What has become certain.
    pub crossings: &'a [Crossing],
    /// Whether what they do to the light may look like somebody in the room.
    pub busy: bool,
    /// Whether the picture is new.
    pub looked: bool,
}

/// A walker is somebody of the room who is at most this far away, in metres.
const SAME_M: f64 = 0.9;
/// Whoever walks out was on the way to the doorway for this long before, in seconds.
const WALK_S: f64 = 1.5;
/// How far from a straight way at even speed they were at most: at the doorway, in metres, and for each second before.
const ASTRAY_M: f64 = 0.3;
const ASTRAY_M_S: f64 = 0.3;
/// Most places of people that are kept; above what people and frames of that time come to.
const MOST_PASSED: usize = 2048;
/// Somebody who has just come in is at most this far from where the picture of the threshold lets expect them, in metres.
const JUST_IN_M: f64 = 0.45;
/// Evidence of somebody whom the light clearly shows.
const CLEAR: f64 = 32.0;
/// Places nearer to each other than this, in metres, are of one body.
const SAME_BODY_M: f64 = 0.3;
/// Evidence at which it is as likely as not that an expected person was found where they are, rather than noise.
const EVEN: f64 = 12.0;
/// Somebody lost at most this far from a wall may have left through another entrance, in metres.
const AT_WALL_M: f64 = 0.4;

/// Standard deviations by which somebody has to be near a wall to be no longer known to be in the room.
const CERTAIN: f64 = 1.0;

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
        let room = settings.grid.room;
        Self {
            tracker: Tracker::new(settings.tracker),
            events: Events::new(settings.dwelling, settings.zones.clone()),
            known: Vec::new(),
            seen: Vec::new(),
            before: Vec::new(),
            passed: Vec::with_capacity(MOST_PASSED),
            walls: [room.half_width_m, room.depth_m],
        }
    }

    /// Assigns no track or event numbers below these.
    pub fn counting_from(self, track: u64, event: u64) -> Self {
        Self { tracker: self.tracker.counting_from(track), events: self.events.counting_from(event), ..self }
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

    /// Like [`Self::step`], with what the camera sees on its own side: who comes in is followed from the threshold on, who
    /// goes out is followed until there, and nobody new begins while somebody outside disturbs the light.
    pub(super) fn step_beside(
        &mut self,
        seconds: f64,
        time: Timestamp,
        detections: &[Detection],
        beside: Threshold,
    ) -> PeopleReport {
        self.seen.clear();
        self.seen.extend(detections.iter().map(weighed));
        if beside.looked {
            let of_room = beside.walkers.all().iter().filter(|w| w.is_somebody() && w.is_of_the_room());
            self.seen.extend(of_room.filter_map(sighted));
        }
        let seen = std::mem::take(&mut self.seen);
        self.tracker.step_with(seconds, &seen, !beside.busy);
        self.seen = seen;
        self.remember(seconds);
        for k in 0..self.tracker.tracks().len() {
            let track = self.tracker.tracks()[k];
            if self.is_at_wall(&track, CERTAIN) {
                self.tracker.doubt(track.id);
            }
        }
        for crossing in beside.crossings {
            self.cross(seconds, time, crossing, beside.walkers, true);
        }
        self.known.retain(|(walker, _)| beside.walkers.all().iter().any(|w| w.id == *walker));
        self.report(time)
    }

    /// The event that says that the camera has moved.
    pub(super) fn camera_moved(&mut self, time: Timestamp) -> Event {
        self.events.camera_moved(time)
    }

    /// Like [`Self::pause`]: all tracks end, but who crosses the threshold is told.
    pub(super) fn pause_beside(&mut self, seconds: f64, time: Timestamp, beside: Threshold) -> PeopleReport {
        self.tracker.reset();
        for crossing in beside.crossings {
            self.cross(seconds, time, crossing, beside.walkers, false);
        }
        self.known.retain(|(walker, _)| beside.walkers.all().iter().any(|w| w.id == *walker));
        self.report(time)
    }

    /// Tells a crossing, and follows who comes in if the room is `watched`.
    fn cross(&mut self, seconds: f64, time: Timestamp, crossing: &Crossing, walkers: &Walkers, watched: bool) {
        let walker = walkers.all().iter().find(|w| w.id == crossing.walker);
        let known = self.known.iter().find(|(walker, _)| *walker == crossing.walker).map(|(_, track)| *track);
        let at = walker.map_or([crossing.x_m, 0.0], Walker::position);
        let away = |track: &Track| (track.x_m - at[0]).hypot(track.y_m - at[1]);
        // Whoever has not been seen for a moment may be farther from where they were expected.
        let reach = |track: &Track| match track.state {
            TrackState::Tentative => 0.0,
            TrackState::Confirmed => SAME_M,
            TrackState::Coasting => SAME_M + 3.0 * (track.covariance_m2[0][0] + track.covariance_m2[1][1]).sqrt(),
        };
        let confirmed = |track: &&Track| away(track) < reach(track);
        let near = self.tracker.tracks().iter().filter(confirmed);
        let near = near.min_by(|a, b| away(a).total_cmp(&away(b))).map(|track| track.id);
        let followed = |id: &u64| self.tracker.tracks().iter().any(|track| track.id == *id);
        let walked_out = self.walked_out(crossing);
        let track = match crossing.direction {
            Direction::In if !watched => self.tracker.number(),
            Direction::In => known.filter(followed).unwrap_or_else(|| {
                let since_s = (seconds - crossing.seconds).clamp(0.0, 1.0);
                let speed = crossing.speed_m_s.clamp(0.3, 1.6);
                let velocity = [walker.map_or(0.0, |w| w.velocity()[0]).clamp(-0.7, 0.7), speed];
                let position = [crossing.x_m + velocity[0] * since_s, velocity[1] * since_s];
                match self.found_near(position) {
                    Some(found) => self.tracker.admit(found.position, velocity, &found.covariance),
                    None => self.tracker.admit(position, velocity, &[[0.03, 0.0], [0.0, 0.04]]),
                }
            }),
            Direction::Out => {
                let track = known.filter(followed).or(walked_out.filter(followed)).or(near);
                if track.is_none() {
                    // Whoever that was may be one of those who are still believed to be inside.
                    self.tracker.doubt_all();
                }
                let track = track.unwrap_or_else(|| self.tracker.number());
                self.tracker.dismiss(track);
                self.events.leaves(track, ExitReason::Door);
                track
            }
            Direction::Back => {
                let of_room = walker.is_some_and(Walker::is_of_the_room);
                known.or(near.filter(|_| of_room)).unwrap_or_else(|| self.tracker.number())
            }
        };
        self.known.retain(|(walker, _)| *walker != crossing.walker);
        self.known.push((crossing.walker, track));
        let ago = SignedDuration::try_from_secs_f64(seconds - crossing.seconds).unwrap_or_default();
        let then = time.checked_sub(ago).unwrap_or(time);
        self.events.crossed(then, track, crossing.direction, [crossing.x_m, 0.0], crossing.speed_m_s);
    }

    /// What this frame shows of somebody who has just come in and is expected at a place.
    fn found_near(&self, place: Point) -> Option<Detection> {
        let taken =
            |d: &Detection| self.tracker.tracks().iter().any(|t| distance(place_of(t), d.position) < SAME_BODY_M);
        let near = self.seen.iter().filter(|d| d.significance > CLEAR && distance(d.position, place) < JUST_IN_M);
        near.filter(|d| !taken(d)).max_by(|a, b| a.significance.total_cmp(&b.significance)).copied()
    }

    /// Keeps where everybody is now, for [`Self::walked_out`].
    fn remember(&mut self, seconds: f64) {
        self.passed.retain(|passed| (0.0..WALK_S).contains(&(seconds - passed.seconds)));
        let confirmed = self.tracker.tracks().iter().filter(|track| track.state != TrackState::Tentative);
        let passed = confirmed.map(|t| Passed { track: t.id, seconds, position: [t.x_m, t.y_m] });
        self.passed.extend(passed.take(MOST_PASSED - self.passed.len()));
    }

    /// Who was on the way that somebody came who walked out.
    fn walked_out(&self, crossing: &Crossing) -> Option<u64> {
        let speed = crossing.speed_m_s.clamp(0.3, 1.6);
        let astray = |passed: &Passed| {
            let before_s = (crossing.seconds - passed.seconds).max(0.0);
            let [x, y] = passed.position;
            (x - crossing.x_m).hypot(y - speed * before_s) / (ASTRAY_M + ASTRAY_M_S * before_s)
        };
        let all = self.passed.iter().map(|passed| (passed.track, astray(passed)));
        all.filter(|(_, astray)| *astray < 1.0).min_by(|a, b| a.1.total_cmp(&b.1)).map(|(track, _)| track)
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

    /// Whether somebody is so near a wall that they may leave through another entrance, by that many standard deviations.
    fn is_at_wall(&self, track: &Track, deviations: f64) -> bool {
        let [half_width_m, depth_m] = self.walls.map(|wall| wall - AT_WALL_M);
        let [sd_x, sd_y] = [0, 1].map(|i| track.covariance_m2[i][i].sqrt());
        track.x_m.abs() - deviations * sd_x > half_width_m || track.y_m - deviations * sd_y > depth_m
    }

    fn report(&mut self, time: Timestamp) -> PeopleReport {
        for track in &self.before {
            if self.is_at_wall(track, 0.0) && !self.tracker.tracks().iter().any(|t| t.id == track.id) {
                self.events.leaves(track.id, ExitReason::Entrance);
            }
        }
        self.before.clear();
        self.before.extend_from_slice(self.tracker.tracks());
        let mut events = Vec::new();
        self.events.observe(time, self.tracker.tracks(), self.tracker.unseen_s(), &mut events);
        PeopleReport { tracks: self.tracker.tracks().to_vec(), events, zones: self.events.occupancy().collect() }
    }
}

fn place_of(track: &Track) -> Point {
    [track.x_m, track.y_m]
}

fn distance(a: Point, b: Point) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// A detection with the covariance that its evidence is worth: what an expected person explains weakly may be noise, and
/// says little about where they are.
fn weighed(detection: &Detection) -> Detection {
    let doubt = 1.0 + (0.5 * (EVEN - detection.significance)).clamp(-50.0, 5.0).exp();
    Detection { covariance: detection.covariance.map(|row| row.map(|v| doubt * v)), ..*detection }
}

/// Where the camera itself sees somebody of the room.
fn sighted(walker: &Walker) -> Option<Detection> {
    let sighting = walker.sighting()?;
    // Bodies differ from the usual one in the same way for as long as they are seen.
    let covariance = sighting.covariance.map(|row| row.map(|v| 3.0 * v));
    (sighting.position[1] > -0.1).then_some(Detection {
        position: sighting.position,
        covariance,
        rgb: [f64::NAN; 3],
        significance: 0.0,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use doorcam_core::geometry::Doorway;
    use doorcam_core::tracking::{EventKind, Through};
    use doorcam_core::visible::Sighting;

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

    fn clear(position: Point) -> Detection {
        Detection { position, covariance: [[0.01, 0.0], [0.0, 0.01]], rgb: [-0.1; 3], significance: 50.0 }
    }

    /// Walks somebody through the picture of a doorway in steps of 0.2 s, from second `from_s` on; `place(t)` is where they
    /// are t seconds later, and `light(t)` where the light of the floor shows somebody.
    fn walk(
        people: &mut People,
        from_s: i64,
        place: impl Fn(f64) -> [f64; 2],
        seen: impl Fn([f64; 2]) -> bool,
        light: impl Fn(f64) -> Option<Point>,
    ) -> Vec<Event> {
        let doorway = Doorway { width_m: 0.9, wall_thickness_m: 0.1, height_m: None, leaf: None };
        let mut walkers = Walkers::new(&doorway);
        let mut events = Vec::new();
        for k in 0..22 {
            let t = 0.2 * k as f64;
            let position = place(t);
            let sighting = Sighting { position, covariance: [[0.01, 0.0], [0.0, 0.01]], cells: 200 };
            let sightings = if seen(position) { std::slice::from_ref(&sighting) } else { &[] };
            let now_s = from_s as f64 + t;
            let crossings = walkers.step(now_s, sightings).to_vec();
            let busy = !sightings.is_empty();
            let beside = Threshold { walkers: &walkers, crossings: &crossings, busy, looked: true };
            let found = light(t).map(|place| Detection { significance: 500.0, ..clear(place) });
            events.extend(people.step_beside(now_s, at(10 * from_s + 2 * k), found.as_slice(), beside).events);
        }
        events
    }

    #[test]
    fn who_walks_in_gets_a_number_and_a_track_and_who_walks_out_leaves_through_the_door() {
        let mut people = people();
        let seen = |[_, y]: [f64; 2]| (-1.0..0.3).contains(&y);
        let events = walk(&mut people, 0, |t| [0.0, (-2.0 + 0.8 * t).min(1.5)], seen, |_| None);
        let told: Vec<_> = events.iter().map(|e| (e.kind, e.track)).collect();
        assert_eq!(told, [(EventKind::CrossIn, 1), (EventKind::Enter, 1)]);
        let crossing = &events[0];
        assert!((crossing.time.as_millisecond() - 2500).abs() < 200, "{crossing:?}");
        assert!(crossing.speed_m_s.is_some_and(|speed| (speed - 0.8).abs() < 0.2), "{crossing:?}");
        let track = people.tracker.tracks()[0];
        assert!((track.x_m.abs() < 0.4) && track.y_m > 0.2, "{track:?}");
        // Somebody who was in the room walks out.
        people.tracker.dismiss(1);
        let id = people.tracker.admit([0.0, 0.4], [0.0, -0.8], &[[0.02, 0.0], [0.0, 0.02]]);
        let events = walk(&mut people, 5, |t| [0.0, 0.4 - 0.8 * t], seen, |_| None);
        let exits: Vec<_> = events.iter().filter(|e| e.kind == EventKind::Exit && e.track == id).collect();
        assert_eq!((exits[0].through, exits[0].reason), (Some(Through::Door), Some(ExitReason::Door)));
        assert!(events.iter().any(|e| e.kind == EventKind::CrossOut && e.track == id), "{events:?}");
    }

    #[test]
    fn who_is_lost_at_a_wall_may_have_left_through_another_entrance() {
        let mut people = people();
        let position = [1.35, 1.5];
        let seen = Detection { position, covariance: [[0.01, 0.0], [0.0, 0.01]], rgb: [-0.1; 3], significance: 50.0 };
        (0..10).for_each(|k| drop(people.step(0.1 * k as f64, at(k), &[seen])));
        let lost = (10..60).flat_map(|k| people.step(0.1 * k as f64, at(k), &[]).events);
        let exits: Vec<_> = lost.filter(|e| e.kind == EventKind::Exit).collect();
        assert_eq!((exits[0].through, exits[0].reason), (None, Some(ExitReason::Entrance)));
    }

    #[test]
    fn who_was_on_the_way_out_has_left_even_if_the_light_last_showed_them_elsewhere() {
        let mut people = people();
        let id = people.tracker.admit([0.1, 1.0], [1.1, 0.3], &[[0.01, 0.0], [0.0, 0.01]]);
        let stray = |t: f64| Some([0.1 + 1.1 * t, 1.0 + 0.3 * t]).filter(|_| t < 2.0);
        let events = walk(&mut people, 0, |t| [0.1, 1.0 - 0.8 * t], |[_, y]| (-1.0..0.15).contains(&y), stray);
        let out: Vec<_> = events.iter().filter(|e| e.kind == EventKind::CrossOut).map(|e| e.track).collect();
        assert_eq!(out, [id], "{events:?}");
    }

    #[test]
    fn when_a_stranger_walks_out_nobody_is_known_to_be_inside_any_more() {
        let mut people = people();
        let known = |people: &People| people.predictions(5.0).all(|p| p.known);
        people.tracker.admit([-0.9, 2.4], [0.0, 0.0], &[[0.01, 0.0], [0.0, 0.01]]);
        assert!(known(&people));
        let inside = |_| Some([-0.9, 2.4]);
        let events = walk(&mut people, 0, |t| [0.1, 0.4 - 0.8 * t], |[_, y]| (-1.0..0.15).contains(&y), inside);
        assert!(events.iter().any(|e| e.kind == EventKind::CrossOut && e.track == 2), "{events:?}");
        assert!(!known(&people) && people.predictions(5.0).count() == 1);
    }

    #[test]
    fn who_is_at_a_side_wall_may_leave_there_unseen() {
        let mut people = people();
        people.tracker.admit([1.3, 1.5], [0.0, 0.0], &[[0.01, 0.0], [0.0, 0.01]]);
        walk(&mut people, 0, |_| [9.0, 9.0], |_| false, |t| Some([1.3, 1.5]).filter(|_| t < 0.5));
        assert!(people.predictions(4.4).all(|p| !p.known));
    }

    #[test]
    fn who_comes_in_is_followed_from_where_the_light_shows_them() {
        let mut people = people();
        let place = |t: f64| [0.0, (-2.0 + 0.8 * t).min(1.5)];
        // The picture is 0.25 m off, the light is right.
        let light = |t: f64| Some([-0.25, place(t)[1]]).filter(|[_, y]| *y > 0.15);
        walk(&mut people, 0, place, |[_, y]| (-1.0..0.12).contains(&y), light);
        let [track] = people.tracker.tracks() else { panic!("{:?}", people.tracker.tracks()) };
        assert!((track.x_m + 0.25).abs() < 0.06, "{track:?}");
    }

    #[test]
    fn weak_evidence_says_little_about_a_place() {
        let spread =
            |significance: f64| weighed(&Detection { significance, ..clear([0.0, 1.0]) }).covariance[0][0] / 0.01;
        assert!((spread(60.0) - 1.0).abs() < 1e-6 && (spread(EVEN) - 2.0).abs() < 1e-9);
        assert!(spread(0.0) > 100.0 && spread(-1e9).is_finite() && spread(1e9) >= 1.0);
    }
}
