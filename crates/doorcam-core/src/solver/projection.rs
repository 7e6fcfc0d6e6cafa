use nalgebra::{DMatrix, DVector};

use super::active::pair;
use super::facet::Admissible;
use super::low_rank::LowRank;
use super::nuisance::Nuisance;
use super::own_picture::OwnPictures;
use super::planes::{dot3, weigh_plane};
use crate::geometry::Side;
use crate::light::{PatchPair, Usable};
use crate::transport::Transport;

/// Patterns that differ by less than this, in 1 − cos², are the same up to rounding.
const ALIKE: f64 = 1e-9;

/// Rounds in which unusable pixels are filled.
const FILLING: usize = 8;
/// How far beyond what is expected each round goes, which needs fewer rounds; it has to stay below 2.
const BEYOND: f64 = 1.8;
/// Most vectors of a side's basis that filling uses; the first ones say most.
const MOST_VECTORS: usize = 160;

/// How the columns of A enter the problem.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Columns {
    /// As in the transport: far facets, which light the floor less, pay more for the same light.
    Radiance,
    /// Each column of A_L and A_R is scaled to unit norm: a facet pays for the change on the floor, near or far.
    /// Intensities are then norms of that change, not radiances.
    UnitNorm,
}

/// What is known of the patches' pixels, per side, row by row from the wall.
#[derive(Debug, Clone, PartialEq)]
pub struct Pixels {
    /// Weights W: one over the noise. Pixels with weight 0 do not count.
    pub weights: [Vec<f64>; 2],
    /// The floor's reflectance relative to its surroundings, a factor on the light from the hidden room.
    pub albedo: [Vec<f64>; 2],
}

impl Pixels {
    /// Equal pixels, except for those that do not count.
    pub fn uniform(counted: &[Vec<bool>; 2]) -> Self {
        Self {
            weights: [0, 1].map(|s| counted[s].iter().map(|&c| f64::from(u8::from(c))).collect()),
            albedo: [0, 1].map(|s| vec![1.0; counted[s].len()]),
        }
    }
}

/// Maps difference measurements to the Gram system: Aᵀy with the nuisances eliminated.
///
/// Nuisances are patterns that the visible side's light and the camera's gain add to a patch at any strength,
/// unpenalised; in eq. 12, the constant b^p. With Q an orthonormal basis of them and W the pixels' weights, eliminating
/// their least-squares strengths replaces A by (I − QQᵀ) W A and y by (I − QQᵀ) W y; the rows of A are multiplied by
/// the floor's albedo. A is nearly of low rank, so it is kept as U C with orthonormal U (M x r). A frame then costs
/// r + q products, [Q U]ᵀ W y, instead of N.
///
/// If the nuisances include the colours' own pictures x0, y^p is replaced by y^p − δ x0^p throughout, with δ the
/// weighted least-squares share of the picture. The own pictures are not projected out of A: Q already spans them up to
/// their noise, and A would become different for each colour.
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
    /// Number of vectors of Q.
    nuisances: usize,
    /// The colours' own pictures, which are removed before Q.
    own: Option<OwnPictures>,
    /// Per vector of Q and channel, its product with the own picture (scaled to unit norm).
    overlap: Vec<[f64; 3]>,
    /// C, r x N: (I − QQᵀ) W A = U C, with scaled columns.
    core: DMatrix<f64>,
    /// QᵀWA with scaled columns: how much of each facet's light looks like a nuisance.
    absorbed: DMatrix<f64>,
    /// Mean over the patch of each nuisance vector, with the weights divided out.
    means: Vec<f64>,
    /// Radiance of a facet of intensity 1.
    scale: Vec<f64>,
}

/// What the solver needs from one frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Correlations {
    /// Per side and channel, A_sᵀ y^p: N values.
    pub rhs: [[Vec<f64>; 3]; 2],
    /// Σ_p ‖y^p‖² over both patches without the nuisances: twice the objective of the empty map.
    pub energy: f64,
    /// The part of `energy` that no light from the hidden room could cause, by eq. 2: what is outside the span of A.
    /// Left, then right.
    pub foreign: [f64; 2],
    /// Per side and channel, Qᵀ W y^p after the own picture is removed.
    nuisance: [[Vec<f64>; 3]; 2],
    /// Per side and channel, the share of the own picture (scaled to unit norm); 0 if there are no own pictures.
    own: [[f64; 3]; 2],
    /// W y of one patch.
    weighted: [Vec<f32>; 3],
    /// UᵀWy of one patch.
    coordinates: [DVector<f64>; 3],
}

impl Correlations {
    /// Correlations of a problem without pixels, such as a test's.
    pub fn new(rhs: [[Vec<f64>; 3]; 2], energy: f64) -> Self {
        let coordinates = std::array::from_fn(|_| DVector::zeros(0));
        let (nuisance, own, weighted) = Default::default();
        Self { rhs, energy, foreign: [0.0; 2], nuisance, own, weighted, coordinates }
    }

    /// The smallest λ with an empty map if all facets are [`Admissible::Signed`]: their largest dual norm.
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
        /// Pixels along a side of the given patches.
        got: usize,
        /// Pixels along a side that the model was built for.
        expected: usize,
    },
}

impl Projection {
    /// Weights the columns of `transport`, projects the nuisances out, and scales and factors the result.
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

    /// Per side, the number of products that a frame costs: r + q.
    pub fn rank(&self) -> [usize; 2] {
        [0, 1].map(|s| self.sides[s].nuisances + self.sides[s].core.nrows())
    }

    /// AᵀA of the left and the right side, N x N each. Computed on each call; the solver keeps the result.
    pub fn gram(&self) -> [DMatrix<f64>; 2] {
        let gram = |s: usize| self.sides[s].core.transpose() * &self.sides[s].core;
        rayon::join(|| gram(0), || gram(1)).into()
    }

    /// Per side and facet, the radiance of a facet of intensity 1; 0 for a facet that lights no pixel.
    pub fn radiance(&self) -> [&[f64]; 2] {
        [0, 1].map(|s| self.sides[s].scale.as_slice())
    }

    /// A workspace for the result of [`Projection::project`].
    pub fn correlations(&self) -> Correlations {
        let zeros = |n: usize| std::array::from_fn(|_| vec![0.0; n]);
        Correlations {
            rhs: [zeros(self.facets), zeros(self.facets)],
            energy: 0.0,
            foreign: [0.0; 2],
            nuisance: [0, 1].map(|s| zeros(self.sides[s].nuisances)),
            own: [[0.0; 3]; 2],
            weighted: std::array::from_fn(|_| vec![0.0; self.sides[0].weights.len()]),
            coordinates: std::array::from_fn(|_| {
                DVector::zeros(self.sides.iter().map(|side| side.core.nrows()).max().unwrap_or(0))
            }),
        }
    }

    /// Writes the `rhs` of white noise of unit variance in W y into `out`; `normal` draws standard normal numbers.
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
    ///
    /// # Errors
    ///
    /// If the patches have another size than the model's, or a pixel that counts is not finite.
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
            let within: f64 = out.coordinates.iter().map(|c| c.rows(0, rank).norm_squared()).sum();
            out.foreign[s] = (energy - within).max(0.0);
            for (rhs, coordinates) in out.rhs[s].iter_mut().zip(&out.coordinates) {
                for (rhs, column) in rhs.iter_mut().zip(projected.core.column_iter()) {
                    *rhs = column.dot(&coordinates.rows(0, rank));
                }
            }
        }
        Ok(())
    }

    /// Replaces the pixels of a difference that are not `usable` by what the others lead one to expect: the light of the
    /// hidden room and the nuisances that fit those best (expectation maximisation from zero, which stops early and so
    /// expects little where little is known). Sides without an unusable pixel stay as they are. Allocates nothing.
    pub fn fill(&self, difference: &mut PatchPair, usable: &Usable, out: &mut Correlations) {
        for (projected, side) in self.sides.iter().zip(Side::BOTH) {
            let usable = usable.side(side);
            let missing = || (0..usable.len()).filter(|&k| !usable[k] && projected.weights[k] > 0.0);
            if missing().next().is_none() {
                continue;
            }
            let patch = difference.side_mut(side);
            let pixels = patch.pixels();
            for channel in 0..3 {
                let plane = patch.plane_mut(channel);
                missing().for_each(|k| plane[k] = 0.0);
                // A value that is not finite is reported by the projection.
                let _ = weigh_plane(plane, &projected.weights, &mut out.weighted[channel]);
            }
            let mut products = [[0.0; 3]; MOST_VECTORS];
            for (product, vector) in products.iter_mut().zip(projected.basis.chunks_exact(pixels)) {
                *product = dot3(vector, &out.weighted);
            }
            for _ in 0..FILLING {
                let mut changes = [[0.0; 3]; MOST_VECTORS];
                for k in missing() {
                    let mut expected = [0.0; 3];
                    for (product, vector) in products.iter().zip(projected.basis.chunks_exact(pixels)) {
                        (0..3).for_each(|c| expected[c] += product[c] * f64::from(vector[k]));
                    }
                    let step = [0, 1, 2].map(|c| BEYOND * (expected[c] - f64::from(out.weighted[c][k])));
                    for (change, vector) in changes.iter_mut().zip(projected.basis.chunks_exact(pixels)) {
                        (0..3).for_each(|c| change[c] += step[c] * f64::from(vector[k]));
                    }
                    (0..3).for_each(|c| out.weighted[c][k] += step[c] as f32);
                }
                for (product, change) in products.iter_mut().zip(&changes) {
                    (0..3).for_each(|c| product[c] += change[c]);
                }
            }
            for channel in 0..3 {
                let plane = patch.plane_mut(channel);
                missing().for_each(|k| plane[k] = out.weighted[channel][k] / projected.weights[k]);
            }
        }
    }

    /// The mean over each patch of what the nuisances explain after the facets' light is subtracted, per side and
    /// channel, in linear light. With the constant as the only nuisance this is b of eq. 12. `intensities(s, n)` is
    /// X_sn = c_sn v_n.
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

    /// Per side and channel, how strongly the first pattern may have changed in the frame, apart from a gain and from
    /// changes in the hidden room. This is the smaller of two values: the pattern's strength (weighted, scaled to unit
    /// norm) in a least-squares fit together with the own picture, to which a gain adds nothing; and the own picture's
    /// share of the frame, to which the hidden room adds little. 0 if the pattern and the own picture are the same,
    /// since the own picture then takes both.
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

    /// Per side and channel, the factor by which the own picture is multiplied after the facets' light is subtracted:
    /// 1 + Σ w² x0 (y − A x) / Σ w² x0². None if there are no own pictures. `intensities(s, n)` is X_sn = c_sn v_n.
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
            // A column that is a nuisance up to rounding cannot be seen.
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

/// An orthonormal basis of the weighted nuisances, without those that earlier ones explain.
fn orthonormal(nuisances: &[Vec<f64>], weights: &[f64]) -> Vec<DVector<f64>> {
    let mut basis: Vec<DVector<f64>> = Vec::new();
    for pattern in nuisances {
        let mut vector = DVector::from_iterator(weights.len(), pattern.iter().zip(weights).map(|(p, w)| p * w));
        let whole = vector.norm();
        // Twice, since one pass leaves rounding errors for nearly parallel patterns.
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
