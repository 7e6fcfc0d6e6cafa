//! Mapping from metres of the floor plan to the page.

use doorcam_core::geometry::Point;

/// A rectangle of the floor plan drawn to scale: x to the right, y (into the hidden room) up.
#[derive(Debug, Clone, Copy)]
pub(super) struct Frame {
    /// Left and top of the rectangle on the page, in page units.
    pub(super) left: f64,
    pub(super) top: f64,
    /// Page units per metre, the same along x and y.
    pub(super) scale: f64,
    /// Metres along x from left to right.
    pub(super) x: [f64; 2],
    /// Metres along y from bottom to top.
    pub(super) y: [f64; 2],
}

impl Frame {
    pub(super) fn width(&self) -> f64 {
        (self.x[1] - self.x[0]) * self.scale
    }

    pub(super) fn height(&self) -> f64 {
        (self.y[1] - self.y[0]) * self.scale
    }

    pub(super) fn bottom(&self) -> f64 {
        self.top + self.height()
    }

    /// The position of a floor plan point on the page.
    pub(super) fn place(&self, [x, y]: Point) -> Point {
        [self.left + (x - self.x[0]) * self.scale, self.top + (self.y[1] - y) * self.scale]
    }

    /// The same rectangle elsewhere on the page.
    pub(super) fn at(self, left: f64, top: f64) -> Self {
        Self { left, top, ..self }
    }
}

/// `value` if it is a length in metres that a floor plan can have, otherwise `otherwise`.
pub(super) fn length_or(value: f64, otherwise: f64) -> f64 {
    if (1e-4..=1e4).contains(&value) { value } else { otherwise }
}
