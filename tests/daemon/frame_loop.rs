//! The frame loop survives a panic while it processes a frame.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use doorcam::feed::{Feed, SourceSpec};
use doorcam::watch::{Hub, Status, start};
use doorcam_core::transport::PatchGrid;
use doorcam_engine::simulation::luminous::{Scenario, write_recording};
use doorcam_engine::{Assembly, Settings, Update, Work};
use doorcam_source::SourceState;

/// A recording of somebody who comes in: six frames of the empty room, then twelve more.
fn recording(directory: &Path) {
    let demo = Scenario::demo();
    let patch = PatchGrid { size: 32, ..demo.patch };
    let scenario = Scenario { fps: 2.0, background_frames: 6, patch, ..demo };
    write_recording(&scenario, directory, 18, 1, || ()).unwrap();
}

/// Runs the frame loop over the recording, with an engine that panics at the frames `panics`. Returns the update of
/// each frame and the status at the end.
fn run(directory: &Path, rolling: bool, panics: &'static [u64]) -> (BTreeMap<u64, Update>, Status) {
    let spec: SourceSpec = format!("replay:{},rate=max", directory.display()).parse().unwrap();
    let feed = Feed::open(&spec, &doorcam::config::Config::default()).unwrap();
    let mut settings = Settings::default();
    settings.grid.intervals = 30;
    let mut assembly = Assembly::new(settings).cold_starts().without_people().with_fault(|frame| {
        assert!(!frame.index.is_some_and(|index| panics.contains(&index)), "injected");
    });
    if rolling {
        assembly = assembly.rolling(Work::InPlace);
    }
    let engine = assembly.for_recording(feed.manifest().unwrap()).unwrap();
    let updates = Arc::new(Mutex::new(BTreeMap::new()));
    let told = Arc::clone(&updates);
    let hub = Hub::new(Some(engine.watched()), None, feed.info()).telling(move |update| {
        told.lock().unwrap().insert(update.frame.unwrap(), update.clone());
    });
    let hub = Arc::new(hub);
    let running = start(feed.start(), Some(engine), Arc::clone(&hub)).unwrap();
    let deadline = Instant::now() + Duration::from_secs(120);
    while hub.status(0).source.state != SourceState::Ended {
        assert!(Instant::now() < deadline, "{:?}", hub.status(0));
        std::thread::sleep(Duration::from_millis(10));
    }
    let status = hub.status(0);
    running.end();
    let updates = updates.lock().unwrap().clone();
    (updates, status)
}

#[test]
fn a_panic_costs_its_frame_and_nothing_else() {
    let directory = tempfile::tempdir().unwrap();
    recording(directory.path());
    for rolling in [false, true] {
        let (whole, status) = run(directory.path(), rolling, &[]);
        assert_eq!((status.frames.solved, status.frames.failed), (18, 0));
        // One while the empty room is learned, three in a row, one at the end.
        const PANICS: &[u64] = &[3, 9, 10, 11, 17];
        let (rest, status) = run(directory.path(), rolling, PANICS);
        assert_eq!((status.frames.captured, status.frames.solved, status.frames.failed), (18, 13, 5));
        assert!(whole.values().filter(|update| !update.facets.is_empty()).count() >= 4, "nobody came in");
        for (number, (frame, update)) in rest.iter().enumerate() {
            assert!(!PANICS.contains(frame));
            let expected = &whole[frame];
            assert_eq!((update.sequence, update.state), (number as u64, expected.state), "frame {frame}");
            // With one background frame fewer, the background differs slightly, and nothing else does.
            assert_eq!(update.facets.is_empty(), expected.facets.is_empty(), "frame {frame}");
        }
    }
}
