//! Optics and inverse problem against published matrices, brute force and literal formulas.

#[path = "../../../../tests/reference/mod.rs"]
mod reference;
#[path = "../solver_problems/mod.rs"]
mod solver_problems;

mod reference_model;
mod solver_refit;
mod solver_solutions;
