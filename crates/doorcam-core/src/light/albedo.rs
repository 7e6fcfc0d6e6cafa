use crate::light::Patch;

/// A picture of a patch separated into the floor's texture and the light on it.
///
/// Light on the floor changes little over a ninth of the patch's side, so variation at smaller scales belongs to the
/// floor: speckle, grain, joints.
#[derive(Debug, Clone, PartialEq)]
pub struct Floor {
    /// Reflectance of each pixel relative to its surroundings, row by row from the wall; 1 if a pixel does not count.
    pub albedo: Vec<f64>,
    /// Per colour, the linear light on each pixel: the picture divided by the albedo and smoothed.
    ///
    /// Albedo times light reproduces the picture, but with the noise of the three colours averaged into one. This
    /// matters because the pictures of the three colours differ by little but their noise. That noise is also in every
    /// difference from the picture, and must not be taken for a pattern of light.
    pub light: [Vec<f64>; 3],
}

impl Floor {
    /// Separates a picture of the patch. `counted` says which pixels count.
    pub fn from_picture(picture: &Patch, counted: &[bool]) -> Self {
        let planes = [0, 1, 2].map(|p| picture.plane(p).iter().map(|&v| f64::from(v)).collect::<Vec<f64>>());
        let grey: Vec<f64> = (0..picture.pixels()).map(|k| planes.iter().map(|p| p[k]).sum::<f64>() / 3.0).collect();
        let around = local_mean(&grey, counted, picture.size());
        let relative = |k: usize| if counted[k] && around[k] > 0.0 { grey[k] / around[k] } else { 1.0 };
        let albedo: Vec<f64> = (0..picture.pixels()).map(relative).collect();
        let light = planes.map(|plane| {
            let even: Vec<f64> =
                plane.iter().zip(&albedo).map(|(value, albedo)| value / albedo.max(f64::MIN_POSITIVE)).collect();
            local_mean(&even, counted, picture.size())
        });
        Self { albedo, light }
    }

    /// The picture of one colour: albedo times light.
    pub fn picture(&self, channel: usize) -> Vec<f64> {
        self.albedo.iter().zip(&self.light[channel]).map(|(albedo, light)| albedo * light).collect()
    }
}

/// Side, in pixels, of the window over which [`Floor`] takes light to change little, for patches of `size` x `size`
/// pixels.
pub fn light_window(size: usize) -> usize {
    2 * reach(size) + 1
}

fn reach(size: usize) -> usize {
    (size / 18).max(1)
}

/// Mean of the pixels that count in a square window around each pixel; 0 where there are none.
fn local_mean(values: &[f64], counted: &[bool], size: usize) -> Vec<f64> {
    let value = |k: usize| if counted[k] { (values[k], 1.0) } else { (0.0, 0.0) };
    let add = |(s, n): (f64, f64), (value, one): (f64, f64)| (s + value, n + one);
    let around = |centre: usize| centre.saturating_sub(reach(size))..(centre + reach(size) + 1).min(size);
    // Rows first, then columns: this avoids visiting all pixels of every window.
    let along = |k: usize| around(k % size).map(|j| value(k / size * size + j)).fold((0.0, 0.0), add);
    let rows: Vec<(f64, f64)> = (0..values.len()).map(along).collect();
    let mean = |k: usize| {
        let (sum, count) = around(k / size).map(|i| rows[i * size + k % size]).fold((0.0, 0.0), add);
        if count > 0.0 { sum / count } else { 0.0 }
    };
    (0..values.len()).map(mean).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn speckle_is_told_from_the_light_on_it() {
        let size = 64;
        let speckle = |k: usize| 1.0 + 0.1 * (((k * 2_654_435_761) >> 7) % 2) as f64;
        let light = |k: usize| 0.3 + 0.2 * (k % size) as f64 / size as f64 + 0.1 * (k / size) as f64 / size as f64;
        let mut patch = Patch::zeros(size);
        for p in 0..3 {
            patch.plane_mut(p).iter_mut().enumerate().for_each(|(k, v)| *v = (speckle(k) * light(k)) as f32);
        }
        let floor = Floor::from_picture(&patch, &vec![true; size * size]);
        let albedo = &floor.albedo;
        let mean = (0..size * size).map(speckle).sum::<f64>() / (size * size) as f64;
        let wrong = |k: &usize| (albedo[*k] - speckle(*k) / mean).abs() > 0.03;
        let middle = |k: &usize| (4..60).contains(&(k / size)) && (4..60).contains(&(k % size));
        let inside = (0..size * size).filter(middle);
        assert!(inside.clone().filter(wrong).count() < 60);
        // Albedo times light reproduces the picture.
        let again = floor.picture(1);
        assert!(inside.clone().all(|k| (again[k] / (speckle(k) * light(k)) - 1.0).abs() < 0.02));
    }

    #[test]
    fn the_local_mean_is_the_mean_of_the_pixels_in_the_window_that_count() {
        let size = 36;
        let values: Vec<f64> = (0..size * size).map(|k| ((k * 7919) % 101) as f64).collect();
        let counted: Vec<bool> = (0..size * size).map(|k| k % 7 != 0 && !(k / size < 12 && k % size < 12)).collect();
        let mean = local_mean(&values, &counted, size);
        assert_eq!(light_window(size), 5);
        for (k, mean) in mean.iter().enumerate() {
            let close = |j: &usize| (j / size).abs_diff(k / size) <= 2 && (j % size).abs_diff(k % size) <= 2;
            let inside: Vec<f64> = (0..size * size).filter(close).filter(|&j| counted[j]).map(|j| values[j]).collect();
            let literal = if inside.is_empty() { 0.0 } else { inside.iter().sum::<f64>() / inside.len() as f64 };
            assert!((mean - literal).abs() < 1e-9, "{k}: {mean} {literal}");
        }
        assert_eq!(mean[5 * size + 5], 0.0);
    }
}
