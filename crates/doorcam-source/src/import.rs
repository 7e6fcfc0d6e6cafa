//! Converts the paper's data files (the authors' repository DoorwayCameraCode) to recordings.

use std::fs;
use std::path::{Path, PathBuf};

use crate::files::{self, FileKind, ReadError};
use crate::recording::{Layout, Manifest};
use crate::truth::{Target, TrueFrame, Truth};
use doorcam_core::geometry::{Doorway, Point, Side};
use doorcam_core::image::{Image, Samples};
use doorcam_core::optics::Transfer;

/// Why the import failed or stopped.
#[derive(Debug, thiserror::Error)]
pub enum ImportError {
    /// The folder is not the authors' repository.
    #[error(
        "{0}: no measurement of DoorwayCameraCode found, expected \"Laboratory Data\" and \"Synthetic Data\" in it"
    )]
    NothingFound(PathBuf),
    /// A recording exists already.
    #[error("{0} exists already; give --force to overwrite it")]
    Exists(PathBuf),
    /// A file cannot be read or written.
    #[error("{0}: {1}")]
    Io(PathBuf, std::io::Error),
    /// A file is not what it should be, or cannot be read.
    #[error("{0}: {1}")]
    Read(PathBuf, ReadError),
    /// An image is broken.
    #[error("{0}: {1}")]
    Image(PathBuf, String),
}

/// What became of one scene.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Outcome {
    /// A recording was written.
    Written {
        /// Its name below OUT.
        name: String,
    },
    /// Files that it needs do not exist.
    Missing {
        /// The name that it would have had.
        name: String,
        /// The files, below SRC.
        files: Vec<PathBuf>,
    },
}

/// One of the authors' scenes: a background and a frame.
struct Scene {
    name: String,
    /// Left and right of the background, then of the frame; paths below SRC.
    files: [[PathBuf; 2]; 2],
    fov_m: f64,
    notes: String,
    /// Where the frame's targets stand, in metres in the door frame; none where unknown.
    stands: Option<&'static [Point]>,
}

/// Light paths per pixel of the noisier synthetic frames; the least noisy have 8000.
const OTHER_SAMPLES: [u32; 9] = [4000, 2000, 1000, 500, 250, 125, 60, 30, 15];

/// Where the cylinders of a synthetic scene stand, in metres in the door frame. Of other scenes the paper shows only
/// figures.
fn known_places(folder: &str) -> Option<&'static [Point]> {
    match folder {
        "Emissive Example" => Some(&[[0.0, 1.0]]),
        // The published files of the latter are byte for byte those of the former.
        "Two Target Example" | "Non-Lambertian Example" => Some(&[[-0.75, 1.0], [0.75, 1.0]]),
        _ => None,
    }
}

fn scenes() -> Vec<Scene> {
    let laboratory = [
        ("lab-0", "One Red Target", 0, "0.05"),
        ("lab-1", "One Red Target", 1, "0.05"),
        ("lab-2", "One Red Target", 2, "0.05"),
        ("lab-3", "One Red Target", 3, "0.05"),
        ("lab-4", "Two Targets", 1, "0.01"),
        ("lab-5", "Two Targets", 5, "0.005"),
        ("lab-6", "Three Targets", 1, "0.01"),
    ];
    let laboratory = laboratory.into_iter().map(|(name, folder, scene, lambda)| {
        let files = |what: &str| {
            Side::BOTH.map(|side| {
                PathBuf::from(format!("Laboratory Data/{folder}/Measurements/scn_{what}_exp_0_{}.jpg", side.name()))
            })
        };
        Scene {
            name: name.into(),
            files: [files("bg"), files(&scene.to_string())],
            fov_m: 0.15,
            notes: format!("DoorwayCameraCode, laboratory, {folder}, scene {scene}; published lambda {lambda}"),
            stands: None,
        }
    });
    let synthetic = [
        ("syn-1", "Two Target Example", "0.1"),
        ("syn-2", "Four Target Example", "0.005"),
        ("syn-3", "Same Color Example", "0.01"),
        ("syn-4", "Non-Lambertian Example", "0.1"),
    ];
    let measured = |folder: &str, stem: &str| {
        Side::BOTH
            .map(|side| PathBuf::from(format!("Synthetic Data/{folder}/Measurements/{stem}_{}_meas.png", side.name())))
    };
    let synthetic_scene = move |name: String, folder: &str, background: &str, frame: &str, lambda: &str| Scene {
        files: [measured(folder, background), measured(folder, frame)],
        fov_m: 0.30,
        notes: format!("DoorwayCameraCode, synthetic, {folder}, {frame}; published lambda {lambda}"),
        stands: known_places(folder),
        name,
    };
    let emissive = synthetic_scene("syn-0".into(), "Emissive Example", "colorful_background", "colorful_object", "0.2");
    let levels = synthetic.into_iter().flat_map(move |(name, folder, lambda)| {
        std::iter::once(8000).chain(OTHER_SAMPLES).map(move |samples| {
            let name = if samples == 8000 { name.to_owned() } else { format!("{name}-samps-{samples}") };
            let frame = format!("frame_0_samps_{samples}");
            synthetic_scene(name, folder, "background_samps_8000", &frame, lambda)
        })
    });
    laboratory.chain(std::iter::once(emissive)).chain(levels).collect()
}

/// Writes a recording below `out` for each scene whose files exist below `src`, and calls `each` with every scene's
/// outcome, in order.
///
/// The background is frame 0, the new frame is frame 1. Images keep their codes; JPEGs become 8-bit PNGs.
///
/// # Errors
/// If `src` has no complete scene, a recording exists and `force` is false, or a file cannot be read, decoded or
/// written.
pub fn doorway_camera_code(
    src: &Path,
    out: &Path,
    force: bool,
    mut each: impl FnMut(&Outcome),
) -> Result<Vec<Outcome>, ImportError> {
    let mut outcomes = Vec::new();
    let scenes = scenes();
    let found = |scene: &Scene| scene.files.iter().flatten().all(|f| src.join(f).is_file());
    if !scenes.iter().any(found) {
        return Err(ImportError::NothingFound(src.to_owned()));
    }
    if !force && let Some(taken) = scenes.iter().filter(|s| found(s)).map(|s| out.join(&s.name)).find(|p| p.exists()) {
        return Err(ImportError::Exists(taken));
    }
    for scene in scenes {
        let missing: Vec<_> = scene.files.iter().flatten().filter(|f| !src.join(f).is_file()).cloned().collect();
        let outcome = if missing.is_empty() {
            write(&scene, src, &out.join(&scene.name))?;
            Outcome::Written { name: scene.name }
        } else {
            Outcome::Missing { name: scene.name, files: missing }
        };
        each(&outcome);
        outcomes.push(outcome);
    }
    Ok(outcomes)
}

fn write(scene: &Scene, src: &Path, out: &Path) -> Result<(), ImportError> {
    let io = |path: &Path| {
        let path = path.to_owned();
        move |e| ImportError::Io(path, e)
    };
    let frames = out.join("frames");
    if frames.exists() {
        fs::remove_dir_all(&frames).map_err(io(&frames))?;
    }
    fs::create_dir_all(&frames).map_err(io(&frames))?;
    let mut size = [0, 0];
    for (index, pair) in scene.files.iter().enumerate() {
        for (side, file) in Side::BOTH.into_iter().zip(pair) {
            let from = src.join(file);
            let to = frames.join(format!("{index:08}_{}.png", side.name()));
            let bytes = files::read(&from, FileKind::IMAGE).map_err(|e| ImportError::Read(from.clone(), e))?;
            let image = crate::image::decode(&bytes).map_err(|e| ImportError::Image(from.clone(), e.to_string()))?;
            size = [image.width, image.height];
            if bytes.starts_with(b"\x89PNG") {
                fs::write(&to, bytes).map_err(io(&to))?;
            } else {
                write_png(&image, &to)?;
            }
        }
    }
    let manifest = Manifest {
        fps: 1.0,
        layout: Layout::Patches,
        transfer: Transfer::Srgb,
        size: Some(size),
        doorway: Doorway { width_m: 0.508, wall_thickness_m: 0.0, height_m: None, leaf: None },
        floor_points: Vec::new(),
        lens: None,
        fov_m: Some(scene.fov_m),
        background_frames: Some([0, 1]),
        notes: scene.notes.clone(),
    };
    let truth = out.join(Truth::FILE);
    if let Some(places) = scene.stands {
        let text = serde_json::to_vec(&self::truth(places)).map_err(std::io::Error::from).map_err(io(&truth))?;
        fs::write(&truth, text).map_err(io(&truth))?;
    }
    manifest.write(out).map_err(io(out))
}

/// Nobody in frame 0, the background; everybody in frame 1. Their widths and colours are not published.
fn truth(places: &[Point]) -> Truth {
    let target = |(id, &[x_m, y_m]): (u64, &Point)| Target { id, x_m, y_m, radius_m: 0.0, rgb: [0.0; 3] };
    let targets = (1..).zip(places).map(target).collect();
    let empty = TrueFrame { index: 0, t: 0.0, targets: Vec::new() };
    Truth { frames: vec![empty, TrueFrame { index: 1, t: 1.0, targets }], crossings: Vec::new() }
}

fn write_png(image: &Image, to: &Path) -> Result<(), ImportError> {
    let (width, height) = (image.width as u32, image.height as u32);
    let save = |result: image::ImageResult<()>| result.map_err(|e| ImportError::Image(to.to_owned(), e.to_string()));
    match &image.samples {
        Samples::Eight(codes) => save(image::save_buffer(to, codes, width, height, image::ColorType::Rgb8)),
        Samples::Sixteen(codes) => {
            let bytes: Vec<u8> = codes.iter().flat_map(|c| c.to_ne_bytes()).collect();
            save(image::save_buffer(to, &bytes, width, height, image::ColorType::Rgb16))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The authors' folder, with one small image in place of every measurement.
    fn source() -> tempfile::TempDir {
        let dir = tempfile::tempdir().unwrap();
        let image = Image { width: 4, height: 4, samples: Samples::Eight(vec![90; 48]) };
        for file in scenes().iter().flat_map(|scene| scene.files.iter().flatten()) {
            let path = dir.path().join(file);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            write_png(&image, &path.with_extension("png")).unwrap();
            fs::rename(path.with_extension("png"), &path).unwrap();
        }
        dir
    }

    #[test]
    fn where_cylinders_are_known_to_stand_the_recording_says_so() {
        let (source, out) = (source(), tempfile::tempdir().unwrap());
        doorway_camera_code(source.path(), out.path(), false, |_| {}).unwrap();
        let places = |name: &str| {
            let truth = Truth::of_recording(&out.path().join(name)).unwrap()?;
            let [empty, frame] = &truth.frames[..] else { panic!("two frames: {truth:?}") };
            assert_eq!((empty.index, empty.targets.len(), frame.index), (0, 0, 1));
            Some(frame.targets.iter().map(|t| (t.id, [t.x_m, t.y_m])).collect::<Vec<_>>())
        };
        assert_eq!(places("syn-0"), Some(vec![(1, [0.0, 1.0])]));
        for two in ["syn-1", "syn-1-samps-250", "syn-4"] {
            assert_eq!(places(two), Some(vec![(1, [-0.75, 1.0]), (2, [0.75, 1.0])]), "{two}");
        }
        for unknown in ["lab-0", "syn-2", "syn-3"] {
            assert!(out.path().join(unknown).join("recording.json").is_file());
            assert_eq!(places(unknown), None);
        }
    }
}
