//! The camera properties that measuring needs: transfer function, lens, points on the floor.

use std::ops::RangeInclusive;

use serde::{Deserialize, Serialize};

use crate::geometry::Point;

/// The transfer function that images are encoded with: how codes map to light.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[serde(rename_all = "lowercase")]
pub enum Transfer {
    /// IEC 61966-2-1.
    Srgb,
    /// Codes are proportional to light.
    Linear,
    /// Light is the code (full scale 1) raised to this power.
    Gamma(f64),
    /// Measured: relative light at equally spaced codes from 0 to full scale, linear in between. Light at full scale
    /// counts as 1.
    Curve(Vec<f64>),
}

/// Powers that a camera can have. With others, nearly all codes would stand for nearly the same light.
const GAMMA: RangeInclusive<f64> = 0.1..=10.0;

/// Most values of a measured curve: more than one for each code of 16 bits say nothing.
const MOST_VALUES: usize = 1 << 16;

/// A transfer function that no camera has. The message names the key and says what was expected.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TransferError {
    /// A power that no camera uses.
    #[error("transfer.gamma is {0}, expected {least} to {most}", least = GAMMA.start(), most = GAMMA.end())]
    Gamma(f64),
    /// Fewer than two values.
    #[error("transfer.curve has {0} values, expected at least 2: the light at code 0 and at full scale")]
    CurveTooShort(usize),
    /// More values than there are codes.
    #[error("transfer.curve has {0} values, expected at most {MOST_VALUES}, one for each code of 16 bits")]
    CurveTooLong(usize),
    /// A value that is below the one before it, negative or not finite.
    #[error("transfer.curve[{at}] is {value}, expected a number of 0 or above, not below the value before it")]
    CurveFalls {
        /// Index of the value.
        at: usize,
        /// The value.
        value: f64,
    },
    /// All values are the same.
    #[error("transfer.curve is {0} throughout, expected light that grows with the code")]
    CurveFlat(f64),
}

impl Transfer {
    /// Checks that a camera can have this transfer function.
    ///
    /// # Errors
    ///
    /// If the power is out of range, or the curve is too short or too long, falls or is flat.
    pub fn validate(&self) -> Result<(), TransferError> {
        match self {
            Transfer::Srgb | Transfer::Linear => Ok(()),
            Transfer::Gamma(gamma) if GAMMA.contains(gamma) => Ok(()),
            &Transfer::Gamma(gamma) => Err(TransferError::Gamma(gamma)),
            Transfer::Curve(curve) if curve.len() > MOST_VALUES => Err(TransferError::CurveTooLong(curve.len())),
            Transfer::Curve(curve) => {
                let (Some(&first), Some(&last), 2..) = (curve.first(), curve.last(), curve.len()) else {
                    return Err(TransferError::CurveTooShort(curve.len()));
                };
                let mut before = 0.0;
                for (at, &value) in curve.iter().enumerate() {
                    if !(value.is_finite() && value >= before) {
                        return Err(TransferError::CurveFalls { at, value });
                    }
                    before = value;
                }
                if first == last { Err(TransferError::CurveFlat(last)) } else { Ok(()) }
            }
        }
    }

    /// Linear light of a code; both are 1 at full scale.
    pub fn light(&self, code: f64) -> f64 {
        match self {
            Transfer::Linear => code,
            Transfer::Srgb => srgb_to_linear(code),
            Transfer::Gamma(gamma) => code.powf(*gamma),
            Transfer::Curve(curve) => {
                let at = code * curve.len().saturating_sub(1) as f64;
                let low = (at.floor() as usize).min(curve.len().saturating_sub(2));
                match (curve.get(low), curve.get(low + 1), curve.last()) {
                    (Some(a), Some(b), Some(full)) => (a + (b - a) * (at - low as f64)) / full,
                    _ => 0.0,
                }
            }
        }
    }
}

/// Inverse of the sRGB transfer function (IEC 61966-2-1), full scale 1.
fn srgb_to_linear(encoded: f64) -> f64 {
    if encoded <= 0.04045 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}

/// Radial distortion in OpenCV's form: an ideal image position x = (u − c) / f, with c the centre of the image, is seen
/// at x (1 + k1 r² + k2 r⁴), r = |x|.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct Lens {
    /// Coefficient of r²; negative for barrel distortion.
    pub k1: f64,
    /// Coefficient of r⁴.
    #[serde(default)]
    pub k2: f64,
    /// Focal length f in pixels; the width of the image if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub focal_px: Option<f64>,
}

/// An image position whose place on the floor is known.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct FloorPoint {
    /// (u, v), in pixels; (0, 0) is the centre of the top-left pixel.
    #[cfg_attr(feature = "schema", schema(value_type = crate::schema::Pixel))]
    pub pixel: Point,
    /// (x, y) in the door frame, in metres.
    #[cfg_attr(feature = "schema", schema(value_type = crate::schema::Point))]
    pub floor_m: Point,
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn srgb_is_the_standard_curve() {
        // Values of IEC 61966-2-1: the knee, code 0.5, full scale.
        assert!((srgb_to_linear(0.04045) - 0.003_130_8).abs() < 1e-7);
        assert!((srgb_to_linear(0.5) - 0.214_041_14).abs() < 1e-8);
        assert_eq!(srgb_to_linear(1.0), 1.0);
    }

    #[test]
    fn transfers_read_as_recordings_have_them() {
        for (text, transfer) in [
            ("\"srgb\"", Transfer::Srgb),
            ("\"linear\"", Transfer::Linear),
            ("{\"gamma\":2.2}", Transfer::Gamma(2.2)),
            ("{\"curve\":[0.0,0.2,1.0]}", Transfer::Curve(vec![0.0, 0.2, 1.0])),
        ] {
            assert_eq!(serde_json::from_str::<Transfer>(text).unwrap(), transfer);
            assert_eq!(serde_json::to_string(&transfer).unwrap(), text);
        }
    }

    #[test]
    fn a_curve_is_straight_between_its_values_and_relative_to_full_scale() {
        let curve = Transfer::Curve(vec![0.0, 1.0, 4.0]);
        for (code, light) in [(0.0, 0.0), (0.25, 0.125), (0.5, 0.25), (0.75, 0.625), (1.0, 1.0)] {
            assert_eq!(curve.light(code), light);
        }
        assert_eq!(Transfer::Gamma(2.0).light(0.5), 0.25);
    }

    #[test]
    fn what_no_camera_has_is_refused_by_key() {
        let error = |transfer: Transfer| transfer.validate().expect_err("refused").to_string();
        assert_eq!(error(Transfer::Gamma(0.0)), "transfer.gamma is 0, expected 0.1 to 10");
        assert!(error(Transfer::Gamma(1e9)).starts_with("transfer.gamma is 1000000000, expected"));
        assert!(
            error(Transfer::Curve(vec![0.5; 65_537])).starts_with("transfer.curve has 65537 values, expected at most")
        );
        assert!(error(Transfer::Curve(vec![1.0])).starts_with("transfer.curve has 1 values, expected at least 2"));
        assert!(error(Transfer::Curve(vec![0.0, 0.5, 0.4])).starts_with("transfer.curve[2] is 0.4, expected"));
        assert!(error(Transfer::Curve(vec![-0.1, 0.5])).starts_with("transfer.curve[0] is -0.1"));
        assert!(error(Transfer::Curve(vec![0.5, 0.5])).starts_with("transfer.curve is 0.5 throughout"));
    }

    proptest! {
        #[test]
        fn light_grows_with_the_code_from_dark_to_full_scale(
            steps in proptest::collection::vec(0.0..1.0f64, 1..20),
            gamma in 0.1..5.0f64,
            code in 0.0..1.0f64,
            more in 0.0..1.0f64,
        ) {
            let mut curve = vec![0.0];
            curve.extend(steps.iter().scan(0.0, |sum, step| { *sum += step; Some(*sum) }));
            let curve = Transfer::Curve(curve);
            prop_assume!(curve.validate().is_ok());
            for transfer in [Transfer::Srgb, Transfer::Linear, Transfer::Gamma(gamma), curve] {
                let (low, high) = (transfer.light(code), transfer.light(code + more * (1.0 - code)));
                prop_assert!(0.0 <= low && low <= high && high <= 1.0 + 1e-12, "{transfer:?}: {low} {high}");
                prop_assert!((transfer.light(1.0) - 1.0).abs() < 1e-12);
            }
        }
    }
}
