mod looking;

use std::sync::Arc;
use std::time::{Duration, Instant};

use jiff::Timestamp;
use serde::Serialize;

use crate::PublishedIteration;
use crate::{Assembly, Engine, FrameReader, Model, Problem, Settings, SetupError, StepError};
use doorcam_core::light::{Background, PatchPair};
use doorcam_core::solver::{
    Columns, Correlations, Lambda, ModelKind, Nuisance, Pixels, Projection, ProjectionError, Solution, Start,
};
use doorcam_source::recording::Manifest;
use doorcam_source::{Purpose, RawFrame, SkippedFrame};
pub use looking::Looking;

/// Maximum number of frames after the empty room that are used: they are kept in memory, still encoded.
pub const BENCH_FRAMES: usize = 200;
/// Minimum number of times that a stage is measured. Frames are visited forwards and backwards in turn, so that each
/// follows a neighbour.
const VISITS: usize = 200;
/// Steps of the published iteration that are run; the time is scaled to [`PublishedIteration::STEPS`].
const PUBLISHED_STEPS: usize = 500;
/// Number of frames on which the published iteration is run.
const PUBLISHED_FRAMES: usize = 5;

/// How long each stage of a frame takes, in milliseconds. As JSON, this is what `doorcam bench --json` prints.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BenchReport {
    /// Calculating Aᵀy.
    pub project_ms: Quantiles,
    /// Solving eq. 13 from the empty map.
    pub cold_ms: Quantiles,
    /// Solving it from the neighbouring frame's map.
    pub warm_ms: Quantiles,
    /// From the encoded frame to the serialised update, with a warm start.
    pub frame_ms: Quantiles,
    /// What looking at the whole picture costs; null if the recording shows only patches.
    pub looking: Option<Looking>,
    /// The authors' 20,000 accelerated steps in Gram form, extrapolated from fewer.
    pub published_iteration_ms: Median,
    /// Facets of the grid, N.
    pub facets: usize,
    /// Pixels that count in both patches together, M.
    pub pixels: usize,
    /// Building the geometry and the table of people anywhere in the room, once per doorway.
    #[serde(skip)]
    pub model_ms: f64,
    /// Building light transport, noise model, projection and Gram matrices, once per background.
    #[serde(skip)]
    pub problem_ms: f64,
    /// Frames that were solved. Frames whose map is empty are left out, unless all are.
    #[serde(skip)]
    pub frames: usize,
    /// Frames that could not be used.
    #[serde(skip)]
    pub skipped: Vec<SkippedFrame>,
}

/// Quantiles of many measured times.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Quantiles {
    /// Median.
    pub p50: f64,
    /// 99th percentile.
    pub p99: f64,
}

/// Median of a few measured times.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Median {
    /// Median.
    pub p50: f64,
}

/// Why nothing could be measured.
#[derive(Debug, thiserror::Error)]
pub enum BenchError {
    /// The recording and the configuration do not fit together.
    #[error(transparent)]
    Setup(#[from] SetupError),
    /// A frame was read but cannot be solved.
    #[error(transparent)]
    Projection(#[from] ProjectionError),
    /// The frame loop refused a frame that was read before.
    #[error(transparent)]
    Step(#[from] StepError),
    /// Every frame after the empty room is broken.
    #[error("no frame after background_frames could be read")]
    NoFrames,
}

/// Measures every stage on a recording's frames: the empty room's first, then those to solve. `progress(done, all)` is
/// called between measurements, never during one.
///
/// # Errors
///
/// If recording and configuration do not fit together, or if no frame can be read or solved.
pub fn bench(
    settings: &Settings,
    manifest: &Manifest,
    frames: &[RawFrame],
    mut progress: impl FnMut(usize, usize),
) -> Result<BenchReport, BenchError> {
    let start = Instant::now();
    let (mut reader, model) = set_up(settings, manifest)?;
    let model_time = start.elapsed();
    let visits = VISITS.max(frames.len());
    let rounds = looking::ROUNDS.max(visits.div_ceil(frames.len().max(1)));
    let looks = if manifest.calibration().is_some() { rounds * frames.len() } else { 0 };
    let all = frames.len() + 3 * visits + PUBLISHED_FRAMES + looks;
    let mut done = 0;
    let mut each = || {
        done += 1;
        progress(done, all);
    };

    let measured = project(&model, &mut reader, frames, visits, &mut each)?;
    let Measured { problem, projected, .. } = &measured;
    let lit: Vec<&Projected> =
        projected.iter().filter(|f| f.lambda_max > problem.lambda(&f.correlations, f.lambda_max)).collect();
    let solved = if lit.is_empty() { projected.iter().collect() } else { lit };
    let cold = solve(&model, problem, &solved, Start::Empty, visits, &mut each);
    let warm = solve(&model, problem, &solved, Start::Previous, visits, &mut each);
    let published = published_iteration(&model, &mut reader, &measured, &solved, &mut each)?;
    let engine = Assembly::new(settings.clone()).without_people().for_recording(manifest)?;
    let whole = whole_frames(engine, &measured.empty, &solved, visits, &mut each)?;
    let others: Vec<&RawFrame> = projected.iter().map(|projected| projected.frame).collect();
    let looking = looking::measure(settings, manifest, &measured.empty, &others, rounds, &mut each)?;
    Ok(BenchReport {
        looking,
        frames: solved.len(),
        project_ms: quantiles(&measured.times),
        cold_ms: quantiles(&cold),
        warm_ms: quantiles(&warm),
        frame_ms: quantiles(&whole),
        published_iteration_ms: Median { p50: quantiles(&published).p50 },
        facets: model.grid.len(),
        pixels: model.counted.iter().flatten().filter(|&&counted| counted).count(),
        model_ms: milliseconds(model_time),
        problem_ms: milliseconds(measured.problem_time),
        skipped: measured.skipped,
    })
}

/// Everything that only depends on the doorway and the camera. As in a live engine, that includes the table that finding
/// people needs; otherwise the first background would be charged with it.
fn set_up(settings: &Settings, manifest: &Manifest) -> Result<(FrameReader, Arc<Model>), SetupError> {
    let reader = FrameReader::for_recording(settings, manifest)?;
    let model = Model::new(settings, manifest.doorway, reader.patch(), reader.seen())?;
    if model.kind == ModelKind::Signed {
        model.bodies();
    }
    Ok((reader, Arc::new(model)))
}

/// A recording's problem and its projected frames.
struct Measured<'a> {
    problem: Problem,
    problem_time: Duration,
    background: Background,
    /// The frames of the empty room that could be read.
    empty: Vec<&'a RawFrame>,
    projected: Vec<Projected<'a>>,
    times: Vec<Duration>,
    skipped: Vec<SkippedFrame>,
}

struct Projected<'a> {
    frame: &'a RawFrame,
    correlations: Correlations,
    lambda_max: f64,
}

/// Learns the empty room, builds the problem and measures Aᵀy on the other frames.
fn project<'a>(
    model: &Model,
    reader: &mut FrameReader,
    frames: &'a [RawFrame],
    visits: usize,
    each: &mut impl FnMut(),
) -> Result<Measured<'a>, BenchError> {
    let mut background = Background::new(model.patch.size);
    let (mut pair, mut difference) = (PatchPair::zeros(model.patch.size), PatchPair::zeros(model.patch.size));
    let (mut empty, mut others, mut skipped) = (Vec::new(), Vec::new(), Vec::new());
    for frame in frames {
        each();
        match reader.read(frame, &mut pair) {
            Err(reason) => skipped.push(reason),
            Ok(_) if frame.purpose == Purpose::Before => {}
            Ok(_) if frame.purpose == Purpose::Background => {
                background.learn(&pair);
                empty.push(frame);
            }
            Ok(_) => others.push(frame),
        }
    }
    let first = *others.first().ok_or(BenchError::NoFrames)?;
    reader.read(first, &mut pair).map_err(StepError::Skipped)?;
    if !background.difference(&pair, &mut difference) {
        return Err(StepError::NoBackground.into());
    }
    let start = Instant::now();
    let problem = Problem::new(model, &background, &difference);
    let problem_time = start.elapsed();
    let mut correlations = problem.projection.correlations();
    let mut projected: Vec<Projected> = Vec::with_capacity(others.len());
    let mut times = Vec::with_capacity(visits);
    for t in there_and_back(others.len()).take(visits) {
        reader.read(others[t], &mut pair).map_err(StepError::Skipped)?;
        background.difference(&pair, &mut difference);
        let start = Instant::now();
        problem.projection.project(&difference, &mut correlations)?;
        times.push(start.elapsed());
        if t == projected.len() {
            let lambda_max = problem.solver.lambda_max(&correlations);
            // Without the workspace over pixels that the projection's own correlations hold.
            let correlations = Correlations::new(correlations.rhs.clone(), correlations.energy);
            projected.push(Projected { frame: others[t], correlations, lambda_max });
        }
        each();
    }
    Ok(Measured { problem, problem_time, background, empty, projected, times, skipped })
}

/// Measures choosing λ and solving, for each visit of a frame.
fn solve(
    model: &Model,
    problem: &Problem,
    frames: &[&Projected],
    from: Start,
    visits: usize,
    each: &mut impl FnMut(),
) -> Vec<Duration> {
    let solver = &problem.solver;
    let (mut workspace, mut solution) = (solver.workspace(), Solution::default());
    let mut visit = |t: usize| {
        let correlations = &frames[t].correlations;
        let start = Instant::now();
        let lambda = problem.lambda(correlations, solver.lambda_max(correlations));
        solver.solve_into(correlations, lambda, model.limits, from, &mut workspace, &mut solution);
        start.elapsed()
    };
    // Not measured: it grows the workspace, and gives the first visit a map to start from.
    visit(there_and_back(frames.len()).nth(1).unwrap_or(0));
    let timed = |t| {
        let time = visit(t);
        each();
        time
    };
    there_and_back(frames.len()).take(visits).map(timed).collect()
}

/// Measures the published iteration on some frames, with unscaled columns as the authors have them, and scales the time
/// to all steps.
fn published_iteration(
    model: &Model,
    reader: &mut FrameReader,
    measured: &Measured,
    frames: &[&Projected],
    each: &mut impl FnMut(),
) -> Result<Vec<Duration>, BenchError> {
    let lambda = match (model.kind, model.lambda) {
        (ModelKind::Published, Lambda::Fixed(lambda)) => lambda,
        _ => Lambda::PUBLISHED,
    };
    let nuisance = Nuisance::constant(model.patch.pixels());
    let projection = Projection::new(&model.matrices(), &Pixels::uniform(&model.counted), &nuisance, Columns::Radiance);
    let gram = projection.gram();
    let mut correlations = projection.correlations();
    let (mut pair, mut difference) = (PatchPair::zeros(model.patch.size), PatchPair::zeros(model.patch.size));
    let mut times = Vec::new();
    for k in 0..PUBLISHED_FRAMES {
        reader.read(frames[k * frames.len() / PUBLISHED_FRAMES].frame, &mut pair).map_err(StepError::Skipped)?;
        measured.background.difference(&pair, &mut difference);
        projection.project(&difference, &mut correlations)?;
        let mut iteration = PublishedIteration::new(&gram, &model.grid.foreground, &correlations, lambda);
        let start = Instant::now();
        (0..PUBLISHED_STEPS).for_each(|_| iteration.step());
        times.push(start.elapsed().mul_f64(PublishedIteration::STEPS as f64 / PUBLISHED_STEPS as f64));
        std::hint::black_box(iteration.intensities());
        each();
    }
    Ok(times)
}

/// Measures the whole frame loop.
fn whole_frames(
    mut engine: Engine,
    empty: &[&RawFrame],
    frames: &[&Projected],
    visits: usize,
    each: &mut impl FnMut(),
) -> Result<Vec<Duration>, BenchError> {
    // After the empty room, one frame that is not measured: it builds the problem.
    let before = there_and_back(frames.len()).nth(1).unwrap_or(0);
    for &frame in empty.iter().chain([&frames[before].frame]) {
        engine.step(frame, Timestamp::UNIX_EPOCH)?;
    }
    let timed = |t: usize| {
        let start = Instant::now();
        std::hint::black_box(engine.step(frames[t].frame, Timestamp::UNIX_EPOCH)?);
        let time = start.elapsed();
        each();
        Ok(time)
    };
    there_and_back(frames.len()).take(visits).map(timed).collect()
}

/// 0, 1, .., count − 1, count − 2, .., 1, 0, 1, .. endlessly.
fn there_and_back(count: usize) -> impl Iterator<Item = usize> {
    let period = (2 * count).saturating_sub(2).max(1);
    (0..period).map(move |t| t.min(period - t)).cycle()
}

/// Median and 99th percentile: the smallest measured times that this share of them does not exceed.
fn quantiles(times: &[Duration]) -> Quantiles {
    let mut sorted = times.to_vec();
    sorted.sort_unstable();
    let at = |share: f64| {
        let rank = (share * sorted.len() as f64).ceil() as usize;
        sorted.get(rank.saturating_sub(1)).copied().map_or(0.0, milliseconds)
    };
    Quantiles { p50: at(0.5), p99: at(0.99) }
}

fn milliseconds(time: Duration) -> f64 {
    time.as_secs_f64() * 1e3
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_times_that_were_measured() {
        let times: Vec<Duration> = (1..=200).rev().map(Duration::from_millis).collect();
        assert_eq!(quantiles(&times), Quantiles { p50: 100.0, p99: 198.0 });
        assert_eq!(quantiles(&times[..1]), Quantiles { p50: 200.0, p99: 200.0 });
    }

    #[cfg(feature = "simulation")]
    #[test]
    fn no_background_is_charged_with_the_table_of_people() {
        use crate::simulation::{Scenario, Simulator};
        let simulator = Simulator::new(Scenario::load("one-person").unwrap(), 1).unwrap();
        let known = |mut settings: Settings| {
            settings.patch.pixels = 16;
            set_up(&settings, simulator.manifest()).unwrap().1.knows_bodies()
        };
        assert!(known(Settings::default()));
        // The authors' model does not look for people.
        assert!(!known(Settings::published()));
    }

    #[test]
    fn every_frame_follows_its_neighbour() {
        let order = |count| there_and_back(count).take(7).collect::<Vec<_>>();
        assert_eq!(order(4), [0, 1, 2, 3, 2, 1, 0]);
        assert_eq!(order(2), [0, 1, 0, 1, 0, 1, 0]);
        assert_eq!(order(1), [0; 7]);
    }
}
