use nalgebra::DMatrix;
use rayon::prelude::*;

use crate::geometry::Side;
use crate::measurement::PatchPair;
use crate::transport::Transport;

/// Pixels whose products are summed in f32 before they join the f64 sum.
const BLOCK: usize = 64;

/// Takes difference measurements to the Gram system: Aᵀy with b eliminated.
///
/// b^p is the least-squares constant of each patch and channel, so projecting the constant out of the columns of A over
/// the pixels that count leaves a problem without b: A is replaced by (I − 11ᵀ/M) A, and Aᵀy by the same product with y
/// as it is, because the centred columns are orthogonal to constants.
#[derive(Debug, Clone)]
pub struct Projection {
    /// Per side, centred and masked columns, f32, one facet after the other.
    columns: [Vec<f32>; 2],
    /// Per side and facet, the mean of the column over the pixels that count.
    means: [Vec<f64>; 2],
    gram: [DMatrix<f64>; 2],
    masks: [Vec<bool>; 2],
    counted: [usize; 2],
    facets: usize,
}

/// What the solver needs to know of one frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Correlations {
    /// Per side and channel, A_sᵀ y^p: N values.
    pub rhs: [[Vec<f64>; 3]; 2],
    /// Σ_p ‖y^p‖² over both patches after the constants are out: twice the objective of the empty map.
    pub energy: f64,
    /// Per side and channel, the mean of y over the pixels that count.
    pub mean: [[f64; 3]; 2],
}

/// A measurement that cannot be used.
#[derive(Debug, thiserror::Error, PartialEq, Eq)]
pub enum ProjectionError {
    /// A pixel is not a number, or infinite.
    #[error("{side} patch, row {row}, column {column}: the {channel} value is not a finite number")]
    NotFinite {
        /// The patch.
        side: &'static str,
        /// Row from the wall.
        row: usize,
        /// Column from the smallest x.
        column: usize,
        /// The colour.
        channel: &'static str,
    },
    /// The patches have another size than the model's.
    #[error("the patches have {got} x {got} pixels, the model {expected} x {expected}")]
    Size {
        /// Pixels along a side of the patches.
        got: usize,
        /// What the model was built for.
        expected: usize,
    },
}

impl Projection {
    /// Centres and masks the columns of `transport` and forms the Gram matrices. `masks` tell, per side and pixel, the ones
    /// that count.
    pub fn new(transport: &Transport, masks: [Vec<bool>; 2]) -> Self {
        let counted = [0, 1].map(|s| masks[s].iter().filter(|&&m| m).count());
        let facets = transport.left.ncols();
        let centred = [0, 1].map(|s| {
            let mut matrix = transport.side(Side::BOTH[s]).clone();
            let mask = &masks[s];
            let means: Vec<f64> = matrix
                .column_iter_mut()
                .map(|mut column| {
                    let used = || mask.iter().enumerate().filter(|&(_, &m)| m).map(|(k, _)| k);
                    let mean = used().map(|k| column[k]).sum::<f64>() / counted[s].max(1) as f64;
                    for (value, &counts) in column.iter_mut().zip(mask) {
                        *value = if counts { *value - mean } else { 0.0 };
                    }
                    mean
                })
                .collect();
            (matrix, means)
        });
        let [left, right] = centred;
        Self {
            gram: [gram(&left.0), gram(&right.0)],
            columns: [&left.0, &right.0].map(|m| m.iter().map(|&v| v as f32).collect()),
            means: [left.1, right.1],
            masks,
            counted,
            facets,
        }
    }

    /// Number of facets, N.
    pub fn facets(&self) -> usize {
        self.facets
    }

    /// AᵀA of the left and the right side, constants projected out: N x N each.
    pub fn gram(&self) -> &[DMatrix<f64>; 2] {
        &self.gram
    }

    /// Per side, the pixels that count, row by row from the wall.
    pub fn masks(&self) -> &[Vec<bool>; 2] {
        &self.masks
    }

    /// Room for the result of [`Projection::project`].
    pub fn correlations(&self) -> Correlations {
        let zeros = || std::array::from_fn(|_| vec![0.0; self.facets]);
        Correlations { rhs: [zeros(), zeros()], energy: 0.0, mean: [[0.0; 3]; 2] }
    }

    /// Computes Aᵀy of a difference measurement into `out`.
    pub fn project(&self, difference: &PatchPair, out: &mut Correlations) -> Result<(), ProjectionError> {
        out.energy = 0.0;
        for (s, side) in Side::BOTH.into_iter().enumerate() {
            let patch = difference.side(side);
            let mask = &self.masks[s];
            if patch.pixels() != mask.len() {
                let expected = mask.len().isqrt();
                return Err(ProjectionError::Size { got: patch.size(), expected });
            }
            for channel in 0..3 {
                let plane = patch.plane(channel);
                let (mut sum, mut squares) = (0.0, 0.0);
                for (k, (&value, &counts)) in plane.iter().zip(mask).enumerate() {
                    if !counts {
                        continue;
                    }
                    if !value.is_finite() {
                        return Err(ProjectionError::NotFinite {
                            side: side.name(),
                            row: k / patch.size(),
                            column: k % patch.size(),
                            channel: ["red", "green", "blue"][channel],
                        });
                    }
                    sum += f64::from(value);
                    squares += f64::from(value).powi(2);
                }
                let mean = sum / self.counted[s].max(1) as f64;
                out.mean[s][channel] = mean;
                out.energy += (squares - sum * mean).max(0.0);
            }
            let planes = [patch.plane(0), patch.plane(1), patch.plane(2)];
            for (n, column) in self.columns[s].chunks_exact(mask.len()).enumerate() {
                let products = dot3(column, planes);
                for (channel, &product) in products.iter().enumerate() {
                    out.rhs[s][channel][n] = product;
                }
            }
        }
        Ok(())
    }

    /// b of eq. 12 for a solution's views X_s = diag(c_s) v: per side and channel, the least-squares constant.
    pub fn illumination(&self, correlations: &Correlations, views: [&[[f64; 3]]; 2]) -> [[f64; 3]; 2] {
        std::array::from_fn(|s| {
            std::array::from_fn(|p| {
                let explained: f64 = self.means[s].iter().zip(views[s]).map(|(mean, rgb)| mean * rgb[p]).sum();
                correlations.mean[s][p] - explained
            })
        })
    }
}

/// The products of one column with three planes. A pixel that does not count has a zero in the column, but NaN x 0 is NaN:
/// such pixels must have been refused or be finite.
fn dot3(column: &[f32], planes: [&[f32]; 3]) -> [f64; 3] {
    planes.map(|plane| {
        column
            .chunks(BLOCK)
            .zip(plane.chunks(BLOCK))
            .map(|(a, y)| {
                // Eight running sums, so that the compiler may use vector registers.
                let mut lanes = [0.0_f32; 8];
                let (a8, y8) = (a.chunks_exact(8), y.chunks_exact(8));
                let rest: f32 = a8.remainder().iter().zip(y8.remainder()).map(|(a, y)| a * y).sum();
                for (a, y) in a8.zip(y8) {
                    for k in 0..8 {
                        lanes[k] += a[k] * y[k];
                    }
                }
                f64::from(lanes.iter().sum::<f32>() + rest)
            })
            .sum()
    })
}

/// MᵀM, columns in parallel.
fn gram(matrix: &DMatrix<f64>) -> DMatrix<f64> {
    let n = matrix.ncols();
    let mut product = DMatrix::zeros(n, n);
    product.as_mut_slice().par_chunks_mut(n.max(1)).enumerate().for_each(|(j, out)| {
        let column = matrix.column(j);
        for (i, value) in out.iter_mut().enumerate() {
            *value = matrix.column(i).dot(&column);
        }
    });
    product
}
