//! The inverse discrete cosine transform of 8 x 8 coefficients (T.81, A.3.3), in f32.
//!
//! Arai, Agui and Nakajima's scaled transform (Trans. IEICE E71, 1988): five multiplications a row; the others are
//! folded into the quantisation.

use std::f32::consts::SQRT_2;
use std::f64::consts::PI;

/// 8 x 8 coefficients or samples.
pub(super) type Block = [[f32; 8]; 8];

/// Zigzag order: for each coefficient in the data, its place, horizontal frequency * 8 + vertical frequency.
pub(super) const ORDER: [u8; 64] = {
    let mut order = [0; 64];
    let (mut u, mut v, mut k) = (0_u8, 0_u8, 0);
    while k < 64 {
        order[k] = 8 * u + v;
        // Along the diagonals, up and to the right, then down and to the left (T.81, figure A.6).
        if (u + v) % 2 == 0 {
            if u == 7 {
                v += 1;
            } else if v == 0 {
                u += 1;
            } else {
                (u, v) = (u + 1, v - 1);
            }
        } else if v == 7 {
            u += 1;
        } else if u == 0 {
            v += 1;
        } else {
            (u, v) = (u - 1, v + 1);
        }
        k += 1;
    }
    order
};

/// The factor by which a coefficient of frequencies u and v is multiplied before [`inverse`].
pub(super) fn scale(u: usize, v: usize) -> f64 {
    let one = |k: usize| if k == 0 { 1.0 } else { 2.0_f64.sqrt() * (k as f64 * PI / 16.0).cos() };
    one(u) * one(v) / 8.0
}

/// Transforms scaled coefficients, indexed by horizontal then vertical frequency, to samples, row by row.
#[inline(always)]
pub(super) fn inverse(coefficients: &mut Block) -> Block {
    pass(coefficients);
    let mut turned = [[0.0; 8]; 8];
    for (x, column) in coefficients.iter().enumerate() {
        for (v, &value) in column.iter().enumerate() {
            turned[v][x] = value;
        }
    }
    pass(&mut turned);
    turned
}

/// Transforms over the first index, for all eight values of the second side by side.
#[inline(always)]
fn pass(block: &mut Block) {
    let [b0, b1, b2, b3, b4, b5, b6, b7] = block;
    for k in 0..8 {
        let (sum, difference) = (b0[k] + b4[k], b0[k] - b4[k]);
        let inner = b2[k] + b6[k];
        let outer = (b2[k] - b6[k]) * SQRT_2 - inner;
        let even = [sum + inner, difference + outer, difference - outer, sum - inner];

        let (z13, z10) = (b5[k] + b3[k], b5[k] - b3[k]);
        let (z11, z12) = (b1[k] + b7[k], b1[k] - b7[k]);
        let z5 = (z10 + z12) * 1.847_759_1;
        let o0 = z11 + z13;
        let o1 = z5 - z10 * 2.613_126 - o0;
        let o2 = (z11 - z13) * SQRT_2 - o1;
        let o3 = z5 - z12 * 1.082_392_2 - o2;

        (b0[k], b7[k]) = (even[0] + o0, even[0] - o0);
        (b1[k], b6[k]) = (even[1] + o1, even[1] - o1);
        (b2[k], b5[k]) = (even[2] + o2, even[2] - o2);
        (b3[k], b4[k]) = (even[3] + o3, even[3] - o3);
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn the_order_is_that_of_figure_a_6() {
        let rows = [[0, 1, 5, 6, 14, 15, 27, 28], [2, 4, 7, 13, 16, 26, 29, 42]];
        for (v, row) in rows.iter().enumerate() {
            for (u, &k) in row.iter().enumerate() {
                assert_eq!(usize::from(ORDER[k as usize]), 8 * u + v);
            }
        }
        let mut all = ORDER;
        all.sort_unstable();
        assert!(all.iter().enumerate().all(|(k, &place)| k == usize::from(place)));
    }

    proptest! {
        #[test]
        fn samples_are_those_of_the_definition(values in proptest::collection::vec(-1000i32..1000, 64), keep in 1usize..=64) {
            let mut coefficients = [[0.0; 8]; 8];
            let value = |u: usize, v: usize| if (v * 8 + u).is_multiple_of(keep) { f64::from(values[8 * u + v]) } else { 0.0 };
            for (u, column) in coefficients.iter_mut().enumerate() {
                for (v, c) in column.iter_mut().enumerate() {
                    *c = (value(u, v) * scale(u, v)) as f32;
                }
            }
            let samples = inverse(&mut coefficients);
            for (y, row) in samples.iter().enumerate() {
                for (x, &sample) in row.iter().enumerate() {
                    let mut sum = 0.0;
                    for u in 0..8 {
                        for v in 0..8 {
                            let c = |k: usize| if k == 0 { 0.5_f64.sqrt() } else { 1.0 };
                            let wave = |at: usize, k: usize| ((2 * at + 1) as f64 * k as f64 * PI / 16.0).cos();
                            sum += c(u) * c(v) / 4.0 * value(u, v) * wave(x, u) * wave(y, v);
                        }
                    }
                    prop_assert!((f64::from(sample) - sum).abs() < 0.01, "{x} {y}: {sample} {sum}");
                }
            }
        }
    }
}
