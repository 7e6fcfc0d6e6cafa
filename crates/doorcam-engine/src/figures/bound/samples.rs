//! Sample measurements of the patches.

use svg::node::element::{Group, Rectangle};

use super::BoundPanel;
use crate::figures::colour::encode;
use crate::figures::legend::embed;
use crate::figures::text::{Anchor, line, unit};
use doorcam_core::geometry::Side;

/// Maximum side of a patch, in page units.
const PATCH: f64 = 104.0;
const TEXT: f64 = 10.0;
const ROW: f64 = 16.0;

/// Common brightness range of all samples.
pub(super) struct Scale {
    low: f64,
    high: f64,
}

impl Scale {
    /// From the smallest to the largest value of any sample; none if they do not differ.
    pub(super) fn of(panels: &[BoundPanel]) -> Option<Self> {
        let values = || panels.iter().flat_map(|panel| &panel.samples).flatten().copied().filter(|v| v.is_finite());
        let (low, high) = (values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max));
        (low < high).then_some(Self { low, high })
    }
}

/// Draws the samples side by side below a panel; returns them and the y at which they end.
pub(super) fn samples(panel: &BoundPanel, [left, top, width]: [f64; 3], scale: &Scale) -> (Group, f64) {
    let mut group = Group::new().set("class", "samples");
    let count = panel.samples.len();
    let side = PATCH.min((width - 8.0) / count.max(2) as f64);
    let start = left + (width - count as f64 * side - (count.saturating_sub(1)) as f64 * 8.0) / 2.0;
    for (k, (sample, patch)) in panel.samples.iter().zip(&panel.sides).enumerate() {
        let size = sample.len().isqrt();
        let grey = |value: &f64| [encode((value - scale.low) / (scale.high - scale.low)); 3];
        let rgb: Vec<u8> = sample[..size * size].iter().flat_map(grey).collect();
        let x = start + k as f64 * (side + 8.0);
        if let Some(image) = embed(&rgb, [size, size], [x, top + ROW, side, side]) {
            group = group.add(image);
        }
        let border = Rectangle::new().set("x", unit(x)).set("y", unit(top + ROW)).set("width", unit(side));
        let border =
            border.set("height", unit(side)).set("fill", "none").set("stroke", "#000").set("stroke-width", 0.8);
        let name = match patch {
            Side::Left => "left patch",
            Side::Right => "right patch",
        };
        group = group.add(border).add(line(x + side / 2.0, top + ROW - 4.0, TEXT, Anchor::Middle, name));
    }
    (group, top + ROW + side)
}
