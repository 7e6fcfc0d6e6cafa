//! What is left of a patch's information when patterns may be present in any strength.

use nalgebra::{Matrix3, Vector3};

/// A pattern that others explain but for this share of its norm adds nothing of its own.
const NOTHING_NEW: f64 = 1e-6;

/// Patterns of unknown strength, in units of each pixel's noise: orthonormal ones that span the same.
#[derive(Debug, Clone)]
pub(super) struct Patterns(Vec<Vec<f64>>);

impl Patterns {
    /// By Gram and Schmidt, twice for accuracy.
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

    /// Fisher information on three parameters, from each pixel's gradient in units of its noise, beside the patterns: the Schur
    /// complement of their strengths in the whole matrix, which is what the gradients are once the patterns are projected out.
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
