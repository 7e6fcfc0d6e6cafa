use super::{Intensity, Rgb};

/// The unified map v_u = M ⊙ max(v_L, v_R) (eq. 14), with the mask M of eq. 15: a facet counts if both intensities
/// reach the threshold, `t` times the largest |c|.
///
/// Darker changes are unified in the same way on the negative parts, as in the authors' figures, and come out negative:
/// the paper's maximum then becomes the more negative of the two views. A facet that is brighter in one view and darker
/// in the other is in neither map.
///
/// `radiance` has, per side and facet, the radiance of a facet of intensity 1.
pub fn unify(intensities: &[Intensity], radiance: [&[f64]; 2], t: f64) -> Vec<Rgb> {
    let largest = intensities.iter().fold(0.0_f64, |m, i| m.max(i.left.abs()).max(i.right.abs()));
    let threshold = t * largest;
    let reaches = |c: f64| c > 0.0 && c >= threshold;
    intensities
        .iter()
        .zip(radiance[0].iter().zip(radiance[1]))
        .map(|(i, (left, right))| {
            let (left, right) = (left * i.left, right * i.right);
            let strongest = if reaches(i.left) && reaches(i.right) {
                left.max(right)
            } else if reaches(-i.left) && reaches(-i.right) {
                left.min(right)
            } else {
                0.0
            };
            i.colour.map(|v| strongest * v)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::{Scene, Sign};
    use super::*;

    /// Eq. 14 and 15 as printed, on nonnegative views: element-wise maximum, mask from c_L and c_R.
    fn literal(left: &[Rgb], right: &[Rgb], c_left: &[f64], c_right: &[f64], t: f64) -> Vec<Rgb> {
        (0..left.len())
            .map(|n| {
                let masked = c_left[n] < t || c_right[n] < t || c_left[n] == 0.0 || c_right[n] == 0.0;
                [0, 1, 2].map(|p| if masked { 0.0 } else { left[n][p].max(right[n][p]) })
            })
            .collect()
    }

    fn intensity() -> impl Strategy<Value = Intensity> {
        let c = prop_oneof![Just(0.0), -2.0..2.0f64];
        (c.clone(), c, prop::array::uniform3(0.0..1.0f64)).prop_map(|(left, right, v)| {
            let norm = v.iter().map(|x| x * x).sum::<f64>().sqrt().max(1e-9);
            Intensity { left, right, colour: v.map(|x| x / norm) }
        })
    }

    proptest! {
        #[test]
        fn unified_is_equations_14_and_15_on_the_positive_and_on_the_negative_parts(
            intensities in prop::collection::vec(intensity(), 1..20), t in 0.0..0.9f64,
        ) {
            let scene = Scene::new(&intensities, [&vec![1.0; intensities.len()], &vec![1.0; intensities.len()]], t);
            let largest = intensities.iter().fold(0.0_f64, |m, i| m.max(i.left.abs()).max(i.right.abs()));
            for sign in [Sign::Brighter, Sign::Darker] {
                let part = |c: f64| if sign == Sign::Brighter { c.max(0.0) } else { (-c).max(0.0) };
                let c_left: Vec<f64> = intensities.iter().map(|i| part(i.left)).collect();
                let c_right: Vec<f64> = intensities.iter().map(|i| part(i.right)).collect();
                let view = |view: &[Rgb]| view.iter().map(|&rgb| sign.of(rgb)).collect::<Vec<_>>();
                let expected = literal(&view(&scene.left), &view(&scene.right), &c_left, &c_right, t * largest);
                for (n, rgb) in expected.iter().enumerate() {
                    let ours = sign.of(scene.unified[n]);
                    for p in 0..3 {
                        prop_assert!((ours[p] - rgb[p]).abs() < 1e-12, "facet {n} {sign:?}: {ours:?} {rgb:?}");
                    }
                }
            }
        }
    }
}
