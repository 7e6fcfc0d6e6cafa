use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context, bail};
use doorcam::config::{Config, ServerConfig};
use doorcam::feed::{Feed, SourceKind, SourceSpec};
use doorcam::history::{History, Kept, Numbers};
use doorcam::publish::Publishers;
use doorcam::server::{Access, Backend, Server, Tls};
use doorcam::text::one_line;
use doorcam::watch::{
    CalibrationStore, Calibrator, CrossingKeeper, Hub, Keeping, Recordings, ZoneIds, ZoneKeeper, ZoneOrigin, start,
};
use doorcam_core::calibration::Calibration;
use doorcam_engine::{Assembly, Engine, Work};
use doorcam_source::recording::Manifest;
use metrics_exporter_prometheus::{PrometheusBuilder, PrometheusHandle};
use tokio::signal::unix::{SignalKind, signal};

use super::listening::ListenOptions;
use super::reload::Reloader;
use super::{ModelOptions, manifest_of, process, service, source_help};

/// Watch a doorway and show the hidden room live, on a page and over REST and WebSocket
#[derive(Debug, clap::Args)]
#[command(after_help = format!("{}

Examples:
  doorcam serve --source v4l2:/dev/video0
  doorcam serve --source replay:recordings/lab-0,loop --preset published
  doorcam serve --source simulate:two-crossing
  and open http://127.0.0.1:8080", source_help::HELP))]
pub(super) struct Arguments {
    /// Where frames come from
    #[arg(long, value_name = "SOURCE")]
    source: SourceSpec,
    #[command(flatten)]
    listening: ListenOptions,
    /// File for the camera's calibration, as made on the page [default: calibration.json in the storage directory]
    #[arg(long, value_name = "FILE")]
    calibration: Option<PathBuf>,
    /// Directory for state kept between runs, one per doorway [default: storage.directory of the configuration]
    #[arg(long, value_name = "DIR")]
    storage: Option<PathBuf>,
    /// Keep events and occupancy in memory only
    #[arg(long)]
    no_history: bool,
    #[command(flatten)]
    model: ModelOptions,
}

/// How long jobs of requests that are still running get to finish at the end.
const LAST_JOBS: Duration = Duration::from_millis(300);

/// A source and what processes its frames.
struct Watch {
    feed: Feed,
    engine: Option<Engine>,
    assembly: Assembly,
    calibration: Option<Calibration>,
    keeping: Keeping,
}

impl Arguments {
    /// Reads the configuration from the file and the command line.
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
    let watch = watch(&config, &arguments.source, arguments.calibration.as_deref())?;
    serve(&config, || arguments.config(), watch, access)
}

/// Serves a source that needs no other options, until interrupted.
pub(super) fn show(config: &Config, spec: &SourceSpec, access: (Access, Option<Tls>)) -> anyhow::Result<()> {
    serve(config, || Ok(config.clone()), watch(config, spec, None)?, access)
}

/// Opens a source and assembles what processes its frames; `file` is the calibration file given by the user, if any.
fn watch(config: &Config, spec: &SourceSpec, file: Option<&Path>) -> anyhow::Result<Watch> {
    let mut feed = Feed::open(spec, config)?;
    let keeping = keeping(&feed, config, file)?;
    let kept = match &keeping {
        Keeping::File(store) => store.load()?,
        Keeping::Fixed(_) => None,
    };
    let calibration = kept.clone().or_else(|| feed.manifest().and_then(Manifest::calibration));
    if let Some(kept) = &kept {
        feed.use_calibration(kept);
    }
    let mut assembly = Assembly::new(config.settings()).rolling(Work::Aside);
    if let (Some(directory), Some(settings)) = (config.storage.directory(), feed.camera_settings()) {
        assembly = assembly.keeping(directory.join("background.bin"), settings);
    }
    let engine = match (feed.manifest(), &calibration) {
        (Some(manifest), _) => {
            let named = || feed.recording().map_or_else(|| feed.info().spec, manifest_of);
            Some(assembly.for_recording(manifest).with_context(named)?)
        }
        (None, Some(calibration)) => {
            let named = || match &keeping {
                Keeping::File(store) => store.file().display().to_string(),
                Keeping::Fixed(_) => spec.text.clone(),
            };
            Some(assembly.for_camera(calibration).with_context(named)?)
        }
        (None, None) => {
            tracing::info!("the camera is not calibrated yet: calibrate it on the page");
            None
        }
    };
    Ok(Watch { feed, engine, assembly, calibration, keeping })
}

/// Where the calibration of a source is kept, or why it cannot be changed.
fn keeping(feed: &Feed, config: &Config, file: Option<&Path>) -> anyhow::Result<Keeping> {
    let fixed = |reason: &str| Ok(Keeping::Fixed(reason.into()));
    match feed.kind() {
        SourceKind::Simulate => match file {
            Some(file) => bail!("{}: a simulated camera brings its own calibration", file.display()),
            None => fixed("a simulated camera brings its own calibration"),
        },
        SourceKind::Replay => {
            let manifest = feed.manifest();
            if manifest.is_some_and(|manifest| manifest.background_frames.is_none()) {
                let named = feed.recording().map(manifest_of).unwrap_or_default();
                bail!("{named}: background_frames is missing, expected [first, end) of the empty room");
            }
            match (file, manifest.and_then(Manifest::calibration)) {
                (Some(file), Some(_)) => Ok(Keeping::File(CalibrationStore::new(file.into()))),
                (Some(file), None) => {
                    bail!("{}: a recording of rectified patches needs no calibration", file.display())
                }
                (None, Some(_)) => fixed(
                    "a recording brings its own calibration; start doorcam with --calibration FILE to make another",
                ),
                (None, None) => fixed("a recording of rectified patches needs no calibration"),
            }
        }
        SourceKind::V4l2 => {
            let usual = || config.storage.directory().map(|directory| directory.join("calibration.json"));
            match file.map(Path::to_owned).or_else(usual) {
                Some(file) => Ok(Keeping::File(CalibrationStore::new(file))),
                None => bail!(
                    "no directory for the camera's calibration, expected --calibration FILE, --storage DIR or $HOME"
                ),
            }
        }
    }
}

/// Installs the recorder of metrics; `/metrics` shows what is recorded from then on.
fn recorder() -> Option<PrometheusHandle> {
    const SECONDS: [f64; 12] = [1e-4, 2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2, 2e-2, 5e-2, 0.1, 0.5, 2.0];
    let builder = PrometheusBuilder::new().set_buckets(&SECONDS).ok()?;
    builder.install_recorder().ok()
}

/// Loads tokens and TLS. This comes before everything else: a start that is refused should leave nothing behind.
pub(super) fn access(config: &Config) -> anyhow::Result<(Access, Option<Tls>)> {
    let tls = Tls::load(&config.tls)?;
    let access = Access::new(&config.access, config.server.listen, |name| std::env::var_os(name))?;
    if access.is_exposed() {
        tracing::warn!("{} needs no token: anybody who reaches it can change everything", config.server.listen);
    }
    Ok((access, tls))
}

/// Runs the frame loop and the server until interrupted; `again` reads the configuration again.
fn serve(
    config: &Config,
    again: impl Fn() -> anyhow::Result<Config>,
    watch: Watch,
    (access, tls): (Access, Option<Tls>),
) -> anyhow::Result<()> {
    let Watch { feed, mut engine, assembly, calibration, keeping } = watch;
    let (info, manifest) = (feed.info(), feed.manifest().cloned());
    let (spec, size) = (info.spec.clone(), manifest.as_ref().and_then(|manifest| manifest.size));
    // Before the hub: counts made before the recorder is installed are lost.
    let metrics = recorder();
    let kind = info.kind;
    let history = History::start(Kept::of(config, kind))?;
    let Numbers { track, event, .. } = history.numbers();
    engine.iter_mut().for_each(|engine| engine.count_from(track, event));
    let assembly = assembly.counting_from(track, event);
    let directory = config.storage.directory();
    // Zones drawn on a replayed or simulated room must not replace those of the camera that uses the default directory.
    let own_place = manifest.is_none() || !config.storage.directory.as_os_str().is_empty();
    let own_directory = directory.as_ref().filter(|_| own_place);
    let zones_file = own_directory.map(|directory| directory.join("zones.json"));
    let saved = zones_file.as_deref().map(ZoneKeeper::load).transpose()?.flatten();
    let origin = if saved.is_some() { ZoneOrigin::Saved } else { ZoneOrigin::Config };
    let mut zone_ids = ZoneIds::load(zones_file.as_ref().map(|file| file.with_file_name("zone-ids.json")))?;
    // Those in use first: their ids are known elsewhere.
    let saved = saved.map(|zones| zone_ids.identified(&zones));
    let configured = zone_ids.identified(&config.zones);
    if let Err(e) = zone_ids.save() {
        tracing::warn!("{e}: ids of zones are kept for this run only");
    }
    let mut used = config.clone();
    used.zones.clone_from(&configured);
    if let (Some(zones), Some(file)) = (saved, &zones_file) {
        tracing::info!("{}: its zones are used, not those of the configuration", file.display());
        engine.iter_mut().for_each(|engine| engine.use_zones(zones.clone()));
        used.zones = zones;
    }
    let hub = Hub::new(engine.as_ref().map(Engine::watched), config.preset, info).configured(&used);
    let publishers = Publishers::new(config, own_directory.map(PathBuf::as_path))?;
    let hub = Arc::new(hub.telling({
        let (history, publishers) = (history.clone(), publishers.clone());
        move |update| {
            history.take_update(update);
            publishers.take_update(update);
        }
    }));
    let crossings_file = own_directory.map(|directory| directory.join("crossings.json"));
    // Before frames start: what comes from now on is counted on top.
    let crossings = Arc::new(CrossingKeeper::new(crossings_file, Arc::clone(&hub), &history));
    let recordings = directory.map(|directory| directory.join("recordings"));
    let recordings = Arc::new(Recordings::new(recordings, manifest, Arc::clone(&hub)));
    let runtime = tokio::runtime::Runtime::new().context("cannot start the server's threads")?;
    let served = runtime.block_on(async {
        let max_connections = process::connections(config.server.max_connections);
        let listening = ServerConfig { max_connections, ..config.server.clone() };
        let server = Server::bind(&listening, access, tls).await?;
        let mut interrupt = signal(SignalKind::interrupt())?;
        let mut terminate = signal(SignalKind::terminate())?;
        let mut hangup = signal(SignalKind::hangup())?;
        // The port is bound before frames start, so that clients do not miss the beginning of a recording.
        let running = start(feed.start(), engine, Arc::clone(&hub)).context("cannot start the frame loop")?;
        if let Some(metrics) = metrics.clone() {
            // Without upkeep, measured values pile up until somebody reads /metrics.
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
        let control = running.control().clone();
        let calibrator = Calibrator::new(assembly, keeping, calibration, size, Arc::clone(&hub), control);
        let calibrator = Arc::new(calibrator.context("cannot start the thread that builds calibrations")?);
        let zones = Arc::new(ZoneKeeper::new(
            (configured, zone_ids),
            zones_file,
            origin,
            Arc::clone(&hub),
            running.control().clone(),
        ));
        let (in_use, config_in_use) = tokio::sync::watch::channel(config.clone());
        let reloader = Reloader {
            again,
            in_use,
            kind,
            access: server.access(),
            calibrator: Arc::clone(&calibrator),
            zones: Arc::clone(&zones),
            history: history.clone(),
            hub: Arc::clone(&hub),
        };
        let watching = format!("watching {spec}: the page is at {}", server.url());
        tracing::info!("{watching}");
        service::ready(&one_line(&watching));
        tokio::spawn(service::feed_watchdog(Arc::clone(&hub)));
        tokio::spawn(Arc::clone(&crossings).keep());
        server
            .serve(
                Backend {
                    hub,
                    control: running.control().clone(),
                    calibrator,
                    config: config_in_use,
                    recordings: Arc::clone(&recordings),
                    zones,
                    crossings: Arc::clone(&crossings),
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
        if let Err(e) = crossings.save() {
            tracing::warn!("{e}: how many walked through is lost");
        }
        kept.end();
        end.send_replace(true);
        // An error here is a panic of the task, which was reported when it happened.
        let _ = publishing.await;
        anyhow::Ok(())
    });
    // What requests have begun may finish, such as a file that is being written. But nobody waits for its answer any
    // more, so it must not keep the program from ending.
    runtime.shutdown_timeout(LAST_JOBS);
    served
}
