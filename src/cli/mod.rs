//! The command line: one file per subcommand.

mod bench;
mod check_config;
mod completions;
mod crb;
mod demo;
#[cfg(feature = "v4l2")]
mod devices;
mod evaluate;
mod import;
mod listening;
mod log;
mod man;
mod memory;
mod process;
mod reconstruct;
mod record;
mod reload;
mod serve;
mod service;
mod simulate;
mod skipping;
mod source_help;

use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Parser, Subcommand};
use doorcam::config::{Config, Preset, parse_lambda};
use doorcam::text::one_line;
use doorcam_core::solver::ModelKind;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// See who moves in the room behind a doorway, from the light that falls on the floor in front of it.
///
/// doorcam reconstructs a bird's-eye map of what changed in a hidden room from two small patches of floor beside the
/// doorway's edges ("The Doorway Camera", ICCP 2022).
#[derive(Debug, Parser)]
#[command(
    version,
    propagate_version = true,
    after_help = "\
Exit status: 0 success; 1 bad input or environment (one line on stderr says what is wrong); 2 wrong usage.
Logs go to stderr; RUST_LOG=debug shows more."
)]
struct Arguments {
    /// Format of the logs on stderr
    #[arg(long, global = true, value_name = "FORMAT", default_value = "text")]
    log: log::Format,
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Demo(demo::Arguments),
    Serve(serve::Arguments),
    Reconstruct(reconstruct::Arguments),
    Evaluate(evaluate::Arguments),
    Record(record::Arguments),
    Simulate(simulate::Arguments),
    Import(import::Arguments),
    #[cfg(feature = "v4l2")]
    Devices(devices::Arguments),
    Crb(crb::Arguments),
    Bench(bench::Arguments),
    CheckConfig(check_config::Arguments),
    Completions(completions::Arguments),
    Man(man::Arguments),
}

/// Options of every command that reconstructs.
#[derive(Debug, clap::Args)]
struct ModelOptions {
    /// Configuration file; config/doorcam.toml shows every key
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Weight of the sparsity penalty in eq. 13: a larger value shows less; "auto" derives it from the measured noise
    /// [default: auto]
    // A string, so that a bad number is an input error (status 1), as in the configuration file.
    #[arg(long, value_name = "X", allow_hyphen_values = true)]
    lambda: Option<String>,
    /// Which changes a facet may show [default: signed]
    #[arg(long, value_name = "MODEL")]
    model: Option<ModelChoice>,
    /// "published": the authors' model, grid, kernel, 0.15 m patches and preprocessing
    #[arg(long, value_name = "NAME")]
    preset: Option<Preset>,
}

/// [`ModelKind`] on the command line.
#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum ModelChoice {
    /// Eq. 13 as written: c_L, c_R >= 0 and v any unit vector, so that a facet may become brighter or darker in each
    /// colour. People mostly make it darker, as they block the light of the wall behind them.
    Signed,
    /// As in the authors' program: v >= 0, and only background facets may become darker.
    Published,
}

impl From<ModelChoice> for ModelKind {
    fn from(choice: ModelChoice) -> Self {
        match choice {
            ModelChoice::Signed => ModelKind::Signed,
            ModelChoice::Published => ModelKind::Published,
        }
    }
}

impl ModelOptions {
    fn config(&self) -> anyhow::Result<Config> {
        let file = self.config.as_deref().map(Config::load).transpose()?;
        let mut config = file.unwrap_or_default().with_preset(self.preset);
        if let Some(model) = self.model {
            config.solver.model = model.into();
        }
        if let Some(text) = &self.lambda {
            config.solver.lambda = parse_lambda("--lambda", text)?;
        }
        Ok(config)
    }
}

/// Parses the command line and runs the command. An error becomes one line on stderr and the exit status.
pub(crate) fn run() -> ExitCode {
    let arguments = Arguments::parse();
    log::start(arguments.log);
    let result = match arguments.command {
        Command::Demo(arguments) => {
            memory::hand_back();
            process::keep_private();
            process::need_files().and_then(|()| demo::run(&arguments))
        }
        Command::Serve(arguments) => {
            memory::hand_back();
            process::keep_private();
            process::need_files().and_then(|()| serve::run(&arguments))
        }
        Command::Reconstruct(arguments) => reconstruct::run(&arguments),
        Command::Evaluate(arguments) => evaluate::run(&arguments),
        Command::Record(arguments) => {
            process::keep_private();
            process::need_files().and_then(|()| record::run(&arguments))
        }
        Command::Simulate(arguments) => simulate::run(&arguments),
        Command::Import(arguments) => import::run(&arguments),
        #[cfg(feature = "v4l2")]
        Command::Devices(arguments) => devices::run(&arguments),
        Command::Crb(arguments) => crb::run(&arguments),
        Command::Bench(arguments) => bench::run(&arguments),
        Command::CheckConfig(arguments) => check_config::run(&arguments),
        Command::Completions(arguments) => completions::run(&arguments),
        Command::Man(arguments) => man::run(&arguments),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) if is_broken_pipe(&error) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("doorcam: {}", one_line(&format!("{error:#}")));
            ExitCode::from(1)
        }
    }
}

/// Whether the reader of our output closed the pipe, as `| head` does. That is not an error.
fn is_broken_pipe(error: &anyhow::Error) -> bool {
    let broken = |e: &std::io::Error| e.kind() == std::io::ErrorKind::BrokenPipe;
    error.chain().any(|cause| cause.downcast_ref().is_some_and(broken))
}

/// A progress bar on a terminal; nothing elsewhere.
fn progress(frames: u64) -> ProgressBar {
    let target =
        if std::io::stderr().is_terminal() { ProgressDrawTarget::stderr() } else { ProgressDrawTarget::hidden() };
    let style = ProgressStyle::with_template("{bar:32} {pos}/{len} frames  {per_sec}  {eta} left");
    let bar = ProgressBar::with_draw_target(Some(frames), target);
    style.map(|style| bar.clone().with_style(style)).unwrap_or(bar)
}

/// The path of a recording's manifest, with which errors about its model begin.
fn manifest_of(recording: &Path) -> String {
    recording.join("recording.json").display().to_string()
}
