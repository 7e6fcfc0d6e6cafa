use super::{Rgb, unify};

/// How strongly the left and the right patch see a facet's change: (c_L, c_R) of one facet, with v its unit colour.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Intensity {
    /// c_L.
    pub left: f64,
    /// c_R.
    pub right: f64,
    /// v, a unit vector (zero for a facet that is dark in both views).
    pub colour: Rgb,
}

impl Intensity {
    /// ‖c‖, the facet's term in the penalty of eq. 13.
    pub fn strength(&self) -> f64 {
        // `hypot` also guards against overflow, but takes ten times as long.
        (self.left * self.left + self.right * self.right).sqrt()
    }
}

/// Which part of a change to look at.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sign {
    /// What became brighter, (·)⁺.
    Brighter,
    /// What became darker, |(·)⁻|.
    Darker,
}

/// The change in the hidden room, per facet: radiance relative to the background, negative where it became darker.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Scene {
    /// v_L = diag(c_L) v, the view from the left edge.
    pub left: Vec<Rgb>,
    /// v_R = diag(c_R) v, the view from the right edge.
    pub right: Vec<Rgb>,
    /// v_u, the unified map (eq. 14): zero where either view sees nothing.
    pub unified: Vec<Rgb>,
}

impl Scene {
    /// Forms the views and, with threshold `t` relative to the largest |c|, the unified map. `radiance` has, per side
    /// and facet, the radiance of a facet of intensity 1: the threshold applies to intensities, the views show
    /// radiance.
    pub fn new(intensities: &[Intensity], radiance: [&[f64]; 2], t: f64) -> Self {
        let view = |s: usize, c: fn(&Intensity) -> f64| {
            intensities.iter().zip(radiance[s]).map(|(i, scale)| i.colour.map(|v| c(i) * scale * v)).collect()
        };
        Self { left: view(0, |i| i.left), right: view(1, |i| i.right), unified: unify(intensities, radiance, t) }
    }

    /// Multiplies each facet's light by its factor in all views. Facets that the unified map leaves out stay out.
    pub fn multiply(&mut self, factors: &[f64]) {
        for view in [&mut self.left, &mut self.right, &mut self.unified] {
            for (rgb, factor) in view.iter_mut().zip(factors) {
                *rgb = rgb.map(|v| factor * v);
            }
        }
    }

    /// Indices of the facets that are nonzero in either view.
    pub fn nonzero(&self) -> impl Iterator<Item = usize> + '_ {
        let lit = |rgb: &Rgb| rgb.iter().any(|&v| v != 0.0);
        (0..self.left.len()).filter(move |&n| lit(&self.left[n]) || lit(&self.right[n]))
    }
}

impl Sign {
    /// This part of a change, as a nonnegative colour.
    pub fn of(self, rgb: Rgb) -> Rgb {
        match self {
            Sign::Brighter => rgb.map(|v| v.max(0.0)),
            Sign::Darker => rgb.map(|v| (-v).max(0.0)),
        }
    }
}
