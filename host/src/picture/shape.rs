//! A picture as a list of shapes, in pixels of its own size, before its conversion to SVG, PNG or
//! PDF.

use super::font;
use super::theme::Colour;

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Rect {
    pub left: f64,
    pub top: f64,
    pub width: f64,
    pub height: f64,
}

impl Rect {
    pub(super) fn new(left: f64, top: f64, width: f64, height: f64) -> Self {
        Self {
            left,
            top,
            width,
            height,
        }
    }

    pub(super) fn right(&self) -> f64 {
        self.left + self.width
    }

    pub(super) fn bottom(&self) -> f64 {
        self.top + self.height
    }

    /// Left, top, width, height.
    pub(super) fn sides(&self) -> [f64; 4] {
        [self.left, self.top, self.width, self.height]
    }

    pub(super) fn corners(&self) -> Vec<(f64, f64)> {
        let (left, top, right, bottom) = (self.left, self.top, self.right(), self.bottom());
        vec![(left, top), (right, top), (right, bottom), (left, bottom)]
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Stroke {
    pub colour: Colour,
    pub width: f64,
    pub dash: &'static [f64],
}

impl Stroke {
    pub(super) const fn new(colour: Colour, width: f64, dash: &'static [f64]) -> Self {
        Self {
            colour,
            width,
            dash,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Anchor {
    Start,
    Middle,
    End,
}

#[derive(Clone, Debug, PartialEq)]
pub(super) struct Text {
    pub at: (f64, f64),
    pub content: String,
    pub size: f64,
    pub bold: bool,
    pub colour: Colour,
    pub anchor: Anchor,
    pub upright: bool,
}

impl Text {
    pub(super) fn sized(self, size: f64, bold: bool) -> Self {
        Self { size, bold, ..self }
    }

    /// Distance from the start of the text to its anchor point.
    pub(super) fn shift(&self) -> f64 {
        let share = match self.anchor {
            Anchor::Start => 0.0,
            Anchor::Middle => 0.5,
            Anchor::End => 1.0,
        };
        share * font::width(&self.content, self.size, self.bold)
    }
}

/// Pixels by number in a palette, rows from the top.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Raster {
    pub width: usize,
    pub height: usize,
    pub palette: Vec<Colour>,
    pub pixels: Vec<u8>,
}

impl Raster {
    pub(super) fn new(width: usize, palette: Vec<Colour>, pixels: Vec<u8>) -> Self {
        let height = pixels.len() / width;
        Self {
            width,
            height,
            palette,
            pixels,
        }
    }

    /// Red, green and blue of each colour of the palette.
    pub(super) fn rgb(&self) -> Vec<u8> {
        self.palette.iter().flat_map(|colour| colour.rgb).collect()
    }

    /// Repeats every pixel horizontally and vertically; a raster finer than the picture is
    /// unchanged.
    pub(super) fn repeated(&self, across: usize, down: usize) -> Self {
        let enough = |times: usize| if times > 2 { times } else { 1 };
        let (across, down) = (enough(across), enough(down));
        let wide = |pixel: &u8| std::iter::repeat_n(*pixel, across);
        let large = |row: &[u8]| {
            let row: Vec<u8> = row.iter().flat_map(wide).collect();
            std::iter::repeat_n(row, down).flatten()
        };
        let rows = self.pixels.chunks(self.width.max(1));
        let pixels = rows.flat_map(large).collect();
        Self::new(self.width * across, self.palette.clone(), pixels)
    }
}

/// Lines and areas. Several pieces share fill and stroke, so many markers are one shape.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Path {
    pub pieces: Vec<Vec<(f64, f64)>>,
    pub closed: bool,
    pub fill: Option<Colour>,
    pub stroke: Option<Stroke>,
    pub clip: Option<Rect>,
}

#[derive(Clone, Debug, PartialEq)]
pub(super) enum Shape {
    Path(Path),
    Text(Text),
    Image(Rect, Raster),
}

impl Shape {
    pub(super) fn lines(pieces: Vec<Vec<(f64, f64)>>, stroke: Stroke, clip: Option<Rect>) -> Self {
        Self::Path(Path {
            pieces,
            closed: false,
            fill: None,
            stroke: Some(stroke),
            clip,
        })
    }

    pub(super) fn areas(
        pieces: Vec<Vec<(f64, f64)>>,
        fill: Option<Colour>,
        stroke: Option<Stroke>,
        clip: Option<Rect>,
    ) -> Self {
        Self::Path(Path {
            pieces,
            closed: true,
            fill,
            stroke,
            clip,
        })
    }

    pub(super) fn area(rect: Rect, fill: Colour) -> Self {
        Self::areas(vec![rect.corners()], Some(fill), None, None)
    }
}
