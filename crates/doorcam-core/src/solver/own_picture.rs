use nalgebra::DMatrix;

use super::planes::{dot, subtract};
use crate::light::Patch;

/// The empty room's own picture of one patch, per colour. An exposure step or flicker adds exactly a multiple of it,
/// noise included.
///
/// y = (g − 1) x0 + change, with x0 a colour's picture, becomes y − δ x0 with δ = Σ w² y x0 / Σ w² x0², which removes
/// the gain g to the last digit. Each picture may be present only in its own colour. As patterns for all colours, three
/// pictures that differ by little but their noise would span that noise, which is in every difference from them.
#[derive(Debug, Clone)]
pub(super) struct OwnPictures {
    /// u_p = W x0_p / ‖W x0_p‖ per colour; zeros if the floor is black in that colour.
    directions: [Vec<f32>; 3],
    /// ‖W x0_p‖.
    norms: [f64; 3],
    /// Per colour, u_pᵀ W A: how much of each facet's light looks like the own picture, N values.
    absorbed: [Vec<f64>; 3],
}

impl OwnPictures {
    /// The own pictures of a patch with these pixel weights; `matrix` is W A, the facets' weighted light.
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

    /// Scales the columns of A, one factor per facet.
    pub fn scale(&mut self, scale: &[f64]) {
        for absorbed in &mut self.absorbed {
            absorbed.iter_mut().zip(scale).for_each(|(value, scale)| *value *= scale);
        }
    }

    /// u_pᵀ v, for the weighted plane v of any pattern.
    pub fn share(&self, channel: usize, plane: &[f32]) -> f64 {
        dot(&self.directions[channel], plane)
    }

    /// Removes a colour's own picture from the weighted plane `plane`. Returns its share, u_pᵀ W y, and the remaining
    /// ‖·‖².
    pub fn remove(&self, channel: usize, plane: &mut [f32]) -> (f64, f64) {
        let share = self.share(channel, plane);
        (share, subtract(share as f32, &self.directions[channel], plane))
    }

    /// The factor by which a colour's picture is multiplied, given the `share` that was removed, without the light of
    /// facets with the intensities X_n; 1 for a black picture.
    pub fn gain(&self, channel: usize, share: f64, intensities: impl Iterator<Item = f64>) -> f64 {
        let facets: f64 = self.absorbed[channel].iter().zip(intensities).map(|(a, x)| a * x).sum();
        let norm = self.norms[channel];
        if norm > 0.0 { 1.0 + (share - facets) / norm } else { 1.0 }
    }
}
