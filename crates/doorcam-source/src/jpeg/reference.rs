//! Decodes a sequential JPEG literally as the standard defines it, slowly and in f64.

use std::collections::HashMap;
use std::f64::consts::PI;

/// Red, green and blue of each pixel, 0 to 255, not rounded.
pub struct Decoded {
    pub width: usize,
    pub height: usize,
    pub pixels: Vec<[f64; 3]>,
}

#[derive(Default)]
struct Component {
    id: u8,
    across: usize,
    down: usize,
    quantisation: u8,
    tables: [u8; 2],
    mean: i32,
    /// Samples a row.
    stride: usize,
    samples: Vec<f64>,
}

/// Symbols by (length, code).
type Codes = HashMap<(u32, u32), u8>;

struct Bits<'a>(&'a [u8], usize);

impl Bits<'_> {
    fn next(&mut self) -> u32 {
        let bit = self.0[self.1 / 8] >> (7 - self.1 % 8) & 1;
        self.1 += 1;
        u32::from(bit)
    }

    fn symbol(&mut self, codes: &Codes) -> u8 {
        let mut code = 0;
        for length in 1..=16 {
            code = code << 1 | self.next();
            if let Some(&symbol) = codes.get(&(length, code)) {
                return symbol;
            }
        }
        panic!("not a code");
    }

    fn number(&mut self, size: u8) -> i32 {
        let bits = (0..size).fold(0, |n, _| n << 1 | self.next() as i32);
        if size > 0 && bits < 1 << (size - 1) { bits + 1 - (1 << size) } else { bits }
    }
}

/// Frequencies across and down in the order of figure A.6: along the diagonals, alternately up and down.
fn zigzag() -> Vec<(usize, usize)> {
    let mut order: Vec<(usize, usize)> = (0..64).map(|k| (k % 8, k / 8)).collect();
    order.sort_by_key(|&(u, v)| (u + v, if (u + v) % 2 == 0 { u } else { v }));
    order
}

/// The definition of the inverse transform (A.3.3).
fn transform(coefficients: &[[f64; 8]; 8], x: usize, y: usize) -> f64 {
    let c = |k: usize| if k == 0 { 0.5_f64.sqrt() } else { 1.0 };
    let wave = |at: usize, k: usize| c(k) * ((2 * at + 1) as f64 * k as f64 * PI / 16.0).cos();
    let terms = (0..8).flat_map(|v| (0..8).map(move |u| (u, v)));
    terms.map(|(u, v)| coefficients[v][u] * wave(x, u) * wave(y, v) / 4.0).sum()
}

pub fn decode(bytes: &[u8]) -> Decoded {
    let (mut steps, mut codes) = (HashMap::new(), HashMap::new());
    let (mut size, mut restart, mut rgb) = ((0, 0), 0, false);
    let mut components: Vec<Component> = Vec::new();
    let mut at = 2;
    loop {
        let (marker, length) = (bytes[at + 1], usize::from(bytes[at + 2]) << 8 | usize::from(bytes[at + 3]));
        let mut content = &bytes[at + 4..at + 2 + length];
        at += 2 + length;
        match marker {
            0xdb => {
                while let [id, rest @ ..] = content {
                    let wide = id >> 4 == 1;
                    let (table, rest) = rest.split_at(if wide { 128 } else { 64 });
                    let step = |k: usize| {
                        if wide {
                            256.0 * f64::from(table[2 * k]) + f64::from(table[2 * k + 1])
                        } else {
                            f64::from(table[k])
                        }
                    };
                    steps.insert(id & 15, (0..64).map(step).collect::<Vec<_>>());
                    content = rest;
                }
            }
            0xc4 => {
                while let [id, rest @ ..] = content {
                    let (counts, mut symbols) = rest.split_at(16);
                    let (mut code, mut table) = (0, Codes::new());
                    for (length, &count) in (1..).zip(counts) {
                        for _ in 0..count {
                            table.insert((length, code), symbols[0]);
                            (code, symbols) = (code + 1, &symbols[1..]);
                        }
                        code <<= 1;
                    }
                    codes.insert((id >> 4, id & 15), table);
                    content = symbols;
                }
            }
            0xdd => restart = usize::from(content[0]) << 8 | usize::from(content[1]),
            0xee => rgb = content.starts_with(b"Adobe") && content[11] == 0,
            0xc0 | 0xc1 => {
                size = (
                    usize::from(content[3]) << 8 | usize::from(content[4]),
                    usize::from(content[1]) << 8 | usize::from(content[2]),
                );
                components = content[6..]
                    .chunks(3)
                    .map(|c| Component {
                        id: c[0],
                        across: usize::from(c[1] >> 4),
                        down: usize::from(c[1] & 15),
                        quantisation: c[2],
                        ..Default::default()
                    })
                    .collect();
            }
            0xda => {
                for (component, chosen) in components.iter_mut().zip(content[1..].chunks(2)) {
                    assert_eq!(component.id, chosen[0]);
                    component.tables = [chosen[1] >> 4, chosen[1] & 15];
                }
                break;
            }
            _ => {}
        }
    }
    if let [grey] = &mut components[..] {
        (grey.across, grey.down) = (1, 1);
    }

    // The data between markers, without the zeros stuffed after 0xff.
    let mut parts = vec![Vec::new()];
    while let [byte, next, ..] = bytes[at..] {
        at += 1;
        match (byte, next) {
            (0xff, 0) => at += 1,
            (0xff, 0xd9) => break,
            (0xff, _) => {
                parts.push(Vec::new());
                at += 1;
                continue;
            }
            _ => {}
        }
        parts.last_mut().unwrap().push(byte);
    }

    let most = (components.iter().map(|c| c.across).max().unwrap(), components.iter().map(|c| c.down).max().unwrap());
    let units = (size.0.div_ceil(8 * most.0), size.1.div_ceil(8 * most.1));
    for component in &mut components {
        component.stride = 8 * component.across * units.0;
        component.samples = vec![0.0; component.stride * 8 * component.down * units.1];
    }
    let (mut parts, mut bits) = (parts.iter(), Bits(&[], 0));
    for unit in 0..units.0 * units.1 {
        if unit == 0 || (restart > 0 && unit % restart == 0) {
            bits = Bits(parts.next().unwrap(), 0);
            components.iter_mut().for_each(|c| c.mean = 0);
        }
        for component in &mut components {
            let table = &steps[&component.quantisation];
            for block in 0..component.across * component.down {
                let mut coefficients = [[0.0; 8]; 8];
                let size = bits.symbol(&codes[&(0, component.tables[0])]);
                component.mean += bits.number(size);
                coefficients[0][0] = f64::from(component.mean) * table[0];
                let mut k = 1;
                while k < 64 {
                    let symbol = bits.symbol(&codes[&(1, component.tables[1])]);
                    match symbol {
                        0 => break,
                        0xf0 => k += 16,
                        _ => {
                            k += usize::from(symbol >> 4);
                            let (u, v) = zigzag()[k];
                            coefficients[v][u] = f64::from(bits.number(symbol & 15)) * table[k];
                            k += 1;
                        }
                    }
                }
                let left = 8 * (unit % units.0 * component.across + block % component.across);
                let top = 8 * (unit / units.0 * component.down + block / component.across);
                for (x, y) in (0..64).map(|k| (k % 8, k / 8)) {
                    component.samples[(top + y) * component.stride + left + x] = 128.0 + transform(&coefficients, x, y);
                }
            }
        }
    }

    // A component's value at a pixel's centre: linear between its samples' centres, constant beyond the outermost.
    let value = |component: &Component, x: usize, y: usize| {
        let along = |pixel: usize, pixels: usize, factor: usize, most: usize| {
            let samples = (pixels * factor).div_ceil(most);
            let at = (pixel as f64 + 0.5) * factor as f64 / most as f64 - 0.5;
            let at = at.clamp(0.0, (samples - 1) as f64);
            (at.floor() as usize, (at.floor() as usize + 1).min(samples - 1), at.fract())
        };
        let (left, right, over) = along(x, size.0, component.across, most.0);
        let (top, bottom, under) = along(y, size.1, component.down, most.1);
        let at = |x: usize, y: usize| component.samples[y * component.stride + x];
        let row = |y: usize| (1.0 - over) * at(left, y) + over * at(right, y);
        (1.0 - under) * row(top) + under * row(bottom)
    };
    let pixel = |k: usize| {
        let values: Vec<f64> = components.iter().map(|c| value(c, k % size.0, k / size.0)).collect();
        match values[..] {
            [grey] => [grey; 3],
            [red, green, blue] if rgb => [red, green, blue],
            // BT.601: luma is 0.299 red + 0.587 green + 0.114 blue.
            [y, cb, cr] => {
                let (red, blue) = (y + 1.402 * (cr - 128.0), y + 1.772 * (cb - 128.0));
                [red, (y - 0.299 * red - 0.114 * blue) / 0.587, blue]
            }
            _ => panic!("one or three components"),
        }
    };
    let pixels = (0..size.0 * size.1).map(|k| pixel(k).map(|v| v.clamp(0.0, 255.0))).collect();
    Decoded { width: size.0, height: size.1, pixels }
}
