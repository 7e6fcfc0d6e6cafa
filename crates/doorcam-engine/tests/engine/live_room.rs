//! A camera that looks at a simulated doorway, frame by frame, with whatever happens in the room and to the light.
// Each test file uses only parts of it.
#![allow(dead_code)]

use std::io::Cursor;
use std::path::Path;
use std::sync::Arc;

use doorcam_core::geometry::{Doorway, Point, Side};
use doorcam_core::light::PatchPair;
use doorcam_core::optics::Transfer;
use doorcam_core::transport::PatchGrid;
use doorcam_engine::Settings;
use doorcam_engine::simulation::luminous::direct::Cylinder;
use doorcam_engine::simulation::luminous::{Renderer, Scenario, Sensor};
use doorcam_engine::{Assembly, Engine, Published, State, Work};
use doorcam_source::recording::{Layout, Manifest};
use doorcam_source::{Purpose, RawFrame, RawImages};
use jiff::Timestamp;

/// Small patches are enough, and fast.
pub const SIZE: usize = 32;

/// The demo's room with this light of the visible side, its own light times `hidden`, and a quieter camera.
pub fn scenario(visible: f64, hidden: f64) -> Scenario {
    let mut scenario = Scenario::demo();
    scenario.patch = PatchGrid { size: SIZE, ..scenario.patch };
    scenario.visible_light = [visible; 3];
    scenario.walls.iter_mut().for_each(|w| w.radiance = w.radiance.map(|v| v * hidden));
    // As many electrons per patch as in the demo, in a quarter of the pixels.
    scenario.sensor = Sensor { full_scale_electrons: 320_000.0, read_electrons: 60.0 };
    scenario
}

/// A room that is dimmer than the visible side, and one that gives most of the light.
pub fn rooms() -> [(&'static str, Scenario); 2] {
    [("dim room", scenario(0.4, 2.0)), ("bright room", scenario(0.1, 6.0))]
}

pub fn settings() -> Settings {
    let mut settings = Settings::default();
    settings.grid.intervals = 30;
    settings.patch.pixels = SIZE;
    settings
}

/// A dark person, as people are in front of a lit wall.
pub fn person([x, y]: Point) -> Cylinder {
    Cylinder { centre: [x, y], radius_m: 0.2, height_m: 1.8, radiance: [0.01, 0.012, 0.02] }
}

/// A camera with the engine behind it, and its time.
pub struct Camera {
    pub scenario: Scenario,
    pub renderer: Renderer,
    pub engine: Engine,
    pub fps: f64,
    pub frame: u64,
}

impl Camera {
    pub fn new(scenario: &Scenario, settings: &Settings, fps: f64) -> Self {
        Self::with_store(scenario, settings, fps, None)
    }

    pub fn with_store(scenario: &Scenario, settings: &Settings, fps: f64, store: Option<(&Path, &str)>) -> Self {
        let mut assembly = offline(settings).rolling(Work::InPlace);
        if let Some((path, words)) = store {
            let words = words.to_owned();
            assembly = assembly.keeping(path, move || words.clone());
        }
        let engine = assembly.for_recording(&manifest(scenario.doorway, scenario.patch.fov_m)).expect("an engine");
        Self { renderer: Renderer::new(scenario), scenario: scenario.clone(), engine, fps, frame: 0 }
    }

    pub fn seconds(&self) -> f64 {
        self.frame as f64 / self.fps
    }

    /// The update for the next frame, which shows this light.
    pub fn see(&mut self, light: &PatchPair) -> Published {
        self.see_as(light, Purpose::Live)
    }

    pub fn see_as(&mut self, light: &PatchPair, purpose: Purpose) -> Published {
        self.frame += 1;
        self.see_at(light, self.seconds(), purpose)
    }

    /// The update for a frame at some other time than the next regular one.
    pub fn see_at(&mut self, light: &PatchPair, seconds: f64, purpose: Purpose) -> Published {
        let frame = raw_frame(&self.scenario.sensor, light, self.frame, seconds, purpose);
        self.engine.step(&frame, Timestamp::UNIX_EPOCH).expect("an update")
    }

    /// The updates while this light stays for some seconds.
    pub fn look(&mut self, light: &PatchPair, seconds: f64) -> Vec<Published> {
        (0..(seconds * self.fps).round() as usize).map(|_| self.see(light)).collect()
    }

    /// The updates for some seconds of the empty room.
    pub fn empty(&mut self, seconds: f64) -> Vec<Published> {
        let light = self.renderer.empty().clone();
        self.look(&light, seconds)
    }

    /// The updates while somebody walks from one place to another.
    pub fn walk(&mut self, from: Point, to: Point, speed_m_s: f64) -> Vec<Published> {
        let length = (to[0] - from[0]).hypot(to[1] - from[1]);
        let steps = (length / speed_m_s * self.fps).ceil() as usize;
        let at = |k: usize| [0, 1].map(|i| from[i] + (to[i] - from[i]) * k as f64 / steps as f64);
        (0..=steps)
            .map(|k| {
                let light = self.renderer.render(vec![person(at(k))]);
                self.see(&light)
            })
            .collect()
    }
}

pub fn manifest(doorway: Doorway, fov_m: f64) -> Manifest {
    Manifest {
        fps: 10.0,
        layout: Layout::Patches,
        transfer: Transfer::Linear,
        size: Some([SIZE; 2]),
        doorway,
        floor_points: Vec::new(),
        lens: None,
        fov_m: Some(fov_m),
        background_frames: None,
        notes: String::new(),
    }
}

/// As offline: the given background stays fixed, frames start from the empty map, and nobody is tracked.
pub fn offline(settings: &Settings) -> Assembly {
    Assembly::new(settings.clone()).cold_starts().without_people()
}

/// A noisy frame of this light, encoded.
pub fn raw_frame(sensor: &Sensor, light: &PatchPair, number: u64, seconds: f64, purpose: Purpose) -> RawFrame {
    let mut generator = Sensor::generator(1, number);
    let images = Side::BOTH.map(|side| {
        let codes = sensor.expose(light.side(side), &mut generator);
        let bytes: Vec<u8> = codes.into_iter().flat_map(u16::to_ne_bytes).collect();
        let size = light.left.size() as u32;
        let mut png = Cursor::new(Vec::new());
        let (colour, format) = (image::ExtendedColorType::Rgb16, image::ImageFormat::Png);
        image::write_buffer_with_format(&mut png, &bytes, size, size, colour, format).expect("a PNG");
        Arc::new(png.into_inner())
    });
    RawFrame {
        index: None,
        purpose,
        seconds,
        images: RawImages::Patches(images),
        time: None,
        name: format!("frame {number}").into(),
    }
}

/// Applies a function to each value of a pair.
pub fn change(pair: &PatchPair, mut f: impl FnMut(Side, usize, f32) -> f32) -> PatchPair {
    let mut out = pair.clone();
    for side in Side::BOTH {
        for p in 0..3 {
            out.side_mut(side).plane_mut(p).iter_mut().enumerate().for_each(|(k, v)| *v = f(side, k, *v));
        }
    }
    out
}

/// Adds the light of a lamp at a place on the visible side, `share` of the mean light on the patches.
pub fn lamp(scenario: &Scenario, light: &PatchPair, [x, y, z]: [f64; 3], share: f64) -> PatchPair {
    let strength = |[px, py]: Point| z / ((px - x).powi(2) + (py - y).powi(2) + z * z).powf(1.5);
    let middle = strength([0.0, -scenario.doorway.wall_thickness_m - scenario.patch.fov_m / 2.0]);
    let mean = f64::from(light.left.data().iter().sum::<f32>()) / light.left.data().len() as f64;
    change(light, |side, k, value| {
        let point = scenario.patch.point(&scenario.doorway, side, k / SIZE, k % SIZE);
        value + (share * mean * strength(point) / middle) as f32
    })
}

pub fn states(updates: &[Published]) -> Vec<State> {
    updates.iter().map(|u| u.update.state).collect()
}

pub fn lit(update: &Published) -> usize {
    update.update.facets.len()
}
