use std::f64::consts::TAU;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;

use super::scenario::{CameraSpec, FlickerSpec};
use super::view::View;
use super::visible::Sight;
use doorcam_core::optics::Transfer;

/// Entries of the table from light to codes: fine enough for the steepest part of sRGB.
const TABLE: usize = 1 << 14;
/// Number of pixel rows that share a noise stream.
const BAND: usize = 16;

/// Turns a frame's light into codes: shutter, noise, transfer function.
#[derive(Debug, Clone)]
pub(super) struct Exposure {
    /// From light, with full scale 1, to 8-bit codes.
    table: Vec<u8>,
    full_scale_electrons: f64,
    read_electrons: f64,
    flicker: Option<FlickerSpec>,
}

/// What varies from frame to frame.
#[derive(Debug, Clone)]
pub(super) struct Shot {
    pub(super) seed: u64,
    pub(super) number: u64,
    pub(super) seconds: f64,
    /// Factor from the scene's light to full scale 1.
    pub(super) gain: f64,
    /// The visible side's light where it is not blocked.
    pub(super) visible: [f64; 3],
    /// What the visible side's lamps and people make of each pixel; none if there are none.
    pub(super) sights: Option<Vec<Sight>>,
}

impl Exposure {
    pub(super) fn new(camera: &CameraSpec, flicker: Option<FlickerSpec>) -> Self {
        Self {
            table: code_table(&camera.transfer),
            full_scale_electrons: camera.full_scale_electrons,
            read_electrons: camera.read_electrons,
            flicker,
        }
    }

    /// 8-bit codes.
    pub(super) fn eight_bits(&self, view: &View, light: &[[f32; 3]], shot: &Shot) -> Vec<u8> {
        self.develop(view, light, shot, |value| {
            // The conversion saturates at both ends, as a sensor does.
            self.table[((value * (TABLE - 1) as f32 + 0.5) as usize).min(TABLE - 1)]
        })
    }

    /// Linear 16-bit codes.
    pub(super) fn sixteen_bits(&self, view: &View, light: &[[f32; 3]], shot: &Shot) -> Vec<u16> {
        self.develop(view, light, shot, |value| (value * 65535.0).round() as u16)
    }

    fn develop<C: Copy + Default + Send + Sync>(
        &self,
        view: &View,
        light: &[[f32; 3]],
        shot: &Shot,
        code: impl Fn(f32) -> C + Sync,
    ) -> Vec<C> {
        let mut codes = vec![C::default(); 3 * view.pixels.len()];
        let pixels = view.pixels.par_chunks(BAND * view.width);
        codes.par_chunks_mut(3 * BAND * view.width).zip(pixels).enumerate().for_each(|(band, (codes, pixels))| {
            let mut noise = self.noise(shot, band);
            for (row, (codes, pixels)) in codes.chunks_mut(3 * view.width).zip(pixels.chunks(view.width)).enumerate() {
                let [hidden, visible] = self.flicker(shot, BAND * band + row);
                let hidden = (shot.gain * hidden) as f32;
                let visible_gain = (shot.gain * visible) as f32;
                let visible = shot.visible.map(|v| (shot.gain * visible * v) as f32);
                let first = (BAND * band + row) * view.width;
                for (k, (codes, pixel)) in codes.chunks_exact_mut(3).zip(pixels).enumerate() {
                    let [a, b] = pixel.taps.map(|tap| tap.of(light));
                    let sight = shot.sights.as_ref().map(|sights| &sights[first + k]);
                    for (c, out) in codes.iter_mut().enumerate() {
                        let falls = sight.map_or(pixel.visible, |sight| sight.floor[c]);
                        let on_floor = hidden * (a[c] + b[c]) + visible[c] * falls;
                        let mut light = pixel.floor[c] * on_floor + pixel.flat[c] * visible[c];
                        if let Some(sight) = sight {
                            // A body's own light, of both sides, flickers with that of the visible side.
                            light = light * (1.0 - sight.covered) + visible_gain * sight.body[c];
                        }
                        *out = code(noise.add(light));
                    }
                }
            }
        });
        codes
    }

    /// The noise of one band of rows of a frame. Each band has its own stream, so that frames can be made in any order.
    fn noise(&self, shot: &Shot, band: usize) -> Noise {
        let mut generator = ChaCha8Rng::seed_from_u64(shot.seed);
        generator.set_stream((shot.number << 8) | band as u64);
        Noise {
            generator,
            photon: (1.0 / self.full_scale_electrons) as f32,
            read: (self.read_electrons / self.full_scale_electrons).powi(2) as f32,
        }
    }

    /// Factors on the hidden and the visible light in a row: the mean of 1 + d sin(2π 2f t) over its exposure.
    fn flicker(&self, shot: &Shot, row: usize) -> [f64; 2] {
        let Some(flicker) = &self.flicker else { return [1.0; 2] };
        let turn = TAU * 2.0 * flicker.mains_hz;
        let half = turn * flicker.exposure_s / 2.0;
        let smoothed = if half > 1e-9 { half.sin() / half } else { 1.0 };
        let middle = shot.seconds + row as f64 * flicker.line_s + flicker.exposure_s / 2.0;
        let wave = smoothed * (turn * middle).sin();
        [1.0 + flicker.hidden * wave, 1.0 + flicker.visible * wave]
    }
}

/// Photon and read noise for successive pixels.
///
/// With n electrons the variance is n + read². With hundreds of electrons Poisson's distribution is nearly normal.
struct Noise {
    generator: ChaCha8Rng,
    photon: f32,
    read: f32,
}

impl Noise {
    fn add(&mut self, light: f32) -> f32 {
        let normal: f32 = StandardNormal.sample(&mut self.generator);
        light + (light * self.photon + self.read).sqrt() * normal
    }
}

/// The nearest code for each light level.
fn code_table(transfer: &Transfer) -> Vec<u8> {
    let mut code = 0_u8;
    (0..TABLE)
        .map(|k| {
            let light = k as f64 / (TABLE - 1) as f64;
            while code < 255 && transfer.light((f64::from(code) + 0.5) / 255.0) < light {
                code += 1;
            }
            code
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::super::floor::Tap;
    use super::super::scenario::{SMALLEST, Scenario};
    use super::super::view::Pixel;
    use super::*;

    /// A grey floor, lit by the visible side only.
    fn grey(size: usize) -> View {
        let pixel = Pixel { taps: [Tap::default(); 2], floor: [0.5; 3], flat: [0.0; 3], visible: 1.0 };
        View { pixels: vec![pixel; size * size], places: vec![[0.0; 2]; size * size], width: size }
    }

    fn shot(number: u64) -> Shot {
        Shot { seed: 7, number, seconds: number as f64 / 10.0, gain: 1.0, visible: [0.8; 3], sights: None }
    }

    const DARK: [[f32; 3]; 2] = [[0.0; 3]; 2];

    #[test]
    fn the_noise_has_the_sensors_mean_and_variance_and_each_frame_its_own() {
        let camera = Scenario::parse(SMALLEST).unwrap().camera;
        let exposure = Exposure::new(&camera, None);
        let codes = exposure.sixteen_bits(&grey(100), &DARK, &shot(3));
        let light: Vec<f64> = codes.iter().map(|&c| f64::from(c) / 65535.0).collect();
        let count = light.len() as f64;
        let mean = light.iter().sum::<f64>() / count;
        let variance = light.iter().map(|l| (l - mean).powi(2)).sum::<f64>() / (count - 1.0);
        let expected = (0.4 * 1e4 + 64.0) / 1e8;
        // Four standard errors of each.
        assert!((mean - 0.4).abs() < 4.0 * (expected / count).sqrt(), "{mean}");
        assert!((variance / expected - 1.0).abs() < 4.0 * (2.0 / count).sqrt(), "{variance} {expected}");
        assert_eq!(codes, exposure.sixteen_bits(&grey(100), &DARK, &shot(3)));
        assert_ne!(codes, exposure.sixteen_bits(&grey(100), &DARK, &shot(4)));
        let bands: Vec<&[u16]> = codes.chunks(3 * BAND * 100).collect();
        assert_ne!(bands[0], bands[1]);
    }

    #[test]
    fn codes_are_the_nearest_of_the_transfer_curve() {
        for transfer in [Transfer::Srgb, Transfer::Linear, Transfer::Gamma(2.2)] {
            let table = code_table(&transfer);
            for code in 1..=254_u8 {
                let light = transfer.light(f64::from(code) / 255.0);
                // In the dark, the table's steps are coarser than those of a gamma curve.
                if light > 1e-3 {
                    assert_eq!(table[(light * (TABLE - 1) as f64).round() as usize], code, "{transfer:?}");
                }
            }
        }
    }

    /// Compared with the literal mean over the exposure time.
    #[test]
    fn rows_flicker_by_the_mean_of_the_mains_over_their_exposure() {
        let camera = Scenario::parse(SMALLEST).unwrap().camera;
        let flicker = FlickerSpec { mains_hz: 50.0, hidden: 0.1, visible: 0.3, exposure_s: 0.004, line_s: 3e-5 };
        let exposure = Exposure::new(&camera, Some(flicker));
        for (number, row) in [(0, 0), (3, 17), (8, 200)] {
            let start = shot(number).seconds + f64::from(row) * 3e-5;
            let wave: f64 =
                (0..1000).map(|k| (TAU * 100.0 * (start + (f64::from(k) + 0.5) * 4e-6)).sin() / 1000.0).sum();
            let [hidden, visible] = exposure.flicker(&shot(number), row as usize);
            assert!((hidden - 1.0 - 0.1 * wave).abs() < 1e-6 && (visible - 1.0 - 0.3 * wave).abs() < 1e-6);
        }
        assert_eq!(Exposure::new(&camera, None).flicker(&shot(5), 3), [1.0; 2]);
    }
}
