use rayon::prelude::*;

use super::Scenario;
use super::direct::{Crowd, Cylinder, DirectLight};
use doorcam_core::geometry::{Point, Side};
use doorcam_core::light::{Patch, PatchPair};
use doorcam_core::quadrature::Quadrature;
use doorcam_core::scene::Rgb;
use doorcam_core::transport::PatchGrid;

/// Floor points along each side of a pixel, over which light is averaged.
const SUBSAMPLES: usize = 2;
/// Quadrature nodes per interval of azimuth; a test shows that they are enough.
const NODES: usize = 8;

/// Renders the patches of a scenario without noise. The empty room is evaluated once.
#[derive(Debug, Clone)]
pub struct Renderer {
    light: DirectLight,
    /// Per side: the floor points, `SUBSAMPLES`² per pixel, pixel after pixel.
    points: [Vec<Point>; 2],
    empty: PatchPair,
}

impl Renderer {
    /// Evaluates the empty room, with pixels in parallel.
    pub fn new(scenario: &Scenario) -> Self {
        let light = DirectLight::new(scenario.doorway, scenario.walls.clone(), Quadrature::new(NODES));
        let points = Side::BOTH.map(|side| floor_points(scenario, side));
        let mut empty = PatchPair::zeros(scenario.patch.size);
        for (side, points) in Side::BOTH.into_iter().zip(&points) {
            let pixels: Vec<Rgb> = points
                .par_chunks(SUBSAMPLES * SUBSAMPLES)
                .map(|points| {
                    let hidden = mean(points, |p| light.empty(p));
                    [0, 1, 2].map(|c| scenario.visible_light[c] + hidden[c])
                })
                .collect();
            fill(empty.side_mut(side), |k| pixels[k]);
        }
        Self { light, points, empty }
    }

    /// The patches of the empty room, in linear light relative to full scale.
    pub fn empty(&self) -> &PatchPair {
        &self.empty
    }

    /// The patches with people in the room.
    pub fn render(&self, people: Vec<Cylinder>) -> PatchPair {
        let crowd = self.light.crowd(people);
        let mut pair = self.empty.clone();
        for (side, points) in Side::BOTH.into_iter().zip(&self.points) {
            self.add_people(&crowd, points, pair.side_mut(side));
        }
        pair
    }

    fn add_people(&self, crowd: &Crowd, points: &[Point], patch: &mut Patch) {
        let empty = patch.clone();
        let mut points = points.chunks_exact(SUBSAMPLES * SUBSAMPLES);
        fill(patch, |k| {
            let change = mean(points.next().unwrap_or_default(), |p| self.light.change(crowd, p));
            [0, 1, 2].map(|c| f64::from(empty.plane(c)[k]) + change[c])
        });
    }
}

/// The centres of the equal cells of each pixel.
fn floor_points(scenario: &Scenario, side: Side) -> Vec<Point> {
    let size = scenario.patch.size;
    let fine = PatchGrid { size: SUBSAMPLES * size, ..scenario.patch };
    let cells = |k: usize| (0..SUBSAMPLES * SUBSAMPLES).map(move |j| (k, j));
    (0..size * size)
        .flat_map(cells)
        .map(|(k, j)| {
            let row = SUBSAMPLES * (k / size) + j / SUBSAMPLES;
            let column = SUBSAMPLES * (k % size) + j % SUBSAMPLES;
            fine.point(&scenario.doorway, side, row, column)
        })
        .collect()
}

fn mean(points: &[Point], light: impl Fn(Point) -> Rgb) -> Rgb {
    let lights: Vec<Rgb> = points.iter().map(|&p| light(p)).collect();
    [0, 1, 2].map(|c| lights.iter().map(|l| l[c]).sum::<f64>() / lights.len() as f64)
}

fn fill(patch: &mut Patch, mut light: impl FnMut(usize) -> Rgb) {
    for k in 0..patch.pixels() {
        for (channel, value) in light(k).into_iter().enumerate() {
            patch.plane_mut(channel)[k] = value as f32;
        }
    }
}
