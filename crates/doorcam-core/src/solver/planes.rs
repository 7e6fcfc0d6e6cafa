//! Sums over the pixels of a patch's colour planes, where a projection spends its time.

/// Number of products that are summed in f32 before they are added to the f64 sum.
const BLOCK: usize = 512;

/// Writes W y into `out` and returns ‖W y‖², or the index of a pixel that counts and is not finite.
pub(super) fn weigh_plane(plane: &[f32], weights: &[f32], out: &mut [f32]) -> Result<f64, usize> {
    let mut energy = 0.0;
    for (k, ((&value, &weight), out)) in plane.iter().zip(weights).zip(out).enumerate() {
        *out = if weight > 0.0 { weight * value } else { 0.0 };
        if !out.is_finite() {
            return Err(k);
        }
        energy += f64::from(*out).powi(2);
    }
    Ok(energy)
}

/// The products of one vector with three planes, in one pass so that the vector is loaded into the cache once.
pub(super) fn dot3(a: &[f32], planes: &[Vec<f32>; 3]) -> [f64; 3] {
    const LANES: usize = 8;
    let [b0, b1, b2] = planes;
    let mut sums = [0.0_f64; 3];
    for (((a, b0), b1), b2) in a.chunks(BLOCK).zip(b0.chunks(BLOCK)).zip(b1.chunks(BLOCK)).zip(b2.chunks(BLOCK)) {
        // Parallel running sums let the compiler use vector registers.
        let mut lanes = [[0.0_f32; LANES]; 3];
        let whole = a.len() / LANES * LANES;
        for k in (0..whole).step_by(LANES) {
            for (lanes, b) in lanes.iter_mut().zip([b0, b1, b2]) {
                for ((lane, a), b) in lanes.iter_mut().zip(&a[k..k + LANES]).zip(&b[k..k + LANES]) {
                    *lane += a * b;
                }
            }
        }
        for ((sum, lanes), b) in sums.iter_mut().zip(lanes).zip([b0, b1, b2]) {
            let rest: f32 = a[whole..].iter().zip(&b[whole..]).map(|(a, b)| a * b).sum();
            *sum += f64::from(lanes.iter().sum::<f32>() + rest);
        }
    }
    sums
}

/// The product of two vectors, summed in f64.
pub(super) fn dot(a: &[f32], b: &[f32]) -> f64 {
    const LANES: usize = 4;
    let product = |(a, b): (&f32, &f32)| f64::from(*a) * f64::from(*b);
    let mut lanes = [0.0; LANES];
    let whole = a.len() / LANES * LANES;
    for (a, b) in a.chunks_exact(LANES).zip(b.chunks_exact(LANES)) {
        lanes.iter_mut().zip(a.iter().zip(b)).for_each(|(lane, pair)| *lane += product(pair));
    }
    lanes.iter().sum::<f64>() + a[whole..].iter().zip(&b[whole..]).map(product).sum::<f64>()
}

/// Subtracts `factor` times `vector` from `plane` and returns the remaining ‖·‖².
pub(super) fn subtract(factor: f32, vector: &[f32], plane: &mut [f32]) -> f64 {
    plane.iter_mut().zip(vector).for_each(|(value, vector)| *value -= factor * vector);
    dot(plane, plane)
}
