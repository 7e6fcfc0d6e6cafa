use super::active::{lit, pair, product, rank_one};
use super::projection::Correlations;
use super::{Solution, Solver};

impl Solver {
    /// Per facet with light, the factor that makes its light as bright as measured while keeping its colour and
    /// balance: a least-squares refit on the support, which undoes the penalty's shrinkage. 1 for dark facets.
    ///
    /// With u_n = A_n x_n the light that facet n adds to both patches in all colours, K_nm = ⟨u_n, u_m⟩ and d = f − 1,
    ///
    /// minimise over f >= 0: ½ ‖y − Σ_n f_n u_n‖² + ½ Σ_{n<m} |K_nm| (d_n − sign(K_nm) d_m)²
    ///
    /// Neighbouring facets look alike on the floor, so only their sum is measured, and plain least squares would make
    /// one huge and the other 0. The second term ties two facets in proportion to how much they look alike, or like
    /// each other's opposite, in the direction that the measurement does not determine. It is 0 at f = 1, so the
    /// residual never becomes larger than the solution's. With this term the facets decouple:
    ///
    /// f_n = 1 + ⟨u_n, r⟩ / Σ_m |K_nm|,  r = y − Σ_m u_m
    ///
    /// A facet that shares no light with others gets its least-squares brightness. Facets that cannot be told apart get
    /// the same factor, that of their sum. At a stationary point every factor is between 1 and what the facet would get
    /// alone.
    ///
    /// Allocates nothing if `factors` has capacity for N values.
    pub fn refit(&self, frame: &Correlations, solution: &Solution, factors: &mut Vec<f64>) {
        factors.clear();
        factors.resize(self.facets(), 1.0);
        let lights = || solution.intensities.iter().enumerate().filter(|(_, i)| lit(i)).map(|(n, i)| (n, rank_one(i)));
        for (n, x) in lights() {
            let (mut explained, mut shared) = (0.0, 0.0);
            for (m, z) in lights() {
                let alike: f64 = (0..2).map(|s| self.gram(s, n, m) * dot(&x[s], &z[s])).sum();
                explained += alike;
                shared += alike.abs();
            }
            if shared > 0.0 {
                factors[n] = (1.0 + (product(&x, &pair(&frame.rhs, n)) - explained) / shared).max(0.0);
            }
        }
    }
}

fn dot(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use nalgebra::DMatrix;

    use super::*;
    use crate::solver::{Admissible, Limits};

    #[test]
    fn shrinkage_is_undone() {
        // Two separate facets with light, and a dark one in between that overlaps both: y = A x exactly.
        let gram = DMatrix::from_row_slice(3, 3, &[1.0, 0.2, 0.0, 0.2, 1.0, 0.1, 0.0, 0.1, 1.0]);
        let truth = [[0.8, 0.0, 0.6], [0.0, 0.0, 0.0], [0.3, 0.4, 0.0]];
        let rhs = [0, 1].map(|_| {
            [0, 1, 2].map(|p| (0..3).map(|n| (0..3).map(|m| gram[(n, m)] * truth[m][p]).sum()).collect::<Vec<f64>>())
        });
        let energy: f64 = 2.0 * (0..3).map(|p| (0..3).map(|n| truth[n][p] * rhs[0][p][n]).sum::<f64>()).sum::<f64>();
        let frame = Correlations::new(rhs, energy);
        let solver = Solver::new([gram.clone(), gram], vec![Admissible::Signed; 3]);
        let solution = solver.solve(&frame, 0.3, Limits::default(), None);
        let mut factors = Vec::new();
        solver.refit(&frame, &solution, &mut factors);
        for n in [0, 2] {
            let light = &solution.intensities[n];
            for (colour, truth) in light.colour.iter().zip(truth[n]) {
                assert!(light.left * colour <= 0.85 * truth + 1e-9, "shrunk");
                let refitted = factors[n] * light.left * colour;
                assert!((refitted - truth).abs() < 1e-6, "facet {n}: {refitted} for {truth}");
            }
        }
        assert_eq!(factors[1], 1.0);
    }
}
