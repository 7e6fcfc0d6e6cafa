use nalgebra::{DMatrix, DVector, SymmetricEigen};

/// Every column of U C differs from its column of A by at most this share of its norm: less than what the noise of a
/// camera or an error of a millimetre in the doorway's width does to it.
const TOLERANCE: f64 = 1e-4;
/// Singular values below this share of the largest are rounding errors.
const ROUNDING: f64 = 1e-7;

/// A matrix of nearly low rank as U C: U has r orthonormal columns, C = UᵀA is r x N.
pub(super) struct LowRank {
    /// U, M x r.
    pub basis: DMatrix<f64>,
    /// C, r x N.
    pub core: DMatrix<f64>,
}

impl LowRank {
    /// From the eigenvectors of AᵀA, which is small: U = A V / σ.
    pub fn new(matrix: &DMatrix<f64>) -> Self {
        let eigen = SymmetricEigen::new(matrix.tr_mul(matrix));
        let mut order: Vec<usize> = (0..eigen.eigenvalues.len()).collect();
        order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
        let largest = order.first().map_or(0.0, |&k| eigen.eigenvalues[k]);
        let norms: Vec<f64> = matrix.column_iter().map(|c| c.norm_squared()).collect();
        let mut left = norms.clone();
        let mut basis: Vec<DVector<f64>> = Vec::new();
        for k in order {
            let done = left.iter().zip(&norms).all(|(left, norm)| *left <= TOLERANCE * TOLERANCE * norm);
            if done || eigen.eigenvalues[k] <= ROUNDING * ROUNDING * largest {
                break;
            }
            let mut vector = matrix * eigen.eigenvectors.column(k);
            // Small singular values come with large relative errors: make the vector orthogonal again.
            for known in &basis {
                let share = known.dot(&vector);
                vector.axpy(-share, known, 1.0);
            }
            let norm = vector.norm();
            vector /= norm;
            for (n, left) in left.iter_mut().enumerate() {
                *left -= vector.dot(&matrix.column(n)).powi(2);
            }
            basis.push(vector);
        }
        let basis = if basis.is_empty() { DMatrix::zeros(matrix.nrows(), 0) } else { DMatrix::from_columns(&basis) };
        let core = basis.tr_mul(matrix);
        Self { basis, core }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_factors_are_orthonormal_and_their_product_is_the_matrix() {
        // Columns that are nearly dependent, as neighbouring facets are.
        let matrix = DMatrix::from_fn(300, 60, |i, j| (-((i as f64 - 5.0 * j as f64) / 40.0).powi(2)).exp());
        let LowRank { basis, core } = LowRank::new(&matrix);
        assert!(basis.ncols() < 60, "rank {}", basis.ncols());
        let identity = basis.tr_mul(&basis);
        assert!((identity - DMatrix::identity(basis.ncols(), basis.ncols())).amax() < 1e-9);
        assert!((&basis * &core - &matrix).amax() < 1e-4 * matrix.amax());
    }
}
