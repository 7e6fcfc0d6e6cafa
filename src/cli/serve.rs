use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context, bail};
use doorcam::config::Config;
use doorcam::history::{History, Numbers};
use doorcam::measurement::Calibration;
use doorcam::pipeline::{
    CalibrationStore, Calibrator, Engine, Hub, Keeping, Recordings, Setup, SourceInfo, ZoneKeeper, ZoneOrigin, start,
};
use doorcam::publish::Publishers;
use doorcam::server::{Access, Backend, Server, Tls};
use doorcam::source::recording::Manifest;
use doorcam::source::{Replay, ReplayOptions, Source, SystemClock};
use metrics_exporter_prometheus::{PrometheusBuilder, PrometheusHandle};
use tokio::signal::unix::{SignalKind, signal};

use super::listening::ListenOptions;
use super::reload::Reloader;
use super::source::{self, Simulated, SourceKind, SourceSpec};
use super::{ModelOptions, engine, engine_of, open_recording, service, simulate};

/// Watch a doorway and show the hidden room live, on a page and over REST and WebSocket
#[derive(Debug, clap::Args)]
#[command(after_help = format!("{}

Examples:
  doorcam serve --source v4l2:/dev/video0
  doorcam serve --source replay:recordings/lab-0,loop --preset published
  doorcam serve --source simulate:two-crossing
  and open http://127.0.0.1:8080", source::HELP))]
pub(super) struct Arguments {
    /// Where frames come from
    #[arg(long, value_name = "SOURCE")]
    source: SourceSpec,
    #[command(flatten)]
    listening: ListenOptions,
    /// The camera's calibration, made on the page and kept there [default: calibration.json in the storage directory]
    #[arg(long, value_name = "FILE")]
    calibration: Option<PathBuf>,
    /// Directory of what is kept between runs: one a doorway [default: storage.directory of the configuration]
    #[arg(long, value_name = "DIR")]
    storage: Option<PathBuf>,
    /// Keep events and occupancy in memory only
    #[arg(long)]
    no_history: bool,
    #[command(flatten)]
    model: ModelOptions,
}

/// A source and what to do with its frames.
struct Watch {
    source: Box<dyn Source>,
    engine: Option<Engine>,
    setup: Setup,
    calibration: Option<Calibration>,
    keeping: Keeping,
    /// What a source that is no camera says of itself.
    manifest: Option<Manifest>,
    info: SourceInfo,
}

impl Arguments {
    /// The configuration as file and command line have it now.
    fn config(&self) -> anyhow::Result<Config> {
        let mut config = self.model.config()?;
        self.listening.apply(&mut config);
        if let Some(directory) = &self.storage {
            config.storage.directory.clone_from(directory);
        }
        config.history.enabled &= !self.no_history;
        Ok(config)
    }
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let config = arguments.config()?;
    let access = access(&config)?;
    let file = arguments.calibration.as_deref();
    let SourceSpec { text, kind } = &arguments.source;
    let watch = match kind {
        SourceKind::Replay(directory, options) => replay(&config, directory, *options, text, file)?,
        SourceKind::Camera(name) => camera(&config, name, text, file)?,
        SourceKind::Simulate(simulated) => simulation(&config, simulated, text, file)?,
    };
    serve(&config, || arguments.config(), watch, access)
}

/// Replays a recording to whoever connects, until interrupted.
pub(super) fn serve_recording(
    config: &Config,
    directory: &Path,
    options: ReplayOptions,
    spec: &str,
    access: (Access, Option<Tls>),
) -> anyhow::Result<()> {
    serve(config, || Ok(config.clone()), replay(config, directory, options, spec, None)?, access)
}

/// Shows a simulated doorway to whoever connects, until interrupted.
pub(super) fn serve_simulation(
    config: &Config,
    simulated: &Simulated,
    spec: &str,
    access: (Access, Option<Tls>),
) -> anyhow::Result<()> {
    serve(config, || Ok(config.clone()), simulation(config, simulated, spec, None)?, access)
}

fn simulation(config: &Config, simulated: &Simulated, spec: &str, file: Option<&Path>) -> anyhow::Result<Watch> {
    if let Some(file) = file {
        bail!("{}: a simulated camera brings its own calibration", file.display());
    }
    let simulator = simulate::simulator(&simulated.scenario, simulated.seed)?;
    let manifest = simulator.manifest().clone();
    let calibration = Calibration::of_recording(&manifest);
    let (engine, _) = engine(config, &manifest, || simulated.scenario.clone(), true)?;
    let info = SourceInfo { spec: spec.into(), kind: "simulate", notes: manifest.notes.clone(), fps: manifest.fps };
    Ok(Watch {
        source: Box::new(simulate::live(simulator, simulated.pace, simulated.once)),
        engine: Some(engine.rolling(&config.background, None)),
        setup: Setup::new(config.clone()),
        calibration,
        keeping: Keeping::Fixed("a simulated camera brings its own calibration".into()),
        manifest: Some(manifest),
        info,
    })
}

fn replay(
    config: &Config,
    directory: &Path,
    options: ReplayOptions,
    spec: &str,
    file: Option<&Path>,
) -> anyhow::Result<Watch> {
    let mut recording = open_recording(directory)?;
    if recording.manifest.background_frames.is_none() {
        let manifest = directory.join("recording.json");
        bail!("{}: background_frames is missing, expected [first, end) of the empty room", manifest.display());
    }
    let own = Calibration::of_recording(&recording.manifest);
    let keeping = match (file, &own) {
        (Some(file), Some(_)) => Keeping::File(CalibrationStore::new(file.into())),
        (Some(file), None) => bail!("{}: a recording of rectified patches needs no calibration", file.display()),
        (None, Some(_)) => Keeping::Fixed(
            "a recording brings its own calibration; start doorcam with --calibration FILE to make another".into(),
        ),
        (None, None) => Keeping::Fixed("a recording of rectified patches needs no calibration".into()),
    };
    let kept = match &keeping {
        Keeping::File(store) => store.load()?,
        Keeping::Fixed(_) => None,
    };
    if let Some(kept) = &kept {
        kept.apply_to(&mut recording.manifest);
    }
    let recording = Arc::new(recording);
    let (engine, _) = engine_of(config, &recording, true)?;
    let engine = engine.rolling(&config.background, None);
    let info = SourceInfo {
        spec: spec.into(),
        kind: "replay",
        notes: recording.manifest.notes.clone(),
        fps: recording.manifest.fps,
    };
    let manifest = Some(recording.manifest.clone());
    let source = Box::new(Replay::new(recording, options, SystemClock::default()));
    let setup = Setup::new(config.clone());
    Ok(Watch { source, engine: Some(engine), setup, calibration: kept.or(own), keeping, manifest, info })
}

#[cfg(feature = "v4l2")]
fn camera(config: &Config, name: &str, spec: &str, file: Option<&Path>) -> anyhow::Result<Watch> {
    use doorcam::source::camera::{Locked, Supervisor};
    use doorcam::source::v4l2::V4l2Camera;

    let usual = || config.storage.directory().map(|directory| directory.join("calibration.json"));
    let Some(file) = file.map(Path::to_owned).or_else(usual) else {
        bail!("there is no place for the camera's calibration, expected --calibration FILE, --storage DIR or $HOME");
    };
    let store = CalibrationStore::new(file);
    let calibration = store.load()?;
    let named = || store.file().display().to_string();
    let directory = config.storage.directory();
    let locked = Arc::new(Locked::new(directory.as_ref().map(|directory| directory.join("controls.json"))));
    let mut setup = Setup::new(config.clone());
    if let Some(directory) = directory {
        let (locked, options) = (Arc::clone(&locked), config.camera.options());
        setup = setup
            .keeping(directory.join("background.bin"), move || format!("{:?}; {}", options.controls, locked.words()));
    }
    let engine = calibration.as_ref().map(|c| setup.engine(c)).transpose().with_context(named)?;
    let mut options = config.camera.options();
    match &calibration {
        // It is for pictures of one size.
        Some(calibration) => options.wish.size = calibration.size.map(|side| u32::try_from(side).unwrap_or(u32::MAX)),
        None => tracing::info!("the camera is not calibrated yet: open the page to do so"),
    }
    let camera = V4l2Camera::new(name, options, locked);
    let source = Box::new(Supervisor::new(camera, SystemClock::default(), u64::from(std::process::id())));
    let info = SourceInfo { spec: spec.into(), kind: "v4l2", notes: String::new(), fps: config.camera.fps };
    Ok(Watch { source, engine, setup, calibration, keeping: Keeping::File(store), manifest: None, info })
}

#[cfg(not(feature = "v4l2"))]
fn camera(_: &Config, _: &str, spec: &str, _: Option<&Path>) -> anyhow::Result<Watch> {
    bail!("{spec}: this doorcam was built without cameras (feature v4l2)")
}

/// What `/metrics` shows is recorded from here on.
fn recorder() -> Option<PrometheusHandle> {
    const SECONDS: [f64; 12] = [1e-4, 2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2, 2e-2, 5e-2, 0.1, 0.5, 2.0];
    let builder = PrometheusBuilder::new().set_buckets(&SECONDS).ok()?;
    builder.install_recorder().ok()
}

/// Who may see and change what: told before anything else is done, for a start that is refused should leave nothing behind.
pub(super) fn access(config: &Config) -> anyhow::Result<(Access, Option<Tls>)> {
    let tls = Tls::load(&config.tls)?;
    let access = Access::new(&config.access, config.server.listen, |name| std::env::var_os(name))?;
    if access.is_exposed() {
        tracing::warn!("{} needs no token: everybody who reaches it sees and changes everything", config.server.listen);
    }
    Ok((access, tls))
}

/// Shows what is watched to whoever connects, until interrupted; `again` gives the configuration as it is when asked.
fn serve(
    config: &Config,
    again: impl Fn() -> anyhow::Result<Config>,
    watch: Watch,
    (access, tls): (Access, Option<Tls>),
) -> anyhow::Result<()> {
    let Watch { source, engine, setup, calibration, keeping, manifest, info } = watch;
    let spec = info.spec.clone();
    // Before the hub: what counts without a recorder counts for nobody.
    let metrics = recorder();
    let camera = info.kind == "v4l2";
    let history = History::start(config.kept_history(camera))?;
    let Numbers { track, event, .. } = history.numbers();
    let mut engine = engine.map(|engine| engine.counting_from(track, event));
    let setup = setup.counting_from(track, event);
    let directory = config.storage.directory();
    // What is drawn over a replayed or simulated room says nothing of the camera that usually keeps things here.
    let own_place = manifest.is_none() || !config.storage.directory.as_os_str().is_empty();
    let zones_file = directory.as_ref().filter(|_| own_place).map(|directory| directory.join("zones.json"));
    let saved = zones_file.as_deref().map(ZoneKeeper::load).transpose()?.flatten();
    let origin = if saved.is_some() { ZoneOrigin::Saved } else { ZoneOrigin::Config };
    let mut used = config.clone();
    if let (Some(zones), Some(file)) = (saved, &zones_file) {
        tracing::info!("{}: its zones are used, not those of the configuration", file.display());
        engine.iter_mut().for_each(|engine| engine.use_zones(zones.clone()));
        used.zones = zones;
    }
    let hub = Hub::new(engine.as_ref().map(Engine::watched), config.preset, info).configured(&used);
    let publishers = Publishers::new(config)?;
    let hub = Arc::new(hub.telling({
        let (history, publishers) = (history.clone(), publishers.clone());
        move |update| {
            history.take_update(update);
            publishers.take_update(update);
        }
    }));
    let recordings = directory.map(|directory| directory.join("recordings"));
    let recordings = Arc::new(Recordings::new(recordings, manifest, Arc::clone(&hub)));
    let runtime = tokio::runtime::Runtime::new().context("cannot start the server's threads")?;
    runtime.block_on(async {
        let server = Server::bind(&config.server, access, tls).await?;
        let mut interrupt = signal(SignalKind::interrupt())?;
        let mut terminate = signal(SignalKind::terminate())?;
        let mut hangup = signal(SignalKind::hangup())?;
        // The port first, then the frames: nobody should miss the beginning of a recording.
        let running = start(source, engine, Arc::clone(&hub)).context("cannot start the frame loop")?;
        if let Some(metrics) = metrics.clone() {
            // What is measured piles up until somebody looks at it, or this is done.
            tokio::spawn(async move {
                let mut upkeep = tokio::time::interval(Duration::from_secs(5));
                loop {
                    upkeep.tick().await;
                    metrics.run_upkeep();
                }
            });
        }
        let kept = history.clone();
        let (end, ending) = tokio::sync::watch::channel(false);
        let publishing = tokio::spawn(publishers.clone().run(Arc::clone(&hub), ending));
        let calibrator =
            Arc::new(Calibrator::new(setup, keeping, calibration, Arc::clone(&hub), running.control().clone()));
        let zones = Arc::new(ZoneKeeper::new(
            config.zones.clone(),
            zones_file,
            origin,
            Arc::clone(&hub),
            running.control().clone(),
        ));
        let (in_use, config_in_use) = tokio::sync::watch::channel(config.clone());
        let reloader = Reloader {
            again,
            in_use,
            camera,
            access: server.access(),
            calibrator: Arc::clone(&calibrator),
            zones: Arc::clone(&zones),
            history: history.clone(),
            hub: Arc::clone(&hub),
        };
        let watching = format!("watching {spec}: the page is at {}", server.url());
        tracing::info!("{watching}");
        service::ready(&watching);
        tokio::spawn(service::feed_watchdog(Arc::clone(&hub)));
        server
            .serve(
                Backend {
                    hub,
                    control: running.control().clone(),
                    calibrator,
                    config: config_in_use,
                    recordings: Arc::clone(&recordings),
                    zones,
                    history,
                    publishers,
                    metrics,
                },
                async move {
                    loop {
                        tokio::select! {
                            _ = interrupt.recv() => break,
                            _ = terminate.recv() => break,
                            Some(()) = hangup.recv() => tokio::task::block_in_place(|| reloader.reload()),
                        }
                    }
                    tracing::info!("stopping");
                    service::stopping();
                },
            )
            .await;
        running.end();
        recordings.finish();
        kept.end();
        end.send_replace(true);
        // A panic has been reported when it happened.
        let _ = publishing.await;
        anyhow::Ok(())
    })
}
