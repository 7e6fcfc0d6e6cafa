//! Compares the light with sums over dense rays, which share only the scenario: no texels, fans, wedges or outlines.

use super::super::scenario::{PersonSpec, SMALLEST};
use super::*;

fn person(x: f64, y: f64, clothes: Rgb) -> PersonSpec {
    let walk = vec![(0.0, x, y)];
    PersonSpec {
        radius_m: 0.2,
        height_m: 1.75,
        clothes,
        skin: [0.5, 0.4, 0.3],
        trousers: None,
        limbs: false,
        walk,
        repeat_s: None,
    }
}

fn figures(people: &[PersonSpec]) -> Vec<Figure> {
    people.iter().map(|p| Figure::new([p.walk[0].1, p.walk[0].2], p.radius_m, p.height_m, p.clothes, p.skin)).collect()
}

fn scenario() -> Scenario {
    Scenario::parse(SMALLEST).unwrap()
}

fn at(light: &RoomLight, nodes: &[[f32; 3]], point: Point) -> Rgb {
    let [a, b] = light.floor().taps(point).map(|tap| tap.of(nodes));
    [0, 1, 2].map(|c| f64::from(a[c]) + f64::from(b[c]))
}

/// Floor points beside, below and in front of the opening, near and far.
const POINTS: [Point; 8] = [
    [-0.52, -0.13],
    [-0.45, -0.25],
    [-0.3, -0.18],
    [-0.41, -0.36],
    [0.0, -0.3],
    [0.35, -0.2],
    [0.48, -0.14],
    [0.5, -0.33],
];

/// A literal version of the scene that finds what each single ray meets.
struct Literal<'a> {
    scenario: &'a Scenario,
    people: &'a [PersonSpec],
    ambient: Rgb,
}

enum Met {
    Nothing,
    Surface { at: [f64; 3], normal: [f64; 3], albedo: Rgb },
}

impl Literal<'_> {
    /// The first person along a ray, by the quadratic equation of its cylinders: distance, normal, albedo.
    fn person(&self, from: [f64; 3], ray: [f64; 3], limit: f64) -> Option<(f64, [f64; 3], Rgb)> {
        let mut first: Option<(f64, [f64; 3], Rgb)> = None;
        for p in self.people {
            let (_, x, y) = p.walk[0];
            let body = (p.radius_m, 0.0, p.height_m - 0.25, p.clothes);
            let head = (0.09, p.height_m - 0.25, p.height_m, p.skin);
            for (radius, bottom, top, albedo) in [body, head] {
                let d = [from[0] - x, from[1] - y];
                let a = ray[0] * ray[0] + ray[1] * ray[1];
                let b = d[0] * ray[0] + d[1] * ray[1];
                let c = d[0] * d[0] + d[1] * d[1] - radius * radius;
                let root = b * b - a * c;
                if root <= 0.0 {
                    continue;
                }
                let t = (-b - root.sqrt()) / a;
                let z = from[2] + t * ray[2];
                if t > 1e-6 && t < limit && (bottom..top).contains(&z) && first.is_none_or(|(nearest, ..)| t < nearest)
                {
                    let normal = [(d[0] + t * ray[0]) / radius, (d[1] + t * ray[1]) / radius, 0.0];
                    first = Some((t, normal, albedo));
                }
                // From above into the top face.
                let t = (top - from[2]) / ray[2];
                let beside = (d[0] + t * ray[0]).hypot(d[1] + t * ray[1]);
                if ray[2] < 0.0 && t > 1e-6 && t < limit && beside < radius && first.is_none_or(|(n, ..)| t < n) {
                    first = Some((t, [0.0, 0.0, 1.0], albedo));
                }
            }
        }
        first
    }

    /// What a ray from the floor of the visible side meets.
    fn meet(&self, [x, y]: Point, ray: [f64; 3]) -> Met {
        let doorway = &self.scenario.doorway;
        for face in [-doorway.wall_thickness_m, 0.0] {
            let t = (face - y) / ray[1];
            if t <= 0.0 || (x + t * ray[0]).abs() >= doorway.half_width() {
                return Met::Nothing;
            }
            if t * ray[2] > doorway.height_m.unwrap_or(self.scenario.room.ceiling_m) {
                return Met::Nothing;
            }
        }
        let room = &self.scenario.room;
        let albedo = &room.albedo;
        let planes = [
            ((-room.half_width_m - x) / ray[0], [1.0, 0.0, 0.0], albedo.left),
            ((room.depth_m - y) / ray[1], [0.0, -1.0, 0.0], albedo.back),
            ((room.half_width_m - x) / ray[0], [-1.0, 0.0, 0.0], albedo.right),
            (room.ceiling_m / ray[2], [0.0, 0.0, -1.0], albedo.ceiling),
        ];
        let (t, normal, colour) =
            planes.into_iter().filter(|(t, ..)| *t > 0.0).min_by(|a, b| a.0.total_cmp(&b.0)).unwrap();
        let from = [x, y, 0.0];
        let (t, normal, albedo) = self.person(from, ray, t).unwrap_or((t, normal, colour));
        Met::Surface { at: [0, 1, 2].map(|k| from[k] + t * ray[k]), normal, albedo }
    }

    /// Radiance of a surface, with lamps as points.
    fn radiance(&self, at: [f64; 3], normal: [f64; 3], albedo: Rgb) -> Rgb {
        let mut light = self.ambient;
        for lamp in &self.scenario.lamp {
            let d = [0, 1, 2].map(|k| lamp.at_m[k] - at[k]);
            let d2 = d.iter().map(|x| x * x).sum::<f64>();
            let facing = (0..3).map(|k| d[k] * normal[k]).sum::<f64>() / d2.sqrt();
            let from = [0, 1, 2].map(|k| at[k] + 1e-6 * normal[k]);
            if facing > 0.0 && self.person(from, d, 1.0).is_none() {
                (0..3).for_each(|c| light[c] += lamp.rgb[c] * facing / d2);
            }
        }
        [0, 1, 2].map(|c| albedo[c] / PI * light[c])
    }

    /// Σ L cos ϑ Δω over n x n rays, evenly spaced in azimuth and in sin² of the elevation.
    fn light(&self, point: Point, n: usize) -> Rgb {
        let mut sum = [0.0; 3];
        for k in 0..n * n {
            let phi = ((k % n) as f64 + 0.5) / n as f64 * PI - PI / 2.0;
            let s = ((k / n) as f64 + 0.5) / n as f64;
            let ray = [phi.sin() * (1.0 - s).sqrt(), phi.cos() * (1.0 - s).sqrt(), s.sqrt()];
            if let Met::Surface { at, normal, albedo } = self.meet(point, ray) {
                let shown = self.radiance(at, normal, albedo);
                (0..3).for_each(|c| sum[c] += shown[c] * 0.5 * PI / (n * n) as f64);
            }
        }
        sum
    }
}

/// The bounced light of a lamp that the floor points do not see, compared with the literal sum: the empty room, one
/// person, one behind another, and a lintel. The errors of the sums, due to steps of 1/900 of the half turn and texels
/// of 0.1 m, are far below these bounds.
#[test]
fn the_light_equals_the_literal_sum_over_rays() {
    let mut scenario = scenario();
    scenario.lamp[0].at_m = [1.2, 0.15, 2.1];
    scenario.lamp[0].radius_m = 0.02;
    let red = person(-0.35, 1.3, [0.7, 0.1, 0.1]);
    let before = person(0.1, 1.0, [0.1, 0.2, 0.6]);
    let behind = person(0.25, 1.9, [0.7, 0.7, 0.2]);
    for (height_m, people) in
        [(None, vec![]), (None, vec![red]), (None, vec![before.clone(), behind]), (Some(1.9), vec![before])]
    {
        scenario.doorway.height_m = height_m;
        let light = RoomLight::new(&scenario);
        let empty = light.light(&[1.0], Vec::new(), [0.0; 3]);
        let nodes = light.light(&[1.0], figures(&people), [0.0; 3]);
        let ambient = light.ambient[0];
        let n = 900;
        for point in POINTS {
            let literal = |people: &[PersonSpec]| Literal { scenario: &scenario, people, ambient }.light(point, n);
            let (nobody, somebody) = (literal(&[]), literal(&people));
            let direct = at_direct(&light, point);
            let (found_nobody, found) = (at(&light, &empty, point), at(&light, &nodes, point));
            for c in 0..3 {
                let ours = found_nobody[c] - direct[c];
                // The straight lines of a fan are worst at the edges' feet.
                assert!((ours / nobody[c] - 1.0).abs() < 0.012, "{point:?} {c}: {ours} {}", nobody[c]);
                let (change, expected) = (found[c] - found_nobody[c], somebody[c] - nobody[c]);
                assert!(
                    (change - expected).abs() < 0.0025 * nobody[c] + 0.05 * expected.abs(),
                    "{} people, {point:?} {c}: {} {}",
                    people.len(),
                    change / nobody[c],
                    expected / nobody[c]
                );
            }
        }
    }
}

/// The lamp's direct light in the empty room.
fn at_direct(light: &RoomLight, point: Point) -> Rgb {
    let nodes: Vec<Rgb> = light.seen[0].iter().map(|&s| light.lamps[0].intensity.map(|i| i * s)).collect();
    at(light, &light.floor.refine(&nodes), point)
}

/// A lamp in the middle of the room, seen from the floor, compared with rays to points spread over the lamp.
#[test]
fn a_lamps_direct_light_equals_the_literal_mean_over_its_face() {
    let mut scenario = scenario();
    scenario.doorway.height_m = Some(2.0);
    scenario.lamp[0].at_m = [0.3, 1.5, 2.0];
    scenario.lamp[0].radius_m = 0.1;
    let light = RoomLight::new(&scenario);
    let (mut whole, mut none, mut partial) = (0, 0, 0);
    for k in 0..600 {
        let point = [-0.8 + 0.8 / 300.0 * f64::from(k), -0.25];
        let [x, y] = point;
        let range = (0.3 - x).hypot(1.5 - y);
        let across = [(1.5 - y) / range, -(0.3 - x) / range];
        let n = 40;
        let (mut seen, mut all) = (0.0, 0.0);
        for k in 0..n * n {
            let [a, b] = [k / n, k % n].map(|i| (2.0 * (i as f64 + 0.5) / n as f64 - 1.0) * 0.1);
            if a.hypot(b) > 0.1 {
                continue;
            }
            let to = [0.3 + a * across[0] - x, 1.5 + a * across[1] - y, 2.0 + b];
            let free = [-0.1, 0.0].iter().all(|face| {
                let t = (face - y) / to[1];
                (x + t * to[0]).abs() < 0.4 && t * to[2] < 2.0
            });
            seen += f64::from(u8::from(free));
            all += 1.0;
        }
        let d2 = range * range + 4.0;
        let expected = seen / all * 2.0 / d2.powf(1.5);
        let found = at_direct(&light, point)[0];
        let most = 2.0 / d2.powf(1.5);
        // A fan's step is an eighth of the lamp.
        assert!((found - expected).abs() < 0.12 * most, "{point:?}: {} {}", found / most, expected / most);
        whole += i32::from(seen == all);
        none += i32::from(seen == 0.0);
        partial += i32::from(seen > 0.0 && seen < all);
    }
    assert!(whole > 100 && none > 100 && partial > 10, "{whole} {none} {partial}");
}

#[test]
fn a_mirrored_room_gives_mirrored_light() {
    let mut scenario = scenario();
    scenario.doorway.height_m = Some(2.0);
    let people = [person(-0.35, 1.3, [0.7, 0.1, 0.1]), person(0.6, 1.9, [0.1, 0.2, 0.6])];
    let light = RoomLight::new(&scenario);
    let nodes = light.light(&[1.0], figures(&people), [0.0; 3]);
    let albedo = &mut scenario.room.albedo;
    std::mem::swap(&mut albedo.left, &mut albedo.right);
    scenario.lamp[0].at_m[0] *= -1.0;
    let mirrored = people.clone().map(|mut p| {
        p.walk[0].1 *= -1.0;
        p
    });
    let other = RoomLight::new(&scenario);
    let flipped = other.light(&[1.0], figures(&mirrored), [0.0; 3]);
    let mut asymmetry = 0.0_f64;
    for [x, y] in POINTS.into_iter().chain([[0.2, -0.05], [0.1, 0.2]]) {
        let (a, b, here) = (at(&light, &nodes, [x, y]), at(&other, &flipped, [-x, y]), at(&light, &nodes, [-x, y]));
        for c in 0..3 {
            assert!((a[c] - b[c]).abs() < 1e-5 * a[c].max(0.01), "{x} {y}: {a:?} {b:?}");
            asymmetry = asymmetry.max((a[c] - here[c]).abs() / a[c].max(0.01));
        }
    }
    assert!(asymmetry > 0.05, "the room is not its own mirror image: {asymmetry}");
}

#[test]
fn light_is_linear_in_each_lamps_level() {
    let mut scenario = scenario();
    let mut second = scenario.lamp[0].clone();
    (second.at_m, second.rgb) = ([-1.1, 2.0, 1.2], [0.3, 0.5, 0.9]);
    scenario.lamp.push(second);
    let light = RoomLight::new(&scenario);
    let people = [person(-0.2, 1.2, [0.7, 0.1, 0.1]), person(0.5, 1.5, [0.3, 0.3, 0.3])];
    let nodes = |levels: [f64; 2]| light.light(&levels, figures(&people), [0.0; 3]);
    let (one, other, both) = (nodes([1.0, 0.0]), nodes([0.0, 1.0]), nodes([0.5, 2.0]));
    for point in POINTS {
        let [one, other, both] = [&one, &other, &both].map(|nodes| at(&light, nodes, point));
        for c in 0..3 {
            assert!((0.5 * one[c] + 2.0 * other[c] - both[c]).abs() < 1e-5 * both[c].max(0.01));
        }
    }
}

#[test]
fn who_is_outside_or_hidden_behind_another_changes_nothing_and_an_empty_room_is_exactly_itself() {
    let mut scenario = scenario();
    scenario.lamp[0].at_m = [0.0, 0.2, 1.8];
    let light = RoomLight::new(&scenario);
    let empty = light.light(&[1.0], Vec::new(), [0.0; 3]);
    assert_eq!(empty, light.light(&[1.0], Vec::new(), [0.0; 3]));
    assert_eq!(empty, light.light(&[1.0], figures(&[person(-1.9, 1.2, [0.9; 3])]), [0.0; 3]));
    // Thin and low, in the shadow of the other person, and so close behind that no floor point sees them.
    let front = PersonSpec { radius_m: 0.35, ..person(0.0, 1.2, [0.2, 0.3, 0.4]) };
    let mut behind = person(-0.05, 1.7, [0.9, 0.1, 0.1]);
    (behind.radius_m, behind.height_m) = (0.12, 0.8);
    let (alone, both) = (
        light.light(&[1.0], figures(std::slice::from_ref(&front)), [0.0; 3]),
        light.light(&[1.0], figures(&[front.clone(), behind.clone()]), [0.0; 3]),
    );
    let hidden = light.light(&[1.0], figures(&[behind]), [0.0; 3]);
    let change = |a: &[[f32; 3]], b: &[[f32; 3]], point: Point| {
        let (a, b) = (at(&light, a, point), at(&light, b, point));
        (0..3).map(|c| (a[c] - b[c]).abs() / a[c]).fold(0.0, f64::max)
    };
    let points = [[-0.3, -0.2], [0.0, -0.2], [0.3, -0.2]];
    for point in points {
        let (unseen, seen) = (change(&alone, &both, point), change(&empty, &hidden, point));
        assert!(seen > 1e-3 && unseen < 0.05 * seen, "{point:?}: {unseen} {seen}");
    }
}
