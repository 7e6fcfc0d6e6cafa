//! Cold and warm solves on the published grid: two people walk, the wall behind them darkens, and the camera is noisy.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use doorcam_core::geometry::{Doorway, Facet, FacetGrid, GridSpec, Side};
use doorcam_core::light::PatchPair;
use doorcam_core::solver::{
    Admissible, Columns, Correlations, Limits, Nuisance, Pixels, Projection, Solution, Solver, Start,
};
use doorcam_core::transport::edge_foot_mask;
use doorcam_core::transport::{Kernel, PatchGrid, PixelLayout, Transport, TransportSpec};

const DOORWAY: Doorway = Doorway { width_m: 0.508, wall_thickness_m: 0.0, height_m: None, leaf: None };
const PATCH: PatchGrid = PatchGrid { size: 64, fov_m: 0.15, layout: PixelLayout::EndsIncluded };
const SPEC: TransportSpec = TransportSpec { kernel: Kernel::Published, facet_height_m: 2.0, patch: PATCH };
const FRAMES: usize = 24;
/// Standard deviation of a pixel's noise: a few percent of the strongest change.
const NOISE: f64 = 0.002;

/// Nearly normal numbers, as sums of uniform ones; the same in every run.
fn noise(state: &mut u64) -> f64 {
    let mut sum = -6.0;
    for _ in 0..12 {
        *state ^= *state << 13;
        *state ^= *state >> 7;
        *state ^= *state << 17;
        sum += (*state >> 11) as f64 / (1_u64 << 53) as f64;
    }
    sum
}

/// Differences on the floor due to people who stand off the grid and move on 5 cm with each frame, as correlations.
fn walk(projection: &Projection) -> Vec<Correlations> {
    let mut state = 1;
    let strip = |x: f64, y: f64, half: f64| Facet { from: [x - half, y], to: [x + half, y] };
    let colours = [[0.2, 0.03, 0.05], [0.03, 0.05, 0.15], [-0.05, -0.05, -0.04], [-0.02, -0.03, -0.02]];
    let frame = |t: usize| {
        let way = 0.05 * t as f64;
        let (a, b) = (-0.6 + way, 0.8 - way);
        let strips = [strip(a, 1.2, 0.2), strip(b, 1.9, 0.15), strip(2.0 * a, 2.97, 0.3), strip(1.5 * b, 2.97, 0.2)];
        let transport = Transport::new(&DOORWAY, &strips, &SPEC);
        let mut difference = PatchPair::zeros(PATCH.size);
        for side in Side::BOTH {
            for p in [0, 1, 2] {
                let light = transport.side(side) * nalgebra::Vector4::from(colours.map(|rgb| rgb[p]));
                let plane = difference.side_mut(side).plane_mut(p);
                for (pixel, light) in plane.iter_mut().zip(light.iter()) {
                    *pixel = (light + NOISE * noise(&mut state)) as f32;
                }
            }
        }
        let mut correlations = projection.correlations();
        projection.project(&difference, &mut correlations).map(|()| correlations)
    };
    (0..FRAMES).map(frame).collect::<Result<_, _>>().expect("finite measurements")
}

fn solves(criterion: &mut Criterion) {
    let grid = FacetGrid::new(&DOORWAY, &GridSpec::published()).expect("the published grid");
    let transport = Transport::new(&DOORWAY, &grid.facets, &SPEC);
    let pixels = Pixels::uniform(&[edge_foot_mask(&PATCH), edge_foot_mask(&PATCH)]);
    let constant = Nuisance::constant(PATCH.pixels());
    let published = |&f: &bool| if f { Admissible::Brighter } else { Admissible::EitherSign };
    let models = [
        ("published", Columns::Radiance, grid.foreground.iter().map(published).collect()),
        ("signed", Columns::UnitNorm, vec![Admissible::Signed; grid.len()]),
    ];
    for (name, columns, admissible) in models {
        let projection = Projection::new(&transport, &pixels, &constant, columns);
        let frames = walk(&projection);
        let solver = Solver::new(projection.gram(), admissible);
        let lambda = 0.1 * solver.lambda_max(&frames[0]);
        let (mut workspace, mut solution) = (solver.workspace(), Solution::default());
        let mut solve = |t: usize, start: Start| {
            solver.solve_into(&frames[t], lambda, Limits::default(), start, &mut workspace, &mut solution);
            black_box(solution.objective())
        };
        let mut t = 0;
        criterion.bench_function(&format!("{name}/cold"), |b| {
            b.iter(|| {
                t = (t + 1) % FRAMES;
                solve(t, Start::Empty)
            });
        });
        // Back and forth, so that in every frame the people are 5 cm from where they were in the frame before.
        let mut t = 0;
        criterion.bench_function(&format!("{name}/warm"), |b| {
            b.iter(|| {
                t = (t + 1) % (2 * FRAMES - 2);
                solve(t.min(2 * FRAMES - 2 - t), Start::Previous)
            });
        });
    }
}

criterion_group!(benches, solves);
criterion_main!(benches);
