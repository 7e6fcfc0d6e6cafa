use std::io::Cursor;
use std::path::Path;

use rayon::prelude::*;

use super::{Renderer, Scenario, Sensor, SimulationError};
use doorcam_core::geometry::Side;
use doorcam_core::optics::Transfer;
use doorcam_source::recording::{Layout, Manifest};
use doorcam_source::truth::{Target, TrueFrame, Truth};

/// Writes `frames` frames of a scenario as a recording of linear 16-bit patches with truth (docs/recordings.md).
///
/// `each` is called after each frame, on any thread. The same seed gives the same files. The manifest is written last,
/// so that an incomplete directory is not a recording.
///
/// # Errors
///
/// If `out_dir` already contains a recording, or a file cannot be encoded or written.
pub fn write_recording(
    scenario: &Scenario,
    out_dir: &Path,
    frames: u64,
    seed: u64,
    each: impl Fn() + Sync,
) -> Result<(), SimulationError> {
    let folder = out_dir.join("frames");
    if folder.exists() || out_dir.join("recording.json").exists() {
        return Err(SimulationError::Exists(out_dir.to_owned()));
    }
    std::fs::create_dir_all(&folder).map_err(|e| SimulationError::Io(folder.clone(), e))?;
    let renderer = Renderer::new(scenario);
    (0..frames).into_par_iter().try_for_each(|frame| {
        write_frame(scenario, &renderer, &folder, frame, seed)?;
        each();
        Ok::<(), SimulationError>(())
    })?;
    let truth = out_dir.join(Truth::FILE);
    let text = serde_json::to_vec(&self::truth(scenario, frames)).map_err(Into::into);
    text.and_then(|text| std::fs::write(&truth, text)).map_err(|e| SimulationError::Io(truth, e))?;
    manifest(scenario, frames, seed).write(out_dir).map_err(|e| SimulationError::Io(out_dir.join("recording.json"), e))
}

fn write_frame(
    scenario: &Scenario,
    renderer: &Renderer,
    folder: &Path,
    frame: u64,
    seed: u64,
) -> Result<(), SimulationError> {
    let people: Vec<_> = scenario.people_in(frame).into_iter().map(|(_, cylinder)| cylinder).collect();
    let pair = renderer.render(people);
    let mut generator = Sensor::generator(seed, frame);
    for side in Side::BOTH {
        let path = folder.join(format!("{frame:08}_{}.png", side.name()));
        let codes = scenario.sensor.expose(pair.side(side), &mut generator);
        let bytes: Vec<u8> = codes.into_iter().flat_map(u16::to_ne_bytes).collect();
        let size = scenario.patch.size as u32;
        let mut png = Cursor::new(Vec::new());
        let (colour, format) = (image::ExtendedColorType::Rgb16, image::ImageFormat::Png);
        image::write_buffer_with_format(&mut png, &bytes, size, size, colour, format)
            .map_err(|e| SimulationError::Image(path.clone(), e))?;
        std::fs::write(&path, png.into_inner()).map_err(|e| SimulationError::Io(path, e))?;
    }
    Ok(())
}

/// True positions of everybody in the room, frame by frame.
fn truth(scenario: &Scenario, frames: u64) -> Truth {
    let targets = |frame| {
        let people = scenario.people_in(frame).into_iter();
        people.filter(|(_, c)| scenario.is_inside(c.centre)).map(|(person, cylinder)| Target {
            id: person.id,
            x_m: cylinder.centre[0],
            y_m: cylinder.centre[1],
            radius_m: cylinder.radius_m,
            rgb: cylinder.radiance,
        })
    };
    let frame = |index| TrueFrame { index, t: scenario.seconds(index), targets: targets(index).collect() };
    Truth { frames: (0..frames).map(frame).collect(), crossings: Vec::new() }
}

fn manifest(scenario: &Scenario, frames: u64, seed: u64) -> Manifest {
    Manifest {
        fps: scenario.fps,
        layout: Layout::Patches,
        transfer: Transfer::Linear,
        size: Some([scenario.patch.size; 2]),
        doorway: scenario.doorway,
        floor_points: Vec::new(),
        lens: None,
        fov_m: Some(scenario.patch.fov_m),
        background_frames: Some([0, scenario.background_frames.min(frames)]),
        notes: format!(
            "Simulated: a self-luminous room evaluated directly from eq. 2 with first-hit occlusion; people are cylinders \
             that are not on the reconstruction grid. Noise from seed {seed}."
        ),
    }
}

#[cfg(test)]
#[path = "recording_tests.rs"]
mod tests;
