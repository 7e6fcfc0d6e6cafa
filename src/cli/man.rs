use std::io::Write;
use std::path::PathBuf;

use anyhow::Context;
use clap::CommandFactory;

/// Print doorcam's manual page, or write those of all commands
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  doorcam man | man -l -
  doorcam man --output /usr/local/share/man/man1")]
pub(super) struct Arguments {
    /// Write doorcam.1 and a page for each command into this directory
    #[arg(long, value_name = "DIR")]
    output: Option<PathBuf>,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let command = super::Arguments::command();
    let Some(directory) = &arguments.output else {
        let mut page = Vec::new();
        clap_mangen::Man::new(command).render(&mut page)?;
        std::io::stdout().write_all(&page)?;
        return Ok(());
    };
    let named = || directory.display().to_string();
    std::fs::create_dir_all(directory).with_context(named)?;
    clap_mangen::generate_to(command, directory).with_context(named)
}
