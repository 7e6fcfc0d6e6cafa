use std::path::PathBuf;

use doorcam_source::import::{Outcome, doorway_camera_code};

/// Turn other programs' data files into recordings
#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    #[command(subcommand)]
    from: From,
}

#[derive(Debug, clap::Subcommand)]
enum From {
    /// The measurements published with the paper, as OUT/lab-0 .. lab-6 and OUT/syn-0 .. syn-4
    ///
    /// Each recording has the background as frame 0 and the new frame as frame 1. Scenes with missing files are listed
    /// and left out.
    DoorwayCameraCode {
        /// The repository's folder, with "Laboratory Data" and "Synthetic Data" in it
        src: PathBuf,
        /// Directory for the recordings
        out: PathBuf,
        /// Overwrite existing recordings
        #[arg(long)]
        force: bool,
    },
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let From::DoorwayCameraCode { src, out, force } = &arguments.from;
    let outcomes = doorway_camera_code(src, out, *force, |outcome| match outcome {
        Outcome::Written { name } => println!("{}", out.join(name).display()),
        Outcome::Missing { name, files } => {
            let names: Vec<_> = files.iter().map(|f| f.display().to_string()).collect();
            tracing::info!("{name}: left out, no {}", names.join(", "));
        }
    })?;
    let written = outcomes.iter().filter(|o| matches!(o, Outcome::Written { .. })).count();
    tracing::info!("{written} recordings written, {} left out", outcomes.len() - written);
    Ok(())
}
