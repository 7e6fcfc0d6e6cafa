use crate::geometry::{Doorway, Facet, Point};

/// The parts of a facet that a floor point sees through the opening and past the door's leaf, as fractions (s0, s1) of
/// the way from `facet.from` to `facet.to`. A leaf may hide its middle, so there are up to two; an empty one has
/// s0 >= s1.
pub(super) fn visible_parts(doorway: &Doorway, pixel: Point, facet: &Facet) -> [(f64, f64); 2] {
    let through = [facet.from, facet.to].map(|end| crossing_margins(doorway, pixel, end));
    let (s0, s1) = positive_part(through);
    let behind = doorway.leaf_ends().map(|leaf| [facet.from, facet.to].map(|end| leaf_margins(leaf, pixel, end)));
    let (u0, u1) = behind.map_or(NOTHING, positive_part);
    if u0 >= u1 { [(s0, s1), NOTHING] } else { [(s0, s1.min(u0)), (s0.max(u1), s1)] }
}

/// No part of a facet.
const NOTHING: (f64, f64) = (1.0, 0.0);

/// Whether a floor point sees a point of the hidden room through the opening and past the door's leaf.
pub(super) fn sees(doorway: &Doorway, pixel: Point, hidden: Point) -> bool {
    crossing_margins(doorway, pixel, hidden).iter().all(|&m| m > 0.0)
        && !doorway.leaf_ends().is_some_and(|leaf| leaf_margins(leaf, pixel, hidden).iter().all(|&m| m > 0.0))
}

/// Greatest height of a point above the floor point `hidden` that a floor point sees below the lintel, in metres. The
/// lintel's lower corner on the hidden face is the one that hides more, because light from the room falls.
pub(super) fn below_lintel(doorway: &Doorway, [_, py]: Point, [_, sy]: Point) -> f64 {
    doorway.height_m.map_or(f64::INFINITY, |height| height * (sy - py) / py.abs())
}

/// Where all of some functions that are linear along a facet are positive, from their values at its two ends: each cuts
/// it at most once.
fn positive_part<const N: usize>([from, to]: [[f64; N]; 2]) -> (f64, f64) {
    let (mut s0, mut s1) = (0.0_f64, 1.0_f64);
    for margins in from.into_iter().zip(to) {
        match margins {
            (a, b) if a <= 0.0 && b <= 0.0 => return NOTHING,
            (a, b) if a < 0.0 => s0 = s0.max(a / (a - b)),
            (a, b) if b < 0.0 => s1 = s1.min(a / (a - b)),
            _ => {}
        }
    }
    (s0, s1)
}

/// Three functions, linear in the point `to`, that are all positive where the leaf hides it from `pixel`: how far it is
/// beyond the leaf's line, and how far inside its two ends. None is if the leaf is seen edge-on.
fn leaf_margins([hinge, free]: [Point; 2], pixel: Point, to: Point) -> [f64; 3] {
    let from_pixel = |[x, y]: Point| [x - pixel[0], y - pixel[1]];
    let cross = |a: Point, b: Point| a[0] * b[1] - a[1] * b[0];
    let (hinge, free, to) = (from_pixel(hinge), from_pixel(free), from_pixel(to));
    let along = [free[0] - hinge[0], free[1] - hinge[1]];
    // Positive if the free edge is to the left of the hinge.
    let turn = cross(hinge, free);
    [turn * (cross(to, along) - cross(hinge, along)), turn * cross(hinge, to), turn * cross(to, free)]
}

/// How far inside each edge the ray passes at the hidden and at the visible face, multiplied by the rise from pixel to
/// point. Positive where the ray is inside.
///
/// "The ray from `pixel` to a point S crosses the face at y = f right of x = e" is linear in S once multiplied by the
/// rise from pixel to S, which is positive.
fn crossing_margins(doorway: &Doorway, [px, py]: Point, [sx, sy]: Point) -> [f64; 4] {
    let half = doorway.half_width();
    let rise = sy - py;
    let run = sx - px;
    let at = |face: f64| (px * rise + run * (face - py), half * rise);
    let (hidden, limit) = at(0.0);
    let (visible, _) = at(-doorway.wall_thickness_m);
    [limit + hidden, limit - hidden, limit + visible, limit - visible]
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::testing::{leaf, meets_leaf};
    use super::*;

    proptest! {
        /// Brute force: test the ray to each of many points along the facet against both faces and the leaf.
        #[test]
        fn the_visible_parts_are_what_single_rays_see(
            width in 0.3..1.5f64, thickness in 0.0..0.3f64, px in -1.0..1.0f64, depth in 0.001..0.5f64,
            x0 in -2.0..2.0f64, y0 in 0.0..3.0f64, x1 in -2.0..2.0f64, y1 in 0.01..3.0f64,
            leaf in leaf(),
        ) {
            let door = Doorway { width_m: width, wall_thickness_m: thickness, height_m: None, leaf };
            let pixel = [px, -thickness - depth];
            let facet = Facet { from: [x0, y0], to: [x1, y1] };
            let parts = visible_parts(&door, pixel, &facet);
            for k in 0..200 {
                let s = (k as f64 + 0.5) / 200.0;
                let point = [x0 + s * (x1 - x0), y0 + s * (y1 - y0)];
                let cross = |face: f64| px + (point[0] - px) * (face - pixel[1]) / (point[1] - pixel[1]);
                let inside = [0.0, -thickness].iter().all(|&f| cross(f).abs() < width / 2.0);
                let seen = inside && !meets_leaf(&door, pixel, point);
                let at_border = parts.iter().any(|(a, b)| (s - a).abs() < 1e-9 || (s - b).abs() < 1e-9);
                prop_assert!(at_border || sees(&door, pixel, point) == seen, "s = {s}");
                let in_part = parts.iter().any(|&(a, b)| s > a && s < b);
                prop_assert!(at_border || in_part == seen, "s = {s}, parts {parts:?}");
            }
        }

        /// Brute force: where the ray to the top of a point passes both faces of the wall.
        #[test]
        fn the_lintel_hides_what_single_rays_do_not_see(
            thickness in 0.0..0.3f64, lintel in 0.2..2.2f64, depth in 0.001..0.5f64, y in 0.01..3.0f64, z in 0.0..3.0f64,
        ) {
            let door = Doorway { width_m: 1.0, wall_thickness_m: thickness, height_m: Some(lintel), leaf: None };
            let (pixel, point) = ([0.1, -thickness - depth], [0.2, y]);
            let height = |face: f64| z * (face - pixel[1]) / (y - pixel[1]);
            let passes = [0.0, -thickness].iter().all(|&face| height(face) < lintel);
            let limit = below_lintel(&door, pixel, point);
            prop_assert!((z - limit).abs() < 1e-9 || (z < limit) == passes, "{z} {limit}");
        }
    }
}
