use super::Overview;

/// A picture without its broad shades, which light casts: only edges and texture are left.
#[derive(Debug, Clone, Default)]
pub(super) struct Filtered {
    pub width: usize,
    pub height: usize,
    /// Each pixel's difference from its surroundings.
    pub values: Vec<f32>,
    rows: Vec<f32>,
    smooth: Vec<f32>,
    sums: Vec<f32>,
}

/// Pixels on each side of one that make its surroundings.
const REACH: usize = 4;

impl Filtered {
    pub fn of(overview: &Overview) -> Self {
        let mut filtered = Self::default();
        filtered.make(overview.width, overview.height, &overview.codes);
        filtered
    }

    /// Filters a picture into this one's memory.
    pub fn make(&mut self, width: usize, height: usize, codes: &[f32]) {
        (self.width, self.height) = (width, height);
        for buffer in [&mut self.values, &mut self.rows, &mut self.smooth] {
            buffer.clear();
            buffer.resize(width * height, 0.0);
        }
        if width < 3 || height < 3 {
            return;
        }
        // Noise and aliasing: the binomial filter 1 2 1 along both axes.
        let smooth = |from: &[f32], to: &mut [f32], step: usize, line: usize, lines: usize, between: usize| {
            for at in 0..lines {
                let start = at * between;
                for k in 0..line {
                    let here = start + k * step;
                    let (left, right) = (start + k.saturating_sub(1) * step, start + (k + 1).min(line - 1) * step);
                    to[here] = 0.25 * (from[left] + from[right]) + 0.5 * from[here];
                }
            }
        };
        smooth(codes, &mut self.rows, 1, width, height, width);
        smooth(&self.rows, &mut self.smooth, width, height, width, 1);
        // Minus the mean over the surroundings, as far as they are in the picture.
        for y in 0..height {
            let line = &self.smooth[y * width..(y + 1) * width];
            let mut sum: f32 = line[..REACH.min(width)].iter().sum();
            let mut count = REACH.min(width);
            for x in 0..width {
                if x + REACH < width {
                    sum += line[x + REACH];
                    count += 1;
                }
                if x > REACH {
                    sum -= line[x - REACH - 1];
                    count -= 1;
                }
                self.rows[y * width + x] = sum / count as f32;
            }
        }
        self.sums.clear();
        self.sums.resize(width, 0.0);
        let sums = &mut self.sums;
        let mut count = REACH.min(height);
        for y in 0..count {
            add(sums, &self.rows[y * width..], 1.0);
        }
        for y in 0..height {
            if y + REACH < height {
                add(sums, &self.rows[(y + REACH) * width..], 1.0);
                count += 1;
            }
            if y > REACH {
                add(sums, &self.rows[(y - REACH - 1) * width..], -1.0);
                count -= 1;
            }
            for ((value, smooth), sum) in
                self.values[y * width..].iter_mut().zip(&self.smooth[y * width..(y + 1) * width]).zip(&*sums)
            {
                *value = smooth - sum / count as f32;
            }
        }
    }

    /// The gradient at a pixel inside the border.
    pub fn gradient(&self, x: usize, y: usize) -> [f32; 2] {
        let at = y * self.width + x;
        [
            0.5 * (self.values[at + 1] - self.values[at - 1]),
            0.5 * (self.values[at + self.width] - self.values[at - self.width]),
        ]
    }

    /// The value between pixels; `None` outside the picture.
    pub fn sample(&self, x: f32, y: f32) -> Option<f32> {
        if !(x >= 0.0 && y >= 0.0) {
            return None;
        }
        let (column, row) = (x as usize, y as usize);
        if column + 1 >= self.width || row + 1 >= self.height {
            return None;
        }
        let (right, down) = (x - column as f32, y - row as f32);
        let at = row * self.width + column;
        let (upper, lower) = (&self.values[at..at + 2], &self.values[at + self.width..at + self.width + 2]);
        let above = upper[0] + right * (upper[1] - upper[0]);
        let below = lower[0] + right * (lower[1] - lower[0]);
        Some(above + down * (below - above))
    }
}

fn add(sums: &mut [f32], line: &[f32], sign: f32) {
    sums.iter_mut().zip(line).for_each(|(sum, value)| *sum += sign * value);
}
