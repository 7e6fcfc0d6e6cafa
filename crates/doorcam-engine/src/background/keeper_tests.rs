//! What lies on the floor of a simulated doorway, and the background that the keeper makes of it.

use std::sync::Arc;

use super::keeper::Keeper;
use super::{FrameLight, Work};
use crate::simulation::luminous::direct::Cylinder;
use crate::simulation::luminous::{Renderer, Scenario, Sensor};
use crate::{Model, Reconstruction, Reconstructor, Settings, State};
use doorcam_core::geometry::Side;
use doorcam_core::light::{PatchPair, Usable};
use doorcam_core::transport::PatchGrid;
use doorcam_source::Purpose;

const SIZE: usize = 32;
const FPS: f64 = 10.0;
const COVER_S: f64 = 4.0;

struct Camera {
    sensor: Sensor,
    renderer: Renderer,
    keeper: Keeper,
    reconstructor: Reconstructor,
    frame: u64,
}

impl Camera {
    /// After it has watched the empty room for ten seconds.
    fn new() -> Self {
        let mut scenario = Scenario::demo();
        scenario.patch = PatchGrid { size: SIZE, ..scenario.patch };
        scenario.visible_light = [0.4; 3];
        scenario.walls.iter_mut().for_each(|w| w.radiance = w.radiance.map(|v| v * 2.0));
        scenario.sensor = Sensor { full_scale_electrons: 320_000.0, read_electrons: 60.0 };
        let mut settings = Settings::default();
        settings.grid.intervals = 30;
        settings.patch.pixels = SIZE;
        settings.background.cover_s = COVER_S;
        settings.background.adapt_s = 5.0;
        let model = Arc::new(Model::new(&settings, scenario.doorway, scenario.patch, None).unwrap());
        let mut reconstructor = Reconstructor::new(model, false);
        let keeper = Keeper::new(&settings.background, None, Work::InPlace, 0.0, &mut reconstructor);
        let renderer = Renderer::new(&scenario);
        let mut camera = Self { sensor: scenario.sensor, renderer, keeper, reconstructor, frame: 0 };
        let empty = camera.renderer.empty().clone();
        (0..100).for_each(|_| drop(camera.see(&empty, None)));
        assert_eq!(camera.keeper.state(), State::Watching);
        camera
    }

    fn see(&mut self, light: &PatchPair, usable: Option<&Usable>) -> Option<Reconstruction> {
        self.frame += 1;
        let mut generator = Sensor::generator(1, self.frame);
        let mut pair = PatchPair::zeros(SIZE);
        for side in Side::BOTH {
            let codes = self.sensor.expose(light.side(side), &mut generator);
            // Codes are interleaved, patches are planes.
            for (k, rgb) in codes.chunks_exact(3).enumerate() {
                (0..3).for_each(|p| pair.side_mut(side).plane_mut(p)[k] = f32::from(rgb[p]) / 65_535.0);
            }
        }
        let (seconds, purpose) = (self.frame as f64 / FPS, Purpose::Live);
        let seen = FrameLight { raw: &pair, pair: &pair, excess: 1.0, seconds, purpose, usable, busy: false };
        self.keeper.step(&seen, &mut self.reconstructor).unwrap()
    }

    /// The reference picture's green at a pixel of the left patch.
    fn reference(&self, pixel: usize) -> f32 {
        self.reconstructor.reference().unwrap().left.plane(1)[pixel]
    }
}

/// A rectangle of the left patch, away from the edge's foot.
fn is_bag(k: usize) -> bool {
    (12..24).contains(&(k / SIZE)) && (4..16).contains(&(k % SIZE))
}
const IN_BAG: usize = 18 * SIZE + 10;

fn change(light: &PatchPair, f: impl Fn(usize, f32) -> f32) -> PatchPair {
    let mut light = light.clone();
    for p in 0..3 {
        light.left.plane_mut(p).iter_mut().enumerate().for_each(|(k, v)| *v = f(k, *v));
    }
    light
}

fn with_bag(light: &PatchPair) -> PatchPair {
    change(light, |k, v| if is_bag(k) { 0.08 + 0.0001 * (k % 7) as f32 } else { v })
}

fn but(blocked: impl Fn(usize) -> bool) -> Usable {
    let mut usable = Usable::all(&[vec![true; SIZE * SIZE], vec![true; SIZE * SIZE]]);
    usable.side_mut(Side::Left).iter_mut().enumerate().for_each(|(k, usable)| *usable = !blocked(k));
    usable
}

fn somebody() -> Vec<Cylinder> {
    vec![Cylinder { centre: [0.2, 1.3], radius_m: 0.2, height_m: 1.8, radiance: [0.01, 0.012, 0.02] }]
}

/// Shows the light with these pixels blocked until they are in the background; returns the seconds that it took.
fn until_learned(camera: &mut Camera, light: &PatchPair, blocked: &Usable) -> (f64, Usable) {
    for k in 1..=(2.0 * COVER_S * FPS) as usize {
        let map = camera.see(light, Some(blocked)).expect("a map");
        assert!(map.is_empty() && camera.keeper.state() == State::Watching, "frame {k}");
        if let Some(pixels) = camera.keeper.take_uncovered() {
            assert!(camera.keeper.take_uncovered().is_none(), "told once");
            return (k as f64 / FPS, pixels);
        }
    }
    panic!("never learned");
}

#[test]
fn a_bag_is_left_out_at_once_and_learned_in_time_and_so_is_the_floor_when_it_goes() {
    let mut camera = Camera::new();
    let (empty, blocked) = (camera.renderer.empty().clone(), but(is_bag));
    let floor = camera.reference(IN_BAG);
    let there = with_bag(&empty);
    let (seconds, pixels) = until_learned(&mut camera, &there, &blocked);
    // The problem is built anew in place: the first frame after it is compared with the bag.
    assert!((COVER_S..COVER_S + 1.0).contains(&seconds), "{seconds}");
    assert!((0..SIZE * SIZE).all(|k| pixels.side(Side::Left)[k] == is_bag(k)) && pixels.count(Side::Right) == 0);
    assert!((camera.reference(IN_BAG) / 0.08 - 1.0).abs() < 0.05, "{}", camera.reference(IN_BAG));
    // All pixels count again. Nothing of the bag shows, and people do.
    for k in 0..100 {
        let map = camera.see(&there, None).expect("a map");
        assert!(map.is_empty() && map.energy < 1.3 && camera.keeper.state() == State::Watching, "frame {k}: {map:?}");
    }
    let person = with_bag(&camera.renderer.render(somebody()));
    assert!(!camera.see(&person, None).expect("a map").is_empty());
    let (seconds, _) = until_learned(&mut camera, &empty, &blocked);
    assert!((COVER_S..COVER_S + 2.0).contains(&seconds), "{seconds}");
    assert!((camera.reference(IN_BAG) / floor - 1.0).abs() < 0.02, "{} {floor}", camera.reference(IN_BAG));
}

/// The light with a bag and its soft shade over the rest of the patch.
fn with_shade(light: &PatchPair) -> PatchPair {
    change(&with_bag(light), |k, v| if is_bag(k) { v } else { v * (0.92 + 0.0025 * (k % SIZE) as f32) })
}

#[test]
fn the_shade_of_a_bag_is_learned_with_it() {
    let mut camera = Camera::new();
    let (empty, blocked) = (camera.renderer.empty().clone(), but(is_bag));
    let there = with_shade(&empty);
    assert!(!camera.see(&there, Some(&blocked)).expect("a map").is_empty(), "the shade looks like somebody");
    let mut frames = 1..(3.0 * COVER_S * FPS) as usize;
    let seconds = frames.find(|_| camera.see(&there, Some(&blocked)).expect("a map").is_empty()).unwrap() as f64 / FPS;
    // Between two rebuilds of the problem are at least five seconds.
    assert!((COVER_S..COVER_S + 6.0).contains(&seconds) && !camera.keeper.awaits_shade(), "{seconds}");
    let person = with_shade(&camera.renderer.render(somebody()));
    assert!(!camera.see(&person, None).expect("a map").is_empty());
}

#[test]
fn nobody_who_walks_while_a_bag_is_learned_becomes_a_part_of_the_room() {
    let mut camera = Camera::new();
    let blocked = but(is_bag);
    let beside = 20 * SIZE + 2;
    let floor = camera.reference(beside);
    for k in 0..(6.0 * COVER_S * FPS) as usize {
        // To and fro at 0.8 m/s.
        let x = ((0.8 * k as f64 / FPS + 0.8) % 3.2 - 1.6).abs() - 0.8;
        let person =
            somebody().into_iter().map(|body| Cylinder { centre: [x, 1.4], radiance: [0.05; 3], ..body }).collect();
        let light = with_shade(&camera.renderer.render(person));
        camera.see(&light, Some(&blocked));
        assert!((camera.reference(beside) / floor - 1.0).abs() < 0.02, "frame {k}: {}", camera.reference(beside));
    }
}

#[test]
fn what_moves_on_the_floor_is_never_learned_and_the_rest_goes_on() {
    let mut camera = Camera::new();
    let empty = camera.renderer.empty().clone();
    let floor = camera.reference(IN_BAG);
    let person = camera.renderer.render(somebody());
    // Legs that sway, for three times as long as a bag takes.
    for k in 0..(3.0 * COVER_S * FPS) as usize {
        let shift = [0, 1, 2, 1][k / 3 % 4];
        let legs = |at: usize| at % SIZE >= shift && is_bag(at - shift);
        let usable = but(legs);
        let light = if k % 20 == 19 { &person } else { &empty };
        let light = change(light, |at, v| if legs(at) { 0.05 + 0.01 * ((at - shift) % 5) as f32 } else { v });
        let map = camera.see(&light, Some(&usable)).expect("a map");
        assert_eq!(map.is_empty(), k % 20 != 19, "frame {k}");
        assert_eq!(camera.keeper.state(), State::Watching);
        assert!(camera.keeper.take_uncovered().is_none(), "frame {k}");
    }
    assert!((camera.reference(IN_BAG) / floor - 1.0).abs() < 0.02);
    // The mean, which has adapted all the time, has nothing of them either.
    let seen = (0..20).filter(|_| camera.see(&empty, None).expect("a map").is_empty()).count();
    assert_eq!(seen, 20);
}

#[test]
fn a_patch_that_is_mostly_blocked_is_no_change_of_the_light() {
    let mut camera = Camera::new();
    let empty = camera.renderer.empty().clone();
    let usable = but(|k| k / SIZE >= 12);
    // A shadow on all of the patch, of which some pixels still pass for floor.
    let shadow = change(&empty, |_, v| 0.6 * v);
    for _ in 0..20 {
        camera.see(&shadow, Some(&usable));
        assert_eq!(camera.keeper.state(), State::Watching);
    }
    (0..20).for_each(|_| assert!(camera.see(&empty, None).is_some_and(|map| map.is_empty())));
}

#[test]
fn the_light_that_changes_around_a_bag_is_learned_without_the_bag() {
    let mut camera = Camera::new();
    let (empty, blocked) = (camera.renderer.empty().clone(), but(is_bag));
    let floor = camera.reference(IN_BAG);
    let mut brighter = empty.clone();
    Side::BOTH.iter().for_each(|&s| brighter.side_mut(s).data_mut().iter_mut().for_each(|v| *v *= 1.3));
    let light = with_bag(&brighter);
    let states: Vec<State> = (0..40)
        .map(|_| {
            camera.see(&light, Some(&blocked));
            camera.keeper.state()
        })
        .collect();
    assert!(states.contains(&State::Relearning) && states[30..].iter().all(|s| *s == State::Watching), "{states:?}");
    let learned = camera.reference(IN_BAG);
    assert!((learned / (1.3 * floor) - 1.0).abs() < 0.03, "{learned} {floor}");
}
