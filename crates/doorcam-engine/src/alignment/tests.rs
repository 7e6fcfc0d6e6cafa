use doorcam_core::image::Samples;
use doorcam_core::transport::PixelLayout;

use super::*;

fn alignment() -> Alignment {
    let calibration: Calibration = serde_json::from_str(
        r#"{"size": [640, 360], "doorway": {"width_m": 0.8, "wall_thickness_m": 0.1}, "transfer": "linear",
            "floor_points": [{"pixel": [50, 20], "floor_m": [-0.8, -0.1]}, {"pixel": [550, 20], "floor_m": [0.8, -0.1]},
                {"pixel": [550, 170], "floor_m": [0.8, -0.6]}, {"pixel": [50, 170], "floor_m": [-0.8, -0.6]}]}"#,
    )
    .unwrap();
    let patch = PatchGrid { fov_m: 0.3, size: 32, layout: PixelLayout::Cells };
    Alignment::new(&calibration, &patch, 10.0, None).unwrap()
}

#[test]
fn looks_share_the_pictures_that_are_decoded_anyway() {
    let image = Image { width: 640, height: 360, samples: Samples::Eight(vec![100; 3 * 640 * 360]) };
    for fps in [10.0, 12.5, 15.0, 20.0, 25.0, 30.0, 60.0] {
        for eager in [false, true] {
            let mut alignment = alignment();
            alignment.eager = eager;
            let (mut decoded_s, mut looks) = (f64::NEG_INFINITY, 0);
            for seconds in (0..(10.0 * fps) as usize).map(|k| k as f64 / fps) {
                // The visible side's looks.
                let whole = seconds - decoded_s >= 0.15 - 1e-6;
                if whole {
                    decoded_s = seconds;
                }
                if alignment.is_due(seconds, whole) {
                    assert!(whole, "{fps} frames a second: decoded for this alone at {seconds} s");
                    alignment.look(&image, seconds, Timestamp::UNIX_EPOCH);
                    looks += 1;
                }
            }
            let expected = if eager { 45..=67 } else { 25..=34 };
            assert!(expected.contains(&looks), "{fps} frames a second: {looks} looks in 10 s");
        }
    }
}

#[test]
fn it_looks_by_itself_where_nobody_else_does() {
    let (alignment, image) = (&mut alignment(), Image::empty());
    let mut looks = 0;
    for seconds in (0..300).map(|k| f64::from(k) / 30.0) {
        if alignment.is_due(seconds, false) {
            // Of another size: not a picture of this camera.
            assert!(alignment.look(&image, seconds, Timestamp::UNIX_EPOCH).is_none() && !alignment.fresh);
            looks += 1;
        }
    }
    assert_eq!(looks, 25);
}
