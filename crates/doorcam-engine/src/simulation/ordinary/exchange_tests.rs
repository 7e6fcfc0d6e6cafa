//! What surfaces and bodies make of the light: each term against a sum over points, and what must hold for all.

use super::*;

/// All that sources give is absorbed somewhere.
#[test]
fn a_closed_room_absorbs_what_its_sources_give() {
    let text =
        format!("{WINDOW}{TABLE}[[lamp]]\nkind = \"bulb\"\nat_m = [-0.9, 0.9, 1.9]\nradius_m = 0.1\nrgb = [1, 1, 1]\n");
    let mut scenario = black(&text);
    scenario.furniture[0].albedo = [0.5; 3];
    scenario.room.albedo.left = [0.7; 3];
    scenario.room.albedo.back = [0.6; 3];
    scenario.room.albedo.right = [0.5; 3];
    scenario.room.albedo.front = [0.6; 3];
    scenario.room.albedo.floor = [0.4; 3];
    scenario.room.albedo.ceiling = [0.8; 3];
    let light = light_of(&scenario);
    for (source, shown) in light.exchange.patches.iter().enumerate() {
        let given: f64 = light.tiles.iter().filter(|tile| tile.source == source).map(source::Tile::flux).sum();
        let given = given * light.sources[source].radiance[1];
        let absorbed: f64 = light
            .shell
            .patches
            .iter()
            .zip(shown)
            // The opening absorbs all and shows nothing: what falls on it is that of the wall around it.
            .map(|(patch, shown)| {
                let falls = if patch.albedo[1] > 0.0 {
                    PI * shown[1] / patch.albedo[1]
                } else {
                    PI * light.exchange.front[source][1] / 0.6
                };
                (1.0 - patch.albedo[1]) * falls * patch.area
            })
            .sum();
        println!("source {source}: {given} {absorbed}");
        assert!((absorbed / given - 1.0).abs() < 0.05, "source {source}: {given} {absorbed}");
    }
}

/// Pieces of the left or right wall, and the irradiance of each.
fn wall_pieces(x: f64, falls: impl Fn([f64; 3], [f64; 3]) -> f64) -> Vec<([f64; 3], [f64; 3], f64, f64)> {
    let normal = [-x.signum(), 0.0, 0.0];
    let n = 40;
    let area = 3.0 * 2.4 / f64::from(n * n);
    (0..n * n)
        .map(|k| {
            let at = [x, (f64::from(k % n) + 0.5) / f64::from(n) * 3.0, (f64::from(k / n) + 0.5) / f64::from(n) * 2.4];
            (at, normal, area, falls(at, normal))
        })
        .collect()
}

/// The floor's light from lit pieces of wall with albedo 0.7.
fn from_wall(scenario: &Scenario, point: Point, pieces: &[([f64; 3], [f64; 3], f64, f64)]) -> f64 {
    let ways = Ways { scenario, bodies: &[] };
    let of = |(at, normal, area, falls): &([f64; 3], [f64; 3], f64, f64)| {
        let one = vec![(*at, Some(*normal), *area)];
        if *falls > 0.0 { 0.7 / PI * falls * ways.light([point[0], point[1], 0.0], [0.0, 0.0, 1.0], &one) } else { 0.0 }
    };
    pieces.iter().map(of).sum()
}

/// Sky and sun on a wall, and from there on the floor.
#[test]
fn light_that_a_wall_reflects_equals_the_literal_sum() {
    let sun = "sun = { towards = [-1.0, 1.0, 0.9], rgb = [10, 10, 10] }\n";
    let mut scenario = black(&format!("{WINDOW}{sun}{TABLE}"));
    scenario.room.albedo.right = [0.7; 3];
    let light = light_of(&scenario);
    let window = rectangle([-0.3, 3.0, 0.9], [1.2, 0.0, 0.0], [0.0, 0.0, 1.2], [0.0, -1.0, 0.0]);
    let coarse: Pieces = window.iter().step_by(7).map(|(at, out, area)| (*at, *out, 7.0 * area)).collect();
    let ways = Ways { scenario: &scenario, bodies: &[] };
    let sky = wall_pieces(1.5, |at, normal| ways.light(at, normal, &coarse));
    let beam = wall_pieces(1.5, |at, normal| {
        let d = [-1.0, 1.0, 0.9];
        let length = f64::sqrt(2.81);
        let t = 3.0 - at[1];
        let [x, z] = [at[0] + t * d[0], at[2] + t * d[2]];
        let through = (-0.3..0.9).contains(&x) && (0.9..2.1).contains(&z);
        let shaded = (1..200).any(|k| ways.in_solid([0, 1, 2].map(|c| at[c] + t * f64::from(k) / 200.0 * d[c])));
        if through && !shaded { 10.0 * (d[0] * normal[0]).max(0.0) / length } else { 0.0 }
    });
    assert!(beam.iter().filter(|piece| piece.3 > 0.0).count() > 40);
    let nodes = |levels: [f64; 2]| light.light(&levels, Vec::new(), [0.0; 3]);
    let (by_sky, by_sun) = (nodes([1.0, 0.0]), nodes([0.0, 1.0]));
    let straight = rectangle([-0.3, 3.0, 0.9], [1.2, 0.0, 0.0], [0.0, 0.0, 1.2], [0.0, -1.0, 0.0]);
    let mut compared = 0;
    for [x, y] in POINTS {
        let direct = ways.light([x, y, 0.0], [0.0, 0.0, 1.0], &straight);
        let (expected, found) = (direct + from_wall(&scenario, [x, y], &sky), at(&light, &by_sky, [x, y])[1]);
        println!("sky [{x}, {y}]: {expected:.5} ({direct:.5}) {found:.5}");
        assert!((found - expected).abs() < 0.03 * expected + 0.004, "[{x}, {y}]: {found} {expected}");
        let (expected, found) = (from_wall(&scenario, [x, y], &beam), at(&light, &by_sun, [x, y])[1]);
        println!("sun [{x}, {y}]: {expected:.5} {found:.5}");
        assert!((found - expected).abs() < 0.08 * expected + 0.003, "sun [{x}, {y}]: {found} {expected}");
        compared += i32::from(expected > 0.01);
    }
    assert!(compared >= 3, "{compared}");
}

/// Somebody in white with legs and arms, lit by a lamp that the floor does not see: every ray to a limb, by halving.
#[test]
fn the_light_of_a_body_equals_the_literal_sum_over_rays() {
    let lamp = "[[lamp]]\nkind = \"bulb\"\nat_m = [1.2, 0.25, 2.0]\nradius_m = 0.05\nrgb = [1, 1, 1]\n";
    let mut scenario = black(lamp);
    scenario.ordinary = true;
    let light = light_of(&scenario);
    let body = walker([-0.1, 1.5]);
    let person = dressed(Person::body(&body), [0.8; 3]);
    let nodes = light.light(&[1.0], vec![person], [0.0; 3]);
    let empty = light.light(&[1.0], Vec::new(), [0.0; 3]);
    let ways = Ways { scenario: &scenario, bodies: std::slice::from_ref(&body) };
    let lamp_at = [1.2, 0.25, 2.0];
    for point in [POINTS[3], POINTS[4], POINTS[5]] {
        let [x, y] = point;
        let middle = (-0.1_f64 - x).atan2(1.5 - y);
        let (half, n) = (0.32, 200);
        let (mut sum, mut shaded) = (0.0, 0.0);
        for k in 0..n * n {
            let phi = middle + half * (2.0 * (f64::from(k % n) + 0.5) / f64::from(n) - 1.0);
            let s = 0.75 * (f64::from(k / n) + 0.5) / f64::from(n);
            let ray = [phi.sin() * f64::sqrt(1.0 - s), phi.cos() * f64::sqrt(1.0 - s), s.sqrt()];
            let from = [x, y, 0.0];
            let far = [0, 1, 2].map(|c| from[c] + 3.2 * ray[c]);
            let Some((place, normal)) = first_limb(&body, from, far) else { continue };
            if !(Ways { scenario: &scenario, bodies: &[] }).free(from, place) {
                continue;
            }
            let d = [0, 1, 2].map(|c| lamp_at[c] - place[c]);
            let range = apart(lamp_at, place);
            let facing = (0..3).map(|c| d[c] * normal[c]).sum::<f64>() / range;
            let before = [0, 1, 2].map(|c| place[c] + 1e-3 * normal[c]);
            if facing > 0.0 {
                let solid_angle = 0.5 * (2.0 * half / f64::from(n)) * (0.75 / f64::from(n));
                let light = 0.8 / PI * facing / (range * range) * solid_angle;
                sum += light;
                shaded += if ways.free(before, lamp_at) { 0.0 } else { light };
            }
        }
        let found = at(&light, &nodes, point)[1] - at(&light, &empty, point)[1];
        println!("{point:?}: {sum:.6} {found:.6}, without shadows of limbs on limbs {:.6}", sum - shaded);
        // Shadows of limbs on each other are left out, and light is that on the body's axis.
        assert!((found / sum - 1.0).abs() < 0.2, "{point:?}: {sum} {found}");
    }
}

/// Where a way first meets a limb, and the normal there.
fn first_limb(body: &Body, from: [f64; 3], to: [f64; 3]) -> Option<([f64; 3], [f64; 3])> {
    let at = |t: f64| [0, 1, 2].map(|k| from[k] + t * (to[k] - from[k]));
    let mut first: Option<(f64, [f64; 3])> = None;
    for (capsule, _) in body.capsules() {
        let foot = |t: f64| {
            let p = at(t);
            let axis = [0, 1, 2].map(|k| capsule.to[k] - capsule.from[k]);
            let dot = (0..3).map(|k| (p[k] - capsule.from[k]) * axis[k]).sum::<f64>();
            let share = (dot / axis.iter().map(|a| a * a).sum::<f64>()).clamp(0.0, 1.0);
            [0, 1, 2].map(|k| capsule.from[k] + share * axis[k])
        };
        let apart_at = |t: f64| apart(at(t), foot(t));
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..30 {
            let (a, b) = (low + (high - low) / 3.0, high - (high - low) / 3.0);
            if apart_at(a) < apart_at(b) { high = b } else { low = a }
        }
        let nearest = low;
        if apart_at(nearest) >= capsule.radius {
            continue;
        }
        let (mut low, mut high) = (0.0, nearest);
        for _ in 0..30 {
            let middle = (low + high) / 2.0;
            if apart_at(middle) < capsule.radius { high = middle } else { low = middle }
        }
        if first.is_none_or(|(t, _)| high < t) {
            let (p, f) = (at(high), foot(high));
            first = Some((high, [0, 1, 2].map(|k| (p[k] - f[k]) / capsule.radius)));
        }
    }
    first.map(|(t, normal)| (at(t), normal))
}

/// A room with everything in it.
fn everything() -> Scenario {
    let more = format!(
        "{WINDOW}{TABLE}{LEAF}[[television]]\nwall = \"left\"\nalong_m = [1.4, 2.2]\nup_m = [0.9, 1.4]\nrgb = [0.5, 0.6, 0.9]\n\
         [[lamp]]\nkind = \"panel\"\nat_m = [0.4, 1.8, 2.3]\nradius_m = 0.3\nsize_m = [0.6, 0.9]\nrgb = [0.5, 0.4, 0.3]\n"
    );
    let mut scenario = black(&more);
    let albedo = &mut scenario.room.albedo;
    (albedo.left, albedo.back, albedo.right) = ([0.7, 0.4, 0.3], [0.6; 3], [0.3, 0.5, 0.7]);
    (albedo.front, albedo.floor, albedo.ceiling) = ([0.6; 3], [0.4; 3], [0.8; 3]);
    scenario.leaf.as_mut().unwrap().albedo = [0.6, 0.5, 0.4];
    scenario.furniture[0].albedo = [0.5, 0.3, 0.2];
    scenario.floor.gloss = 0.05;
    scenario
}

#[test]
fn a_mirrored_room_gives_mirrored_light() {
    let mut scenario = everything();
    let people = |side: f64| {
        let cylinder = Person::cylinder([-0.4 * side, 1.3], 0.2, 1.75, [0.6, 0.1, 0.1], [0.5, 0.4, 0.3]);
        vec![cylinder]
    };
    let light = light_of(&scenario);
    let levels = light.levels(0.0, None, 1);
    let nodes = light.light(&levels, people(1.0), [0.0; 3]);
    let albedo = &mut scenario.room.albedo;
    std::mem::swap(&mut albedo.left, &mut albedo.right);
    let flip = |[from, to]: [f64; 2]| [-to, -from];
    scenario.window[0].along_m = flip(scenario.window[0].along_m);
    scenario.furniture[0].x_m = flip(scenario.furniture[0].x_m);
    scenario.leaf.as_mut().unwrap().hinge = doorcam_core::geometry::Side::Right;
    scenario.television[0].wall = crate::simulation::scenario::WallName::Right;
    scenario.lamp[0].at_m[0] *= -1.0;
    scenario.camera.at_m[0] *= -1.0;
    let mirror = light_of(&scenario);
    let flipped = mirror.light(&levels, people(-1.0), [0.0; 3]);
    let mut asymmetry = 0.0_f64;
    for [x, y] in POINTS {
        let (a, b, here) = (at(&light, &nodes, [x, y]), at(&mirror, &flipped, [-x, y]), at(&light, &nodes, [-x, y]));
        for c in 0..3 {
            assert!((a[c] - b[c]).abs() < 2e-3 * a[c].max(0.01), "[{x}, {y}]: {a:?} {b:?}");
            asymmetry = asymmetry.max((a[c] - here[c]).abs() / a[c].max(0.01));
        }
    }
    assert!(asymmetry > 0.05, "the room is not its own mirror image: {asymmetry}");
}

#[test]
fn light_is_linear_in_each_source_and_an_empty_room_is_exactly_itself() {
    let light = light_of(&everything());
    let people = || vec![Person::body(&walker([0.1, 1.2])), Person::body(&walker([-0.6, 2.0]))];
    let nodes = |levels: [f64; 3]| light.light(&levels, people(), [0.0; 3]);
    let alone = [nodes([1.0, 0.0, 0.0]), nodes([0.0, 1.0, 0.0]), nodes([0.0, 0.0, 1.0])];
    let all = nodes([0.5, 2.0, 1.5]);
    for point in POINTS {
        let [a, b, c] = [&alone[0], &alone[1], &alone[2]].map(|nodes| at(&light, nodes, point));
        let all = at(&light, &all, point);
        for k in 0..3 {
            let sum = 0.5 * a[k] + 2.0 * b[k] + 1.5 * c[k];
            assert!((sum - all[k]).abs() < 1e-4 * all[k].max(0.01), "{point:?}: {sum} {}", all[k]);
        }
    }
    let levels = [1.0; 3];
    let gone = Person::cylinder([-1.95, 1.2], 0.2, 1.7, [0.5; 3], [0.5; 3]);
    assert_eq!(light.light(&levels, vec![gone], [0.0; 3]), light.light(&levels, Vec::new(), [0.0; 3]));
}

#[test]
fn a_television_flickers_as_its_seed_says_and_everything_else_holds_still() {
    let light = light_of(&everything());
    let levels = |shown: f64, seed: u64| light.levels(1.0, Some(shown), seed);
    let over = |seed: u64| (0..200).map(|k| levels(f64::from(k) / 5.0, seed)[2]).collect::<Vec<f64>>();
    let (shown, again, other) = (over(1), over(1), over(2));
    assert!(shown == again && shown != other);
    assert!(shown.iter().all(|level| (0.4..=1.6).contains(level)), "{shown:?}");
    let cuts = shown.windows(2).filter(|pair| (pair[0] - pair[1]).abs() > 0.2).count();
    let mean = shown.iter().sum::<f64>() / 200.0;
    assert!((10..60).contains(&cuts) && (mean - 1.0).abs() < 0.2, "{cuts} {mean}");
    assert_eq!(levels(3.0, 1)[..2], [1.0, 1.0]);
    assert_eq!(light.levels(1.0, None, 1), [1.0; 3]);
}

/// As docs/simulator.md defines it for the truth: not what only the floor before the opening sees.
#[test]
fn the_floor_beside_the_edges_sees_a_window_but_no_lamp_on_the_doorways_own_wall() {
    let lamp =
        |x: f64| format!("[[lamp]]\nkind = \"bulb\"\nat_m = [{x}, 0.15, 2.2]\nradius_m = 0.1\nrgb = [1, 1, 1]\n");
    let mut scenario = black(&format!("{}{}", lamp(1.25), lamp(-1.25)));
    scenario.ordinary = true;
    let albedo = &mut scenario.room.albedo;
    (albedo.left, albedo.back, albedo.right, albedo.ceiling) = ([0.6; 3], [0.6; 3], [0.6; 3], [0.8; 3]);
    for thickness in [0.15, 0.28] {
        scenario.doorway.wall_thickness_m = thickness;
        let all = |scenario: &Scenario| {
            let floor = FloorMap::new(scenario.doorway);
            let grid =
                (0..60).flat_map(|i| (0..20).map(move |j| [f64::from(i) * 0.03 - 0.9, f64::from(j) * -0.03 - 0.3]));
            let taps: Vec<Tap> = grid.flat_map(|place| floor.taps(place)).collect();
            OrdinaryLight::new(scenario, floor, taps.into_iter())
        };
        assert!(!all(&scenario).sees_a_source(), "{thickness}");
        let mut lit = black(WINDOW);
        lit.doorway.wall_thickness_m = thickness;
        assert!(all(&lit).sees_a_source(), "{thickness}");
    }
}
