//! How a picture is put on a screen or on paper: colours, width, size of its letters.

use super::Theme;

/// Points to a pixel of the layout: its small letters are 12 pixels, 9 points.
const POINTS: f64 = 0.75;
/// Size of the small letters in points where none is asked for.
const LETTERS: f64 = 9.0;
const MILLIMETRES_AN_INCH: f64 = 25.4;
const POINTS_AN_INCH: f64 = 72.0;

/// Colours, width on paper and size of letters of a picture.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Look {
    theme: Theme,
    /// In mm; `None` as wide as the picture is laid out.
    width: Option<f64>,
    /// Small letters in points.
    letters: Option<f64>,
}

impl Look {
    /// The look of these colours, this width in mm, and small letters of this size in points; `None` as on a screen.
    #[must_use]
    pub fn new(theme: Theme, width: Option<f64>, letters: Option<f64>) -> Self {
        Self {
            theme,
            width,
            letters,
        }
    }

    pub(super) fn theme(self) -> Theme {
        self.theme
    }

    /// Whether it was asked for as so wide on paper.
    pub(super) fn on_paper(self) -> bool {
        self.width.is_some() || self.letters.is_some()
    }

    /// Points on paper to a pixel of the layout.
    pub(super) fn points(self) -> f64 {
        POINTS * self.letters.unwrap_or(LETTERS) / LETTERS
    }

    /// Millimetres on paper to a pixel of the layout.
    pub(super) fn millimetres(self) -> f64 {
        self.points() * MILLIMETRES_AN_INCH / POINTS_AN_INCH
    }

    /// Width of the layout in pixels, of a picture that is `own` pixels wide by itself.
    pub(super) fn laid_out(self, own: f64) -> f64 {
        self.width.map_or(own, |width| width / self.millimetres())
    }
}

impl From<Theme> for Look {
    fn from(theme: Theme) -> Self {
        Self::new(theme, None, None)
    }
}
