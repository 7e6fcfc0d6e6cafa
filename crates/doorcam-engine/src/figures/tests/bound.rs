//! Reads the figure of the bound back: regions from its pixels, positions from its axes.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use proptest::prelude::*;

use super::shown::Shown;
use super::*;
use doorcam_core::geometry::Biangular;

const DOORWAY: Doorway = Doorway { width_m: 1.0, wall_thickness_m: 0.1, height_m: None, leaf: None };

fn panel(title: &str, sides: &[Side], walled: bool, regions: Vec<Region>, samples: Vec<Vec<f64>>) -> BoundPanel {
    BoundPanel { title: title.into(), sides: sides.to_vec(), walled, regions, samples }
}

fn svg(panels: &[BoundPanel], target: Option<Point>) -> String {
    bound_svg(&BoundPicture { doorway: &DOORWAY, patch_m: 0.2, panels, target, caption: "caption" })
}

#[test]
fn regions_targets_and_walls_stand_where_they_are() {
    let place = [0.3, 1.2];
    let region = Region { angles: Biangular::from_point(&DOORWAY, place), widths: [0.1, 0.2] };
    let open = panel("open", &Side::BOTH, false, vec![region], Vec::new());
    let door = panel("door", &Side::BOTH[..1], true, vec![region], Vec::new());
    let shown = Shown::new(svg(&[open, door], Some([-0.4, 0.8])));
    for group in ["doorcam-bound-a", "doorcam-bound-b"] {
        let at = |place| shown.at(group, 0, place);
        // Inside by slightly less than half the widths in angle, outside by slightly more.
        let moved = |d1: f64, d2: f64| {
            let Biangular { alpha1, alpha2 } = region.angles;
            Biangular { alpha1: alpha1 + d1, alpha2: alpha2 + d2 }.to_point(&DOORWAY)
        };
        let blue = |[r, _, b]: [u8; 3]| b > r && b - r > 40;
        for (d1, d2) in [(0.0, 0.0), (0.04, 0.0), (-0.04, 0.0), (0.0, 0.08), (0.0, -0.08)] {
            assert!(blue(at(moved(d1, d2))), "{group} {d1} {d2}");
            assert!(!blue(at(moved(1.6 * d1, 1.6 * d2))) || (d1, d2) == (0.0, 0.0), "{group} {d1} {d2}");
        }
        assert_eq!(at([-0.4, 0.8]), [0xe0, 0x1b, 0x1b]);
        let wall = if group.ends_with('b') { [0x8c, 0x8c, 0x92] } else { [255; 3] };
        assert_eq!(at([-0.7, -0.05]), wall);
        assert_eq!(at([0.7, -0.05]), [255; 3], "no wall on the side that is not measured");
    }
}

#[test]
fn samples_have_one_scale_and_their_own_orientation() {
    let ramp: Vec<f64> = (0..16).map(|k| f64::from(k / 4)).collect();
    let dark = vec![0.0; 16];
    let text = svg(&[panel("a", &Side::BOTH, true, Vec::new(), vec![ramp, dark])], None);
    let document = Document::parse(&text).expect("XML");
    let images: Vec<_> = document.descendants().filter(|n| n.has_tag_name("image")).collect();
    let decode = |k: usize| {
        let href = images[k].attribute("href").expect("data");
        let bytes = STANDARD.decode(href.rsplit(',').next().expect("data")).expect("base64");
        image::load_from_memory(&bytes).expect("PNG").to_rgb8()
    };
    assert_eq!(images.len(), 2);
    let (ramp, dark) = (decode(0), decode(1));
    assert_eq!([ramp.get_pixel(2, 0)[0], ramp.get_pixel(2, 3)[0]], [0, 255], "the row at the wall is on top");
    assert!(dark.pixels().all(|p| p[0] == 0));
}

proptest! {
    #[test]
    fn no_number_breaks_the_figure(values in proptest::collection::vec(prop_oneof![
        Just(f64::NAN), Just(f64::INFINITY), Just(-1e300), Just(0.0), -3.0..3.0
    ], 8)) {
        let angles = Biangular { alpha1: values[0], alpha2: values[1] };
        let regions = vec![Region { angles, widths: [values[2], values[3]] }];
        let samples = vec![values[4..].to_vec()];
        let text = svg(&[panel("a", &Side::BOTH, true, regions, samples)], Some([values[4], values[5]]));
        // Encoded images may have any letters.
        let images = text.split("base64,").skip(1).filter_map(|rest| rest.split('"').next());
        let numbers = images.fold(text.clone(), |text, image| text.replace(image, ""));
        prop_assert!(!numbers.contains("NaN") && !numbers.contains("inf"));
        prop_assert!(png(&text, 300).is_ok());
    }
}
