//! The outline of a biangular cell: the part of the hidden room between two rays from each edge.

use super::Region;
use crate::figures::frame::Frame;
use crate::figures::text::unit;
use doorcam_core::geometry::{Doorway, Point, Side};

/// The outline as SVG path data, clipped to the panel; none if the cell lies outside.
pub(super) fn outline(region: &Region, doorway: &Doorway, frame: &Frame) -> Option<String> {
    let corners = cell(region, doorway, frame);
    if corners.is_empty() {
        return None;
    }
    let mut d = String::new();
    for (k, corner) in corners.iter().enumerate() {
        let [x, y] = frame.place(*corner);
        d += &format!("{}{} {}", if k == 0 { 'M' } else { 'L' }, unit(x), unit(y));
    }
    Some(d + "Z")
}

/// Corners of the clipped cell in metres, in order.
fn cell(region: &Region, doorway: &Doorway, frame: &Frame) -> Vec<Point> {
    let [left, right] = frame.x;
    let mut corners = vec![[left, 0.0], [right, 0.0], [right, frame.y[1]], [left, frame.y[1]]];
    let middles = [region.angles.alpha1, region.angles.alpha2];
    for ((side, middle), width) in Side::BOTH.into_iter().zip(middles).zip(region.widths) {
        if middle.is_nan() || width.is_nan() {
            return Vec::new();
        }
        for turn in [-1.0, 1.0] {
            let angle = (middle + turn * width / 2.0).clamp(0.0, std::f64::consts::PI);
            let (sine, cosine) = angle.sin_cos();
            let edge = doorway.edge(side);
            // Positive beyond the ray as the angle grows; at the right edge the angle turns the other way.
            let mirror = if side == Side::Left { 1.0 } else { -1.0 };
            let beyond = move |[x, y]: Point| cosine * (y - edge[1]) - sine * mirror * (x - edge[0]);
            corners = keep(&corners, |corner| -turn * beyond(corner));
        }
    }
    corners
}

/// Clips a convex outline to where a linear height is not negative (Sutherland and Hodgman).
fn keep(corners: &[Point], height: impl Fn(Point) -> f64) -> Vec<Point> {
    let mut kept = Vec::with_capacity(corners.len() + 1);
    for (k, &here) in corners.iter().enumerate() {
        let next = corners[(k + 1) % corners.len()];
        let (a, b) = (height(here), height(next));
        if a >= 0.0 {
            kept.push(here);
        }
        if (a > 0.0 && b < 0.0) || (a < 0.0 && b > 0.0) {
            let share = a / (a - b);
            kept.push([0, 1].map(|axis| here[axis] + share * (next[axis] - here[axis])));
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use doorcam_core::geometry::Biangular;

    proptest! {
        /// All corners of a cell inside the panel are crossings of its rays.
        #[test]
        fn corners_are_crossings_of_rays(a in 0.5..1.5f64, b in 0.5..1.5f64, wa in 0.001..0.1f64, wb in 0.001..0.1f64) {
            let doorway = Doorway { width_m: 1.0, wall_thickness_m: 0.0, height_m: None, leaf: None };
            let frame = Frame { left: 0.0, top: 0.0, scale: 1.0, x: [-100.0, 100.0], y: [-1.0, 100.0] };
            let region = Region { angles: Biangular { alpha1: a, alpha2: b }, widths: [wa, wb] };
            let corners = cell(&region, &doorway, &frame);
            prop_assert_eq!(corners.len(), 4);
            for (i, j) in [(-0.5, -0.5), (-0.5, 0.5), (0.5, -0.5), (0.5, 0.5)] {
                let [x, y] = Biangular { alpha1: a + i * wa, alpha2: b + j * wb }.to_point(&doorway);
                let near = corners.iter().any(|c| (c[0] - x).hypot(c[1] - y) < 1e-9 * (1.0 + y));
                prop_assert!(near, "{corners:?} {x} {y}");
            }
        }

        #[test]
        fn no_number_breaks_an_outline(values in proptest::collection::vec(prop_oneof![
            Just(f64::NAN), Just(f64::INFINITY), Just(-1e300), Just(0.0), -3.0..3.0
        ], 4)) {
            let doorway = Doorway { width_m: 1.0, wall_thickness_m: 0.0, height_m: None, leaf: None };
            let frame = Frame { left: 0.0, top: 0.0, scale: 100.0, x: [-1.0, 1.0], y: [-0.2, 2.0] };
            let angles = Biangular { alpha1: values[0], alpha2: values[1] };
            let region = Region { angles, widths: [values[2], values[3]] };
            let d = outline(&region, &doorway, &frame).unwrap_or_default();
            prop_assert!(!d.contains("NaN") && !d.contains("inf"), "{d}");
        }
    }

    #[test]
    fn who_could_be_anywhere_fills_the_room() {
        let doorway = Doorway { width_m: 1.0, wall_thickness_m: 0.0, height_m: None, leaf: None };
        let frame = Frame { left: 0.0, top: 0.0, scale: 1.0, x: [-1.0, 1.0], y: [-0.2, 2.0] };
        let angles = Biangular { alpha1: 1.0, alpha2: 1.0 };
        let anywhere = Region { angles, widths: [f64::INFINITY; 2] };
        let corners = cell(&anywhere, &doorway, &frame);
        let crossed = |(a, b): (&Point, &Point)| a[0] * b[1] - b[0] * a[1];
        let area = corners.iter().zip(corners.iter().cycle().skip(1)).map(crossed).sum::<f64>() / 2.0;
        assert!((area - 4.0).abs() < 1e-12, "{corners:?}");
    }
}
