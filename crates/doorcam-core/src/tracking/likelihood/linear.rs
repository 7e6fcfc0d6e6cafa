use nalgebra::SMatrix;

use super::MOST_PEOPLE;

/// Most linear unknowns of a colour: per person and edge, a radiance and the strength of what they hide.
pub(super) const R: usize = 4 * MOST_PEOPLE;

/// Cholesky factor of the leading part of a symmetric matrix.
#[derive(Debug, Clone, Copy)]
pub(super) struct Factor {
    lower: SMatrix<f64, R, R>,
    size: usize,
}

impl Factor {
    /// Factors the leading `size` rows and columns of `matrix`, of which the lower part is read. A pivot that rounding
    /// made too small is replaced by a large one, which holds its unknown at 0.
    pub fn new(mut matrix: SMatrix<f64, R, R>, size: usize) -> Self {
        const HELD: f64 = 1e12;
        for j in 0..size {
            let whole = matrix[(j, j)];
            let mut pivot = whole;
            (0..j).for_each(|k| pivot -= matrix[(j, k)] * matrix[(j, k)]);
            let pivot = if pivot > 1e-12 * whole && pivot.is_finite() { pivot.sqrt() } else { HELD };
            matrix[(j, j)] = pivot;
            for i in j + 1..size {
                let mut value = matrix[(i, j)];
                (0..j).for_each(|k| value -= matrix[(i, k)] * matrix[(j, k)]);
                matrix[(i, j)] = value / pivot;
            }
        }
        Self { lower: matrix, size }
    }

    /// Replaces a right-hand side by the solution.
    pub fn solve(&self, values: &mut [f64; R]) {
        let lower = &self.lower;
        for i in 0..self.size {
            let mut value = values[i];
            (0..i).for_each(|k| value -= lower[(i, k)] * values[k]);
            values[i] = value / lower[(i, i)];
        }
        for i in (0..self.size).rev() {
            let mut value = values[i];
            (i + 1..self.size).for_each(|k| value -= lower[(k, i)] * values[k]);
            values[i] = value / lower[(i, i)];
        }
    }

    /// Log of the determinant.
    pub fn log_determinant(&self) -> f64 {
        (0..self.size).map(|k| 2.0 * self.lower[(k, k)].ln()).sum()
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{DMatrix, DVector};

    use super::*;

    #[test]
    fn a_factor_solves_and_knows_the_determinant() {
        for size in [1, 5, R] {
            let root =
                DMatrix::from_fn(size, size, |i, j| ((5 * i + 3 * j) % 7) as f64 + if i == j { 9.0 } else { 0.0 });
            let whole = &root * root.transpose();
            let matrix = SMatrix::from_fn(|i, j| if i < size && j < size { whole[(i, j)] } else { f64::NAN });
            let factor = Factor::new(matrix, size);
            let mut values = [f64::NAN; R];
            (0..size).for_each(|k| values[k] = (k as f64).sin());
            let right = DVector::from_column_slice(&values[..size]);
            factor.solve(&mut values);
            assert!((&whole * DVector::from_column_slice(&values[..size]) - right).amax() < 1e-9);
            assert!((factor.log_determinant() - 2.0 * root.determinant().abs().ln()).abs() < 1e-8);
        }
    }
}
