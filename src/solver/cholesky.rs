//! Solving with a symmetric positive definite matrix, in place: nalgebra's decomposition would take a new matrix a frame.

use std::cmp::Ordering;

/// Pivots below this share of the diagonal's value say that the matrix is not safely positive definite.
const PIVOT: f64 = 1e-12;

/// Solves M x = b, with M's lower triangle row by row in `matrix` and b in `x`; false if M is not positive definite.
/// `matrix` becomes the factor L of M = L Lᵀ.
pub(super) fn solve(matrix: &mut [f64], x: &mut [f64]) -> bool {
    let n = x.len();
    for i in 0..n {
        let (above, row) = matrix.split_at_mut(i * n);
        let row = &mut row[..n];
        for j in 0..i {
            let other = &above[j * n..][..=j];
            row[j] = (row[j] - dot(&row[..j], &other[..j])) / other[j];
        }
        let pivot = row[i] - dot(&row[..i], &row[..i]);
        // Not a number counts as not positive.
        if pivot.partial_cmp(&(PIVOT * row[i])) != Some(Ordering::Greater) {
            return false;
        }
        row[i] = pivot.sqrt();
    }
    for i in 0..n {
        x[i] = (x[i] - dot(&matrix[i * n..][..i], &x[..i])) / matrix[i * n + i];
    }
    for i in (0..n).rev() {
        x[i] /= matrix[i * n + i];
        let value = x[i];
        for (x, l) in x[..i].iter_mut().zip(&matrix[i * n..][..i]) {
            *x -= value * l;
        }
    }
    true
}

/// Eight running sums, so that the compiler may use vector registers.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; 8];
    let (a8, b8) = (a.chunks_exact(8), b.chunks_exact(8));
    let rest: f64 = a8.remainder().iter().zip(b8.remainder()).map(|(a, b)| a * b).sum();
    for (a, b) in a8.zip(b8) {
        for k in 0..8 {
            sums[k] += a[k] * b[k];
        }
    }
    sums.iter().sum::<f64>() + rest
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
            let matrix = &root * root.transpose() + DMatrix::identity(n, n) * 0.1;
            let wanted = DVector::from_fn(n, |i, _| entries[1600 + i]);
            let mut x = (&matrix * &wanted).as_slice().to_vec();
            // Symmetric: columns are rows.
            prop_assert!(solve(&mut matrix.as_slice().to_vec(), &mut x));
            for (x, wanted) in x.iter().zip(wanted.iter()) {
                prop_assert!((x - wanted).abs() < 1e-9);
            }
            let indefinite = &matrix - DMatrix::identity(n, n) * (matrix[(n - 1, n - 1)] + 0.1);
            prop_assert!(!solve(&mut indefinite.as_slice().to_vec(), &mut x));
        }
    }
}
