//! Compares the grid and the transport matrices with the authors' published ones.

use crate::reference::{data, npy, published_doorway};
use doorcam_core::geometry::{FacetGrid, GridSpec};
use doorcam_core::transport::{Kernel, PatchGrid, PixelLayout, Transport, TransportSpec};

#[test]
fn the_grid_is_the_published_one_in_its_order() {
    let Some(path) = data("reference/grid.json") else { return };
    let json: serde_json::Value = serde_json::from_slice(&std::fs::read(path).expect("read")).expect("JSON");
    let facets: Vec<[[f64; 2]; 2]> = serde_json::from_value(json["facets"].clone()).expect("facets");
    let foreground: Vec<bool> = serde_json::from_value(json["foreground"].clone()).expect("foreground");
    let grid = FacetGrid::new(&published_doorway(), &GridSpec::published()).expect("grid");
    assert_eq!(grid.len(), facets.len());
    for (n, (ours, theirs)) in grid.facets.iter().zip(&facets).enumerate() {
        for (p, q) in [ours.from, ours.to].iter().zip(theirs) {
            assert!((p[0] - q[0]).abs() < 1e-9 && (p[1] - q[1]).abs() < 1e-9, "facet {n}: {ours:?} {theirs:?}");
        }
    }
    assert_eq!(grid.foreground, foreground);
}

#[test]
fn the_published_transport_is_the_published_one() {
    for size in [16, 32] {
        let Some(path) = data(&format!("reference/transport-{size}.npy")) else { return };
        let (rows, columns, theirs) = npy(&path);
        let grid = FacetGrid::new(&published_doorway(), &GridSpec::published()).expect("grid");
        let patch = PatchGrid { size, fov_m: 0.15, layout: PixelLayout::EndsIncluded };
        let spec = TransportSpec { kernel: Kernel::Published, facet_height_m: 2.0, patch };
        let ours = Transport::new(&published_doorway(), &grid.facets, &spec);
        assert_eq!((rows, columns), (2 * size * size, grid.len()));
        let mut worst = 0.0_f64;
        for k in 0..size * size {
            // Their pixels are in column-major order.
            let (row, column) = (k / size, k % size);
            let their_row = column * size + row;
            for n in 0..columns {
                let left = theirs[their_row * columns + n];
                let right = theirs[(their_row + size * size) * columns + n];
                for (a, b) in [(ours.left[(k, n)], left), (ours.right[(k, n)], right)] {
                    if a != b {
                        worst = worst.max((a - b).abs() / b.abs());
                    }
                }
            }
        }
        assert!(worst <= 1e-12, "{size} x {size}: worst relative difference {worst:e}");
    }
}
