//! Reads a JPEG's header segments.

use super::huffman::Tables;
use super::idct::{ORDER, scale};
use super::outline::{big_endian, next_marker, segment};

/// The layout of a JPEG that [`super::exact::Exact`] decodes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Header {
    /// Pixels across.
    pub width: usize,
    /// Pixels down.
    pub height: usize,
    /// Components; only the first is used if grey.
    pub components: [Component; 3],
    /// What the components mean.
    pub colours: Colours,
    /// The largest sampling factors, horizontal and vertical.
    pub most: (usize, usize),
    /// Units (MCU) between restart markers; 0 if there are none.
    pub restart_interval: usize,
    /// Position at which the entropy-coded data begin.
    pub data: usize,
}

/// What the components of an image mean.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Colours {
    Grey,
    YCbCr,
    Rgb,
}

/// One component and the numbers of its tables.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Component {
    id: u8,
    /// Sampling factor across, in blocks per unit.
    pub across: usize,
    /// Sampling factor down, in blocks per unit.
    pub down: usize,
    pub quantisation: usize,
    pub dc_table: usize,
    pub ac_table: usize,
}

/// The four quantisation tables in zigzag order, multiplied by the transform's [`scale`].
#[derive(Debug, Clone)]
pub(super) struct Quantisation {
    tables: [[f32; 64]; 4],
    defined: [bool; 4],
}

impl Default for Quantisation {
    fn default() -> Self {
        Self { tables: [[0.0; 64]; 4], defined: [false; 4] }
    }
}

impl Quantisation {
    /// The table of this number, if it is defined.
    pub fn get(&self, number: usize) -> Option<&[f32; 64]> {
        self.tables.get(number).filter(|_| self.defined[number])
    }

    fn define(&mut self, mut segment: &[u8]) -> Option<()> {
        while let Some((&id, rest)) = segment.split_first() {
            let (number, bytes) = (usize::from(id & 15), 1 + usize::from(id >> 4));
            if number > 3 || bytes > 2 {
                return None;
            }
            let (steps, rest) = rest.split_at_checked(64 * bytes)?;
            for ((step, factor), place) in steps.chunks_exact(bytes).zip(&mut self.tables[number]).zip(ORDER) {
                let (u, v) = (usize::from(place / 8), usize::from(place % 8));
                *factor = (big_endian(step) as f64 * scale(u, v)) as f32;
            }
            self.defined[number] = true;
            segment = rest;
        }
        Some(())
    }
}

impl Header {
    /// Reads the header of a sequential 8-bit JPEG with one scan, grey or of three components with sampling factors of
    /// 1 and 2, and stores its tables. None for any other kind, and for inconsistent headers.
    pub fn read(bytes: &[u8], quantisation: &mut Quantisation, huffman: &mut Tables) -> Option<Self> {
        quantisation.defined = [false; 4];
        let (mut frame, mut restart_interval, mut jfif, mut adobe) = (None, 0, false, None);
        let mut at = 2;
        loop {
            let (marker, after) = next_marker(bytes, at)?;
            let content = segment(bytes, after)?;
            at = after + 2 + content.len();
            match marker {
                0xc0 | 0xc1 if frame.is_none() => frame = Some(content),
                // Other kinds of frames, a second frame, or DNL.
                0xc0..=0xc3 | 0xc5..=0xcf | 0xdc => return None,
                0xc4 => huffman.define(content)?,
                0xdb => quantisation.define(content)?,
                0xdd => restart_interval = big_endian(content.get(..2)?),
                0xe0 => jfif |= content.starts_with(b"JFIF\0"),
                0xee if content.starts_with(b"Adobe") => adobe = Some(*content.get(11)?),
                0xda => {
                    let mut header = Self::of_frame(frame?)?;
                    header.restart_interval = restart_interval;
                    header.data = at;
                    let grey = header.colours == Colours::Grey;
                    header.scan(content)?;
                    if !grey {
                        header.colours = colours(jfif, adobe, header.components.map(|c| c.id))?;
                    }
                    return Some(header);
                }
                _ => {}
            }
        }
    }

    fn of_frame(frame: &[u8]) -> Option<Self> {
        let (height, width) = (big_endian(frame.get(1..3)?), big_endian(frame.get(3..5)?));
        let grey = match frame.get(5)? {
            1 => true,
            3 => false,
            _ => return None,
        };
        if frame[0] != 8 || width == 0 || height == 0 {
            return None;
        }
        let mut components = [Component::default(); 3];
        let count = if grey { 1 } else { 3 };
        for (component, bytes) in components.iter_mut().zip(frame.get(6..6 + 3 * count)?.chunks_exact(3)) {
            let (across, down) = (usize::from(bytes[1] >> 4), usize::from(bytes[1] & 15));
            // A single component is not interleaved: its units are its blocks, whatever its sampling factors.
            (component.across, component.down) = if grey { (1, 1) } else { (across, down) };
            if !(1..=2).contains(&component.across) || !(1..=2).contains(&component.down) {
                return None;
            }
            (component.id, component.quantisation) = (bytes[0], usize::from(bytes[2]));
        }
        let most = components.iter().fold((1, 1), |(a, d), c| (a.max(c.across), d.max(c.down)));
        let colours = if grey { Colours::Grey } else { Colours::YCbCr };
        Some(Self { width, height, components, colours, most, restart_interval: 0, data: 0 })
    }

    /// Takes the numbers of the Huffman tables from the header of a scan, which must have all components.
    fn scan(&mut self, scan: &[u8]) -> Option<()> {
        let count = self.used().len();
        if usize::from(*scan.first()?) != count || scan.len() != 4 + 2 * count || scan[1 + 2 * count..] != [0, 63, 0] {
            return None;
        }
        for (component, bytes) in self.components[..count].iter_mut().zip(scan[1..].chunks_exact(2)) {
            if bytes[0] != component.id {
                return None;
            }
            (component.dc_table, component.ac_table) = (usize::from(bytes[1] >> 4), usize::from(bytes[1] & 15));
        }
        Some(())
    }

    /// The components in use: one if grey, otherwise three.
    pub fn used(&self) -> &[Component] {
        &self.components[..if self.colours == Colours::Grey { 1 } else { 3 }]
    }

    /// Units (MCU) across and down.
    pub fn units(&self) -> (usize, usize) {
        (self.width.div_ceil(8 * self.most.0), self.height.div_ceil(8 * self.most.1))
    }
}

/// What three components mean: always YCbCr in JFIF, else as Adobe's marker says, else by the components' names.
fn colours(jfif: bool, adobe: Option<u8>, ids: [u8; 3]) -> Option<Colours> {
    match adobe {
        _ if jfif => Some(Colours::YCbCr),
        Some(0) => Some(Colours::Rgb),
        Some(1) => Some(Colours::YCbCr),
        Some(_) => None,
        None if ids == *b"RGB" => Some(Colours::Rgb),
        None => Some(Colours::YCbCr),
    }
}
