use nalgebra::{Matrix5, SMatrix, Vector5};

use super::Motion;
use super::filtered::Filtered;
use super::reference::CELL;

/// A small square of the reference with an edge or texture in it.
#[derive(Debug, Clone)]
pub(super) struct Cell {
    pixels: Vec<Pixel>,
    /// Sum of the squares of the values.
    energy: f64,
    /// Sum of the squares of the gradients.
    steepness: f64,
    /// Direction in which its brightness varies most.
    normal: [f64; 2],
    /// What it counts for in the support: less where many others have edges in this direction.
    pub share: f64,
}

/// One of its pixels: where it is, how it differs from the cell's mean, and the gradient there. In a cell with a single
/// edge the gradient is only what is across the edge: nothing shows how it moves along itself.
#[derive(Debug, Clone, Copy)]
struct Pixel {
    at: [f32; 2],
    value: f32,
    gradient: [f32; 2],
}

/// Finds the motion that makes a picture's cells look like the reference's: Gauss-Newton steps on the differences, each
/// cell with a brightness and a contrast of its own, weighted by how well it fits.
#[derive(Debug, Clone, Default)]
pub(super) struct Fine {
    seen: Vec<f32>,
}

/// A refined motion, in pixels of the overview.
#[derive(Debug, Clone, Copy)]
pub(super) struct Refined {
    pub motion: Motion,
    pub support: f64,
    pub sd: f64,
}

/// Most steps: a motion that has not settled by then does not fit.
const STEPS: usize = 12;
/// A step below this, in pixels of the overview, is the last.
const SETTLED: f64 = 0.003;
/// Correlation from which a cell fits, while the motion is found and at the end.
const FITS: [f64; 2] = [0.4, 0.75];
/// A cell's own displacement, in pixels of the overview, up to which it agrees with the motion, at the end.
const AGREES: f64 = 0.4;
/// Standard deviation of the noise in a cell's values, in codes, that is always assumed.
const NOISE: f64 = 0.3;
/// Neighbouring pixels' differences are not independent, for they are smooth: this many count as one.
const ALIKE: f64 = 6.0;
/// Standard deviation of a single cell's displacement at best, in pixels of the overview: lights that change differently
/// on both sides of an edge seem to move it.
const CELL_SD: f64 = 0.15;
/// Share of a cell's gradients that must be along its edge for its motion along it to be seen.
const ALONG: f64 = 0.15;
/// What the camera's own distortions and what the model of the motion leaves out add to a motion's error, in pixels of
/// the overview.
const MODEL: f64 = 0.02;
/// A turn that moves the picture's middle by 1 pixel makes it grow by up to this per pixel, divided by the square of the
/// picture's width: the focal length is at least 0.6 widths.
const TILT: f64 = 2.8;
/// Tilt that any motion may have, as that moves a picture's border by so many pixels.
const LEAST_TILT: f64 = 0.1;

impl Cell {
    /// The cell whose first pixel is (x, y), which must be inside the picture's border.
    pub fn new(picture: &Filtered, x: usize, y: usize) -> Self {
        let inside = (y..y + CELL).flat_map(|y| (x..x + CELL).map(move |x| (x, y)));
        let mut pixels: Vec<Pixel> = inside
            .map(|(x, y)| Pixel {
                at: [x as f32, y as f32],
                value: picture.values[y * picture.width + x],
                gradient: picture.gradient(x, y),
            })
            .collect();
        let mean = pixels.iter().map(|p| p.value).sum::<f32>() / pixels.len() as f32;
        pixels.iter_mut().for_each(|p| p.value -= mean);
        let sum = |of: fn(&Pixel) -> f32| pixels.iter().map(|p| f64::from(of(p))).sum::<f64>();
        let energy = sum(|p| p.value * p.value);
        let [xx, xy, yy] =
            [sum(|p| p.gradient[0].powi(2)), sum(|p| p.gradient[0] * p.gradient[1]), sum(|p| p.gradient[1].powi(2))];
        let (sin, cos) = (0.5 * (2.0 * xy).atan2(xx - yy)).sin_cos();
        let along = sin * sin * xx - 2.0 * sin * cos * xy + cos * cos * yy;
        if along < ALONG * (xx + yy) {
            for pixel in &mut pixels {
                let across = cos as f32 * pixel.gradient[0] + sin as f32 * pixel.gradient[1];
                pixel.gradient = [across * cos as f32, across * sin as f32];
            }
        }
        Self { pixels, energy, steepness: xx + yy, normal: [cos, sin], share: 1.0 }
    }

    /// Root mean square of the gradient.
    pub fn edge(&self) -> f32 {
        (self.steepness / self.pixels.len() as f64).sqrt() as f32
    }

    /// The bin of its direction.
    pub fn direction(&self) -> usize {
        direction(self.normal[1].atan2(self.normal[0]))
    }

    /// How the picture's values compare with this cell's: contrast, correlation, and what is left over a pixel.
    fn fit(&self, seen: &[f32]) -> Option<Fit> {
        let count = seen.len() as f64;
        let mean = seen.iter().map(|&v| f64::from(v)).sum::<f64>() / count;
        let (mut product, mut energy) = (0.0, 0.0);
        for (pixel, &value) in self.pixels.iter().zip(seen) {
            let value = f64::from(value) - mean;
            product += value * f64::from(pixel.value);
            energy += value * value;
        }
        let contrast = product / self.energy;
        let left = (energy - contrast * product).max(0.0) / count;
        let correlation = product / (self.energy * energy).sqrt();
        correlation.is_finite().then_some(Fit { mean, contrast, correlation, left })
    }
}

#[derive(Debug, Clone, Copy)]
struct Fit {
    mean: f64,
    contrast: f64,
    correlation: f64,
    left: f64,
}

/// Sums over cells: the normal equations, and what agrees.
#[derive(Debug, Default)]
struct Sums {
    normal: Matrix5<f64>,
    right: Vector5<f64>,
    /// What the cells that lie in the picture count for, and those that agree.
    cells: [f64; 2],
}

impl Fine {
    /// Refines a motion; `None` if nothing of the reference is in the picture there.
    pub fn refine(&mut self, cells: &[Cell], picture: &Filtered, start: Motion) -> Option<Refined> {
        let mut motion = start;
        let width = picture.width as f64;
        let mut agreeing = f64::INFINITY;
        for step in 0..STEPS {
            let sums = self.sum(cells, picture, &motion, FITS[0], agreeing);
            let (normal, right) = with_tilt(&sums, &motion, width);
            let delta = normal.cholesky()?.solve(&right);
            // Far steps lead astray: the differences are linear for a pixel or two.
            let long = delta[0].hypot(delta[1]).max(0.3 * width * delta[2].abs());
            let delta = delta * (2.0 / long.max(2.0));
            motion.shift_px[0] += delta[0];
            motion.shift_px[1] += delta[1];
            motion.rotation += delta[2];
            motion.tilt_per_px[0] += delta[3];
            motion.tilt_per_px[1] += delta[4];
            if motion.shift_px.iter().any(|v| !v.is_finite() || v.abs() > width) || motion.rotation.abs() > 1.0 {
                return None;
            }
            // First everything that correlates, then only what does not contradict the rest.
            agreeing = if step < 2 { 3.0 } else { 1.0 };
            if long < SETTLED && step > 2 {
                break;
            }
        }
        let sums = self.sum(cells, picture, &motion, FITS[1], AGREES);
        let (normal, _) = with_tilt(&sums, &motion, width);
        let [inside, agreeing] = sums.cells;
        let support = agreeing / inside.max(f64::MIN_POSITIVE);
        let covariance = normal.try_inverse()?;
        Some(Refined { motion, support, sd: deviation(&covariance, picture) })
    }

    /// Compares each cell, moved by `motion`. Those count that correlate by `fits` and whose own displacement is at most
    /// `agrees`.
    fn sum(&mut self, cells: &[Cell], picture: &Filtered, motion: &Motion, fits: f64, agrees: f64) -> Sums {
        let mut sums = Sums::default();
        let (sin, cos) = motion.rotation.sin_cos();
        let centre = motion.centre_px;
        let origin = [0, 1].map(|k| centre[k] + motion.shift_px[k]);
        for cell in cells {
            self.seen.clear();
            for pixel in &cell.pixels {
                let [x, y] = [f64::from(pixel.at[0]) - centre[0], f64::from(pixel.at[1]) - centre[1]];
                let grown = 1.0 + motion.tilt_per_px[0] * x + motion.tilt_per_px[1] * y;
                let to = [origin[0] + grown * (cos * x - sin * y), origin[1] + grown * (sin * x + cos * y)];
                let Some(value) = picture.sample(to[0] as f32, to[1] as f32) else { break };
                self.seen.push(value);
            }
            if self.seen.len() < cell.pixels.len() {
                continue;
            }
            sums.cells[0] += cell.share;
            let Some(fit) = cell.fit(&self.seen) else { continue };
            if fit.correlation < fits {
                continue;
            }
            let (mut normal, mut right) = (Matrix5::zeros(), Vector5::zeros());
            let across = cell.normal;
            let (mut flow, mut steepness) = (0.0, 0.0);
            for (pixel, &seen) in cell.pixels.iter().zip(&self.seen) {
                let rest = f64::from(seen) - fit.mean - fit.contrast * f64::from(pixel.value);
                let gradient = pixel.gradient.map(|g| fit.contrast * f64::from(g));
                // The reference's gradient, turned as the picture is.
                let g = [cos * gradient[0] - sin * gradient[1], sin * gradient[0] + cos * gradient[1]];
                let [x, y] = [f64::from(pixel.at[0]) - centre[0], f64::from(pixel.at[1]) - centre[1]];
                let along = g[0] * x + g[1] * y;
                let row = Vector5::new(g[0], g[1], g[1] * x - g[0] * y, along * x, along * y);
                normal.ger(1.0, &row, &row, 1.0);
                right.axpy(-rest, &row, 1.0);
                let steep = gradient[0] * across[0] + gradient[1] * across[1];
                flow -= steep * rest;
                steepness += steep * steep;
            }
            if (flow / steepness).abs() > agrees || !steepness.is_finite() {
                continue;
            }
            sums.cells[1] += cell.share;
            let variance = ALIKE * (fit.left + NOISE * NOISE);
            // No cell alone knows better than this, whatever its contrast.
            let weight = 1.0 / (variance + CELL_SD * CELL_SD * (normal[(0, 0)] + normal[(1, 1)]));
            sums.normal += weight * normal;
            sums.right += weight * right;
        }
        sums
    }
}

/// The normal equations with what is known beforehand of the tilt: it is between none and that of a wide lens, in
/// proportion to the motion.
fn with_tilt(sums: &Sums, motion: &Motion, width: f64) -> (Matrix5<f64>, Vector5<f64>) {
    let (mut normal, mut right) = (sums.normal, sums.right);
    for k in 0..2 {
        let most = TILT * motion.shift_px[k] / (width * width);
        let (mean, deviation) = (0.5 * most, 0.5 * most.abs() + LEAST_TILT * 4.0 / (width * width));
        let weight = 1.0 / (deviation * deviation);
        normal[(3 + k, 3 + k)] += weight;
        right[3 + k] += weight * (mean - motion.tilt_per_px[k]);
    }
    // So little is known beforehand of the others that it only keeps the equations solvable.
    for k in 0..3 {
        normal[(k, k)] += if k == 2 { 1e-2 } else { 1e-6 };
    }
    (normal, right)
}

/// Bins of direction, and the share of all edges that each has at least.
pub(super) const DIRECTIONS: usize = 8;
const FEW: f64 = 0.1;

/// The bin of an edge whose brightness varies most at this angle.
pub(super) fn direction(angle: f64) -> usize {
    let turn = angle.rem_euclid(std::f64::consts::PI) / std::f64::consts::PI;
    (turn * DIRECTIONS as f64).round() as usize % DIRECTIONS
}

/// What each edge counts for, given how many there are in each direction. A picture may have many edges in one direction
/// and few in others, but it takes both to know where it is.
pub(super) fn shares(counts: [usize; DIRECTIONS]) -> [f64; DIRECTIONS] {
    let least = FEW * counts.iter().sum::<usize>() as f64;
    counts.map(|count| 1.0 / (count as f64 + least).max(1.0))
}

/// Standard deviation of where the motion puts a pixel of the overview: the worst over the middle half of the picture.
fn deviation(covariance: &Matrix5<f64>, picture: &Filtered) -> f64 {
    let [x, y] = [picture.width, picture.height].map(|n| n as f64 / 4.0);
    let worst = [[-x, -y], [x, -y], [x, y], [-x, y], [0.0, 0.0]].into_iter().map(|[x, y]| {
        let moved = SMatrix::<f64, 2, 5>::from_row_slice(&[1.0, 0.0, -y, x * x, x * y, 0.0, 1.0, x, x * y, y * y]);
        (moved * covariance * moved.transpose()).symmetric_eigenvalues().max()
    });
    (worst.fold(0.0, f64::max) + MODEL * MODEL).sqrt()
}
