//! The inverse problem of eq. 13, in Gram form.
//!
//! minimise over v (N x 3, unit rows), c_L, c_R (N each), b (2 x 3)
//!
//! λ Σ_n ‖(c_Ln, c_Rn)‖₂ + ½ Σ_p ‖ [1 0; 0 1] b^p + blkdiag(A_L, A_R) [diag c_L; diag c_R] v^p − y^p ‖²
//!
//! b is unpenalised: centring the columns of A_L and A_R eliminates it ([`Projection`]). The rest needs only the Gram
//! matrices AᵀA and, per frame, Aᵀy. For each facet, the exact minimiser over (c_n, v_n) with all others fixed is a
//! search over one angle ([`facet`]); [`Solver`] descends over facets.

mod active;
mod audit;
mod cholesky;
mod descent;
mod dual;
pub mod facet;
mod kind;
mod lambda;
mod low_rank;
mod newton;
mod nuisance;
mod own_picture;
mod planes;
mod projection;
mod refit;
#[cfg(test)]
mod scalar_tests;
mod solution;
mod stationarity;
mod tangent;

pub use audit::{Audit, audit};
pub use descent::{Solver, Workspace};
pub use facet::Admissible;
pub use kind::ModelKind;
pub use lambda::Lambda;
pub use nuisance::Nuisance;
pub use projection::{Columns, Correlations, Pixels, Projection, ProjectionError};
pub use solution::{Limits, Solution, Start};
