//! Widths and outlines of letters, from the bundled font.

use std::sync::LazyLock;

use ab_glyph::{Font, FontRef, GlyphId, OutlineCurve};

static REGULAR: LazyLock<Option<FontRef<'static>>> =
    LazyLock::new(|| FontRef::try_from_slice(file(false)).ok());
static BOLD: LazyLock<Option<FontRef<'static>>> =
    LazyLock::new(|| FontRef::try_from_slice(file(true)).ok());

/// The font file, TrueType.
pub(super) fn file(bold: bool) -> &'static [u8] {
    if bold {
        include_bytes!("../../fonts/kband-sans-bold.ttf")
    } else {
        include_bytes!("../../fonts/kband-sans.ttf")
    }
}

fn font(bold: bool) -> Option<&'static FontRef<'static>> {
    if bold {
        BOLD.as_ref()
    } else {
        REGULAR.as_ref()
    }
}

/// Width of `words` at a size in pixels.
pub(super) fn width(words: &str, size: f64, bold: bool) -> f64 {
    let Some(font) = font(bold) else {
        return 0.6 * size * words.chars().count() as f64;
    };
    glyphs(font, words).map(|(_, advance)| advance).sum::<f64>() * size
}

/// `size`, reduced so that `words` fit into `room` pixels, to no less than six tenths.
pub(super) fn fitted(words: &str, size: f64, bold: bool, room: f64) -> f64 {
    size * (room / width(words, size, bold)).clamp(0.6, 1.0)
}

/// Outlines of `words` at a size in pixels, beginning at (0, 0) of the baseline, y downwards.
pub(super) fn outline(words: &str, size: f64, bold: bool, mut draw: impl FnMut(OutlineCurve)) {
    let Some(font) = font(bold) else { return };
    let em = f64::from(font.units_per_em().unwrap_or(1000.0));
    let scale = (size / em) as f32;
    let mut left = 0.0;
    for (glyph, advance) in glyphs(font, words) {
        let offset = (left * size) as f32;
        let place =
            |point: ab_glyph::Point| ab_glyph::point(offset + point.x * scale, -point.y * scale);
        for curve in font
            .outline(glyph)
            .map(|outline| outline.curves)
            .unwrap_or_default()
        {
            draw(match curve {
                OutlineCurve::Line(a, b) => OutlineCurve::Line(place(a), place(b)),
                OutlineCurve::Quad(a, b, c) => OutlineCurve::Quad(place(a), place(b), place(c)),
                OutlineCurve::Cubic(a, b, c, d) => {
                    OutlineCurve::Cubic(place(a), place(b), place(c), place(d))
                }
            });
        }
        left += advance;
    }
}

/// Each letter of `words` with the number of its glyph and its advance in em.
pub(super) fn numbers(words: &str, bold: bool) -> impl Iterator<Item = (char, u16, f64)> {
    let font = font(bold);
    let glyphs = font.into_iter().flat_map(move |font| glyphs(font, words));
    let letters = words.chars();
    letters
        .zip(glyphs)
        .map(|(letter, (glyph, advance))| (letter, glyph.0, advance))
}

/// Every letter of the font, in the same form.
pub(super) fn all(bold: bool) -> impl Iterator<Item = (char, u16, f64)> {
    let font = font(bold);
    font.into_iter().flat_map(|font| {
        let em = f64::from(font.units_per_em().unwrap_or(1000.0));
        font.codepoint_ids().map(move |(glyph, letter)| {
            (
                letter,
                glyph.0,
                f64::from(font.h_advance_unscaled(glyph)) / em,
            )
        })
    })
}

/// Dimensions of a face's letters in em; upwards and to the right are positive.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Measures {
    /// Left, lower, right and upper edge of the box around all letters.
    pub bounds: [f64; 4],
    pub ascent: f64,
    pub descent: f64,
    /// Height of a capital letter.
    pub capital: f64,
    /// Width of an upright stroke.
    pub stem: f64,
}

/// Dimensions of the bundled font.
pub(super) fn measures(bold: bool) -> Measures {
    let Some(font) = font(bold) else {
        return Measures::default();
    };
    let em = f64::from(font.units_per_em().unwrap_or(1000.0));
    let bounds = |glyph: GlyphId| {
        let bounds = font.outline(glyph)?.bounds;
        let [a, b] = [bounds.min, bounds.max];
        Some([
            f64::from(a.x.min(b.x)) / em,
            f64::from(a.y.min(b.y)) / em,
            f64::from(a.x.max(b.x)) / em,
            f64::from(a.y.max(b.y)) / em,
        ])
    };
    let of = |letter: char| bounds(font.glyph_id(letter)).unwrap_or_default();
    let all = font
        .codepoint_ids()
        .filter_map(|(glyph, _)| bounds(glyph))
        .reduce(|a, b| {
            [
                a[0].min(b[0]),
                a[1].min(b[1]),
                a[2].max(b[2]),
                a[3].max(b[3]),
            ]
        });
    // The letters I and l of a sans-serif font are one stem each; the narrower one has no serif.
    let width = |[left, _, right, _]: [f64; 4]| right - left;
    Measures {
        bounds: all.unwrap_or_default(),
        ascent: f64::from(font.ascent_unscaled()) / em,
        descent: f64::from(font.descent_unscaled()) / em,
        capital: of('H')[3],
        stem: width(of('I')).min(width(of('l'))),
    }
}

/// The glyphs of `words` and their advance in em.
fn glyphs<'a>(
    font: &'a FontRef<'static>,
    words: &'a str,
) -> impl Iterator<Item = (GlyphId, f64)> + 'a {
    let em = f64::from(font.units_per_em().unwrap_or(1000.0));
    words.chars().map(move |letter| {
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

    #[test]
    fn a_face_is_measured_by_its_letters() {
        let [regular, bold] = [false, true].map(measures);
        for face in [regular, bold] {
            let [left, lower, right, upper] = face.bounds;
            assert!(
                left <= 0.0 && lower < 0.0 && right > 0.6 && upper >= face.capital,
                "{face:?}"
            );
            assert!(
                face.descent < 0.0 && face.ascent >= face.capital,
                "{face:?}"
            );
            assert!((0.6..0.8).contains(&face.capital), "{face:?}");
            assert!((0.05..0.25).contains(&face.stem), "{face:?}");
        }
        assert!(bold.stem > 1.3 * regular.stem, "{regular:?} {bold:?}");
    }
}
