//! Follows people through a recording and prints who is where: `cargo run -p doorcam-engine --example follow`
//!
//! Without an argument the recording is simulated. The argument is the directory of a recording, or the name or file of
//! another scenario: `cargo run -p doorcam-engine --example follow -- four-people`

use std::error::Error;
use std::path::Path;
use std::sync::Arc;

use doorcam_core::tracking::TrackState;
use doorcam_engine::simulation::{LiveOptions, LiveSimulation, Scenario, Simulator};
use doorcam_engine::{Assembly, Settings, StepError};
use doorcam_source::recording::{Manifest, Recording};
use doorcam_source::{Pace, Replay, ReplayOptions, Source, SourceEvent, SystemClock};
use jiff::{SignedDuration, Timestamp};

/// Seconds between two lines about the same people.
const EVERY_S: f64 = 0.5;

fn main() -> Result<(), Box<dyn Error>> {
    let (manifest, mut source) = open(&std::env::args().nth(1).unwrap_or_else(|| "two-crossing".into()))?;
    let mut engine = Assembly::new(Settings::default()).for_recording(&manifest)?;
    let mut due = 0.0;
    while let Some(event) = source.next() {
        // A file gives frames, or says which ones it cannot give; cameras say more.
        let SourceEvent::Frame(frame) = event else { continue };
        // A recording has no date, so its time counts from 1970.
        let time = Timestamp::UNIX_EPOCH + SignedDuration::try_from_secs_f64(frame.seconds)?;
        let update = match engine.step(&frame, time) {
            Ok(published) => published.update,
            Err(StepError::Skipped(_)) => continue,
            Err(error) => return Err(error.into()),
        };
        for event in &update.events {
            let (x, y) = (event.x_m, event.y_m);
            println!("{:6.1} s  person {}: {:?} at x {x:.2} m, y {y:.2} m", frame.seconds, event.track, event.kind);
        }
        if frame.seconds < due {
            continue;
        }
        for track in update.tracks.iter().filter(|track| track.state != TrackState::Tentative) {
            let [[xx, _], [_, yy]] = track.covariance_m2;
            let (x, y, error) = (track.x_m, track.y_m, (xx + yy).sqrt());
            let is = if track.state == TrackState::Coasting { "should be" } else { "is" };
            println!("{:6.1} s  person {} {is} at x {x:.2} m, y {y:.2} m (± {error:.2} m)", frame.seconds, track.id);
            due = frame.seconds + EVERY_S;
        }
    }
    Ok(())
}

/// A recording or a scenario: what is known of it beforehand, and its frames.
fn open(name: &str) -> Result<(Manifest, Box<dyn Source>), Box<dyn Error>> {
    if Path::new(name).is_dir() {
        let (recording, options) =
            (Recording::open(Path::new(name))?, ReplayOptions { pace: Pace::Max, looped: false });
        let manifest = recording.manifest.clone();
        return Ok((manifest, Box::new(Replay::new(Arc::new(recording), options, SystemClock::default()))));
    }
    let (simulator, options) = (Simulator::new(Scenario::load(name)?, 1)?, LiveOptions { pace: Pace::Max, once: true });
    let manifest = simulator.manifest().clone();
    Ok((manifest, Box::new(LiveSimulation::new(Arc::new(simulator), options, SystemClock::default()))))
}
