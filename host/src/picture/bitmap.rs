//! Rasterization of shapes to PNG: anti-aliased paths, glyph outlines as paths, scaled rasters.
//! Lengths are in pixels of the sheet.

use tiny_skia::{
    FillRule, FilterQuality, Mask, Paint, Path, PathBuilder, Pixmap, PixmapPaint,
    PremultipliedColorU8, StrokeDash, Transform,
};

use super::shape::{Raster, Rect, Shape, Text};
use super::theme::Colour;
use super::{Look, font};

/// Pixels of the PNG per pixel of the sheet: sharp on current screens and in print.
const PIXELS_ON_SCREEN: f64 = 2.0;
/// Resolution on paper in dots per inch, as journals require.
const DOTS_PER_INCH: f64 = 300.0;

/// The PNG of shapes on a sheet of this size in sheet pixels; `None` if memory is insufficient.
pub(super) fn png(
    [width, height]: [f64; 2],
    about: &str,
    look: Look,
    shapes: &[Shape],
) -> Option<Vec<u8>> {
    let (paper, screen) = (look.points() / 72.0 * DOTS_PER_INCH, PIXELS_ON_SCREEN);
    let times = if look.on_paper() { paper } else { screen };
    let scale = || Transform::from_scale(times as f32, times as f32);
    let size = |length: f64| (length * times).round() as u32;
    let mut sheet = Pixmap::new(size(width), size(height))?;
    sheet.fill(colour(look.theme.background()));
    let mut clip: Option<(Rect, Mask)> = None;
    for shape in shapes {
        match shape {
            Shape::Path(shape) => {
                if let Some(rect) = shape.clip
                    && clip.as_ref().is_none_or(|(last, _)| *last != rect)
                {
                    let mut mask = Mask::new(sheet.width(), sheet.height())?;
                    let inside = outline(&[rect.corners()], true)?;
                    mask.fill_path(&inside, FillRule::Winding, true, scale());
                    clip = Some((rect, mask));
                }
                let mask = shape.clip.and(clip.as_ref()).map(|(_, mask)| mask);
                let Some(path) = outline(&shape.pieces, shape.closed) else {
                    continue;
                };
                if let Some(fill) = shape.fill {
                    sheet.fill_path(&path, &paint(fill), FillRule::Winding, scale(), mask);
                }
                if let Some(stroke) = shape.stroke {
                    let dash: Vec<f32> = stroke.dash.iter().map(|length| *length as f32).collect();
                    let line = tiny_skia::Stroke {
                        width: stroke.width as f32,
                        line_join: tiny_skia::LineJoin::Round,
                        // Without lengths there is no dash.
                        dash: StrokeDash::new(dash, 0.0),
                        ..tiny_skia::Stroke::default()
                    };
                    sheet.stroke_path(&path, &paint(stroke.colour), &line, scale(), mask);
                }
            }
            Shape::Text(text) => draw_text(&mut sheet, text, scale()),
            Shape::Image(place, raster) => image(&mut sheet, place, raster, times),
        }
    }
    encode(&sheet, about, look.on_paper())
}

/// A raster as a PNG with its palette, for embedding in SVG.
pub(super) fn indexed_png(raster: &Raster) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, raster.width as u32, raster.height as u32);
    encoder.set_color(png::ColorType::Indexed);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_palette(raster.rgb());
    let opacities = raster.palette.iter();
    let opacities = opacities.map(|colour| (colour.opacity * 255.0).round() as u8);
    encoder.set_trns(opacities.collect::<Vec<_>>());
    encoder.set_compression(png::Compression::High);
    // Writing to a Vec cannot fail. A raster of the wrong size gives an empty image.
    if let Ok(mut writer) = encoder.write_header() {
        let _ = writer.write_image_data(&raster.pixels);
    }
    bytes
}

fn colour(colour: Colour) -> tiny_skia::Color {
    let [red, green, blue] = colour.rgb;
    let mut made = tiny_skia::Color::from_rgba8(red, green, blue, 255);
    made.set_alpha(colour.opacity);
    made
}

fn paint(fill: Colour) -> Paint<'static> {
    let mut paint = Paint::default();
    paint.set_color(colour(fill));
    paint.anti_alias = true;
    paint
}

fn outline(pieces: &[Vec<(f64, f64)>], closed: bool) -> Option<Path> {
    let mut path = PathBuilder::new();
    for piece in pieces {
        if let Some(((x, y), rest)) = piece.split_first() {
            path.move_to(*x as f32, *y as f32);
            rest.iter()
                .for_each(|(x, y)| path.line_to(*x as f32, *y as f32));
        }
        if closed {
            path.close();
        }
    }
    path.finish()
}

fn draw_text(sheet: &mut Pixmap, text: &Text, scale: Transform) {
    let mut path = PathBuilder::new();
    font::outline(&text.content, text.size, text.bold, |begin, [b, c, d]| {
        if let Some(begin) = begin {
            path.move_to(begin.x, begin.y);
        }
        path.cubic_to(b.x, b.y, c.x, c.y, d.x, d.y);
    });
    let Some(path) = path.finish() else { return };
    let (x, y) = (text.at.0 as f32, text.at.1 as f32);
    let turn = Transform::from_rotate(if text.upright { -90.0 } else { 0.0 });
    let place = Transform::from_translate(-text.shift() as f32, 0.0)
        .post_concat(turn)
        .post_translate(x, y)
        .post_concat(scale);
    sheet.fill_path(&path, &paint(text.colour), FillRule::Winding, place, None);
}

fn image(sheet: &mut Pixmap, place: &Rect, raster: &Raster, times: f64) {
    let Some(mut source) = Pixmap::new(raster.width as u32, raster.height as u32) else {
        return;
    };
    let premultiplied = |entry: &Colour| colour(*entry).premultiply().to_color_u8();
    let palette: Vec<PremultipliedColorU8> = raster.palette.iter().map(premultiplied).collect();
    for (pixel, number) in source.pixels_mut().iter_mut().zip(&raster.pixels) {
        if let Some(entry) = palette.get(usize::from(*number)) {
            *pixel = *entry;
        }
    }
    let across = place.width / raster.width as f64;
    let down = place.height / raster.height as f64;
    let transform = Transform::from_scale(across as f32, down as f32)
        .post_translate(place.left as f32, place.top as f32)
        .post_concat(Transform::from_scale(times as f32, times as f32));
    let mut paint = PixmapPaint::default();
    if across * times <= 1.0 {
        paint.quality = FilterQuality::Bilinear;
    }
    sheet.draw_pixmap(0, 0, source.as_ref(), &paint, transform, None);
}

fn encode(sheet: &Pixmap, about: &str, on_paper: bool) -> Option<Vec<u8>> {
    // The sheet has an opaque background, so every pixel is opaque.
    let mut pixels = vec![[0; 3]; sheet.pixels().len()];
    for (to, pixel) in pixels.iter_mut().zip(sheet.pixels()) {
        *to = [pixel.red(), pixel.green(), pixel.blue()];
    }
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, sheet.width(), sheet.height());
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::Balanced);
    if on_paper {
        let dots = (DOTS_PER_INCH / 0.0254).round() as u32;
        encoder.set_pixel_dims(Some(png::PixelDimensions {
            xppu: dots,
            yppu: dots,
            unit: png::Unit::Meter,
        }));
    }
    if !about.is_empty() {
        encoder
            .add_itxt_chunk("Provenance".into(), about.into())
            .ok()?;
    }
    encoder
        .write_header()
        .ok()?
        .write_image_data(pixels.as_flattened())
        .ok()?;
    Some(bytes)
}
