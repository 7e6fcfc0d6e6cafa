//! Reads a figure back.

use image::RgbImage;
use resvg::usvg::roxmltree::{Document, Node};

use crate::figures::png;
use doorcam_core::geometry::Point;

/// A figure and its pixels, two per page unit.
pub(super) struct Shown {
    pub(super) svg: String,
    pub(super) pixels: RgbImage,
}

impl Shown {
    pub(super) fn new(svg: String) -> Self {
        let width: f64 = Document::parse(&svg)
            .expect("XML")
            .root_element()
            .attribute("width")
            .expect("width")
            .parse()
            .expect("number");
        let png = png(&svg, (2.0 * width) as u32).expect("PNG");
        Self { svg, pixels: image::load_from_memory(&png).expect("an image").to_rgb8() }
    }

    /// Colour at a floor plan position, located by the axes of a panel (or of a patch: the k-th axes of its group).
    pub(super) fn at(&self, group: &str, k: usize, [x, y]: Point) -> [u8; 3] {
        let document = Document::parse(&self.svg).expect("XML");
        let axis = |class, attribute| {
            let axis = by_id(&document, group).descendants().filter(|n| n.attribute("class") == Some(class)).nth(k);
            Axis::read(axis.expect("axis"), attribute)
        };
        // Labels are offset from their ticks by this part of a line's height.
        let (column, row) = (axis("x-axis", "x").place(x), axis("y-axis", "y").place(y) - 3.6);
        self.pixels.get_pixel((2.0 * column) as u32, (2.0 * row) as u32).0
    }
}

pub(super) fn by_id<'a, 'i>(document: &'a Document<'i>, id: &str) -> Node<'a, 'i> {
    document.descendants().find(|n| n.attribute("id") == Some(id)).unwrap_or_else(|| panic!("no {id}"))
}

/// Page units as a function of metres, from the first and the last label of an axis.
pub(super) struct Axis {
    metres: [f64; 2],
    units: [f64; 2],
}

impl Axis {
    pub(super) fn read(axis: Node, attribute: &str) -> Self {
        let labels: Vec<Node> = axis.descendants().filter(|n| n.has_tag_name("text")).collect();
        let ends = [labels[0], labels[labels.len() - 1]];
        let text = |n: Node| n.text().expect("label").trim().replace('−', "-");
        Self {
            metres: ends.map(|n| text(n).parse().expect("metres")),
            units: ends.map(|n| n.attribute(attribute).expect("place").parse().expect("number")),
        }
    }

    pub(super) fn per_metre(&self) -> f64 {
        (self.units[1] - self.units[0]) / (self.metres[1] - self.metres[0])
    }

    fn place(&self, metres: f64) -> f64 {
        self.units[0] + (metres - self.metres[0]) * self.per_metre()
    }
}
