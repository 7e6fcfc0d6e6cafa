use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::sync::Arc;

use anyhow::{Context, bail};
use doorcam::config::Config;
use doorcam::pipeline::{Hub, SourceInfo, start};
use doorcam::server::Server;
use doorcam::source::{Pace, Replay, ReplayOptions, SystemClock};
use tokio::signal::unix::{SignalKind, signal};

use super::{ModelOptions, engine, open_recording};

/// Watch a doorway and show the hidden room live, on a page and over REST and WebSocket
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Sources:
  replay:DIR[,loop][,rate=max]   a recording: at its own pace or as fast as it goes, once or for ever

Example:
  doorcam serve --source replay:recordings/lab-0,loop --preset published
  and open http://127.0.0.1:8080")]
pub(super) struct Arguments {
    /// Where frames come from
    #[arg(long, value_name = "SOURCE")]
    source: SourceSpec,
    /// Address and port to listen on; port 0 takes a free one [default: 127.0.0.1:8080]
    #[arg(long, value_name = "ADDR:PORT")]
    listen: Option<SocketAddr>,
    #[command(flatten)]
    model: ModelOptions,
}

/// `replay:DIR[,loop][,rate=max]`
#[derive(Debug, Clone, PartialEq)]
pub(super) struct SourceSpec {
    text: String,
    directory: PathBuf,
    options: ReplayOptions,
}

impl FromStr for SourceSpec {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let Some(rest) = text.strip_prefix("replay:") else {
            return Err("expected replay:DIR[,loop][,rate=max]; cameras and the simulator are not built yet".into());
        };
        let mut options = ReplayOptions { pace: Pace::Recorded, looped: false };
        let mut directory = rest;
        // Options are taken from the end, so that a directory's name may have commas.
        while let Some((before, option)) = directory.rsplit_once(',') {
            match option {
                "loop" => options.looped = true,
                "rate=max" => options.pace = Pace::Max,
                _ => break,
            }
            directory = before;
        }
        if directory.is_empty() {
            return Err("expected a directory after replay:".into());
        }
        Ok(Self { text: text.into(), directory: directory.into(), options })
    }
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let config = arguments.model.config()?;
    let SourceSpec { text, directory, options } = &arguments.source;
    serve(&config, directory, *options, text, arguments.listen)
}

/// Replays a recording to whoever connects, until interrupted.
pub(super) fn serve(
    config: &Config,
    directory: &Path,
    options: ReplayOptions,
    spec: &str,
    listen: Option<SocketAddr>,
) -> anyhow::Result<()> {
    let recording = Arc::new(open_recording(directory)?);
    if recording.manifest.background_frames.is_none() {
        let manifest = directory.join("recording.json");
        bail!("{}: background_frames is missing, expected [first, end) of the empty room", manifest.display());
    }
    let (engine, model) = engine(config, &recording, true)?;
    let info = SourceInfo {
        spec: spec.into(),
        kind: "replay",
        notes: recording.manifest.notes.clone(),
        fps: recording.manifest.fps,
    };
    let hub = Arc::new(Hub::new(model, info));
    let runtime = tokio::runtime::Runtime::new().context("cannot start the server's threads")?;
    runtime.block_on(async {
        let server = Server::bind(listen.unwrap_or(config.server.listen)).await?;
        let mut interrupt = signal(SignalKind::interrupt())?;
        let mut terminate = signal(SignalKind::terminate())?;
        // The port first, then the frames: nobody should miss the beginning of a recording.
        let source = Box::new(Replay::new(recording, options, SystemClock::default()));
        start(source, engine, Arc::clone(&hub)).context("cannot start the frame loop")?;
        tracing::info!("watching {spec}: the page is at http://{}", server.address());
        server
            .serve(hub, async move {
                tokio::select! { _ = interrupt.recv() => {}, _ = terminate.recv() => {} }
                tracing::info!("stopping");
            })
            .await?;
        anyhow::Ok(())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sources_are_read() {
        let read = |text: &str| text.parse::<SourceSpec>().map(|s| (s.directory, s.options));
        let options = |pace, looped| ReplayOptions { pace, looped };
        assert_eq!(read("replay:a/b"), Ok(("a/b".into(), options(Pace::Recorded, false))));
        assert_eq!(read("replay:a,loop,rate=max"), Ok(("a".into(), options(Pace::Max, true))));
        assert_eq!(read("replay:a,b,loop"), Ok(("a,b".into(), options(Pace::Recorded, true))));
        assert!(read("v4l2:/dev/video0").unwrap_err().contains("not built yet"));
        assert!(read("replay:").unwrap_err().contains("expected a directory"));
    }
}
