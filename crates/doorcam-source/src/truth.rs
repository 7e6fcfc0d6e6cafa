//! Where everybody in the hidden room really is: `truth.json` (DESIGN: the recording contract).

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use doorcam_core::scene::Rgb;

/// The truth of a recording.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Truth {
    /// Frame by frame; a frame that is missing is not known.
    pub frames: Vec<TrueFrame>,
}

/// Who is there in one frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TrueFrame {
    /// Number of the frame.
    pub index: u64,
    /// Its time, in seconds.
    pub t: f64,
    /// Everybody in the room.
    pub targets: Vec<Target>,
}

/// One person.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Target {
    /// Who it is.
    pub id: u64,
    /// The body's axis, in metres in the door frame.
    pub x_m: f64,
    /// The same, into the room.
    pub y_m: f64,
    /// The body's radius, in metres.
    #[serde(default)]
    pub radius_m: f64,
    /// Its colour.
    #[serde(default)]
    pub rgb: Rgb,
}

/// Why there is no truth to compare with.
#[derive(Debug, thiserror::Error)]
pub enum TruthError {
    /// It cannot be read.
    #[error("{0}: {1}")]
    Io(PathBuf, std::io::Error),
    /// It is not what it should be.
    #[error("{path}: {key}: {message}")]
    Invalid {
        /// The file.
        path: PathBuf,
        /// Where in it.
        key: String,
        /// What is wrong.
        message: String,
    },
}

impl Truth {
    /// Name of the file in a recording.
    pub const FILE: &str = "truth.json";

    /// Reads the truth of a recording; none if it has none.
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
