//! A JPEG decoder without intermediate rounding, for measuring.
//!
//! Ordinary decoders round luma and chroma to 8 bits before converting them to colours, and then round the colours. The
//! error is small, but it is the same over whole areas of a floor of one colour, so averaging over pixels does not
//! remove it. Here everything between the coefficients and the 16-bit codes is f32.

use std::ops::Range;

use pulp::{Arch, Simd, WithSimd};

use super::bits::Bits;
use super::broken::Broken;
use super::colour::{Scratch, Strip, write_row};
use super::header::{Colours, Component, Header, Quantisation};
use super::huffman::{Huffman, Tables};
use super::idct::{Block, ORDER, inverse};
use super::outline::Outline;
use crate::image_error::{ImageError, check_size};
use doorcam_core::image::Image;

/// Decodes JPEG after JPEG, reusing its buffers.
#[derive(Debug, Clone)]
pub(super) struct Exact {
    arch: Arch,
    quantisation: Quantisation,
    huffman: Tables,
    strips: [Strip; 3],
    scratch: [Scratch; 3],
}

impl Default for Exact {
    fn default() -> Self {
        Self::on(Arch::new())
    }
}

impl Exact {
    /// A decoder that uses these vector instructions. The result does not depend on them.
    pub fn on(arch: Arch) -> Self {
        let (strips, scratch) = (Default::default(), Default::default());
        Self { arch, quantisation: Quantisation::default(), huffman: Tables::default(), strips, scratch }
    }

    /// Reads the header of a JPEG (without what follows its end marker) and stores its tables. None for kinds that this
    /// decoder does not support: progressive, several scans, more than 8 bits, or other than grey, YCbCr and RGB.
    pub fn header(&mut self, bytes: &[u8], outline: &Outline) -> Option<Header> {
        if !outline.sequential || outline.scans != 1 {
            return None;
        }
        self.huffman.reset(!outline.huffman_tables);
        Header::read(bytes, &mut self.quantisation, &mut self.huffman)
    }

    /// Decodes `rows` of the JPEG whose header was read last into `image`, at 16 bits a sample: a value v of 0 to 255
    /// becomes 257 v. The image's other rows keep their contents. Data below the last of the rows are read only if the
    /// JPEG has no restart markers or no end marker, since nothing else then reveals a missing part.
    pub fn decode(
        &mut self,
        bytes: &[u8],
        header: &Header,
        outline: &Outline,
        expected: Option<(usize, usize)>,
        rows: Range<usize>,
        image: &mut Image,
    ) -> Result<(), ImageError> {
        let (width, height) = (header.width, header.height);
        check_size((width, height), expected)?;
        let data = bytes.get(header.data..).unwrap_or(&[]);
        // A block takes at least two bits, which bounds the image that a short file can claim.
        let blocks: usize = header.used().iter().map(|c| c.across * c.down).sum();
        let (across, down) = header.units();
        if across * down * blocks > 4 * data.len() {
            return Err(Broken("its data end early").into());
        }
        let Self { arch, quantisation, huffman, strips, scratch } = self;
        let mut tables = [None; 3];
        for (table, component) in tables.iter_mut().zip(header.used()) {
            *table = Some(BlockTables::of(component, quantisation, huffman)?);
        }
        for (strip, component) in strips.iter_mut().zip(header.used()) {
            strip.resize(8 * component.across * across, 8 * component.down);
            strip.halved = (component.across < header.most.0, component.down < header.most.1);
            let part = |pixels: usize, halved: bool| if halved { pixels.div_ceil(2) } else { pixels };
            strip.size = (part(width, strip.halved.0), part(height, strip.halved.1));
        }
        let samples = image.sixteen_mut(width, height);
        let rows = rows.start.min(height)..rows.end.min(height);
        let scan = Scan { header, tables, data, rows, ended: outline.ended, strips, scratch, samples };
        Ok(arch.dispatch(scan)?)
    }
}

/// The tables for a component's blocks.
#[derive(Debug, Clone, Copy)]
struct BlockTables<'a> {
    steps: &'a [f32; 64],
    dc: &'a Huffman,
    ac: &'a Huffman,
}

/// The decoding of a scan, compiled for the processor's widest vectors.
struct Scan<'a> {
    header: &'a Header,
    /// Some for each component in use.
    tables: [Option<BlockTables<'a>>; 3],
    data: &'a [u8],
    rows: Range<usize>,
    /// Whether there is an end marker.
    ended: bool,
    strips: &'a mut [Strip; 3],
    scratch: &'a mut [Scratch; 3],
    samples: &'a mut [u16],
}

impl WithSimd for Scan<'_> {
    type Output = Result<(), Broken>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Self::Output {
        let Self { header, tables, data, rows, ended, strips, scratch, samples } = self;
        if rows.is_empty() {
            return Ok(());
        }
        let (across, down) = header.units();
        let unit = 8 * header.most.1;
        // With vertically halved chroma, the rows next to a border between rows of units need the chroma of both.
        let late = usize::from(header.colours != Colours::Grey && strips.iter().any(|s| s.halved.1));
        let wanted = rows.start.saturating_sub(late) / unit..((rows.end + late - 1) / unit + 1).min(down);

        let mut bits = Bits::new(data);
        let mut means = [0_i32; 3];
        let mut units_left = header.restart_interval;
        // Without restart markers or an end marker, a missing part shows only in that the data run out early.
        let read = if header.restart_interval > 0 && ended { wanted.end } else { down };
        for unit_row in 0..read {
            let show = wanted.contains(&unit_row);
            for unit_column in 0..across {
                if header.restart_interval > 0 {
                    if units_left == 0 {
                        bits.restart()?;
                        means = [0; 3];
                        units_left = header.restart_interval;
                    }
                    units_left -= 1;
                }
                for (n, component) in header.components.iter().enumerate() {
                    let Some(tables) = &tables[n] else { break };
                    let level = if n == 0 || header.colours == Colours::Rgb { 128.0 } else { 0.0 };
                    for y in 0..component.down {
                        for x in 0..component.across {
                            if !show {
                                tables.skip(&mut bits, &mut means[n])?;
                                continue;
                            }
                            let strip = &mut strips[n];
                            let corner = 8 * (unit_column * component.across + x) + (1 + 8 * y) * strip.stride;
                            let rows = strip.samples[corner..].chunks_mut(strip.stride);
                            tables.decode(&mut bits, &mut means[n], level, rows)?;
                        }
                    }
                }
            }
            bits.check()?;
            if !show {
                continue;
            }
            let last = if unit_row + 1 == down { header.height } else { (unit_row + 1) * unit - late };
            let first = (unit_row * unit).saturating_sub(late);
            for (strip, component) in strips.iter_mut().zip(&header.components) {
                strip.above = unit_row * 8 * component.down;
            }
            for y in first.max(rows.start)..last.min(rows.end) {
                let out = &mut samples[3 * header.width * y..][..3 * header.width];
                write_row(strips, header.colours, y, scratch, out);
            }
            strips.iter_mut().for_each(Strip::next);
        }
        // Something else than the end marker follows, or the data are padded: they may have been cut off anywhere.
        if ended || bits.is_at_end() { Ok(()) } else { Err(Broken("its data go on after the image")) }
    }
}

impl<'a> BlockTables<'a> {
    fn of(component: &Component, quantisation: &'a Quantisation, huffman: &'a Tables) -> Result<Self, Broken> {
        let missing = Broken("a Huffman table is missing");
        Ok(Self {
            steps: quantisation.get(component.quantisation).ok_or(Broken("a quantisation table is missing"))?,
            dc: huffman.get(0, component.dc_table).ok_or(missing)?,
            ac: huffman.get(1, component.ac_table).ok_or(missing)?,
        })
    }

    /// Decodes a block into the first 8 samples of 8 rows. `mean` is the DC coefficient of the component's previous
    /// block, then of this one.
    #[inline(always)]
    fn decode<'s>(
        &self,
        bits: &mut Bits,
        mean: &mut i32,
        level: f32,
        rows: impl Iterator<Item = &'s mut [f32]>,
    ) -> Result<(), Broken> {
        *mean = mean.wrapping_add(self.dc.next(bits)?.value);
        let mean = *mean as f32 * self.steps[0] + level;
        let mut block: Block = [[0.0; 8]; 8];
        let mut last = 0;
        self.coefficients(bits, |k, value| {
            let place = ORDER[k];
            block[usize::from(place / 8)][usize::from(place % 8)] = value as f32 * self.steps[k];
            last = k;
        })?;
        if last == 0 {
            rows.take(8).for_each(|row| row[..8].fill(mean));
            return Ok(());
        }
        block[0][0] = mean;
        let samples = inverse(&mut block);
        rows.zip(&samples).for_each(|(row, samples)| row[..8].copy_from_slice(samples));
        Ok(())
    }

    /// Skips a block, keeping track of the DC coefficient.
    #[inline(always)]
    fn skip(&self, bits: &mut Bits, mean: &mut i32) -> Result<(), Broken> {
        *mean = mean.wrapping_add(self.dc.next(bits)?.value);
        self.coefficients(bits, |_, _| {})
    }

    /// Passes each non-zero AC coefficient of a block to `each`, with its index in zigzag order (T.81, F.2.2.2).
    #[inline(always)]
    fn coefficients(&self, bits: &mut Bits, mut each: impl FnMut(usize, i32)) -> Result<(), Broken> {
        let mut k = 1;
        while k < 64 {
            let next = self.ac.next(bits)?;
            if next.size == 0 {
                match next.run {
                    0 => return Ok(()),
                    15 => k += 16,
                    _ => return Err(Broken("its data have an invalid Huffman symbol")),
                }
                continue;
            }
            k += next.run;
            if k > 63 {
                break;
            }
            each(k, next.value);
            k += 1;
        }
        if k == 64 { Ok(()) } else { Err(Broken("a block has more than 64 coefficients")) }
    }
}
