//! Linear light to sRGB bytes.

use doorcam_core::scene::{Rgb, Scene, Sign};

/// Linear light, 0 to 1, as an sRGB byte (IEC 61966-2-1).
pub(super) fn encode(linear: f64) -> u8 {
    let x = linear.clamp(0.0, 1.0);
    let encoded = if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 };
    (255.0 * encoded).round() as u8
}

/// One brightness scale for the three views of a sign, so that they can be compared.
#[derive(Debug, Clone, Copy)]
pub(super) struct Exposure {
    pub(super) sign: Sign,
    /// The change shown at full brightness: the largest of any facet, colour and view. 0 if nothing changed.
    pub(super) white: f64,
}

impl Exposure {
    pub(super) fn new(scene: &Scene, sign: Sign) -> Self {
        let views = [&scene.left, &scene.right, &scene.unified];
        let white =
            views.into_iter().flatten().flat_map(|&rgb| sign.of(rgb)).filter(|v| v.is_finite()).fold(0.0, f64::max);
        Self { sign, white }
    }

    /// The colour of a facet; none if it has nothing of this sign, or too little to show in 8 bits.
    pub(super) fn colour(&self, rgb: Rgb) -> Option<[u8; 3]> {
        if self.white <= 0.0 || rgb.iter().any(|v| !v.is_finite()) {
            return None;
        }
        Some(self.sign.of(rgb).map(|v| encode(v / self.white))).filter(|bytes| *bytes != [0; 3])
    }
}

/// A colour in SVG notation.
pub(super) fn hex([r, g, b]: [u8; 3]) -> String {
    format!("#{r:02x}{g:02x}{b:02x}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_transfer_function_is_that_of_srgb() {
        // Reference points: the ends, the linear part, middle grey (18 %) and half.
        for (linear, byte) in [(0.0, 0), (0.001, 3), (0.18, 118), (0.5, 188), (1.0, 255), (7.0, 255), (f64::NAN, 0)] {
            assert_eq!(encode(linear), byte, "{linear}");
        }
    }

    #[test]
    fn one_scale_holds_for_all_views_of_a_sign() {
        let scene = Scene {
            left: vec![[0.5, 0.0, 0.0], [0.0, -3.0, 0.0]],
            right: vec![[2.0, 0.0, 0.0], [f64::INFINITY, 0.0, f64::NAN]],
            unified: vec![[1.0, 0.0, 0.0], [0.0; 3]],
        };
        let brighter = Exposure::new(&scene, Sign::Brighter);
        assert_eq!(brighter.white, 2.0);
        assert_eq!(brighter.colour([1.0, 0.0, 0.0]), Some([188, 0, 0]));
        assert_eq!(brighter.colour([-1.0, 0.0, 0.0]), None);
        assert_eq!(brighter.colour([f64::INFINITY, 0.0, 0.0]), None);
        let darker = Exposure::new(&scene, Sign::Darker);
        assert_eq!(darker.white, 3.0);
        assert_eq!(darker.colour([0.0, -3.0, 0.0]), Some([0, 255, 0]));
    }
}
