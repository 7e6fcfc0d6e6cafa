//! Properties of the whole path from patch pairs to a map, in memory: what must not change a map, and what must.

use std::sync::Arc;

use doorcam_core::geometry::{Biangular, Doorway, Facet, Point, Side};
use doorcam_core::light::{Background, PatchPair};
use doorcam_core::scene::Intensity;
use doorcam_core::solver::Lambda;
use doorcam_core::solver::ModelKind;
use doorcam_engine::Settings;
use doorcam_engine::simulation::luminous::direct::Cylinder;
use doorcam_engine::simulation::luminous::{Renderer, Scenario, Sensor};
use doorcam_engine::{Model, Problem, Reconstruction, Reconstructor};
use rand_distr::{Distribution, StandardNormal};

/// The demo's room behind the narrowest door, for which the grid is the published one.
struct Room {
    scenario: Scenario,
    renderer: Renderer,
}

impl Room {
    fn new() -> Self {
        let mut scenario = Scenario::demo();
        scenario.doorway = Doorway { width_m: 0.508, wall_thickness_m: 0.0, height_m: None, leaf: None };
        Self { renderer: Renderer::new(&scenario), scenario }
    }

    fn model(&self, settings: &Settings) -> Arc<Model> {
        Arc::new(Model::new(settings, self.scenario.doorway, self.scenario.patch, None).unwrap())
    }

    /// A camera frame of this light; frames of one seed have different noise.
    fn expose(&self, light: &PatchPair, seed: u64, frame: u64) -> PatchPair {
        let mut generator = Sensor::generator(seed, frame);
        let mut pair = light.clone();
        for side in Side::BOTH {
            let codes = self.scenario.sensor.expose(light.side(side), &mut generator);
            for (k, code) in codes.into_iter().enumerate() {
                pair.side_mut(side).plane_mut(k % 3)[k / 3] = f32::from(code) / 65535.0;
            }
        }
        pair
    }

    /// Noisy frames of an empty room.
    fn empty_frames(&self, light: &PatchPair, seed: u64, count: u64) -> Vec<PatchPair> {
        (0..count).map(|frame| self.expose(light, seed, frame)).collect()
    }

    /// The change that a person off the grid makes, without noise.
    fn person(&self, [x, y]: Point, radiance: [f64; 3]) -> PatchPair {
        let body = Cylinder { centre: [x, y], radius_m: 0.2, height_m: 1.8, radiance };
        combine(&self.renderer.render(vec![body]), self.renderer.empty(), |there, empty| there - empty)
    }
}

const RED: [f64; 3] = [0.3, 0.1, 0.08];
/// Darker than every wall.
const BLACK: [f64; 3] = [0.005, 0.005, 0.01];
const SOMEWHERE: Point = [0.23, 1.37];
/// Light taken from the visible side's 0.8 of the demo, so that frames can become brighter without saturating.
const DIMMED: f32 = 0.3;

/// Two grid cells, in degrees of the bearing at either edge: the doorway is too narrow to locate a faint person's
/// distance much better.
const CLOSE: f64 = 8.0;

/// Combines each value of one pair with that of another.
fn combine(a: &PatchPair, b: &PatchPair, f: impl Fn(f32, f32) -> f32) -> PatchPair {
    let mut out = a.clone();
    for side in Side::BOTH {
        let values = out.side_mut(side).data_mut().iter_mut();
        values.zip(b.side(side).data()).for_each(|(a, &b)| *a = f(*a, b));
    }
    out
}

fn reconstructor(model: &Arc<Model>, empty: &[PatchPair]) -> Reconstructor {
    let mut reconstructor = Reconstructor::new(Arc::clone(model), false);
    empty.iter().for_each(|frame| reconstructor.learn(frame));
    reconstructor
}

fn mean(empty: &[PatchPair]) -> PatchPair {
    background(empty).mean().clone()
}

fn background(empty: &[PatchPair]) -> Background {
    let mut background = Background::new(empty[0].left.size());
    empty.iter().for_each(|frame| background.learn(frame));
    background
}

fn map(reconstructor: &mut Reconstructor, pair: &PatchPair) -> Reconstruction {
    reconstructor.reconstruct(pair).unwrap().expect("a background")
}

fn lit(intensities: &[Intensity]) -> Vec<usize> {
    (0..intensities.len()).filter(|&n| intensities[n].left != 0.0 || intensities[n].right != 0.0).collect()
}

/// Requires the same facets with the same light times `scale`, to 1e-3 of the strongest.
fn assert_same(found: &[Intensity], expected: &[Intensity], scale: f64, what: &str) {
    assert!(!lit(expected).is_empty(), "{what}: nothing is lit");
    assert_eq!(lit(found), lit(expected), "{what}");
    let allowed = 1e-3 * expected.iter().map(|i| i.left.hypot(i.right)).fold(0.0, f64::max) * scale;
    for (n, (found, expected)) in found.iter().zip(expected).enumerate() {
        for (a, b) in [(found.left, expected.left), (found.right, expected.right)] {
            for p in 0..3 {
                let difference = (a * found.colour[p] - scale * b * expected.colour[p]).abs();
                assert!(difference <= allowed, "{what}: facet {n}: {found:?}, expected {expected:?}");
            }
        }
    }
}

/// How far the strongest facet's bearings are from those of a point, in degrees: the larger of both edges'. None if no
/// facet is lit.
fn degrees_away(room: &Room, model: &Model, found: &[Intensity], from: Point) -> Option<f64> {
    let strength = |n: &usize| found[*n].left.min(found[*n].right);
    let strongest = lit(found).into_iter().max_by(|a, b| strength(a).total_cmp(&strength(b)))?;
    let [there, found] = [from, middle(&model.grid.facets[strongest])];
    let [there, found] = [there, found].map(|point| Biangular::from_point(&room.scenario.doorway, point));
    Some((found.alpha1 - there.alpha1).abs().max((found.alpha2 - there.alpha2).abs()).to_degrees())
}

fn middle(facet: &Facet) -> Point {
    [0, 1].map(|k| (facet.from[k] + facet.to[k]) / 2.0)
}

/// Exactly, because the frames differ only by f32 rounding.
#[test]
fn a_gain_of_the_camera_does_not_change_the_map() {
    let room = Room::new();
    let model = room.model(&Settings::default());
    for texture in [0.0, 0.02] {
        let floor = SpeckledFloor::new(&room, 1, texture);
        let empty = room.empty_frames(&floor.lighted(0.0, &PatchPair::zeros(64)), 1, 20);
        let background = mean(&empty);
        let mut reconstructor = reconstructor(&model, &empty);
        for (who, radiance) in [("red", RED), ("black", BLACK)] {
            let lighted = floor.lighted(0.0, &room.person(SOMEWHERE, radiance));
            for (what, seen) in [("no noise", lighted.clone()), ("noise", room.expose(&lighted, 1, 1000))] {
                let change = combine(&seen, &background, |x, x0| x - x0);
                let mut with_gain = |gain: f32| {
                    let frame = combine(&background, &change, |x0, change| gain * x0 + change);
                    map(&mut reconstructor, &frame).solution.intensities
                };
                let plain = with_gain(1.0);
                for gain in [0.8, 0.9, 0.97, 1.03, 1.1, 1.2] {
                    assert_same(&with_gain(gain), &plain, 1.0, &format!("{who}, {what}, {texture}, gain {gain}"));
                }
            }
        }
    }
}

#[test]
fn the_gain_is_reported_with_and_without_somebody_in_the_room() {
    /// Four standard deviations of the own picture's share in a frame with this noise.
    const NOISE: f64 = 5e-4;
    /// What the facets, as bright as measured, leave of a person's light, which changes the floor's by up to 9 percent.
    /// Neighbours' light is not refitted one by one, so up to a fifteenth of it counts as gain.
    const LEFT: f64 = 6e-3;

    let room = Room::new();
    let model = room.model(&Settings::default());
    let dimmed = combine(room.renderer.empty(), room.renderer.empty(), |light, _| light - DIMMED);
    let mut reconstructor = reconstructor(&model, &room.empty_frames(&dimmed, 40, 20));
    for (who, change, allowed) in [
        ("nobody", PatchPair::zeros(64), NOISE),
        ("red", room.person(SOMEWHERE, RED), LEFT),
        ("black", room.person(SOMEWHERE, BLACK), LEFT),
        ("close and bright", room.person([-0.2, 0.9], [0.5, 0.2, 0.1]), LEFT),
    ] {
        for (frame, gain) in (100..).zip([0.8_f32, 0.9, 1.0, 1.1, 1.2]) {
            let light = combine(&dimmed, &change, |light, change| gain * (light + change));
            let found = map(&mut reconstructor, &room.expose(&light, 40, frame));
            assert_eq!(lit(&found.solution.intensities).is_empty(), who == "nobody");
            let gains = found.gain.expect("the signed model knows gains");
            for found in gains.as_flattened() {
                assert!((found - f64::from(gain)).abs() < allowed, "{who}, gain {gain}: {gains:?}");
            }
        }
    }
    let mut settings = Settings::default();
    settings.solver.model = ModelKind::Published;
    let mut published = self::reconstructor(&room.model(&settings), std::slice::from_ref(&dimmed));
    assert_eq!(map(&mut published, &dimmed).gain, None);
}

/// As from a camera: each frame has noise of its own, according to its own brightness.
#[test]
fn exposure_steps_of_an_empty_room_show_nothing_whether_or_not_a_lamp_drifts() {
    /// Light of a lamp that is brighter farther from the wall; at full strength, at the far side of the patch.
    const LAMP: f32 = 0.02;

    let room = Room::new();
    let model = room.model(&Settings::default());
    let light = |strength: f32| {
        let mut pair = room.renderer.empty().clone();
        for side in Side::BOTH {
            for (k, value) in pair.side_mut(side).data_mut().iter_mut().enumerate() {
                let row = (k / 64 % 64) as f32 / 64.0;
                *value += strength * LAMP * row * row - DIMMED;
            }
        }
        pair
    };
    for (seed, drift) in (30..).zip([0.0, 1.0]) {
        let strength = |t: u64| drift * (0.7 * t as f32).sin();
        let frame = |gain: f32, t: u64| {
            let light = light(strength(t));
            room.expose(&combine(&light, &light, |light, _| gain * light), seed, t)
        };
        let empty: Vec<PatchPair> = (0..24).map(|t| frame(1.0, t)).collect();
        let mut reconstructor = reconstructor(&model, &empty);
        for (t, gain) in (100..200).zip([0.8, 0.9, 0.97, 1.03, 1.1, 1.2].into_iter().cycle()) {
            let found = map(&mut reconstructor, &frame(gain, t));
            let lit = lit(&found.solution.intensities);
            assert!(lit.is_empty(), "drift {drift}, frame {t}, gain {gain}: {lit:?}");
        }
    }
}

#[test]
fn a_mirrored_room_gives_the_mirrored_map() {
    fn mirror(pair: &PatchPair) -> PatchPair {
        let size = pair.left.size();
        let mut out = pair.clone();
        for (side, other) in [(Side::Left, Side::Right), (Side::Right, Side::Left)] {
            for channel in 0..3 {
                let plane = pair.side(other).plane(channel);
                let target = out.side_mut(side).plane_mut(channel);
                (0..size * size).for_each(|k| target[k] = plane[k / size * size + size - 1 - k % size]);
            }
        }
        out
    }

    let room = Room::new();
    // Choosing λ automatically draws noise, and the draws are not mirrored.
    let mut settings = Settings::default();
    settings.solver.lambda = Lambda::Fixed(20.0);
    let model = room.model(&settings);
    let facets = &model.grid.facets;
    let mirrored: Vec<usize> = facets
        .iter()
        .map(|facet| {
            let [x, y] = middle(facet);
            let at = |other: &Facet| (middle(other)[0] + x).hypot(middle(other)[1] - y) < 1e-9;
            facets.iter().position(at).expect("the grid is symmetric")
        })
        .collect();
    let empty = room.empty_frames(room.renderer.empty(), 2, 12);
    let frame = combine(&mean(&empty), &room.person(SOMEWHERE, RED), |x0, change| x0 + change);
    let there = map(&mut reconstructor(&model, &empty), &frame).solution.intensities;
    let empty: Vec<PatchPair> = empty.iter().map(mirror).collect();
    let back = map(&mut reconstructor(&model, &empty), &mirror(&frame)).solution.intensities;
    let expected: Vec<Intensity> = (0..facets.len())
        .map(|n| {
            let Intensity { left, right, colour } = there[mirrored[n]];
            Intensity { left: right, right: left, colour }
        })
        .collect();
    assert_same(&back, &expected, 1.0, "mirrored");
}

#[test]
fn no_difference_is_an_empty_map_in_every_model() {
    let room = Room::new();
    let empty = room.empty_frames(room.renderer.empty(), 3, 5);
    for kind in [ModelKind::Signed, ModelKind::Published] {
        let mut settings = Settings::default();
        settings.solver.model = kind;
        let found = map(&mut reconstructor(&room.model(&settings), &empty), &mean(&empty));
        assert!(lit(&found.solution.intensities).is_empty(), "{kind:?}");
        assert!(found.scene.nonzero().next().is_none());
    }
}

#[test]
fn a_value_that_is_no_number_is_refused_with_its_place_and_the_next_frame_is_fine() {
    let room = Room::new();
    let model = room.model(&Settings::default());
    let empty = room.empty_frames(room.renderer.empty(), 4, 8);
    let frame = combine(&mean(&empty), &room.person(SOMEWHERE, RED), |x0, change| x0 + change);
    let mut reconstructor = reconstructor(&model, &empty);
    let before = map(&mut reconstructor, &frame).solution;
    let mut broken = frame.clone();
    broken.right.plane_mut(1)[30 * 64 + 7] = f32::NAN;
    let error = reconstructor.reconstruct(&broken).unwrap_err().to_string();
    assert_eq!(error, "right patch, row 30, column 7: the green value is not a finite number");
    assert_eq!(map(&mut reconstructor, &frame).solution, before);
    // Pixels at the foot of the edge do not count.
    let mut foot = frame.clone();
    assert!(!model.counted[0][32]);
    foot.left.plane_mut(0)[32] = f32::NAN;
    assert_eq!(map(&mut reconstructor, &foot).solution, before);
}

#[test]
fn a_change_and_a_lambda_three_times_as_large_make_a_map_three_times_as_strong() {
    let room = Room::new();
    let empty = room.empty_frames(room.renderer.empty(), 5, 1);
    let change = room.person(SOMEWHERE, RED);
    let solve = |scale: f32| {
        let mut settings = Settings::default();
        settings.solver.model = ModelKind::Published;
        settings.solver.lambda = Lambda::Fixed(1e-3 * f64::from(scale));
        let frame = combine(&mean(&empty), &change, |x0, change| x0 + scale * change);
        map(&mut reconstructor(&room.model(&settings), &empty), &frame).solution.intensities
    };
    assert_same(&solve(3.0), &solve(1.0), 3.0, "three times");
}

/// With several backgrounds, because a background's remaining noise is the same in all its frames.
#[test]
fn an_empty_room_stays_empty_and_a_faint_person_is_found() {
    /// Frames of the empty room that are learned, for each background.
    const LEARNED: [u64; 6] = [10, 10, 15, 20, 30, 30];
    /// Frames of the empty room that are watched, for each background.
    const FRAMES: u64 = 520;
    /// How much stronger than just visible the person is: dual norm of the noiseless change over the least λ.
    const FAINT: f64 = 3.0;

    let room = Room::new();
    let model = room.model(&Settings::default());
    let light = room.renderer.empty();
    let (mut wrong, mut missed, mut looked_for) = (0, 0, 0);
    for (seed, learned) in (10..).zip(LEARNED) {
        let empty = room.empty_frames(light, seed, learned);
        let mut reconstructor = reconstructor(&model, &empty);
        for frame in 0..FRAMES {
            let found = map(&mut reconstructor, &room.expose(light, seed, 1000 + frame));
            wrong += u32::from(!lit(&found.solution.intensities).is_empty());
        }
        let problem = Problem::new(&model, &background(&empty), &PatchPair::zeros(64));
        for (who, radiance) in [("red", RED), ("black", BLACK)] {
            let change = room.person(SOMEWHERE, radiance);
            let mut correlations = problem.projection.correlations();
            problem.projection.project(&change, &mut correlations).unwrap();
            let scale = (FAINT * problem.lambda(&problem.projection.correlations(), 0.0)
                / problem.solver.lambda_max(&correlations)) as f32;
            let lighted = combine(light, &change, |x0, change| x0 + scale * change);
            for frame in 0..20 {
                let found = map(&mut reconstructor, &room.expose(&lighted, seed, 5000 + frame)).solution.intensities;
                let away = degrees_away(&room, &model, &found, SOMEWHERE);
                looked_for += 1;
                if away.is_none_or(|degrees| degrees > CLOSE) {
                    missed += 1;
                    eprintln!("{who}, seed {seed}, {learned} frames learned: strongest facet {away:?} degrees away");
                }
            }
        }
    }
    let frames = FRAMES * LEARNED.len() as u64;
    eprintln!("empty room: {wrong} of {frames} frames show something; {missed} of {looked_for} faint people missed");
    assert!(frames >= 3000 && f64::from(wrong) <= 1e-3 * frames as f64, "{wrong} of {frames}");
    assert_eq!(missed, 0);
}

/// A floor with its own speckle, in the light of an empty room with dimmed visible side.
struct SpeckledFloor {
    albedo: PatchPair,
    light: PatchPair,
}

impl SpeckledFloor {
    /// A floor with white speckle of this standard deviation per pixel.
    fn new(room: &Room, seed: u64, texture: f32) -> Self {
        let mut generator = Sensor::generator(seed, u64::MAX);
        let mut albedo = PatchPair::zeros(64);
        for side in Side::BOTH {
            for k in 0..64 * 64 {
                let z: f32 = StandardNormal.sample(&mut generator);
                (0..3).for_each(|p| albedo.side_mut(side).plane_mut(p)[k] = 1.0 + texture * z);
            }
        }
        Self { albedo, light: combine(room.renderer.empty(), room.renderer.empty(), |light, _| light - DIMMED) }
    }

    /// What the camera sees if a lamp of the visible side adds even light, and `change` comes from the room.
    fn lighted(&self, lamp: f32, change: &PatchPair) -> PatchPair {
        let light = combine(&self.light, change, |light, change| light + lamp + change);
        combine(&light, &self.albedo, |light, albedo| light * albedo)
    }
}

/// A fifth of the visible side's dimmed light.
const LAMP: f32 = 0.1;

#[test]
fn a_lamp_of_the_visible_side_on_a_speckled_floor_shows_nothing() {
    let room = Room::new();
    let model = room.model(&Settings::default());
    let nobody = PatchPair::zeros(64);
    for (texture, seeds) in [(0.02, 20..23), (0.05, 23..35), (0.1, 35..38)] {
        for seed in seeds {
            let floor = SpeckledFloor::new(&room, seed, texture);
            let mut reconstructor = reconstructor(&model, &room.empty_frames(&floor.lighted(0.0, &nobody), seed, 20));
            for (frame, lamp) in (1000..).zip([LAMP, -LAMP, 0.3 * LAMP, -0.3 * LAMP]) {
                let found = map(&mut reconstructor, &room.expose(&floor.lighted(lamp, &nobody), seed, frame));
                let lit = lit(&found.solution.intensities);
                assert!(lit.is_empty(), "texture {texture}, seed {seed}, lamp {lamp}: {lit:?}");
            }
        }
    }
}

#[test]
fn a_person_is_found_on_a_speckled_floor_while_a_lamp_has_changed() {
    let room = Room::new();
    let model = room.model(&Settings::default());
    for seed in 50..53 {
        let floor = SpeckledFloor::new(&room, seed, 0.05);
        let empty = room.empty_frames(&floor.lighted(0.0, &PatchPair::zeros(64)), seed, 20);
        let mut reconstructor = reconstructor(&model, &empty);
        for (who, radiance) in [("red", RED), ("black", BLACK)] {
            let person = room.person(SOMEWHERE, radiance);
            for (frame, lamp) in (1000..).zip([0.0, LAMP, -LAMP]) {
                let found = map(&mut reconstructor, &room.expose(&floor.lighted(lamp, &person), seed, frame));
                let away = degrees_away(&room, &model, &found.solution.intensities, SOMEWHERE);
                assert!(away.is_some_and(|degrees| degrees <= CLOSE), "{who}, seed {seed}, lamp {lamp}: {away:?}");
            }
        }
    }
}

/// A changed lamp raises λ; exposure steps, noise and people do not.
#[test]
fn only_a_change_of_even_light_costs_sensitivity() {
    let room = Room::new();
    let model = room.model(&Settings::default());
    let nobody = PatchPair::zeros(64);
    let floor = SpeckledFloor::new(&room, 60, 0.05);
    let still = floor.lighted(0.0, &nobody);
    let empty = room.empty_frames(&still, 60, 20);
    let problem = Problem::new(&model, &background(&empty), &PatchPair::zeros(64));
    let mut correlations = problem.projection.correlations();
    let least = problem.lambda(&correlations, 0.0);
    let mut raised = |light: &PatchPair, frame: u64| {
        let difference = combine(&room.expose(light, 60, frame), &mean(&empty), |x, x0| x - x0);
        problem.projection.project(&difference, &mut correlations).unwrap();
        problem.lambda(&correlations, 0.0) / least
    };
    for (frame, gain) in (100..).zip([0.8, 0.9, 1.0, 1.0, 1.1, 1.2]) {
        let ratio = raised(&combine(&still, &still, |light, _| gain * light), frame);
        assert!((1.0..1.02).contains(&ratio), "gain {gain}: {ratio}");
    }
    for radiance in [RED, BLACK] {
        let ratio = raised(&floor.lighted(0.0, &room.person(SOMEWHERE, radiance)), 150);
        assert!((1.0..1.1).contains(&ratio), "{radiance:?}: {ratio}");
    }
    let [half, whole] = [0.5, 1.0].map(|share| raised(&floor.lighted(share * LAMP, &nobody), 200));
    assert!(1.5 < half && half < whole && whole < 6.0, "{half} {whole}");
}
