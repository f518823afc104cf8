//! Text, frames, swatches and markers of every panel.

use std::f64::consts::TAU;

use super::SMALL_TEXT_SIZE;
use crate::picture::font;
use crate::picture::shape::{Anchor, Rect, Shape, Stroke, Text};
use crate::picture::theme::{Colour, Fill, Theme};

pub(in crate::picture) fn label(
    at: (f64, f64),
    text: &str,
    anchor: Anchor,
    colour: Colour,
) -> Text {
    Text {
        at,
        content: text.into(),
        size: SMALL_TEXT_SIZE,
        bold: false,
        colour,
        anchor,
        upright: false,
    }
}

/// Text that runs upwards beside an axis of this length, smaller if it does not fit.
pub(super) fn vertical_text(at: (f64, f64), text: &str, colour: Colour, length: f64) -> Shape {
    Shape::Text(Text {
        upright: true,
        size: font::fit_size(text, 13.0, false, length + 36.0),
        ..label(at, text, Anchor::Middle, colour)
    })
}

pub(super) fn series_stroke(theme: Theme, series: usize, width: f64) -> Stroke {
    const DASHES: [&[f64]; 7] = [
        &[],
        &[7.0, 3.0],
        &[2.0, 2.5],
        &[9.0, 3.0, 2.0, 3.0],
        &[12.0, 4.0],
        &[4.0, 2.0],
        &[1.5, 1.5],
    ];
    Stroke::new(theme.series(series), width, DASHES[series % 7])
}

pub(super) fn dashed(theme: Theme) -> Stroke {
    Stroke::new(theme.muted(), 1.2, &[5.0, 3.0])
}

pub(super) fn frame(rect: Rect, fill: Option<Colour>, line: Colour, width: f64) -> Shape {
    let stroke = Stroke::new(line, width, &[]);
    Shape::areas(vec![rect.corners()], fill, Some(stroke), None)
}

pub(super) fn swatch(theme: Theme, fill: Fill, rect: Rect, shapes: &mut Vec<Shape>) {
    shapes.push(Shape::area(rect, fill.colour(theme)));
    let step = 6.0;
    let mut pieces = Vec::new();
    // The pattern is aligned to the sheet, not to the rectangle, so neighbours join.
    for rise in fill.hatches() {
        let reach = rise.abs() * rect.height;
        let first = ((rect.left - reach) / step).ceil() as i64;
        let last = ((rect.right() + reach) / step).floor() as i64;
        for n in first..=last {
            let foot = n as f64 * step;
            let head = foot + rise * rect.height;
            let ends = clipped(rect, (foot, rect.bottom()), (head, rect.top));
            pieces.extend(ends.map(Vec::from));
        }
    }
    if !pieces.is_empty() {
        // Colour of text or sheet, whichever contrasts more with the fill.
        let fill = fill.colour(theme).luminance();
        let [ink, sheet] = [theme.text(), theme.background()];
        let from = |colour: Colour| (colour.luminance() - fill).abs();
        let colour = if from(ink) < from(sheet) { sheet } else { ink };
        let stroke = Stroke::new(colour.with_opacity(0.55), 0.8, &[]);
        shapes.push(Shape::lines(pieces, stroke, None));
    }
}

/// The part of a rising line within the sides of a rectangle.
fn clipped(rect: Rect, a: (f64, f64), b: (f64, f64)) -> Option<[(f64, f64); 2]> {
    let at = |x: f64| (x, a.1 + (b.1 - a.1) * (x - a.0) / (b.0 - a.0));
    let clip = |end: (f64, f64)| match end.0 {
        x if x < rect.left => at(rect.left),
        x if x > rect.right() => at(rect.right()),
        _ => end,
    };
    let outside = a.0.max(b.0) <= rect.left || a.0.min(b.0) >= rect.right();
    (!outside).then(|| [a, b].map(clip))
}

const MIN_SMALL_MARKERS: usize = 120;

pub(super) fn marks(
    theme: Theme,
    series: usize,
    places: &[(f64, f64)],
    clip: Option<Rect>,
) -> Shape {
    // Circle, square, triangle, diamond, cross.
    let shape: Vec<(f64, f64)> = match series % 5 {
        0 => {
            let turns = (0..12).map(|n| (f64::from(n) / 12.0 * TAU).sin_cos());
            turns.map(|(x, y)| (3.0 * x, 3.0 * y)).collect()
        }
        1 => vec![(-2.7, -2.7), (2.7, -2.7), (2.7, 2.7), (-2.7, 2.7)],
        2 => vec![(0.0, -3.6), (3.4, 2.6), (-3.4, 2.6)],
        3 => vec![(0.0, -4.0), (4.0, 0.0), (0.0, 4.0), (-4.0, 0.0)],
        _ => {
            let arm = [(-1.0, -3.6), (1.0, -3.6), (1.0, -1.0)];
            let turned = |arm: &[(f64, f64); 3]| Some(arm.map(|(x, y)| (-y, x)));
            let arms = std::iter::successors(Some(arm), turned);
            arms.take(4).flatten().collect()
        }
    };
    // Many markers overlap; smaller ones without an edge do not hide each other.
    let many = places.len() > MIN_SMALL_MARKERS;
    let size = if many { 0.55 } else { 1.0 };
    let piece = |(x, y): &(f64, f64)| {
        let moved = shape.iter().map(|(a, b)| (x + size * a, y + size * b));
        moved.collect()
    };
    let pieces = places.iter().map(piece).collect();
    let edge = (!many).then(|| Stroke::new(theme.background(), 0.6, &[]));
    Shape::areas(pieces, Some(theme.series(series)), edge, clip)
}
