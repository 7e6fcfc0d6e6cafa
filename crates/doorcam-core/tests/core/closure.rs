//! The core stays free of what makes a daemon.

use std::process::Command;

/// Packages of a runtime, a server, a command line, a database or a broker.
const FOREIGN: [&str; 10] = [
    "axum",
    "clap",
    "hyper",
    "image",
    "reqwest",
    "rumqttc-v4-next",
    "rusqlite",
    "tokio",
    "tracing-subscriber",
    "utoipa",
];

#[test]
fn the_core_depends_on_numerics_alone() {
    let output = Command::new(env!("CARGO"))
        .args(["tree", "--offline", "--package", "doorcam-core", "--edges", "normal,build", "--prefix", "none"])
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .expect("cargo runs");
    let said = String::from_utf8(output.stdout).expect("UTF-8");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let mut packages: Vec<&str> = said.lines().filter_map(|line| line.split(' ').next()).collect();
    packages.sort_unstable();
    packages.dedup();
    assert!(packages.contains(&"nalgebra") && packages.contains(&"doorcam-core"), "{packages:?}");
    assert!(packages.len() <= 120, "{} packages: {packages:?}", packages.len());
    let foreign: Vec<_> = FOREIGN.iter().filter(|name| packages.contains(name)).collect();
    assert!(foreign.is_empty(), "{foreign:?}");
}
