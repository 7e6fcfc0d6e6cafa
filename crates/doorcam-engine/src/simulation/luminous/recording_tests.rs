use super::super::direct::{Cylinder, Wall};
use super::*;
use doorcam_core::light::PatchPair;
use doorcam_core::transport::PatchGrid;
use doorcam_source::recording::Recording;

/// The demo with fewer pixels.
fn small() -> Scenario {
    let demo = Scenario::demo();
    Scenario { patch: PatchGrid { size: 16, ..demo.patch }, ..demo }
}

fn write(seed: u64) -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    write_recording(&small(), &dir.path().join("r"), 60, seed, || ()).unwrap();
    dir
}

fn bytes(dir: &tempfile::TempDir, name: &str) -> Vec<u8> {
    std::fs::read(dir.path().join("r").join(name)).unwrap()
}

#[test]
fn an_empty_room_is_exactly_the_background() {
    let scenario = small();
    let renderer = Renderer::new(&scenario);
    assert_eq!(&renderer.render(Vec::new()), renderer.empty());
    assert_eq!(scenario.people_in(9), []);
    let first = scenario.people_in(10).into_iter().map(|(_, c)| c).collect::<Vec<_>>();
    assert_eq!(first.len(), 2);
    assert_eq!(&renderer.render(first), renderer.empty());
}

#[test]
fn a_mirrored_room_gives_mirrored_and_swapped_patches() {
    let scenario = small();
    let mirror = |[x, y]: [f64; 2]| [-x, y];
    let walls = scenario.walls.iter().map(|w| Wall { from: mirror(w.from), to: mirror(w.to), ..*w }).collect();
    let mirrored = Scenario { walls, ..scenario.clone() };
    let people: Vec<Cylinder> = scenario.people_in(100).into_iter().map(|(_, c)| c).collect();
    let there = people.iter().map(|c| Cylinder { centre: mirror(c.centre), ..*c }).collect();
    let pair = Renderer::new(&scenario).render(people);
    let flipped = Renderer::new(&mirrored).render(there);
    let size = scenario.patch.size;
    let at = |pair: &PatchPair, side, c, k: usize| f64::from(pair.side(side).plane(c)[k]);
    let mut asymmetry = 0.0_f64;
    for (side, other) in [(Side::Left, Side::Right), (Side::Right, Side::Left)] {
        for (c, k) in (0..3).flat_map(|c| (0..size * size).map(move |k| (c, k))) {
            let mirrored_k = k / size * size + size - 1 - k % size;
            let (a, b) = (at(&pair, side, c, k), at(&flipped, other, c, mirrored_k));
            assert!((a - b).abs() < 1e-7, "{side:?} {c} {k}: {a} {b}");
            asymmetry = asymmetry.max((a - at(&pair, other, c, mirrored_k)).abs());
        }
    }
    assert!(asymmetry > 1e-3, "the room is not its own mirror image: {asymmetry}");
}

#[test]
fn the_recording_opens_and_knows_the_truth() {
    let dir = write(3);
    let recording = Recording::open(&dir.path().join("r")).unwrap();
    assert!(recording.unknown_keys.is_empty());
    assert_eq!((recording.frames.len(), recording.manifest.background_frames), (60, Some([0, 10])));
    assert!(recording.manifest.notes.starts_with("Simulated: a self-luminous room"));
    let image = doorcam_source::image::decode(&bytes(&dir, "frames/00000042_right.png")).unwrap();
    assert_eq!((image.width, image.height), (16, 16));
    assert!(matches!(image.samples, doorcam_core::image::Samples::Sixteen(_)));
    let truth: serde_json::Value = serde_json::from_slice(&bytes(&dir, "truth.json")).unwrap();
    let scenario = small();
    for frame in 0..60 {
        let entry = &truth["frames"][frame as usize];
        assert_eq!(entry["index"], frame);
        let inside = |c: &Cylinder| c.centre[0].abs() < 1.5;
        let expected: Vec<_> = scenario.people_in(frame).into_iter().filter(|(_, c)| inside(c)).collect();
        let targets = entry["targets"].as_array().unwrap();
        assert_eq!(targets.len(), expected.len(), "frame {frame}");
        for (target, (person, cylinder)) in targets.iter().zip(expected) {
            let near = |key: &str, value: f64| target[key].as_f64().is_some_and(|v| (v - value).abs() < 1e-12);
            assert_eq!(target["id"], person.id);
            assert!(near("x_m", cylinder.centre[0]) && near("y_m", cylinder.centre[1]), "{target}");
            assert!(near("radius_m", person.radius_m) && target["rgb"][2].as_f64() == Some(person.radiance[2]));
        }
    }
    assert!(truth["frames"][45]["targets"].as_array().is_some_and(|t| !t.is_empty()));
}

#[test]
fn seeds_reproduce_bytes() {
    let (first, again, other) = (write(3), write(3), write(4));
    for name in ["recording.json", "truth.json", "frames/00000000_left.png", "frames/00000059_right.png"] {
        assert_eq!(bytes(&first, name), bytes(&again, name), "{name}");
    }
    let name = "frames/00000000_left.png";
    assert_ne!(bytes(&first, name), bytes(&other, name));
    assert_ne!(bytes(&first, name), bytes(&first, "frames/00000001_left.png"));
}

#[test]
fn a_recording_is_never_overwritten() {
    let dir = write(3);
    let error = write_recording(&small(), &dir.path().join("r"), 1, 3, || ()).unwrap_err();
    assert!(matches!(error, SimulationError::Exists(_)), "{error}");
}
