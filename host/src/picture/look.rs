//! Presentation of a picture on a screen or on paper: colours, width, size of letters.

use super::{Picture, Theme};
use crate::arguments::{number, within};
use crate::file::Destination;
use crate::provenance;
use crate::refusal::{Refusal, Result};

/// Points per pixel of the layout: small letters are 12 pixels, 9 points.
const POINTS: f64 = 0.75;
/// Default size of the small letters in points.
const LETTERS: f64 = 9.0;

/// Colours of a picture, its width on paper and the size of its letters.
#[derive(Clone, Copy, Debug, Default, PartialEq, clap::Args)]
pub struct Look {
    /// Colours of the picture.
    #[arg(long, value_enum, default_value_t = Theme::Light)]
    pub(super) theme: Theme,

    /// Width of the picture on paper: column (84 mm), page (174 mm), or 40..1000 mm.
    #[arg(long, value_name = "MM", value_parser = width)]
    pub(super) width: Option<f64>,

    /// Size of the picture's small letters on paper in points [default: 9].
    #[arg(long, value_name = "PT", value_parser = within(4.0, 30.0, "pt"))]
    pub(super) font_size: Option<f64>,
}

fn width(text: &str) -> Result<f64, String> {
    match text.trim() {
        "column" => Ok(84.0),
        "page" => Ok(174.0),
        text => match number(text.trim_end_matches("mm").trim_end()) {
            Ok(width) if (40.0..=1000.0).contains(&width) => Ok(width),
            _ => Err("accepted: column (84 mm), page (174 mm), or 40..1000 mm".into()),
        },
    }
}

pub const PICTURES: [&str; 3] = ["svg", "png", "pdf"];

impl Look {
    /// Writes the picture in the format of the file's ending, one of [`PICTURES`].
    pub fn write(self, target: &Destination, picture: &Picture) -> Result<()> {
        let bytes = picture.to_bytes(&target.ending(), self, &provenance::line());
        let bytes = bytes.ok_or_else(|| {
            let cause = "there is no memory for the picture";
            Refusal::new(cause, "write an .svg or .pdf instead")
        })?;
        target.write_bytes(&bytes)
    }

    pub(super) fn on_paper(self) -> bool {
        self.width.is_some() || self.font_size.is_some()
    }

    /// Points on paper per pixel of the layout.
    pub(super) fn points(self) -> f64 {
        POINTS * self.font_size.unwrap_or(LETTERS) / LETTERS
    }

    /// Millimetres on paper per pixel of the layout.
    pub(super) fn millimetres(self) -> f64 {
        self.points() * 25.4 / 72.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn widths_as_typed() {
        assert_eq!(width("column"), Ok(84.0));
        assert_eq!(width("page"), Ok(174.0));
        assert_eq!(width("120 mm"), Ok(120.0));
        for bad in ["", "wide", "39", "1001", "nan", "-84"] {
            assert!(width(bad).unwrap_err().contains("column (84 mm)"), "{bad}");
        }
    }
}
