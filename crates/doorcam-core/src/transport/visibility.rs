use crate::geometry::{Doorway, Facet, Point};

/// The part of a facet that a floor point sees through the opening, as fractions (s0, s1) of the way from `facet.from`
/// to `facet.to`; none if it sees nothing of it.
///
/// Light must pass between the edges at both faces of the wall. "The ray from `pixel` to a point S crosses the face at
/// y = f right of x = e" is linear in S once multiplied by the rise from pixel to S, which is positive. So each of the
/// four conditions cuts the segment at most once.
pub(super) fn visible_part(doorway: &Doorway, pixel: Point, facet: &Facet) -> Option<(f64, f64)> {
    let (mut s0, mut s1) = (0.0_f64, 1.0_f64);
    for margins in
        crossing_margins(doorway, pixel, facet.from).into_iter().zip(crossing_margins(doorway, pixel, facet.to))
    {
        match margins {
            (a, b) if a <= 0.0 && b <= 0.0 => return None,
            (a, b) if a < 0.0 => s0 = s0.max(a / (a - b)),
            (a, b) if b < 0.0 => s1 = s1.min(a / (a - b)),
            _ => {}
        }
    }
    (s0 < s1).then_some((s0, s1))
}

/// Whether a floor point sees a point of the hidden room through the opening.
pub(super) fn sees(doorway: &Doorway, pixel: Point, hidden: Point) -> bool {
    crossing_margins(doorway, pixel, hidden).iter().all(|&m| m > 0.0)
}

/// How far inside each edge the ray passes at the hidden and at the visible face, multiplied by the rise from pixel to
/// point. Positive where the ray is inside.
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

    use super::*;

    proptest! {
        /// Brute force: test the ray to each of many points along the facet against both faces.
        #[test]
        fn the_visible_part_is_what_single_rays_see(
            width in 0.3..1.5f64, thickness in 0.0..0.3f64, px in -1.0..1.0f64, depth in 0.001..0.5f64,
            x0 in -2.0..2.0f64, y0 in 0.0..3.0f64, x1 in -2.0..2.0f64, y1 in 0.01..3.0f64,
        ) {
            let door = Doorway { width_m: width, wall_thickness_m: thickness, height_m: None };
            let pixel = [px, -thickness - depth];
            let facet = Facet { from: [x0, y0], to: [x1, y1] };
            let part = visible_part(&door, pixel, &facet);
            for k in 0..200 {
                let s = (k as f64 + 0.5) / 200.0;
                let point = [x0 + s * (x1 - x0), y0 + s * (y1 - y0)];
                let cross = |face: f64| px + (point[0] - px) * (face - pixel[1]) / (point[1] - pixel[1]);
                let inside = [0.0, -thickness].iter().all(|&f| cross(f).abs() < width / 2.0);
                prop_assert_eq!(sees(&door, pixel, point), inside);
                let in_part = part.is_some_and(|(a, b)| s > a && s < b);
                let at_border = part.is_some_and(|(a, b)| (s - a).abs() < 1e-9 || (s - b).abs() < 1e-9);
                prop_assert!(at_border || in_part == inside, "s = {s}, part {part:?}");
            }
        }
    }
}
