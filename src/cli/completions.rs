use std::io::Write;

use clap::CommandFactory;
use clap_complete::Shell;

/// Print a shell completion script for doorcam
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  doorcam completions bash > /etc/bash_completion.d/doorcam
  doorcam completions zsh > ~/.zfunc/_doorcam
  doorcam completions fish > ~/.config/fish/completions/doorcam.fish")]
pub(super) struct Arguments {
    /// The shell
    shell: Shell,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    // In memory first: the generator panics if its writer fails, as a closed pipe does.
    let mut script = Vec::new();
    clap_complete::generate(arguments.shell, &mut super::Arguments::command(), "doorcam", &mut script);
    std::io::stdout().write_all(&script)?;
    Ok(())
}
