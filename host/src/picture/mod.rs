//! Pictures of one house style, drawn once as shapes and written as SVG or PNG.
//!
//! Every axis has a unit by its type; colours, dashes, markers and hatches come from the theme by the
//! number of the series or the fill of the regime, so that all pictures of kband read alike, also in
//! grey and for colour-blind readers. Big point clouds and maps become one embedded image.

mod axis;
mod bitmap;
mod font;
mod panel;
mod shape;
mod svg;
mod theme;

pub use axis::{Axis, Unit};
pub use panel::{Grid, Panel};
pub use theme::{Fill, Theme};

use shape::{Anchor, Rect, Shape, Text};

/// A picture: a title and panels one below the other.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    title: String,
    caption: String,
    width: f64,
    panels: Vec<Panel>,
    beside: Option<Box<Picture>>,
}

impl Picture {
    /// A picture with a title and no panel yet, 900 pixels wide.
    #[must_use]
    pub fn new(title: impl Into<String>) -> Self {
        Self {
            title: title.into(),
            caption: String::new(),
            width: 900.0,
            panels: Vec::new(),
            beside: None,
        }
    }

    /// Another title.
    #[must_use]
    pub fn titled(mut self, title: impl Into<String>) -> Self {
        self.title = title.into();
        self
    }

    /// Another picture to the right of this one.
    #[must_use]
    pub fn beside(mut self, right: Self) -> Self {
        self.beside = Some(Box::new(right));
        self
    }

    /// A line below the title: the parameters it was drawn for.
    #[must_use]
    pub fn caption(mut self, words: impl Into<String>) -> Self {
        self.caption = words.into();
        self
    }

    /// Width in pixels (else 900).
    #[must_use]
    pub fn width(mut self, pixels: f64) -> Self {
        self.width = pixels.clamp(300.0, 4000.0);
        self
    }

    /// One more panel, below the others.
    #[must_use]
    pub fn panel(mut self, panel: Panel) -> Self {
        self.panels.push(panel);
        self
    }

    /// The picture as an SVG document.
    #[must_use]
    pub fn to_svg(&self, theme: Theme) -> String {
        let (size, shapes) = self.shapes(theme);
        svg::document(size[0], size[1], &self.title, &shapes)
    }

    /// The picture as a PNG of twice its size in pixels; `None` only where memory is refused.
    #[must_use]
    pub fn to_png(&self, theme: Theme) -> Option<Vec<u8>> {
        let (size, shapes) = self.shapes(theme);
        bitmap::png(size[0], size[1], theme.background(), &shapes)
    }

    /// Width and height, and what is drawn.
    fn shapes(&self, theme: Theme) -> ([f64; 2], Vec<Shape>) {
        let mut shapes = Vec::new();
        let (mut left, mut height) = (0.0, 0.0);
        let mut next = Some(self);
        while let Some(picture) = next {
            height = f64::max(height, picture.draw(theme, left, &mut shapes));
            left += picture.width;
            next = picture.beside.as_deref();
        }
        let sheet = Rect {
            left: 0.0,
            top: 0.0,
            width: left,
            height,
        };
        shapes.insert(0, Shape::area(sheet, theme.background()));
        ([left, height], shapes)
    }

    /// Draws this one alone from a left edge on; its height.
    fn draw(&self, theme: Theme, left: f64, shapes: &mut Vec<Shape>) -> f64 {
        let words = |y: f64, words: &str, size: f64, bold: bool, colour| {
            Shape::Text(Text {
                at: (left + 18.0, y),
                words: words.into(),
                size,
                bold,
                colour,
                anchor: Anchor::Start,
                upright: false,
            })
        };
        shapes.push(words(28.0, &self.title, 16.0, true, theme.text()));
        let mut y = 44.0;
        if !self.caption.is_empty() {
            for line in wrapped(&self.caption, self.width - 36.0) {
                shapes.push(words(y + 4.0, &line, panel::SMALL, false, theme.muted()));
                y += 16.0;
            }
            y += 4.0;
        }
        for panel in &self.panels {
            y = panel.draw(theme, left, y, self.width, shapes) + 10.0;
        }
        y
    }
}

/// The words in lines no wider than `width` pixels.
fn wrapped(words: &str, width: f64) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in words.split(' ') {
        match lines.last_mut() {
            Some(line) if font::width(&format!("{line} {word}"), panel::SMALL, false) <= width => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.into()),
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample() -> Panel {
        Panel::new(
            Axis::new("k", Unit::NONE, 0.3, 0.5),
            Axis::new("impact phase", Unit::RADIANS, 0.0, std::f64::consts::TAU).in_pi(),
        )
    }

    fn everything() -> Picture {
        let sine = |n: i32| (0.3 + f64::from(n) * 1e-4, 3.0 + f64::from(n).sin());
        let panel = sample()
            .heading("every kind of item")
            .strip("band", 0.393, 0.477)
            .density("impacts", (0..20_000).map(sine).collect())
            .line("line", 0, (0..2000).map(sine).collect())
            .markers("markers", 1, vec![(0.35, 1.0), (0.36, f64::NAN)])
            .between("between", 2, vec![(0.4, 1.0, 2.0), (0.5, 1.5, 2.0)])
            .bars("bars", 3, vec![(0.3, 0.31, 2.0)])
            .shelf("shelf", 1.0, 2.0)
            .mark(0.393, "k₂")
            .mark(0.394, "chaos")
            .level(3.0, "level")
            .note(0.45, 4.0, "a < b & c")
            .ribbon(
                vec![(0.3, 0.4, Fill::Chaotic), (0.4, 0.5, Fill::Locked)],
                &[(Fill::Locked, "locked")],
            );
        let map = sample().heat(
            Grid::new(2, vec![0.0, 1.0, 2.0, f64::NAN]),
            Axis::new("speed", Unit::MILLIMETRES_A_SECOND, 0.0, 2.0),
        );
        let classes = sample().classes(
            Grid::new(2, vec![Fill::Rest, Fill::Locked]),
            &[(Fill::Rest, "rest")],
        );
        Picture::new("Title")
            .caption("words ".repeat(60))
            .panel(panel)
            .panel(map)
            .panel(classes)
    }

    #[test]
    fn svg_is_small_and_its_words_are_escaped() {
        let svg = everything().to_svg(Theme::Light);
        assert!(svg.len() < 200_000, "{} bytes", svg.len());
        assert!(svg.contains("a &lt; b &amp; c") && svg.contains("k (–)"));
        assert!(!svg.contains("NaN") && !svg.contains("inf"));
        assert_eq!(svg.matches("<text").count(), svg.matches("</text>").count());
    }

    #[test]
    fn png_has_ink_on_every_panel() {
        for theme in [Theme::Light, Theme::Dark] {
            let bytes = everything().to_png(theme).unwrap();
            let mut reader = png::Decoder::new(std::io::Cursor::new(&bytes))
                .read_info()
                .unwrap();
            let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
            let info = reader.next_frame(&mut pixels).unwrap();
            assert_eq!(info.width, 1800);
            let background = theme.background();
            let blank = [background.red, background.green, background.blue];
            let inked = pixels.chunks(3).filter(|pixel| *pixel != blank).count();
            let share = inked as f64 / (pixels.len() / 3) as f64;
            assert!((0.2..0.9).contains(&share), "{share}");
        }
    }

    #[test]
    fn a_picture_beside_another_is_as_it_is_alone_but_farther_right() {
        let (alone, lone) = everything().shapes(Theme::Light);
        let (both, shapes) = sample_and(everything()).shapes(Theme::Light);
        assert_eq!(both, [alone[0] + 500.0, alone[1]]);
        let left = Picture::new("Left").width(500.0).panel(sample());
        assert_eq!(
            shapes.len(),
            lone.len() + left.shapes(Theme::Light).1.len() - 1
        );
        let svg = sample_and(everything()).to_svg(Theme::Light);
        assert!(svg.contains("Left") && svg.contains("every kind of item"));
    }

    fn sample_and(right: Picture) -> Picture {
        let left = Picture::new("Left").width(500.0).panel(sample());
        left.beside(right)
    }

    #[test]
    fn the_same_picture_gives_the_same_bytes() {
        assert_eq!(
            everything().to_svg(Theme::Dark),
            everything().to_svg(Theme::Dark)
        );
        assert_eq!(
            everything().to_png(Theme::Dark),
            everything().to_png(Theme::Dark)
        );
    }
}
