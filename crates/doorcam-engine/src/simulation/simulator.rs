use std::io::Cursor;
use std::sync::Arc;

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};

use super::Walk;
use super::crossings::crossings;
use super::exposure::{Exposure, Shot};
use super::figure::Figure;
use super::floor::{FloorMap, Tap};
use super::light::RoomLight;
use super::ordinary::{OrdinaryLight, Person, TrueRoom};
use super::scenario::{FrameFormat, PersonSpec, Scenario, in_force};
use super::view::{Bump, Pinhole, Seen, View, floor_points, patch_grid};
use super::visible::{Body, Looks, ObjectSpec, Sight, Stage, VisibleLamp, pose};
use doorcam_core::geometry::{Doorway, Point, Side};
use doorcam_core::image::{Image, Samples};
use doorcam_core::optics::Transfer;
use doorcam_core::transport::{PatchGrid, PixelLayout};
use doorcam_source::recording::{Layout, Manifest};
use doorcam_source::sensor::{LumaMatrix, SensorFormat, SensorPixels};
use doorcam_source::truth::{Target, TrueCrossing, TrueFrame};
use doorcam_source::{Purpose, RawFrame, RawImages, SkipKind, SkippedFrame};

/// With fewer marks than this in the picture, a calibration cannot be checked.
const LEAST_MARKS: usize = 6;
/// How far before and behind the hidden face the room's light on the floor is taken for that on somebody who stands
/// there, in metres.
const LIT_M: f64 = 0.8;
/// Squares beside the edges that define the light's level and the visible side's share.
const REFERENCE: PatchGrid = PatchGrid { size: 16, fov_m: 0.3, layout: PixelLayout::Cells };

/// Makes any frame of a scenario; the same seed gives the same frames.
#[derive(Debug, Clone)]
pub struct Simulator {
    scenario: Scenario,
    seed: u64,
    light: Light,
    views: Vec<Outlook>,
    exposure: Exposure,
    walks: Vec<Walk>,
    /// Factor from the scene's light to full scale.
    gain: f64,
    /// The visible side's light, without its drift.
    visible: [f64; 3],
    /// The visible side's lamps.
    lamps: Vec<VisibleLamp>,
    manifest: Manifest,
}

/// What the camera sees from a time on, until it is bumped again.
#[derive(Debug, Clone)]
struct Outlook {
    from_s: f64,
    /// None for patches, which no camera sees.
    camera: Option<Pinhole>,
    view: View,
}

/// The light of the hidden room.
#[derive(Debug, Clone)]
enum Light {
    Plain(Box<RoomLight>),
    Ordinary(Box<OrdinaryLight>),
}

impl Light {
    fn floor(&self) -> &FloorMap {
        match self {
            Self::Plain(light) => light.floor(),
            Self::Ordinary(light) => light.floor(),
        }
    }
}

/// Everybody and everything that is somewhere at one moment.
enum Cast {
    /// People of a scenario whose camera sees nobody.
    Unseen(Vec<Figure>),
    /// The same in an ordinary room.
    Ordinary(Vec<Person>),
    /// All people and things, if some are on the visible side.
    Seen(Vec<Body>),
}

impl Simulator {
    /// Calculates everything that does not move, which takes up to a second.
    ///
    /// # Errors
    ///
    /// If the camera sees too few of the marks at the doorway's foot; the message names the keys, not the file.
    pub fn new(scenario: Scenario, seed: u64) -> Result<Self, String> {
        let manifest = manifest(&scenario, seed)?;
        let floor = FloorMap::new(scenario.doorway);
        let views = outlooks(&scenario, &floor);
        let seen = views.iter().flat_map(|outlook| outlook.view.pixels.iter().flat_map(|pixel| pixel.taps));
        let light = if scenario.is_ordinary() {
            let others: Vec<Tap> = lit_places(&scenario.doorway).flat_map(|place| floor.taps(place)).collect();
            Light::Ordinary(Box::new(OrdinaryLight::new(&scenario, floor, seen.chain(others))))
        } else {
            let mut light = RoomLight::new(&scenario);
            light.look_only_at(seen);
            Light::Plain(Box::new(light))
        };
        let exposure = Exposure::new(&scenario.camera, scenario.flicker);
        let walks = scenario.person.iter().map(Scenario::walk).collect();
        let reference: Vec<Point> =
            Side::BOTH.into_iter().flat_map(|side| REFERENCE.points(&scenario.doorway, side)).collect();
        let lamps = scenario.visible.lamp.iter().map(|spec| VisibleLamp::new(spec, &reference)).collect();
        let (gain, visible) = (1.0, [0.0; 3]);
        let mut simulator = Self { scenario, seed, light, views, exposure, walks, gain, visible, lamps, manifest };
        simulator.set_level();
        Ok(simulator)
    }

    /// Sets the visible side's light and the gain from the light on the floor beside the edges of the empty room.
    fn set_level(&mut self) {
        let levels = self.levels(-self.scenario.background_s, None);
        let nodes = self.hidden_light(&levels, Cast::Unseen(Vec::new()), [0.0; 3]).0;
        let hidden = mean_light(&self.scenario.doorway, self.light.floor(), &nodes);
        let mean = hidden.iter().sum::<f64>() / 3.0;
        let spec = &self.scenario.visible;
        let white = spec.rgb.iter().sum::<f64>() / 3.0;
        self.visible = spec.rgb.map(|c| c / white * mean * spec.share / (1.0 - spec.share));
        let lit = (0..3).map(|c| self.scenario.floor.albedo[c] * (hidden[c] + self.visible[c])).sum::<f64>() / 3.0;
        self.gain = if lit > 0.0 { self.scenario.camera.level / lit } else { 1.0 };
    }

    /// The scenario.
    pub fn scenario(&self) -> &Scenario {
        &self.scenario
    }

    /// The manifest of a recording of one round.
    pub fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// Makes a frame. After the last frame of a round the scenario begins again with other noise, but time goes on.
    ///
    /// # Errors
    ///
    /// If the frame cannot be encoded.
    pub fn frame(&self, number: u64) -> Result<RawFrame, SkippedFrame> {
        let index = number % self.scenario.frames();
        let name: Arc<str> = format!("frame {index}").into();
        let images = self.images(number).map_err(|reason| SkippedFrame::new(&*name, SkipKind::Damaged, reason))?;
        let purpose = if index < self.scenario.background_frames() { Purpose::Background } else { Purpose::Watch };
        let seconds = number as f64 / self.scenario.fps;
        Ok(RawFrame { index: Some(index), purpose, seconds, images, time: None, name })
    }

    /// True positions of everybody in the room, for a frame of one round.
    pub fn truth(&self, index: u64) -> TrueFrame {
        let room = &self.scenario.room;
        let inside = |[x, y]: &Point| x.abs() < room.half_width_m && (0.0..room.depth_m).contains(y);
        let people = self.people_at(self.seconds_after_empty(index));
        let targets = people.filter(|(_, _, at)| inside(at)).map(|(id, person, [x_m, y_m])| Target {
            id,
            x_m,
            y_m,
            radius_m: person.radius_m,
            rgb: person.clothes,
        });
        TrueFrame { index, t: index as f64 / self.scenario.fps, targets: targets.collect() }
    }

    /// What is in an ordinary room; none for another one.
    pub(super) fn true_room(&self) -> Option<TrueRoom<'_>> {
        match &self.light {
            Light::Plain(_) => None,
            Light::Ordinary(light) => Some(TrueRoom::new(&self.scenario, light.sees_a_source())),
        }
    }

    /// Who goes through the doorway in a round or turns around on its threshold, in order of time.
    pub fn true_crossings(&self) -> Vec<TrueCrossing> {
        let scenario = &self.scenario;
        let empty = scenario.background_frames() as f64 / scenario.fps;
        let last = scenario.frames().saturating_sub(1) as f64 / scenario.fps;
        let who = scenario.person.iter().zip(&self.walks).filter(|(person, _)| Scenario::goes_outside(person));
        let each = who.flat_map(|(_, walk)| crossings(walk, &scenario.doorway, last - empty));
        let mut all: Vec<TrueCrossing> = each.map(|c| TrueCrossing { t: c.t + empty, ..c }).collect();
        all.sort_by(|a, b| a.t.total_cmp(&b.t));
        all
    }

    /// Seconds from the end of the empty time to a frame of a round.
    fn seconds_after_empty(&self, index: u64) -> f64 {
        // In whole frames, so that the first one after the empty time is at exactly 0.
        (index as f64 - self.scenario.background_frames() as f64) / self.scenario.fps
    }

    /// Everybody who is anywhere, numbered from 1.
    fn people_at(&self, seconds: f64) -> impl Iterator<Item = (u64, &PersonSpec, Point)> {
        let people = self.scenario.person.iter().zip(&self.walks).zip(1..);
        people.filter_map(move |((person, walk), id)| {
            (seconds >= 0.0).then(|| walk.at(seconds)).flatten().map(|at| (id, person, at))
        })
    }

    fn cast_at(&self, seconds: f64) -> Cast {
        let people = self.people_at(seconds);
        let shown = self.scenario.shows_people();
        if !shown && !self.scenario.is_ordinary() {
            return Cast::Unseen(
                people.map(|(_, p, at)| Figure::new(at, p.radius_m, p.height_m, p.clothes, p.skin)).collect(),
            );
        }
        let person = |(id, person, _): (u64, &PersonSpec, Point)| {
            let looks = Looks {
                radius: person.radius_m,
                height: person.height_m,
                clothes: person.clothes,
                trousers: person.trousers.unwrap_or(person.clothes.map(|c| 0.5 * c)),
                skin: person.skin,
            };
            Some(Body::person(&looks, &pose(self.walks.get(id as usize - 1)?, seconds)?))
        };
        if !shown {
            let ordinary = |(id, p, at): (u64, &PersonSpec, Point)| {
                if p.limbs {
                    return person((id, p, at)).as_ref().map(Person::body);
                }
                Some(Person::cylinder(at, p.radius_m, p.height_m, p.clothes, p.skin))
            };
            return Cast::Ordinary(people.filter_map(ordinary).collect());
        }
        let there = |object: &&ObjectSpec| seconds >= object.from_s && object.until_s.is_none_or(|end| seconds < end);
        let objects = self.scenario.object.iter().filter(there);
        let bag = |o: &ObjectSpec| Body::bag(o.at_m, o.length_m, o.thickness_m, o.turn_deg.to_radians(), o.albedo);
        Cast::Seen(people.filter_map(person).chain(objects.map(bag)).collect())
    }

    /// The level of each of the room's lights. `seconds` count from the end of the empty time, `shown` from the first
    /// frame of all; without that, what flickers has its mean.
    fn levels(&self, seconds: f64, shown: Option<f64>) -> Vec<f64> {
        match &self.light {
            Light::Plain(_) => self.scenario.lamp.iter().map(|lamp| in_force(&lamp.switch, seconds)).collect(),
            Light::Ordinary(light) => light.levels(seconds, shown, self.seed),
        }
    }

    /// The room's light on the floor, and the bodies among those who are there.
    fn hidden_light(&self, levels: &[f64], cast: Cast, visible: [f64; 3]) -> (Vec<[f32; 3]>, Vec<Body>) {
        match (&self.light, cast) {
            (Light::Plain(light), Cast::Unseen(figures)) => (light.light(levels, figures, visible), Vec::new()),
            (Light::Plain(light), Cast::Seen(bodies)) => {
                (light.light(levels, bodies.iter().map(Body::figure).collect(), visible), bodies)
            }
            (Light::Ordinary(light), Cast::Seen(bodies)) => {
                (light.light(levels, bodies.iter().map(Person::body).collect(), visible), bodies)
            }
            (Light::Ordinary(light), Cast::Ordinary(people)) => (light.light(levels, people, visible), Vec::new()),
            (Light::Ordinary(light), Cast::Unseen(_)) => (light.light(levels, Vec::new(), visible), Vec::new()),
            (Light::Plain(light), Cast::Ordinary(_)) => (light.light(levels, Vec::new(), visible), Vec::new()),
        }
    }

    fn images(&self, number: u64) -> Result<RawImages, String> {
        let seconds = self.seconds_after_empty(number % self.scenario.frames());
        let spec = &self.scenario.visible;
        let drift = 1.0 + spec.drift * (std::f64::consts::TAU * seconds / spec.drift_period_s).sin();
        let visible = self.visible.map(|v| v * drift);
        let levels = self.levels(seconds, Some(number as f64 / self.scenario.fps));
        let (light, bodies) = self.hidden_light(&levels, self.cast_at(seconds), visible);
        let outlook = self.outlook(seconds);
        let sights =
            (!bodies.is_empty() || !self.lamps.is_empty()).then(|| self.sights(&levels, &bodies, visible, outlook));
        let shot = Shot {
            seed: self.seed,
            number,
            seconds: number as f64 / self.scenario.fps,
            gain: self.gain * in_force(&self.scenario.camera.exposure, seconds),
            visible,
            sights,
        };
        match self.scenario.camera.layout {
            Layout::Camera => self.encode(self.exposure.eight_bits(&outlook.view, &light, &shot)),
            Layout::Patches => {
                let codes = self.exposure.sixteen_bits(&outlook.view, &light, &shot);
                let (left, right) = codes.split_at(codes.len() / 2);
                Ok(RawImages::Patches([self.patch(left)?, self.patch(right)?]))
            }
        }
    }

    /// What the camera sees at a time.
    fn outlook(&self, seconds: f64) -> &Outlook {
        let later = self.views.iter().skip(1).take_while(|outlook| seconds >= outlook.from_s).count();
        &self.views[later]
    }

    /// What the visible side's lamps, people and things make of each pixel.
    fn sights(&self, levels: &[f64], bodies: &[Body], visible: [f64; 3], outlook: &Outlook) -> Vec<Sight> {
        // Of the empty room: a body is not lit by the floor in its own shadow.
        let empty = match bodies {
            [] => Vec::new(),
            _ => self.hidden_light(levels, Cast::Unseen(Vec::new()), visible).0,
        };
        let half = self.scenario.doorway.half_width();
        let hidden = |[x, y]: Point| {
            let place = [x.clamp(0.02 - half, half - 0.02), y.clamp(-LIT_M, LIT_M)];
            let [a, b] = self.light.floor().taps(place).map(|tap| tap.of(&empty));
            [0, 1, 2].map(|c| f64::from(a[c] + b[c]))
        };
        let stage = Stage {
            doorway: &self.scenario.doorway,
            lamps: &self.lamps,
            ambient: 1.0 - self.scenario.visible.lamp.iter().map(|lamp| lamp.share).sum::<f64>(),
            bodies,
            visible,
            hidden: &hidden,
        };
        stage.sights(&outlook.view, outlook.camera.as_ref())
    }

    fn encode(&self, codes: Vec<u8>) -> Result<RawImages, String> {
        let camera = &self.scenario.camera;
        let [width, height] = camera.size;
        match camera.format {
            FrameFormat::Rgb => Ok(RawImages::Sensor(
                SensorFormat {
                    pixels: SensorPixels::Rgb24,
                    width,
                    height,
                    stride: 3 * width,
                    full_range: true,
                    matrix: LumaMatrix::Bt601,
                },
                Arc::new(codes),
            )),
            FrameFormat::Jpeg => {
                let image = Image { width, height, samples: Samples::Eight(codes) };
                doorcam_source::image::encode_jpeg(&image, camera.quality)
                    .map(|jpeg| RawImages::Camera(Arc::new(jpeg)))
                    .map_err(|e| e.to_string())
            }
            FrameFormat::Png => {
                let png = png(&codes, [width, height], ExtendedColorType::Rgb8)?;
                Ok(RawImages::Camera(Arc::new(png)))
            }
        }
    }

    fn patch(&self, codes: &[u16]) -> Result<Arc<Vec<u8>>, String> {
        let bytes: Vec<u8> = codes.iter().copied().flat_map(u16::to_ne_bytes).collect();
        png(&bytes, [patch_grid(&self.scenario.camera).size; 2], ExtendedColorType::Rgb16).map(Arc::new)
    }
}

fn png(samples: &[u8], [width, height]: [usize; 2], colour: ExtendedColorType) -> Result<Vec<u8>, String> {
    let mut png = Cursor::new(Vec::with_capacity(samples.len()));
    let size = |n: usize| u32::try_from(n).map_err(|e| e.to_string());
    PngEncoder::new_with_quality(&mut png, CompressionType::Fast, FilterType::Sub)
        .write_image(samples, size(width)?, size(height)?, colour)
        .map_err(|e| e.to_string())?;
    Ok(png.into_inner())
}

/// What the camera sees at first and after each bump.
fn outlooks(scenario: &Scenario, map: &FloorMap) -> Vec<Outlook> {
    let seen = Seen { doorway: &scenario.doorway, floor: &scenario.floor, wall: &scenario.wall, map };
    if scenario.camera.layout == Layout::Patches {
        return vec![Outlook { from_s: 0.0, camera: None, view: View::patches(&patch_grid(&scenario.camera), &seen) }];
    }
    let camera = Pinhole::new(&scenario.camera);
    let bumps = scenario.camera.bump.iter();
    let bumps = bumps.map(|&(t, right, down, turn_deg)| (t, Bump { shift: [right, down], turn_deg }));
    std::iter::once((f64::NEG_INFINITY, Bump::default()))
        .chain(bumps)
        .map(|(from_s, bump)| {
            let camera = camera.bumped(bump);
            Outlook { from_s, camera: Some(camera), view: View::picture(&camera, &seen) }
        })
        .collect()
}

/// Places whose light is needed whatever the camera sees: beside the edges, and where somebody may stand in the opening.
fn lit_places(doorway: &Doorway) -> impl Iterator<Item = Point> {
    let half = doorway.half_width();
    let reference = Side::BOTH.into_iter().flat_map(|side| REFERENCE.points(doorway, side));
    let opening = (0..=20).flat_map(move |i| {
        (0..=40).map(move |j| [half * (f64::from(i) / 10.0 - 1.0), LIT_M * (f64::from(j) / 20.0 - 1.0)])
    });
    reference.collect::<Vec<_>>().into_iter().chain(opening)
}

/// Mean light on the floor beside both edges.
fn mean_light(doorway: &Doorway, map: &FloorMap, nodes: &[[f32; 3]]) -> [f64; 3] {
    let points: Vec<Point> = Side::BOTH.into_iter().flat_map(|side| REFERENCE.points(doorway, side)).collect();
    let mut sum = [0.0; 3];
    for &point in &points {
        let [a, b] = map.taps(point).map(|tap| tap.of(nodes));
        (0..3).for_each(|c| sum[c] += f64::from(a[c] + b[c]) / points.len() as f64);
    }
    sum
}

fn manifest(scenario: &Scenario, seed: u64) -> Result<Manifest, String> {
    let camera = &scenario.camera;
    let notes = format!("Simulated: {}. Seed {seed}.", scenario.description.trim().trim_end_matches('.'));
    let pictures = camera.layout == Layout::Camera;
    let floor_points = if pictures { floor_points(&Pinhole::new(camera), &scenario.doorway) } else { Vec::new() };
    if pictures && floor_points.len() < LEAST_MARKS {
        return Err(format!(
            "camera sees {} of the 10 marks at the doorway's foot, expected at least {LEAST_MARKS}: check camera.at_m, \
             look_at_m and field_of_view_deg",
            floor_points.len()
        ));
    }
    Ok(Manifest {
        fps: scenario.fps,
        layout: camera.layout,
        transfer: if pictures { camera.transfer.clone() } else { Transfer::Linear },
        size: Some(if pictures { camera.size } else { [patch_grid(camera).size; 2] }),
        doorway: scenario.doorway,
        floor_points,
        lens: None,
        fov_m: (!pictures).then_some(camera.fov_m),
        background_frames: Some([0, scenario.background_frames()]),
        notes,
    })
}

#[cfg(test)]
#[path = "simulator_tests.rs"]
mod tests;
