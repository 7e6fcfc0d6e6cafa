//! The information left in a patch when nuisance patterns may be present at any strength.

use nalgebra::{Matrix3, Vector3};

/// A pattern is dropped if the others explain all but this share of its norm.
const NOTHING_NEW: f64 = 1e-6;

/// An orthonormal basis of patterns of unknown strength, in units of each pixel's noise.
#[derive(Debug, Clone)]
pub(super) struct Patterns(Vec<Vec<f64>>);

impl Patterns {
    /// Gram-Schmidt, run twice for accuracy.
    pub fn new(patterns: &[Vec<f64>]) -> Self {
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let mut found: Vec<Vec<f64>> = Vec::new();
        for pattern in patterns {
            let mut rest = pattern.clone();
            for _ in 0..2 {
                for other in &found {
                    let share = dot(&rest, other);
                    rest.iter_mut().zip(other).for_each(|(r, o)| *r -= share * o);
                }
            }
            let norm = dot(&rest, &rest).sqrt();
            if norm > NOTHING_NEW * dot(pattern, pattern).sqrt() {
                rest.iter_mut().for_each(|r| *r /= norm);
                found.push(rest);
            }
        }
        Self(found)
    }

    /// Fisher information on three parameters when the patterns' strengths are unknown, from each pixel's gradient in
    /// units of its noise. This is the Schur complement of the strengths in the full matrix, which is the information
    /// of the gradients with the patterns projected out.
    pub fn information(&self, gradients: &[Vector3<f64>]) -> Matrix3<f64> {
        let mut sum = Matrix3::zeros();
        gradients.iter().for_each(|gradient| sum.ger(1.0, gradient, gradient, 1.0));
        for pattern in &self.0 {
            let common: Vector3<f64> = gradients.iter().zip(pattern).map(|(gradient, p)| gradient * *p).sum();
            sum.ger(-1.0, &common, &common, 1.0);
        }
        sum
    }
}
