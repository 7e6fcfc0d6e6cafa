//! Axes in metres around a frame.

use svg::node::element::{Group, Path, Rectangle};

use super::frame::Frame;
use super::text::{Anchor, decimal, line, unit};

/// Space that the axes take to the left of and below their frame, in page units.
pub(super) const LEFT: f64 = 54.0;
pub(super) const BELOW: f64 = 36.0;

const TICK: f64 = 4.0;
const TICK_TEXT: f64 = 10.0;
const LABEL_TEXT: f64 = 11.0;
/// Page units between ticks, so that labels do not touch.
pub(super) const SPACING: f64 = 42.0;

/// Border, ticks and labels of both axes, in metres.
pub(super) fn axes(frame: &Frame) -> Group {
    let border = Rectangle::new()
        .set("x", unit(frame.left))
        .set("y", unit(frame.top))
        .set("width", unit(frame.width()))
        .set("height", unit(frame.height()))
        .set("fill", "none")
        .set("stroke", "#000")
        .set("stroke-width", 0.8);
    let (ticks_x, decimals_x) = ticks(frame.x, frame.width() / SPACING);
    let (ticks_y, decimals_y) = ticks(frame.y, frame.height() / SPACING);
    let mut marks = String::new();
    let mut horizontal = Group::new().set("class", "x-axis");
    for x in ticks_x {
        let [at, _] = frame.place([x, 0.0]);
        marks += &format!("M{} {}v{TICK}", unit(at), unit(frame.bottom()));
        let text = decimal(x, decimals_x);
        horizontal = horizontal.add(line(at, frame.bottom() + 15.0, TICK_TEXT, Anchor::Middle, &text));
    }
    let mut widest = 0;
    let mut vertical = Group::new().set("class", "y-axis");
    for y in ticks_y {
        let [_, at] = frame.place([0.0, y]);
        marks += &format!("M{} {}h-{TICK}", unit(frame.left), unit(at));
        let text = decimal(y, decimals_y);
        widest = widest.max(text.chars().count());
        vertical = vertical.add(line(frame.left - 7.0, at + 3.6, TICK_TEXT, Anchor::End, &text));
    }
    let [middle_x, middle_y] = [frame.left + frame.width() / 2.0, frame.top + frame.height() / 2.0];
    let upright = frame.left - 14.0 - 0.62 * TICK_TEXT * widest as f64;
    Group::new()
        .add(border)
        .add(Path::new().set("d", marks).set("fill", "none").set("stroke", "#000").set("stroke-width", 0.8))
        .add(horizontal)
        .add(vertical)
        .add(line(middle_x, frame.bottom() + 30.0, LABEL_TEXT, Anchor::Middle, "x [m]"))
        .add(
            line(upright, middle_y, LABEL_TEXT, Anchor::Middle, "y [m]")
                .set("transform", format!("rotate(-90 {} {})", unit(upright), unit(middle_y))),
        )
}

/// Round numbers in a range and their number of decimals: at most about `count` of them, but at least two.
pub(super) fn ticks([low, high]: [f64; 2], count: f64) -> (Vec<f64>, usize) {
    let coarse = (high - low) / count.max(1.0);
    let power = 10f64.powf(coarse.log10().floor());
    // The smallest of 1, 2, 5, 10 that keeps to the count. The tolerance is for 0.5 / 0.5 coming out just above 1.
    let step = [1.0, 2.0, 5.0].iter().map(|m| m * power).find(|s| s * (1.0 + 1e-9) >= coarse).unwrap_or(10.0 * power);
    if !(step.is_finite() && step > 0.0) {
        return (Vec::new(), 0);
    }
    let first = (low / step - 1e-9).ceil() as i64;
    let last = (high / step + 1e-9).floor() as i64;
    // Rounding in a range absurdly far from zero must not make an endless axis.
    let last = last.min(first.saturating_add(100));
    let decimals = (-step.log10() - 1e-9).ceil().clamp(0.0, 12.0) as usize;
    let values: Vec<f64> = (first..=last).map(|k| k as f64 * step).collect();
    // A single number is no scale: rather crowd a short axis.
    if values.len() < 2 && count < 8.0 {
        return ticks([low, high], 2.0 * count.max(1.0));
    }
    (values, decimals)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_numbers_that_fit() {
        let shown = |range, count| {
            let (values, decimals) = ticks(range, count);
            values.into_iter().map(|v| decimal(v, decimals)).collect::<Vec<_>>()
        };
        assert_eq!(shown([-1.5, 1.5], 6.0), ["−1.5", "−1.0", "−0.5", "0.0", "0.5", "1.0", "1.5"]);
        assert_eq!(shown([-0.2, 3.0], 7.0), ["0.0", "0.5", "1.0", "1.5", "2.0", "2.5", "3.0"]);
        assert_eq!(shown([-0.15, 0.0], 3.0), ["−0.15", "−0.10", "−0.05", "0.00"]);
        assert_eq!(shown([0.0, 100.0], 5.0), ["0", "20", "40", "60", "80", "100"]);
        assert_eq!(shown([-0.6, 0.6], 1.0), ["−0.5", "0.0", "0.5"]);
        assert_eq!(shown([2.0, 2.0], 5.0), Vec::<String>::new());
    }
}
