use faer::{MatRef, Side};
use nalgebra::{Cholesky, DMatrix};

/// Every column of U C differs from that of A by at most this share of its norm. Camera noise, or an error of a
/// millimetre in the doorway's width, changes it more.
const TOLERANCE: f64 = 1e-4;
/// Singular values below this share of the largest are rounding error.
const ROUNDING: f64 = 1e-7;

/// A matrix of nearly low rank, factored as U C: U has r orthonormal columns, C = UᵀA is r x N.
pub(super) struct LowRank {
    /// U, M x r.
    pub basis: DMatrix<f64>,
    /// C, r x N.
    pub core: DMatrix<f64>,
}

impl LowRank {
    /// Uses the eigenvectors V of AᵀA, which is small: U is the first r columns of A V, made orthonormal.
    pub fn new(matrix: &DMatrix<f64>) -> Self {
        let transposed = matrix.transpose();
        let eigen = Eigen::new(&(&transposed * matrix));
        let mut basis = matrix * eigen.vectors.columns(0, rank(matrix, &eigen));
        // Small singular values have large relative errors; the second pass reduces the rest to rounding.
        orthonormalise(&mut basis);
        orthonormalise(&mut basis);
        let core = basis.transpose() * matrix;
        Self { basis, core }
    }
}

/// A symmetric matrix's eigenvalues and eigenvectors, the largest eigenvalue first.
struct Eigen {
    values: Vec<f64>,
    vectors: DMatrix<f64>,
}

impl Eigen {
    fn new(matrix: &DMatrix<f64>) -> Self {
        let n = matrix.nrows();
        let view = MatRef::from_column_major_slice(matrix.as_slice(), n, n);
        // faer is several times as fast here as nalgebra. It fails only on values that are not finite; nothing is kept
        // then.
        match view.self_adjoint_eigen(Side::Lower) {
            Ok(eigen) => Self {
                values: (0..n).rev().map(|k| eigen.S()[k]).collect(),
                vectors: DMatrix::from_fn(n, n, |i, j| eigen.U()[(i, n - 1 - j)]),
            },
            Err(_) => Self { values: Vec::new(), vectors: DMatrix::zeros(n, 0) },
        }
    }
}

/// The number of strongest directions after which the rest of every column is within the tolerance, judged by the
/// eigenvalues λ: along direction k, column n has the squared norm λ_k V_nk².
fn rank(matrix: &DMatrix<f64>, eigen: &Eigen) -> usize {
    let norms: Vec<f64> = matrix.column_iter().map(|c| c.norm_squared()).collect();
    let mut left = norms.clone();
    let largest = eigen.values.first().copied().unwrap_or(0.0);
    for (taken, (&value, vector)) in eigen.values.iter().zip(eigen.vectors.column_iter()).enumerate() {
        let done = left.iter().zip(&norms).all(|(left, norm)| *left <= TOLERANCE * TOLERANCE * norm);
        if done || value <= ROUNDING * ROUNDING * largest {
            return taken;
        }
        for (left, share) in left.iter_mut().zip(vector.iter()) {
            *left -= value * share * share;
        }
    }
    eigen.values.len()
}

/// Makes nearly orthogonal columns orthonormal: with BᵀB = L Lᵀ, B becomes B L⁻ᵀ.
fn orthonormalise(basis: &mut DMatrix<f64>) {
    for mut column in basis.column_iter_mut() {
        let norm = column.norm();
        column /= norm;
    }
    if let Some(factor) = Cholesky::new(basis.transpose() * &*basis) {
        // L is close to the identity, so its inverse is as accurate as a solve and much faster to apply.
        let mut inverse = DMatrix::identity(basis.ncols(), basis.ncols());
        if factor.l().solve_lower_triangular_mut(&mut inverse) {
            *basis *= inverse.transpose();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_factors_are_orthonormal_and_their_product_is_the_matrix() {
        // Nearly dependent columns, like those of neighbouring facets.
        let matrix = DMatrix::from_fn(300, 60, |i, j| (-((i as f64 - 5.0 * j as f64) / 40.0).powi(2)).exp());
        let LowRank { basis, core } = LowRank::new(&matrix);
        assert!(basis.ncols() < 60, "rank {}", basis.ncols());
        let identity = basis.transpose() * &basis;
        assert!((identity - DMatrix::identity(basis.ncols(), basis.ncols())).amax() < 1e-9);
        assert!((&basis * &core - &matrix).amax() < 1e-4 * matrix.amax());
    }

    #[test]
    fn nothing_at_all_has_rank_zero() {
        let LowRank { basis, core } = LowRank::new(&DMatrix::zeros(30, 4));
        assert_eq!((basis.ncols(), core.shape()), (0, (0, 4)));
    }
}
