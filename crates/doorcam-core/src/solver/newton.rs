//! Newton's step on all facets with light at once, along their [`Tangents`].
//!
//! Near a solution, the set of facets with light, of c_s at 0 and of colours at 0 no longer changes, and eq. 13 is
//! smooth in the rest. Block descent is slow there because neighbouring facets look much alike; Newton's method is not.
//! Far from a solution, a step is cut where the first facets become dark: beyond that point, its effect on the other
//! facets relies on light that is gone.

use super::active::{Active, Point};
use super::cholesky::Cholesky;
use super::tangent::{Curvature, Tangents};

/// Most trial steps, each damped more than the one before.
const TRIALS: usize = 4;

/// Most places tried along a step, besides its end.
const PLACES: usize = 6;

/// Levenberg-Marquardt damping, a share of the Hessian's diagonal that is added to it: its value after the first bad
/// step, its bounds, and the factors by which it changes. While facets still come and go, a full Newton step is far too
/// long: the Hessian is nearly singular because neighbouring facets look much alike.
const DAMPING: Damping = Damping { first: 1e-3, least: 1e-8, most: 1.0, more: 10.0, some_more: 3.0, less: 0.1 };

struct Damping {
    first: f64,
    least: f64,
    most: f64,
    more: f64,
    some_more: f64,
    less: f64,
}

/// A step is good if the objective falls by this share of its linear prediction.
const GOOD: f64 = 1e-4;

/// A step that achieves this share of the fall that the quadratic model predicts is taken without a search.
const WELL: f64 = 0.5;

/// Differences of the objective below this share of ‖y‖² are rounding error; then the residual decides.
const ROUNDING: f64 = 1e-15;

/// An accepted step.
#[derive(Debug, Clone, Copy)]
pub(super) struct Step {
    /// By how much the objective fell.
    pub fall: f64,
    /// Whether the quadratic model predicted it well, so the next step will converge faster still.
    pub smooth: bool,
}

/// Workspace for Newton's step.
#[derive(Debug, Clone, Default)]
pub(super) struct Newton {
    tangents: Tangents,
    hessian: Vec<f64>,
    cholesky: Cholesky,
    step: Vec<f64>,
    places: Vec<f64>,
    trial: Point,
    damping: f64,
}

impl Newton {
    /// A workspace for `n` facets.
    pub fn with_capacity(n: usize) -> Self {
        // Solutions have light in a fraction of the facets; the buffers grow once if there are more.
        let unknowns = 2 * n;
        Self {
            tangents: Tangents::with_capacity(n),
            hessian: Vec::with_capacity(unknowns.pow(2)),
            cholesky: Cholesky::with_capacity(unknowns),
            step: Vec::with_capacity(4 * n),
            places: Vec::with_capacity(5 * n),
            trial: Point::with_capacity(n),
            damping: 0.0,
        }
    }

    /// Resets the damping left from the previous solve.
    pub fn reset(&mut self) {
        self.damping = 0.0;
    }

    /// Moves the point if that lowers the objective; returns none if no step does.
    pub fn step(&mut self, active: &Active, point: &mut Point) -> Option<Step> {
        self.tangents.span(active, point);
        if self.tangents.len() == 0 {
            return None;
        }
        let rounding = ROUNDING * active.energy();
        for _ in 0..TRIALS {
            self.solve(active, point);
            let slope: f64 = self.tangents.gradient.iter().zip(&self.step).map(|(g, d)| g * d).sum();
            let (t, fall) = self.search(active, point, slope);
            // Close to convergence even the fall is rounding error; the residual still tells better from worse.
            let good = fall >= -GOOD * t * slope
                || (fall >= -rounding && active.residual(&self.trial) < 0.5 * active.residual(point));
            if good {
                let kept = fall / (-0.5 * slope);
                if t == 1.0 {
                    self.adapt(kept);
                }
                std::mem::swap(point, &mut self.trial);
                return Some(Step { fall, smooth: t == 1.0 && kept > 0.3 });
            }
            if -slope <= 1e-3 * rounding {
                return None;
            }
            self.damping = (self.damping * DAMPING.more).clamp(DAMPING.first, DAMPING.most);
        }
        None
    }

    /// Damps less after a step that the quadratic model predicted well, more after one that it did not.
    fn adapt(&mut self, kept: f64) {
        if kept > 0.8 {
            self.damping *= DAMPING.less;
        } else if kept < 0.3 {
            self.damping *= DAMPING.some_more;
        }
        if self.damping < DAMPING.least {
            self.damping = 0.0;
        }
    }

    /// Solves for the step with the exact Hessian or, if that is not positive definite, without the terms that may be
    /// negative.
    fn solve(&mut self, active: &Active, point: &Point) {
        for (curvature, damping) in
            [(Curvature::Exact, self.damping), (Curvature::Positive, self.damping.max(DAMPING.least))]
        {
            self.tangents.hessian(active, point, curvature, damping, &mut self.hessian);
            self.step.clear();
            self.step.extend(self.tangents.gradient.iter().map(|g| -g));
            if self.cholesky.solve(&mut self.hessian, &mut self.step) {
                return;
            }
        }
    }

    /// Searches along the step, at its end and where lights and colours reach their bounds. Puts the best point into
    /// `self.trial` and returns how far along the step it is and by how much the objective falls there.
    fn search(&mut self, active: &Active, point: &Point, slope: f64) -> (f64, f64) {
        let end = self.fall_at(active, point, 1.0);
        if end >= -0.5 * WELL * slope {
            return (1.0, end);
        }
        let mut places = std::mem::take(&mut self.places);
        self.tangents.bounds(active, point, &self.step, &mut places);
        if places.is_empty() {
            // The parabola through the fall at the end and the slope at the start.
            places.push((0.5 * slope / (slope + end)).clamp(0.1, 0.7));
        }
        let (mut best, mut last) = ((1.0, end), f64::NEG_INFINITY);
        for &t in places.iter().take(PLACES) {
            let fall = self.fall_at(active, point, t);
            if fall > best.1 {
                best = (t, fall);
            }
            if fall < last {
                break;
            }
            last = fall;
        }
        self.places = places;
        let fall = self.fall_at(active, point, best.0);
        (best.0, fall)
    }

    fn fall_at(&mut self, active: &Active, point: &Point, t: f64) -> f64 {
        self.tangents.travel(active, point, &self.step, t, &mut self.trial.light);
        active.correlate(&mut self.trial);
        active.fall(point, &self.trial)
    }
}
