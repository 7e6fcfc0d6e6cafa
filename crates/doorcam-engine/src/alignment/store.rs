use std::path::PathBuf;

use doorcam_core::alignment::{Motion, Overview, Reference};
use doorcam_core::calibration::Calibration;
use doorcam_source::files::{self, FileKind, replace};
use serde::{Deserialize, Serialize};

use crate::background::{Job, Work};

/// Keeps the reference picture in a file that only its owner can read.
pub(super) struct ReferenceStore {
    file: PathBuf,
    work: Work,
    saving: Option<Job<()>>,
}

/// The first line of the file. After it come the picture's codes, two bytes each, the low one first; 65535 is white.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Header {
    version: u32,
    size: [usize; 2],
    scale: usize,
    /// The calibration when the picture was taken.
    calibration: Calibration,
    /// How the camera has moved since, as far as the calibration in use follows it.
    motion: Motion,
}

const VERSION: u32 = 1;
/// Codes are kept in units of 1/257 of an 8-bit code.
const FINER: f32 = 257.0;
/// A header with the most floor points has 10 kB, the largest picture half a megabyte.
const KIND: FileKind = FileKind::new("a reference picture", 4 << 20);
/// Points of a calibration that differ by less, in pixels, are the same: numbers are rounded when they are saved.
const SAME_PX: f64 = 0.01;

impl ReferenceStore {
    pub fn new(file: PathBuf, work: Work) -> Self {
        Self { file, work, saving: None }
    }

    /// The picture that belongs to `calibration`: with the calibration of its time, and how the camera moved since.
    pub fn load(&self, calibration: &Calibration) -> Option<(Reference, Calibration, Motion)> {
        let name = self.file.display();
        let bytes = match files::read(&self.file, KIND) {
            Ok(bytes) => bytes,
            Err(e) if e.is_missing() => return None,
            Err(e) => {
                tracing::warn!("{name}: the reference picture is not used: {}", e.words());
                return None;
            }
        };
        let Some((header, overview)) = decode(&bytes) else {
            tracing::warn!("{name}: the reference picture is not used: it is damaged or of another version of doorcam");
            return None;
        };
        if !is_same(&super::moved_calibration(&header.calibration, &header.motion), calibration) {
            tracing::info!("{name}: the reference picture belongs to another calibration: a new one is taken");
            return None;
        }
        Some((Reference::new(overview)?, header.calibration, header.motion))
    }

    /// Saves the picture, on another thread unless work is done in place. What is being saved is finished first.
    pub fn save(&mut self, overview: &Overview, calibration: &Calibration, motion: &Motion) {
        if let Some(before) = self.saving.take() {
            // Seconds have passed since, except in tests.
            before.wait();
        }
        let (file, bytes) = (self.file.clone(), encode(overview, calibration, motion));
        self.saving = Some(Job::start(self.work, "save", move || {
            if let Err(e) = replace(&file, &bytes) {
                tracing::warn!("{}: the reference picture cannot be saved: {e}", file.display());
            }
        }));
    }
}

fn encode(overview: &Overview, calibration: &Calibration, motion: &Motion) -> Vec<u8> {
    let header = Header {
        version: VERSION,
        size: [overview.width, overview.height],
        scale: overview.scale,
        calibration: calibration.clone(),
        motion: *motion,
    };
    // Serialising cannot fail: there are no maps, and what is not finite becomes null.
    let mut bytes = serde_json::to_vec(&header).unwrap_or_default();
    bytes.push(b'\n');
    let codes = overview.codes.iter().map(|code| (code * FINER).round().clamp(0.0, 65535.0) as u16);
    bytes.extend(codes.flat_map(u16::to_le_bytes));
    bytes
}

fn decode(bytes: &[u8]) -> Option<(Header, Overview)> {
    let end = bytes.iter().position(|&byte| byte == b'\n')?;
    let header: Header = serde_json::from_slice(&bytes[..end]).ok()?;
    let [width, height] = header.size;
    let codes: Vec<f32> = bytes[end + 1..]
        .chunks_exact(2)
        .map(|code| f32::from(u16::from_le_bytes([code[0], code[1]])) / FINER)
        .collect();
    let [across, down] = header.calibration.size;
    let scale = header.scale;
    let fits = header.version == VERSION
        && scale == Overview::scale_of(across)
        && (width, height) == (across / scale, down / scale)
        && codes.len() == width * height;
    fits.then_some((header, Overview { width, height, scale, codes }))
}

fn is_same(one: &Calibration, other: &Calibration) -> bool {
    let points = one
        .floor_points
        .iter()
        .zip(&other.floor_points)
        .all(|(a, b)| a.floor_m == b.floor_m && (0..2).all(|k| (a.pixel[k] - b.pixel[k]).abs() < SAME_PX));
    points
        && one.floor_points.len() == other.floor_points.len()
        && (one.size, one.doorway, one.lens) == (other.size, other.doorway, other.lens)
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::PermissionsExt;

    use super::*;

    fn calibration() -> Calibration {
        serde_json::from_str(
            r#"{"size": [64, 36], "doorway": {"width_m": 0.6, "wall_thickness_m": 0.1}, "floor_points": [
                {"pixel": [5, 2], "floor_m": [-0.5, -0.1]}, {"pixel": [55, 2], "floor_m": [0.5, -0.1]},
                {"pixel": [55, 17], "floor_m": [0.5, -0.4]}, {"pixel": [5, 17], "floor_m": [-0.5, -0.4]}]}"#,
        )
        .unwrap()
    }

    fn picture() -> Overview {
        let codes = (0..64 * 36).map(|k| if (k % 64 / 8 + k / 64 / 8) % 2 == 0 { 20.25 } else { 200.0 }).collect();
        Overview { width: 64, height: 36, scale: 1, codes }
    }

    #[test]
    fn a_picture_is_found_again_with_its_own_calibration_only() {
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("reference.bin");
        let mut store = ReferenceStore::new(file.clone(), Work::InPlace);
        assert!(store.load(&calibration()).is_none(), "there is no file");
        let motion = Motion { shift_px: [1.5, -0.25], rotation: 0.01, ..Motion::none([31.5, 17.5]) };
        store.save(&picture(), &calibration(), &motion);
        assert_eq!(std::fs::metadata(&file).unwrap().permissions().mode() & 0o777, 0o600);
        assert!(store.load(&calibration()).is_none(), "the calibration in use has followed the camera");
        let (reference, then, since) = store.load(&super::super::moved_calibration(&calibration(), &motion)).unwrap();
        assert_eq!((then, since), (calibration(), motion));
        let kept = reference.overview();
        assert!(kept.is_like(&picture()) && kept.codes.iter().zip(picture().codes).all(|(a, b)| (a - b).abs() < 0.01));
        let bytes = std::fs::read(&file).unwrap();
        for damaged in [&bytes[..bytes.len() - 1], &bytes[..100], b"", b"\n", &[b"x".as_slice(), &bytes].concat()] {
            assert!(decode(damaged).is_none());
        }
    }
}
