//! The reference data of the doorway camera, for tests of every crate: their location and file formats.
// Each test program uses only a part of it.
#![allow(dead_code)]

use std::io::Read;
use std::path::{Path, PathBuf};

use doorcam_core::geometry::Doorway;

/// A path below the reference data. Prints a note and returns `None` if this machine does not have it.
pub fn data(path: &str) -> Option<PathBuf> {
    let root = std::env::var_os("DOORCAM_DATA").map(PathBuf::from).unwrap_or_else(|| {
        // Beside the repository, whichever of its crates runs the test.
        let top = Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().find(|d| d.join("Cargo.lock").exists());
        top.unwrap_or(Path::new(".")).join("../shared/data")
    });
    let full = root.join(path);
    if full.exists() {
        return Some(full);
    }
    eprintln!("SKIPPED: no reference data at {} (set DOORCAM_DATA to have this tested)", full.display());
    None
}

/// A two-dimensional array of an NPY file (version 1, little-endian f64), as (rows, columns, row-major values).
pub fn npy(path: &Path) -> (usize, usize, Vec<f64>) {
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

/// An array of little-endian f32 of an NPZ file (a ZIP archive of NPY files), as (shape, values in row-major order).
pub fn npz_f32(path: &Path, name: &str) -> (Vec<usize>, Vec<f32>) {
    let bytes = std::fs::read(path).expect("readable NPZ file");
    let u16_at = |at: usize| usize::from(u16::from_le_bytes([bytes[at], bytes[at + 1]]));
    let u32_at = |at: usize| u16_at(at) | u16_at(at + 2) << 16;
    // The end record locates the central directory, which locates each file.
    let end = (0..bytes.len() - 21).rev().find(|&k| bytes[k..].starts_with(b"PK\x05\x06")).expect("a ZIP archive");
    let mut entry = u32_at(end + 16);
    for _ in 0..u16_at(end + 10) {
        let (name_len, rest) = (u16_at(entry + 28), u16_at(entry + 30) + u16_at(entry + 32));
        if &bytes[entry + 46..entry + 46 + name_len] == format!("{name}.npy").as_bytes() {
            let (packed, local) = (u32_at(entry + 20), u32_at(entry + 42));
            let start = local + 30 + u16_at(local + 26) + u16_at(local + 28);
            let mut npy = Vec::new();
            let deflated = &bytes[start..start + packed];
            flate2::read::DeflateDecoder::new(deflated).read_to_end(&mut npy).expect("deflated data");
            let data = 10 + usize::from(u16::from_le_bytes([npy[8], npy[9]]));
            let header = std::str::from_utf8(&npy[10..data]).expect("ASCII header");
            assert!(header.contains("'<f4'") && header.contains("'fortran_order': False"), "{header}");
            let shape = header.split("'shape': (").nth(1).and_then(|s| s.split(')').next()).expect("shape");
            let shape = shape.split(',').filter_map(|n| n.trim().parse().ok()).collect();
            let values = npy[data..].chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().expect("4 bytes")));
            return (shape, values.collect());
        }
        entry += 46 + name_len + rest;
    }
    panic!("{} has no {name}", path.display());
}

/// The published doorway: 20 inches wide, a thin wall.
pub fn published_doorway() -> Doorway {
    Doorway { width_m: 0.508, wall_thickness_m: 0.0, height_m: None, leaf: None }
}
