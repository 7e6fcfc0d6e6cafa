//! Solving with a symmetric positive definite matrix, in place: nalgebra's decomposition would take a new matrix a frame.

use std::cmp::Ordering;

/// Pivots below this share of the diagonal's value say that the matrix is not safely positive definite.
const PIVOT: f64 = 1e-12;

/// Rows of the factor that a new row is multiplied with at once, so that it is read once for all of them.
const ROWS: usize = 4;

/// Rows that are worked on at once, so that the rows above come from the nearest cache for all but the first of them.
const TILE: usize = 16;

/// Running sums of each product, so that the compiler may use vector registers.
const LANES: usize = 4;

/// Solves M x = b, with M's lower triangle row by row in `matrix` and b in `x`; false if M is not positive definite.
/// `matrix` becomes the factor L of M = L Lᵀ, but with the reciprocals of its diagonal.
pub(super) fn solve(matrix: &mut [f64], x: &mut [f64]) -> bool {
    let n = x.len();
    for top in (0..n).step_by(TILE) {
        let (above, tile) = matrix.split_at_mut(top * n);
        for j in (0..top).step_by(ROWS) {
            for row in tile.chunks_exact_mut(n).take(TILE) {
                eliminate(row, &above[j * n..], n, j, ROWS);
            }
        }
        for i in top..n.min(top + TILE) {
            let (above, row) = tile.split_at_mut((i - top) * n);
            for j in (top..i).step_by(ROWS) {
                eliminate(row, &above[(j - top) * n..], n, j, ROWS.min(i - j));
            }
            let pivot = row[i] - dot(&row[..i], &row[..i]);
            // Not a number counts as not positive.
            if pivot.partial_cmp(&(PIVOT * row[i])) != Some(Ordering::Greater) {
                return false;
            }
            row[i] = 1.0 / pivot.sqrt();
        }
    }
    for i in 0..n {
        x[i] = (x[i] - dot(&matrix[i * n..][..i], &x[..i])) * matrix[i * n + i];
    }
    for i in (0..n).rev() {
        x[i] *= matrix[i * n + i];
        let value = x[i];
        for (x, l) in x[..i].iter_mut().zip(&matrix[i * n..][..i]) {
            *x -= value * l;
        }
    }
    true
}

/// Columns j.. of a row of the factor, from as many of its rows above: L_ij = (M_ij − Σ_{k<j} L_ik L_jk) / L_jj. `rows` begin
/// with row j, `stride` apart.
fn eliminate(row: &mut [f64], rows: &[f64], stride: usize, j: usize, count: usize) {
    let before = |r: usize| &rows[r * stride..][..j];
    let products = if count == ROWS {
        products(&row[..j], [before(0), before(1), before(2), before(3)])
    } else {
        std::array::from_fn(|r| if r < count { dot(&row[..j], before(r)) } else { 0.0 })
    };
    for (r, product) in products.into_iter().enumerate().take(count) {
        let other = &rows[r * stride..][..=j + r];
        let near = (j..j + r).map(|k| row[k] * other[k]).sum::<f64>();
        row[j + r] = (row[j + r] - product - near) * other[j + r];
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; LANES];
    let (a_lanes, b_lanes) = (a.chunks_exact(LANES), b.chunks_exact(LANES));
    let rest: f64 = a_lanes.remainder().iter().zip(b_lanes.remainder()).map(|(a, b)| a * b).sum();
    for (a, b) in a_lanes.zip(b_lanes) {
        for k in 0..LANES {
            sums[k] += a[k] * b[k];
        }
    }
    sums.iter().sum::<f64>() + rest
}

/// The products of one row with four others. Their length is a multiple of the lanes: blocks start at such columns.
fn products(a: &[f64], others: [&[f64]; ROWS]) -> [f64; ROWS] {
    let mut sums = [[0.0; LANES]; ROWS];
    let [mut b, mut c, mut d, mut e] = others.map(|o| o.chunks_exact(LANES));
    for a in a.chunks_exact(LANES) {
        let (Some(b), Some(c), Some(d), Some(e)) = (b.next(), c.next(), d.next(), e.next()) else { break };
        for k in 0..LANES {
            sums[0][k] += a[k] * b[k];
            sums[1][k] += a[k] * c[k];
            sums[2][k] += a[k] * d[k];
            sums[3][k] += a[k] * e[k];
        }
    }
    sums.map(|s| s.iter().sum())
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
