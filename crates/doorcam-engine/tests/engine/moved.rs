//! Cameras that are nudged while they watch.

use std::sync::Arc;

use doorcam_core::calibration::Calibration;
use doorcam_core::image::{Image, Samples};
use doorcam_core::tracking::{EventKind, TrackState};
use doorcam_engine::simulation::{Scenario, Simulator};
use doorcam_engine::{Assembly, Engine, Settings, State, Update, Work};
use doorcam_source::image::decode;
use doorcam_source::recording::Recording;
use doorcam_source::truth::TrueFrame;
use doorcam_source::{RawFrame, RawImages};
use jiff::Timestamp;

use crate::reference;

/// The simulated doorway, seen by a camera whose line of sight is turned by so many metres on the floor, and rolled.
fn seen_by(scenario: &str, aside_m: [f64; 2], roll_deg: f64) -> Simulator {
    let mut scenario = Scenario::load(scenario).unwrap();
    scenario.background_s = 3.0;
    let camera = &mut scenario.camera;
    camera.look_at_m = [0, 1].map(|k| camera.look_at_m[k] + aside_m[k]);
    camera.roll_deg += roll_deg;
    Simulator::new(scenario, 1).unwrap()
}

fn settings() -> Settings {
    let mut settings = Settings::default();
    settings.patch.pixels = 32;
    settings
}

fn rolling(simulator: &Simulator) -> Engine {
    Assembly::new(settings()).rolling(Work::InPlace).for_recording(simulator.manifest()).unwrap()
}

/// Distance of the farthest confirmed person from everybody who is there; infinite if nobody is.
fn falsest(update: &Update, truth: &TrueFrame) -> f64 {
    let confirmed = update.tracks.iter().filter(|track| track.state == TrackState::Confirmed);
    let nearest = |track: &doorcam_core::tracking::Track| {
        let distances = truth.targets.iter().map(|target| (track.x_m - target.x_m).hypot(track.y_m - target.y_m));
        distances.fold(f64::INFINITY, f64::min)
    };
    confirmed.map(nearest).fold(0.0, f64::max)
}

/// How far the points of a calibration are from those of another camera, at most, in pixels.
fn farthest_px(calibration: &Calibration, camera: &Simulator) -> f64 {
    let points = &camera.manifest().floor_points;
    let of = |floor_m| points.iter().find(|point| point.floor_m == floor_m);
    let distances = calibration.floor_points.iter().filter_map(|point| {
        let there = of(point.floor_m)?.pixel;
        Some((point.pixel[0] - there[0]).hypot(point.pixel[1] - there[1]))
    });
    distances.fold(0.0, f64::max)
}

#[test]
fn a_calibration_follows_a_camera_that_was_nudged() {
    let before = seen_by("one-person", [0.0; 2], 0.0);
    for (aside_m, roll_deg) in [([0.008, 0.0], 0.0), ([-0.004, 0.008], 0.0), ([0.0, 0.0], 1.0), ([0.006, -0.006], -0.5)]
    {
        let after = seen_by("one-person", aside_m, roll_deg);
        let named = format!("{aside_m:?}, {roll_deg} degrees");
        let mut engine = rolling(&before);
        let (mut noticed, mut watched) = (None, None);
        for number in 0..100 {
            let bumped = number >= 45;
            let frame = if bumped { &after } else { &before }.frame(number).unwrap();
            let update = engine.step(&frame, Timestamp::UNIX_EPOCH).unwrap().update;
            let told = update.events.iter().filter(|event| event.kind == EventKind::CameraMoved).count();
            let false_m = falsest(&update, &before.truth(number));
            assert!(false_m < 0.7, "{named}, frame {number}: somebody is confirmed {false_m:.1} m from anybody");
            if let Some(followed) = engine.take_followed() {
                assert!(bumped && noticed.is_none(), "{named}, frame {number}");
                let moved = update.camera_moved.unwrap();
                assert!(moved.corrected, "{named}");
                assert_eq!(told, 1, "{named}: {:?}", update.events);
                let (error, was) =
                    (farthest_px(&followed, &after), farthest_px(&before.manifest().calibration().unwrap(), &after));
                eprintln!("{named}: noticed in frame {number}, off by {error:.2} of {was:.1} px: {moved:?}");
                assert!(error < 0.6, "{named}: {error:.2} px");
                noticed = Some(number);
            } else {
                assert_eq!(told, 0, "{named}, frame {number}");
            }
            if bumped && noticed.is_some() && update.state == State::Watching {
                watched.get_or_insert(number);
            }
        }
        assert!(noticed.is_some_and(|number| number < 45 + 20), "{named}: {noticed:?}");
        assert!(watched.is_some_and(|number| number < 45 + 50), "{named}: {watched:?}");
    }
}

#[test]
fn a_camera_that_was_turned_away_shows_no_map_until_it_is_back() {
    let (before, after) = (seen_by("one-person", [0.0; 2], 0.0), seen_by("one-person", [0.0, 0.05], 2.0));
    let was = farthest_px(&before.manifest().calibration().unwrap(), &after);
    let mut engine = rolling(&before);
    let (mut states, mut told) = (Vec::new(), Vec::new());
    for number in 0..100 {
        let frame = if (45..75).contains(&number) { &after } else { &before }.frame(number).unwrap();
        let update = engine.step(&frame, Timestamp::UNIX_EPOCH).unwrap().update;
        if update.state == State::Misaligned {
            assert!(update.facets.is_empty() && update.tracks.iter().all(|track| track.state != TrackState::Confirmed));
        }
        if number == 74 {
            let moved = update.camera_moved.unwrap();
            eprintln!("{moved:?}, at most {was:.1} px");
            let (shift_px, rotation_deg) = (moved.shift_px.unwrap(), moved.rotation_deg.unwrap());
            assert!(!moved.corrected && (shift_px - was).abs() < 0.3 * was && (rotation_deg.abs() - 2.0).abs() < 0.8);
        }
        let events = update.events.iter().filter(|event| event.kind == EventKind::CameraMoved);
        told.extend(events.map(|event| (event.track, event.sequence)));
        states.push((update.state, update.camera_moved.is_some()));
    }
    assert!(engine.take_followed().is_none());
    assert_eq!(told.len(), 1, "turned away, and back: {told:?}");
    assert_eq!(told[0].0, 0, "it is of no person");
    assert!(states[..45].iter().all(|state| *state != (State::Misaligned, true)));
    let noticed = states.iter().position(|(_, moved)| *moved);
    assert!(noticed.is_some_and(|number| (46..65).contains(&number)), "{noticed:?}");
    assert!(states[65..75].iter().all(|state| *state == (State::Misaligned, true)));
    assert_eq!(states[99], (State::Watching, false));
}

#[test]
fn nothing_that_happens_in_a_room_moves_the_camera() {
    for scenario in ["lamp-switched", "busy-doorway", "flicker", "four-people"] {
        let simulator = seen_by(scenario, [0.0; 2], 0.0);
        let assembly = Assembly::new(settings()).without_people().rolling(Work::InPlace);
        let mut engine = assembly.for_recording(simulator.manifest()).unwrap();
        let mut looked = false;
        for number in 0..150 {
            let published = engine.step(&simulator.frame(number).unwrap(), Timestamp::UNIX_EPOCH).unwrap();
            assert!(published.update.camera_moved.is_none(), "{scenario}, frame {number}");
            assert_ne!(published.update.state, State::Misaligned, "{scenario}, frame {number}");
            looked |= published.reference.is_some();
        }
        assert!(looked, "{scenario}: there is a picture to compare with");
    }
}

#[test]
fn a_camera_that_looks_at_something_else_shows_no_map() {
    let here = seen_by("one-person", [0.0; 2], 0.0);
    // Shelves: rectangles of different greys.
    let grey = |x: usize, y: usize| [40 + ((x / 53 * 7 + y / 37 * 11) % 13 * 15) as u8; 3];
    let [width, height] = here.scenario().camera.size;
    let codes = (0..height).flat_map(|y| (0..width).flat_map(move |x| grey(x, y))).collect();
    let shelves = Image { width, height, samples: Samples::Eight(codes) };
    let shelves = RawImages::Camera(Arc::new(doorcam_source::image::encode_jpeg(&shelves, 95).unwrap()));
    let mut engine = rolling(&here);
    let mut last = None;
    for number in 0..200 {
        let frame = here.frame(number).unwrap();
        let frame = if number < 45 { frame } else { RawFrame { images: shelves.clone(), ..frame } };
        let update = engine.step(&frame, Timestamp::UNIX_EPOCH).unwrap().update;
        last = Some((update.state, update.camera_moved));
    }
    let (state, moved) = last.unwrap();
    assert_eq!(state, State::Misaligned);
    let moved = moved.unwrap();
    assert_eq!((moved.shift_px, moved.corrected), (None, false));
}

#[test]
fn a_camera_that_stays_is_not_moved_by_whoever_walks_past() {
    for name in ["D1", "D2", "D3", "D4", "D5", "D6"] {
        let Some(path) = reference::data(&format!("rendered/{name}")) else { continue };
        let recording = Recording::open(&path).unwrap();
        let assembly = Assembly::new(settings()).without_people();
        let mut engine = assembly.for_recording(&recording.manifest).unwrap();
        let mut looked = false;
        for entry in &recording.frames {
            let frame = doorcam_source::load(&recording, entry).unwrap();
            let published = engine.step(&frame, Timestamp::UNIX_EPOCH).unwrap();
            assert_ne!(published.update.state, State::Misaligned, "{name}, frame {}", entry.index);
            assert!(published.update.camera_moved.is_none(), "{name}, frame {}", entry.index);
            looked |= published.reference.is_some();
        }
        assert!(looked, "{name}: there is a picture to compare with");
    }
}

/// A frame whose picture is moved by whole pixels.
fn shifted(frame: &RawFrame, [right, down]: [i64; 2]) -> RawFrame {
    let RawImages::Camera(bytes) = &frame.images else { panic!("a camera's frame") };
    let Image { width, height, samples } = decode(bytes).unwrap();
    let codes = samples.to_eight();
    let from = |at: i64, by: i64, size: usize| (at - by).clamp(0, size as i64 - 1) as usize;
    let mut moved = Vec::with_capacity(codes.len());
    for y in 0..height as i64 {
        for x in 0..width as i64 {
            let at = 3 * (from(y, down, height) * width + from(x, right, width));
            moved.extend_from_slice(&codes[at..at + 3]);
        }
    }
    let image = Image { width, height, samples: Samples::Eight(moved) };
    let bytes = doorcam_source::image::encode_jpeg(&image, 98).unwrap();
    RawFrame { images: RawImages::Camera(Arc::new(bytes)), ..frame.clone() }
}

#[test]
fn people_in_rendered_rooms_are_found_as_well_after_a_nudge() {
    // Shifted pictures are compressed a second time, in both runs.
    for (name, by) in [("D1", [4, 0]), ("D1", [-3, 3]), ("D2", [0, -4]), ("D3", [4, 2])] {
        let Some(path) = reference::data(&format!("rendered/{name}")) else { continue };
        let recording = Recording::open(&path).unwrap();
        let truth = doorcam_source::truth::Truth::of_recording(&path).unwrap().unwrap();
        let [_, from] = recording.manifest.background_frames.unwrap();
        let bump = from + 5;
        // Mean distance of the people from the nearest confirmed track, from 2 s after the bump on, and how many are found.
        let run = |by: [i64; 2]| {
            let mut engine = Assembly::new(Settings::default()).for_recording(&recording.manifest).unwrap();
            let (mut sum, mut found, mut people) = (0.0, 0, 0);
            for entry in &recording.frames {
                let frame = doorcam_source::load(&recording, entry).unwrap();
                let frame = if entry.index >= bump { shifted(&frame, by) } else { frame };
                let update = engine.step(&frame, Timestamp::UNIX_EPOCH).unwrap().update;
                let there = truth.frames.iter().find(|frame| frame.index == entry.index);
                for target in there.iter().flat_map(|there| &there.targets).filter(|_| entry.index >= bump + 10) {
                    let tracks = update.tracks.iter().filter(|track| track.state == TrackState::Confirmed);
                    let distances = tracks.map(|track| (track.x_m - target.x_m).hypot(track.y_m - target.y_m));
                    let nearest = distances.fold(f64::INFINITY, f64::min);
                    people += 1;
                    if nearest < 0.5 {
                        (sum, found) = (sum + nearest, found + 1);
                    }
                }
            }
            assert_eq!(engine.take_followed().is_some(), by != [0, 0], "{name}");
            (sum / f64::from(found), f64::from(found) / f64::from(people))
        };
        let (still, moved) = (run([0, 0]), run(by));
        eprintln!(
            "{name} moved by {by:?}: error {:.3} m, before {:.3} m; found {:.2}, {:.2}",
            moved.0, still.0, moved.1, still.1
        );
        assert!(moved.0 <= 1.2 * still.0 && moved.1 >= still.1 - 0.1, "{name} {by:?}");
    }
}
