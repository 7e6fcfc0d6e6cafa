//! Bit reader for entropy-coded data.

use super::broken::Broken;

/// The bits of entropy-coded data between two markers. Past the end it supplies zeros, and counts them.
#[derive(Debug)]
pub(super) struct Bits<'a> {
    bytes: &'a [u8],
    /// Position of the first byte that is not entirely in the window.
    at: usize,
    /// The next bits, from the top.
    window: u64,
    /// Number of valid bits in the window.
    count: u32,
    /// Number of zero bits supplied past the end of the data.
    made_up: u32,
}

impl<'a> Bits<'a> {
    /// From the start of `bytes`.
    pub fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, at: 0, window: 0, count: 0, made_up: 0 }
    }

    /// Fills the window to at least 32 bits: enough for a Huffman code of 16 and the 15 bits that may follow it.
    #[inline(always)]
    pub fn refill(&mut self) {
        if self.count >= 32 {
            return;
        }
        let next = self.bytes.get(self.at..).and_then(<[u8]>::first_chunk).copied().map(u64::from_be_bytes);
        match next {
            Some(next) if !has_ff(next) => {
                // Bits of a last, partial byte enter the window without being counted; the next refill repeats them.
                self.window |= next >> self.count;
                let taken = (63 - self.count) / 8;
                self.at += taken as usize;
                self.count += 8 * taken;
            }
            _ => self.refill_slowly(),
        }
    }

    /// Byte by byte. 0xff is data if a stuffed 0 follows, which is dropped; otherwise it begins a marker.
    #[cold]
    #[inline(never)]
    fn refill_slowly(&mut self) {
        while self.count <= 56 {
            let byte = match self.bytes.get(self.at..) {
                Some(&[0xff, 0, ..]) => {
                    self.at += 2;
                    0xff
                }
                Some(&[byte, ..]) if byte != 0xff => {
                    self.at += 1;
                    byte
                }
                _ => {
                    self.made_up += 8;
                    0
                }
            };
            self.window |= u64::from(byte) << (56 - self.count);
            self.count += 8;
        }
    }

    /// The next `n` bits, 1 to 32, which must be in the window.
    #[inline(always)]
    pub fn peek(&self, n: u32) -> usize {
        (self.window >> (64 - n)) as usize
    }

    /// Consumes `n` bits, which must be in the window.
    #[inline(always)]
    pub fn skip(&mut self, n: u32) {
        self.window <<= n;
        self.count -= n;
    }

    /// Consumes `n` bits, 1 to 15, as a signed number: a leading 0 makes it negative (T.81, F.2.2.1).
    #[inline(always)]
    pub fn number(&mut self, n: u32) -> i32 {
        let bits = self.peek(n) as i32;
        self.skip(n);
        extended(bits, n)
    }

    /// An error if more bits were consumed than there are.
    #[inline(always)]
    pub fn check(&self) -> Result<(), Broken> {
        if self.made_up > self.count { Err(Broken("its data end early")) } else { Ok(()) }
    }

    /// Whether no whole byte is left, but for the beginning of a marker.
    pub fn is_at_end(&self) -> bool {
        let left_over = self.count.saturating_sub(self.made_up);
        left_over < 8 && self.bytes.get(self.at..).is_none_or(|rest| rest.iter().all(|&byte| byte == 0xff))
    }

    /// Moves past the restart marker, which must come next.
    pub fn restart(&mut self) -> Result<(), Broken> {
        self.check()?;
        let left_over = self.count - self.made_up;
        while let Some([0xff, 0xff, ..]) = self.bytes.get(self.at..) {
            self.at += 1;
        }
        match self.bytes.get(self.at..) {
            Some([0xff, 0xd0..=0xd7, ..]) if left_over < 8 => {
                *self = Self { at: self.at + 2, ..Self::new(self.bytes) };
                Ok(())
            }
            _ => Err(Broken("a restart marker is missing or misplaced")),
        }
    }
}

/// The signed number that `n` bits encode (T.81, F.2.2.1, EXTEND).
#[inline(always)]
pub(super) fn extended(bits: i32, n: u32) -> i32 {
    if bits < 1 << (n - 1) { bits - (1 << n) + 1 } else { bits }
}

fn has_ff(bytes: u64) -> bool {
    const LOW: u64 = u64::from_ne_bytes([0x01; 8]);
    const HIGH: u64 = u64::from_ne_bytes([0x80; 8]);
    (!bytes).wrapping_sub(LOW) & bytes & HIGH != 0
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn bits_come_in_order_and_stuffing_is_left_out(
            bytes in proptest::collection::vec(prop_oneof![any::<u8>(), Just(0xff)], 0..60), steps in proptest::collection::vec(1u32..=16, 1..200),
        ) {
            let stuffed: Vec<u8> =
                bytes.iter().flat_map(|&b| [b, 0].into_iter().take(if b == 0xff { 2 } else { 1 })).chain([0xff, 0xd0, 7]).collect();
            let mut bits = Bits::new(&stuffed);
            let bit = |k: usize| bytes.get(k / 8).map_or(0, |b| usize::from(b >> (7 - k % 8) & 1));
            let mut at = 0;
            for step in steps {
                bits.refill();
                let expected = (at..at + step as usize).fold(0, |n, k| n << 1 | bit(k));
                prop_assert_eq!(bits.peek(step), expected);
                bits.skip(step);
                at += step as usize;
                prop_assert_eq!(bits.check().is_err(), at > 8 * bytes.len());
            }
            let whole = at <= 8 * bytes.len() && 8 * bytes.len() - at < 8;
            prop_assert_eq!(bits.restart().is_ok(), whole);
            if whole {
                bits.refill();
                prop_assert_eq!(bits.peek(8), 7);
            }
        }
    }

    #[test]
    fn numbers_are_those_of_the_standard() {
        // T.81, table F.1.
        for (size, bits, number) in
            [(1, 0, -1), (1, 1, 1), (2, 0, -3), (2, 1, -2), (2, 2, 2), (3, 0, -7), (3, 7, 7), (11, 0, -2047)]
        {
            assert_eq!(extended(bits, size), number);
        }
    }
}
