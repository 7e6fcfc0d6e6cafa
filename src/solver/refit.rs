use super::projection::Correlations;
use super::{Solution, Solver};

/// Sweeps of the refit at most; a handful of facets needs a few dozen.
const SWEEPS: usize = 500;
/// A sweep that changes no factor by more than this ends it.
const STILL: f64 = 1e-6;

impl Solver {
    /// Per facet with light, the factor by which its light must be multiplied to fit the frame best, its colour and balance
    /// kept: a least-squares refit on the support, free of the penalty's shrinkage. 1 for dark facets; 0 where the others
    /// explain the frame better without it.
    ///
    /// minimise over f >= 0: ½ ‖y − Σ_n f_n A_n x_n‖², by coordinate descent.
    pub fn refit(&self, frame: &Correlations, solution: &Solution) -> Vec<f64> {
        let x = |n: usize| {
            let i = &solution.intensities[n];
            [i.left, i.right].map(|c| i.colour.map(|v| c * v))
        };
        let support: Vec<(usize, [[f64; 3]; 2])> =
            (0..self.facets()).map(|n| (n, x(n))).filter(|(_, x)| x.iter().flatten().any(|&v| v != 0.0)).collect();
        let dot = |a: &[f64; 3], b: &[f64; 3]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        // The Gram matrix and right-hand side of the lights' own contributions.
        let product = |(n, x): &(usize, [[f64; 3]; 2]), (m, z): &(usize, [[f64; 3]; 2])| {
            (0..2).map(|s| self.gram(s, *n, *m) * dot(&x[s], &z[s])).sum::<f64>()
        };
        let gram: Vec<Vec<f64>> = support.iter().map(|a| support.iter().map(|b| product(a, b)).collect()).collect();
        let wish = |(n, x): &(usize, [[f64; 3]; 2])| {
            (0..2).map(|s| (0..3).map(|p| x[s][p] * frame.rhs[s][p][*n]).sum::<f64>()).sum::<f64>()
        };
        let wishes: Vec<f64> = support.iter().map(wish).collect();
        let mut factors = vec![1.0; support.len()];
        for _ in 0..SWEEPS {
            let mut largest = 0.0_f64;
            for i in 0..support.len() {
                if gram[i][i] <= 0.0 {
                    continue;
                }
                let others: f64 =
                    gram[i].iter().zip(&factors).map(|(g, f)| g * f).sum::<f64>() - gram[i][i] * factors[i];
                let new = ((wishes[i] - others) / gram[i][i]).max(0.0);
                largest = largest.max((new - factors[i]).abs());
                factors[i] = new;
            }
            if largest < STILL {
                break;
            }
        }
        let mut all = vec![1.0; self.facets()];
        support.iter().zip(factors).for_each(|(&(n, _), factor)| all[n] = factor);
        all
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::DMatrix;

    use super::*;
    use crate::solver::{Admissible, Limits};

    #[test]
    fn shrinkage_is_undone() {
        // Two facets that overlap a little, each with a light of its own: y = A x exactly.
        let gram = DMatrix::from_row_slice(3, 3, &[1.0, 0.2, 0.0, 0.2, 1.0, 0.1, 0.0, 0.1, 1.0]);
        let truth = [[0.8, 0.0, 0.6], [0.0, 0.0, 0.0], [0.3, 0.4, 0.0]];
        let rhs = [0, 1].map(|_| {
            [0, 1, 2].map(|p| (0..3).map(|n| (0..3).map(|m| gram[(n, m)] * truth[m][p]).sum()).collect::<Vec<f64>>())
        });
        let energy: f64 = 2.0 * (0..3).map(|p| (0..3).map(|n| truth[n][p] * rhs[0][p][n]).sum::<f64>()).sum::<f64>();
        let frame = Correlations::new(rhs, energy);
        let solver = Solver::new(&[gram.clone(), gram], vec![Admissible::Signed; 3]);
        let solution = solver.solve(&frame, 0.3, Limits::default(), None);
        let factors = solver.refit(&frame, &solution);
        for n in [0, 2] {
            let light = &solution.intensities[n];
            for (colour, truth) in light.colour.iter().zip(truth[n]) {
                assert!(light.left * colour <= 0.85 * truth + 1e-9, "shrunk");
                let refitted = factors[n] * light.left * colour;
                assert!((refitted - truth).abs() < 0.02, "facet {n}: {refitted} for {truth}");
            }
        }
        assert_eq!(factors[1], 1.0);
    }
}
