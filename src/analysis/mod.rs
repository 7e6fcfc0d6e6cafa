//! How good and how fast the rest of the program is.

mod bench;
pub mod bound;
pub mod evaluation;
mod published_iteration;

pub use bench::{BENCH_FRAMES, BenchError, BenchReport, Median, Quantiles, bench};
pub use published_iteration::PublishedIteration;
