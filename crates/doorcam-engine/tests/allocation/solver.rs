//! From the difference to the solution and its refit, a frame allocates nothing once this path has been run before.
//!
//! The results for others (scene, update and its JSON text) are new vectors for every frame: they are shared with all
//! clients and outlive the frame.

use crate::allocations;
use crate::solver_problems::Problem;
use doorcam_core::geometry::Side;
use doorcam_core::light::{Averager, Averaging, Background, PatchPair, RollingBackground};
use doorcam_core::solver::{Admissible, Limits, Solution, Start};
use doorcam_core::transport::PatchGrid;
use doorcam_engine::simulation::luminous::direct::Cylinder;
use doorcam_engine::simulation::luminous::{Renderer, Scenario, Sensor};
use doorcam_engine::{Model, Settings};

pub fn check() {
    for kind in [Admissible::Brighter, Admissible::EitherSign, Admissible::Signed] {
        let problem = Problem::random(60, 40, 7, |_| kind);
        let solver = problem.solver();
        let mut workspace = solver.workspace();
        let (mut solution, mut factors) = (Solution::default(), Vec::new());
        let lambda = 0.05 * solver.lambda_max(&problem.frame);
        let mut solve = |share: f64, start: Start| {
            solver.solve_into(&problem.frame, share * lambda, Limits::default(), start, &mut workspace, &mut solution);
            solver.refit(&problem.frame, &solution, &mut factors);
            assert!(solution.intensities.iter().any(|i| i.left != 0.0));
            assert!(factors.iter().any(|&f| f > 1.0));
        };
        solve(1.0, Start::Empty);
        assert_eq!(allocations(|| solve(1.0, Start::Empty)), 0, "{kind:?}, again");
        assert_eq!(allocations(|| solve(2.0, Start::Previous)), 0, "{kind:?}, warm");
        assert_eq!(allocations(|| solve(1.5, Start::Previous)), 0, "{kind:?}, warm");
    }
    from_patches();
}

/// Difference, projection, λ, solution and refit, with somebody who walks.
fn from_patches() {
    let scenario = Scenario { patch: PatchGrid { size: 32, ..Scenario::demo().patch }, ..Scenario::demo() };
    let renderer = Renderer::new(&scenario);
    let model = Model::new(&Settings::default(), scenario.doorway, scenario.patch, None).unwrap();
    let expose = |light: &PatchPair, frame: u64| {
        let mut generator = Sensor::generator(1, frame);
        let mut pair = light.clone();
        for side in Side::BOTH {
            let codes = scenario.sensor.expose(light.side(side), &mut generator);
            for (k, code) in codes.into_iter().enumerate() {
                pair.side_mut(side).plane_mut(k % 3)[k / 3] = f32::from(code) / 65535.0;
            }
        }
        pair
    };
    let mut background = Background::new(scenario.patch.size);
    (0..8).for_each(|frame| background.learn(&expose(renderer.empty(), frame)));
    let frames = [-0.2, -0.1, 0.0, 0.1].map(|x| {
        let body = Cylinder { centre: [x, 1.2], radius_m: 0.2, height_m: 1.8, radiance: [0.5, 0.2, 0.1] };
        expose(&renderer.render(vec![body]), 100)
    });
    let mut difference = PatchPair::zeros(scenario.patch.size);
    let problem = doorcam_engine::Problem::new(&model, &background, &difference);
    let mut correlations = problem.projection.correlations();
    let (mut workspace, mut solution) = (problem.solver.workspace(), Solution::default());
    let mut factors = Vec::new();
    let mut walk = |start: Start| {
        for frame in &frames {
            assert!(background.difference(frame, &mut difference));
            problem.projection.project(&difference, &mut correlations).unwrap();
            let lambda = problem.lambda(&correlations, problem.solver.lambda_max(&correlations));
            problem.solver.solve_into(&correlations, lambda, model.limits, start, &mut workspace, &mut solution);
            problem.solver.refit(&correlations, &solution, &mut factors);
            assert!(solution.intensities.iter().any(|i| i.left != 0.0));
        }
    };
    walk(Start::Empty);
    assert_eq!(allocations(|| walk(Start::Empty)), 0, "frames, cold");
    assert_eq!(allocations(|| walk(Start::Previous)), 0, "frames, warm");
    let mut rolling = RollingBackground::from_background(&background);
    let mut follow = || frames.iter().cycle().take(100).for_each(|frame| rolling.adapt(frame, 1.0, 60.0));
    follow();
    assert_eq!(allocations(follow), 0, "a background that follows");
    for mode in [Averaging::Exponential, Averaging::Boxcar] {
        let mut averager = Averager::new(mode, 1.0, scenario.patch.size);
        let mut seconds = 0.0;
        let mut average = || {
            for frame in frames.iter().cycle().take(40) {
                seconds += 0.1;
                std::hint::black_box(averager.push(frame, seconds));
            }
        };
        average();
        assert_eq!(allocations(average), 0, "{mode:?}");
    }
}
