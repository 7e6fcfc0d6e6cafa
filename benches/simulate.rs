//! Simulating a whole frame, with nobody and with two people, and setting up a scenario.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use doorcam_engine::simulation::{FrameFormat, Scenario, Simulator};

fn simulate(c: &mut Criterion) {
    let scenario = |format| {
        let mut scenario = Scenario::load("two-crossing").unwrap();
        scenario.camera.format = format;
        scenario
    };
    let mut group = c.benchmark_group("simulate");
    group.sample_size(20);
    for (name, format) in [("raw", FrameFormat::Rgb), ("jpeg", FrameFormat::Jpeg)] {
        let simulator = Simulator::new(scenario(format), 1).unwrap();
        let (empty, crowded) = (0, simulator.scenario().background_frames() + 105);
        assert_eq!(simulator.truth(crowded).targets.len(), 2);
        group.bench_function(format!("empty room, {name}"), |b| b.iter(|| simulator.frame(black_box(empty))));
        group.bench_function(format!("two people, {name}"), |b| b.iter(|| simulator.frame(black_box(crowded))));
    }
    group.bench_function("set up", |b| b.iter(|| Simulator::new(scenario(FrameFormat::Rgb), 1)));
    group.finish();
}

criterion_group!(benches, simulate);
criterion_main!(benches);
