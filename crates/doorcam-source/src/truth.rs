//! Ground truth of a recording, where everybody in the hidden room really is: `truth.json` (docs/recordings.md).

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use doorcam_core::scene::Rgb;

/// The truth of a recording.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Truth {
    /// Frame by frame. Of a frame that is not listed, the truth is unknown.
    pub frames: Vec<TrueFrame>,
}

/// Who is there in one frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TrueFrame {
    /// Number of the frame.
    pub index: u64,
    /// Time of the frame, in seconds.
    pub t: f64,
    /// Everybody in the hidden room.
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
    Io(PathBuf, std::io::Error),
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
        let text = match std::fs::read_to_string(&path) {
            Ok(text) => text,
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(None),
            Err(e) => return Err(TruthError::Io(path, e)),
        };
        let mut json = serde_json::Deserializer::from_str(&text);
        match serde_path_to_error::deserialize(&mut json) {
            Ok(truth) => Ok(Some(truth)),
            Err(e) => {
                let key = e.path().to_string();
                Err(TruthError::Invalid { path, key, message: e.into_inner().to_string() })
            }
        }
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
    fn errors_name_the_file_and_the_key() {
        let error = read(r#"{"frames": [{"index": 0, "t": 0, "targets": [{"id": 1, "x_m": "left", "y_m": 1}]}]}"#);
        let message = error.unwrap_err().to_string();
        assert!(message.contains("truth.json: frames[0].targets[0].x_m: invalid type"), "{message}");
        let none = tempfile::tempdir().unwrap();
        assert_eq!(Truth::of_recording(none.path()).unwrap(), None);
    }
}
