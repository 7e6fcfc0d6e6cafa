use super::*;
use crate::geometry::{Doorway, FacetGrid, GridSpec};
use crate::transport::{Kernel, PatchGrid, PixelLayout, TransportSpec};

const SIZE: usize = 32;

fn transport() -> Transport {
    let doorway = Doorway { width_m: 0.6, wall_thickness_m: 0.05, height_m: None, leaf: None };
    let grid = FacetGrid::new(&doorway, &GridSpec { intervals: 30, ..GridSpec::published() }).unwrap();
    let patch = PatchGrid { size: SIZE, fov_m: 0.3, layout: PixelLayout::Cells };
    Transport::new(&doorway, &grid.facets, &TransportSpec { kernel: Kernel::Radiometric, facet_height_m: 2.0, patch })
}

/// Reproducible numbers between −1 and 1.
fn noise(seed: u64) -> impl Iterator<Item = f64> {
    (1u64..).map(move |k| {
        let mut x = k.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ seed.wrapping_mul(0xd1b5_4a32_d192_ed03);
        x ^= x >> 29;
        x = x.wrapping_mul(0xbf58_476d_1ce4_e5b9);
        (x >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    })
}

fn measurement() -> PatchPair {
    let mut pair = PatchPair::zeros(SIZE);
    for (seed, patch) in [&mut pair.left, &mut pair.right].into_iter().enumerate() {
        for (k, (value, noise)) in patch.data_mut().iter_mut().zip(noise(seed as u64)).enumerate() {
            *value = (0.01 * noise + 0.02 * (k as f64 / 500.0).sin() + 0.05) as f32;
        }
    }
    pair
}

/// Noisy pictures of an empty room, a different one in each colour.
fn own_pictures() -> PatchPair {
    let mut pair = PatchPair::zeros(SIZE);
    for (seed, patch) in [&mut pair.left, &mut pair.right].into_iter().enumerate() {
        for (k, (value, noise)) in patch.data_mut().iter_mut().zip(noise(20 + seed as u64)).enumerate() {
            *value = (0.5 + 0.2 * (k as f64 / 700.0).cos() + 0.05 * noise) as f32;
        }
    }
    pair
}

/// Evaluates the formulas of the documentation directly: y without its share of the own picture, then the residuals of
/// a least-squares fit of the nuisances, column by column.
#[test]
fn the_fast_product_is_the_literal_one() {
    let transport = transport();
    let pixels = SIZE * SIZE;
    let weights: [Vec<f64>; 2] = [7u64, 8].map(|seed| {
        noise(seed).take(pixels).enumerate().map(|(k, v)| if k % 17 == 0 { 0.0 } else { 1.0 + 0.3 * v }).collect()
    });
    let patterns = [9u64, 10].map(|seed| {
        let slope = (0..pixels).map(|k| 0.4 + 0.1 * (k % SIZE) as f64 / SIZE as f64);
        vec![vec![1.0; pixels], slope.zip(noise(seed)).map(|(s, v)| s + 0.01 * v).collect()]
    });
    let plain = Nuisance::new(patterns.clone());
    let pictures = own_pictures();
    let albedo: [Vec<f64>; 2] = [11u64, 12].map(|seed| noise(seed).take(pixels).map(|v| 1.0 + 0.05 * v).collect());
    let known = Pixels { weights: weights.clone(), albedo: albedo.clone() };
    let y = measurement();
    for (columns, own) in [(Columns::Radiance, false), (Columns::UnitNorm, false), (Columns::UnitNorm, true)] {
        let nuisance = if own { plain.clone().with_own_pictures(pictures.clone()) } else { plain.clone() };
        let projection = Projection::new(&transport, &known, &nuisance, columns);
        let gram = projection.gram();
        let mut fast = projection.correlations();
        projection.project(&y, &mut fast).unwrap();
        let mut energy = 0.0;
        for (s, side) in Side::BOTH.into_iter().enumerate() {
            let w = DVector::from_vec(weights[s].clone());
            let q = DMatrix::from_fn(pixels, 2, |k, j| patterns[s][j][k] * w[k]);
            let normal = (q.transpose() * &q).try_inverse().unwrap();
            let residual = |v: DVector<f64>| &v - &q * (&normal * (q.transpose() * &v));
            let a = multiply_rows(transport.side(side), &albedo[s]);
            let clean: Vec<DVector<f64>> = (0..a.ncols()).map(|n| residual(a.column(n).component_mul(&w))).collect();
            for p in 0..3 {
                let weighted = |pair: &PatchPair| {
                    let plane = pair.side(side).plane(p).iter().map(|&v| f64::from(v));
                    DVector::from_iterator(pixels, plane).component_mul(&w)
                };
                let mut y = weighted(&y);
                if own {
                    let x0 = weighted(&pictures);
                    y -= y.dot(&x0) / x0.norm_squared() * &x0;
                }
                let clean_y = residual(y);
                energy += clean_y.norm_squared();
                let size = clean_y.norm();
                for (n, column) in clean.iter().enumerate() {
                    let scale = if columns == Columns::UnitNorm { column.norm().recip() } else { 1.0 };
                    let literal = column.dot(&clean_y) * scale;
                    let error = (fast.rhs[s][p][n] - literal).abs() / (size * column.norm() * scale);
                    assert!(error < 2e-5, "{columns:?} {side:?} {p} {n}: {} {literal}", fast.rhs[s][p][n]);
                }
            }
            for (i, a) in clean.iter().enumerate() {
                for (j, b) in clean.iter().enumerate().step_by(7) {
                    let scale = if columns == Columns::UnitNorm { (a.norm() * b.norm()).recip() } else { 1.0 };
                    let error = (gram[s][(i, j)] - a.dot(b) * scale).abs() / (a.norm() * b.norm() * scale);
                    assert!(error < 1e-6, "{columns:?} Gram {i} {j}");
                }
            }
        }
        assert!((fast.energy - energy).abs() < 1e-5 * energy, "{} {energy}", fast.energy);
    }
}

/// Own pictures do not change this: their share of the frame is given back to the constant.
#[test]
fn with_the_constant_as_the_only_pattern_the_illumination_is_b_of_equation_12() {
    let transport = transport();
    let known = Pixels::uniform(&[vec![true; SIZE * SIZE], vec![true; SIZE * SIZE]]);
    let constant = Nuisance::constant(SIZE * SIZE);
    for nuisance in [constant.clone(), constant.with_own_pictures(own_pictures())] {
        let projection = Projection::new(&transport, &known, &nuisance, Columns::Radiance);
        let b = [[0.01, -0.02, 0.03], [-0.04, 0.05, 0.06]];
        let x = |s: usize, n: usize| if n == 40 { [0.3, 0.1, 0.2 + s as f64] } else { [0.0; 3] };
        let mut y = PatchPair::zeros(SIZE);
        for (s, side) in Side::BOTH.into_iter().enumerate() {
            for (p, b) in b[s].into_iter().enumerate() {
                let light = transport.side(side).column(40) * x(s, 40)[p];
                let plane = y.side_mut(side).plane_mut(p);
                plane.iter_mut().zip(light.iter()).for_each(|(y, light)| *y = (light + b) as f32);
            }
        }
        let mut correlations = projection.correlations();
        projection.project(&y, &mut correlations).unwrap();
        let found = projection.illumination(&correlations, x);
        for s in 0..2 {
            for p in 0..3 {
                assert!((found[s][p] - b[s][p]).abs() < 1e-6, "{found:?}");
            }
        }
    }
}

/// Evaluates the formula of the documentation directly.
#[test]
fn the_gain_is_the_least_squares_share_of_the_own_picture_without_the_facets() {
    let (transport, pixels, pictures, y) = (transport(), SIZE * SIZE, own_pictures(), measurement());
    let part = |k: usize, v: f64| if k.is_multiple_of(13) { 0.0 } else { 1.0 + 0.3 * v };
    let weights = [31u64, 32].map(|seed| noise(seed).take(pixels).enumerate().map(|(k, v)| part(k, v)).collect());
    let albedo = [33u64, 34].map(|seed| noise(seed).take(pixels).map(|v| 1.0 + 0.05 * v).collect());
    let known = Pixels { weights, albedo };
    let constant = Nuisance::constant(pixels);
    let nuisance = constant.clone().with_own_pictures(pictures.clone());
    let projection = Projection::new(&transport, &known, &nuisance, Columns::UnitNorm);
    let mut correlations = projection.correlations();
    projection.project(&y, &mut correlations).unwrap();
    let lights = [(40, [0.3, -0.1, 0.2]), (90, [-0.5, 0.0, 0.4])];
    let x = |s: usize, n: usize| {
        let light = lights.iter().find(|(at, _)| *at == n).map_or([0.0; 3], |(_, light)| *light);
        light.map(|v| v * (1.0 + s as f64))
    };
    let gains = projection.gain(&correlations, x).expect("there are own pictures");
    for (s, side) in Side::BOTH.into_iter().enumerate() {
        for (p, gain) in gains[s].into_iter().enumerate() {
            let (mut cross, mut square) = (0.0, 0.0);
            for k in 0..pixels {
                let [x0, y] = [&pictures, &y].map(|pair| f64::from(pair.side(side).plane(p)[k]));
                let radiance = |n: usize| x(s, n)[p] * projection.radiance()[s][n];
                let facets: f64 = [40, 90].iter().map(|&n| transport.side(side)[(k, n)] * radiance(n)).sum();
                let w2 = known.weights[s][k].powi(2);
                cross += w2 * x0 * (y - known.albedo[s][k] * facets);
                square += w2 * x0 * x0;
            }
            let literal = 1.0 + cross / square;
            assert!((gain - literal).abs() < 1e-5, "{side:?} {p}: {gain} {literal}");
        }
    }
    let without = Projection::new(&transport, &known, &constant, Columns::UnitNorm);
    let mut correlations = without.correlations();
    without.project(&y, &mut correlations).unwrap();
    assert_eq!(without.gain(&correlations, x), None);
}

#[test]
fn values_that_are_no_numbers_are_refused_with_their_place_unless_they_do_not_count() {
    let mut counted = [vec![true; SIZE * SIZE], vec![true; SIZE * SIZE]];
    counted[1][5] = false;
    let projection =
        Projection::new(&transport(), &Pixels::uniform(&counted), &Nuisance::constant(SIZE * SIZE), Columns::UnitNorm);
    let mut out = projection.correlations();
    let mut y = measurement();
    y.right.plane_mut(2)[5] = f32::NAN;
    projection.project(&y, &mut out).unwrap();
    assert!(out.rhs.iter().flatten().flatten().all(|v| v.is_finite()));
    y.right.plane_mut(1)[2 * SIZE + 3] = f32::INFINITY;
    let error = projection.project(&y, &mut out).unwrap_err().to_string();
    assert_eq!(error, "right patch, row 2, column 3: the green value is not a finite number");
}

#[test]
fn a_multiple_of_the_own_picture_is_not_there_at_all() {
    let pixels = SIZE * SIZE;
    let known = Pixels::uniform(&[vec![true; pixels], vec![true; pixels]]);
    let pictures = own_pictures();
    let nuisance = Nuisance::constant(pixels).with_own_pictures(pictures.clone());
    let projection = Projection::new(&transport(), &known, &nuisance, Columns::UnitNorm);
    let with_gains = |gains: [f32; 3]| {
        let mut y = measurement();
        for side in Side::BOTH {
            for (p, gain) in gains.into_iter().enumerate() {
                let plane = y.side_mut(side).plane_mut(p).iter_mut();
                plane.zip(pictures.side(side).plane(p)).for_each(|(y, x0)| *y += (gain - 1.0) * x0);
            }
        }
        let mut correlations = projection.correlations();
        projection.project(&y, &mut correlations).unwrap();
        correlations
    };
    let plain = with_gains([1.0; 3]);
    let largest = plain.rhs.iter().flatten().flatten().fold(0.0_f64, |most, v| most.max(v.abs()));
    for gains in [[1.2; 3], [0.8, 1.0, 1.1]] {
        let found = with_gains(gains);
        for (a, b) in found.rhs.iter().flatten().flatten().zip(plain.rhs.iter().flatten().flatten()) {
            assert!((a - b).abs() < 1e-5 * largest, "{gains:?}: {a} {b}");
        }
        assert!((found.energy - plain.energy).abs() < 1e-5 * plain.energy);
    }
}

/// Fits the pattern and the own picture by their normal equations.
#[test]
fn even_light_is_the_smaller_of_a_fit_with_the_own_picture_and_of_its_share() {
    let (pixels, pictures, y) = (SIZE * SIZE, own_pictures(), measurement());
    let weights: [Vec<f64>; 2] = [41u64, 42].map(|seed| noise(seed).take(pixels).map(|v| 1.0 + 0.3 * v).collect());
    let first: Vec<f64> = noise(43).take(pixels).map(|v| 1.0 + 0.1 * v).collect();
    let second: Vec<f64> = (0..pixels).map(|k| (k % SIZE) as f64).collect();
    let patterns = || vec![first.clone(), second.clone()];
    let nuisance = Nuisance::new([patterns(), patterns()]).with_own_pictures(pictures.clone());
    let known = Pixels { weights: weights.clone(), albedo: [vec![1.0; pixels], vec![1.0; pixels]] };
    let projection = Projection::new(&transport(), &known, &nuisance, Columns::UnitNorm);
    let mut correlations = projection.correlations();
    assert_eq!(projection.even_light(&correlations), [[0.0; 3]; 2]);
    // In `y` the share is larger; with most of the picture taken away, the fit is.
    let mut less = y.clone();
    for side in Side::BOTH {
        let values = less.side_mut(side).data_mut().iter_mut();
        values.zip(pictures.side(side).data()).for_each(|(y, x0)| *y -= 0.12 * x0);
    }
    let mut smaller = [0, 0];
    for y in [&y, &less] {
        projection.project(y, &mut correlations).unwrap();
        let found = projection.even_light(&correlations);
        for (s, side) in Side::BOTH.into_iter().enumerate() {
            let w = DVector::from_vec(weights[s].clone());
            let unit = DVector::from_vec(first.clone()).component_mul(&w).normalize();
            for (p, &found) in found[s].iter().enumerate() {
                let weighted = |pair: &PatchPair| {
                    let plane = pair.side(side).plane(p).iter().map(|&v| f64::from(v));
                    DVector::from_iterator(pixels, plane).component_mul(&w)
                };
                let (x0, y) = (weighted(&pictures), weighted(y));
                let fit = DMatrix::from_columns(&[unit.clone(), x0.clone()]);
                let fitted = ((fit.transpose() * &fit).try_inverse().unwrap() * fit.transpose() * &y)[0].abs();
                let share = y.dot(&x0.normalize()).abs();
                let literal = fitted.min(share);
                smaller[usize::from(share < fitted)] += 1;
                assert!((found - literal).abs() < 1e-4 * fitted.max(share), "{side:?} {p}: {found} {literal}");
            }
        }
    }
    assert!(smaller.iter().all(|&count| count > 0), "both cases: {smaller:?}");
}

#[test]
fn a_black_floor_has_no_picture_to_take_out() {
    let pixels = SIZE * SIZE;
    let known = Pixels::uniform(&[vec![true; pixels], vec![true; pixels]]);
    let constant = Nuisance::constant(pixels);
    let black = constant.clone().with_own_pictures(PatchPair::zeros(SIZE));
    let [(plain, _), (black, gain)] = [constant, black].map(|nuisance| {
        let projection = Projection::new(&transport(), &known, &nuisance, Columns::UnitNorm);
        let mut correlations = projection.correlations();
        projection.project(&measurement(), &mut correlations).unwrap();
        let gain = projection.gain(&correlations, |_, _| [1.0; 3]);
        (correlations, gain)
    });
    assert_eq!((black.rhs, gain), (plain.rhs, Some([[1.0; 3]; 2])));
}

/// A projection of equal pixels with the constant as nuisance.
fn plain_projection() -> Projection {
    let pixels = Pixels::uniform(&[vec![true; SIZE * SIZE], vec![true; SIZE * SIZE]]);
    Projection::new(&transport(), &pixels, &Nuisance::constant(SIZE * SIZE), Columns::Radiance)
}

/// What two facets at each side add to the floor, plus even light.
fn light_from_the_room() -> PatchPair {
    let transport = transport();
    let mut pair = PatchPair::zeros(SIZE);
    for side in Side::BOTH {
        let matrix = transport.side(side);
        for channel in 0..3 {
            let plane = pair.side_mut(side).plane_mut(channel);
            for (k, value) in plane.iter_mut().enumerate() {
                let [a, b] = [10, 40].map(|n| matrix[(k, n * matrix.ncols() / 60)]);
                *value = (0.3 * a - (0.1 + 0.1 * channel as f64) * b + 0.01) as f32;
            }
        }
    }
    pair
}

#[test]
fn only_what_no_facet_can_cause_is_foreign() {
    let projection = plain_projection();
    let mut frame = projection.correlations();
    let mut pair = light_from_the_room();
    projection.project(&pair, &mut frame).unwrap();
    assert!(frame.foreign.iter().all(|foreign| *foreign < 1e-6 * frame.energy), "{:?}", frame.foreign);
    // A shadow with a sharp border across the fan of the left patch.
    for channel in 0..3 {
        pair.left.plane_mut(channel)[SIZE * SIZE / 2..].iter_mut().for_each(|value| *value -= 0.02);
    }
    projection.project(&pair, &mut frame).unwrap();
    let shadow = 3.0 * 0.5 * (SIZE * SIZE) as f64 * 0.02 * 0.02;
    assert!(frame.foreign[0] > 0.01 * shadow && frame.foreign[0] < shadow, "{:?} of {shadow}", frame.foreign);
    assert!(frame.foreign[1] < 1e-6 * frame.energy, "{:?}", frame.foreign);
}

#[test]
fn covered_pixels_are_filled_with_what_the_others_lead_one_to_expect() {
    let projection = plain_projection();
    let mut frame = projection.correlations();
    let whole = light_from_the_room();
    let mut covered = whole.clone();
    let mut usable = Usable::all(&[vec![true; SIZE * SIZE], vec![true; SIZE * SIZE]]);
    // A leg: a band of pixels across the right patch.
    let leg = |k: usize| (12..16).contains(&(k % SIZE));
    for k in (0..SIZE * SIZE).filter(|&k| leg(k)) {
        usable.side_mut(Side::Right)[k] = false;
        (0..3).for_each(|c| covered.right.plane_mut(c)[k] = -0.5);
    }
    projection.fill(&mut covered, &usable, &mut frame);
    assert_eq!(covered.left, whole.left);
    let (mut miss, mut size) = (0.0, 0.0);
    for k in 0..SIZE * SIZE {
        let (filled, expected) = (covered.right.plane(1)[k], whole.right.plane(1)[k]);
        if !leg(k) {
            assert_eq!(filled, expected);
            continue;
        }
        (miss, size) = (miss + f64::from(filled - expected).powi(2), size + f64::from(expected).powi(2));
    }
    // Without filling it would be all of it. What changes within the band alone cannot be known.
    assert!(miss < 0.3 * size, "{miss} of {size}");
}
