use std::net::SocketAddr;
use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, bail};
use doorcam::config::Config;
use doorcam::pipeline::{Engine, Hub, SourceInfo, start};
use doorcam::server::Server;
use doorcam::source::{Replay, ReplayOptions, Source, SystemClock};
use tokio::signal::unix::{SignalKind, signal};

use super::source::{self, SourceKind, SourceSpec};
use super::{ModelOptions, engine, open_recording};

/// Watch a doorway and show the hidden room live, on a page and over REST and WebSocket
#[derive(Debug, clap::Args)]
#[command(after_help = format!("{}

Examples:
  doorcam serve --source v4l2:/dev/video0
  doorcam serve --source replay:recordings/lab-0,loop --preset published
  and open http://127.0.0.1:8080", source::HELP))]
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

/// A source and what to do with its frames.
struct Watch {
    source: Box<dyn Source>,
    engine: Option<Engine>,
    info: SourceInfo,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let config = arguments.model.config()?;
    let SourceSpec { text, kind } = &arguments.source;
    let watch = match kind {
        SourceKind::Replay(directory, options) => replay(&config, directory, *options, text)?,
        SourceKind::Camera(name) => camera(&config, name, text)?,
    };
    serve(&config, watch, arguments.listen)
}

/// Replays a recording to whoever connects, until interrupted.
pub(super) fn serve_recording(
    config: &Config,
    directory: &Path,
    options: ReplayOptions,
    spec: &str,
    listen: Option<SocketAddr>,
) -> anyhow::Result<()> {
    serve(config, replay(config, directory, options, spec)?, listen)
}

fn replay(config: &Config, directory: &Path, options: ReplayOptions, spec: &str) -> anyhow::Result<Watch> {
    let recording = Arc::new(open_recording(directory)?);
    if recording.manifest.background_frames.is_none() {
        let manifest = directory.join("recording.json");
        bail!("{}: background_frames is missing, expected [first, end) of the empty room", manifest.display());
    }
    let (engine, _) = engine(config, &recording, true)?;
    let info = SourceInfo {
        spec: spec.into(),
        kind: "replay",
        notes: recording.manifest.notes.clone(),
        fps: recording.manifest.fps,
    };
    let source = Box::new(Replay::new(recording, options, SystemClock::default()));
    Ok(Watch { source, engine: Some(engine), info })
}

#[cfg(feature = "v4l2")]
fn camera(config: &Config, name: &str, spec: &str) -> anyhow::Result<Watch> {
    use doorcam::source::camera::Supervisor;
    use doorcam::source::v4l2::V4l2Camera;

    let camera = V4l2Camera::new(name, config.camera.options());
    let source = Box::new(Supervisor::new(camera, SystemClock::default(), u64::from(std::process::id())));
    let info = SourceInfo { spec: spec.into(), kind: "v4l2", notes: String::new(), fps: config.camera.fps };
    Ok(Watch { source, engine: None, info })
}

#[cfg(not(feature = "v4l2"))]
fn camera(_: &Config, _: &str, spec: &str) -> anyhow::Result<Watch> {
    bail!("{spec}: this doorcam was built without cameras (feature v4l2)")
}

/// Shows what is watched to whoever connects, until interrupted.
fn serve(config: &Config, watch: Watch, listen: Option<SocketAddr>) -> anyhow::Result<()> {
    let Watch { source, engine, info } = watch;
    let spec = info.spec.clone();
    let hub = Arc::new(Hub::new(engine.as_ref().map(Engine::watched), config.preset, info));
    let runtime = tokio::runtime::Runtime::new().context("cannot start the server's threads")?;
    runtime.block_on(async {
        let server = Server::bind(listen.unwrap_or(config.server.listen)).await?;
        let mut interrupt = signal(SignalKind::interrupt())?;
        let mut terminate = signal(SignalKind::terminate())?;
        // The port first, then the frames: nobody should miss the beginning of a recording.
        let control = start(source, engine, Arc::clone(&hub)).context("cannot start the frame loop")?;
        tracing::info!("watching {spec}: the page is at http://{}", server.address());
        server
            .serve(hub, control, async move {
                tokio::select! { _ = interrupt.recv() => {}, _ = terminate.recv() => {} }
                tracing::info!("stopping");
            })
            .await?;
        anyhow::Ok(())
    })
}
