//! Compares the optics and the inverse problem with published matrices, brute force and the formulas as written.

#[path = "../../../../tests/reference/mod.rs"]
mod reference;
#[path = "../solver_problems/mod.rs"]
mod solver_problems;
#[path = "../../src/testing.rs"]
mod testing;

mod closure;
mod reference_model;
mod solver_refit;
mod solver_solutions;
