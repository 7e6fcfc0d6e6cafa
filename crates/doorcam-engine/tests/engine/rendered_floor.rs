//! Rectified patches compared with the floor that the rendered recordings show.

use crate::reference;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use doorcam_core::geometry::{Doorway, Side};
use doorcam_core::light::PatchPair;
use doorcam_core::transport::PatchGrid;
use doorcam_engine::FrameReader;
use doorcam_engine::Settings;
use doorcam_source::recording::{Files, Recording};
use doorcam_source::{RawFrame, RawImages};

/// The rendered floor along the wall: linear light in squares of 5 mm, row 0 at the wall, column 0 at the smallest x,
/// extending 0.2 m beyond either edge and 0.3 m from the wall.
struct Strip {
    rows: usize,
    columns: usize,
    light: Vec<f64>,
}

impl Strip {
    /// The strip of the empty room.
    fn read(file: &Path) -> Self {
        let (shape, hidden) = reference::npz_f32(file, "hidden_empty");
        let (_, visible) = reference::npz_f32(file, "visible");
        let light = hidden.iter().zip(&visible).map(|(&h, &v)| f64::from(h) + f64::from(v)).collect();
        Self { rows: shape[0], columns: shape[1], light }
    }

    /// Light at a place in squares from the strip's corner, bilinear between the squares' centres.
    fn at(&self, row: f64, column: f64, channel: usize) -> f64 {
        let split = |at: f64, n: usize| {
            let at = (at - 0.5).clamp(0.0, (n - 1) as f64);
            let low = (at as usize).min(n - 2);
            (low, at - low as f64)
        };
        let ((i, a), (j, b)) = (split(row, self.rows), split(column, self.columns));
        let value = |i: usize, j: usize| self.light[3 * (i * self.columns + j) + channel];
        (1.0 - a) * ((1.0 - b) * value(i, j) + b * value(i, j + 1))
            + a * ((1.0 - b) * value(i + 1, j) + b * value(i + 1, j + 1))
    }

    /// Mean light over a patch pixel's square of floor.
    fn mean(&self, doorway: &Doorway, patch: &PatchGrid, side: Side, k: usize, channel: usize) -> f64 {
        const FINE: usize = 8;
        let [x, y] = patch.point(doorway, side, k / patch.size, k % patch.size);
        let cell = patch.fov_m / patch.size as f64;
        let per_m = self.columns as f64 / (doorway.width_m + 0.4);
        let within = |n: usize| ((n as f64 + 0.5) / FINE as f64 - 0.5) * cell;
        let sample = |s: usize| {
            let (x, y) = (x + within(s % FINE), y + within(s / FINE));
            let (column, row) = (x + doorway.width_m / 2.0 + 0.2, -doorway.wall_thickness_m - y);
            self.at(row * self.rows as f64 / 0.3, column * per_m, channel)
        };
        (0..FINE * FINE).map(sample).sum::<f64>() / (FINE * FINE) as f64
    }
}

/// Red, green and blue per side and pixel.
type Pair = [Vec<[f64; 3]>; 2];

/// The mean of a recording's frames of the empty room, in which little of their noise and JPEG's rounding is left.
fn empty_room(recording: &Recording, reader: &mut FrameReader) -> Pair {
    let [first, end] = recording.manifest.background_frames.expect("frames of the empty room");
    let patch = reader.patch();
    let mut pair = PatchPair::zeros(patch.size);
    let mut mean = [0, 1].map(|_| vec![[0.0; 3]; patch.pixels()]);
    for entry in &recording.frames[first as usize..end as usize] {
        let Files::Camera(file) = &entry.files else { panic!("an image") };
        let frame = RawFrame {
            index: Some(entry.index),
            purpose: recording.purpose(entry.index),
            seconds: entry.seconds,
            images: RawImages::Camera(Arc::new(std::fs::read(file).expect("readable"))),
            time: None,
            name: file.display().to_string().into(),
        };
        reader.read(&frame, &mut pair).expect("a whole frame");
        for (mean, side) in mean.iter_mut().zip(Side::BOTH) {
            for (k, pixel) in mean.iter_mut().enumerate() {
                for (channel, sum) in pixel.iter_mut().enumerate() {
                    *sum += f64::from(pair.side(side).plane(channel)[k]) / (end - first) as f64;
                }
            }
        }
    }
    mean
}

fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0.0), |(s, n), v| (s + v * v, n + 1.0));
    (sum / count).sqrt()
}

#[test]
fn patches_agree_with_the_rendered_floor() {
    for name in ["D1", "D2", "D3"] {
        let Some(path) = reference::data(&format!("rendered/{name}")) else { continue };
        let strip = Strip::read(&path.join("strip.npz"));
        let recording = Recording::open(&path).expect("a recording");
        let mut reader = FrameReader::for_recording(&Settings::default(), &recording.manifest).expect("a reader");
        assert!(reader.seen().expect("a camera").iter().flatten().all(|&seen| seen));
        let patch = reader.patch();
        let got = empty_room(&recording, &mut reader);
        let truth: Pair = Side::BOTH.map(|side| {
            let light = |k, channel| strip.mean(&recording.manifest.doorway, &patch, side, k, channel);
            (0..patch.pixels()).map(|k| [0, 1, 2].map(|channel| light(k, channel))).collect()
        });
        // The images are exposed with one factor for all colours.
        let sum = |pair: &Pair| pair.iter().flatten().flatten().sum::<f64>();
        let exposure = sum(&got) / sum(&truth);
        let level = sum(&got) / (6 * patch.pixels()) as f64;
        // D3's floor is speckled but its strip is not, so only its colours can be compared; their mean gives the
        // speckle.
        let speckled = name == "D3";
        let off: Pair = [0, 1].map(|s| {
            let off = |(got, truth): (&[f64; 3], &[f64; 3])| {
                let speckle = (0..3).map(|c| got[c] / (exposure * truth[c])).sum::<f64>() / 3.0;
                let albedo = if speckled { speckle } else { 1.0 };
                [0, 1, 2].map(|c| 100.0 * (got[c] - albedo * exposure * truth[c]) / level)
            };
            got[s].iter().zip(&truth[s]).map(off).collect()
        });
        let rows = |rows: Range<usize>| {
            let pixels = rows.start * patch.size..rows.end * patch.size;
            rms(off.iter().flat_map(|side| &side[pixels.clone()]).flatten().copied())
        };
        let (all, wall, others) = (rows(0..patch.size), rows(0..1), rows(1..patch.size));
        println!("{name}: off by, in % of the mean (rms): {all:.2} (row at the wall {wall:.2}, others {others:.2})");
        assert!(all < 1.0 && wall < 1.0, "{name}: {all} {wall}");
    }
}
