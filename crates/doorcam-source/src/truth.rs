//! Ground truth of a recording, where everybody in the hidden room really is: `truth.json` (docs/recordings.md).

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::bounded::bounded;
use crate::files::{self, FileKind, ReadError};
use crate::recording::{MOST_FRAMES, brief, median, other_unit};
use doorcam_core::scene::Rgb;
use doorcam_core::tracking::Direction;

/// Most people in one frame: more than fit into a room. Who is who among them takes a time that grows as the cube of
/// their number.
const MOST_PEOPLE: usize = 256;

/// Farthest place of a person from the door, in metres: no floor shows anybody who is farther away.
const FARTHEST_M: f64 = 100.0;

/// Largest radius of a body, in metres.
const LARGEST_RADIUS_M: f64 = 5.0;

/// Brightest colour of a body; white is 1.
const BRIGHTEST: f64 = 1000.0;

/// Latest time, in seconds: as for `timestamps.csv`.
const LATEST_S: f64 = 1e10;

/// The truth of a recording.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Truth {
    /// Frame by frame. Of a frame that is not listed, the truth is unknown.
    #[serde(deserialize_with = "bounded::<_, _, MOST_FRAMES>")]
    pub frames: Vec<TrueFrame>,
    /// Who went through the doorway, in order of time.
    #[serde(default, skip_serializing_if = "Vec::is_empty", deserialize_with = "bounded::<_, _, MOST_FRAMES>")]
    pub crossings: Vec<TrueCrossing>,
}

/// Somebody who went through the doorway, or turned around on its threshold.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TrueCrossing {
    /// When the body's axis passed y = 0, or was nearest to it, in seconds.
    pub t: f64,
    /// Which way.
    pub direction: Direction,
}

/// Who is there in one frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TrueFrame {
    /// Number of the frame.
    pub index: u64,
    /// Time of the frame, in seconds.
    pub t: f64,
    /// Everybody in the hidden room.
    #[serde(deserialize_with = "bounded::<_, _, MOST_PEOPLE>")]
    pub targets: Vec<Target>,
}

/// One person.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Target {
    /// Identifies the person across frames.
    pub id: u64,
    /// The body's axis, x in the door frame, in metres.
    pub x_m: f64,
    /// The body's axis, y in the door frame (into the hidden room), in metres.
    pub y_m: f64,
    /// The body's radius, in metres.
    #[serde(default)]
    pub radius_m: f64,
    /// The body's colour, linear.
    #[serde(default)]
    pub rgb: Rgb,
}

/// Why `truth.json` cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum TruthError {
    /// The file cannot be read.
    #[error("{0}: {1}")]
    Io(PathBuf, ReadError),
    /// The contents are invalid.
    #[error("{path}: {key}: {message}")]
    Invalid {
        /// The file.
        path: PathBuf,
        /// The key at fault.
        key: String,
        /// What is wrong.
        message: String,
    },
}

impl Truth {
    /// Name of the file in a recording.
    pub const FILE: &str = "truth.json";

    /// Reads the truth of the recording in `directory`; none if it has no such file.
    ///
    /// # Errors
    /// If the file exists but cannot be read, or is invalid.
    pub fn of_recording(directory: &Path) -> Result<Option<Self>, TruthError> {
        let path = directory.join(Self::FILE);
        let text = match files::read_text(&path, FileKind::TRUTH) {
            Ok(text) => text,
            Err(e) if e.is_missing() => return Ok(None),
            Err(e) => return Err(TruthError::Io(path, e)),
        };
        let mut json = serde_json::Deserializer::from_str(&text);
        let truth: Self = match serde_path_to_error::deserialize(&mut json) {
            Ok(truth) => truth,
            Err(e) => {
                let key = e.path().to_string();
                return Err(TruthError::Invalid { path, key, message: e.into_inner().to_string() });
            }
        };
        match truth.check() {
            Ok(()) => Ok(Some(truth)),
            Err((key, message)) => Err(TruthError::Invalid { path, key, message }),
        }
    }

    /// The first value that cannot be: its key and what is wrong.
    fn check(&self) -> Result<(), (String, String)> {
        for (n, frame) in self.frames.iter().enumerate() {
            let within = |key: String, value: f64, least: f64, most: f64, what: &str| {
                if (least..=most).contains(&value) {
                    return Ok(());
                }
                Err((
                    format!("frames[{n}].{key}"),
                    format!("{value} is not possible, expected {least} to {most} {what}"),
                ))
            };
            within("t".into(), frame.t, -LATEST_S, LATEST_S, "seconds")?;
            for (k, target) in frame.targets.iter().enumerate() {
                let of = |key: &str| format!("targets[{k}].{key}");
                within(of("x_m"), target.x_m, -FARTHEST_M, FARTHEST_M, "metres")?;
                within(of("y_m"), target.y_m, -FARTHEST_M, FARTHEST_M, "metres")?;
                within(of("radius_m"), target.radius_m, 0.0, LARGEST_RADIUS_M, "metres")?;
                for (c, value) in target.rgb.into_iter().enumerate() {
                    within(of(&format!("rgb[{c}]")), value, -BRIGHTEST, BRIGHTEST, "(white is 1)")?;
                }
            }
        }
        for (n, crossing) in self.crossings.iter().enumerate() {
            if !(-LATEST_S..=LATEST_S).contains(&crossing.t) {
                let message = format!("{} is not possible, expected {} to {LATEST_S} seconds", crossing.t, -LATEST_S);
                return Err((format!("crossings[{n}].t"), message));
            }
        }
        Ok(())
    }

    /// Checks that the times of the frames are in seconds, given the recording's frames a second.
    ///
    /// # Errors
    /// If they are not, in words: the key and the likely unit.
    pub fn check_times(&self, fps: f64) -> Result<(), String> {
        let steps = self.frames.windows(2).filter_map(|pair| {
            let frames = pair[1].index.checked_sub(pair[0].index).filter(|&frames| frames > 0)?;
            Some((pair[1].t - pair[0].t) / frames as f64).filter(|&step| step > 0.0)
        });
        let Some(step) = median(steps.collect()) else { return Ok(()) };
        other_unit(step, fps).map_or(Ok(()), |unit| {
            Err(format!(
                "frames[1].t: the times are {} s a frame apart, but {} s by fps in recording.json; they are probably \
                 {unit}, expected seconds",
                brief(step),
                brief(1.0 / fps)
            ))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Option<Truth>, TruthError> {
        let dir = tempfile::tempdir().unwrap();
        std::fs::write(dir.path().join(Truth::FILE), text).unwrap();
        Truth::of_recording(dir.path())
    }

    #[test]
    fn what_is_optional_may_be_left_out() {
        let text =
            r#"{"frames": [{"index": 3, "t": 0.6, "targets": [{"id": 7, "x_m": -1, "y_m": 2.5}]}], "by": "hand"}"#;
        let truth = read(text).unwrap().unwrap();
        let target = Target { id: 7, x_m: -1.0, y_m: 2.5, radius_m: 0.0, rgb: [0.0; 3] };
        assert_eq!(truth.frames, [TrueFrame { index: 3, t: 0.6, targets: vec![target] }]);
    }

    #[test]
    fn impossible_values_and_counts_are_refused_by_their_key() {
        let with = |t: &str, x: &str, more: &str| {
            let text = format!(
                r#"{{"frames": [{{"index": 0, "t": {t}, "targets": [{{"id": 1, "x_m": {x}, "y_m": 1{more}}}]}}]}}"#
            );
            read(&text).map(drop).map_err(|e| e.to_string().split("truth.json: ").nth(1).unwrap().to_owned())
        };
        assert_eq!(with("-0.0", "-0", r#", "radius_m": 0, "rgb": [-0.1, 0, 5e-324]"#), Ok(()));
        let key = |result: Result<(), String>| result.expect_err("refused").split(": ").next().unwrap().to_owned();
        for value in ["1e308", "-1e9", "100.5"] {
            assert_eq!(key(with("0", value, "")), "frames[0].targets[0].x_m", "{value}");
        }
        assert_eq!(key(with("1e300", "0", "")), "frames[0].t");
        assert_eq!(key(with("0", "0", r#", "radius_m": -1"#)), "frames[0].targets[0].radius_m");
        assert_eq!(key(with("0", "0", r#", "rgb": [0, 1e300, 0]"#)), "frames[0].targets[0].rgb[1]");
        let crowd = |count: usize| {
            let target = |id: usize| format!(r#"{{"id": {id}, "x_m": 0, "y_m": 1}}"#);
            let targets = (0..count).map(target).collect::<Vec<_>>().join(",");
            read(&format!(r#"{{"frames": [{{"index": 0, "t": 0, "targets": [{targets}]}}]}}"#))
        };
        assert_eq!(crowd(256).unwrap().unwrap().frames[0].targets.len(), 256);
        let error = crowd(20_000).unwrap_err().to_string();
        assert!(error.contains("truth.json: frames[0].targets: more than 256 values, expected at most 256"), "{error}");
    }

    #[test]
    fn other_units_of_time_are_named() {
        let truth = |step: f64| {
            let frame = |index: u64| TrueFrame { index, t: step * index as f64, targets: Vec::new() };
            Truth { frames: [0, 1, 2, 5, 6].map(frame).into(), crossings: Vec::new() }
        };
        truth(0.1).check_times(10.0).unwrap();
        truth(0.0).check_times(10.0).unwrap();
        let error = truth(100.0).check_times(10.0).unwrap_err();
        assert_eq!(
            error,
            "frames[1].t: the times are 100 s a frame apart, but 0.1 s by fps in recording.json; they are probably \
             milliseconds, expected seconds"
        );
    }

    #[test]
    fn a_byte_order_mark_is_taken_and_another_encoding_named() {
        let text = r#"{"frames": []}"#;
        assert_eq!(read(&format!("\u{feff}{text}")).unwrap().unwrap().frames, []);
        let dir = tempfile::tempdir().unwrap();
        let wide: Vec<u8> = text.encode_utf16().flat_map(u16::to_le_bytes).collect();
        std::fs::write(dir.path().join(Truth::FILE), wide).unwrap();
        let error = Truth::of_recording(dir.path()).unwrap_err().to_string();
        assert!(error.ends_with("truth.json: is text in UTF-16 or UTF-32, expected UTF-8"), "{error}");
    }

    #[test]
    fn errors_name_the_file_and_the_key() {
        let error = read(r#"{"frames": [{"index": 0, "t": 0, "targets": [{"id": 1, "x_m": "left", "y_m": 1}]}]}"#);
        let message = error.unwrap_err().to_string();
        assert!(message.contains("truth.json: frames[0].targets[0].x_m: invalid type"), "{message}");
        let none = tempfile::tempdir().unwrap();
        assert_eq!(Truth::of_recording(none.path()).unwrap(), None);
    }
}
