//! Solves linear systems with a symmetric positive definite matrix in place.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::{LltRegularization, cholesky_in_place, cholesky_in_place_scratch};
use faer::linalg::cholesky::llt::solve::solve_in_place;
use faer::{MatMut, Par, Spec};

/// Diagonal entries below this share of the largest are scaled as if they were this large.
const LEAST: f64 = 1e-12;

/// Workspace for a factorisation.
pub(super) struct Cholesky {
    scratch: MemBuffer,
    /// One over the square root of the diagonal.
    scale: Vec<f64>,
}

impl Cholesky {
    /// A workspace for matrices of up to `n` rows; it grows for a larger one.
    pub fn with_capacity(n: usize) -> Self {
        Self { scratch: scratch(n), scale: Vec::with_capacity(n) }
    }

    /// Solves M x = b, with M's lower triangle column by column in `matrix` and b in `x`. Returns false, and leaves `x`
    /// meaningless, if M is not positive definite. Overwrites `matrix`.
    pub fn solve(&mut self, matrix: &mut [f64], x: &mut [f64]) -> bool {
        let n = x.len();
        if self.scale.capacity() < n {
            *self = Self::with_capacity(n);
        }
        // Scaling the diagonal to ones removes much of the ill-conditioning.
        let diagonal = || (0..n).map(|i| matrix[i * n + i].abs());
        let least = (LEAST * diagonal().fold(0.0, f64::max)).max(f64::MIN_POSITIVE);
        self.scale.clear();
        self.scale.extend(diagonal().map(|entry| entry.max(least).sqrt().recip()));
        for (j, column) in matrix.chunks_exact_mut(n).enumerate() {
            let by = self.scale[j];
            column[j..].iter_mut().zip(&self.scale[j..]).for_each(|(value, scale)| *value *= by * scale);
        }
        x.iter_mut().zip(&self.scale).for_each(|(x, scale)| *x *= scale);
        let mut matrix = MatMut::from_column_major_slice_mut(matrix, n, n);
        let stack = MemStack::new(&mut self.scratch);
        let factored =
            cholesky_in_place(matrix.as_mut(), LltRegularization::default(), Par::Seq, stack, Spec::default());
        if factored.is_err() {
            return false;
        }
        let unknowns = MatMut::from_column_major_slice_mut(x, n, 1);
        solve_in_place(matrix.as_ref(), unknowns, Par::Seq, MemStack::new(&mut []));
        x.iter_mut().zip(&self.scale).for_each(|(x, scale)| *x *= scale);
        true
    }
}

impl std::fmt::Debug for Cholesky {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Cholesky").field("capacity", &self.scale.capacity()).finish_non_exhaustive()
    }
}

impl Clone for Cholesky {
    fn clone(&self) -> Self {
        Self::with_capacity(self.scale.capacity())
    }
}

impl Default for Cholesky {
    fn default() -> Self {
        Self::with_capacity(0)
    }
}

fn scratch(n: usize) -> MemBuffer {
    MemBuffer::new(cholesky_in_place_scratch::<f64>(n, Par::Seq, Spec::default()))
}

#[cfg(test)]
mod tests {
    use nalgebra::{DMatrix, DVector};
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn solves_what_was_multiplied(n in 1usize..40, entries in prop::collection::vec(-1.0..1.0f64, 1640)) {
            let root = DMatrix::from_fn(n, n, |i, j| entries[i * n + j]);
            let scale = DMatrix::from_diagonal(&DVector::from_fn(n, |i, _| 10f64.powf(3.0 * entries[1639 - i])));
            let matrix = &scale * (&root * root.transpose() + DMatrix::identity(n, n) * 0.1) * &scale;
            let wanted = DVector::from_fn(n, |i, _| entries[1600 + i] / scale[(i, i)]);
            let b = &matrix * &wanted;
            let mut cholesky = Cholesky::with_capacity(20);
            let mut x = b.as_slice().to_vec();
            prop_assert!(cholesky.solve(&mut matrix.as_slice().to_vec(), &mut x));
            for (i, (x, wanted)) in x.iter().zip(wanted.iter()).enumerate() {
                prop_assert!((x - wanted).abs() * scale[(i, i)] < 1e-9);
            }
            let indefinite = &matrix - DMatrix::identity(n, n) * (matrix[(n - 1, n - 1)] + 0.1);
            prop_assert!(!cholesky.solve(&mut indefinite.as_slice().to_vec(), &mut b.as_slice().to_vec()));
        }
    }
}
