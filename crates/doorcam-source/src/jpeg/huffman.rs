//! Huffman tables and decoding (T.81, annexes C and F).

use super::bits::{Bits, extended};
use super::broken::Broken;
use super::standard;

/// Bits of the lookup table that decodes most codes in one step.
const LOOKUP: u32 = 10;

/// One Huffman table, prepared for decoding.
#[derive(Debug, Clone)]
pub(super) struct Huffman {
    /// Indexed by the next LOOKUP bits.
    short: [Entry; 1 << LOOKUP],
    /// By length: an upper bound, exclusive, of the codes of at most this length, left-aligned in 16 bits.
    limit: [u32; 17],
    /// By length: what to add to a code of this length to get the index of its symbol.
    offset: [i32; 17],
    symbols: [u8; 256],
}

/// A symbol and the number after it: number << 16 | symbol << 8 | bits used. The number is 0 if the bits looked up hold
/// only the symbol's code, the bits used are 0 if they do not hold even that.
#[derive(Debug, Clone, Copy, Default)]
struct Entry(u32);

/// The four tables of each class: DC and AC coefficients.
#[derive(Debug, Clone)]
pub(super) struct Tables {
    /// Class 0 (DC), then class 1 (AC).
    tables: Vec<Huffman>,
    defined: [bool; 8],
}

/// A decoded symbol and the number after it: a coefficient, or a difference of DC coefficients.
#[derive(Debug, Clone, Copy)]
pub(super) struct Coefficient {
    /// Number of zero coefficients before it.
    pub run: usize,
    /// Bits of the number; 0 if there is none.
    pub size: u32,
    /// The number; 0 if there is none.
    pub value: i32,
}

impl Default for Tables {
    fn default() -> Self {
        let empty =
            Huffman { short: [Entry::default(); 1 << LOOKUP], limit: [0; 17], offset: [0; 17], symbols: [0; 256] };
        Self { tables: vec![empty; 8], defined: [false; 8] }
    }
}

impl Tables {
    /// Drops all tables; then defines the standard ones if `standard`.
    pub fn reset(&mut self, standard: bool) {
        self.defined = [false; 8];
        if standard {
            for (id, counts, values) in standard::TABLES {
                self.defined[place(id)] = self.tables[place(id)].set(id >> 4, counts, values).is_some();
            }
        }
    }

    /// Stores the tables of a DHT segment; none if they are broken.
    pub fn define(&mut self, mut segment: &[u8]) -> Option<()> {
        while let Some((&id, rest)) = segment.split_first() {
            let (counts, rest) = rest.split_first_chunk()?;
            let total = counts.iter().map(|&n| usize::from(n)).sum();
            let (values, rest) = rest.split_at_checked(total)?;
            if id & 15 > 3 || id >> 4 > 1 {
                return None;
            }
            self.tables[place(id)].set(id >> 4, counts, values)?;
            self.defined[place(id)] = true;
            segment = rest;
        }
        Some(())
    }

    /// The table of this number for class 0 (DC) or 1 (AC), if it is defined.
    pub fn get(&self, class: usize, number: usize) -> Option<&Huffman> {
        let place = 4 * class + number;
        self.tables.get(place).filter(|_| self.defined[place])
    }
}

fn place(id: u8) -> usize {
    usize::from(4 * (id >> 4 & 1) + (id & 3))
}

impl Huffman {
    /// Builds the table from the count of codes of each length and their symbols (T.81, annex C). None if there are
    /// more codes than their lengths allow.
    fn set(&mut self, class: u8, counts: &[u8; 16], symbols: &[u8]) -> Option<()> {
        if symbols.len() > 256 || (class == 0 && symbols.iter().any(|&s| s > 15)) {
            return None;
        }
        self.symbols[..symbols.len()].copy_from_slice(symbols);
        self.short.fill(Entry::default());
        let (mut code, mut place) = (0_u32, 0);
        for length in 1..=16_u32 {
            self.offset[length as usize] = place as i32 - code as i32;
            for _ in 0..counts[length as usize - 1] {
                if code >= 1 << length {
                    return None;
                }
                if length <= LOOKUP {
                    let spare = LOOKUP - length;
                    let first = (code << spare) as usize;
                    for (bits, entry) in self.short[first..first + (1 << spare)].iter_mut().enumerate() {
                        *entry = Entry::new(symbols[place], length, bits as u32, spare);
                    }
                }
                (code, place) = (code + 1, place + 1);
            }
            self.limit[length as usize] = code << (16 - length);
            code <<= 1;
        }
        Some(())
    }

    /// Decodes the next symbol and the number after it.
    #[inline(always)]
    pub fn next(&self, bits: &mut Bits) -> Result<Coefficient, Broken> {
        bits.refill();
        let entry = self.short[bits.peek(LOOKUP)];
        let (value, symbol, length) = (entry.0 as i32 >> 16, entry.0 >> 8 & 0xff, entry.0 & 0xff);
        if value != 0 {
            bits.skip(length);
            return Ok(Coefficient { run: (symbol >> 4) as usize, size: symbol & 15, value });
        }
        let symbol = if length > 0 {
            bits.skip(length);
            symbol
        } else {
            self.long(bits)?
        };
        let size = symbol & 15;
        let value = if size > 0 { bits.number(size) } else { 0 };
        Ok(Coefficient { run: (symbol >> 4) as usize, size, value })
    }

    /// Decodes the symbol of a code of more than LOOKUP bits.
    #[inline(always)]
    fn long(&self, bits: &mut Bits) -> Result<u32, Broken> {
        let next = bits.peek(16);
        for length in LOOKUP as usize + 1..=16 {
            if (next as u32) < self.limit[length] {
                bits.skip(length as u32);
                let place = (next >> (16 - length)) as i32 + self.offset[length];
                return Ok(u32::from(self.symbols[place as usize & 0xff]));
            }
        }
        Err(Broken("its data have an invalid Huffman code"))
    }
}

impl Entry {
    /// For a symbol whose code has `length` bits and is followed by the `spare` bits `bits`.
    fn new(symbol: u8, length: u32, bits: u32, spare: u32) -> Self {
        let size = u32::from(symbol & 15);
        let (value, length) = if (1..=spare).contains(&size) {
            (extended((bits >> (spare - size)) as i32, size), length + size)
        } else {
            (0, length)
        };
        Self((value as u32) << 16 | u32::from(symbol) << 8 | length)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_code_of_the_standard_tables_is_its_symbol() {
        let mut tables = Tables::default();
        tables.reset(true);
        for (id, counts, symbols) in standard::TABLES {
            let table = tables.get(usize::from(id >> 4), usize::from(id & 15)).unwrap();
            // Codes of one length count up; the next length starts from the following code, shifted left (annex C).
            let (mut code, mut symbols) = (0_u32, symbols.iter());
            for (length, &count) in (1..).zip(counts) {
                for _ in 0..count {
                    let symbol = u32::from(*symbols.next().unwrap());
                    let size = symbol & 15;
                    // After the code, the extreme numbers of its size: all zeros, then all ones.
                    for ones in [false, true] {
                        let behind = if ones { (1_u64 << size) - 1 } else { 0 };
                        let word = (u64::from(code) << size | behind) << (64 - length - size);
                        let bytes: Vec<u8> = word
                            .to_be_bytes()
                            .iter()
                            .flat_map(|&b| [b, 0].into_iter().take(if b == 0xff { 2 } else { 1 }))
                            .collect();
                        let found = table.next(&mut Bits::new(&bytes)).unwrap();
                        assert_eq!((found.run as u32) << 4 | found.size, symbol, "{id:x} {length} {code:b}");
                        let number = (1_i32 << size) - 1;
                        assert_eq!(found.value, if ones { number } else { -number });
                    }
                    code += 1;
                }
                code <<= 1;
            }
            assert!(table.next(&mut Bits::new(&[0xff, 0, 0xff, 0, 0xff, 0])).is_err(), "all ones is no code");
        }
    }

    #[test]
    fn tables_that_cannot_be_are_refused() {
        let mut tables = Tables::default();
        let counts = |first: u8| [&[0x10, first][..], &[0; 15], &[1, 2, 3]].concat();
        assert!(tables.define(&counts(2)[..19]).is_some());
        assert!(tables.define(&counts(3)).is_none(), "three codes of one bit");
        assert!(tables.define(&counts(2)[..18]).is_none(), "a symbol is missing");
        assert!(tables.define(&[0x00, 1, 0]).is_none(), "cut off");
        assert!(tables.get(1, 0).is_some() && tables.get(0, 0).is_none());
    }
}
