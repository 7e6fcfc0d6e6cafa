//! Recordings: a directory with a manifest, frames and, optionally, times and truth (docs/recordings.md).

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::{Purpose, SourceError};
use doorcam_core::calibration::Calibration;
use doorcam_core::geometry::{Doorway, Side};
use doorcam_core::optics::{FloorPoint, Lens, Transfer};

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
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub size: Option<[usize; 2]>,
    /// The doorway.
    pub doorway: Doorway,
    /// Layout camera: at least four points with known positions in the image (pixels) and on the floor (m, door frame).
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
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
    /// Keys of the manifest that this version ignores.
    pub unknown_keys: Vec<String>,
}

impl Recording {
    /// Reads the manifest and lists the frames.
    ///
    /// # Errors
    /// If the manifest or `timestamps.csv` is unreadable or invalid, or there are no images.
    pub fn open(path: &Path) -> Result<Self, SourceError> {
        let file = path.join("recording.json");
        let text = std::fs::read_to_string(&file)
            .map_err(|e| SourceError::new(&file, format!("cannot read the recording's manifest: {}", reason(&e))))?;
        let (manifest, unknown_keys) = parse_manifest(&text).map_err(|e| SourceError::new(&file, e))?;
        manifest.check().map_err(|e| SourceError::new(&file, e))?;
        let times = read_times(&path.join("timestamps.csv"))?;
        let frames = list_frames(path, &manifest, &times)?;
        Ok(Self { path: path.to_owned(), manifest, frames, unknown_keys })
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
    let parsed = serde_ignored::deserialize(tracked, |key| unknown.push(key.to_string()));
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

    /// A manifest for images of a calibrated camera.
    pub fn of_camera(calibration: &Calibration, fps: f64, notes: String) -> Self {
        Self {
            fps,
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
        positive("fps", self.fps, "frames a second")?;
        self.doorway.validate().map_err(|e| e.to_string())?;
        self.transfer.validate().map_err(|e| e.to_string())?;
        if let Some([first, end]) = self.background_frames.filter(|[first, end]| first >= end) {
            return Err(format!("background_frames is [{first}, {end}], expected [first, end) with first < end"));
        }
        if self.size.is_some_and(|[w, h]| w == 0 || h == 0) {
            return Err("size has a zero, expected [width, height] in pixels".into());
        }
        match self.layout {
            Layout::Patches => match self.fov_m {
                Some(fov) => positive("fov_m", fov, "metres"),
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
}

/// An I/O error in words; without the operating system's error number where it is a usual one.
fn reason(error: &std::io::Error) -> String {
    match error.kind() {
        std::io::ErrorKind::NotFound => "no such file or directory".into(),
        std::io::ErrorKind::PermissionDenied => "permission denied".into(),
        _ => error.to_string(),
    }
}

/// Seconds by frame number from `timestamps.csv`; empty if there is none.
fn read_times(file: &Path) -> Result<BTreeMap<u64, f64>, SourceError> {
    let text = match std::fs::read_to_string(file) {
        Ok(text) => text,
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(BTreeMap::new()),
        Err(e) => return Err(SourceError::new(file, reason(&e))),
    };
    let mut times = BTreeMap::new();
    let last = text.lines().count().saturating_sub(1);
    for (number, line) in text.lines().enumerate() {
        let fields: Vec<&str> = line.split(',').map(str::trim).collect();
        if line.trim().is_empty() || (number == 0 && fields.iter().any(|f| f.parse::<f64>().is_err())) {
            continue;
        }
        let parsed = match fields[..] {
            [index, seconds] => index.parse().ok().zip(seconds.parse::<f64>().ok().filter(|s| s.is_finite())),
            _ => None,
        };
        // A power cut while recording may leave half a line.
        if parsed.is_none() && number == last && !text.ends_with('\n') {
            break;
        }
        let (index, seconds) =
            parsed.ok_or_else(|| SourceError::new(file, format!("line {}: expected \"index,seconds\"", number + 1)))?;
        times.insert(index, seconds);
    }
    Ok(times)
}

fn list_frames(path: &Path, manifest: &Manifest, times: &BTreeMap<u64, f64>) -> Result<Vec<Entry>, SourceError> {
    let folder = path.join("frames");
    let mut names = Vec::new();
    let listing = std::fs::read_dir(&folder).map_err(|e| SourceError::new(&folder, reason(&e)))?;
    for entry in listing {
        let entry = entry.map_err(|e| SourceError::new(&folder, reason(&e)))?;
        let name = PathBuf::from(entry.file_name());
        let extension = name.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
        if matches!(extension.as_str(), "jpg" | "jpeg" | "png") {
            names.push(name);
        }
    }
    names.sort();
    let files = match manifest.layout {
        Layout::Camera => camera_files(names),
        Layout::Patches => patch_files(names),
    };
    if files.is_empty() {
        return Err(SourceError::new(&folder, "no images, expected 00000000.jpg, ... or 00000000_left.png, ..."));
    }
    let clock = |index: u64| times.get(&index).copied().unwrap_or(index as f64 / manifest.fps);
    let in_folder = |files: Files| match files {
        Files::Camera(name) => Files::Camera(folder.join(name)),
        Files::Patches(left, right) => Files::Patches(folder.join(left), folder.join(right)),
        Files::Missing(name) => Files::Missing(folder.join(name)),
    };
    Ok(files.into_iter().map(|(index, f)| Entry { index, seconds: clock(index), files: in_folder(f) }).collect())
}

/// Frames by number, or by their place in the list if not all names are distinct numbers.
fn camera_files(names: Vec<PathBuf>) -> Vec<(u64, Files)> {
    let number = |name: &Path| name.file_stem()?.to_str()?.parse::<u64>().ok();
    let numbered: Option<BTreeMap<u64, PathBuf>> =
        names.iter().map(|name| number(name).map(|n| (n, name.clone()))).collect();
    match numbered.filter(|n| n.len() == names.len()) {
        Some(numbered) => with_gaps(numbered.into_iter().map(|(n, name)| (n, Files::Camera(name))).collect(), ""),
        None => names.into_iter().enumerate().map(|(n, name)| (n as u64, Files::Camera(name))).collect(),
    }
}

fn patch_files(names: Vec<PathBuf>) -> Vec<(u64, Files)> {
    let mut pairs: BTreeMap<u64, [Option<PathBuf>; 2]> = BTreeMap::new();
    for name in names {
        let stem = name.file_stem().and_then(|s| s.to_str()).unwrap_or_default();
        let found = Side::BOTH.iter().enumerate().find_map(|(s, side)| {
            let number = stem.strip_suffix(side.name())?.strip_suffix('_')?;
            Some((number.parse::<u64>().ok()?, s))
        });
        if let Some((number, s)) = found {
            pairs.entry(number).or_default()[s] = Some(name);
        }
    }
    let files = |(n, pair): (u64, [Option<PathBuf>; 2])| match pair {
        [Some(left), Some(right)] => (n, Files::Patches(left, right)),
        [None, _] => (n, Files::Missing(format!("{n:08}_left.png").into())),
        [_, None] => (n, Files::Missing(format!("{n:08}_right.png").into())),
    };
    with_gaps(pairs.into_iter().map(files).collect(), "_left")
}

/// Longest run of missing numbers that counts as lost frames rather than as another way of numbering.
const LONGEST_GAP: u64 = 1000;

/// Adds an entry for each number that is missing between two others.
fn with_gaps(files: Vec<(u64, Files)>, suffix: &str) -> Vec<(u64, Files)> {
    let mut all: Vec<(u64, Files)> = Vec::with_capacity(files.len());
    for (n, file) in files {
        if let Some(next) = all.last().map(|&(last, _)| last + 1).filter(|&next| n - next <= LONGEST_GAP) {
            all.extend((next..n).map(|k| (k, Files::Missing(format!("{k:08}{suffix}.png").into()))));
        }
        all.push((n, file));
    }
    all
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const MANIFEST: &str = r#"{"fps": 5, "layout": "patches", "transfer": "linear", "size": [64, 64],
        "doorway": {"width_m": 0.9, "wall_thickness_m": 0.1, "height_m": null}, "fov_m": 0.15,
        "background_frames": [0, 2], "notes": "x", "shutter": {"open": 0}}"#;

    fn folder(manifest: &str, names: &[&str]) -> tempfile::TempDir {
        let dir = tempfile::tempdir().unwrap();
        std::fs::write(dir.path().join("recording.json"), manifest).unwrap();
        std::fs::create_dir(dir.path().join("frames")).unwrap();
        for name in names {
            std::fs::write(dir.path().join("frames").join(name), b"x").unwrap();
        }
        dir
    }

    fn error(manifest: &str, names: &[&str]) -> String {
        let dir = folder(manifest, names);
        let text = Recording::open(dir.path()).expect_err("refused").to_string();
        text.replace(&dir.path().display().to_string(), "DIR")
    }

    #[test]
    fn frames_are_listed_with_gaps_and_unknown_keys_are_reported() {
        let names = [
            "00000000_left.png",
            "00000000_right.jpg",
            "00000001_left.png",
            "00000003_left.png",
            "00000003_right.png",
            "notes.txt",
        ];
        let dir = folder(MANIFEST, &names);
        let recording = Recording::open(dir.path()).unwrap();
        assert_eq!(recording.unknown_keys, ["shutter"]);
        let at = |n: &str| dir.path().join("frames").join(n);
        let files: Vec<_> = recording.frames.iter().map(|f| (f.index, f.seconds, f.files.clone())).collect();
        assert_eq!(
            files,
            [
                (0, 0.0, Files::Patches(at("00000000_left.png"), at("00000000_right.jpg"))),
                (1, 0.2, Files::Missing(at("00000001_right.png"))),
                (2, 0.4, Files::Missing(at("00000002_left.png"))),
                (3, 0.6, Files::Patches(at("00000003_left.png"), at("00000003_right.png"))),
            ]
        );
        assert_eq!((recording.purpose(1), recording.purpose(2)), (Purpose::Background, Purpose::Watch));
    }

    #[test]
    fn times_come_from_the_file_where_there_is_one() {
        let dir = folder(MANIFEST, &["00000000_left.png", "00000000_right.png"]);
        std::fs::write(dir.path().join("timestamps.csv"), "index,seconds\n0,12.5\n").unwrap();
        assert_eq!(Recording::open(dir.path()).unwrap().frames[0].seconds, 12.5);
        std::fs::write(dir.path().join("timestamps.csv"), "index,seconds\n0,12.5\n1,soon\n").unwrap();
        let text = Recording::open(dir.path()).expect_err("refused").to_string();
        assert!(text.ends_with("timestamps.csv: line 3: expected \"index,seconds\""), "{text}");
    }

    #[test]
    fn what_is_wrong_is_said_in_one_line_that_names_file_and_key() {
        let dir = tempfile::tempdir().unwrap();
        let text = Recording::open(dir.path()).expect_err("refused").to_string();
        assert!(
            text.ends_with("recording.json: cannot read the recording's manifest: no such file or directory"),
            "{text}"
        );
        let with =
            |from: &str, to: &str| error(&MANIFEST.replace(from, to), &["00000000_left.png", "00000000_right.png"]);
        assert_eq!(
            with("\"fps\": 5", "\"fps\": 0"),
            "DIR/recording.json: fps is 0, expected a number of frames a second above 0"
        );
        assert_eq!(with("0.9", "-1"), "DIR/recording.json: doorway.width_m is -1, expected 0.05 to 10 metres");
        assert_eq!(
            with("0.9", "\"wide\""),
            "DIR/recording.json: doorway.width_m: invalid type: string \"wide\", expected f64 at line 2 column 37"
        );
        assert_eq!(
            with("\"linear\"", "{\"gamma\": -2.2}"),
            "DIR/recording.json: transfer.gamma is -2.2, expected a number above 0"
        );
        assert_eq!(
            with("\"linear\"", "\"rec709\""),
            "DIR/recording.json: transfer: unknown variant `rec709`, expected one of `srgb`, `linear`, `gamma`, `curve` at \
             line 1 column 52"
        );
        assert_eq!(
            with(", \"fov_m\": 0.15", ""),
            "DIR/recording.json: fov_m is missing; layout \"patches\" needs the patches' side in metres"
        );
        assert_eq!(
            with("\"patches\"", "\"camera\""),
            "DIR/recording.json: floor_points has 0 points, expected at least 4 with layout \"camera\""
        );
        assert_eq!(
            with("[0, 2]", "[2, 2]"),
            "DIR/recording.json: background_frames is [2, 2], expected [first, end) with first < end"
        );
        let points = r#""camera", "floor_points": [{"pixel": [0, 0], "floor_m": [0, 0]}, {"pixel": [9, 0], "floor_m": [1, 0]},
            {"pixel": [0, 9], "floor_m": [0, 1]}, {"pixel": [9, 9], "floor_m": [1, 1]}]"#;
        let unsized_camera = MANIFEST.replace("\"patches\"", points).replace("\"size\": [64, 64],", "");
        assert_eq!(
            error(&unsized_camera, &["00000000.png"]),
            "DIR/recording.json: size is missing; layout \"camera\" needs the images' [width, height] in pixels"
        );
        assert!(error(MANIFEST, &[]).starts_with("DIR/frames: no images"));
    }

    proptest! {
        #[test]
        fn any_text_as_manifest_is_refused_or_read_without_panic(text in ".{0,200}") {
            let _ = parse_manifest(&text);
        }

        #[test]
        fn damaged_manifests_never_panic(at in 0usize..300, with in proptest::char::any()) {
            let mut text: Vec<char> = MANIFEST.chars().collect();
            let length = text.len();
            text[at % length] = with;
            if let Ok((manifest, _)) = parse_manifest(&text.into_iter().collect::<String>()) {
                let _ = manifest.check();
            }
        }
    }
}
