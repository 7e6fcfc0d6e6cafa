use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};

use super::*;
use crate::geometry::{Doorway, Leaf, Point, Room, Side};
use crate::light::{FanPair, PatchPair};
use crate::tracking::{Detection, Prediction, TrackState};
use crate::transport::{Body, FloorView, PatchGrid, PixelLayout};

const DOOR: Doorway = Doorway { width_m: 0.7, wall_thickness_m: 0.1, height_m: Some(2.0), leaf: None };
const PATCH: PatchGrid = PatchGrid { size: 48, fov_m: 0.3, layout: PixelLayout::Cells };
const ROOM: Room = Room { half_width_m: 1.5, depth_m: 3.0 };
const LEVEL: f64 = 0.4;
/// Noise of a pixel: 0.5 % of the level.
const NOISE: f64 = 0.002;
const RADIUS_M: f64 = 0.2;
const HEIGHT_M: f64 = 1.7;

fn finder() -> Finder {
    finder_at(&DOOR)
}

fn finder_at(door: &Doorway) -> Finder {
    finder_in(door, &ROOM)
}

fn finder_in(door: &Doorway, searched: &Room) -> Finder {
    let fans = FanPair::new(door, &PATCH, &[vec![true; PATCH.pixels()], vec![true; PATCH.pixels()]]);
    let table = BodyTable::new(door, &PATCH, &fans, RADIUS_M, HEIGHT_M);
    let mut random = ChaCha8Rng::seed_from_u64(9);
    let empty: Vec<PatchPair> = (0..6).map(|_| measurement(&[], &mut random)).collect();
    let weights = [vec![1.0 / NOISE; PATCH.pixels()], vec![1.0 / NOISE; PATCH.pixels()]];
    let likelihood = Likelihood::new(&LikelihoodSpec {
        doorway: door,
        room: &ROOM,
        searched,
        patch: &PATCH,
        fans: &fans,
        table: &table,
        weights: &weights,
        patterns: [vec![vec![LEVEL; PATCH.pixels()]], vec![vec![LEVEL; PATCH.pixels()]]],
        empty: &empty.iter().collect::<Vec<_>>(),
        level: LEVEL,
        still: None,
        body: [RADIUS_M, HEIGHT_M],
    });
    Finder::new(*door, likelihood.unwrap(), RADIUS_M)
}

/// A difference with bodies of given radiances and with noise, computed pixel by pixel from the formulas.
fn measurement(people: &[(Point, [f64; 3])], random: &mut ChaCha8Rng) -> PatchPair {
    measurement_at(&DOOR, people, random)
}

fn measurement_at(door: &Doorway, people: &[(Point, [f64; 3])], random: &mut ChaCha8Rng) -> PatchPair {
    let mut pair = PatchPair::zeros(PATCH.size);
    for side in Side::BOTH {
        let views: Vec<FloorView> =
            PATCH.points(door, side).into_iter().map(|point| FloorView::new(door, point)).collect();
        for c in 0..3 {
            for (value, view) in pair.side_mut(side).plane_mut(c).iter_mut().zip(&views) {
                let light = |&(centre, radiance): &(Point, [f64; 3])| {
                    radiance[c] * view.body(door, &Body { centre, radius_m: RADIUS_M, height_m: HEIGHT_M })
                };
                let noise: f64 = StandardNormal.sample(random);
                *value = (people.iter().map(light).sum::<f64>() + NOISE * noise) as f32;
            }
        }
    }
    pair
}

#[test]
fn one_person_is_found_off_the_grid_with_honest_errors() {
    let mut finder = finder();
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let mut inside = 0;
    let places = [[0.0, 1.0], [0.63, 1.31], [-0.87, 1.52], [0.21, 2.33], [-0.4, 1.77]];
    for (k, place) in places.iter().cycle().take(60).enumerate() {
        let difference = measurement(&[(*place, [-0.2, -0.25, -0.1])], &mut random);
        // Where the map would show it, to within about a facet.
        let from = [place[0] + 0.1 * (k as f64).cos(), place[1] + 0.25 * (k as f64).sin()];
        let found = finder.find(&difference, std::iter::empty(), &[from], 1.0);
        assert_eq!(found.len(), 1, "{place:?} {found:?}");
        let [[xx, xy], [_, yy]] = found[0].covariance;
        let (dx, dy) = (found[0].position[0] - place[0], found[0].position[1] - place[1]);
        let distance2 = (yy * dx * dx - 2.0 * xy * dx * dy + xx * dy * dy) / (xx * yy - xy * xy);
        inside += usize::from(distance2 < 5.991);
        assert!(dx.hypot(dy) < 4.0 * (xx + yy).sqrt(), "{place:?} {found:?}");
        assert!(found[0].rgb.iter().all(|&v| v < 0.0) && (found[0].rgb[1] + 0.25).abs() < 0.15, "{found:?}");
    }
    // The reported error allows for bodies that are not cylinders, so at least 95 % are expected.
    assert!(inside >= 54, "{inside} of 60 inside the 95 % ellipse");
}

#[test]
fn two_people_are_found_from_three_seeds_and_nobody_in_noise() {
    let mut finder = finder();
    let mut random = ChaCha8Rng::seed_from_u64(2);
    let people = [([-0.6, 1.1], [-0.25, -0.1, 0.05]), ([0.5, 1.9], [0.1, -0.2, -0.3])];
    for _ in 0..10 {
        let difference = measurement(&people, &mut random);
        let found = finder.find(&difference, std::iter::empty(), &[[-0.5, 1.2], [0.4, 1.6], [0.1, 1.2]], 1.0);
        assert_eq!(found.len(), 2, "{found:?}");
        for (place, _) in people {
            let away = |d: &crate::tracking::Detection| (d.position[0] - place[0]).hypot(d.position[1] - place[1]);
            assert!(found.iter().any(|d| away(d) < 0.3), "{place:?} {found:?}");
        }
    }
    for _ in 0..30 {
        let noise = measurement(&[], &mut random);
        let found = finder.find(&noise, std::iter::empty(), &[[0.0, 1.0], [-0.7, 1.5], [0.6, 2.4]], 1.0);
        assert!(found.is_empty(), "{found:?}");
    }
}

#[test]
fn even_light_of_any_strength_is_nobody() {
    let mut finder = finder();
    let mut random = ChaCha8Rng::seed_from_u64(3);
    let mut lit = measurement(&[], &mut random);
    for side in Side::BOTH {
        lit.side_mut(side).data_mut().iter_mut().for_each(|v| *v += 0.05);
    }
    let found = finder.find(&lit, std::iter::empty(), &[[0.0, 1.0], [0.5, 0.8]], 1.0);
    assert!(found.is_empty(), "{found:?}");
}

#[test]
fn the_table_is_the_formula_between_its_places_too() {
    let fans = FanPair::new(&DOOR, &PATCH, &[vec![true; PATCH.pixels()], vec![true; PATCH.pixels()]]);
    for door in [DOOR, OPEN_DOOR] {
        let table = BodyTable::new(&door, &PATCH, &fans, RADIUS_M, HEIGHT_M);
        for centre in [[0.02, 0.71], [0.63, 1.31], [-0.87, 1.52], [0.21, 2.33], [1.2, 2.9], [-0.55, 1.9]] {
            for (s, side) in Side::BOTH.into_iter().enumerate() {
                let body = Body { centre, radius_m: RADIUS_M, height_m: HEIGHT_M };
                let means = |door: &Doorway| {
                    let points = PATCH.points(door, side).into_iter();
                    let views: Vec<f64> = points.map(|point| FloorView::new(door, point).body(door, &body)).collect();
                    fans.sides()[s].means(|k| views[k])
                };
                let stencil = BodyTable::stencil(place::Place::from_point(centre));
                let interpolated = |cell: usize| {
                    let weigh = |&(k, w): &(usize, [f32; 3])| {
                        let (column, step) = table.columns[s].column(k);
                        f64::from(w[0] * step * f32::from(column[cell]))
                    };
                    stencil.iter().map(weigh).sum::<f64>()
                };
                // Relative to the light of somebody whom no leaf hides.
                let squares = means(&DOOR).iter().map(|v| v * v).sum::<f64>();
                let errors =
                    means(&door).iter().enumerate().map(|(cell, v)| (interpolated(cell) - v).powi(2)).sum::<f64>();
                // Half of the error comes from representing groups of pixels by one point.
                let error = (errors / squares).sqrt();
                assert!(error < 0.05, "{centre:?} {side:?} {:?}: {error}", door.leaf);
            }
        }
    }
}

#[test]
fn one_patch_alone_tells_the_direction_of_somebody_who_is_expected_and_finds_nobody_new() {
    let mut random = ChaCha8Rng::seed_from_u64(4);
    let place = [0.5, 1.6];
    let mut pair = measurement(&[(place, [-0.2, -0.15, -0.1])], &mut random);
    let mut finder = finder();
    let expected = |known: bool| Prediction {
        id: 1,
        state: TrackState::Confirmed,
        position: [0.45, 1.5],
        covariance: [[0.04, 0.0], [0.0, 0.04]],
        known,
        rgb: [-0.1; 3],
    };
    // A second later than the frame before, so that errors which last count once.
    let both = finder.find_with(&pair, [1.0; 2], [expected(false)].into_iter(), &[], 1.0)[0];
    assert_eq!(finder.find(&pair, [expected(false)].into_iter(), &[], 1.0)[0], both);
    // The right patch is covered.
    pair.right.data_mut().fill(0.0);
    let one = finder.find_with(&pair, [1.0, 0.0], [expected(true)].into_iter(), &[], 1.0).to_vec();
    let [[xx, xy], [_, yy]] = one[0].covariance;
    // Across the direction from the left edge the place is as certain as before, along it it is not.
    let [dx, dy] = [place[0] + 0.5 * DOOR.width_m, place[1]];
    let r = dx.hypot(dy);
    let [along, across] =
        [[dx / r, dy / r], [-dy / r, dx / r]].map(|[a, b]| (a * a * xx + 2.0 * a * b * xy + b * b * yy).sqrt());
    assert!(across < 0.12 && along > 3.0 * across, "{across} {along}");
    assert!(along > both.covariance[1][1].sqrt(), "{along} {both:?}");
    assert!(finder.find_with(&pair, [1.0, 0.0], std::iter::empty(), &[place], 0.1).is_empty());
}

/// A door that stands open at the left and hides what is to the left from the left edge.
const OPEN_DOOR: Doorway = Doorway { leaf: Some(Leaf { hinge: Side::Left, angle_deg: 95.0, width_m: 0.68 }), ..DOOR };

#[test]
fn who_is_behind_the_leaf_is_a_direction_from_the_other_edge() {
    let mut random = ChaCha8Rng::seed_from_u64(5);
    let mut finder = finder_at(&OPEN_DOOR);
    for (place, from) in [([-0.85, 1.9], OPEN_DOOR.edge(Side::Right)), ([-1.1, 2.3], OPEN_DOOR.edge(Side::Right))] {
        let behind = measurement_at(&OPEN_DOOR, &[(place, [-0.3, -0.22, -0.15])], &mut random);
        // The map knows the direction only.
        let seed = [0, 1].map(|k| from[k] + 0.8 * (place[k] - from[k]));
        let found = finder.find(&behind, std::iter::empty(), &[seed], 1.0).to_vec();
        assert_eq!(found.len(), 1, "{place:?} {found:?}");
        let Detection { position: [x, y], covariance: [[xx, xy], [_, yy]], .. } = found[0];
        let sight = [place[0] - from[0], place[1] - from[1]];
        let distance = sight[0].hypot(sight[1]);
        let [along, across] = [[sight[0], sight[1]], [-sight[1], sight[0]]].map(|[a, b]| {
            let [a, b] = [a / distance, b / distance];
            let off = (x - place[0]) * a + (y - place[1]) * b;
            (off, (a * a * xx + 2.0 * a * b * xy + b * b * yy).sqrt())
        });
        assert!(across.1 < 0.1 && along.1 > 0.15 * distance, "{along:?} {across:?}");
        assert!(along.0.abs() < 2.5 * along.1 && across.0.abs() < 2.5 * across.1, "{along:?} {across:?}");
        // Nobody is found there by who does not know of the leaf.
        assert!(self::finder().find(&behind, std::iter::empty(), &[seed, place], 1.0).is_empty());
    }
    let visible = [0.6, 1.6];
    let pair = measurement_at(&OPEN_DOOR, &[(visible, [-0.3, -0.22, -0.15])], &mut random);
    let both = finder.find(&pair, std::iter::empty(), &[[0.5, 1.5]], 1.0)[0];
    assert!((both.position[0] - visible[0]).hypot(both.position[1] - visible[1]) < 0.15, "{both:?}");
    for _ in 0..20 {
        let noise = measurement_at(&OPEN_DOOR, &[], &mut random);
        let found = finder.find(&noise, std::iter::empty(), &[[-0.6, 1.8], [-1.0, 2.4], [0.6, 2.4]], 1.0);
        assert!(found.is_empty(), "{found:?}");
    }
}

#[test]
fn people_are_found_as_far_as_is_searched() {
    let mut random = ChaCha8Rng::seed_from_u64(6);
    let place = [0.4, 3.9];
    let far = measurement(&[(place, [-0.35, -0.3, -0.25])], &mut random);
    // The map ends at three metres.
    let seed = [0.3, 2.9];
    let wide = Room { half_width_m: 2.2, depth_m: 4.2 };
    let found = finder_in(&DOOR, &wide).find(&far, std::iter::empty(), &[seed], 1.0).to_vec();
    let Detection { position: [x, y], covariance: [[xx, _], [_, yy]], .. } = found[0];
    assert!((x - place[0]).hypot(y - place[1]) < 2.5 * (xx + yy).sqrt() && y > 3.4, "{found:?}");
    let near = finder().find(&far, std::iter::empty(), &[seed], 1.0).to_vec();
    assert!(near.iter().all(|d| d.position[1] < 3.3), "{near:?}");
}
