//! Projecting a frame onto the Gram system: Aᵀy of both patches, 64 x 64 pixels, N = 230, one core.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use doorcam_core::geometry::{Doorway, FacetGrid, GridSpec};
use doorcam_core::light::PatchPair;
use doorcam_core::solver::{Columns, Nuisance, Pixels, Projection};
use doorcam_core::transport::edge_foot_mask;
use doorcam_core::transport::{Kernel, PatchGrid, PixelLayout, Transport, TransportSpec};

fn project(c: &mut Criterion) {
    let doorway = Doorway { width_m: 0.508, wall_thickness_m: 0.0, height_m: None, leaf: None };
    let Ok(grid) = FacetGrid::new(&doorway, &GridSpec::published()) else { return };
    let patch = PatchGrid { size: 64, fov_m: 0.3, layout: PixelLayout::Cells };
    let spec = TransportSpec { kernel: Kernel::Radiometric, facet_height_m: 2.0, patch };
    let transport = Transport::new(&doorway, &grid.facets, &spec);
    let counted = edge_foot_mask(&patch);
    let pixels = Pixels::uniform(&[counted.clone(), counted]);
    let nuisance = Nuisance::constant(patch.pixels());
    let projection = Projection::new(&transport, &pixels, &nuisance, Columns::UnitNorm);
    let mut y = PatchPair::zeros(64);
    for (k, value) in y.left.data_mut().iter_mut().enumerate() {
        *value = 0.01 * (k as f32 * 0.37).sin();
    }
    let mut out = projection.correlations();
    println!("products a frame: {:?}", projection.rank());
    c.bench_function("project", |b| b.iter(|| projection.project(black_box(&y), &mut out)));
}

criterion_group!(benches, project);
criterion_main!(benches);
