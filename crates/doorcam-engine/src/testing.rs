//! What tests of several modules need.

/// The settings of a property test that usually takes `usual` cases; PROPTEST_CASES, 256 for as many as usual, scales
/// them.
pub(crate) fn cases(usual: u32) -> proptest::test_runner::Config {
    let all = proptest::test_runner::Config::default();
    proptest::test_runner::Config { cases: (usual * all.cases / 256).max(1), ..all }
}
