//! From Fisher information to covariance.

use nalgebra::{Cholesky, DMatrix};

/// A parameter is observable if the others leave at least this share of its information; less is rounding error.
const LEAST_SHARE: f64 = 1e-13;

/// The inverse of a Fisher information matrix; none if it leaves a direction unknown.
///
/// Parameters have different units, so each is scaled to unit information. Then only correlation between them can make
/// the matrix ill-conditioned.
pub(super) fn covariance(information: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let scale = information.diagonal().map(|f| 1.0 / f.sqrt());
    if !scale.iter().all(|s| s.is_finite() && *s > 0.0) {
        return None;
    }
    let outer = &scale * scale.transpose();
    let factor = Cholesky::new(information.component_mul(&outer))?;
    if factor.l_dirty().diagonal().iter().any(|pivot| pivot * pivot < LEAST_SHARE) {
        return None;
    }
    Some(factor.inverse().component_mul(&outer))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_do_not_matter_and_unknown_directions_are_told() {
        let information = DMatrix::from_row_slice(2, 2, &[4.0, 1.0, 1.0, 1.0]);
        let inverse = covariance(&information).unwrap();
        let expected = DMatrix::from_row_slice(2, 2, &[1.0, -1.0, -1.0, 4.0]) / 3.0;
        assert!((inverse - &expected).norm() < 1e-14);
        let units = DMatrix::from_diagonal(&nalgebra::DVector::from_row_slice(&[1e-9, 1e7]));
        let scaled = covariance(&(&units * &information * &units)).unwrap();
        assert!((&units * scaled * &units - expected).norm() < 1e-14);
        assert!(covariance(&DMatrix::from_row_slice(2, 2, &[1.0, 1.0, 1.0, 1.0])).is_none());
        assert!(covariance(&DMatrix::from_row_slice(2, 2, &[1.0, 0.0, 0.0, 0.0])).is_none());
    }
}
