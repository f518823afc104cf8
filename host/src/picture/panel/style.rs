//! Text, frames, swatches and markers of every panel.

use super::SMALL;
use crate::picture::font;
use crate::picture::shape::{Anchor, Rect, Shape, Stroke, Text};
use crate::picture::theme::{Colour, Fill, Hatch, Marker, Theme};

pub(super) fn label(at: (f64, f64), words: &str, anchor: Anchor, colour: Colour) -> Text {
    Text {
        at,
        words: words.into(),
        size: SMALL,
        bold: false,
        colour,
        anchor,
        upright: false,
    }
}

/// Words that read upwards beside an axis of this length, smaller where they do not fit.
pub(super) fn upright(at: (f64, f64), words: &str, colour: Colour, length: f64) -> Shape {
    Shape::Text(Text {
        upright: true,
        size: font::fitted(words, 13.0, false, length + 36.0),
        ..label(at, words, Anchor::Middle, colour)
    })
}

pub(super) fn dashed(theme: Theme) -> Stroke {
    Stroke {
        colour: theme.muted(),
        width: 1.2,
        dash: &[5.0, 3.0],
    }
}

pub(super) fn frame_of(rect: Rect, colour: Colour, width: f64) -> Shape {
    let stroke = Stroke::solid(colour, width);
    Shape::areas(vec![rect.corners()], None, Some(stroke), None)
}

pub(super) fn framed(rect: Rect, fill: Colour, line: Colour) -> Shape {
    let stroke = Stroke::solid(line, 0.8);
    Shape::areas(vec![rect.corners()], Some(fill), Some(stroke), None)
}

pub(super) fn swatch(theme: Theme, fill: Fill, rect: Rect, frame: bool, shapes: &mut Vec<Shape>) {
    shapes.push(Shape::area(rect, fill.colour(theme)));
    let step = 6.0;
    let mut pieces = Vec::new();
    let hatch = fill.hatch();
    let rises: &[f64] = match hatch {
        Hatch::None => &[],
        Hatch::Up => &[1.0],
        Hatch::Down => &[-1.0],
        Hatch::Cross => &[1.0, -1.0],
        Hatch::Upright => &[0.0],
    };
    // The pattern is aligned to the sheet, not to the rectangle, so neighbours join.
    for rise in rises {
        let reach = rise.abs() * rect.height;
        let first = ((rect.left - reach) / step).ceil() as i64;
        let last = ((rect.right() + reach) / step).floor() as i64;
        for n in first..=last {
            let foot = n as f64 * step;
            let ends = clipped(
                rect,
                (foot, rect.bottom()),
                (foot + rise * rect.height, rect.top),
            );
            pieces.extend(ends.map(|(a, b)| vec![a, b]));
        }
    }
    if !pieces.is_empty() {
        // The colour with more contrast to the fill: that of the text or of the sheet.
        let fill = fill.colour(theme).luminance();
        let [ink, sheet] = [theme.text(), theme.background()];
        let from = |colour: Colour| (colour.luminance() - fill).abs();
        let colour = if from(ink) < from(sheet) { sheet } else { ink };
        let stroke = Stroke::solid(colour.faint(0.55), 0.8);
        shapes.push(Shape::lines(pieces, stroke, None));
    }
    if frame {
        shapes.push(frame_of(rect, theme.muted(), 0.8));
    }
}

/// The part of a rising line within the sides of a rectangle.
pub(super) fn clipped(
    rect: Rect,
    a: (f64, f64),
    b: (f64, f64),
) -> Option<((f64, f64), (f64, f64))> {
    let at = |x: f64| (x, a.1 + (b.1 - a.1) * (x - a.0) / (b.0 - a.0));
    let clip = |end: (f64, f64)| {
        if end.0 < rect.left {
            at(rect.left)
        } else if end.0 > rect.right() {
            at(rect.right())
        } else {
            end
        }
    };
    let outside = a.0.max(b.0) <= rect.left || a.0.min(b.0) >= rect.right();
    (!outside).then(|| (clip(a), clip(b)))
}

/// Number of markers from which they are drawn small.
const MIN_SMALL_MARKERS: usize = 120;

pub(super) fn marks(
    theme: Theme,
    series: usize,
    places: &[(f64, f64)],
    clip: Option<Rect>,
) -> Shape {
    let (colour, _, marker) = theme.series(series);
    let shape: Vec<(f64, f64)> = match marker {
        Marker::Circle => (0..12)
            .map(|n| (f64::from(n) / 12.0 * std::f64::consts::TAU).sin_cos())
            .map(|(x, y)| (3.0 * x, 3.0 * y))
            .collect(),
        Marker::Square => vec![(-2.7, -2.7), (2.7, -2.7), (2.7, 2.7), (-2.7, 2.7)],
        Marker::Triangle => vec![(0.0, -3.6), (3.4, 2.6), (-3.4, 2.6)],
        Marker::Diamond => vec![(0.0, -4.0), (4.0, 0.0), (0.0, 4.0), (-4.0, 0.0)],
        Marker::Cross => vec![
            (-1.0, -3.6),
            (1.0, -3.6),
            (1.0, -1.0),
            (3.6, -1.0),
            (3.6, 1.0),
            (1.0, 1.0),
            (1.0, 3.6),
            (-1.0, 3.6),
            (-1.0, 1.0),
            (-3.6, 1.0),
            (-3.6, -1.0),
            (-1.0, -1.0),
        ],
    };
    // Many markers overlap: smaller ones without an edge do not hide each other.
    let many = places.len() > MIN_SMALL_MARKERS;
    let size = if many { 0.55 } else { 1.0 };
    let piece = |(x, y): &(f64, f64)| {
        let moved = shape.iter().map(|(a, b)| (x + size * a, y + size * b));
        moved.collect()
    };
    let pieces = places.iter().map(piece).collect();
    let edge = (!many).then(|| Stroke::solid(theme.background(), 0.6));
    Shape::areas(pieces, Some(colour), edge, clip)
}
