//! Presentation of a picture on a screen or on paper: colours, width, size of letters.

use super::Theme;

/// Points per pixel of the layout: small letters are 12 pixels, 9 points.
const POINTS: f64 = 0.75;
/// Default size of the small letters in points.
const LETTERS: f64 = 9.0;
const MILLIMETRES_AN_INCH: f64 = 25.4;
const POINTS_AN_INCH: f64 = 72.0;

/// Colours, width on paper and size of letters of a picture.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Look {
    theme: Theme,
    /// Width in mm; `None` for the width of the layout.
    width: Option<f64>,
    /// Size of the small letters in points.
    letters: Option<f64>,
}

impl Look {
    /// The look with these colours, width in mm and size of small letters in points; `None` as on a
    /// screen.
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

    /// Whether a size on paper was requested.
    pub(super) fn on_paper(self) -> bool {
        self.width.is_some() || self.letters.is_some()
    }

    /// Points on paper per pixel of the layout.
    pub(super) fn points(self) -> f64 {
        POINTS * self.letters.unwrap_or(LETTERS) / LETTERS
    }

    /// Millimetres on paper per pixel of the layout.
    pub(super) fn millimetres(self) -> f64 {
        self.points() * MILLIMETRES_AN_INCH / POINTS_AN_INCH
    }

    /// Width of the layout in pixels, for a picture of default width `own`.
    pub(super) fn laid_out(self, own: f64) -> f64 {
        self.width.map_or(own, |width| width / self.millimetres())
    }
}

impl From<Theme> for Look {
    fn from(theme: Theme) -> Self {
        Self::new(theme, None, None)
    }
}
