//! Widths and outlines of letters of the bundled font.

use std::sync::LazyLock;

use ab_glyph::{Font, FontRef, GlyphId, OutlineCurve, Point, point};

static FONTS: LazyLock<[Option<FontRef<'static>>; 2]> = LazyLock::new(|| {
    let regular: &[u8] = include_bytes!("../../fonts/kband-sans.ttf");
    let bold: &[u8] = include_bytes!("../../fonts/kband-sans-bold.ttf");
    [regular, bold].map(|bytes| FontRef::try_from_slice(bytes).ok())
});

fn font(bold: bool) -> Option<&'static FontRef<'static>> {
    FONTS[usize::from(bold)].as_ref()
}

/// Width of `text` at a size in pixels.
pub(super) fn width(text: &str, size: f64, bold: bool) -> f64 {
    let Some(font) = font(bold) else {
        return 0.6 * size * text.chars().count() as f64;
    };
    glyphs(font, text).map(|(_, advance)| advance).sum::<f64>() * size
}

/// `size`, reduced so that `text` fit into `room` pixels, to at least 0.6 of it.
pub(super) fn fit_size(text: &str, size: f64, bold: bool, room: f64) -> f64 {
    size * (room / width(text, size, bold)).clamp(0.6, 1.0)
}

/// Outlines of `text` at a size in pixels, from (0, 0) on the baseline, with y downwards. They are
/// cubic curves: the start of a contour, then two control points and the end of each curve.
pub(super) fn outline(
    text: &str,
    size: f64,
    bold: bool,
    mut draw: impl FnMut(Option<Point>, [Point; 3]),
) {
    let Some(font) = font(bold) else { return };
    let em = f64::from(font.units_per_em().unwrap_or(1000.0));
    let scale = (size / em) as f32;
    let mut left = 0.0;
    for (glyph, advance) in glyphs(font, text) {
        let offset = (left * size) as f32;
        let place = |at: Point| point(offset + at.x * scale, -at.y * scale);
        let outline = font.outline(glyph);
        let mut end = None;
        for curve in outline.map(|outline| outline.curves).unwrap_or_default() {
            let (start, handles, last) = match curve {
                OutlineCurve::Line(a, b) => (a, [a, b], b),
                OutlineCurve::Quad(a, b, c) => {
                    let part = |from: f32, to: f32| from + (to - from) * (2.0 / 3.0);
                    let towards = |from: Point| point(part(from.x, b.x), part(from.y, b.y));
                    (a, [towards(a), towards(c)], c)
                }
                OutlineCurve::Cubic(a, b, c, d) => (a, [b, c], d),
            };
            let begin = (end != Some(start)).then(|| place(start));
            draw(begin, [handles[0], handles[1], last].map(place));
            end = Some(last);
        }
        left += advance;
    }
}

fn glyphs<'a>(
    font: &'a FontRef<'static>,
    text: &'a str,
) -> impl Iterator<Item = (GlyphId, f64)> + 'a {
    let em = f64::from(font.units_per_em().unwrap_or(1000.0));
    text.chars().map(move |letter| {
        let glyph = font.glyph_id(letter);
        (glyph, f64::from(font.h_advance_unscaled(glyph)) / em)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_font_has_every_sign_that_pictures_use() {
        for bold in [false, true] {
            let font = font(bold).unwrap();
            for letter in "aZ09 ψφτγηαωΓπλ·−–×≤≥≈∞√²³₀₁₂₃₄°µ".chars()
            {
                assert_ne!(font.glyph_id(letter).0, 0, "{letter}");
            }
        }
        assert!(width("MM", 10.0, false) > 1.9 * width("n", 10.0, false));
    }
}
