//! The configuration file: every key, its default and its range. `config/doorcam.toml` shows them all. The defaults of
//! what the engine does are the engine's own.

mod access;
mod background;
mod camera;
mod changes;
mod crossings;
mod history;
mod into_settings;
mod publish;
mod room;
mod tls;
mod tracking;

use std::net::SocketAddr;
use std::path::Path;

pub use access::AccessConfig;
pub use background::{AveragingConfig, BackgroundConfig};
pub use camera::{CameraConfig, StorageConfig};
pub use changes::{Change, Takes};
pub use crossings::CrossingsConfig;
pub use history::HistoryConfig;
pub use publish::{HookUrl, MqttConfig, SiteConfig, WebhookConfig, topic_level};
pub use room::{DoorwayConfig, RoomConfig};
use serde::{Deserialize, Serialize};
pub use tls::TlsConfig;
pub use tracking::{LONGEST_ZONE_ID, TrackerConfig, check_zones};
use utoipa::ToSchema;

use doorcam_core::geometry::{GridSpec, Point, Room};
use doorcam_core::scene::Brightness;
use doorcam_core::schema;
use doorcam_core::solver::{Lambda, ModelKind};
use doorcam_core::tracking::Zone;
use doorcam_core::transport::Kernel;
use doorcam_engine::{PatchSettings, Settings, SolverSettings};
use doorcam_source::files::{self, FileKind};

/// A configuration that cannot be used. The message is one line that names the file, the line or key, and what was
/// expected.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct ConfigError(String);

impl ConfigError {
    pub(crate) fn new(text: String) -> Self {
        Self(text)
    }
}

/// The whole configuration.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// Where doorcam listens.
    pub server: ServerConfig,
    /// Who may read, and who may change things.
    pub access: AccessConfig,
    /// HTTPS.
    pub tls: TlsConfig,
    /// Where state is kept between runs.
    pub storage: StorageConfig,
    /// How events and occupancy are recorded.
    pub history: HistoryConfig,
    /// The camera.
    pub camera: CameraConfig,
    /// The door.
    pub doorway: DoorwayConfig,
    /// The hidden room that the map covers, and its lights.
    pub room: RoomConfig,
    /// The reconstruction grid.
    pub grid: GridConfig,
    /// The floor patches.
    pub patch: PatchConfig,
    /// Averaging of frames in time.
    pub averaging: AveragingConfig,
    /// How the background (the picture of the empty room) is learned and kept up to date.
    pub background: BackgroundConfig,
    /// The model of light that travels from facets to the floor.
    pub transport: TransportConfig,
    /// The inverse problem.
    pub solver: SolverConfig,
    /// The unified map and how figures show it.
    pub scene: SceneConfig,
    /// How people are tracked.
    pub tracker: TrackerConfig,
    /// Who walks through the doorway.
    pub crossings: CrossingsConfig,
    /// Named parts of the room.
    pub zones: Vec<Zone>,
    /// How this doorway is told apart from others.
    pub site: SiteConfig,
    /// The MQTT broker to publish to.
    pub mqtt: MqttConfig,
    /// Addresses that events are posted to.
    pub webhooks: Vec<WebhookConfig>,
    /// The preset in use, if any; its values replace those of the sections it covers.
    #[serde(skip)]
    pub preset: Option<Preset>,
}

/// `[server]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ServerConfig {
    /// Address and port.
    #[schema(value_type = String)]
    pub listen: SocketAddr,
    /// Most connections open at once.
    pub max_connections: usize,
    /// Most connections open at once from one address.
    pub max_connections_per_address: usize,
}

impl Default for ServerConfig {
    fn default() -> Self {
        Self {
            listen: SocketAddr::from(([127, 0, 0, 1], 8080)),
            max_connections: 512,
            max_connections_per_address: 256,
        }
    }
}

/// `[grid]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields)]
pub struct GridConfig {
    /// Width of the grid's cells in α1 and α2, in degrees; 180 must be a whole number of steps.
    pub angular_step_deg: f64,
    /// Smallest angle between a facet and the wall, in degrees.
    pub min_angle_deg: f64,
    /// Smallest distance between a facet and an edge, in metres.
    pub edge_clearance_m: f64,
    /// No facet is inside the ellipse whose points have distances to the two edges that sum to this, in metres.
    pub near_sum_m: f64,
}

impl Default for GridConfig {
    fn default() -> Self {
        Settings::default().grid.into()
    }
}

impl From<GridSpec> for GridConfig {
    fn from(grid: GridSpec) -> Self {
        // The room is a section of its own.
        let GridSpec { room: _, intervals, min_angle, edge_clearance_m, near_sum_m } = grid;
        let (angular_step_deg, min_angle_deg) = (180.0 / intervals as f64, min_angle.to_degrees());
        Self { angular_step_deg, min_angle_deg, edge_clearance_m, near_sum_m }
    }
}

/// `[patch]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields)]
pub struct PatchConfig {
    /// Side of the square of floor that is used, in metres; less if a recording shows less.
    pub fov_m: f64,
    /// Pixels along each side of the patch.
    pub pixels: usize,
    /// Parts of the floor to ignore.
    pub exclude: Vec<Rectangle>,
}

/// A rectangle of floor with its sides along the axes of the door frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Rectangle {
    /// One corner: (x, y) in the door frame, in metres.
    #[schema(value_type = schema::Point)]
    pub from_m: Point,
    /// The opposite corner.
    #[schema(value_type = schema::Point)]
    pub to_m: Point,
}

impl Default for PatchConfig {
    fn default() -> Self {
        Settings::default().patch.into()
    }
}

impl From<PatchSettings> for PatchConfig {
    fn from(PatchSettings { fov_m, pixels, exclude }: PatchSettings) -> Self {
        let exclude = exclude.into_iter().map(|[from_m, to_m]| Rectangle { from_m, to_m }).collect();
        Self { fov_m, pixels, exclude }
    }
}

/// `[transport]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields)]
pub struct TransportConfig {
    /// The law by which light falls off with distance.
    pub kernel: Kernel,
    /// Height of the facets, in metres.
    pub facet_height_m: f64,
}

impl Default for TransportConfig {
    fn default() -> Self {
        let Settings { kernel, facet_height_m, .. } = Settings::default();
        Self { kernel, facet_height_m }
    }
}

/// `[solver]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields)]
pub struct SolverConfig {
    /// Which changes a facet may show.
    pub model: ModelKind,
    /// Weight of the sparsity penalty in eq. 13.
    #[schema(value_type = schema::NumberOrWord)]
    pub lambda: Lambda,
    /// Automatic λ: this times the level that the empty room's noise reaches in one frame of a thousand.
    pub lambda_factor: f64,
    /// Automatic λ: at least this share of the smallest λ at which the map is empty.
    pub lambda_share: f64,
    /// Most solver steps per frame.
    pub max_steps: usize,
}

impl Default for SolverConfig {
    fn default() -> Self {
        let SolverSettings { model, lambda, lambda_factor, lambda_share, max_steps } = Settings::default().solver;
        Self { model, lambda, lambda_factor, lambda_share, max_steps }
    }
}

/// `[scene]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields)]
pub struct SceneConfig {
    /// Threshold t of eq. 15, relative to the largest |c|.
    pub unified_threshold: f64,
    /// The brightness that figures show.
    pub brightness: Brightness,
}

impl Default for SceneConfig {
    fn default() -> Self {
        let Settings { unified_threshold, brightness, .. } = Settings::default();
        Self { unified_threshold, brightness }
    }
}

/// A named set of values.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum Preset {
    /// The authors' program: its grid, kernel, 0.15 m patches, preprocessing, λ and the brightness of its figures.
    Published,
}

impl Config {
    /// Reads and checks a configuration file.
    ///
    /// # Errors
    ///
    /// If the file cannot be read, is not valid TOML, or has an unknown key or a value out of range.
    pub fn load(path: &Path) -> Result<Self, ConfigError> {
        let file = path.display();
        let text = files::read_text(path, FileKind::CONFIG)
            .map_err(|e| ConfigError(format!("{file}: cannot read the configuration: {e}")))?;
        let config = Self::parse(&text).map_err(|e| ConfigError(format!("{file}: {e}")))?;
        Ok(config)
    }

    /// Reads and checks the text of a configuration file.
    ///
    /// # Errors
    ///
    /// If the text is not valid TOML, or has an unknown key or a value out of range.
    pub fn parse(text: &str) -> Result<Self, ConfigError> {
        let config: Self = toml::from_str(text).map_err(|e| {
            let line = e.span().map_or(1, |span| 1 + text[..span.start.min(text.len())].matches('\n').count());
            let message = e.message().split_whitespace().collect::<Vec<_>>().join(" ");
            ConfigError(format!("line {line}: {message}"))
        })?;
        config.check()?;
        Ok(config)
    }

    /// This configuration with the preset's values in place of its own.
    pub fn with_preset(mut self, preset: Option<Preset>) -> Self {
        if let Some(Preset::Published) = preset {
            let Settings { grid, patch, kernel, facet_height_m, solver, brightness, .. } = Settings::published();
            let Room { half_width_m, depth_m } = grid.room;
            self.room = RoomConfig { half_width_m, depth_m, ..self.room };
            self.grid = grid.into();
            self.patch = PatchConfig { exclude: self.patch.exclude, ..patch.into() };
            self.transport = TransportConfig { kernel, facet_height_m };
            self.solver.model = solver.model;
            self.scene.brightness = brightness;
        }
        self.preset = preset;
        self
    }

    /// Checks the range of every value. Limits that depend on the doorway are checked once the doorway is known.
    ///
    /// # Errors
    ///
    /// If a value is out of its range, naming its key.
    pub fn check(&self) -> Result<(), ConfigError> {
        within("server.max_connections", self.server.max_connections as f64, 1.0, 1e5, "connections")?;
        let of_one = self.server.max_connections_per_address as f64;
        within("server.max_connections_per_address", of_one, 1.0, 1e5, "connections")?;
        self.access.check()?;
        self.tls.check()?;
        self.history.check()?;
        publish::check(&self.site, &self.mqtt, &self.webhooks)?;
        self.camera.check()?;
        self.doorway.check()?;
        self.room.check()?;
        within("grid.angular_step_deg", self.grid.angular_step_deg, 0.5, 20.0, "degrees")?;
        let steps = 180.0 / self.grid.angular_step_deg;
        if (steps - steps.round()).abs() > 1e-6 {
            return Err(ConfigError(format!(
                "grid.angular_step_deg is {}, expected a step that divides 180 degrees evenly, such as 4 or 2.5",
                self.grid.angular_step_deg
            )));
        }
        within("grid.min_angle_deg", self.grid.min_angle_deg, 1.0, 80.0, "degrees")?;
        within("grid.edge_clearance_m", self.grid.edge_clearance_m, 0.0, 10.0, "metres")?;
        within("grid.near_sum_m", self.grid.near_sum_m, 0.0, 100.0, "metres")?;
        within("patch.fov_m", self.patch.fov_m, 0.01, 2.0, "metres")?;
        within("patch.pixels", self.patch.pixels as f64, 8.0, 256.0, "pixels")?;
        self.averaging.check()?;
        self.background.check()?;
        within("transport.facet_height_m", self.transport.facet_height_m, 0.1, 10.0, "metres")?;
        if let Lambda::Fixed(lambda) = self.solver.lambda {
            check_lambda("solver.lambda", lambda)?;
        }
        within("solver.lambda_factor", self.solver.lambda_factor, 0.01, 100.0, "(a factor)")?;
        within("solver.lambda_share", self.solver.lambda_share, 0.0, 1.0, "(a share)")?;
        within("solver.max_steps", self.solver.max_steps as f64, 1.0, 1e6, "steps")?;
        within("scene.unified_threshold", self.scene.unified_threshold, 0.0, 1.0, "(a share of the largest |c|)")?;
        self.tracker.check()?;
        tracking::check_zones(&self.zones)
    }
}

/// Reads a λ given as text; `key` is its name in the error message.
///
/// # Errors
///
/// If the text is neither "auto" nor a finite number above 0.
pub fn parse_lambda(key: &str, text: &str) -> Result<Lambda, ConfigError> {
    if text == "auto" {
        return Ok(Lambda::Auto);
    }
    let lambda = text
        .parse::<f64>()
        .map_err(|_| ConfigError(format!("{key} is \"{text}\", expected \"auto\" or a number above 0")))?;
    check_lambda(key, lambda)?;
    Ok(Lambda::Fixed(lambda))
}

fn check_lambda(key: &str, lambda: f64) -> Result<(), ConfigError> {
    if lambda.is_finite() && lambda > 0.0 {
        return Ok(());
    }
    Err(ConfigError(format!("{key} is {lambda}, expected \"auto\" or a number above 0")))
}

/// The beginning of a text that may be long, for messages.
pub(crate) fn brief(text: &str) -> String {
    const MOST: usize = 80;
    let mut characters = text.chars();
    let begin: String = characters.by_ref().take(MOST).collect();
    if characters.next().is_some() { format!("{begin}...") } else { begin }
}

fn within(key: &str, value: f64, low: f64, high: f64, unit: &str) -> Result<(), ConfigError> {
    if (low..=high).contains(&value) {
        return Ok(());
    }
    Err(ConfigError(format!("{key} is {value}, expected {low} to {high} {unit}")))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const SHIPPED: &str = include_str!("../config/doorcam.toml");

    #[test]
    fn the_shipped_file_shows_every_key_with_its_default() {
        assert_eq!(Config::parse(SHIPPED).unwrap(), Config::default());
        let shipped: toml::Table = SHIPPED.parse().unwrap();
        let keys = |table: &toml::Table| -> Vec<String> {
            let inner = |(name, value): (&String, &toml::Value)| {
                value.as_table().into_iter().flatten().map(|(key, _)| format!("{name}.{key}")).collect::<Vec<_>>()
            };
            table.iter().flat_map(inner).collect()
        };
        let all: toml::Table = serde_json::from_value(serde_json::to_value(Config::default()).unwrap()).unwrap();
        assert_eq!(keys(&shipped), keys(&all));
    }

    #[test]
    fn every_key_of_the_shipped_file_has_a_comment_above_it() {
        let lines: Vec<&str> = SHIPPED.lines().collect();
        for (number, line) in lines.iter().enumerate().filter(|(_, l)| l.contains(" = ") && !l.starts_with('#')) {
            assert!(lines[number - 1].starts_with("# "), "line {}: {line}", number + 1);
        }
    }

    #[test]
    fn errors_name_the_line_or_the_key() {
        let error = |text: &str| Config::parse(text).expect_err("refused").to_string();
        assert_eq!(
            error("[room]\ndepth_m = 3.0\n\n[solver]\nlamda = 1\n"),
            "line 5: unknown field `lamda`, expected one of `model`, `lambda`, `lambda_factor`, `lambda_share`, `max_steps`"
        );
        assert_eq!(error("[solver]\nlambda = -1\n"), "solver.lambda is -1, expected \"auto\" or a number above 0");
        assert_eq!(error("[solver]\nlambda = nan\n"), "solver.lambda is NaN, expected \"auto\" or a number above 0");
        let word = "line 2: lambda is \"big\", expected \"auto\" or a number above 0";
        assert_eq!(error("[solver]\nlambda = \"big\"\n"), word);
        assert!(error("[server]\nlisten = \"nowhere\"\n").starts_with("line 2: "));
        assert!(error("[grid]\nangular_step_deg = 7\n").contains("expected a step that divides 180 degrees"));
        assert!(error("solver = {").starts_with("line 1: "));
        let lambda = parse_lambda("--lambda", "many").expect_err("refused").to_string();
        assert_eq!(lambda, "--lambda is \"many\", expected \"auto\" or a number above 0");
    }

    proptest! {
        #[test]
        fn any_text_is_refused_in_one_line_or_read(text in "[\\[\\]a-z_.=\"0-9 \n-]{0,120}") {
            if let Err(e) = Config::parse(&text) {
                prop_assert!(!e.to_string().contains('\n'));
            }
        }
    }
}
