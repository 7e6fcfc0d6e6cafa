use nalgebra::{Cholesky, DMatrix, DVector};

/// Most changes of which unknowns are held at 0. Some tens suffice; each costs a factorisation.
const CHANGES: usize = 40;
/// An unknown that is held is freed if the slope there exceeds this, relative to the largest gradient.
const SLOPE: f64 = 1e-9;

/// Minimises ½ xᵀ H x − gᵀ x, with x_k >= 0 where `bounded`: an active-set method that begins with those unknowns held at 0
/// that are 0 in `x`. H must be positive definite. `None` if it is not, to working precision.
pub(super) fn minimise(
    hessian: &DMatrix<f64>,
    gradient: &DVector<f64>,
    bounded: &[bool],
    x: &DVector<f64>,
) -> Option<DVector<f64>> {
    let mut held: Vec<bool> = (0..x.len()).map(|k| bounded[k] && x[k] <= 0.0).collect();
    let mut x = x.clone();
    for change in 0..CHANGES {
        let free: Vec<usize> = (0..x.len()).filter(|&k| !held[k]).collect();
        let system = hessian.select_rows(&free).select_columns(&free);
        let right = gradient.select_rows(&free);
        let solved = Cholesky::new(system)?.solve(&right);
        x.fill(0.0);
        let mut below = false;
        for (&k, &value) in free.iter().zip(solved.iter()) {
            x[k] = value;
            if bounded[k] && value < 0.0 {
                held[k] = true;
                x[k] = 0.0;
                below = true;
            }
        }
        if below {
            continue;
        }
        let slope = gradient - hessian * &x;
        let least = SLOPE * gradient.amax();
        let downhill = |k: &usize| held[*k] && slope[*k] > least;
        if change < CHANGES / 2 {
            // Many at once is faster, but may go round in circles.
            let steepest = (0..x.len()).filter(downhill).map(|k| slope[k]).fold(0.0, f64::max);
            if steepest == 0.0 {
                break;
            }
            (0..x.len()).filter(|k| downhill(k)).collect::<Vec<_>>().into_iter().for_each(|k| {
                held[k] = slope[k] < 0.5 * steepest;
            });
        } else {
            let steepest = (0..x.len()).filter(downhill).max_by(|&a, &b| slope[a].total_cmp(&slope[b]));
            let Some(k) = steepest else { break };
            held[k] = false;
        }
    }
    Some(x)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_minimum_has_no_slope_where_it_is_free_and_none_downhill_where_it_is_held() {
        let a = DMatrix::from_fn(12, 8, |i, j| ((3 * i + 7 * j) % 11) as f64 - 4.0 + if i == j { 6.0 } else { 0.0 });
        let hessian = a.transpose() * &a;
        let gradient = a.transpose() * DVector::from_fn(12, |i, _| (i as f64 - 5.0).powi(2) - 12.0);
        let bounded: Vec<bool> = (0..8).map(|k| k != 3).collect();
        for start in [0.0, 1.0] {
            let x = minimise(&hessian, &gradient, &bounded, &DVector::from_element(8, start)).unwrap();
            let left = &gradient - &hessian * &x;
            for k in 0..8 {
                let scale = 1e-8 * gradient.amax();
                assert!(!bounded[k] || x[k] >= 0.0);
                assert!(
                    if x[k] == 0.0 && bounded[k] { left[k] <= scale } else { left[k].abs() < scale },
                    "{k}: {x} {left}"
                );
            }
            assert!(x.iter().any(|&v| v == 0.0) && x.iter().any(|&v| v > 0.0));
        }
    }
}
