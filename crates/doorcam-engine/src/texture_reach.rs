use nalgebra::{DMatrix, DVector};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;

use doorcam_core::geometry::Side;
use doorcam_core::light::{Floor, Patch, light_window, texture_strength};
use doorcam_core::solver::{Correlations, Projection};
use doorcam_core::transport::Transport;

/// Number of floors that are drawn.
const DRAWS: usize = 32;

/// Per side, how far the floor's texture reaches when the visible side's even light changes: the largest dual norm over
/// the facets per unit of [`Projection::even_light`] in a frame, one value per drawn floor.
///
/// Only their scale tells texture from light, so the estimated albedo lacks the part of the texture that is as smooth
/// as light. Even light shows that part, no pattern that is projected out contains it, and it can look like facets. No
/// better estimate is possible: the four smoothest patterns hold four fifths of a typical facet's light, and in those a
/// texture looks like the room's light. The strength of that part, however, can be estimated: floors with white texture
/// as strong as the one that shows are drawn; each is photographed in the real floor's light, its albedo estimated from
/// the photograph in the same way, and then lit evenly. `noise` is the standard deviation that noise adds to the
/// estimated albedo.
pub(super) fn texture_reach(
    transport: &Transport,
    size: usize,
    floors: &[Floor; 2],
    weights: &[Vec<f64>; 2],
    noise: f64,
    projection: &Projection,
) -> [Vec<f64>; 2] {
    [0, 1].map(|s| {
        let (weights, transport) = (&weights[s], transport.side(Side::BOTH[s]));
        let counted: Vec<bool> = weights.iter().map(|&w| w > 0.0).collect();
        let seen = texture_strength(&floors[s].albedo, &counted, size);
        let strength = (seen * seen - noise * noise).max(0.0).sqrt();
        if strength == 0.0 {
            return Vec::new();
        }
        let light = light_without_texture(&floors[s], &counted, strength, size);
        let reach = |draw: usize| {
            let mut random = ChaCha8Rng::seed_from_u64(2);
            random.set_stream((2 * draw + s) as u64);
            let speckle = |_: &f64| 1.0 + strength * Distribution::<f64>::sample(&StandardNormal, &mut random);
            let texture: Vec<f64> = weights.iter().map(speckle).collect();
            let EvenLight { left, albedo, strength } = EvenLight::on(&texture, &light, draw % 3, weights, &counted)?;
            // `left` is orthogonal to the drawn floor's patterns, so the facets' light need not be projected as well.
            // The patterns that `projection` takes out belong to the real floor.
            let rows = DVector::from_fn(left.len(), |k, _| left[k] * weights[k] * albedo[k]);
            let facets = transport.tr_mul(&rows);
            let mut rhs: [[Vec<f64>; 3]; 2] = std::array::from_fn(|_| std::array::from_fn(|_| vec![0.0; facets.len()]));
            rhs[s][0] = facets.iter().zip(projection.radiance()[s]).map(|(light, scale)| light * scale).collect();
            Some(Correlations::new(rhs, 0.0).signed_lambda_max() / strength)
        };
        (0..DRAWS).into_par_iter().filter_map(reach).collect()
    })
}

/// The light on a floor without the contrast that the texture adds to it through its mean over the window. Contrast
/// tells even light from a gain: with too much of it, the texture of the drawn floors would reach less far than the
/// real one.
fn light_without_texture(floor: &Floor, counted: &[bool], strength: f64, size: usize) -> [Vec<f64>; 3] {
    /// Smallest share of the contrast's variance that is kept.
    const LEAST: f64 = 0.1;
    let used = || (0..counted.len()).filter(|&k| counted[k]);
    let count = used().count().max(1) as f64;
    let mean = |values: &dyn Fn(usize) -> f64| used().map(values).sum::<f64>() / count;
    let grey = |k: usize| floor.light.iter().map(|light| light[k]).sum::<f64>() / 3.0;
    let level = mean(&grey);
    let variance = mean(&|k| (grey(k) - level).powi(2));
    let of_texture = (level * strength / light_window(size) as f64).powi(2);
    let kept = if variance > 0.0 { (1.0 - of_texture / variance).max(LEAST).sqrt() } else { 1.0 };
    floor.light.each_ref().map(|light| {
        let level = mean(&|k| light[k]);
        light.iter().map(|value| level + kept * (value - level)).collect()
    })
}

/// Even light of strength 1 in one colour on a floor, projected with the patterns estimated from the floor's picture.
struct EvenLight {
    /// The weighted light that is left after the own picture and the patterns are taken out.
    left: DVector<f64>,
    /// The albedo estimated from the picture.
    albedo: Vec<f64>,
    /// Its strength as [`Projection::even_light`] reports it.
    strength: f64,
}

impl EvenLight {
    /// On a floor with this texture, photographed in `light`; none if its strength is 0 or not finite.
    fn on(texture: &[f64], light: &[Vec<f64>; 3], channel: usize, weights: &[f64], counted: &[bool]) -> Option<Self> {
        let mut picture = Patch::zeros(texture.len().isqrt());
        for (p, light) in light.iter().enumerate() {
            let plane = picture.plane_mut(p).iter_mut();
            plane.zip(texture.iter().zip(light)).for_each(|(v, (a, l))| *v = (a * l) as f32);
        }
        let floor = Floor::from_picture(&picture, counted);
        let weigh =
            |values: &[f64]| DVector::from_iterator(values.len(), values.iter().zip(weights).map(|(v, w)| v * w));
        let own: Vec<f64> = picture.plane(channel).iter().map(|&v| f64::from(v)).collect();
        let own = weigh(&own).normalize();
        let first = weigh(&floor.albedo).normalize();
        let mut left = weigh(texture);
        left.axpy(-own.dot(&left), &own, 1.0);
        let strength = (first.dot(&left) / (1.0 - first.dot(&own).powi(2))).abs();
        let [red, green, blue] = [0, 1, 2].map(|p| weigh(&floor.picture(p)).normalize());
        let patterns = DMatrix::from_columns(&[first, red, green, blue]).qr().q();
        left -= &patterns * patterns.tr_mul(&left);
        let some = strength > 0.0 && strength.is_finite();
        some.then_some(Self { left, albedo: floor.albedo, strength })
    }
}

/// How far texture reaches in a frame, given its reach per unit of even light. The two sides' textures are independent,
/// so their squares add.
pub(super) fn reach_in(per_unit: [f64; 2], projection: &Projection, correlations: &Correlations) -> f64 {
    let norm2 = |rgb: [f64; 3]| rgb.iter().map(|v| v * v).sum::<f64>();
    let [left, right] = projection.even_light(correlations).map(norm2);
    (per_unit[0].powi(2) * left + per_unit[1].powi(2) * right).sqrt()
}
