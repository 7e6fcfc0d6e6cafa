//! Simulated walks with known noise, run through the tracker.

use proptest::prelude::*;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use rand_distr::{Distribution, StandardNormal};

use super::{Covariance, Detection, Track, TrackState, Tracker, TrackerSettings};
use crate::geometry::{Point, Room};
use crate::scene::Rgb;

const SETTINGS: TrackerSettings = TrackerSettings {
    room: Room { half_width_m: 1.5, depth_m: 3.0 },
    margin_m: 0.2,
    body_radius_m: 0.2,
    confirm_s: 0.4,
    coast_s: 1.5,
    max_people: 8,
};
const GREY: Rgb = [-0.03, -0.03, -0.03];
const RED: Rgb = [-0.005, -0.04, -0.04];

/// Errors typical of a doorway's geometry: 12 cm along the line of sight, 4 cm across.
fn covariance([x, y]: Point) -> Covariance {
    let range2 = x * x + y * y;
    let (along, across) = (0.12_f64.powi(2), 0.04_f64.powi(2));
    let both = |a: f64, b: f64, one: f64| across * one + (along - across) * a * b / range2;
    [[both(x, x, 1.0), both(x, y, 0.0)], [both(x, y, 0.0), both(y, y, 1.0)]]
}

fn at(position: Point, rgb: Rgb) -> Detection {
    Detection { position, covariance: covariance(position), rgb, significance: 60.0 }
}

/// Detections with noise, misses and false alarms.
struct Noise(ChaCha8Rng);

impl Noise {
    fn new(seed: u64) -> Self {
        Self(ChaCha8Rng::seed_from_u64(seed))
    }

    fn uniform(&mut self) -> f64 {
        self.0.next_u64() as f64 / u64::MAX as f64
    }

    fn normal(&mut self) -> f64 {
        StandardNormal.sample(&mut self.0)
    }

    fn seen(&mut self, [x, y]: Point, rgb: Rgb) -> Detection {
        let range = x.hypot(y);
        let (along, across) = (0.12 * self.normal(), 0.04 * self.normal());
        let place = [x + (along * x - across * y) / range, y + (along * y + across * x) / range];
        Detection { position: place, ..at([x, y], rgb.map(|v| v + 0.004 * self.normal())) }
    }

    fn anywhere(&mut self) -> Detection {
        let place = [3.0 * self.uniform() - 1.5, 0.3 + 2.7 * self.uniform()];
        let rgb = [self.normal(), self.normal(), self.normal()].map(|v| 0.01 * v);
        Detection { significance: 15.0, ..at(place, rgb) }
    }
}

fn tracker() -> Tracker {
    Tracker::new(SETTINGS)
}

fn confirmed(tracker: &Tracker) -> Vec<Track> {
    tracker.tracks().iter().filter(|t| t.state != TrackState::Tentative).copied().collect()
}

fn nearest(tracks: &[Track], [x, y]: Point) -> Option<Track> {
    let far = |t: &Track| (t.x_m - x).hypot(t.y_m - y);
    tracks.iter().copied().filter(|t| far(t) < 0.5).min_by(|a, b| far(a).total_cmp(&far(b)))
}

/// A walk in a circle at 0.9 m/s.
fn round(t: f64) -> Point {
    [0.8 * (1.1 * t).cos(), 1.6 + 0.8 * (1.1 * t).sin()]
}

#[test]
fn somebody_who_walks_is_one_track_from_half_a_second_on() {
    for fps in [5.0, 10.0, 15.0, 30.0] {
        let (mut tracker, mut noise) = (tracker(), Noise::new(1));
        let (mut square, mut inside, mut count) = (0.0, 0, 0);
        for k in 0..(60.0 * fps) as usize {
            let t = k as f64 / fps;
            tracker.step(t, &[noise.seen(round(t), GREY)]);
            if t < 0.61 {
                continue;
            }
            let [track] = confirmed(&tracker)[..] else { panic!("{fps} {t}: {:?}", tracker.tracks()) };
            assert_eq!((track.id, track.state), (1, TrackState::Confirmed));
            let [x, y] = round(t);
            let (dx, dy) = (x - track.x_m, y - track.y_m);
            let [[xx, xy], [_, yy]] = track.covariance_m2;
            let distance2 = (yy * dx * dx - 2.0 * xy * dx * dy + xx * dy * dy) / (xx * yy - xy * xy);
            inside += usize::from(distance2 < 5.991);
            square += dx * dx + dy * dy;
            count += 1;
        }
        let (error, share) = ((square / count as f64).sqrt(), inside as f64 / count as f64);
        // The detections' own error is 0.126 m.
        assert!(error < 0.11, "{fps} frames a second: {error}");
        assert!(share > 0.85, "{fps} frames a second: {share} inside the 95 % ellipse");
    }
}

#[test]
fn confirmation_takes_time_not_frames() {
    for (fps, latest) in [(5.0, 0.6), (10.0, 0.6), (15.0, 0.6), (30.0, 0.6)] {
        let mut late = 0;
        for seed in 0..200 {
            let (mut tracker, mut noise) = (tracker(), Noise::new(seed));
            // Four of five frames show them, including the first.
            let found = (0..).map(|k| f64::from(k) / fps).find(|&t| {
                let seen = t == 0.0 || noise.uniform() < 0.8;
                let detection = noise.seen(round(t), GREY);
                tracker.step(t, if seen { std::slice::from_ref(&detection) } else { &[] });
                !confirmed(&tracker).is_empty()
            });
            let found = found.unwrap();
            assert!(found > 0.39, "{found}");
            late += usize::from(found > latest + 0.01);
        }
        // At 5 frames a second, two of the three frames after the first must show them: 90 % of cases.
        assert!(late <= 40, "{fps} frames a second: {late} of 200 after {latest} s");
    }
}

#[test]
fn half_of_the_frames_are_enough() {
    let mut broken = 0;
    for seed in 0..40 {
        let (mut tracker, mut noise) = (tracker(), Noise::new(seed));
        let mut there = 0;
        let mut frames = 0;
        for k in 0..450 {
            let t = k as f64 / 15.0;
            let detection = noise.seen(round(t), GREY);
            let seen = noise.uniform() < 0.5;
            tracker.step(t, if seen { std::slice::from_ref(&detection) } else { &[] });
            if t > 1.5 {
                frames += 1;
                there += usize::from(nearest(&confirmed(&tracker), round(t)).is_some());
            }
        }
        let ids = tracker.tracks().iter().map(|t| t.id).max().unwrap_or(0);
        broken += usize::from(there * 100 < frames * 99 || confirmed(&tracker).len() != 1 || ids > 3);
    }
    assert!(broken <= 2, "{broken} of 40 walks");
}

#[test]
fn false_detections_alone_make_nobody() {
    // Hours with a false detection in one frame of 25, anywhere.
    let mut confirmations = 0;
    for (fps, seed) in [(5.0, 3), (15.0, 4)] {
        let (mut tracker, mut noise) = (tracker(), Noise::new(seed));
        for k in 0..(4.0 * 3600.0 * fps) as usize {
            let false_one = noise.uniform() < 0.04;
            let detection = noise.anywhere();
            tracker.step(k as f64 / fps, if false_one { std::slice::from_ref(&detection) } else { &[] });
            confirmations += confirmed(&tracker).len();
        }
    }
    assert_eq!(confirmations, 0);
}

/// Lets two people pass each other; returns whether each keeps one track to the end.
fn crossing(seed: u64, colours: [Rgb; 2], passing_m: f64, merge_m: f64, speed: f64) -> bool {
    let (mut tracker, mut noise) = (tracker(), Noise::new(seed));
    let mut ids: [Option<u64>; 2] = [None; 2];
    let frames = (2.4 / speed * 15.0) as usize;
    for k in 0..frames {
        let t = k as f64 / 15.0;
        let across = -1.2 + speed * t;
        let places = [[across, 1.5 - passing_m / 2.0], [-across, 1.5 + passing_m / 2.0]];
        let [a, b] = [noise.seen(places[0], colours[0]), noise.seen(places[1], colours[1])];
        let apart = (places[0][0] - places[1][0]).hypot(places[0][1] - places[1][1]);
        if apart < merge_m {
            let half = |i: usize| (a.position[i] + b.position[i]) / 2.0;
            let rgb = [0, 1, 2].map(|i| (a.rgb[i] + b.rgb[i]) / 2.0);
            tracker.step(t, &[Detection { position: [half(0), half(1)], rgb, ..a }]);
        } else {
            tracker.step(t, &[b, a]);
        }
        if (0.7..0.8).contains(&t) {
            ids = places.map(|place| nearest(&confirmed(&tracker), place).map(|t| t.id));
        }
    }
    let t = (frames - 1) as f64 / 15.0;
    let ends = [[-1.2 + speed * t, 1.5 - passing_m / 2.0], [1.2 - speed * t, 1.5 + passing_m / 2.0]];
    let kept = ends.map(|place| nearest(&confirmed(&tracker), place).map(|t| t.id));
    ids[0].is_some() && ids[1].is_some() && kept == ids && confirmed(&tracker).len() == 2
}

fn kept(colours: [Rgb; 2], passing_m: f64, merge_m: f64, speed: f64) -> usize {
    (0..100).filter(|&seed| crossing(seed, colours, passing_m, merge_m, speed)).count()
}

#[test]
fn people_who_pass_one_another_keep_their_tracks() {
    assert_eq!(kept([GREY, RED], 0.5, 0.0, 0.5), 100);
    assert_eq!(kept([GREY, GREY], 0.5, 0.0, 0.5), 100);
}

#[test]
fn people_who_are_seen_as_one_while_they_pass_keep_their_tracks() {
    let (differing, alike) = (kept([GREY, RED], 0.4, 0.6, 0.8), kept([GREY, GREY], 0.4, 0.6, 0.8));
    assert!(differing >= 95, "{differing} of 100 in different colours, {alike} in one");
    assert!(alike >= 90, "{alike} of 100 in one colour");
}

#[test]
fn who_stays_is_not_drawn_to_who_has_left() {
    for beside in [[0.5, 1.6], [0.0, 2.1]] {
        let (mut exchanged, mut sum) = (0, 0.0);
        for seed in 0..50 {
            let (mut tracker, mut noise) = (tracker(), Noise::new(seed));
            let stays = [0.0, 1.6];
            let (mut square, mut count) = (0.0, 0);
            for k in 0..90 {
                let both = [noise.seen(stays, GREY), noise.seen(beside, GREY)];
                tracker.step(k as f64 / 15.0, if k < 45 { &both } else { &both[..1] });
                if k >= 45 {
                    let near = nearest(&confirmed(&tracker), stays).unwrap();
                    square += (near.x_m - stays[0]).powi(2) + (near.y_m - stays[1]).powi(2);
                    count += 1;
                }
            }
            exchanged += usize::from(confirmed(&tracker).len() != 1);
            sum += square / f64::from(count);
        }
        assert_eq!(exchanged, 0, "{beside:?}");
        // The detections' own error is 0.126 m.
        let error = (sum / 50.0_f64).sqrt();
        assert!(error < 0.15, "{beside:?}: {error}");
    }
}

#[test]
fn dropped_frames_change_little() {
    let (mut all, mut half) = (tracker(), tracker());
    let mut noise = Noise::new(9);
    let mut worst: f64 = 0.0;
    for k in 0..300 {
        let t = k as f64 / 15.0;
        let detection = noise.seen(round(t), GREY);
        all.step(t, &[detection]);
        if k % 2 == 0 {
            half.step(t, &[detection]);
            if t > 1.0 {
                let (a, b) = (confirmed(&all)[0], confirmed(&half)[0]);
                assert_eq!((a.id, b.id), (1, 1));
                worst = worst.max((a.x_m - b.x_m).hypot(a.y_m - b.y_m));
            }
        }
    }
    assert!(worst < 0.25, "{worst}");
}

#[test]
fn frames_without_time_between_them_change_nothing_but_the_average() {
    // A frame that shows nobody at the same moment as one that does is no evidence of absence.
    let mut tracker = tracker();
    for k in 0..20 {
        tracker.step(k as f64 / 10.0, &[at([0.2, 1.5], GREY)]);
    }
    let before = tracker.tracks().to_vec();
    for _ in 0..1000 {
        tracker.step(1.9, &[]);
    }
    assert_eq!(tracker.tracks(), before);
    tracker.step(1.85, &[]);
    assert_eq!(tracker.tracks(), before);
}

#[test]
fn an_unseen_person_coasts_slows_down_and_ends() {
    let mut tracker = tracker();
    let walk = |t: f64| [-1.0 + 0.8 * t, 1.5];
    let mut t = 0.0;
    while t < 1.5 {
        tracker.step(t, &[at(walk(t), GREY)]);
        t += 0.1;
    }
    let last = confirmed(&tracker)[0];
    let mut ended = None;
    for k in 1..30 {
        tracker.step(1.4 + 0.1 * k as f64, &[]);
        match confirmed(&tracker)[..] {
            [track] => {
                assert_eq!(track.id, last.id);
                assert_eq!(track.state == TrackState::Coasting, k > 2, "{k}");
                assert!(track.vx_m_s <= last.vx_m_s && track.x_m - last.x_m < 0.8);
                assert!(track.covariance_m2[0][0] > last.covariance_m2[0][0]);
                assert!((tracker.unseen_s()[0] - 0.1 * k as f64).abs() < 1e-9);
            }
            _ => {
                ended = ended.or(Some(k));
            }
        }
    }
    assert!(ended.is_some_and(|k| (14..=15).contains(&k)), "{ended:?}");
    tracker.step(5.0, &[at([0.0, 1.5], GREY)]);
    assert_eq!(tracker.tracks()[0].id, 2);
}

#[test]
fn who_leaves_the_room_ends_sooner() {
    let mut tracker = tracker();
    let mut k = 0;
    while -0.3 + 0.1 * k as f64 <= 1.5 {
        tracker.step(0.1 * k as f64, &[at([-0.3 + 0.1 * k as f64, 1.5], GREY)]);
        k += 1;
    }
    assert_eq!(confirmed(&tracker).len(), 1);
    // At 1 m/s they are 0.4 m beyond the wall after half of `coast_s`.
    for unseen in 0..8 {
        tracker.step(0.1 * (k + unseen) as f64, &[]);
    }
    assert_eq!(tracker.tracks(), []);
}

#[test]
fn nobody_begins_outside_the_room_or_in_somebody() {
    let mut tracker = tracker();
    for k in 0..20 {
        let outside = [[1.75, 1.0], [-1.75, 1.0], [0.0, -0.25], [0.0, 3.25]].map(|place| at(place, GREY));
        tracker.step(0.1 * k as f64, &outside);
        assert_eq!(tracker.tracks(), []);
    }
    for k in 20..60 {
        // One person seen as two detections, about a body's radius apart.
        tracker.step(0.1 * k as f64, &[at([0.0, 1.5], GREY), at([0.2, 1.6], GREY)]);
        assert_eq!(tracker.tracks().len(), 1);
    }
}

#[test]
fn who_stands_beside_somebody_takes_longer_and_is_found() {
    let mut tracker = tracker();
    let first = at([0.0, 2.0], GREY);
    for k in 0..20 {
        tracker.step(0.1 * k as f64, &[first]);
    }
    // 0.45 m behind: within the noise along the line of sight, but outside the body.
    let uncertain = [[0.01, 0.0], [0.0, 0.09]];
    let second = Detection { covariance: uncertain, ..at([0.0, 2.45], GREY) };
    let found = (20..60).find(|&k| {
        tracker.step(0.1 * k as f64, &[first, second]);
        confirmed(&tracker).len() == 2
    });
    assert!(found.is_some_and(|k| (28..=34).contains(&k)), "{found:?}");
}

#[test]
fn nonsense_is_survived() {
    let mut tracker = tracker();
    let good = at([0.0, 1.0], GREY);
    let wrong = [
        Detection { position: [f64::NAN, 1.0], ..good },
        Detection { position: [f64::INFINITY, 1.0], ..good },
        Detection { covariance: [[0.0; 2]; 2], ..good },
        Detection { covariance: [[1.0, 2.0], [2.0, 1.0]], ..good },
        Detection { covariance: [[f64::NAN; 2]; 2], ..good },
    ];
    tracker.step(0.0, &wrong);
    assert_eq!(tracker.tracks(), []);
    for seconds in [0.0, f64::NAN, 0.1, f64::INFINITY, 0.2, -5.0, -4.9, 1e300, -1e300, 0.0] {
        tracker.step(seconds, &[good, Detection { rgb: [f64::NAN; 3], significance: f64::NAN, ..good }]);
        assert!(tracker.tracks().iter().all(|t| t.x_m.is_finite() && t.covariance_m2[0][0].is_finite()));
        assert!(tracker.predictions(f64::NAN).all(|p| p.position[0].is_finite()));
    }
}

#[test]
fn nobody_is_followed_over_a_gap() {
    let mut tracker = tracker();
    for k in 0..20 {
        tracker.step(0.1 * k as f64, &[at([0.0, 1.5], GREY)]);
    }
    tracker.step(1.9 + 1.4, &[at([0.0, 1.5], GREY)]);
    assert_eq!(confirmed(&tracker)[0].id, 1);
    for jump in [5.0, -20.0] {
        let last = tracker.tracks()[0].id;
        tracker.step(3.3 + jump, &[at([0.0, 1.5], GREY)]);
        assert_eq!((tracker.tracks().len(), tracker.tracks()[0].id), (1, last + 1));
    }
    tracker.reset();
    assert_eq!((tracker.tracks().len(), tracker.predictions(0.0).count()), (0, 0));
    tracker.step(0.0, &[at([0.0, 1.5], GREY)]);
    assert_eq!(tracker.tracks()[0].id, 4);
}

#[test]
fn predictions_are_where_the_next_frame_will_look() {
    let mut tracker = tracker();
    for k in 0..20 {
        tracker.step(0.1 * k as f64, &[at([-0.8 + 0.08 * k as f64, 1.5], RED)]);
    }
    let prediction = tracker.predictions(2.2).next().unwrap();
    tracker.step(2.2, &[]);
    let track = tracker.tracks()[0];
    assert_eq!((prediction.position, prediction.covariance), ([track.x_m, track.y_m], track.covariance_m2));
    assert_eq!((prediction.id, prediction.rgb), (track.id, RED));
}

#[test]
fn there_are_never_more_people_than_allowed() {
    let settings = TrackerSettings { max_people: 2, ..SETTINGS };
    let mut tracker = Tracker::new(settings);
    let everywhere: Vec<Detection> =
        (0..12).map(|i| at([-1.2 + 0.8 * (i % 4) as f64, 0.8 + 0.9 * (i / 4) as f64], GREY)).collect();
    for k in 0..30 {
        tracker.step(0.1 * k as f64, &everywhere);
        assert!(tracker.tracks().len() <= 4);
    }
    assert_eq!(confirmed(&tracker).len(), 2);
}

proptest! {
    #![proptest_config(crate::testing::cases(40))]
    #[test]
    fn mirrored_rooms_have_mirrored_tracks_and_the_same_input_the_same_tracks(seed in 0..1000_u64) {
        let (mut plain, mut again, mut mirrored) = (tracker(), tracker(), tracker());
        let mut noise = Noise::new(seed);
        let flip = |d: &Detection| {
            let [[xx, xy], [yx, yy]] = d.covariance;
            Detection { position: [-d.position[0], d.position[1]], covariance: [[xx, -xy], [-yx, yy]], ..*d }
        };
        let mut t = 0.0;
        for _ in 0..60 {
            t += 0.2 * noise.uniform();
            let mut seen = vec![noise.seen(round(t), GREY), noise.seen(round(t + 2.0), RED)];
            if noise.uniform() < 0.3 {
                seen.push(noise.anywhere());
            }
            if noise.uniform() < 0.3 {
                seen.remove(0);
            }
            plain.step(t, &seen);
            again.step(t, &seen);
            mirrored.step(t, &seen.iter().map(flip).collect::<Vec<_>>());
            prop_assert_eq!(plain.tracks(), again.tracks());
            prop_assert_eq!(plain.tracks().len(), mirrored.tracks().len());
            for (a, b) in plain.tracks().iter().zip(mirrored.tracks()) {
                prop_assert_eq!((a.id, a.state), (b.id, b.state));
                prop_assert!((a.x_m + b.x_m).abs() < 1e-9 && (a.y_m - b.y_m).abs() < 1e-9);
                prop_assert!((a.vx_m_s + b.vx_m_s).abs() < 1e-9);
                prop_assert!((a.covariance_m2[0][1] + b.covariance_m2[0][1]).abs() < 1e-9);
            }
        }
    }
}

#[test]
fn who_was_seen_to_come_in_is_there_until_seen_to_leave() {
    let mut tracker = Tracker::new(SETTINGS);
    tracker.step(0.0, &[]);
    let id = tracker.admit([0.0, 0.1], [0.0, 0.8], &[[0.03, 0.0], [0.0, 0.03]]);
    let admitted = tracker.tracks()[0];
    assert_eq!((admitted.id, admitted.state), (id, TrackState::Confirmed));
    // Unseen for longer than anybody else would be followed, and found again.
    (1..=20).for_each(|k| tracker.step(0.1 * f64::from(k), &[]));
    assert_eq!((tracker.tracks()[0].id, tracker.tracks()[0].state), (id, TrackState::Coasting));
    assert!(tracker.predictions(2.1).all(|prediction| prediction.known));
    tracker.step(2.1, &[at([0.1, 1.2], GREY)]);
    assert_eq!((tracker.tracks().len(), tracker.tracks()[0].id), (1, id));
    assert!(tracker.tracks()[0].state == TrackState::Confirmed);
    tracker.dismiss(id);
    assert!(tracker.tracks().is_empty());
    assert!(tracker.number() > id, "numbers are not used again");
}

#[test]
fn nobody_begins_and_nobody_is_confirmed_while_the_light_is_disturbed() {
    let mut tracker = Tracker::new(SETTINGS);
    let seen = [at([0.3, 1.5], GREY)];
    (0..3).for_each(|k| tracker.step(0.1 * f64::from(k), &seen));
    assert_eq!(tracker.tracks()[0].state, TrackState::Tentative);
    (3..20).for_each(|k| tracker.step_with(0.1 * f64::from(k), &seen, false));
    assert!(tracker.tracks().is_empty());
    (20..40).for_each(|k| tracker.step(0.1 * f64::from(k), &seen));
    assert_eq!(tracker.tracks()[0].state, TrackState::Confirmed);
    // Who is followed already goes on.
    (40..50).for_each(|k| tracker.step_with(0.1 * f64::from(k), &seen, false));
    assert_eq!(tracker.tracks()[0].state, TrackState::Confirmed);
}
