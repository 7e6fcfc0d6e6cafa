//! SVG to PNG, with built-in fonts.

use std::sync::{Arc, LazyLock};

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};
use resvg::tiny_skia::{Color, Pixmap, Transform};
use resvg::usvg::{self, fontdb};

use super::RenderError;

/// Largest width and height of a picture, in pixels.
const MAX_SIDE: u64 = 16_384;
/// Largest number of pixels: 256 MB while a picture is drawn.
const MAX_PIXELS: u64 = 64 << 20;

/// Built-in fonts only, so that text looks the same on every machine.
static FONTS: LazyLock<Arc<fontdb::Database>> = LazyLock::new(|| {
    let mut fonts = fontdb::Database::new();
    for face in [dejavu::sans::regular(), dejavu::sans::bold()] {
        fonts.load_font_source(fontdb::Source::Binary(Arc::new(face)));
    }
    fonts.set_sans_serif_family("DejaVu Sans");
    Arc::new(fonts)
});

/// Draws an SVG on white as an opaque 8-bit RGB PNG, `width_px` pixels wide and with the SVG's proportions.
///
/// Text is set in DejaVu Sans. Only embedded images are drawn; files are never read.
///
/// # Errors
///
/// If the SVG is invalid, the picture would be empty or too large, or the PNG cannot be written.
pub fn png(svg: &str, width_px: u32) -> Result<Vec<u8>, RenderError> {
    let mut options =
        usvg::Options { font_family: "DejaVu Sans".to_owned(), fontdb: Arc::clone(&FONTS), ..usvg::Options::default() };
    options.image_href_resolver.resolve_string = Box::new(|_, _| None);
    let tree = usvg::Tree::from_str(svg, &options)?;
    let scale = width_px as f32 / tree.size().width();
    let height_px = f64::from(tree.size().height() * scale).round().max(1.0) as u64;
    let refused = || size_error(width_px.into(), height_px);
    check_size(width_px.into(), height_px)?;
    let mut pixmap = Pixmap::new(width_px, u32::try_from(height_px).map_err(|_| refused())?).ok_or_else(refused)?;
    pixmap.fill(Color::WHITE);
    resvg::render(&tree, Transform::from_scale(scale, scale), &mut pixmap.as_mut());
    // On white every pixel is opaque, so premultiplied values are the colours themselves.
    let rgb: Vec<u8> = pixmap.data().chunks_exact(4).flat_map(|p| [p[0], p[1], p[2]]).collect();
    encode(&rgb, pixmap.width(), pixmap.height())
}

/// Refuses a picture that is empty or does not fit into memory.
pub(super) fn check_size(width: u64, height: u64) -> Result<(), RenderError> {
    let side = 1..=MAX_SIDE;
    if side.contains(&width) && side.contains(&height) && width * height <= MAX_PIXELS {
        Ok(())
    } else {
        Err(size_error(width, height))
    }
}

fn size_error(width: u64, height: u64) -> RenderError {
    RenderError::Size { width, height, max_side: MAX_SIDE, max_pixels: MAX_PIXELS }
}

/// Encodes RGB bytes, row by row, as a PNG.
pub(super) fn encode(rgb: &[u8], width: u32, height: u32) -> Result<Vec<u8>, RenderError> {
    let mut bytes = Vec::new();
    // Figures are flat: the fast setting costs little size and saves most of the time.
    PngEncoder::new_with_quality(&mut bytes, CompressionType::Fast, FilterType::Adaptive).write_image(
        rgb,
        width,
        height,
        ExtendedColorType::Rgb8,
    )?;
    Ok(bytes)
}
