use nalgebra::{DMatrix, DVector};

use super::active::pair;
use super::facet::Admissible;
use super::low_rank::LowRank;
use super::nuisance::Nuisance;
use super::own_picture::OwnPictures;
use super::planes::{dot3, weigh_plane};
use crate::geometry::Side;
use crate::light::PatchPair;
use crate::transport::Transport;

/// Patterns that differ by less, in 1 − cos², are the same but for rounding.
const ALIKE: f64 = 1e-9;

/// How the columns of A enter the problem.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Columns {
    /// As the transport has them: far facets, which light the floor less, pay more for the same light.
    Radiance,
    /// Each column of A_L and of A_R scaled to unit norm: what a facet pays is how much the floor changes, near or far.
    /// Intensities are then norms of that change, not radiances.
    UnitNorm,
}

/// What is known of a patch's pixels, row by row from the wall; per side.
#[derive(Debug, Clone, PartialEq)]
pub struct Pixels {
    /// Weights W: one over the noise. Pixels of weight 0 do not count at all.
    pub weights: [Vec<f64>; 2],
    /// The floor's reflectance relative to its surroundings: light from the room comes back multiplied by it.
    pub albedo: [Vec<f64>; 2],
}

impl Pixels {
    /// All alike, but for those that do not count.
    pub fn uniform(counted: &[Vec<bool>; 2]) -> Self {
        Self {
            weights: [0, 1].map(|s| counted[s].iter().map(|&c| f64::from(u8::from(c))).collect()),
            albedo: [0, 1].map(|s| vec![1.0; counted[s].len()]),
        }
    }
}

/// Takes difference measurements to the Gram system: Aᵀy with the nuisances eliminated.
///
/// Nuisances are patterns that the visible side's light and the camera's gain add to a patch at any strength, unpenalised:
/// in eq. 12 the constant b^p. With Q an orthonormal basis of them, their least-squares strengths leave the problem with
/// (I − QQᵀ) W A for A and (I − QQᵀ) W y for y, W the pixels' weights; the rows of A are
/// multiplied by the floor's albedo. A is nearly of low rank, so it is kept as U C with orthonormal U (M x r): a frame
/// costs the r + q products [Q U]ᵀ W y instead of N.
///
/// If the nuisances have the colours' own pictures x0, y^p − δ x0^p stands for y^p throughout, δ the weighted least-squares
/// share of the picture. A is not freed of them: in each colour they are, but for their noise, what Q spans, and A would
/// become another one for each colour.
#[derive(Debug, Clone)]
pub struct Projection {
    sides: [ProjectedSide; 2],
    facets: usize,
}

#[derive(Debug, Clone)]
struct ProjectedSide {
    weights: Vec<f32>,
    /// Q then U, one orthonormal vector after the other.
    basis: Vec<f32>,
    /// Vectors of Q.
    nuisances: usize,
    /// The colours' own pictures, which leave before Q does.
    own: Option<OwnPictures>,
    /// Per vector of Q and channel, its product with the own picture (of unit norm).
    overlap: Vec<[f64; 3]>,
    /// C, r x N: (I − QQᵀ) W A = U C, columns scaled.
    core: DMatrix<f64>,
    /// QᵀWA with scaled columns: what of each facet's light looks like a nuisance.
    absorbed: DMatrix<f64>,
    /// Mean over the patch of each nuisance vector, taken back to unweighted pixels.
    means: Vec<f64>,
    /// Radiance of a facet of intensity 1.
    scale: Vec<f64>,
}

/// What the solver needs to know of one frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Correlations {
    /// Per side and channel, A_sᵀ y^p: N values.
    pub rhs: [[Vec<f64>; 3]; 2],
    /// Σ_p ‖y^p‖² over both patches once the nuisances are out: twice the objective of the empty map.
    pub energy: f64,
    /// Per side and channel, Qᵀ W y^p once the own picture is out.
    nuisance: [[Vec<f64>; 3]; 2],
    /// Per side and channel, the share of the own picture (of unit norm); 0 if the nuisances have none.
    own: [[f64; 3]; 2],
    /// W y of one patch.
    weighted: [Vec<f32>; 3],
    /// UᵀWy of one patch.
    coordinates: [DVector<f64>; 3],
}

impl Correlations {
    /// Of a problem that has no pixels behind it, such as a test's.
    pub fn new(rhs: [[Vec<f64>; 3]; 2], energy: f64) -> Self {
        let coordinates = std::array::from_fn(|_| DVector::zeros(0));
        let (nuisance, own, weighted) = Default::default();
        Self { rhs, energy, nuisance, own, weighted, coordinates }
    }

    /// The smallest λ at which a map of facets that may all show any change is empty: their largest dual norm.
    pub fn signed_lambda_max(&self) -> f64 {
        let facets = self.rhs[0][0].len();
        (0..facets).map(|n| Admissible::Signed.dual_norm(&pair(&self.rhs, n))).fold(0.0, f64::max)
    }
}

/// A measurement that cannot be used.
#[derive(Debug, thiserror::Error, PartialEq, Eq)]
pub enum ProjectionError {
    /// A pixel is not a number, or infinite.
    #[error("{side} patch, row {row}, column {column}: the {channel} value is not a finite number")]
    NotFinite {
        /// The patch.
        side: &'static str,
        /// Row from the wall.
        row: usize,
        /// Column from the smallest x.
        column: usize,
        /// The colour.
        channel: &'static str,
    },
    /// The patches have another size than the model's.
    #[error("the patches have {got} x {got} pixels, the model {expected} x {expected}")]
    Size {
        /// Pixels along a side of the patches.
        got: usize,
        /// What the model was built for.
        expected: usize,
    },
}

impl Projection {
    /// Weighs, frees of nuisances, scales and factors the columns of `transport`.
    pub fn new(transport: &Transport, pixels: &Pixels, nuisance: &Nuisance, columns: Columns) -> Self {
        let project = |s: usize| {
            let (weights, albedo) = (&pixels.weights[s], &pixels.albedo[s]);
            let rows: Vec<f64> = weights.iter().zip(albedo).map(|(w, a)| w * a).collect();
            let weighted = multiply_rows(transport.side(Side::BOTH[s]), &rows);
            let own = nuisance.own(Side::BOTH[s]).map(|picture| OwnPictures::new(picture, weights, &weighted));
            ProjectedSide::new(weighted, weights, nuisance.side(s), own, columns)
        };
        let sides = rayon::join(|| project(0), || project(1)).into();
        Self { facets: transport.left.ncols(), sides }
    }

    /// Number of facets, N.
    pub fn facets(&self) -> usize {
        self.facets
    }

    /// Per side, the number of products that a frame costs.
    pub fn rank(&self) -> [usize; 2] {
        [0, 1].map(|s| self.sides[s].nuisances + self.sides[s].core.nrows())
    }

    /// AᵀA of the left and the right side: N x N each. Worked out anew each time, for whoever solves to keep.
    pub fn gram(&self) -> [DMatrix<f64>; 2] {
        let gram = |s: usize| self.sides[s].core.transpose() * &self.sides[s].core;
        rayon::join(|| gram(0), || gram(1)).into()
    }

    /// Per side and facet, the radiance of a facet of intensity 1; 0 for a facet that lights no pixel.
    pub fn radiance(&self) -> [&[f64]; 2] {
        [0, 1].map(|s| self.sides[s].scale.as_slice())
    }

    /// Room for the result of [`Projection::project`].
    pub fn correlations(&self) -> Correlations {
        let zeros = |n: usize| std::array::from_fn(|_| vec![0.0; n]);
        Correlations {
            rhs: [zeros(self.facets), zeros(self.facets)],
            energy: 0.0,
            nuisance: [0, 1].map(|s| zeros(self.sides[s].nuisances)),
            own: [[0.0; 3]; 2],
            weighted: std::array::from_fn(|_| vec![0.0; self.sides[0].weights.len()]),
            coordinates: std::array::from_fn(|_| {
                DVector::zeros(self.sides.iter().map(|side| side.core.nrows()).max().unwrap_or(0))
            }),
        }
    }

    /// Writes what white noise of unit variance in W y would give into `out`; `normal` draws standard normal numbers.
    pub fn white_noise(&self, out: &mut Correlations, mut normal: impl FnMut() -> f64) {
        for (s, side) in self.sides.iter().enumerate() {
            let rank = side.core.nrows();
            for (rhs, coordinates) in out.rhs[s].iter_mut().zip(&mut out.coordinates) {
                coordinates.rows_mut(0, rank).iter_mut().for_each(|c| *c = normal());
                for (rhs, column) in rhs.iter_mut().zip(side.core.column_iter()) {
                    *rhs = column.dot(&coordinates.rows(0, rank));
                }
            }
        }
    }

    /// Computes Aᵀy of a difference measurement into `out`. Allocates nothing.
    pub fn project(&self, difference: &PatchPair, out: &mut Correlations) -> Result<(), ProjectionError> {
        out.energy = 0.0;
        for (s, side) in Side::BOTH.into_iter().enumerate() {
            let (patch, projected) = (difference.side(side), &self.sides[s]);
            let pixels = projected.weights.len();
            if patch.pixels() != pixels {
                return Err(ProjectionError::Size { got: patch.size(), expected: pixels.isqrt() });
            }
            let mut energy = 0.0;
            for (channel, weighted) in out.weighted.iter_mut().enumerate() {
                let bad = |k: usize| ProjectionError::NotFinite {
                    side: side.name(),
                    row: k / patch.size(),
                    column: k % patch.size(),
                    channel: ["red", "green", "blue"][channel],
                };
                let whole = weigh_plane(patch.plane(channel), &projected.weights, weighted).map_err(bad)?;
                energy += match &projected.own {
                    None => whole,
                    Some(own) => {
                        let (share, rest) = own.remove(channel, weighted);
                        out.own[s][channel] = share;
                        rest
                    }
                };
            }
            for (k, vector) in projected.basis.chunks_exact(pixels).enumerate() {
                let products = dot3(vector, &out.weighted);
                for (channel, product) in products.into_iter().enumerate() {
                    match k.checked_sub(projected.nuisances) {
                        None => {
                            energy -= product * product;
                            out.nuisance[s][channel][k] = product;
                        }
                        Some(k) => out.coordinates[channel][k] = product,
                    }
                }
            }
            out.energy += energy.max(0.0);
            let rank = projected.core.nrows();
            for (rhs, coordinates) in out.rhs[s].iter_mut().zip(&out.coordinates) {
                for (rhs, column) in rhs.iter_mut().zip(projected.core.column_iter()) {
                    *rhs = column.dot(&coordinates.rows(0, rank));
                }
            }
        }
        Ok(())
    }

    /// The mean over each patch of what the nuisances explain once the facets' light is taken away, per side and channel:
    /// with the constant as the only nuisance, b of eq. 12. `intensities(s, n)` is X_sn = c_sn v_n.
    pub fn illumination(
        &self,
        correlations: &Correlations,
        intensities: impl Fn(usize, usize) -> [f64; 3],
    ) -> [[f64; 3]; 2] {
        [0, 1].map(|s| {
            let side = &self.sides[s];
            let mut explained = [0.0; 3];
            for (q, mean) in side.means.iter().enumerate() {
                let whole = |p: usize| correlations.nuisance[s][p][q] + side.overlap[q][p] * correlations.own[s][p];
                let mut strength = [0, 1, 2].map(whole);
                for n in 0..self.facets {
                    let x = intensities(s, n);
                    strength.iter_mut().zip(x).for_each(|(strength, x)| *strength -= side.absorbed[(q, n)] * x);
                }
                explained.iter_mut().zip(strength).for_each(|(sum, strength)| *sum += mean * strength);
            }
            explained
        })
    }

    /// Per side and channel, how strong a change of the first pattern may be in the frame, besides a gain and what happens in
    /// the room: the smaller of its strength (weighed, of unit norm) in a least-squares fit of it and the own picture, to
    /// which a gain adds nothing, and the own picture's share of the frame, to which the room adds little. 0 where the first
    /// pattern and the own picture are the same, so that the own picture takes both.
    pub fn even_light(&self, correlations: &Correlations) -> [[f64; 3]; 2] {
        [0, 1].map(|s| {
            let strength = |p: usize| {
                let product = correlations.nuisance[s][p].first().copied().unwrap_or(0.0);
                let apart = 1.0 - self.sides[s].overlap.first().map_or(0.0, |overlap| overlap[p] * overlap[p]);
                let fitted = if apart > ALIKE { product.abs() / apart } else { 0.0 };
                fitted.min(correlations.own[s][p].abs())
            };
            [0, 1, 2].map(strength)
        })
    }

    /// Per side and channel, by what factor the own picture is multiplied once the facets' light is taken away:
    /// 1 + Σ w² x0 (y − A x) / Σ w² x0². None if the nuisances have no own pictures. `intensities(s, n)` is X_sn = c_sn v_n.
    pub fn gain(
        &self,
        correlations: &Correlations,
        intensities: impl Fn(usize, usize) -> [f64; 3],
    ) -> Option<[[f64; 3]; 2]> {
        let gain = |s: usize| {
            let own = self.sides[s].own.as_ref()?;
            Some([0, 1, 2].map(|p| own.gain(p, correlations.own[s][p], (0..self.facets).map(|n| intensities(s, n)[p]))))
        };
        Some([gain(0)?, gain(1)?])
    }
}

impl ProjectedSide {
    fn new(
        mut matrix: DMatrix<f64>,
        weights: &[f64],
        nuisances: &[Vec<f64>],
        mut own: Option<OwnPictures>,
        columns: Columns,
    ) -> Self {
        let q = orthonormal(nuisances, weights);
        let mut absorbed = DMatrix::zeros(q.len(), matrix.ncols());
        let mut scale = vec![1.0; matrix.ncols()];
        let whole: Vec<f64> = matrix.column_iter().map(|c| c.norm()).collect();
        for (n, mut column) in matrix.column_iter_mut().enumerate() {
            for (k, vector) in q.iter().enumerate() {
                absorbed[(k, n)] = vector.dot(&column);
                column.axpy(-absorbed[(k, n)], vector, 1.0);
            }
            let norm = column.norm();
            // What is all nuisance, but for rounding, cannot be seen.
            let seen = norm > 1e-9 * whole[n] && norm > 0.0;
            scale[n] = match columns {
                _ if !seen => 0.0,
                Columns::Radiance => 1.0,
                Columns::UnitNorm => norm.recip(),
            };
            column.scale_mut(scale[n]);
            absorbed.column_mut(n).scale_mut(scale[n]);
        }
        if let Some(own) = &mut own {
            own.scale(&scale);
        }
        let overlap = |vector: &DVector<f64>| {
            let vector: Vec<f32> = vector.iter().map(|&v| v as f32).collect();
            [0, 1, 2].map(|p| own.as_ref().map_or(0.0, |own| own.share(p, &vector)))
        };
        let overlap = q.iter().map(overlap).collect();
        let LowRank { basis, core } = LowRank::new(&matrix);
        let all = q.iter().flat_map(|v| v.iter()).chain(basis.iter());
        let counted = weights.iter().filter(|&&w| w > 0.0).count().max(1) as f64;
        let unweighted = |v: &DVector<f64>| {
            v.iter().zip(weights).filter(|&(_, &w)| w > 0.0).map(|(v, w)| v / w).sum::<f64>() / counted
        };
        Self {
            weights: weights.iter().map(|&w| w as f32).collect(),
            basis: all.map(|&v| v as f32).collect(),
            nuisances: q.len(),
            own,
            overlap,
            means: q.iter().map(unweighted).collect(),
            core,
            absorbed,
            scale,
        }
    }
}

/// diag(rows) A.
fn multiply_rows(matrix: &DMatrix<f64>, rows: &[f64]) -> DMatrix<f64> {
    let mut product = matrix.clone();
    for mut column in product.column_iter_mut() {
        column.iter_mut().zip(rows).for_each(|(value, factor)| *value *= factor);
    }
    product
}

/// An orthonormal basis of the weighted nuisances; those that the ones before them explain are left out.
fn orthonormal(nuisances: &[Vec<f64>], weights: &[f64]) -> Vec<DVector<f64>> {
    let mut basis: Vec<DVector<f64>> = Vec::new();
    for pattern in nuisances {
        let mut vector = DVector::from_iterator(weights.len(), pattern.iter().zip(weights).map(|(p, w)| p * w));
        let whole = vector.norm();
        // Twice: one pass leaves rounding errors of nearly parallel patterns.
        for known in basis.iter().chain(basis.iter()) {
            let share = known.dot(&vector);
            vector.axpy(-share, known, 1.0);
        }
        let norm = vector.norm();
        if norm > 1e-6 * whole {
            basis.push(vector / norm);
        }
    }
    basis
}

#[cfg(test)]
#[path = "projection_tests.rs"]
mod tests;
