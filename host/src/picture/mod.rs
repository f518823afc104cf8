//! Pictures in one style, legible in grey and for colour-blind readers, drawn once as shapes and
//! written as SVG, PNG or PDF. Large point clouds and maps become one embedded image.

mod axis;
mod bitmap;
mod font;
mod look;
mod panel;
mod pdf;
mod shape;
mod svg;
mod theme;

pub use axis::Axis;
pub use look::{Look, PICTURES};
pub use panel::{Grid, Panel};
use panel::{SMALL_TEXT_SIZE, label};
pub(crate) use svg::escape;
pub use theme::{Fill, Theme, page_colours};

use shape::{Anchor, Rect, Shape};

#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    title: String,
    caption: String,
    width: f64,
    panels: Vec<Panel>,
}

impl Picture {
    /// A picture with a title and no panel yet, 900 pixels wide.
    pub fn new(title: impl Into<String>) -> Self {
        Self {
            title: title.into(),
            caption: String::new(),
            width: 900.0,
            panels: Vec::new(),
        }
    }

    pub fn caption(mut self, text: impl Into<String>) -> Self {
        self.caption = text.into();
        self
    }

    /// Width in pixels; default 900.
    pub fn width(mut self, pixels: f64) -> Self {
        self.width = pixels.clamp(300.0, 4000.0);
        self
    }

    pub fn panel(mut self, panel: Panel) -> Self {
        self.panels.push(panel);
        self
    }

    /// The picture as `svg`, `png` or `pdf`, of one page. A PNG has twice the picture's size for a
    /// screen, 300 dots per inch for paper. `about` is a description, empty for none. `None` only
    /// if memory is insufficient.
    pub fn to_bytes(&self, ending: &str, look: Look, about: &str) -> Option<Vec<u8>> {
        let (size, shapes) = self.shapes(look);
        let texts = [&self.title, about];
        match ending {
            "pdf" => Some(pdf::document(size, texts, look, &shapes)),
            "png" => bitmap::png(size, about, look, &shapes),
            _ => Some(svg::document(size, texts, look, &shapes).into_bytes()),
        }
    }

    fn shapes(&self, look: Look) -> ([f64; 2], Vec<Shape>) {
        let theme = look.theme;
        let on_paper = look.width.map(|width| width / look.millimetres());
        let width = on_paper.unwrap_or(self.width);
        let mut shapes = Vec::new();
        let mut y = 28.0;
        for line in wrapped(&self.title, TITLE, true, width - 36.0) {
            let text = label((18.0, y), &line, Anchor::Start, theme.text());
            shapes.push(Shape::Text(text.sized(TITLE, true)));
            y += 20.0;
        }
        y -= 4.0;
        if !self.caption.is_empty() {
            for line in wrapped(&self.caption, SMALL_TEXT_SIZE, false, width - 36.0) {
                let label = label((18.0, y + 4.0), &line, Anchor::Start, theme.muted());
                shapes.push(Shape::Text(label));
                y += 16.0;
            }
            y += 4.0;
        }
        for panel in &self.panels {
            let squeezed = (width / self.width).clamp(MIN_HEIGHT_RATIO, 1.0 / MIN_HEIGHT_RATIO);
            y = panel.draw(theme, y, width, squeezed, &mut shapes) + 10.0;
        }
        let sheet = Rect::new(0.0, 0.0, width, y);
        shapes.insert(0, Shape::area(sheet, theme.background()));
        ([width, y], shapes)
    }
}

const TITLE: f64 = 16.0;
/// Smallest factor on the heights of panels in a narrower picture.
const MIN_HEIGHT_RATIO: f64 = 0.6;

/// The words in lines of at most `width` pixels.
fn wrapped(text: &str, size: f64, bold: bool, width: f64) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split(' ') {
        match lines.last_mut() {
            Some(line) if font::width(&format!("{line} {word}"), size, bold) <= width => {
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
    use std::io::Cursor;

    use super::*;

    fn sample() -> Panel {
        let phase = Axis::new("impact phase", "rad", 0.0, std::f64::consts::TAU);
        Panel::new(Axis::new("k", "", 0.3, 0.5), phase.in_pi())
    }

    fn all_items() -> Picture {
        let sine = |n: i32| (0.3 + f64::from(n) * 1e-4, 3.0 + f64::from(n).sin());
        let panel = sample()
            .heading("every kind of item")
            .strip("band", 0.393, 0.477)
            .density("impacts", (0..20_000).map(sine).collect())
            .line("line", 0, (0..2000).map(sine).collect())
            .markers("markers", 1, vec![(0.35, 1.0), (0.36, f64::NAN)])
            .between("between", 2, vec![(0.4, 1.0, 2.0), (0.5, 1.5, 2.0)])
            .shelf("shelf", 1.0, 2.0)
            .mark(0.393, "k₂")
            .mark(0.394, "chaos")
            .level(3.0, "a < b & c")
            .ribbon(
                vec![(0.3, 0.4, Fill::Chaotic), (0.4, 0.5, Fill::Locked)],
                &[(Fill::Locked, "locked")],
            );
        let speeds = Grid::new(2, vec![0.0, 1.0, 2.0, f64::NAN]);
        let map = sample().heat(speeds, Axis::new("speed", "mm/s", 0.0, 2.0));
        let fills = Grid::new(2, vec![Fill::Rest, Fill::Locked]);
        let classes = sample().classes(fills, &[(Fill::Rest, "rest")]);
        Picture::new("Title")
            .caption("words ".repeat(60))
            .panel(panel)
            .panel(map)
            .panel(classes)
    }

    fn svg(picture: &Picture, look: Look) -> String {
        String::from_utf8(picture.to_bytes("svg", look, "").unwrap()).unwrap()
    }

    fn png(look: Look) -> png::Reader<Cursor<Vec<u8>>> {
        let bytes = all_items().to_bytes("png", look, "").unwrap();
        png::Decoder::new(Cursor::new(bytes)).read_info().unwrap()
    }

    #[test]
    fn svg_is_small_and_its_words_are_escaped() {
        let svg = svg(&all_items(), Look::default());
        assert!(svg.len() < 200_000, "{} bytes", svg.len());
        assert!(svg.contains("a &lt; b &amp; c") && svg.contains("k (–)"));
        assert!(!svg.contains("NaN") && !svg.contains("inf"));
        assert_eq!(svg.matches("<text").count(), svg.matches("</text>").count());
    }

    #[test]
    fn png_has_ink_on_every_panel() {
        for theme in [Theme::Light, Theme::Dark] {
            let look = Look {
                theme,
                ..Look::default()
            };
            let mut reader = png(look);
            let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
            let info = reader.next_frame(&mut pixels).unwrap();
            assert_eq!(info.width, 1800);
            let blank = theme.background().rgb;
            let inked = pixels.chunks(3).filter(|pixel| *pixel != blank).count();
            let share = inked as f64 / (pixels.len() / 3) as f64;
            assert!((0.2..0.9).contains(&share), "{share}");
        }
    }

    #[test]
    fn a_picture_has_the_requested_width_on_paper() {
        let column = Look {
            theme: Theme::Light,
            width: Some(84.0),
            font_size: Some(7.0),
        };
        let svg = svg(&all_items(), column);
        assert!(svg.contains("width=\"84mm\""), "{}", &svg[..120]);
        // 300 dots an inch.
        let reader = png(column);
        assert_eq!(reader.info().width, 992);
        assert_eq!(reader.info().pixel_dims.unwrap().xppu, 11_811);
        let pdf = all_items().to_bytes("pdf", column, "").unwrap();
        assert!(pdf.starts_with(b"%PDF-") && pdf.ends_with(b"%%EOF"));
        let text = String::from_utf8_lossy(&pdf);
        // 84 mm are 238.110 points.
        assert!(text.contains("/MediaBox [0 0 238.11"), "{}", text.len());
        assert!(text.contains("/SMask"));
        assert_eq!(all_items().to_bytes("pdf", column, ""), Some(pdf));
        // Small letters of 7 points are 12 pixels of the layout, so the layout is wider.
        let (size, _) = all_items().shapes(column);
        assert!((size[0] - 84.0 / 25.4 * 72.0 / (7.0 / 12.0)).abs() < 1e-9);
    }

    #[test]
    fn a_legend_names_drawn_items_and_counts_omitted_ones() {
        let picture = |points: Vec<(f64, f64)>, more: Vec<(f64, f64)>| {
            let panel = sample().markers("some", 0, points).line("others", 1, more);
            let picture = Picture::new("Title").panel(panel.strip("band", 0.6, 0.7));
            svg(&picture, Look::default())
        };
        let points = vec![(0.4, 1.0), (0.4, 7.0), (0.7, 1.0)];
        let svg = picture(points, Vec::new());
        assert!(svg.contains("some") && svg.contains("2 points beyond the scale"));
        assert!(!svg.contains("others") && !svg.contains("band"));
        let points = vec![(0.3, 1.0), (0.5, 1.0)];
        let svg = picture(Vec::new(), points);
        assert!(svg.contains("others") && !svg.contains("some") && !svg.contains("beyond"));
    }
}
