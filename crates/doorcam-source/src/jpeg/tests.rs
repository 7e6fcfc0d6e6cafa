use jpeg_encoder::{ColorType, Encoder, SamplingFactor};
use proptest::prelude::*;

use super::outline::{next_marker, segment};
use super::*;
use doorcam_core::image::Samples;

const ALL: Range<usize> = 0..usize::MAX;
const DEPTHS: [JpegDepth; 2] = [JpegDepth::Eight, JpegDepth::Exact];
const SAMPLINGS: [SamplingFactor; 4] =
    [SamplingFactor::R_4_4_4, SamplingFactor::R_4_2_2, SamplingFactor::R_4_2_0, SamplingFactor::R_4_4_0];

fn noise(seed: u32) -> impl FnMut() -> u8 {
    let mut state = seed;
    move || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 24) as u8
    }
}

/// A textured picture; `contrast` up to 255.
fn picture(width: u16, height: u16, contrast: u8) -> Vec<u8> {
    let mut random = noise(1);
    let texture = |k: usize| (100 + (k / 50) % 80) as u8;
    (0..3 * usize::from(width) * usize::from(height))
        .map(|k| texture(k).saturating_add((u16::from(random()) * u16::from(contrast) / 255) as u8))
        .collect()
}

fn encode(
    pixels: &[u8],
    size: (u16, u16),
    colours: ColorType,
    quality: u8,
    set: impl FnOnce(&mut Encoder<&mut Vec<u8>>),
) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = Encoder::new(&mut bytes, quality);
    set(&mut encoder);
    encoder.encode(pixels, size.0, size.1, colours).unwrap();
    bytes
}

/// A textured JPEG as a webcam makes it: 4:2:2, standard Huffman tables.
fn webcam(width: u16, height: u16, restart: Option<u16>) -> Vec<u8> {
    encode(&picture(width, height, 31), (width, height), ColorType::Rgb, 90, |encoder| {
        encoder.set_sampling_factor(SamplingFactor::R_4_2_2);
        if let Some(interval) = restart {
            encoder.set_restart_interval(interval);
        }
    })
}

fn decode(depth: JpegDepth, bytes: &[u8]) -> Result<Image, String> {
    let mut image = Image::empty();
    let decoded = JpegReader::new(depth).decode_into(bytes, None, ALL, &mut image);
    decoded.map_err(|e| e.to_string()).map(|()| image)
}

/// All samples, from 0 to 255.
fn values(image: &Image) -> Vec<f64> {
    match &image.samples {
        Samples::Eight(samples) => samples.iter().map(|&s| f64::from(s)).collect(),
        Samples::Sixteen(samples) => samples.iter().map(|&s| f64::from(s) / 257.0).collect(),
    }
}

/// Where the entropy-coded data begin.
fn data_start(bytes: &[u8]) -> usize {
    let mut at = 2;
    loop {
        let (marker, after) = next_marker(bytes, at).unwrap();
        at = after + 2 + segment(bytes, after).unwrap().len();
        if marker == 0xda {
            return at;
        }
    }
}

/// The JPEG with the segments of this marker replaced by `with`.
fn replaced(bytes: &[u8], marker: u8, with: &[u8]) -> Vec<u8> {
    let mut out = bytes[..2].to_vec();
    let mut at = 2;
    while at < data_start(bytes) {
        let (found, after) = next_marker(bytes, at).unwrap();
        let next = after + 2 + segment(bytes, after).unwrap().len();
        out.extend_from_slice(if found == marker { with } else { &bytes[at..next] });
        at = next;
    }
    [&out, &bytes[at..]].concat()
}

/// An error unless the samples are those of the standard's definition, to the last of 16 bits.
fn compare(bytes: &[u8]) -> Result<(), String> {
    let image = decode(JpegDepth::Exact, bytes)?;
    let truth = reference::decode(bytes);
    let Samples::Sixteen(codes) = &image.samples else { return Err("not decoded exactly".into()) };
    if (image.width, image.height) != (truth.width, truth.height) || codes.len() != 3 * truth.pixels.len() {
        return Err("another size".into());
    }
    for (k, (&code, &value)) in codes.iter().zip(truth.pixels.as_flattened()).enumerate() {
        // Rounding accounts for 0.5, f32 arithmetic for the rest.
        if (f64::from(code) - 257.0 * value).abs() > 0.6 {
            return Err(format!("sample {k}: {code}, expected {}", 257.0 * value));
        }
    }
    Ok(())
}

#[test]
fn without_vector_instructions_the_samples_are_the_same() {
    for sampling in SAMPLINGS {
        let bytes = encode(&picture(83, 45, 90), (83, 45), ColorType::Rgb, 85, |e| e.set_sampling_factor(sampling));
        let expected = decode(JpegDepth::Exact, &bytes).unwrap();
        let mut plain = JpegReader::new(JpegDepth::Exact);
        *plain.exact = Exact::on(pulp::Arch::Scalar);
        let mut image = Image::empty();
        plain.decode_into(&bytes, None, ALL, &mut image).unwrap();
        assert_eq!(image, expected, "{sampling:?}");
    }
}

#[test]
fn every_sample_is_that_of_the_definition() {
    for (width, height) in [(64, 48), (80, 33), (17, 16), (50, 31), (1, 1), (3, 2), (9, 65)] {
        for contrast in [31, 255] {
            let pixels = picture(width, height, contrast);
            for (sampling, restart) in SAMPLINGS.into_iter().flat_map(|s| [(s, 0), (s, 1), (s, 3)]) {
                let bytes = encode(&pixels, (width, height), ColorType::Rgb, 90, |encoder| {
                    encoder.set_sampling_factor(sampling);
                    encoder.set_restart_interval(restart);
                });
                compare(&bytes).unwrap_or_else(|e| panic!("{width} x {height} {sampling:?} {restart}: {e}"));
            }
            let grey = &pixels[..pixels.len() / 3];
            for (optimised, quality) in [(false, 30), (true, 30), (true, 100)] {
                let bytes = encode(grey, (width, height), ColorType::Luma, quality, |encoder| {
                    encoder.set_optimized_huffman_tables(optimised);
                    // This encoder's optimised tables do not count the symbols that restarts produce.
                    encoder.set_restart_interval(if optimised { 0 } else { 5 });
                });
                compare(&bytes).unwrap_or_else(|e| panic!("{width} x {height} grey {optimised}: {e}"));
            }
        }
    }
}

#[test]
fn components_may_be_red_green_and_blue() {
    let bytes = encode(&picture(40, 24, 80), (40, 24), ColorType::Ycbcr, 95, |_| {});
    let adobe = replaced(&bytes, 0xe0, b"\xff\xee\0\x0eAdobe\0\x64\0\0\0\0\0");
    compare(&adobe).unwrap();
    assert_ne!(decode(JpegDepth::Exact, &adobe).unwrap(), decode(JpegDepth::Exact, &bytes).unwrap());
}

#[test]
fn both_depths_agree_within_the_rounding_of_the_lesser() {
    // `rounded` is how often chroma is rounded to 8 bits, by up to half a code each time; blue is luma + 1.772 Cb. Luma
    // and blue are rounded once each, and the integer arithmetic of the 8-bit decoder adds a little.
    for (sampling, rounded) in SAMPLINGS.into_iter().zip([1.0, 2.0, 3.0, 2.0]) {
        let limit = 0.5 * 1.772 * rounded + 0.5 + 0.5 + 0.1;
        for (width, height) in [(160, 96), (155, 83)] {
            let bytes = encode(&picture(width, height, 31), (width, height), ColorType::Rgb, 90, |encoder| {
                encoder.set_sampling_factor(sampling);
            });
            let [eight, exact] = DEPTHS.map(|depth| values(&decode(depth, &bytes).unwrap()));
            let most = eight.iter().zip(&exact).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(most <= limit, "{sampling:?} {width}: {most}");
        }
    }
}

#[test]
fn means_over_a_smooth_floor_are_much_nearer_to_the_truth_than_through_8_bits() {
    let (width, height) = (320_u16, 240_u16);
    // Y, Cb and Cr of a floor of one colour under light that falls off by a few codes.
    let truth: Vec<[f64; 3]> = (0..320 * 240)
        .map(|k| {
            let (x, y) = ((k % 320) as f64 / 320.0, (k / 320) as f64 / 240.0);
            [141.3 - 5.0 * x + 3.0 * y, 118.4 + 1.5 * y, 131.8 - 1.2 * x]
        })
        .collect();
    // Noise of one code dithers the pixels, so that means over an area resolve a small part of a code.
    let mut random = noise(7);
    let pixels: Vec<u8> = truth.as_flattened().iter().map(|v| (v + f64::from(random()) / 256.0) as u8).collect();
    let bytes = encode(&pixels, (width, height), ColorType::Ycbcr, 98, |encoder| {
        encoder.set_sampling_factor(SamplingFactor::R_4_4_4);
    });
    let truth: Vec<f64> = truth
        .iter()
        .flat_map(|[y, cb, cr]| {
            let (red, blue) = (y + 1.402 * (cr - 128.0), y + 1.772 * (cb - 128.0));
            [red, (y - 0.299 * red - 0.114 * blue) / 0.587, blue]
        })
        .collect();
    // RMS error of the means over squares of 16 x 16 pixels, in codes of 255.
    let error = |depth| {
        let decoded = values(&decode(depth, &bytes).unwrap());
        let corners = || (0..240).step_by(16).flat_map(|y| (0..320).step_by(16).map(move |x| 320 * y + x));
        let mut squares = 0.0;
        for (channel, corner) in (0..3).flat_map(|channel| corners().map(move |corner| (channel, corner))) {
            let places = (0..256).map(|k| 3 * (corner + 320 * (k / 16) + k % 16) + channel);
            squares += (places.map(|at| decoded[at] - truth[at]).sum::<f64>() / 256.0).powi(2);
        }
        (squares / (3 * corners().count()) as f64).sqrt()
    };
    let (eight, exact) = (error(JpegDepth::Eight), error(JpegDepth::Exact));
    println!("error of means: {eight:.4} codes through 8 bits, {exact:.4} exactly");
    assert!(exact < 0.25 * eight, "{exact} {eight}");
}

#[test]
fn some_rows_are_those_of_the_whole_and_no_others_are_written() {
    for (sampling, height) in SAMPLINGS.into_iter().flat_map(|s| [(s, 96), (s, 77)]) {
        let bytes = encode(&picture(70, height, 31), (70, height), ColorType::Rgb, 90, |encoder| {
            encoder.set_sampling_factor(sampling);
            encoder.set_restart_interval(4);
        });
        let whole = decode(JpegDepth::Exact, &bytes).unwrap();
        let Samples::Sixteen(whole) = &whole.samples else { unreachable!() };
        let mut reader = JpegReader::new(JpegDepth::Exact);
        for rows in [0..1, 15..17, 16..32, 31..33, 40..41, 60..77, 76..200, 90..95, 5..5, 300..400] {
            let mut image = Image::empty();
            image.sixteen_mut(70, height.into()).fill(7);
            reader.decode_into(&bytes, None, rows.clone(), &mut image).unwrap();
            let Samples::Sixteen(part) = &image.samples else { unreachable!() };
            for (y, (part, whole)) in part.chunks(210).zip(whole.chunks(210)).enumerate() {
                let expected = if rows.contains(&y) { whole } else { &[7; 210] };
                assert!(part == expected, "{sampling:?} {rows:?}: row {y}");
            }
        }
    }
}

#[test]
fn what_is_missing_is_noticed_wherever_it_is() {
    let mut reader = JpegReader::new(JpegDepth::Exact);
    let mut decodes = |bytes: &[u8]| reader.decode_into(bytes, None, 24..48, &mut Image::empty()).is_ok();
    let (plain, restarting) = (webcam(160, 96, None), webcam(160, 96, Some(10)));
    for bytes in [&plain, &restarting] {
        let (start, end) = (data_start(bytes), bytes.len() - 2);
        let ended = |share: f64| [&bytes[..start + ((end - start) as f64 * share) as usize], &[0xff, 0xd9]].concat();
        assert!(decodes(bytes) && decodes(&bytes[..end]) && decodes(&bytes[..=end]), "only the end marker is missing");
        assert!(!decodes(&bytes[..end - 8]), "a little more is missing");
        assert!(!decodes(&ended(0.4)), "within the rows");
        assert!(!decodes(&ended(0.7)), "below them");
    }
    let (start, end) = (data_start(&plain), plain.len() - 2);
    let part = (end - start) / 20;
    for first in (start..end - part).step_by(part) {
        let without = [&plain[..first], &plain[first + part..]].concat();
        assert!(!decodes(&without), "without {part} bytes at {} of {}", first - start, end - start);
    }
}

#[test]
fn other_kinds_come_with_8_bits() {
    let pixels = picture(80, 48, 31);
    let progressive = encode(&pixels, (80, 48), ColorType::Rgb, 90, |encoder| encoder.set_progressive(true));
    // With optimised tables, this encoder writes a scan for each component.
    let scans = encode(&pixels, (80, 48), ColorType::Rgb, 90, |encoder| encoder.set_optimized_huffman_tables(true));
    let baseline = decode(JpegDepth::Eight, &encode(&pixels, (80, 48), ColorType::Rgb, 90, |_| {})).unwrap();
    for bytes in [progressive, scans] {
        assert_eq!(decode(JpegDepth::Exact, &bytes).unwrap(), baseline);
    }
}

#[test]
fn tables_that_a_webcam_left_out_are_the_standard_ones() {
    let bytes = webcam(80, 48, None);
    let without = replaced(&bytes, 0xc4, &[]);
    assert!(without.len() + 400 < bytes.len(), "the tables are gone");
    for depth in DEPTHS {
        assert_eq!(decode(depth, &without).unwrap(), decode(depth, &bytes).unwrap());
    }
}

#[test]
fn padding_after_the_end_does_no_harm() {
    let bytes = webcam(80, 48, None);
    for depth in DEPTHS {
        let image = decode(depth, &bytes).unwrap();
        for padding in [&[0u8; 700][..], &[0xff; 5], &[0xff, 0xd9], b"junk \xff\xd8\xff"] {
            assert_eq!(decode(depth, &[&bytes[..], padding].concat()).unwrap(), image);
        }
    }
}

#[test]
fn a_jpeg_that_lacks_only_its_end_marker_is_whole() {
    let bytes = [webcam(160, 96, None), webcam(160, 96, Some(7))];
    for (depth, bytes) in DEPTHS.into_iter().flat_map(|depth| bytes.iter().map(move |bytes| (depth, bytes))) {
        let mut reader = JpegReader::new(depth);
        let mut image = Image::empty();
        reader.decode_into(bytes, None, ALL, &mut image).unwrap();
        assert!(!reader.lacked_end());
        for cut in [2, 1] {
            let mut without = Image::empty();
            reader.decode_into(&bytes[..bytes.len() - cut], None, ALL, &mut without).unwrap();
            assert!(reader.lacked_end() && without == image, "{cut}");
        }
        // Nobody knows what was there instead of the padding.
        for padding in [&[0u8; 9][..], b"\0", b"junk"] {
            let padded = [&bytes[..bytes.len() - 2], padding].concat();
            let error = reader.decode_into(&padded, None, ALL, &mut image).unwrap_err();
            assert_eq!(error.to_string(), "broken JPEG: cut off before its end marker");
            assert!(!reader.lacked_end());
        }
        for padding in [1, 9, 1000, 40_000] {
            let padded = [&bytes[..bytes.len() / 2], &vec![0; padding]].concat();
            reader.decode_into(&padded, None, ALL, &mut image).expect_err("half of it is missing");
        }
    }
    let pixels = picture(80, 48, 31);
    let progressive = encode(&pixels, (80, 48), ColorType::Rgb, 90, |encoder| encoder.set_progressive(true));
    let scans = encode(&pixels, (80, 48), ColorType::Rgb, 90, |encoder| encoder.set_optimized_huffman_tables(true));
    for (depth, bytes) in DEPTHS.into_iter().flat_map(|depth| [(depth, &progressive), (depth, &scans)]) {
        let error = decode(depth, &bytes[..bytes.len() - 2]).unwrap_err();
        assert_eq!(error, "broken JPEG: cut off before its end marker", "a scan may be missing");
    }
}

#[test]
fn whatever_is_cut_off_or_left_out_makes_it_an_error() {
    for depth in DEPTHS {
        for bytes in [webcam(160, 96, None), webcam(160, 96, Some(7))] {
            let (start, end) = (data_start(&bytes), bytes.len() - 2);
            for cut in (2..end - 2).step_by(61) {
                let error = decode(depth, &bytes[..cut]).unwrap_err();
                assert_eq!(error, "broken JPEG: cut off before its end marker", "{cut}");
            }
            // Some drivers write the end marker where the data broke off, or lose a packet in the middle.
            for cut in (start..end - 64).step_by(61) {
                decode(depth, &[&bytes[..cut], &[0xff, 0xd9]].concat()).expect_err("ended early");
            }
            for at in (start..end - 800).step_by(61) {
                decode(depth, &[&bytes[..at], &bytes[at + 700..]].concat()).expect_err("a part is missing");
            }
        }
    }
}

#[test]
fn tables_that_are_missing_make_it_an_error() {
    let bytes = webcam(80, 48, None);
    for depth in DEPTHS {
        decode(depth, &replaced(&bytes, 0xdb, &[])).expect_err("no quantisation");
    }
}

#[test]
fn colours_that_are_finer_than_the_brightness_make_it_an_error() {
    let bytes = include_bytes!("../../../../fuzz/corpus/jpeg/fine-colour.jpg");
    for depth in DEPTHS {
        let refused = decode(depth, bytes).expect_err("no encoder makes these");
        assert!(refused.contains("its chroma is sampled more finely than its luma"), "{refused}");
    }
}

#[test]
fn an_image_of_another_size_is_refused_before_it_is_decoded() {
    for depth in DEPTHS {
        let mut image = Image::empty();
        let decoded = JpegReader::new(depth).decode_into(&webcam(80, 48, None), Some((640, 480)), ALL, &mut image);
        assert_eq!(decoded.unwrap_err().to_string(), "the image has 80 x 48 pixels, expected 640 x 480");
        assert_eq!(image.samples, Samples::Eight(Vec::new()));
    }
}

#[test]
fn a_short_file_that_claims_to_be_a_large_image_is_refused_before_there_is_room_for_it() {
    let mut bytes = webcam(80, 48, None);
    let frame = bytes.windows(2).position(|m| m == [0xff, 0xc0]).unwrap();
    bytes[frame + 5..frame + 9].fill(0x3f);
    let mut image = Image::empty();
    JpegReader::new(JpegDepth::Exact).decode_into(&bytes, None, ALL, &mut image).expect_err("too short");
    assert_eq!(image.samples, Samples::Eight(Vec::new()));
}

#[test]
fn the_next_image_goes_into_the_same_buffer() {
    for depth in DEPTHS {
        let mut image = Image::empty();
        let mut reader = JpegReader::new(depth);
        let bytes = webcam(80, 48, None);
        reader.decode_into(&bytes, None, ALL, &mut image).unwrap();
        let place = |image: &Image| match &image.samples {
            Samples::Eight(samples) => samples.as_ptr() as usize,
            Samples::Sixteen(samples) => samples.as_ptr() as usize,
        };
        let first = place(&image);
        reader.decode_into(&bytes, None, ALL, &mut image).unwrap();
        assert_eq!(place(&image), first);
    }
}

proptest! {
    #[test]
    fn any_jpeg_of_a_webcam_is_decoded_as_defined(
        width in 1u16..70, height in 1u16..70, quality in 1u8..=100, sampling in 0usize..4, restart in 0u16..9, seed in any::<u32>(),
        grey in any::<bool>(), optimised in any::<bool>(),
    ) {
        let mut random = noise(seed);
        let channels = if grey { 1 } else { 3 };
        let pixels: Vec<u8> = (0..channels * usize::from(width) * usize::from(height)).map(|_| random()).collect();
        let colours = if grey { ColorType::Luma } else { ColorType::Rgb };
        let bytes = encode(&pixels, (width, height), colours, quality, |encoder| {
            encoder.set_sampling_factor(SAMPLINGS[sampling]);
            encoder.set_optimized_huffman_tables(grey && optimised);
            encoder.set_restart_interval(if grey && optimised { 0 } else { restart });
        });
        if let Err(difference) = compare(&bytes) {
            prop_assert!(false, "{}", difference);
        }
    }

    #[test]
    fn damaged_jpegs_never_panic(
        restart in 0u16..5, sampling in 0usize..4, changes in proptest::collection::vec((any::<proptest::sample::Index>(), any::<u8>()), 1..12),
        rows in any::<(u8, u8)>(), grey in any::<bool>(),
    ) {
        let colours = if grey { ColorType::Luma } else { ColorType::Rgb };
        let mut bytes = encode(&picture(48, 40, 200), (48, 40), colours, 80, |encoder| {
            encoder.set_sampling_factor(SAMPLINGS[sampling]);
            encoder.set_restart_interval(restart);
        });
        for (at, with) in changes {
            let at = at.index(bytes.len());
            bytes[at] = with;
        }
        let mut reader = JpegReader::new(JpegDepth::Exact);
        let _ = reader.decode_into(&bytes, Some((48, 40)), rows.0.into()..rows.1.into(), &mut Image::empty());
        let _ = reader.decode_into(&bytes, None, ALL, &mut Image::empty());
    }

    #[test]
    fn headers_and_data_of_anything_never_panic(
        header in proptest::collection::vec(any::<u8>(), 0..90), data in proptest::collection::vec(any::<u8>(), 0..400),
        kind in prop_oneof![Just(0xc0u8), Just(0xc4), Just(0xdb), Just(0xda), Just(0xdd), Just(0xee)],
    ) {
        // A valid JPEG with one segment replaced by anything, then one with any data.
        let good = webcam(40, 24, None);
        let length = (header.len() as u16 + 2).to_be_bytes();
        let bytes = replaced(&good, kind, &[&[0xff, kind], &length[..], &header].concat());
        let mut reader = JpegReader::new(JpegDepth::Exact);
        let _ = reader.decode_into(&bytes, None, ALL, &mut Image::empty());
        let data = [&good[..data_start(&good)], &data, &[0xff, 0xd9]].concat();
        let _ = reader.decode_into(&data, None, ALL, &mut Image::empty());
    }
}
