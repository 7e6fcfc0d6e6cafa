use nalgebra::DMatrix;

/// Columns of numbers in 16 bits, exact to 1/65534 of the largest magnitude in their column: half the memory of f32,
/// with an error far below that of interpolating between neighbouring columns.
#[derive(Debug, Clone)]
pub(super) struct Columns {
    /// Column-major, in units of each column's step.
    values: Vec<i16>,
    steps: Vec<f32>,
}

impl Columns {
    /// Quantises the columns of a matrix.
    pub fn new(matrix: &DMatrix<f32>) -> Self {
        let steps: Vec<f32> = matrix.column_iter().map(|column| column.amax() / f32::from(i16::MAX)).collect();
        let units = |(column, &step): (&[f32], &f32)| {
            let per_step = if step > 0.0 { step.recip() } else { 0.0 };
            column.iter().map(|value| (value * per_step).round() as i16).collect::<Vec<_>>()
        };
        let columns = matrix.as_slice().chunks(matrix.nrows().max(1)).zip(&steps);
        let mut values = Vec::with_capacity(matrix.len());
        columns.map(units).for_each(|column| values.extend(column));
        Self { values, steps }
    }

    /// Length of each column.
    pub fn rows(&self) -> usize {
        self.values.len() / self.steps.len().max(1)
    }

    /// A column in units of its step, and the step.
    pub fn column(&self, number: usize) -> (&[i16], f32) {
        let rows = self.rows();
        (&self.values[number * rows..][..rows], self.steps[number])
    }

    /// The columns as a matrix.
    pub fn matrix(&self) -> DMatrix<f32> {
        DMatrix::from_fn(self.rows(), self.steps.len(), |row, number| {
            let (column, step) = self.column(number);
            f32::from(column[row]) * step
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_number_is_as_exact_as_the_largest_of_its_column_allows() {
        let matrix =
            DMatrix::from_fn(7, 5, |i, j| (i as f32 - 3.3) * 10.0_f32.powi(3 * j as i32 - 6) * (j as f32 - 4.0));
        let columns = Columns::new(&matrix);
        assert_eq!(columns.rows(), 7);
        for (column, (original, kept)) in matrix.column_iter().zip(columns.matrix().column_iter()).enumerate() {
            let error = (original - kept).amax();
            assert!(error <= original.amax() / 65_000.0, "{column}: {error}");
            assert_eq!(original.amax() == 0.0, kept.amax() == 0.0);
        }
        let nothing = Columns::new(&DMatrix::zeros(0, 3));
        assert_eq!((nothing.rows(), nothing.matrix().shape()), (0, (0, 3)));
    }
}
