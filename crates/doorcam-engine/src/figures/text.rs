//! Text and numbers in the SVG.

use svg::node::Blob;
use svg::node::element::Text;

/// Font family of all text; the rasteriser brings it along.
pub(super) const FONT: &str = "DejaVu Sans, sans-serif";

/// Rounds a coordinate to hundredths of a unit. NaN or infinity, which would break the SVG, become 0.
pub(super) fn unit(value: f64) -> f64 {
    // Adding zero turns -0, which would print as "-0", into 0.
    if value.is_finite() { (value * 100.0).round() / 100.0 + 0.0 } else { 0.0 }
}

/// Alignment of a text relative to its position.
#[derive(Clone, Copy)]
pub(super) enum Anchor {
    Start,
    Middle,
    End,
}

/// One line of text of the given size at a position on the page.
pub(super) fn line(x: f64, y: f64, size: f64, anchor: Anchor, content: &str) -> Text {
    let anchor = match anchor {
        Anchor::Start => "start",
        Anchor::Middle => "middle",
        Anchor::End => "end",
    };
    Text::new(printable(content)).set("x", unit(x)).set("y", unit(y)).set("font-size", size).set("text-anchor", anchor)
}

/// Like [`line`], with a symbol of the paper, bold with a subscript: before **v**_L after.
pub(super) fn line_with_symbol(place: [f64; 3], [before, bold, subscript, after]: [&'static str; 4]) -> Text {
    let [x, y, size] = place;
    // One piece of raw XML: the writer would put separate elements on separate lines, and a line break shows as a
    // space. The shift back needs an element too, since dy moves all text that follows.
    let runs = format!(
        r#"{before}<tspan font-weight="bold">{bold}</tspan><tspan font-size="{}" dy="2.5">{subscript}</tspan><tspan dy="-2.5">{after}</tspan>"#,
        0.72 * size,
    );
    line(x, y, size, Anchor::Start, "").add(Blob::new(runs))
}

/// Replaces white space by blanks and removes the characters that XML forbids.
pub(super) fn printable(text: &str) -> String {
    text.chars()
        .map(|c| if c.is_whitespace() { ' ' } else { c })
        .filter(|&c| !c.is_control() && !matches!(c, '\u{fffe}' | '\u{ffff}'))
        .collect()
}

/// Breaks text into lines of about `width` page units; a longer word is cut.
pub(super) fn wrap(text: &str, width: f64, size: f64) -> Vec<String> {
    // DejaVu Sans prose averages 0.56 em per character; a little more keeps long lines inside the page.
    let per_line = ((width / (0.58 * size)) as usize).max(8);
    let mut lines = vec![String::new()];
    let mut length = 0;
    for word in printable(text).split(' ').filter(|w| !w.is_empty()) {
        for (k, piece) in word.chars().collect::<Vec<_>>().chunks(per_line).enumerate() {
            let gap = usize::from(length > 0 && k == 0);
            if length + gap + piece.len() > per_line {
                lines.push(String::new());
                length = 0;
            } else if gap == 1 {
                lines.last_mut().into_iter().for_each(|l| l.push(' '));
                length += 1;
            }
            lines.last_mut().into_iter().for_each(|l| l.extend(piece));
            length += piece.len();
        }
    }
    lines
}

/// A number with this many decimals and a true minus sign.
pub(super) fn decimal(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    match text.strip_prefix('-') {
        Some(digits) if digits.chars().any(|c| ('1'..='9').contains(&c)) => format!("−{digits}"),
        Some(digits) => digits.to_owned(),
        None => text,
    }
}

/// A number to two significant digits: 0.012, 3.4, 250, 1.2e−7.
pub(super) fn significant(value: f64) -> String {
    let rounded: f64 = format!("{value:.1e}").parse().unwrap_or(value);
    let size = rounded.abs();
    if size == 0.0 {
        "0".to_owned()
    } else if (1e-3..1e5).contains(&size) {
        decimal(rounded, (1.0 - size.log10().floor()).max(0.0) as usize)
    } else {
        format!("{rounded:.1e}").replace('-', "−")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_read_as_in_a_paper() {
        assert_eq!(decimal(-0.5, 1), "−0.5");
        assert_eq!(decimal(-0.04, 1), "0.0");
        for (value, text) in [
            (0.0123, "0.012"),
            (-0.0123, "−0.012"),
            (0.0999, "0.10"),
            (3.44, "3.4"),
            (251.0, "250"),
            (1.0, "1.0"),
            (1.23e-7, "1.2e−7"),
            (0.0, "0"),
        ] {
            assert_eq!(significant(value), text);
        }
    }

    #[test]
    fn what_is_not_finite_or_not_xml_does_not_get_through() {
        assert_eq!(unit(f64::NAN), 0.0);
        assert_eq!(unit(f64::NEG_INFINITY), 0.0);
        assert_eq!(unit(-0.001).to_string(), "0");
        assert_eq!(printable("a\u{0}b\u{1b}[c\nd\u{ffff}"), "ab[c d");
    }

    #[test]
    fn wrapping_keeps_every_word_and_the_width() {
        let lines = wrap("one two three four five six seven", 12.0 * 0.58 * 10.0, 10.0);
        assert_eq!(lines, ["one two", "three four", "five six", "seven"]);
        let long = wrap(&"x".repeat(30), 12.0 * 0.58 * 10.0, 10.0);
        assert_eq!(long.iter().map(String::len).collect::<Vec<_>>(), [12, 12, 6]);
    }
}
