use nalgebra::{DMatrix, DVector, SymmetricEigen};

use crate::geometry::Side;
use crate::light::PatchPair;

/// Fewest frames from which a pattern can be told from noise.
const ENOUGH: usize = 8;
/// Smallest standard deviation of the frames along a pattern, relative to white noise. Noise that compression and
/// interpolation spread over neighbours reaches about 2.
const STANDS_OUT: f64 = 4.0;

/// Drift patterns of each side: unit vectors over the patch's pixels along which the empty room's frames vary over time
/// beyond their noise and beyond the patterns `explained`, because its lamps vary against one another. Strongest first,
/// at most `most`; pixels that are not `counted` are 0.
///
/// Patterns are the principal components of the even frames. One counts only if the odd frames, which did not
/// contribute to it, vary along it too. Otherwise it would be noise of the even frames, and projecting it out would
/// make the empty room look quieter than it is.
pub fn drift_patterns(
    frames: &[&PatchPair],
    explained: &[Vec<Vec<f64>>; 2],
    counted: &[Vec<bool>; 2],
    most: usize,
) -> [Vec<Vec<f64>>; 2] {
    [0, 1].map(|s| side_drift(frames, Side::BOTH[s], &explained[s], &counted[s], most))
}

fn side_drift(
    frames: &[&PatchPair],
    side: Side,
    explained: &[Vec<f64>],
    counted: &[bool],
    most: usize,
) -> Vec<Vec<f64>> {
    if frames.len() < ENOUGH {
        return Vec::new();
    }
    let basis = DMatrix::from_fn(counted.len(), explained.len(), |k, j| if counted[k] { explained[j][k] } else { 0.0 });
    let basis = basis.qr().q();
    let even = deviations(frames.iter().copied().step_by(2), side, &basis, counted);
    let odd = deviations(frames.iter().copied().skip(1).step_by(2), side, &basis, counted);
    let eigen = SymmetricEigen::new(even.tr_mul(&even));
    let mut order: Vec<usize> = (0..eigen.eigenvalues.len()).collect();
    order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
    // For pure noise, all eigenvalues are about equal (but for three zeros from subtracting the means), and each is the
    // sum over all pixels. The median is therefore the noise variance times the number of pixels.
    let pixels = counted.iter().filter(|&&c| c).count().max(1) as f64;
    let noise = eigen.eigenvalues[order[(order.len() - 3) / 2]] / pixels;
    let mut patterns = Vec::new();
    for &k in order.iter().take(most) {
        let pattern = &even * eigen.eigenvectors.column(k);
        let norm = pattern.norm();
        if norm <= 0.0 {
            break;
        }
        let pattern = pattern / norm;
        let variance = odd.tr_mul(&pattern).norm_squared() / odd.ncols() as f64;
        if variance <= STANDS_OUT * STANDS_OUT * noise {
            break;
        }
        patterns.push(pattern.iter().copied().collect());
    }
    patterns
}

/// Deviations of the frames from their mean, with the span of `basis` (orthonormal) projected out: one column per frame
/// and colour.
fn deviations<'a>(
    frames: impl Iterator<Item = &'a PatchPair> + Clone,
    side: Side,
    basis: &DMatrix<f64>,
    counted: &[bool],
) -> DMatrix<f64> {
    let count = frames.clone().count();
    let mut samples = DMatrix::zeros(counted.len(), 3 * count);
    for (t, frame) in frames.enumerate() {
        for channel in 0..3 {
            let plane = frame.side(side).plane(channel);
            let mut column = samples.column_mut(3 * t + channel);
            for (k, value) in column.iter_mut().enumerate().filter(|&(k, _)| counted[k]) {
                *value = f64::from(plane[k]);
            }
        }
    }
    for channel in 0..3 {
        let mut mean = DVector::zeros(counted.len());
        (0..count).for_each(|t| mean.axpy(1.0 / count as f64, &samples.column(3 * t + channel), 1.0));
        (0..count).for_each(|t| samples.column_mut(3 * t + channel).axpy(-1.0, &mean, 1.0));
    }
    let explained = basis * basis.tr_mul(&samples);
    samples - explained
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::NoiseModel;
    use crate::light::noise::tests::{SIZE, all, frames};

    #[test]
    fn a_drifting_lamp_is_a_pattern_and_noise_is_none() {
        let noise = NoiseModel { read: 1e-6, shot: 0.0 };
        let constant = || vec![vec![1.0; SIZE * SIZE]];
        let explained = [constant(), constant()];
        let none = drift_patterns(&frames(16, noise, 0.0).iter().collect::<Vec<_>>(), &explained, &all(), 3);
        assert_eq!(none.map(|p| p.len()), [0, 0]);
        let [left, right] = drift_patterns(&frames(16, noise, 0.02).iter().collect::<Vec<_>>(), &explained, &all(), 3);
        assert_eq!((left.len(), right.len()), (1, 1));
        let lamp: Vec<f64> = (0..SIZE * SIZE).map(|k| ((k / SIZE) as f64 / 6.0).sin()).collect();
        let mean = lamp.iter().sum::<f64>() / lamp.len() as f64;
        let norm = lamp.iter().map(|v| (v - mean).powi(2)).sum::<f64>().sqrt();
        let cosine: f64 = left[0].iter().zip(&lamp).map(|(p, l)| p * (l - mean) / norm).sum();
        assert!(cosine.abs() > 0.98, "{cosine}");
    }
}
