use std::sync::Arc;

use jiff::{SignedDuration, Timestamp};
use serde::{Deserialize, Serialize};

use crate::geometry::Side;
use crate::light::{PatchPair, Snapshot};

/// First line of the file: its type and format version.
const MAGIC: &[u8] = b"doorcam background 1\n";
/// Most deviations that are saved: enough for noise and drift, few enough for a memory card.
const SAVED: usize = 16;
/// Most bytes of a header.
const LONGEST_HEADER: usize = 1 << 16;

/// Text that identifies everything a background depends on. Different fingerprints mean different doorways, cameras or
/// exposures.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Fingerprint(String);

impl Fingerprint {
    /// A fingerprint from a text that describes everything.
    pub fn new(description: impl Into<String>) -> Self {
        Self(description.into())
    }
}

/// Why a saved background is not used.
#[derive(Debug, thiserror::Error)]
pub enum LoadError {
    /// It is not a background, incomplete, or of another version.
    #[error("it is damaged: {0}")]
    Damaged(&'static str),
    /// It belongs to another doorway, camera position or exposure.
    #[error("it was learned with another geometry, exposure or averaging")]
    Other,
    /// It is so old that the light has probably changed.
    #[error("it is {0} hours old")]
    Old(i64),
    /// It was saved later than now, so its age is unknown: the clock is wrong, or was when it was saved.
    #[error("it was saved at {0}, which is later than now: the clock is or was wrong")]
    Future(Timestamp),
}

/// Second line of the file. The pictures follow as little-endian 32-bit floats: the mean, then the deviations from it,
/// each with the left patch first.
#[derive(Serialize, Deserialize)]
struct Header {
    fingerprint: Fingerprint,
    saved: Timestamp,
    size: usize,
    averaged: f64,
    deviations: usize,
    checksum: u64,
}

impl Snapshot {
    /// Encodes the snapshot as the bytes of a file that [`Snapshot::decode`] reads.
    ///
    /// # Errors
    ///
    /// If the header cannot be serialised.
    pub fn encode(&self, fingerprint: &Fingerprint) -> Result<Vec<u8>, serde_json::Error> {
        // The latest deviations describe the current light.
        let deviations = &self.deviations[self.deviations.len().saturating_sub(SAVED)..];
        let mut body = Vec::new();
        for pair in std::iter::once(&self.mean).chain(deviations.iter().map(Arc::as_ref)) {
            for side in Side::BOTH {
                pair.side(side).data().iter().for_each(|v| body.extend_from_slice(&v.to_le_bytes()));
            }
        }
        let header = Header {
            fingerprint: fingerprint.clone(),
            saved: Timestamp::now(),
            size: self.mean.left.size(),
            averaged: self.averaged,
            deviations: deviations.len(),
            checksum: checksum(&body),
        };
        let mut file = MAGIC.to_vec();
        serde_json::to_writer(&mut file, &header)?;
        file.push(b'\n');
        file.extend_from_slice(&body);
        Ok(file)
    }

    /// Largest size, in bytes, of a file with a background of patches of `size` x `size` pixels. There is no need to
    /// read more.
    pub fn longest(size: usize) -> usize {
        MAGIC.len() + LONGEST_HEADER + (1 + SAVED) * bytes(size)
    }

    /// Decodes the bytes of a file.
    ///
    /// # Errors
    ///
    /// If the file is damaged, has another fingerprint, has patches of another size than `size` x `size` pixels, or is
    /// older than `keep_s` seconds.
    pub fn decode(file: &[u8], fingerprint: &Fingerprint, size: usize, keep_s: f64) -> Result<Self, LoadError> {
        let rest = file
            .strip_prefix(MAGIC)
            .ok_or(LoadError::Damaged("it does not begin like a background of this version"))?;
        let end = rest.iter().take(LONGEST_HEADER).position(|&b| b == b'\n');
        let (header, body) = rest.split_at(end.ok_or(LoadError::Damaged("it ends in its header"))?);
        let header: Header =
            serde_json::from_slice(header).map_err(|_| LoadError::Damaged("its header is not readable"))?;
        let body = &body[1..];
        if header.fingerprint != *fingerprint || header.size != size {
            return Err(LoadError::Other);
        }
        if header.deviations > SAVED || body.len() != (1 + header.deviations) * bytes(size) {
            return Err(LoadError::Damaged("it does not have the expected length"));
        }
        if checksum(body) != header.checksum {
            return Err(LoadError::Damaged("its checksum is wrong"));
        }
        let age = Timestamp::now().duration_since(header.saved);
        if age < SignedDuration::from_mins(-1) {
            return Err(LoadError::Future(header.saved));
        }
        if age.as_secs_f64() > keep_s {
            return Err(LoadError::Old(age.as_hours()));
        }
        let mut pairs = body.chunks_exact(bytes(size)).map(|chunk| pair(chunk, size));
        let mean = pairs.next().ok_or(LoadError::Damaged("it has no picture"))?;
        let snapshot = Self { mean, averaged: header.averaged, deviations: pairs.map(Arc::new).collect() };
        let finite = |pair: &PatchPair| Side::BOTH.iter().all(|&s| pair.side(s).data().iter().all(|v| v.is_finite()));
        let all_finite = finite(&snapshot.mean) && snapshot.deviations.iter().all(|d| finite(d));
        if !all_finite || !snapshot.averaged.is_finite() || snapshot.averaged < 1.0 {
            return Err(LoadError::Damaged("it has values that are not numbers"));
        }
        Ok(snapshot)
    }
}

/// Size of a patch pair, in bytes.
fn bytes(size: usize) -> usize {
    2 * 3 * size * size * size_of::<f32>()
}

fn pair(bytes: &[u8], size: usize) -> PatchPair {
    let mut pair = PatchPair::zeros(size);
    let mut values = bytes.chunks_exact(size_of::<f32>()).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]));
    for side in Side::BOTH {
        pair.side_mut(side).data_mut().iter_mut().zip(&mut values).for_each(|(value, read)| *value = read);
    }
    pair
}

/// FNV-1a, 64 bits: detects damage, not tampering.
fn checksum(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |hash, &b| (hash ^ u64::from(b)).wrapping_mul(0x100_0000_01b3))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::light::noise::tests::{SIZE, frames};
    use crate::light::{Background, NoiseModel, RollingBackground};

    const DAY: f64 = 86_400.0;

    fn snapshot() -> Snapshot {
        let mut background = Background::new(SIZE);
        frames(20, NoiseModel { read: 1e-6, shot: 0.0 }, 0.0).iter().for_each(|f| background.learn(f));
        RollingBackground::from_background(&background).snapshot()
    }

    fn here() -> Fingerprint {
        Fingerprint::new("doorway 0.8 m, exposure 10 ms")
    }

    fn saved() -> Vec<u8> {
        snapshot().encode(&here()).unwrap()
    }

    #[test]
    fn what_is_saved_comes_back() {
        let bytes = saved();
        assert!(bytes.len() <= Snapshot::longest(SIZE));
        let (saved, loaded) = (snapshot(), Snapshot::decode(&bytes, &here(), SIZE, DAY).unwrap());
        assert_eq!((&loaded.mean, loaded.averaged), (&saved.mean, 20.0));
        assert_eq!(loaded.deviations, saved.deviations[4..]);
    }

    #[test]
    fn what_does_not_belong_here_is_refused_and_says_why() {
        let bytes = saved();
        let refused = |fingerprint: &str, size: usize, keep_s: f64| {
            Snapshot::decode(&bytes, &Fingerprint::new(fingerprint), size, keep_s).map(|_| ()).unwrap_err()
        };
        assert!(matches!(refused("doorway 0.8 m, exposure 20 ms", SIZE, DAY), LoadError::Other));
        assert!(matches!(refused(&here().0, 2 * SIZE, DAY), LoadError::Other));
        assert!(matches!(refused(&here().0, SIZE, -1.0), LoadError::Old(0)));
    }

    #[test]
    fn a_background_from_the_future_has_no_age() {
        let bytes = saved();
        let text = String::from_utf8_lossy(&bytes[..200]).into_owned();
        let at = text.find("\"saved\":\"").unwrap() + 9;
        let mut later = bytes.clone();
        later[at..at + 4].copy_from_slice(b"2999");
        let error = Snapshot::decode(&later, &here(), SIZE, DAY).map(drop).unwrap_err().to_string();
        assert!(error.starts_with("it was saved at 2999-") && error.contains("later than now"), "{error}");
    }

    proptest! {
        #[test]
        fn damaged_files_are_refused(at in any::<prop::sample::Index>(), byte in any::<u8>(), cut in any::<bool>()) {
            let mut bytes = saved();
            let at = at.index(bytes.len());
            let same = bytes[at] == byte;
            if cut { bytes.truncate(at) } else { bytes[at] = byte }
            match Snapshot::decode(&bytes, &here(), SIZE, 1e9) {
                // Changing a digit of the saving time or of the number of frames gives another valid file.
                Ok(loaded) => prop_assert!(!cut && (same || loaded.mean == snapshot().mean)),
                Err(e) => prop_assert!(cut || !same, "{e}"),
            }
        }

        #[test]
        fn any_bytes_are_refused(bytes in prop::collection::vec(any::<u8>(), 0..300), header in any::<bool>()) {
            let bytes = if header { [MAGIC, &bytes].concat() } else { bytes };
            prop_assert!(Snapshot::decode(&bytes, &here(), SIZE, DAY).is_err());
        }
    }
}
