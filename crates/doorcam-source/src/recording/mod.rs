//! Recordings: a directory with a manifest, frames and, optionally, times and truth (docs/recordings.md).

mod listing;
mod timeline;

use std::path::{Path, PathBuf};

use serde::{Deserialize, Deserializer, Serialize};

use super::{Purpose, SourceError};
use crate::bounded::bounded;
use crate::files::{self, FileKind};
use crate::orientation::Orientation;
use doorcam_core::calibration::{Calibration, MOST_POINTS, image_size};
use doorcam_core::geometry::Doorway;
use doorcam_core::image::MOST_PIXELS;
use doorcam_core::optics::{FloorPoint, Lens, Transfer};

pub(crate) use listing::MOST_FRAMES;
pub(crate) use timeline::{brief, median, other_unit};

/// Frame rates that are believed, in frames a second: from one in a hundred seconds to what no webcam reaches.
const FPS: std::ops::RangeInclusive<f64> = 0.01..=1000.0;

/// Sides of a square of floor that are believed, in metres.
const FOV_M: std::ops::RangeInclusive<f64> = 0.01..=100.0;

/// Most bytes of notes: they are part of every status.
const MOST_NOTES: usize = 16 * 1024;

/// Most unknown keys that are kept to be named.
const MOST_UNKNOWN: usize = 20;

/// So many frames from the first on are tried, to find one whose image tells how all of them are oriented.
const TRIED: usize = 20;

/// The manifest of a recording, `recording.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// Frames a second.
    pub fps: f64,
    /// What the images show.
    pub layout: Layout,
    /// Transfer function of the images.
    pub transfer: Transfer,
    /// Width and height of the images, in pixels; needed with layout camera.
    #[serde(default, deserialize_with = "size", skip_serializing_if = "Option::is_none")]
    pub size: Option<[usize; 2]>,
    /// The doorway.
    pub doorway: Doorway,
    /// Layout camera: at least four points with known positions in the image (pixels) and on the floor (m, door frame).
    #[serde(default, skip_serializing_if = "Vec::is_empty", deserialize_with = "bounded::<_, _, MOST_POINTS>")]
    pub floor_points: Vec<FloorPoint>,
    /// Layout camera: the lens's distortion; none if straight lines appear straight.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lens: Option<Lens>,
    /// Layout patches: side of the square of floor that each image shows, in metres.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fov_m: Option<f64>,
    /// Frames of the empty room: the first, and the one after the last.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub background_frames: Option<[u64; 2]>,
    /// Notes for people, such as where the recording comes from.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub notes: String,
}

/// Reads a size as a calibration's is read, so that both accept the same.
fn size<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<[usize; 2]>, D::Error> {
    #[derive(Deserialize)]
    struct Size(#[serde(deserialize_with = "image_size")] [usize; 2]);
    Ok(Option::<Size>::deserialize(deserializer)?.map(|Size(size)| size))
}

/// What the images of a recording show.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Layout {
    /// The camera's view: one image a frame.
    Camera,
    /// Rectified patches: a left and a right image a frame.
    Patches,
}

/// The image files of one frame.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Files {
    /// Layout camera.
    Camera(PathBuf),
    /// Layout patches: left, right.
    Patches(PathBuf, PathBuf),
    /// A number of the sequence without a file, or with only one of two: the path that was expected.
    Missing(PathBuf),
}

/// One frame of a recording.
#[derive(Debug, Clone, PartialEq)]
pub struct Entry {
    /// Number of the frame.
    pub index: u64,
    /// Time of capture, in seconds on the recording's own clock.
    pub seconds: f64,
    /// The image files.
    pub files: Files,
}

/// An opened recording: its manifest and list of frames. Images are read later, one by one.
#[derive(Debug, Clone, PartialEq)]
pub struct Recording {
    /// The directory.
    pub path: PathBuf,
    /// Its manifest.
    pub manifest: Manifest,
    /// The frames in order.
    pub frames: Vec<Entry>,
    /// Keys of the manifest that this version ignores; the first ones, if there are many.
    pub unknown_keys: Vec<String>,
    /// What a user should know about the files, one line each: what is left out, missing, or not taken as it is.
    pub notes: Vec<String>,
    /// How the images are tagged to be turned for people. Images are used as they are stored.
    pub(crate) orientation: Orientation,
}

impl Recording {
    /// Reads the manifest, lists the frames and determines their times.
    ///
    /// # Errors
    /// If the manifest or `timestamps.csv` is unreadable or invalid, there are no images, or the files contradict each
    /// other.
    pub fn open(path: &Path) -> Result<Self, SourceError> {
        let file = path.join("recording.json");
        let text = files::read_text(&file, FileKind::MANIFEST)
            .map_err(|e| SourceError::new(&file, format!("cannot read the recording's manifest: {}", e.words())))?;
        let (manifest, unknown_keys) = parse_manifest(&text).map_err(|e| SourceError::new(&file, e))?;
        manifest.check().map_err(|e| SourceError::new(&file, e))?;
        let times_file = path.join("timestamps.csv");
        let mut stamps = timeline::read(&times_file)?;
        let folder = path.join("frames");
        let listing::Listing { frames, notes: of_names } = listing::list(&folder, manifest.layout)?;
        let numbers: Vec<u64> = frames.iter().map(|(number, _)| *number).collect();
        manifest.check_background(&numbers).map_err(|e| SourceError::new(&file, e))?;
        let seconds = timeline::times(&numbers, &mut stamps, manifest.fps);
        let seconds = seconds.map_err(|e| SourceError::new(&times_file, e))?;
        let entry =
            |((index, files), seconds): ((u64, Files), f64)| Entry { index, seconds, files: files.within(&folder) };
        let frames = frames.into_iter().zip(seconds).map(entry).collect();
        let about = |file: &Path, notes: Vec<String>| {
            notes.into_iter().map(|note| format!("{}: {note}", files::shown(file))).collect::<Vec<_>>()
        };
        let notes = [about(&folder, of_names), about(&times_file, stamps.notes)].concat();
        let orientation = Orientation::default();
        let mut recording = Self { path: path.to_owned(), manifest, frames, unknown_keys, notes, orientation };
        recording.orient()?;
        Ok(recording)
    }

    /// Finds out how the images are tagged to be turned. An error if the manifest's size is that of the turned images,
    /// for then so are the floor points.
    fn orient(&mut self) -> Result<(), SourceError> {
        let first = self.frames.iter().take(TRIED).find_map(|entry| {
            let (Files::Camera(file) | Files::Patches(file, _)) = &entry.files else { return None };
            let bytes = files::read(file, self.image_kind()).ok()?;
            Some((file, Orientation::of(&bytes), crate::image::size(&bytes)))
        });
        let Some((file, orientation, size)) =
            first.filter(|(_, orientation, _)| *orientation != Orientation::default())
        else {
            return Ok(());
        };
        if let (true, Some((width, height)), Some(expected)) = (orientation.swaps_sides(), size, self.manifest.size)
            && width != height
            && expected == [height, width]
        {
            return Err(SourceError::new(
                file,
                format!(
                    "its pixels are stored as {width} x {height} and tagged to be turned (EXIF orientation {orientation}), \
                     but recording.json has size [{height}, {width}]: store the images turned and without the tag, or give \
                     size and floor_points in pixels of the stored image"
                ),
            ));
        }
        self.notes.push(format!(
            "{}: tagged to be turned for people (EXIF orientation {orientation}): the images are used as they are stored, \
             and floor_points must be in pixels of the stored image",
            files::shown(file)
        ));
        self.orientation = orientation;
        Ok(())
    }

    /// What is expected of an image file.
    pub(crate) fn image_kind(&self) -> FileKind {
        // Four samples a pixel with 16 bits each, not compressed, and room for what else may be in the file.
        const BESIDE: u64 = 16 << 20;
        match (self.manifest.layout, self.manifest.size) {
            (Layout::Camera, Some([w, h])) => FileKind::IMAGE.at_most(8 * (w as u64).saturating_mul(h as u64) + BESIDE),
            _ => FileKind::IMAGE,
        }
    }

    /// What a frame is for, according to `background_frames`.
    pub fn purpose(&self, index: u64) -> Purpose {
        match self.manifest.background_frames {
            Some([first, _]) if index < first => Purpose::Before,
            Some([_, end]) if index < end => Purpose::Background,
            _ => Purpose::Watch,
        }
    }
}

/// The manifest and the names of unknown keys.
fn parse_manifest(text: &str) -> Result<(Manifest, Vec<String>), String> {
    let mut unknown = Vec::new();
    let mut json = serde_json::Deserializer::from_str(text);
    let mut track = serde_path_to_error::Track::new();
    let tracked = serde_path_to_error::Deserializer::new(&mut json, &mut track);
    let parsed = serde_ignored::deserialize(tracked, |key| {
        if unknown.len() < MOST_UNKNOWN {
            unknown.push(key.to_string().escape_debug().to_string());
        }
    });
    let manifest = parsed.map_err(|e: serde_json::Error| {
        let path = track.path().to_string();
        if path != "." {
            return format!("{path}: {e}");
        }
        match e.to_string() {
            missing if missing.starts_with("missing field `doorway`") => {
                "doorway and floor_points are missing: they come with a calibration (docs/recordings.md says how)"
                    .into()
            }
            other => other,
        }
    })?;
    json.end().map_err(|e| e.to_string())?;
    Ok((manifest, unknown))
}

impl Manifest {
    /// The camera's calibration; none if the images are rectified patches.
    pub fn calibration(&self) -> Option<Calibration> {
        (self.layout == Layout::Camera).then(|| Calibration {
            size: self.size.unwrap_or_default(),
            doorway: self.doorway,
            floor_points: self.floor_points.clone(),
            lens: self.lens,
            transfer: Some(self.transfer.clone()),
        })
    }

    /// Replaces the manifest's calibration.
    pub fn set_calibration(&mut self, calibration: &Calibration) {
        self.size = Some(calibration.size);
        self.doorway = calibration.doorway;
        self.floor_points.clone_from(&calibration.floor_points);
        self.lens = calibration.lens;
        self.transfer = calibration.transfer().clone();
    }

    /// A manifest for images of a calibrated camera. A frame rate that no recording may have, as some drivers report, is
    /// replaced by the nearest one.
    pub fn of_camera(calibration: &Calibration, fps: f64, notes: String) -> Self {
        Self {
            fps: fps.clamp(*FPS.start(), *FPS.end()),
            layout: Layout::Camera,
            transfer: calibration.transfer().clone(),
            size: Some(calibration.size),
            doorway: calibration.doorway,
            floor_points: calibration.floor_points.clone(),
            lens: calibration.lens,
            fov_m: None,
            background_frames: None,
            notes,
        }
    }

    /// Writes `recording.json` into the directory `recording`.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn write(&self, recording: &Path) -> std::io::Result<()> {
        let mut text = serde_json::to_string_pretty(self)?;
        text.push('\n');
        std::fs::write(recording.join("recording.json"), text)
    }

    fn check(&self) -> Result<(), String> {
        let positive = |key: &str, value: f64, unit: &str| {
            if value.is_finite() && value > 0.0 {
                Ok(())
            } else {
                Err(format!("{key} is {value}, expected a number of {unit} above 0"))
            }
        };
        let within = |key: &str, value: f64, range: std::ops::RangeInclusive<f64>, unit: &str| {
            positive(key, value, unit)?;
            if range.contains(&value) {
                return Ok(());
            }
            Err(format!("{key} is {value}, expected {} to {} {unit}", range.start(), range.end()))
        };
        within("fps", self.fps, FPS, "frames a second")?;
        if self.notes.len() > MOST_NOTES {
            return Err(format!("notes has {} bytes, expected at most {MOST_NOTES}", self.notes.len()));
        }
        self.doorway.validate().map_err(|e| e.to_string())?;
        self.transfer.validate().map_err(|e| e.to_string())?;
        if let Some([first, end]) = self.background_frames.filter(|[first, end]| first >= end) {
            return Err(format!("background_frames is [{first}, {end}], expected [first, end) with first < end"));
        }
        if self.size.is_some_and(|[w, h]| w == 0 || h == 0) {
            return Err("size has a zero, expected [width, height] in pixels".into());
        }
        if let Some([w, h]) = self.size.filter(|[w, h]| w.saturating_mul(*h) > MOST_PIXELS) {
            return Err(format!(
                "size is [{w}, {h}], expected [width, height] of at most as many pixels as 7680 x 4320"
            ));
        }
        match self.layout {
            Layout::Patches => match self.fov_m {
                Some(fov) => within("fov_m", fov, FOV_M, "metres"),
                None => Err("fov_m is missing; layout \"patches\" needs the patches' side in metres".into()),
            },
            Layout::Camera if self.floor_points.len() < 4 => Err(format!(
                "floor_points has {} points, expected at least 4 with layout \"camera\"",
                self.floor_points.len()
            )),
            // The size determines, before the first image, which parts of the patches the camera sees.
            Layout::Camera if self.size.is_none() => {
                Err("size is missing; layout \"camera\" needs the images' [width, height] in pixels".into())
            }
            Layout::Camera => Ok(()),
        }
    }

    /// Checks that there are frames of the empty room, for nothing can be compared with one that is elsewhere. `numbers`
    /// are those of all frames, in order.
    fn check_background(&self, numbers: &[u64]) -> Result<(), String> {
        let (Some([from, end]), Some(first), Some(last)) = (self.background_frames, numbers.first(), numbers.last())
        else {
            return Ok(());
        };
        if numbers.iter().any(|number| (from..end).contains(number)) {
            return Ok(());
        }
        Err(format!("background_frames is [{from}, {end}], but the frames are {first} to {last}"))
    }
}

impl Files {
    fn within(self, folder: &Path) -> Self {
        match self {
            Self::Camera(name) => Self::Camera(folder.join(name)),
            Self::Patches(left, right) => Self::Patches(folder.join(left), folder.join(right)),
            Self::Missing(name) => Self::Missing(folder.join(name)),
        }
    }
}

#[cfg(test)]
mod tests;
