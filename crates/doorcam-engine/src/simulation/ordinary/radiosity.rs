use std::f64::consts::PI;

use rayon::prelude::*;

use super::super::room::Vector;
use super::shell::{Shell, Texel};
use super::solid::{Solid, blocked};
use super::source::{Source, Tile, dot};
use doorcam_core::scene::Rgb;

/// Reflections that count if a scenario sets no limit: what is left after them is below a thousandth of the light.
pub(super) const BOUNCES: u32 = 26;
/// Most further reflections of what people change: the rest is below a hundredth of it.
const MOST_RESPONSES: u32 = 9;
/// How far from a surface a line of sight begins, in metres.
const BEFORE_M: f64 = 1e-4;

/// The light that surfaces exchange in the empty room.
#[derive(Debug, Clone)]
pub(super) struct Exchange {
    /// Per source and patch: radiosity / π, its radiance, at level 1.
    pub(super) patches: Vec<Vec<Rgb>>,
    /// Per source and seen texel: irradiance at level 1, direct and indirect.
    pub(super) texels: Vec<Vec<Rgb>>,
    /// Per source and seen texel: the indirect part.
    pub(super) indirect: Vec<Vec<Rgb>>,
    /// Per tile and seen texel: direct irradiance for a radiance of 1.
    pub(super) direct: Vec<Vec<f32>>,
    /// Per tile and patch: direct irradiance for a radiance of 1.
    pub(super) on_patches: Vec<Vec<f32>>,
    /// Form factors from all patches to each, and to each seen texel.
    factors: Vec<f32>,
    gather: Vec<f32>,
    /// Mean albedo of all patches, by channel.
    albedo: Rgb,
    /// How often light is reflected.
    bounces: u32,
    /// Per source: mean irradiance of the doorway's wall, seen from the room.
    pub(super) front: Vec<Rgb>,
}

fn lifted(texel: &Texel) -> Vector {
    [0, 1, 2].map(|k| texel.centre[k] + BEFORE_M * texel.normal[k])
}

/// The part of a small piece's light that arrives at a place, times π: cos cos A / d², bounded where it is close.
fn form(place: Vector, normal: Vector, from: &Texel) -> f64 {
    let d = [0, 1, 2].map(|k| from.centre[k] - place[k]);
    let (arriving, leaving) = (dot(d, normal), -dot(d, from.normal));
    if arriving <= 0.0 || leaving <= 0.0 {
        return 0.0;
    }
    let d2 = dot(d, d);
    from.area * arriving * leaving / (d2 * (PI * d2 + from.area))
}

/// Form factors of all patches, seen from a place; they add up to 1, as those of a closed room do.
fn row(place: Vector, normal: Vector, patches: &[Texel], solids: &[Solid], row: &mut [f32]) {
    let mut sum = 0.0;
    for (out, patch) in row.iter_mut().zip(patches) {
        let factor = form(place, normal, patch);
        let seen = factor > 0.0 && !blocked(solids, place, lifted(patch));
        *out = if seen { factor as f32 } else { 0.0 };
        sum += f64::from(*out);
    }
    if sum > 0.0 {
        let scale = (1.0 / sum) as f32;
        row.iter_mut().for_each(|factor| *factor *= scale);
    }
}

/// Direct irradiance from a tile at a texel, for a radiance of 1.
fn direct(tile: &Tile, texel: &Texel, solids: &[Solid]) -> f64 {
    let place = lifted(texel);
    let (light, _) = tile.irradiance(place, texel.normal, texel.half());
    if light > 0.0 && !blocked(solids, place, tile.from(place).0) { light } else { 0.0 }
}

impl Exchange {
    /// Light that is reflected at most `bounces` times before it falls on the floor.
    pub(super) fn new(shell: &Shell, sources: &[Source], tiles: &[Tile], bounces: u32) -> Self {
        let (patches, solids) = (&shell.patches, &shell.solids);
        let count = patches.len();
        let mut factors = vec![0.0_f32; count * count];
        factors
            .par_chunks_mut(count)
            .zip(patches)
            .for_each(|(out, patch)| row(lifted(patch), patch.normal, patches, solids, out));
        let of_source = |source: usize| -> Vec<Rgb> {
            let tiles: Vec<&Tile> = tiles.iter().filter(|tile| tile.source == source).collect();
            let radiance = sources[source].radiance;
            // What the sources send straight to each patch.
            let straight: Vec<Rgb> = patches
                .iter()
                .map(|patch| {
                    let light: f64 = tiles.iter().map(|tile| direct(tile, patch, solids)).sum();
                    [0, 1, 2].map(|c| light * radiance[c] * patch.albedo[c] / PI)
                })
                .collect();
            let mut shown = straight.clone();
            // Reflected once by now, and once more by what the floor sees.
            for _ in 2..bounces {
                let again = |k: usize| {
                    let light = gathered(&factors[k * count..][..count], &shown);
                    [0, 1, 2].map(|c| straight[k][c] + patches[k].albedo[c] * light[c])
                };
                shown = (0..count).map(again).collect();
            }
            shown
        };
        let shown: Vec<Vec<Rgb>> = (0..sources.len()).into_par_iter().map(of_source).collect();
        let straight = |texels: &[Texel]| -> Vec<Vec<f32>> {
            let on_all = |tile: &Tile| texels.iter().map(|texel| direct(tile, texel, solids) as f32).collect();
            tiles.par_iter().map(on_all).collect()
        };
        let (direct, on_patches) = (straight(&shell.texels), straight(patches));
        let mut gather = vec![0.0_f32; shell.texels.len() * count];
        let by_texel: Vec<Vec<Rgb>> = gather
            .par_chunks_mut(count)
            .zip(&shell.texels)
            .map(|(factors, texel)| {
                row(lifted(texel), texel.normal, patches, solids, factors);
                shown.iter().map(|shown| gathered(factors, shown).map(|c| PI * c)).collect()
            })
            .collect();
        let indirect: Vec<Vec<Rgb>> =
            (0..sources.len()).map(|source| by_texel.iter().map(|all| all[source]).collect()).collect();
        let mut texels = indirect.clone();
        for (tile, direct) in tiles.iter().zip(&direct) {
            let radiance = sources[tile.source].radiance;
            for (texel, light) in texels[tile.source].iter_mut().zip(direct) {
                (0..3).for_each(|c| texel[c] += radiance[c] * f64::from(*light));
            }
        }
        let front = shown.iter().map(|shown| front(patches, shown)).collect();
        let area: f64 = patches.iter().map(|patch| patch.area).sum();
        let mean = |c: usize| patches.iter().map(|patch| patch.area * patch.albedo[c]).sum::<f64>() / area;
        let albedo = [0, 1, 2].map(mean);
        Self { patches: shown, texels, indirect, direct, on_patches, factors, gather, albedo, bounces, front }
    }

    /// What all surfaces make of a change of the irradiance of patches: that of the irradiance of each seen texel, and on
    /// the mean of all patches, after the first reflection. `straight` is the change of what comes straight from lights,
    /// `reflected` that of the rest.
    pub(super) fn response(&self, patches: &[Texel], straight: &[Rgb], reflected: &[Rgb]) -> (Vec<Rgb>, Rgb) {
        let count = patches.len();
        let mut light: [Vec<f32>; 3] = [0, 1, 2].map(|_| vec![0.0; count]);
        // From the last reflection to the first: F ρ (x₁ + F ρ (x₂ + ...)).
        for k in (1..self.bounces.min(MOST_RESPONSES)).rev() {
            let shown = [0, 1, 2].map(|c| {
                let part = self.part(c, k);
                let of = |j: usize| {
                    let change = straight[j][c] + part * reflected[j][c] + f64::from(light[c][j]);
                    (patches[j].albedo[c] * change) as f32
                };
                (0..count).map(of).collect::<Vec<f32>>()
            });
            if k == 1 {
                let at = |row: &[f32]| [0, 1, 2].map(|c| product(row, &shown[c]));
                let texels = self.gather.par_chunks(count).map(at).collect();
                return (texels, self.mean(patches, &shown));
            }
            for (out, shown) in light.iter_mut().zip(&shown) {
                let rows = self.factors.par_chunks(count);
                rows.zip(out).for_each(|(row, out)| *out = product(row, shown) as f32);
            }
        }
        (vec![[0.0; 3]; self.gather.len() / count.max(1)], [0.0; 3])
    }

    /// The part of the reflected light of which k further reflections count: that of which few enough were before.
    fn part(&self, channel: usize, k: u32) -> f64 {
        let rho = self.albedo[channel];
        let sum = |orders: u32| (0..orders).map(|j| rho.powi(j as i32)).sum::<f64>();
        let all = self.bounces.saturating_sub(1).max(1);
        sum(all.saturating_sub(k)) / sum(all)
    }

    /// Mean irradiance that patches with these radiosities give each other.
    fn mean(&self, patches: &[Texel], shown: &[Vec<f32>; 3]) -> Rgb {
        let area: f64 = patches.iter().map(|patch| patch.area).sum();
        let of = |c: usize| patches.iter().zip(&shown[c]).map(|(p, s)| p.area * f64::from(*s)).sum::<f64>() / area;
        [0, 1, 2].map(of)
    }
}

/// Mean radiance of the doorway's wall.
fn front(patches: &[Texel], shown: &[Rgb]) -> Rgb {
    let mut sum = [0.0; 3];
    let mut area = 0.0;
    for (patch, shown) in patches.iter().zip(shown).filter(|(patch, _)| patch.surface == super::shell::FRONT) {
        area += patch.area;
        (0..3).for_each(|c| sum[c] += patch.area * shown[c]);
    }
    sum.map(|c| c / area)
}

/// Σ a b, in as many lanes as processors have.
pub(super) fn product(a: &[f32], b: &[f32]) -> f64 {
    const LANES: usize = 16;
    let mut sums = [0.0_f32; LANES];
    for (a, b) in a.chunks_exact(LANES).zip(b.chunks_exact(LANES)) {
        for (sum, (a, b)) in sums.iter_mut().zip(a.iter().zip(b)) {
            *sum += a * b;
        }
    }
    let whole = a.len() / LANES * LANES;
    let rest: f32 = a[whole..].iter().zip(&b[whole..]).map(|(a, b)| a * b).sum();
    f64::from(sums.iter().sum::<f32>() + rest)
}

/// Σ factor · radiance
pub(super) fn gathered(factors: &[f32], shown: &[Rgb]) -> Rgb {
    let mut sum = [0.0; 3];
    for (factor, shown) in factors.iter().zip(shown).filter(|(factor, _)| **factor > 0.0) {
        (0..3).for_each(|c| sum[c] += f64::from(*factor) * shown[c]);
    }
    sum
}

/// The light that all patches send to a place that faces `normal`, nothing being in the way.
pub(super) fn on_place(place: Vector, normal: Vector, patches: &[Texel], shown: &[Rgb]) -> Rgb {
    let (mut sum, mut whole) = ([0.0; 3], 0.0);
    for (patch, shown) in patches.iter().zip(shown) {
        let factor = form(place, normal, patch);
        if factor > 0.0 {
            whole += factor;
            (0..3).for_each(|c| sum[c] += factor * shown[c]);
        }
    }
    sum.map(|c| PI * c / whole.max(1e-9))
}
