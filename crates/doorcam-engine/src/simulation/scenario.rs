use std::path::Path;

use rust_embed::Embed;
use serde::{Deserialize, Serialize};

pub use super::camera_spec::{CameraSpec, FlickerSpec, FrameFormat};

use super::Walk;
use super::ordinary::{FurnitureSpec, LampFacing, LeafSpec, TelevisionSpec, WindowSpec};
use super::visible::{ObjectSpec, VisibleLampSpec, WallSpec};
use doorcam_core::geometry::Doorway;
use doorcam_core::scene::Rgb;
use doorcam_source::files::{self, FileKind};

/// A scenario that cannot be used: one line with the file, the line or key, and what was expected.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{0}")]
pub struct ScenarioError(String);

/// The scenarios that come with doorcam.
#[derive(Embed)]
#[folder = "scenarios/"]
struct Library;

/// Everything that a simulated recording shows. docs/simulator.md describes each key.
///
/// Lengths are in metres in the door frame, times in seconds. Times of walks, switches and exposures count from the end
/// of the empty time. Light is in relative units: the camera's level sets the scale.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scenario {
    /// One line that says what it shows.
    pub description: String,
    /// Frames per second.
    pub fps: f64,
    /// Duration of the empty room at the start, in seconds.
    pub background_s: f64,
    /// Duration of a round in seconds, including the empty time; then a loop begins again.
    pub duration_s: f64,
    /// Whether all surfaces of the room exchange light, as they do in a room with a window, a television, furniture, a
    /// leaf, a glossy floor, a rectangular panel or somebody with limbs.
    #[serde(default)]
    pub ordinary: bool,
    /// The doorway.
    pub doorway: Doorway,
    /// The hidden room.
    pub room: RoomSpec,
    /// Panels on the walls; later ones cover earlier ones.
    #[serde(default)]
    pub panel: Vec<PanelSpec>,
    /// The lamps of the hidden room.
    #[serde(default)]
    pub lamp: Vec<LampSpec>,
    /// Its windows.
    #[serde(default)]
    pub window: Vec<WindowSpec>,
    /// Its televisions.
    #[serde(default)]
    pub television: Vec<TelevisionSpec>,
    /// Its furniture.
    #[serde(default)]
    pub furniture: Vec<FurnitureSpec>,
    /// The door's leaf, open into the room; none if there is none, or if it is out of the way.
    #[serde(default)]
    pub leaf: Option<LeafSpec>,
    /// The people who walk there.
    #[serde(default)]
    pub person: Vec<PersonSpec>,
    /// Light of the visible side.
    pub visible: VisibleSpec,
    /// Things on the floor.
    #[serde(default)]
    pub object: Vec<ObjectSpec>,
    /// The floor.
    #[serde(default)]
    pub floor: FloorSpec,
    /// The doorway's wall, seen from the visible side.
    #[serde(default)]
    pub wall: WallSpec,
    /// The camera.
    pub camera: CameraSpec,
    /// Flicker of lamps on the mains; none if they do not flicker.
    #[serde(default)]
    pub flicker: Option<FlickerSpec>,
}

/// `[room]`
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RoomSpec {
    /// The room is |x| < half_width_m.
    pub half_width_m: f64,
    /// The room is 0 < y < depth_m.
    pub depth_m: f64,
    /// Height of the ceiling.
    pub ceiling_m: f64,
    /// How often light is reflected before it falls on the floor, at most; without limit if none. Only for ordinary
    /// rooms, to compare them with a path tracer that has such a limit.
    #[serde(default)]
    pub bounces: Option<u32>,
    /// Albedo of its surfaces.
    pub albedo: RoomAlbedo,
}

/// `[room.albedo]`: red, green, blue, 0 to 1.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RoomAlbedo {
    /// The wall at x = −half_width_m.
    pub left: Rgb,
    /// The wall at y = depth_m.
    pub back: Rgb,
    /// The wall at x = half_width_m.
    pub right: Rgb,
    /// The doorway's wall, seen from the room.
    pub front: Rgb,
    /// The floor of the room.
    pub floor: Rgb,
    /// The ceiling.
    pub ceiling: Rgb,
}

/// A wall that panels can hang on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum WallName {
    /// At x = −half_width_m.
    Left,
    /// At y = depth_m.
    Back,
    /// At x = half_width_m.
    Right,
}

/// `[[panel]]`: a painted rectangle on a wall.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PanelSpec {
    /// The wall.
    pub wall: WallName,
    /// Extent along the wall: x on the back wall, y on a side wall.
    pub along_m: [f64; 2],
    /// Extent above the floor.
    pub up_m: [f64; 2],
    /// Its albedo.
    pub albedo: Rgb,
}

/// Kind of a lamp.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum LampKind {
    /// A sphere that shines evenly.
    Bulb,
    /// A disc that shines downwards by Lambert's law.
    Panel,
}

/// `[[lamp]]`
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct LampSpec {
    /// Its kind.
    pub kind: LampKind,
    /// Its centre.
    pub at_m: [f64; 3],
    /// Its radius: determines how soft shadows are.
    pub radius_m: f64,
    /// Radiant intensity in relative units; for a panel, straight down.
    pub rgb: Rgb,
    /// Length and width of a panel that is a rectangle: along x and y, or along the wall and upwards if it does not
    /// shine downwards. Its radius then counts for nothing.
    #[serde(default)]
    pub size_m: Option<[f64; 2]>,
    /// Where a rectangular panel shines to.
    #[serde(default)]
    pub faces: LampFacing,
    /// Times and the level from then on: 0 is off, 1 applies before the first.
    #[serde(default)]
    pub switch: Vec<(f64, f64)>,
}

/// `[[person]]`
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PersonSpec {
    /// Radius of the body.
    #[serde(default = "usual_radius")]
    pub radius_m: f64,
    /// Height including the head.
    #[serde(default = "usual_height")]
    pub height_m: f64,
    /// Albedo of the body.
    pub clothes: Rgb,
    /// Albedo of the head.
    #[serde(default = "usual_skin")]
    pub skin: Rgb,
    /// Albedo of the legs, where people have some: half that of the clothes by default.
    #[serde(default)]
    pub trousers: Option<Rgb>,
    /// Whether they have legs and arms in the room's light; people of a scenario with somebody on the visible side do.
    #[serde(default)]
    pub limbs: bool,
    /// Waypoints [seconds, x, y]; the person is only there from the first to the last.
    pub walk: Vec<(f64, f64, f64)>,
    /// Seconds after which the walk begins again; none for a single walk.
    #[serde(default)]
    pub repeat_s: Option<f64>,
}

/// `[visible]`: the visible side's light on the floor.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VisibleSpec {
    /// Its share of the light on the floor beside the edges while the room is empty: 0 to below 1.
    pub share: f64,
    /// Its colour.
    #[serde(default = "white")]
    pub rgb: Rgb,
    /// Amplitude of its rise and fall, as a part of itself.
    #[serde(default)]
    pub drift: f64,
    /// Period of the drift, in seconds.
    #[serde(default = "minute")]
    pub drift_period_s: f64,
    /// Lamps that a part of it comes from; the rest comes from everywhere.
    #[serde(default)]
    pub lamp: Vec<VisibleLampSpec>,
}

/// `[floor]`: what the camera looks at.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FloorSpec {
    /// Mean albedo.
    pub albedo: Rgb,
    /// Standard deviation of its speckle, relative to the albedo.
    pub speckle: f64,
    /// Size of a speckle.
    pub grain_m: f64,
    /// Part of the light straight from above that it mirrors, more or less blurred, besides what it scatters.
    pub gloss: f64,
    /// How much it blurs what it mirrors: the α of a GGX lobe.
    pub roughness: f64,
}

impl Default for FloorSpec {
    fn default() -> Self {
        Self { albedo: [0.6, 0.6, 0.6], speckle: 0.0, grain_m: 0.004, gloss: 0.0, roughness: 0.22 }
    }
}

fn usual_radius() -> f64 {
    0.2
}
fn usual_height() -> f64 {
    1.75
}
fn usual_skin() -> Rgb {
    [0.55, 0.38, 0.3]
}
fn white() -> Rgb {
    [1.0; 3]
}
fn minute() -> f64 {
    60.0
}
/// The value in force at a time: that of the last entry not later than it; 1 before the first.
pub(super) fn in_force(entries: &[(f64, f64)], seconds: f64) -> f64 {
    entries.iter().rev().find(|(at, _)| *at <= seconds).map_or(1.0, |(_, value)| *value)
}

impl Scenario {
    /// The names of the scenarios that come with doorcam, sorted.
    pub fn names() -> Vec<String> {
        let mut names: Vec<String> = Library::iter().filter_map(|f| Some(f.strip_suffix(".toml")?.into())).collect();
        names.sort();
        names
    }

    /// Loads one of [`Scenario::names`], or a file: a name that ends in `.toml` or contains a slash is a path.
    ///
    /// # Errors
    ///
    /// If there is no such scenario, or the file cannot be read or is not valid.
    pub fn load(name: &str) -> Result<Self, ScenarioError> {
        let error = |e: String| ScenarioError(format!("{name}: {e}"));
        if name.ends_with(".toml") || name.contains('/') {
            let text = files::read_text(Path::new(name), FileKind::SCENARIO).map_err(|e| match e {
                e if e.is_missing() => error("no such file, expected a scenario (config/scenarios has some)".into()),
                e => error(format!("cannot read the scenario: {}", e.words())),
            })?;
            return Self::parse(&text).map_err(error);
        }
        let Some(file) = Library::get(&format!("{name}.toml")) else {
            return Err(error(format!("unknown scenario, expected {} or a TOML file", Self::names().join(", "))));
        };
        let text = String::from_utf8_lossy(&file.data);
        Self::parse(&text).map_err(error)
    }

    /// The same, as its seed says: `walk-through`, `pass-by`, `bag`, `bump` and `random` are
    /// different with each.
    ///
    /// # Errors
    ///
    /// As [`Scenario::load`].
    pub fn varied(name: &str, seed: u64) -> Result<Self, ScenarioError> {
        let mut scenario = Self::load(name)?;
        super::variation::vary(&mut scenario, name, seed);
        Ok(scenario)
    }

    /// The room of a seed: its own door, walls, lights, camera and walks (docs/simulator.md has the distributions), with
    /// so many people, or as many as the seed says.
    ///
    /// # Errors
    ///
    /// If there are to be fewer than one or more than four people.
    pub fn random(seed: u64, people: Option<usize>) -> Result<Self, ScenarioError> {
        let most = super::variation::MOST_PEOPLE;
        if let Some(count) = people.filter(|count| !(1..=most).contains(count)) {
            return Err(ScenarioError(format!("{count} people: expected 1 to {most}")));
        }
        let mut scenario = Self::load(super::variation::RANDOM)?;
        super::variation::random(&mut scenario, seed, people);
        Ok(scenario)
    }

    /// Parses and checks a scenario.
    ///
    /// # Errors
    ///
    /// If the text is not a valid scenario; the message does not name the file.
    pub fn parse(text: &str) -> Result<Self, String> {
        let scenario: Self = toml::from_str(text).map_err(|e| {
            let line = e.span().map_or(1, |span| 1 + text[..span.start.min(text.len())].matches('\n').count());
            format!("line {line}: {}", e.message().split_whitespace().collect::<Vec<_>>().join(" "))
        })?;
        scenario.check()?;
        Ok(scenario)
    }

    /// Number of frames in a round.
    pub fn frames(&self) -> u64 {
        (self.duration_s * self.fps).round().max(1.0) as u64
    }

    /// Number of frames at the start of a round that show the empty room.
    pub fn background_frames(&self) -> u64 {
        (self.background_s * self.fps).round() as u64
    }

    /// Whether anybody or anything is on the visible side. Then all people have legs, and the camera sees who is in its
    /// picture.
    pub(super) fn shows_people(&self) -> bool {
        !self.object.is_empty() || self.person.iter().any(Self::goes_outside)
    }

    /// Whether it has what only [`super::ordinary`] knows.
    pub(super) fn is_ordinary(&self) -> bool {
        self.ordinary
            || !self.window.is_empty()
            || !self.television.is_empty()
            || !self.furniture.is_empty()
            || self.leaf.is_some()
            || self.floor.gloss > 0.0
            || self.person.iter().any(|person| person.limbs)
            || self.lamp.iter().any(|lamp| lamp.size_m.is_some())
    }

    /// Whether a person is on the visible side at any time.
    pub(super) fn goes_outside(person: &PersonSpec) -> bool {
        person.walk.iter().any(|&(_, _, y)| y < 0.0)
    }

    /// A person's walk, in seconds since the end of the empty time.
    pub(super) fn walk(person: &PersonSpec) -> Walk {
        Walk { waypoints: person.walk.iter().map(|&(t, x, y)| (t, [x, y])).collect(), period_s: person.repeat_s }
    }

    pub(super) fn check(&self) -> Result<(), String> {
        super::check::check(self)
    }
}

/// A scenario with the required keys only.
#[cfg(test)]
pub(super) const SMALLEST: &str = r#"
description = "a small room"
fps = 5
background_s = 1
duration_s = 4
[doorway]
width_m = 0.8
wall_thickness_m = 0.1
[room]
half_width_m = 1.5
depth_m = 3.0
ceiling_m = 2.4
[room.albedo]
left = [0.6, 0.3, 0.3]
back = [0.7, 0.7, 0.6]
right = [0.3, 0.4, 0.6]
front = [0.6, 0.6, 0.6]
floor = [0.3, 0.3, 0.3]
ceiling = [0.8, 0.8, 0.8]
[[lamp]]
kind = "bulb"
at_m = [0.9, 0.4, 2.1]
radius_m = 0.08
rgb = [1.0, 0.9, 0.8]
[visible]
share = 0.4
[camera]
at_m = [0.05, -0.75, 1.3]
look_at_m = [0.0, -0.25]
field_of_view_deg = 60
"#;

#[cfg(test)]
#[path = "scenario_tests.rs"]
mod tests;
