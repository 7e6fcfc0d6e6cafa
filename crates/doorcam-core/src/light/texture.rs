use crate::light::light_window;

/// Strength of a floor's texture, from the albedo that [`super::Floor`] found: the standard deviation per pixel of a
/// white texture that would be equally strong at the scales that matter, those of the window and above.
///
/// Grain a few pixels wide is stronger at those scales than its deviation per pixel suggests. Means over b x b pixels
/// of a white texture have 1 / b of the pixels' deviation; those of a coarser texture have more. The result is the
/// largest of b times that deviation over a few b, corrected for the mean over the window, to which the albedo is
/// relative.
pub fn texture_strength(albedo: &[f64], counted: &[bool], size: usize) -> f64 {
    let window = light_window(size);
    let strength = |b: usize| b as f64 * deviation_of_means(albedo, counted, size, b) / (1.0 - share(b, window)).sqrt();
    (1..=window.div_ceil(2).min(3)).map(strength).fold(0.0, f64::max)
}

/// For white texture: variance of the mean over the window, relative to that of the mean over b x b pixels in it.
fn share(b: usize, window: usize) -> f64 {
    (b as f64 / window as f64).powi(2)
}

/// RMS deviation from 1 of the means over squares of b x b pixels. Squares with pixels that do not count are left out.
fn deviation_of_means(albedo: &[f64], counted: &[bool], size: usize, b: usize) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0_f64);
    for square in (0..size / b).flat_map(|i| (0..size / b).map(move |j| (i * b, j * b))) {
        let pixels = || (0..b * b).map(|k| (square.0 + k / b) * size + square.1 + k % b);
        if pixels().all(|k| counted[k]) {
            let mean = pixels().map(|k| albedo[k]).sum::<f64>() / (b * b) as f64;
            sum += (mean - 1.0).powi(2);
            count += 1.0;
        }
    }
    (sum / count.max(1.0)).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::{Floor, Patch};

    const SIZE: usize = 64;

    /// The strength found for a floor whose grain is `grain` pixels wide, in light that increases to the right.
    fn found(deviation: f64, grain: usize, counted: &[bool]) -> f64 {
        // Uniform numbers of unit variance.
        let random = |k: usize| {
            let mut x = (k as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
            x ^= x >> 29;
            x = x.wrapping_mul(0xbf58_476d_1ce4_e5b9);
            3.0_f64.sqrt() * ((x >> 11) as f64 / (1u64 << 52) as f64 - 1.0)
        };
        let mut patch = Patch::zeros(SIZE);
        for p in 0..3 {
            for (k, value) in patch.plane_mut(p).iter_mut().enumerate() {
                let texture = 1.0 + deviation * random(k / SIZE / grain * SIZE + k % SIZE / grain);
                *value = (texture * (0.4 + 0.2 * (k % SIZE) as f64 / SIZE as f64)) as f32;
            }
        }
        texture_strength(&Floor::from_picture(&patch, counted).albedo, counted, SIZE)
    }

    #[test]
    fn white_texture_is_as_strong_as_its_deviation_and_coarse_grain_stronger() {
        let all = vec![true; SIZE * SIZE];
        for deviation in [0.02, 0.08] {
            let ratio = found(deviation, 1, &all) / deviation;
            assert!((0.95..1.1).contains(&ratio), "{deviation}: {ratio}");
        }
        let ratio = found(0.02, 2, &all) / 0.02;
        assert!((1.8..2.2).contains(&ratio), "grain of two pixels: {ratio}");
    }

    #[test]
    fn an_even_floor_has_no_texture_and_what_does_not_count_does_not() {
        assert!(found(0.0, 1, &vec![true; SIZE * SIZE]) < 0.01);
        let upper: Vec<bool> = (0..SIZE * SIZE).map(|k| k < SIZE * SIZE / 2).collect();
        let ratio = found(0.05, 1, &upper) / 0.05;
        assert!((0.95..1.1).contains(&ratio), "{ratio}");
        assert_eq!(found(0.05, 1, &vec![false; SIZE * SIZE]), 0.0);
    }
}
