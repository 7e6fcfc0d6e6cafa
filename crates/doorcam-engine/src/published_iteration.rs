use nalgebra::DMatrix;

use doorcam_core::scene::Intensity;
use doorcam_core::solver::Correlations;

/// The authors' method for solving eq. 13, as the reference for measuring [`doorcam_core::solver::Solver`]: accelerated
/// proximal gradient steps on v, c_L and c_R together.
///
/// It works in Gram form with b eliminated: a step costs two products of an N x N with an N x 3 matrix, whatever the
/// number of pixels. That is already much less than in their program, which multiplies with A and Aᵀ and takes steps on
/// b as well.
#[derive(Debug, Clone)]
pub struct PublishedIteration<'a> {
    gram: &'a [DMatrix<f64>; 2],
    foreground: &'a [bool],
    /// A_sᵀ y, N x 3 per side.
    rhs: [DMatrix<f64>; 2],
    lambda: f64,
    point: Point,
    /// The point extrapolated by its momentum, where the next gradient is taken.
    ahead: Point,
    /// t_k of the momentum.
    t: f64,
    /// Workspace for G_s X_s − A_sᵀ y, and for X_s = diag(c_s) v.
    gradient: [DMatrix<f64>; 2],
    light: DMatrix<f64>,
}

/// v, N x 3, with unit rows except where momentum has moved it, and (c_L, c_R), N x 2.
#[derive(Debug, Clone)]
struct Point {
    v: DMatrix<f64>,
    c: DMatrix<f64>,
}

impl<'a> PublishedIteration<'a> {
    /// Steps that the authors take per frame.
    pub const STEPS: usize = 20_000;
    /// Length of a step.
    const STEP: f64 = 1e-4;

    /// Starts from the empty map with grey facets. `gram` and `frame` must have columns in units of radiance, as the
    /// authors' have.
    pub fn new(gram: &'a [DMatrix<f64>; 2], foreground: &'a [bool], frame: &Correlations, lambda: f64) -> Self {
        let n = foreground.len();
        let point = Point { v: DMatrix::from_element(n, 3, 3.0_f64.sqrt().recip()), c: DMatrix::zeros(n, 2) };
        let rhs = [0, 1].map(|s| DMatrix::from_fn(n, 3, |k, p| frame.rhs[s][p][k]));
        Self {
            gram,
            foreground,
            lambda,
            ahead: point.clone(),
            point,
            t: 1.0,
            gradient: rhs.clone(),
            light: DMatrix::zeros(n, 3),
            rhs,
        }
    }

    /// Takes one step.
    pub fn step(&mut self) {
        for (s, gradient) in self.gradient.iter_mut().enumerate() {
            for p in 0..3 {
                self.light.set_column(p, &self.ahead.v.column(p).component_mul(&self.ahead.c.column(s)));
            }
            gradient.copy_from(&self.rhs[s]);
            gradient.gemm(1.0, &self.gram[s], &self.light, -1.0);
        }
        let next_t = (1.0 + (1.0 + 4.0 * self.t * self.t).sqrt()) / 2.0;
        let momentum = (self.t - 1.0) / next_t;
        self.t = next_t;
        for n in 0..self.foreground.len() {
            let pull = |s: usize, p: usize| self.gradient[s][(n, p)];
            let (v, c) = ([0, 1, 2].map(|p| self.ahead.v[(n, p)]), [0, 1].map(|s| self.ahead.c[(n, s)]));
            let next_v = unit([0, 1, 2].map(|p| v[p] - Self::STEP * (c[0] * pull(0, p) + c[1] * pull(1, p))), v);
            let along = [0, 1].map(|s| c[s] - Self::STEP * (0..3).map(|p| pull(s, p) * v[p]).sum::<f64>());
            let next_c = self.shrink(n, along);
            for (p, next) in next_v.into_iter().enumerate() {
                self.ahead.v[(n, p)] = next + momentum * (next - self.point.v[(n, p)]);
                self.point.v[(n, p)] = next;
            }
            for (s, next) in next_c.into_iter().enumerate() {
                self.ahead.c[(n, s)] = next + momentum * (next - self.point.c[(n, s)]);
                self.point.c[(n, s)] = next;
            }
        }
    }

    /// The proximal step of the penalty and, in the foreground, of c >= 0.
    fn shrink(&self, n: usize, c: [f64; 2]) -> [f64; 2] {
        let c = if self.foreground[n] { c.map(|c| c.max(0.0)) } else { c };
        let norm = c[0].hypot(c[1]);
        let threshold = self.lambda * Self::STEP;
        if norm <= threshold { [0.0; 2] } else { c.map(|c| c * (1.0 - threshold / norm)) }
    }

    /// The map so far, with unit colours.
    pub fn intensities(&self) -> Vec<Intensity> {
        let facet = |n: usize| {
            let v = [0, 1, 2].map(|p| self.point.v[(n, p)]);
            let norm = v.iter().map(|v| v * v).sum::<f64>().sqrt();
            let c = [0, 1].map(|s| self.point.c[(n, s)] * norm);
            if norm > 0.0 && c != [0.0; 2] {
                Intensity { left: c[0], right: c[1], colour: v.map(|v| v / norm) }
            } else {
                Intensity::default()
            }
        };
        (0..self.foreground.len()).map(facet).collect()
    }
}

/// The nearest unit vector with v >= 0, or `before` if there is none.
fn unit(v: [f64; 3], before: [f64; 3]) -> [f64; 3] {
    let v = v.map(|v| v.max(0.0));
    let norm = v.iter().map(|v| v * v).sum::<f64>().sqrt();
    if norm > 0.0 { v.map(|v| v / norm) } else { before }
}

#[cfg(test)]
mod tests {
    use super::*;
    use doorcam_core::solver::{Admissible, Limits, Solver};

    /// Two facets whose columns overlap a little, one in the foreground and one in the background.
    #[test]
    fn it_comes_to_the_solvers_solution() {
        let gram = [0.3, 0.2].map(|cross| DMatrix::from_row_slice(2, 2, &[40.0, cross, cross, 30.0]));
        let foreground = [true, false];
        let rhs = [
            [vec![9.0, -6.0], vec![1.0, -1.0], vec![-2.0, -3.0]],
            [vec![6.0, -9.0], vec![2.0, -2.0], vec![-3.0, -4.0]],
        ];
        let frame = Correlations::new(rhs, 10.0);
        let lambda = 0.5;
        let mut published = PublishedIteration::new(&gram, &foreground, &frame, lambda);
        for _ in 0..PublishedIteration::STEPS {
            published.step();
        }
        let solver = Solver::new(gram.clone(), vec![Admissible::Brighter, Admissible::EitherSign]);
        let ours = solver.solve(&frame, lambda, Limits::default(), None).intensities;
        for (a, b) in published.intensities().iter().zip(&ours) {
            assert!((a.left - b.left).abs() < 1e-5 && (a.right - b.right).abs() < 1e-6, "{a:?} {b:?}");
            assert!(a.colour.iter().zip(b.colour).all(|(a, b)| (a - b).abs() < 1e-5), "{a:?} {b:?}");
        }
        assert!(published.intensities()[0].left > 0.0 && published.intensities()[1].left < 0.0);
    }
}
