//! How a picture looks: for a screen, or for paper.

use crate::file::Destination;
use crate::picture::{Look, Picture, Theme};
use crate::provenance;
use crate::refusal::Refusal;

use super::{number, within};

/// Colours of a picture, its width on paper and the size of its letters.
#[derive(Clone, Copy, Debug, Default, clap::Args)]
pub struct LookArguments {
    /// Colours of the picture.
    #[arg(long, value_enum, default_value_t = Theme::Light)]
    theme: Theme,

    /// Width of the picture on paper: column (84 mm), page (174 mm), or 40..1000 mm.
    #[arg(long, value_name = "MM", value_parser = width)]
    width: Option<f64>,

    /// Size of the picture's small letters on paper in points [default: 9].
    #[arg(long, value_name = "PT", value_parser = within(4.0, 30.0, "pt"))]
    font_size: Option<f64>,
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

/// Endings of the files that pictures are written to.
pub const PICTURES: [&str; 3] = ["svg", "png", "pdf"];

impl LookArguments {
    /// Writes the picture as its ending says, one of [`PICTURES`].
    pub fn write(self, target: &Destination, picture: &Picture) -> Result<(), Refusal> {
        let look = Look::new(self.theme, self.width, self.font_size);
        let about = provenance::line();
        let bytes = match target.ending().as_str() {
            "pdf" => picture.to_pdf(look, &about),
            "png" => picture.to_png(look, &about).ok_or_else(|| {
                Refusal::new(
                    "there is no memory for the picture",
                    "write an .svg or .pdf instead",
                )
            })?,
            _ => picture.to_svg(look, &about).into_bytes(),
        };
        target.write_bytes(&bytes)
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
