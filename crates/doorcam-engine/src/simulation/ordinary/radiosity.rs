use std::f64::consts::PI;

use rayon::prelude::*;

use super::super::room::Vector;
use super::shell::{Shell, Texel};
use super::solid::{Solid, blocked};
use super::source::{Source, Tile, dot};
use doorcam_core::scene::Rgb;

/// Rounds of exchange between patches: what is left after them is below a thousandth of the light.
const ROUNDS: usize = 14;
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
    pub(super) fn new(shell: &Shell, sources: &[Source], tiles: &[Tile]) -> Self {
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
            for _ in 0..ROUNDS {
                for k in 0..count {
                    let light = gathered(&factors[k * count..][..count], &shown);
                    shown[k] = [0, 1, 2].map(|c| straight[k][c] + patches[k].albedo[c] * light[c]);
                }
            }
            shown
        };
        let shown: Vec<Vec<Rgb>> = (0..sources.len()).into_par_iter().map(of_source).collect();
        let direct: Vec<Vec<f32>> = tiles
            .par_iter()
            .map(|tile| shell.texels.iter().map(|texel| direct(tile, texel, solids) as f32).collect())
            .collect();
        let by_texel: Vec<Vec<Rgb>> = shell
            .texels
            .par_iter()
            .map_init(
                || vec![0.0_f32; count],
                |factors, texel| {
                    row(lifted(texel), texel.normal, patches, solids, factors);
                    shown.iter().map(|shown| gathered(factors, shown).map(|c| PI * c)).collect()
                },
            )
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
        Self { patches: shown, texels, indirect, direct, front }
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
