//! Building the transport matrices, 2 x 64² x 230, on all cores, and the Gram matrices.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use doorcam_core::geometry::{Doorway, FacetGrid, GridSpec};
use doorcam_core::solver::{Columns, Nuisance, Pixels, Projection};
use doorcam_core::transport::edge_foot_mask;
use doorcam_core::transport::{Kernel, PatchGrid, PixelLayout, Transport, TransportSpec};

fn transport(c: &mut Criterion) {
    let doorway = Doorway { width_m: 0.508, wall_thickness_m: 0.0, height_m: None, leaf: None };
    let Ok(grid) = FacetGrid::new(&doorway, &GridSpec::published()) else { return };
    let mut group = c.benchmark_group("transport");
    group.sample_size(10);
    for (name, kernel, layout, fov_m) in [
        ("published", Kernel::Published, PixelLayout::EndsIncluded, 0.15),
        ("radiometric", Kernel::Radiometric, PixelLayout::Cells, 0.3),
    ] {
        let patch = PatchGrid { size: 64, fov_m, layout };
        let spec = TransportSpec { kernel, facet_height_m: 2.0, patch };
        group.bench_function(name, |b| b.iter(|| black_box(Transport::new(&doorway, &grid.facets, &spec))));
        let transport = Transport::new(&doorway, &grid.facets, &spec);
        let counted = edge_foot_mask(&patch);
        let pixels = Pixels::uniform(&[counted.clone(), counted]);
        let nuisance = Nuisance::constant(patch.pixels());
        group.bench_function(format!("{name}, Gram matrices"), |b| {
            b.iter(|| black_box(Projection::new(&transport, &pixels, &nuisance, Columns::Radiance)))
        });
    }
    group.finish();
}

criterion_group!(benches, transport);
criterion_main!(benches);
