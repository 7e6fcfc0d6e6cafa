use nalgebra::DMatrix;

use super::planes::{dot, subtract};
use crate::light::Patch;

/// The empty room's own picture of one patch, colour by colour: what an exposure step or flicker adds a multiple of, exactly,
/// noise included.
///
/// y = (g − 1) x0 + change, with x0 a colour's picture, becomes y − δ x0 with δ = Σ w² y x0 / Σ w² x0²: the gain g is gone to
/// the last digit. Only its own colour may hold a picture. As patterns for all colours, three pictures that differ by little
/// but their noise would span that noise, which is in every difference from them.
#[derive(Debug, Clone)]
pub(super) struct OwnPictures {
    /// u_p = W x0_p / ‖W x0_p‖ per colour; zeros for a colour in which the floor is black.
    directions: [Vec<f32>; 3],
    /// ‖W x0_p‖.
    norms: [f64; 3],
    /// Per colour, u_pᵀ W A: what of each facet's light looks like its own picture, N values.
    absorbed: [Vec<f64>; 3],
}

impl OwnPictures {
    /// Of a patch whose pixels have these weights and whose facets' light is, weighed, `matrix` (W A).
    pub fn new(picture: &Patch, weights: &[f64], matrix: &DMatrix<f64>) -> Self {
        let weighted = [0, 1, 2].map(|p| {
            let value = |(&v, &w): (&f32, &f64)| if w > 0.0 { w * f64::from(v) } else { 0.0 };
            picture.plane(p).iter().zip(weights).map(value).collect::<Vec<f64>>()
        });
        let norms = weighted.each_ref().map(|v| v.iter().map(|v| v * v).sum::<f64>().sqrt());
        let unit = [0, 1, 2].map(|p| {
            let length = if norms[p] > 0.0 { norms[p] } else { 1.0 };
            weighted[p].iter().map(|v| v / length).collect::<Vec<f64>>()
        });
        let absorbed = unit.each_ref().map(|u| {
            let product = |column: &[f64]| u.iter().zip(column).map(|(u, a)| u * a).sum::<f64>();
            matrix.column_iter().map(|column| product(column.as_slice())).collect::<Vec<f64>>()
        });
        let directions = unit.map(|u| u.into_iter().map(|u| u as f32).collect());
        Self { directions, norms, absorbed }
    }

    /// Multiplies what is known of the facets' light by their `scale`.
    pub fn scale(&mut self, scale: &[f64]) {
        for absorbed in &mut self.absorbed {
            absorbed.iter_mut().zip(scale).for_each(|(value, scale)| *value *= scale);
        }
    }

    /// u_pᵀ v, for the weighed plane v of any pattern.
    pub fn share(&self, channel: usize, plane: &[f32]) -> f64 {
        dot(&self.directions[channel], plane)
    }

    /// Takes a colour's own picture out of the weighed plane `plane`; its share of it, u_pᵀ W y, and the ‖·‖² that is left.
    pub fn remove(&self, channel: usize, plane: &mut [f32]) -> (f64, f64) {
        let share = self.share(channel, plane);
        (share, subtract(share as f32, &self.directions[channel], plane))
    }

    /// By what factor a colour's picture is multiplied, of which `share` was removed, apart from the light of facets of the
    /// intensities X_n; 1 for a black picture.
    pub fn gain(&self, channel: usize, share: f64, intensities: impl Iterator<Item = f64>) -> f64 {
        let facets: f64 = self.absorbed[channel].iter().zip(intensities).map(|(a, x)| a * x).sum();
        let norm = self.norms[channel];
        if norm > 0.0 { 1.0 + (share - facets) / norm } else { 1.0 }
    }
}
