//! Small random problems of eq. 13, and eq. 13 itself as written.
#![allow(dead_code)]

use doorcam_core::scene::Intensity;
use doorcam_core::solver::{Admissible, Correlations, Solver};
use nalgebra::{DMatrix, DVector};

/// Random numbers that are the same on every machine (xorshift).
pub struct Numbers(u64);

impl Numbers {
    /// A different sequence for each seed.
    pub fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1)
    }

    /// Uniform in 0..1.
    pub fn unit(&mut self) -> f64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Uniform in -1..1.
    pub fn signed(&mut self) -> f64 {
        2.0 * self.unit() - 1.0
    }
}

/// A problem with its columns and measurement, not only their products, so that eq. 13 can be evaluated directly.
pub struct Problem {
    pub columns: [DMatrix<f64>; 2],
    pub y: [[DVector<f64>; 3]; 2],
    pub kinds: Vec<Admissible>,
    pub gram: [DMatrix<f64>; 2],
    pub frame: Correlations,
}

impl Problem {
    /// A random problem. Neighbouring columns look alike, as those of neighbouring facets do.
    pub fn random(facets: usize, pixels: usize, seed: u64, kind: impl Fn(usize) -> Admissible) -> Self {
        let mut numbers = Numbers::new(seed);
        let columns = [0, 1].map(|_| {
            let mut matrix = DMatrix::zeros(pixels, facets);
            for n in 0..facets {
                for k in 0..pixels {
                    let before = if n > 0 { matrix[(k, n - 1)] } else { 0.0 };
                    matrix[(k, n)] = 0.8 * before + 0.6 * numbers.signed();
                }
            }
            matrix
        });
        // The light of a few facets, plus noise.
        let mut y = [0, 1].map(|_| [0, 1, 2].map(|_| DVector::from_fn(pixels, |_, _| 0.2 * numbers.signed())));
        for _ in 0..1 + facets / 8 {
            let n = (numbers.unit() * facets as f64) as usize;
            for (y, columns) in y.iter_mut().zip(&columns) {
                let c = numbers.unit();
                y.iter_mut().for_each(|y| *y += columns.column(n) * c * numbers.signed());
            }
        }
        Self::new(columns, y, (0..facets).map(kind).collect())
    }

    pub fn new(columns: [DMatrix<f64>; 2], y: [[DVector<f64>; 3]; 2], kinds: Vec<Admissible>) -> Self {
        let gram = [0, 1].map(|s| columns[s].tr_mul(&columns[s]));
        let rhs = [0, 1].map(|s| [0, 1, 2].map(|p| columns[s].tr_mul(&y[s][p]).as_slice().to_vec()));
        let energy = y.iter().flatten().map(|y| y.norm_squared()).sum();
        let frame = Correlations::new(rhs, energy);
        Self { columns, y, kinds, gram, frame }
    }

    pub fn solver(&self) -> Solver {
        Solver::new(self.gram.clone(), self.kinds.clone())
    }

    /// Eq. 13 as written, without b.
    pub fn objective(&self, intensities: &[Intensity], lambda: f64, weights: &[f64]) -> f64 {
        let mut value = 0.0;
        for s in 0..2 {
            for p in 0..3 {
                let x = DVector::from_fn(intensities.len(), |n, _| {
                    [intensities[n].left, intensities[n].right][s] * intensities[n].colour[p]
                });
                value += 0.5 * (&self.columns[s] * x - &self.y[s][p]).norm_squared();
            }
        }
        value + lambda * intensities.iter().zip(weights).map(|(i, w)| w * i.left.hypot(i.right)).sum::<f64>()
    }

    /// A random admissible value.
    pub fn admissible(kind: Admissible, numbers: &mut Numbers) -> Intensity {
        let mut v: [f64; 3] = std::array::from_fn(|_| numbers.signed());
        let mut c = [numbers.signed(), numbers.signed()];
        if kind.colour_is_nonnegative() {
            v = v.map(f64::abs);
        }
        if kind.light_is_nonnegative() {
            c = c.map(f64::abs);
        }
        let norm = v.iter().map(|x| x * x).sum::<f64>().sqrt();
        Intensity { left: c[0], right: c[1], colour: v.map(|x| x / norm) }
    }
}
