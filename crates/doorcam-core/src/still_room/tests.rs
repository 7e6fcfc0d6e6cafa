use proptest::prelude::*;

use super::surfaces::{BANDS, BETWEEN_M, CEILING_M, Surfaces};
use super::*;
use crate::geometry::{Point, Room, RoomLight, Side};
use crate::light::{FanPair, Floor, PatchPair};
use crate::transport::{Body, PatchGrid, PixelLayout};

pub(crate) const DOOR: Doorway = Doorway { width_m: 0.9, wall_thickness_m: 0.12, height_m: Some(2.03), leaf: None };
pub(crate) const ROOM: Room = Room { half_width_m: 2.0, depth_m: 4.0 };
pub(crate) const PATCH: PatchGrid = PatchGrid { size: 48, fov_m: 0.3, layout: PixelLayout::Cells };

/// A room of which each piece is as bright as `radiance` says.
fn room(radiance: impl Fn(usize) -> Rgb) -> StillRoom {
    room_with(&[], radiance)
}

/// The same with described lights, which are its last pieces.
pub(super) fn room_with(lights: &[RoomLight], radiance: impl Fn(usize) -> Rgb) -> StillRoom {
    let surfaces = Surfaces::new(ROOM, lights);
    let radiance: Vec<Rgb> = (0..surfaces.pieces()).map(radiance).collect();
    StillRoom {
        surfaces,
        excess: radiance.clone(),
        radiance,
        visible: [[0.0; 3]; 2],
        misfit: 0.0,
        bright_share: 1.0,
        all_bright_share: 1.0,
    }
}

/// Something irregular.
fn patchwork(piece: usize) -> Rgb {
    [0, 1, 2].map(|c| 1.0 + ((piece / 5 * 37 + c * 11) % 17) as f64)
}

/// The piece that a mirrored room has in the place of this one.
fn mirrored(surfaces: &Surfaces, piece: usize) -> usize {
    let walls = surfaces.of_walls();
    let [across, _] = surfaces.cells();
    if piece < walls {
        (surfaces.strips() - 1 - piece / BANDS) * BANDS + piece % BANDS
    } else {
        let cell = piece - walls;
        walls + cell / across * across + across - 1 - cell % across
    }
}

/// The piece that a ray from a floor point meets, found in space.
fn met(surfaces: &Surfaces, [px, py]: Point, [dx, dy, dz]: [f64; 3]) -> usize {
    let to_side = (ROOM.half_width_m.copysign(dx) - px) / dx;
    let to_back = (ROOM.depth_m - py) / dy;
    let to_ceiling = CEILING_M / dz;
    let t = [to_side, to_back, to_ceiling].into_iter().filter(|t| *t > 0.0).fold(f64::INFINITY, f64::min);
    let [x, y, z] = [px + t * dx, py + t * dy, t * dz];
    if t == to_ceiling {
        let [across, deep] = surfaces.cells();
        let column = ((x + 2.0) / 4.0 * across as f64) as usize;
        return surfaces.of_walls()
            + ((y / 4.0 * deep as f64) as usize).min(deep - 1) * across
            + column.min(across - 1);
    }
    let along = if t == to_back {
        4.0 + x + 2.0
    } else if dx < 0.0 {
        y
    } else {
        12.0 - y
    };
    let strip = (along.max(0.0) / 12.0 * surfaces.strips() as f64) as usize;
    let band = BETWEEN_M.iter().filter(|&&top| z > top).count();
    strip.min(surfaces.strips() - 1) * BANDS + band
}

/// Light at a floor point from all of the room, and the part of it that a cylinder hides, summed ray by ray.
fn literal(still: &StillRoom, [px, py]: Point, body: &Body) -> [f64; 2] {
    const AZIMUTHS: usize = 3000;
    const ELEVATIONS: usize = 300;
    let (da, de) = (std::f64::consts::PI / AZIMUTHS as f64, std::f64::consts::FRAC_PI_2 / ELEVATIONS as f64);
    let (mut all, mut hidden) = (0.0, 0.0);
    for a in (0..AZIMUTHS).map(|k| (k as f64 + 0.5) * da - std::f64::consts::FRAC_PI_2) {
        let crosses = |face: f64| (px + (face - py) * a.tan()).abs() < DOOR.half_width();
        if !crosses(0.0) || !crosses(-DOOR.wall_thickness_m) {
            continue;
        }
        let (dx, dy) = (body.centre[0] - px, body.centre[1] - py);
        let beside = dx * a.cos() - dy * a.sin();
        let meets = beside.abs() < body.radius_m;
        for e in (0..ELEVATIONS).map(|k| (k as f64 + 0.5) * de) {
            if -py / a.cos() * e.tan() > 2.03 {
                break;
            }
            let piece = met(&still.surfaces, [px, py], [a.sin() * e.cos(), a.cos() * e.cos(), e.sin()]);
            let light = still.excess[piece][1] * e.sin() * e.cos() * de * da;
            all += light;
            if meets && e.tan() * dx.hypot(dy) < body.height_m {
                hidden += light;
            }
        }
    }
    [all, hidden]
}

proptest! {
    #![proptest_config(crate::testing::cases(24))]
    #[test]
    fn light_and_what_a_cylinder_hides_of_it_equal_sums_over_rays(
        px in -0.6..0.6f64, depth in 0.02..0.3f64, x in -1.5..1.5f64, y in 0.6..3.5f64, radius_m in 0.15..0.25f64,
    ) {
        let still = room(patchwork);
        let point = [px, -DOOR.wall_thickness_m - depth];
        let seen = still.seen(&DOOR, &FloorView::new(&DOOR, point));
        let body = Body { centre: [x, y], radius_m, height_m: 1.7 };
        let [all, hidden] = literal(&still, point, &body);
        prop_assert!((seen.light()[1] - all).abs() < 0.02 * all + 1e-3, "{} {all}", seen.light()[1]);
        let found = seen.hidden(&body)[1];
        prop_assert!((found - hidden).abs() < 0.06 * hidden + 0.01 * all, "{found} {hidden} of {all}");
    }

    #[test]
    fn a_mirrored_room_is_seen_mirrored(
        px in -0.6..0.6f64, depth in 0.02..0.3f64, x in -1.5..1.5f64, y in 0.6..3.5f64,
    ) {
        let still = room(patchwork);
        let other = room(|piece| patchwork(mirrored(&still.surfaces, piece)));
        let see = |still: &StillRoom, sign: f64| {
            let seen = still.seen(&DOOR, &FloorView::new(&DOOR, [sign * px, -DOOR.wall_thickness_m - depth]));
            let body = Body { centre: [sign * x, y], radius_m: 0.2, height_m: 1.7 };
            [seen.light()[0], seen.hidden(&body)[0]]
        };
        let (here, there) = (see(&still, 1.0), see(&other, -1.0));
        for (a, b) in here.into_iter().zip(there) {
            prop_assert!((a - b).abs() < 1e-4 * here[0] + 1e-6, "{here:?} {there:?}");
        }
    }
}

/// The empty floor's picture in a room, with light from the visible side.
pub(crate) fn picture(still: &StillRoom, visible: f64) -> PatchPair {
    let mut pair = PatchPair::zeros(PATCH.size);
    for side in Side::BOTH {
        let light: Vec<Rgb> = (PATCH.points(&DOOR, side).into_iter())
            .map(|point| still.seen(&DOOR, &FloorView::new(&DOOR, point)).light())
            .collect();
        for c in 0..3 {
            let pixels = pair.side_mut(side).plane_mut(c).iter_mut();
            pixels.zip(&light).for_each(|(pixel, light)| *pixel = (visible + light[c]) as f32);
        }
    }
    pair
}

pub(crate) fn fit(picture: &PatchPair) -> StillRoom {
    fit_with(&[], picture)
}

/// What is found in the picture of a room with these lights.
pub(crate) fn fit_with(lights: &[RoomLight], picture: &PatchPair) -> StillRoom {
    let counted = vec![true; PATCH.pixels()];
    let fans = FanPair::new(&DOOR, &PATCH, &[counted.clone(), counted.clone()]);
    let floors = [&picture.left, &picture.right]
        .map(|patch| Floor { albedo: vec![1.0; patch.pixels()], ..Floor::from_picture(patch, &counted) });
    let empty = Empty { doorway: &DOOR, room: ROOM, lights, patch: &PATCH, fans: &fans, picture, floors: &floors };
    StillRoom::fit(&empty).unwrap()
}

/// Walls of one radiance and a window in the back wall, from x = 0.3 to 0.9 m.
pub(crate) fn with_window(strength: f64) -> StillRoom {
    let surfaces = Surfaces::new(ROOM, &[]);
    room(|piece| {
        let (strip, band) = (piece / BANDS, piece % BANDS);
        let (_, x) = surfaces.at(0.5 * (surfaces.start(strip) + surfaces.start(strip.min(surfaces.strips() - 1) + 1)));
        let back = piece < surfaces.of_walls() && surfaces.at(surfaces.start(strip)).0 == Place::BackWall;
        let lit = back && band == 1 && (0.3..0.9).contains(&x);
        [0.1 + if lit { strength } else { 0.0 }; 3]
    })
}

#[test]
fn a_window_is_found_where_it_is_and_the_visible_sides_share_too() {
    let true_room = with_window(8.0);
    let still = fit(&picture(&true_room, 0.15));
    assert!(still.misfit() < 0.01, "{}", still.misfit());
    assert!(still.visible().iter().flatten().all(|v| (v - 0.15).abs() < 0.02), "{:?}", still.visible());
    assert!(still.is_bright(), "{}", still.bright_share());
    let things = still.bright_things();
    let window = things.first().unwrap();
    assert_eq!(window.place, Place::BackWall, "{things:?}");
    let [from, to] = window.along_m;
    assert!((0.5 * (from + to) - 0.6).abs() < 0.15 && (0.3..1.2).contains(&(to - from)), "{things:?}");
    // What somebody in front of it hides.
    let (mut sum, mut wrong) = (0.0, 0.0);
    for (x, y) in [(0.4, 2.0), (0.2, 1.5), (0.1, 1.0), (0.5, 3.0)] {
        let body = Body { centre: [x, y], radius_m: 0.2, height_m: 1.7 };
        for side in Side::BOTH {
            for point in PATCH.points(&DOOR, side).into_iter().step_by(7) {
                let view = FloorView::new(&DOOR, point);
                let even = room(|_| [0.1; 3]).seen(&DOOR, &view).hidden(&body)[1];
                let truth = true_room.seen(&DOOR, &view).hidden(&body)[1] - even;
                sum += truth * truth;
                wrong += (still.seen(&DOOR, &view).hidden(&body)[1] - truth).powi(2);
            }
        }
    }
    assert!(wrong < 0.4 * 0.4 * sum, "{}", (wrong / sum).sqrt());
}

#[test]
fn an_evenly_lit_room_has_nothing_bright_and_a_dark_one_is_no_room() {
    let even = fit(&picture(&room(|_| [0.1; 3]), 0.15));
    assert!(!even.is_bright() && even.bright_things().is_empty(), "{} {:?}", even.bright_share(), even.bright_things());
    let counted = vec![true; PATCH.pixels()];
    let fans = FanPair::new(&DOOR, &PATCH, &[counted.clone(), counted.clone()]);
    let dark = PatchPair::zeros(PATCH.size);
    let floors = [&dark.left, &dark.right].map(|patch| Floor::from_picture(patch, &counted));
    let empty =
        Empty { doorway: &DOOR, room: ROOM, lights: &[], patch: &PATCH, fans: &fans, picture: &dark, floors: &floors };
    assert_eq!(StillRoom::fit(&empty), None);
}

#[test]
fn light_along_the_doorways_wall_is_no_window() {
    let surfaces = Surfaces::new(ROOM, &[]);
    let lit_to = |farthest_m: f64| {
        let radiance: Vec<Rgb> = (0..surfaces.pieces())
            .map(|piece| {
                let strip = (piece / BANDS).min(surfaces.strips() - 1);
                let (place, y) = surfaces.at(0.5 * (surfaces.start(strip) + surfaces.start(strip + 1)));
                let lit = piece < surfaces.of_walls() && place == Place::RightWall && y < farthest_m;
                [if lit { 5.0 } else { 0.1 }; 3]
            })
            .collect();
        let excess = super::bright::excess(&surfaces, &radiance).iter().filter(|rgb| rgb[1] > 0.0).count();
        (excess, super::bright::find(&surfaces, &radiance).len())
    };
    assert_eq!(lit_to(0.6), (0, 0));
    let (excess, found) = lit_to(1.6);
    assert!(excess > 0 && found > 0);
}
