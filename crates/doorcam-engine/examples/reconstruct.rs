//! Reconstructs one frame of a recording as a map: `cargo run -p doorcam-engine --example reconstruct`
//!
//! Prints the facets that changed. Without arguments the recording is simulated. The first argument is the directory of
//! a recording, or the name or file of another scenario; the second (with feature `figures`) is an SVG file to draw the
//! map to: `cargo run -p doorcam-engine --example reconstruct -- two-crossing map.svg`

use std::error::Error;
use std::path::Path;

use doorcam_engine::simulation::{Scenario, Simulator};
use doorcam_engine::{Assembly, Settings};
use doorcam_source::recording::{Manifest, Recording};
use doorcam_source::{RawFrame, SkippedFrame, load};
use jiff::Timestamp;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (manifest, count, frame) = open(arguments.first().map_or("one-person", String::as_str))?;
    let [_, empty] = manifest.background_frames.ok_or("the recording does not say when the room is empty")?;
    let mut engine = Assembly::new(Settings::default()).cold_starts().without_people().for_recording(&manifest)?;
    // The engine learns from the frames that show the empty room.
    for number in 0..empty.min(count) {
        engine.step(&frame(number)?, Timestamp::UNIX_EPOCH)?;
    }
    // The map is that of the frame in the middle of the rest.
    let number = ((empty + count) / 2).min(count - 1);
    let published = engine.step(&frame(number)?, Timestamp::UNIX_EPOCH)?;
    let (model, scene) = (engine.watched().model, published.scene.ok_or("the room is empty throughout")?);
    println!("Frame {number}. Change of each facet that both edges see, in linear red, green and blue:");
    for (facet, rgb) in model.grid.facets.iter().zip(&scene.unified).filter(|(_, rgb)| **rgb != [0.0; 3]) {
        let ([x, y], [red, green, blue]) = (facet.midpoint(), rgb);
        println!("  x {x:5.2} m, y {y:4.2} m: {red:+.3} {green:+.3} {blue:+.3}");
    }
    #[cfg(feature = "figures")]
    if let Some(file) = arguments.get(1) {
        use doorcam_engine::figures::{ReconstructionPicture, reconstruction_svg};
        let (difference, caption) = (published.difference.as_ref(), format!("Frame {number}"));
        std::fs::write(file, reconstruction_svg(&ReconstructionPicture::of(&model, &scene, difference, &caption)))?;
    }
    Ok(())
}

/// Loads or makes the frame with this number.
type Frames = Box<dyn Fn(u64) -> Result<RawFrame, SkippedFrame>>;

/// A recording or a scenario: what is known of it beforehand, the number of frames, and the frames.
fn open(name: &str) -> Result<(Manifest, u64, Frames), Box<dyn Error>> {
    if Path::new(name).is_dir() {
        let recording = Recording::open(Path::new(name))?;
        let (manifest, count) = (recording.manifest.clone(), recording.frames.len() as u64);
        return Ok((manifest, count, Box::new(move |k| load(&recording, &recording.frames[k as usize]))));
    }
    let simulator = Simulator::new(Scenario::load(name)?, 1)?;
    Ok((simulator.manifest().clone(), simulator.scenario().frames(), Box::new(move |k| simulator.frame(k))))
}
