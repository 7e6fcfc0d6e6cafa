//! How light from each facet reaches each floor pixel: the transport matrices A_L and A_R (paper: eq. 2, eq. 12).

mod body;
mod edge_foot;
mod kernel;
mod past_leaf;
mod patch;
#[cfg(test)]
mod testing;
mod visibility;

use nalgebra::DMatrix;
use rayon::prelude::*;

pub(crate) use body::share;
pub use body::{Body, FloorView};
pub use edge_foot::edge_foot_mask;
pub use kernel::Kernel;
pub use past_leaf::PastLeaf;
pub use patch::{PatchGrid, PixelLayout};

use crate::geometry::{Doorway, Facet, Side};

/// Parameters of the transport matrices, besides the doorway and the facets.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TransportSpec {
    /// Falloff law, with its quadrature.
    pub kernel: Kernel,
    /// Height of the facets, in metres.
    pub facet_height_m: f64,
    /// Size and pixels of the patches.
    pub patch: PatchGrid,
}

/// A_L and A_R (eq. 12): light at each pixel of the left and right patch per unit of radiance of each facet.
#[derive(Debug, Clone, PartialEq)]
pub struct Transport {
    /// A_L, M x N: one column per facet; pixels row by row, starting at the wall.
    pub left: DMatrix<f64>,
    /// A_R, the same for the right patch.
    pub right: DMatrix<f64>,
}

impl Transport {
    /// Evaluates eq. 2 for every facet and pixel; columns run in parallel.
    pub fn new(doorway: &Doorway, facets: &[Facet], spec: &TransportSpec) -> Self {
        let side = |side| {
            let pixels = spec.patch.points(doorway, side);
            let mut matrix = DMatrix::zeros(pixels.len(), facets.len());
            matrix.as_mut_slice().par_chunks_mut(pixels.len()).zip(facets).for_each(|(column, facet)| {
                let source = spec.kernel.prepare(doorway, facet, spec.facet_height_m);
                for (value, &pixel) in column.iter_mut().zip(&pixels) {
                    *value = source.light_at(pixel);
                }
            });
            matrix
        };
        Self { left: side(Side::Left), right: side(Side::Right) }
    }

    /// The matrix of one side.
    pub fn side(&self, side: Side) -> &DMatrix<f64> {
        match side {
            Side::Left => &self.left,
            Side::Right => &self.right,
        }
    }
}
