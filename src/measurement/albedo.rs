use super::Patch;

/// The floor's reflectance at each pixel relative to its surroundings, from a picture of the patch: the picture over its
/// mean in a square window of a ninth of the patch's side. 1 where a pixel does not count.
///
/// Light on the floor changes little over so short a way, so what does change is the floor: speckle, grain, joints.
pub fn relative_albedo(picture: &Patch, counted: &[bool]) -> Vec<f64> {
    let size = picture.size();
    let reach = (size / 18).max(1);
    let grey: Vec<f64> =
        (0..picture.pixels()).map(|k| (0..3).map(|p| f64::from(picture.plane(p)[k])).sum::<f64>() / 3.0).collect();
    let around = |centre: usize| centre.saturating_sub(reach)..(centre + reach + 1).min(size);
    (0..picture.pixels())
        .map(|k| {
            let (row, column) = (k / size, k % size);
            let window = around(row).flat_map(|i| around(column).map(move |j| i * size + j));
            let (sum, count) = window.filter(|&k| counted[k]).fold((0.0, 0.0), |(s, n), k| (s + grey[k], n + 1.0));
            if counted[k] && sum > 0.0 { grey[k] * count / sum } else { 1.0 }
        })
        .collect()
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
        let albedo = relative_albedo(&patch, &vec![true; size * size]);
        let mean = (0..size * size).map(speckle).sum::<f64>() / (size * size) as f64;
        let wrong = |k: &usize| (albedo[*k] - speckle(*k) / mean).abs() > 0.03;
        let inside = (0..size * size).filter(|k| (4..60).contains(&(k / size)) && (4..60).contains(&(k % size)));
        assert!(inside.filter(wrong).count() < 60);
    }
}
