//! People in a room with a window that the floor sees.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};

use super::*;
use crate::geometry::{Point, Side};
use crate::light::{FanPair, PatchPair};
use crate::still_room::StillRoom;
use crate::still_room::tests::{DOOR, PATCH, ROOM, fit, picture, with_window};
use crate::transport::{Body, FloorView};

const NOISE: f64 = 0.002;
const RADIUS_M: f64 = 0.2;
const HEIGHT_M: f64 = 1.7;

fn finder(still: Option<&StillRoom>, level: f64) -> Finder {
    let counted = [vec![true; PATCH.pixels()], vec![true; PATCH.pixels()]];
    let fans = FanPair::new(&DOOR, &PATCH, &counted);
    let table = BodyTable::new(&DOOR, &PATCH, &fans, RADIUS_M, HEIGHT_M);
    let likelihood = Likelihood::new(&LikelihoodSpec {
        doorway: &DOOR,
        searched: &ROOM,
        room: &ROOM,
        patch: &PATCH,
        fans: &fans,
        table: &table,
        weights: &[vec![1.0 / NOISE; PATCH.pixels()], vec![1.0 / NOISE; PATCH.pixels()]],
        patterns: [vec![vec![level; PATCH.pixels()]], vec![vec![level; PATCH.pixels()]]],
        empty: &[],
        level,
        still,
        body: [RADIUS_M, HEIGHT_M],
    });
    Finder::new(DOOR, likelihood.unwrap(), RADIUS_M)
}

/// What a person of one radiance changes in a room, pixel by pixel, with noise.
fn change(still: &StillRoom, centre: Point, radiance: f64, random: &mut ChaCha8Rng) -> PatchPair {
    let body = Body { centre, radius_m: RADIUS_M, height_m: HEIGHT_M };
    let mut pair = PatchPair::zeros(PATCH.size);
    for side in Side::BOTH {
        let views: Vec<FloorView> = PATCH.points(&DOOR, side).into_iter().map(|p| FloorView::new(&DOOR, p)).collect();
        let light: Vec<f64> = (views.iter())
            .map(|view| radiance * view.body(&DOOR, &body) - still.seen(&DOOR, view).hidden(&body)[0])
            .collect();
        for c in 0..3 {
            for (value, light) in pair.side_mut(side).plane_mut(c).iter_mut().zip(&light) {
                let noise: f64 = StandardNormal.sample(random);
                *value = (light + NOISE * noise) as f32;
            }
        }
    }
    pair
}

#[test]
fn somebody_before_a_window_is_found_where_they_are_if_the_window_is_known() {
    let true_room = with_window(1.5);
    let empty = picture(&true_room, 0.15);
    let level = empty.left.data().iter().map(|&v| f64::from(v)).sum::<f64>() / empty.left.data().len() as f64;
    let mut random = ChaCha8Rng::seed_from_u64(5);
    let places = [[0.35, 2.0], [0.2, 1.4], [-0.1, 1.2], [0.5, 2.6], [0.7, 1.8], [-0.6, 1.5]];
    let mut errors = |finder: &mut Finder| -> Vec<f64> {
        let error = |place: &Point| {
            let difference = change(&true_room, *place, 0.04, &mut random);
            let from = [place[0] + 0.1, place[1] - 0.2];
            let found = finder.find(&difference, std::iter::empty(), &[from], 1.0);
            found.first().map_or(1.0, |d| (d.position[0] - place[0]).hypot(d.position[1] - place[1]))
        };
        places.iter().map(error).collect()
    };
    let (knowing, not_knowing) = (errors(&mut finder(Some(&true_room), level)), errors(&mut finder(None, level)));
    let mean = |errors: &[f64]| errors.iter().sum::<f64>() / errors.len() as f64;
    assert!(mean(&knowing) < 0.8 * mean(&not_knowing), "{knowing:?} {not_knowing:?}");
}

#[test]
fn a_room_without_bright_things_gives_what_it_gives_when_nothing_is_known_of_it() {
    let even = with_window(0.0);
    let still = fit(&picture(&even, 0.15));
    let mut random = ChaCha8Rng::seed_from_u64(6);
    let difference = change(&even, [0.3, 1.4], 0.02, &mut random);
    let found = |still: Option<&StillRoom>| {
        finder(still, 0.25).find(&difference, std::iter::empty(), &[[0.3, 1.2]], 1.0).to_vec()
    };
    let (known, unknown) = (found(Some(&still)), found(None));
    assert_eq!(known.len(), 1);
    assert_eq!(known, unknown);
}
