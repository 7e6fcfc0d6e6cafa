//! Where the tests' reference data is, and the readers for it.
#![allow(dead_code)]

use std::path::PathBuf;

/// A path below the reference data, or none, saying so, if this machine does not have it.
pub fn data(path: &str) -> Option<PathBuf> {
    let root = std::env::var_os("DOORCAM_DATA")
        .map(PathBuf::from)
        .unwrap_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/data"));
    let full = root.join(path);
    if full.exists() {
        return Some(full);
    }
    eprintln!("SKIPPED: no reference data at {} (set DOORCAM_DATA to have this tested)", full.display());
    None
}

/// A two-dimensional array of a NPY file (version 1, little-endian f64), as (rows, columns, values in row-major order).
pub fn npy(path: &std::path::Path) -> (usize, usize, Vec<f64>) {
    let bytes = std::fs::read(path).expect("readable NPY file");
    let header_len = u16::from_le_bytes([bytes[8], bytes[9]]) as usize;
    let header = std::str::from_utf8(&bytes[10..10 + header_len]).expect("ASCII header");
    assert!(header.contains("'<f8'"), "{header}");
    let fortran = header.contains("'fortran_order': True");
    let shape: Vec<usize> = header
        .split("'shape': (")
        .nth(1)
        .and_then(|s| s.split(')').next())
        .expect("shape")
        .split(',')
        .filter_map(|n| n.trim().parse().ok())
        .collect();
    let (rows, columns) = (shape[0], shape[1]);
    let raw: Vec<f64> =
        bytes[10 + header_len..].chunks_exact(8).map(|b| f64::from_le_bytes(b.try_into().expect("8 bytes"))).collect();
    assert_eq!(raw.len(), rows * columns);
    if !fortran {
        return (rows, columns, raw);
    }
    (rows, columns, (0..rows * columns).map(|k| raw[(k % columns) * rows + k / columns]).collect())
}

/// The published doorway: 20 inches wide, a thin wall.
pub fn published_doorway() -> doorcam::geometry::Doorway {
    doorcam::geometry::Doorway { width_m: 0.508, wall_thickness_m: 0.0, height_m: None }
}
