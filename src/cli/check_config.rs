use std::path::PathBuf;

use doorcam::config::Config;

/// Check a configuration file without starting anything
#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// The configuration file
    file: PathBuf,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    Config::load(&arguments.file)?;
    println!("{}: fine", arguments.file.display());
    Ok(())
}
