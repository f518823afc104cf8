//! Items between the axes.

use std::collections::BTreeSet;

use super::axes::Pixels;
use super::map::{Grid, raster};
use super::style::{marks, series_stroke};
use crate::picture::axis::Axis;
use crate::picture::shape::{Rect, Shape, Stroke};
use crate::picture::theme::{Fill, Theme};

#[derive(Clone, Debug, PartialEq)]
pub(super) enum Item {
    /// Series and points.
    Line(usize, Vec<(f64, f64)>),
    Markers(usize, Vec<(f64, f64)>),
    Between(usize, Vec<(f64, f64, f64)>),
    Density(Vec<(f64, f64)>),
    /// Numbers of points in the cells of evenly spaced columns, from the top.
    Columns(Vec<Vec<u32>>),
    Heat(Grid<f64>, Axis),
    Classes(Grid<Fill>),
    /// A strip of the horizontal axis, or of the vertical one.
    Strip {
        low: f64,
        high: f64,
        of_y: bool,
    },
}

impl Pixels<'_> {
    pub(super) fn draw_item(&self, theme: Theme, item: &Item, shapes: &mut Vec<Shape>) {
        let plot = self.plot;
        match item {
            Item::Line(series, points) => {
                let stroke = series_stroke(theme, *series, 1.8);
                shapes.push(Shape::lines(self.pieces(points), stroke, Some(plot)));
            }
            Item::Markers(series, points) => {
                // A marker on the frame is drawn completely.
                let clip = Rect {
                    left: plot.left - 4.0,
                    top: plot.top - 4.0,
                    width: plot.width + 8.0,
                    height: plot.height + 8.0,
                };
                // NaN is outside.
                let within = |(x, y): &(f64, f64)| {
                    (plot.left - 0.1..=plot.right() + 0.1).contains(x)
                        && (plot.top - 0.1..=plot.bottom() + 0.1).contains(y)
                };
                let place = |(x, y): &(f64, f64)| (self.x_pixel(*x), self.y_pixel(*y));
                let places: Vec<_> = points.iter().map(place).filter(within).collect();
                shapes.push(marks(theme, *series, &places, Some(clip)));
            }
            Item::Between(series, points) => {
                let colour = theme.series(*series);
                let side = |pick: fn(&(f64, f64, f64)) -> (f64, f64)| {
                    self.pieces(&points.iter().map(pick).collect::<Vec<_>>())
                };
                let low = side(|(x, low, _)| (*x, *low)).into_iter();
                let high = side(|(x, _, high)| (*x, *high)).into_iter();
                let outline = |(low, high): (Vec<_>, Vec<_>)| {
                    low.into_iter().chain(high.into_iter().rev()).collect()
                };
                let pieces = low.zip(high).map(outline).collect();
                let (fill, edge) = (colour.with_opacity(0.3), Stroke::solid(colour, 0.8));
                shapes.push(Shape::areas(pieces, Some(fill), Some(edge), Some(plot)));
            }
            Item::Density(points) => {
                shapes.push(Shape::Image(plot, self.density(theme, points)));
            }
            Item::Columns(columns) => {
                shapes.push(Shape::Image(plot, Self::columns(theme, columns)));
            }
            Item::Heat(grid, scale) => self.heat(theme, grid, scale, shapes),
            Item::Classes(grid) => {
                let palette = Fill::ALL.iter().map(|fill| fill.colour(theme)).collect();
                let raster = raster(grid, palette, |fill| *fill as u8);
                shapes.push(Shape::Image(plot, raster));
            }
            Item::Strip { low, high, of_y } => {
                let mut rect = plot;
                if *of_y {
                    rect.top = self.y_pixel(*high).clamp(plot.top, plot.bottom());
                    rect.height = self.y_pixel(*low).clamp(plot.top, plot.bottom()) - rect.top;
                } else {
                    rect.left = self.x_pixel(*low).clamp(plot.left, plot.right());
                    rect.width = self.x_pixel(*high).clamp(plot.left, plot.right()) - rect.left;
                }
                if rect.width > 0.0 && rect.height > 0.0 {
                    shapes.push(Shape::area(rect, theme.strip()));
                }
            }
        }
    }

    /// The line in pieces of finite points. Within half a pixel of width only the first, lowest,
    /// highest and last point remain, which looks the same.
    fn pieces(&self, points: &[(f64, f64)]) -> Vec<Vec<(f64, f64)>> {
        let mut pieces: Vec<Vec<(f64, f64)>> = Vec::new();
        let mut piece: Vec<(f64, f64)> = Vec::new();
        let mut bucket: Vec<(f64, f64)> = Vec::new();
        let flush = |bucket: &mut Vec<(f64, f64)>, piece: &mut Vec<(f64, f64)>| {
            if bucket.len() <= 4 {
                piece.append(bucket);
                return;
            }
            let by_height = |a: &usize, b: &usize| bucket[*a].1.total_cmp(&bucket[*b].1);
            let last = bucket.len() - 1;
            let lowest = (0..=last).min_by(by_height).unwrap_or(0);
            let highest = (0..=last).max_by(by_height).unwrap_or(0);
            let extremes = BTreeSet::from([0, lowest, highest, last]);
            piece.extend(extremes.into_iter().map(|place| bucket[place]));
            bucket.clear();
        };
        for (x, y) in points {
            let place = (self.x_pixel(*x), self.y_pixel(*y));
            if !place.0.is_finite() || !place.1.is_finite() {
                flush(&mut bucket, &mut piece);
                if piece.len() > 1 {
                    pieces.push(std::mem::take(&mut piece));
                }
                piece.clear();
                continue;
            }
            // Limits coordinates far outside the panel, to keep huge numbers out of the file.
            let place = (
                place.0.clamp(self.plot.left - 2e3, self.plot.right() + 2e3),
                place.1.clamp(self.plot.top - 2e3, self.plot.bottom() + 2e3),
            );
            let first = bucket.first();
            if first.is_some_and(|first| (first.0 - place.0).abs() > 0.5) {
                flush(&mut bucket, &mut piece);
            }
            bucket.push(place);
        }
        flush(&mut bucket, &mut piece);
        if piece.len() > 1 {
            pieces.push(piece);
        }
        pieces
    }
}
