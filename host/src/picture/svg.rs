//! Shapes as SVG.

use std::fmt::Write;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;

use super::shape::{Anchor, Rect, Shape, Text};
use super::theme::Colour;
use super::{Look, bitmap};

/// The SVG document of shapes on a sheet of this size, with title and description.
pub(super) fn document(
    [width, height]: [f64; 2],
    [title, about]: [&str; 2],
    look: Look,
    shapes: &[Shape],
) -> String {
    let mut clips: Vec<Rect> = Vec::new();
    let mut body = String::new();
    for shape in shapes {
        // Writing to a String cannot fail.
        let _ = draw(&mut body, &mut clips, shape);
    }
    let size = |pixels: f64| match look.on_paper() {
        true => format!("{}mm", short(pixels * look.millimetres())),
        false => pixels.to_string(),
    };
    let mut text = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{}\" height=\"{}\" \
         viewBox=\"0 0 {width} {height}\" font-family=\"'DejaVu Sans', Verdana, sans-serif\">\n\
         <title>{}</title>\n",
        size(width),
        size(height),
        escape(title)
    );
    if !about.is_empty() {
        let _ = writeln!(text, "<metadata>{}</metadata>", escape(about));
    }
    if !clips.is_empty() {
        text.push_str("<defs>\n");
        for (n, clip) in clips.iter().enumerate() {
            let rect = placed(clip);
            let _ = writeln!(text, "<clipPath id=\"c{n}\"><rect {rect}/></clipPath>");
        }
        text.push_str("</defs>\n");
    }
    text + &body + "</svg>\n"
}

fn draw(out: &mut String, clips: &mut Vec<Rect>, shape: &Shape) -> std::fmt::Result {
    match shape {
        Shape::Path(path) => {
            out.push_str("<path d=\"");
            for piece in &path.pieces {
                for (n, (x, y)) in piece.iter().enumerate() {
                    let step = if n == 0 { 'M' } else { 'L' };
                    out.push(step);
                    add_short(out, *x);
                    out.push(' ');
                    add_short(out, *y);
                }
                if path.closed {
                    out.push('Z');
                }
            }
            out.push('"');
            match path.fill {
                Some(colour) => paint(out, "fill", colour)?,
                None => out.push_str(" fill=\"none\""),
            }
            if let Some(stroke) = path.stroke {
                paint(out, "stroke", stroke.colour)?;
                let width = short(stroke.width);
                write!(out, " stroke-width=\"{width}\" stroke-linejoin=\"round\"")?;
                if !stroke.dash.is_empty() {
                    let dash: Vec<String> = stroke.dash.iter().copied().map(short).collect();
                    write!(out, " stroke-dasharray=\"{}\"", dash.join(" "))?;
                }
            }
            if let Some(clip) = path.clip {
                let existing = clips.iter().position(|other| *other == clip);
                let n = existing.unwrap_or_else(|| {
                    clips.push(clip);
                    clips.len() - 1
                });
                write!(out, " clip-path=\"url(#c{n})\"")?;
            }
            out.push_str("/>\n");
            Ok(())
        }
        Shape::Text(text) => write_text(out, text),
        Shape::Image(place, raster) => {
            // Viewers enlarge images differently; large cells keep sharp edges in all of them.
            let repeat =
                |place: f64, cells: usize| (2.0 * place / cells as f64).ceil().max(1.0) as usize;
            let across = repeat(place.width, raster.width);
            let large = raster.repeated(across, repeat(place.height, raster.height));
            let (place, png) = (placed(place), STANDARD.encode(bitmap::indexed_png(&large)));
            writeln!(
                out,
                "<image {place} preserveAspectRatio=\"none\" href=\"data:image/png;base64,{png}\"/>"
            )
        }
    }
}

fn placed(rect: &Rect) -> String {
    let [x, y, width, height] = rect.sides().map(short);
    format!("x=\"{x}\" y=\"{y}\" width=\"{width}\" height=\"{height}\"")
}

fn write_text(out: &mut String, text: &Text) -> std::fmt::Result {
    let (x, y) = (short(text.at.0), short(text.at.1));
    if text.upright {
        write!(out, "<text transform=\"translate({x} {y}) rotate(-90)\"")?;
    } else {
        write!(out, "<text x=\"{x}\" y=\"{y}\"")?;
    }
    write!(out, " font-size=\"{}\"", short(text.size))?;
    if text.bold {
        out.push_str(" font-weight=\"bold\"");
    }
    match text.anchor {
        Anchor::Start => {}
        Anchor::Middle => out.push_str(" text-anchor=\"middle\""),
        Anchor::End => out.push_str(" text-anchor=\"end\""),
    }
    paint(out, "fill", text.colour)?;
    writeln!(out, ">{}</text>", escape(&text.content))
}

fn paint(out: &mut String, what: &str, colour: Colour) -> std::fmt::Result {
    let [red, green, blue] = colour.rgb;
    write!(out, " {what}=\"#{red:02x}{green:02x}{blue:02x}\"")?;
    if colour.opacity < 1.0 {
        let opacity = short(f64::from(colour.opacity));
        write!(out, " {what}-opacity=\"{opacity}\"")?;
    }
    Ok(())
}

/// A coordinate with at most two decimals.
fn short(value: f64) -> String {
    let mut text = String::new();
    add_short(&mut text, value);
    text
}

/// Appends a coordinate with at most two decimals.
fn add_short(out: &mut String, value: f64) {
    let hundredths = (100.0 * value).round() as i64;
    if hundredths < 0 {
        out.push('-');
    }
    let size = hundredths.unsigned_abs();
    let (whole, rest) = (size / 100, size % 100);
    // Writing to a String cannot fail.
    let _ = match (rest / 10, rest % 10) {
        (0, 0) => write!(out, "{whole}"),
        (tenths, 0) => write!(out, "{whole}.{tenths}"),
        _ => write!(out, "{whole}.{rest:02}"),
    };
}

/// Text as the content of an element.
pub(crate) fn escape(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
}
