//! What is compiled for the processor's widest vectors gives the same numbers without them, to the last bit.

use proptest::prelude::*;
use pulp::{Arch, Scalar, WithSimd};

use super::active::TakeOut;
use super::dual::SignedDualNorms;
use super::tangent::Products;
use crate::scene::Intensity;

fn plain<W: WithSimd>(work: W) -> W::Output {
    work.with_simd(Scalar::new())
}

fn values(count: usize) -> impl Strategy<Value = Vec<f64>> {
    prop::collection::vec(prop_oneof![-1.0..1.0f64, Just(0.0)], count)
}

const N: usize = 37;

proptest! {
    #[test]
    fn vectors_change_nothing(planes in prop::array::uniform6(values(N)), gram in prop::array::uniform2(values(N)),
        light in prop::array::uniform2(0.0..1.0f64), colour in prop::array::uniform3(-1.0..1.0f64))
    {
        let [l0, l1, l2, r0, r1, r2] = planes;
        let sides = [[l0, l1, l2], [r0, r1, r2]];

        let (mut wide, mut narrow) = (vec![0.0; N], vec![0.0; N]);
        Arch::new().dispatch(SignedDualNorms { correlations: &sides, out: &mut wide });
        plain(SignedDualNorms { correlations: &sides, out: &mut narrow });
        prop_assert_eq!(&wide, &narrow);

        let moves = sides.each_ref().map(|side| side.each_ref().map(Vec::as_slice));
        let rows = gram.each_ref().map(Vec::as_slice);
        Arch::new().dispatch(Products { moves, rows, column: &mut wide });
        plain(Products { moves, rows, column: &mut narrow });
        prop_assert_eq!(&wide, &narrow);

        let lit = Intensity { left: light[0], right: light[1], colour };
        for side in 0..2 {
            let columns = || std::iter::once((gram[side].as_slice(), &lit));
            let (mut wide, mut narrow) = (sides[side].clone(), sides[side].clone());
            Arch::new().dispatch(TakeOut { correlations: &mut wide, side, columns: columns() });
            plain(TakeOut { correlations: &mut narrow, side, columns: columns() });
            prop_assert_eq!(wide, narrow);
        }
    }
}
