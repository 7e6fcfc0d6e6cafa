//! Compares the light with sums over points of lights, windows and bodies that share only the scenario with it.

use super::super::super::scenario::{SMALLEST, Scenario};
use super::super::super::visible::{Body, Looks, pose};
use super::super::super::{Walk, floor::FloorMap};
use super::*;
use doorcam_core::geometry::Point;

#[path = "exchange_tests.rs"]
mod exchange;

/// A room whose surfaces reflect nothing, without lamps; `more` is added before its visible side.
fn black(more: &str) -> Scenario {
    let start = SMALLEST.find("[[lamp]]").unwrap();
    let end = SMALLEST.find("[visible]").unwrap();
    let text = format!("{}{more}\n{}", &SMALLEST[..start], &SMALLEST[end..]);
    let mut scenario = Scenario::parse(&text).unwrap_or_else(|e| panic!("{e}\n{text}"));
    let albedo = &mut scenario.room.albedo;
    for surface in [
        &mut albedo.left,
        &mut albedo.back,
        &mut albedo.right,
        &mut albedo.front,
        &mut albedo.floor,
        &mut albedo.ceiling,
    ] {
        *surface = [0.0; 3];
    }
    scenario
}

/// At the floor points of the tests and those mirrored.
fn light_of(scenario: &Scenario) -> OrdinaryLight {
    let floor = FloorMap::new(scenario.doorway);
    let places = POINTS.into_iter().flat_map(|[x, y]| [[x, y], [-x, y]]);
    let taps: Vec<Tap> = places.flat_map(|place| floor.taps(place)).collect();
    OrdinaryLight::new(scenario, floor, taps.into_iter())
}

fn at(light: &OrdinaryLight, nodes: &[[f32; 3]], point: Point) -> Rgb {
    let [a, b] = light.floor().taps(point).map(|tap| tap.of(nodes));
    [0, 1, 2].map(|c| f64::from(a[c]) + f64::from(b[c]))
}

fn walker(at: Point) -> Body {
    let looks = Looks { radius: 0.2, height: 1.75, clothes: [0.5; 3], trousers: [0.3; 3], skin: [0.4; 3] };
    let way = vec![(0.0, [at[0] - 1.0, at[1]]), (1.0, at), (2.0, [at[0] + 1.0, at[1] + 0.3])];
    Body::person(&looks, &pose(&Walk { waypoints: way, period_s: None }, 1.0).unwrap())
}

fn dressed(mut person: Person, albedo: Rgb) -> Person {
    person.parts.iter_mut().chain(&mut person.shade).for_each(|(_, colour)| *colour = albedo);
    person
}

const POINTS: [Point; 9] = [
    [-0.7, -0.2],
    [-0.52, -0.13],
    [-0.45, -0.3],
    [-0.41, -0.5],
    [0.0, -0.3],
    [0.2, -0.15],
    [0.46, -0.14],
    [0.55, -0.35],
    [0.75, -0.25],
];

/// A light as many small pieces: place, normal (none: to all sides alike), area.
type Pieces = Vec<([f64; 3], Option<[f64; 3]>, f64)>;

fn rectangle(corner: [f64; 3], along: [f64; 3], up: [f64; 3], normal: [f64; 3]) -> Pieces {
    let n = 60;
    let length = |v: [f64; 3]| (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
    let area = length(along) * length(up) / f64::from(n * n);
    (0..n * n)
        .map(|k| {
            let (a, b) = ((f64::from(k % n) + 0.5) / f64::from(n), (f64::from(k / n) + 0.5) / f64::from(n));
            ([0, 1, 2].map(|c| corner[c] + a * along[c] + b * up[c]), Some(normal), area)
        })
        .collect()
}

fn disc(centre: [f64; 3], radius: f64) -> Pieces {
    rectangle(
        [centre[0] - radius, centre[1] - radius, centre[2]],
        [2.0 * radius, 0.0, 0.0],
        [0.0, 2.0 * radius, 0.0],
        [0.0, 0.0, -1.0],
    )
    .into_iter()
    .filter(|(at, ..)| (at[0] - centre[0]).hypot(at[1] - centre[1]) < radius)
    .collect()
}

/// The outside of a ball.
fn ball(centre: [f64; 3], radius: f64) -> Pieces {
    let n = 90;
    (0..n * n)
        .map(|k| {
            let (turn, z) = (
                f64::from(k % n) / f64::from(n) * std::f64::consts::TAU,
                (f64::from(k / n) + 0.5) / f64::from(n) * 2.0 - 1.0,
            );
            let level = (1.0 - z * z).sqrt();
            let normal = [level * turn.cos(), level * turn.sin(), z];
            let area = 4.0 * PI * radius * radius / f64::from(n * n);
            ([0, 1, 2].map(|c| centre[c] + radius * normal[c]), Some(normal), area)
        })
        .collect()
}

/// Whether a way is free: the opening point by point, boxes by marching, people by the distance to each limb's line.
struct Ways<'a> {
    scenario: &'a Scenario,
    bodies: &'a [Body],
}

fn apart(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f64>().sqrt()
}

impl Ways<'_> {
    fn in_solid(&self, [x, y, z]: [f64; 3]) -> bool {
        let within = |[from, to]: [f64; 2], at: f64| at > from && at < to;
        let furniture =
            self.scenario.furniture.iter().any(|f| within(f.x_m, x) && within(f.y_m, y) && within(f.up_m, z));
        let leaf = self.scenario.leaf.is_some_and(|leaf| {
            // Its middle line, 4 cm thick.
            let side = if leaf.hinge == doorcam_core::geometry::Side::Left { -1.0 } else { 1.0 };
            let angle = leaf.angle_deg.to_radians();
            let d = [x - side * (self.scenario.doorway.half_width() + 0.01), y - 0.01];
            let along = -side * angle.cos() * d[0] + angle.sin() * d[1];
            let across = angle.sin() * d[0] + side * angle.cos() * d[1];
            (0.0..leaf.width_m).contains(&along) && across.abs() < 0.02 && z < leaf.height_m
        });
        furniture || leaf
    }

    fn free(&self, from: [f64; 3], to: [f64; 3]) -> bool {
        let at = |t: f64| [0, 1, 2].map(|k| from[k] + t * (to[k] - from[k]));
        let door = &self.scenario.doorway;
        let open = [-door.wall_thickness_m, 0.0].into_iter().all(|face| {
            let [x, _, z] = at((face - from[1]) / (to[1] - from[1]));
            x.abs() < door.half_width() && z < door.height_m.unwrap_or(self.scenario.room.ceiling_m)
        });
        if from[1] < 0.0 && !open {
            return false;
        }
        let solid = !self.scenario.furniture.is_empty() || self.scenario.leaf.is_some();
        if solid && (1..400).any(|k| self.in_solid(at(f64::from(k) / 400.0))) {
            return false;
        }
        !self.bodies.iter().flat_map(Body::capsules).any(|(capsule, _)| {
            // Nearest approach of the two lines, by halving: the distance from the way to the limb is convex.
            let from_limb = |t: f64| {
                let p = at(t);
                let axis = [0, 1, 2].map(|k| capsule.to[k] - capsule.from[k]);
                let dot = (0..3).map(|k| (p[k] - capsule.from[k]) * axis[k]).sum::<f64>();
                let share = (dot / axis.iter().map(|a| a * a).sum::<f64>()).clamp(0.0, 1.0);
                apart(p, [0, 1, 2].map(|k| capsule.from[k] + share * axis[k]))
            };
            let (mut low, mut high) = (0.0, 1.0);
            for _ in 0..30 {
                let (a, b) = (low + (high - low) / 3.0, high - (high - low) / 3.0);
                if from_limb(a) < from_limb(b) { high = b } else { low = a }
            }
            from_limb(low) < capsule.radius
        })
    }

    /// Σ cos cos dA / d² of a light of radiance 1, with a camera's view of the floor if that is glossy.
    fn light(&self, place: [f64; 3], normal: [f64; 3], pieces: &Pieces) -> f64 {
        let floor = &self.scenario.floor;
        pieces
            .iter()
            .map(|(at, out, area)| {
                let d = [0, 1, 2].map(|k| at[k] - place[k]);
                let range = apart(*at, place);
                let facing = (0..3).map(|k| d[k] * normal[k]).sum::<f64>() / range;
                let shining = out.map_or(1.0, |out| -(0..3).map(|k| d[k] * out[k]).sum::<f64>() / range);
                if facing <= 0.0 || shining <= 0.0 || !self.free(place, *at) {
                    return 0.0;
                }
                let gloss = if floor.gloss > 0.0 { self.lobe(place, d.map(|c| c / range)) } else { 0.0 };
                (1.0 + gloss) * facing * shining * area / (range * range)
            })
            .sum()
    }

    /// A GGX lobe by its textbook formula (Walter et al. 2007), times π / ρ.
    fn lobe(&self, place: [f64; 3], light: [f64; 3]) -> f64 {
        let floor = &self.scenario.floor;
        let eye = self.scenario.camera.at_m;
        let range = apart(eye, place);
        let eye = [0, 1, 2].map(|k| (eye[k] - place[k]) / range);
        let half = [0, 1, 2].map(|k| eye[k] + light[k]);
        let half = half.map(|c| c / apart(half, [0.0; 3]));
        let tan2 = 1.0 / (half[2] * half[2]) - 1.0;
        let a2 = floor.roughness.powi(2);
        let spread = a2 / (PI * half[2].powi(4) * (a2 + tan2).powi(2));
        let fresnel =
            floor.gloss + (1.0 - floor.gloss) * (1.0 - (0..3).map(|k| half[k] * light[k]).sum::<f64>()).powi(5);
        let smith = |z: f64| (-1.0 + (1.0 + a2 * (1.0 / (z * z) - 1.0)).sqrt()) / 2.0;
        let masked = 1.0 / (1.0 + smith(light[2]) + smith(eye[2]));
        spread * fresnel * masked / (4.0 * light[2] * eye[2]) * PI / (floor.albedo.iter().sum::<f64>() / 3.0)
    }
}

const WINDOW: &str = "[[window]]\nwall = \"back\"\nalong_m = [-0.3, 0.9]\nup_m = [0.9, 2.1]\nsky = [1, 1, 1]\n";
const TABLE: &str = "[[furniture]]\nx_m = [0.3, 1.1]\ny_m = [1.6, 2.3]\nup_m = [0.7, 1.0]\nalbedo = [0, 0, 0]\n";
const LEAF: &str = "[leaf]\nhinge = \"left\"\nangle_deg = 97\nwidth_m = 0.78\nalbedo = [0, 0, 0]\n";

/// Every kind of light, each alone and with something that stands in its way, and what it lets through.
fn kinds() -> Vec<(&'static str, Scenario, Pieces)> {
    let window = || rectangle([-0.3, 3.0, 0.9], [1.2, 0.0, 0.0], [0.0, 0.0, 1.2], [0.0, -1.0, 0.0]);
    let side = "[[television]]\nwall = \"right\"\nalong_m = [1.2, 2.4]\nup_m = [0.8, 1.5]\nrgb = [1, 1, 1]\n";
    let panel = "[[lamp]]\nkind = \"panel\"\nat_m = [0.2, 1.6, 2.3]\nradius_m = 0.3\nsize_m = [0.6, 1.0]\nrgb = [0.6, 0.6, 0.6]\n";
    let round = "[[furniture]]\nx_m = [1.2, 1.4]\ny_m = [0.2, 0.4]\nup_m = [0, 0.1]\nalbedo = [0, 0, 0]\n[[lamp]]\nkind = \"panel\"\nat_m = [0.1, 1.5, 2.2]\nradius_m = 0.3\nrgb = [0.28274, 0.28274, 0.28274]\n";
    let bulb = "[[furniture]]\nx_m = [1.2, 1.4]\ny_m = [0.2, 0.4]\nup_m = [0, 0.1]\nalbedo = [0, 0, 0]\n[[lamp]]\nkind = \"bulb\"\nat_m = [-0.2, 1.7, 1.5]\nradius_m = 0.18\nrgb = [0.101788, 0.101788, 0.101788]\n";
    let wall = "[[lamp]]\nkind = \"panel\"\nat_m = [0.4, 2.5, 1.4]\nradius_m = 0.3\nsize_m = [0.5, 0.4]\nfaces = \"front\"\nrgb = [0.2, 0.2, 0.2]\n";
    let under = |mut scenario: Scenario| {
        scenario.doorway.height_m = Some(1.3);
        scenario
    };
    let glossy = |mut scenario: Scenario| {
        (scenario.floor.gloss, scenario.floor.roughness) = (0.06, 0.3);
        scenario
    };
    vec![
        ("a window", black(WINDOW), window()),
        ("a window behind a table", black(&format!("{WINDOW}{TABLE}")), window()),
        ("a window beside a leaf", black(&format!("{WINDOW}{LEAF}")), window()),
        ("a window under a lintel", under(black(WINDOW)), window()),
        ("a window on a glossy floor", glossy(black(WINDOW)), window()),
        ("a television", black(side), rectangle([1.5, 1.2, 0.8], [0.0, 1.2, 0.0], [0.0, 0.0, 0.7], [-1.0, 0.0, 0.0])),
        (
            "a ceiling panel",
            black(panel),
            rectangle([-0.1, 1.1, 2.3], [0.6, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]),
        ),
        ("a round panel", black(round), disc([0.1, 1.5, 2.2], 0.3)),
        ("a bulb", black(bulb), ball([-0.2, 1.7, 1.5], 0.18)),
        (
            "an upright panel",
            black(wall),
            rectangle([0.15, 2.5, 1.2], [0.5, 0.0, 0.0], [0.0, 0.0, 0.4], [0.0, -1.0, 0.0]),
        ),
    ]
}

/// In the empty room, and past somebody in black with legs and arms.
#[test]
fn the_light_of_each_source_equals_the_literal_sum_over_its_face() {
    let (mut worst, mut worst_change) = (0.0_f64, 0.0_f64);
    for (name, scenario, pieces) in kinds() {
        let light = light_of(&scenario);
        // Where somebody is before it.
        let bodies = [walker(if name == "a television" { [0.9, 1.2] } else { [0.05, 1.15] })];
        let levels = light.levels(0.0, None, 1);
        let empty = light.light(&levels, Vec::new(), [0.0; 3]);
        let people = vec![dressed(Person::body(&bodies[0]), [0.0; 3])];
        let with = light.light(&levels, people, [0.0; 3]);
        let up = [0.0, 0.0, 1.0];
        let most = POINTS.map(|p| at(&light, &empty, p)[1]).into_iter().fold(0.0, f64::max);
        let mut hidden = 0;
        for [x, y] in POINTS {
            let nobody = Ways { scenario: &scenario, bodies: &[] }.light([x, y, 0.0], up, &pieces);
            let somebody = Ways { scenario: &scenario, bodies: &bodies }.light([x, y, 0.0], up, &pieces);
            let (found, changed) = (at(&light, &empty, [x, y])[1], at(&light, &with, [x, y])[1]);
            println!("{name} [{x}, {y}]: {nobody:.5} {found:.5}, {:.5} {:.5}", nobody - somebody, found - changed);
            worst = worst.max((found - nobody).abs() / most);
            worst_change = worst_change.max((found - changed - nobody + somebody).abs() / most);
            // Fans' straight lines are worst at the edges' feet, and where something else throws a sharp shadow.
            assert!((found - nobody).abs() < 0.02 * nobody + 0.03 * most, "{name} [{x}, {y}]: {found} {nobody}");
            let (change, expected) = (found - changed, nobody - somebody);
            assert!(
                (change - expected).abs() < 0.06 * expected + 0.04 * most,
                "{name} [{x}, {y}]: {change} {expected} of {most}"
            );
            hidden += i32::from(expected > 0.02 * most);
        }
        assert!(hidden > 0, "{name}: nobody hides anything");
    }
    println!("worst {worst}, worst change {worst_change}");
}
