//! Items between the axes.

use std::collections::BTreeSet;

use super::axes::Pixels;
use super::map::{Grid, raster};
use super::style::{marks, series_stroke};
use crate::picture::axis::Axis;
use crate::picture::shape::{Rect, Shape, Stroke};
use crate::picture::theme::Fill;

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
    /// Low and high end of a strip of the horizontal axis.
    Strip(f64, f64),
    /// The same of the vertical axis.
    Shelf(f64, f64),
}

impl Pixels<'_> {
    pub(super) fn draw_item(&mut self, item: &Item) {
        let (plot, theme) = (self.plot, self.theme);
        match item {
            Item::Line(series, points) => {
                let stroke = series_stroke(theme, *series, 1.8);
                self.push(Shape::lines(self.pieces(points), stroke, Some(plot)));
            }
            Item::Markers(series, points) => {
                // A marker on the frame is drawn completely.
                let (left, top) = (plot.left - 4.0, plot.top - 4.0);
                let clip = Rect::new(left, top, plot.width + 8.0, plot.height + 8.0);
                // NaN is outside.
                let within = |(x, y): &(f64, f64)| {
                    (plot.left - 0.1..=plot.right() + 0.1).contains(x)
                        && (plot.top - 0.1..=plot.bottom() + 0.1).contains(y)
                };
                let place = |(x, y): &(f64, f64)| (self.x_pixel(*x), self.y_pixel(*y));
                let places: Vec<_> = points.iter().map(place).filter(within).collect();
                self.push(marks(theme, *series, &places, Some(clip)));
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
                let (fill, edge) = (colour.with_opacity(0.3), Stroke::new(colour, 0.8, &[]));
                self.push(Shape::areas(pieces, Some(fill), Some(edge), Some(plot)));
            }
            Item::Density(points) => self.image(self.density(points)),
            Item::Columns(columns) => self.image(self.columns(columns)),
            Item::Heat(grid, scale) => self.heat(grid, scale),
            Item::Classes(grid) => {
                let palette = Fill::ALL.iter().map(|fill| fill.colour(theme)).collect();
                self.image(raster(grid, palette, |fill| *fill as u8));
            }
            Item::Strip(low, high) => {
                let [left, right] =
                    [low, high].map(|x| self.x_pixel(*x).clamp(plot.left, plot.right()));
                self.shade(Rect::new(left, plot.top, right - left, plot.height));
            }
            Item::Shelf(low, high) => {
                let [bottom, top] =
                    [low, high].map(|y| self.y_pixel(*y).clamp(plot.top, plot.bottom()));
                self.shade(Rect::new(plot.left, top, plot.width, bottom - top));
            }
        }
    }

    fn shade(&mut self, strip: Rect) {
        if strip.width > 0.0 && strip.height > 0.0 {
            self.push(Shape::area(strip, self.theme.strip()));
        }
    }

    /// The line in pieces of finite points, of at least two each.
    fn pieces(&self, points: &[(f64, f64)]) -> Vec<Vec<(f64, f64)>> {
        let place = |(x, y): &(f64, f64)| (self.x_pixel(*x), self.y_pixel(*y));
        let places: Vec<(f64, f64)> = points.iter().map(place).collect();
        let pieces = places.split(|(x, y)| !x.is_finite() || !y.is_finite());
        let pieces = pieces.map(|piece| self.thinned(piece));
        pieces.filter(|piece| piece.len() > 1).collect()
    }

    /// A piece of a line. Within half a pixel of width only the first, lowest, highest and last
    /// point remain, which looks the same.
    fn thinned(&self, places: &[(f64, f64)]) -> Vec<(f64, f64)> {
        // Limits coordinates far outside the panel, to keep huge numbers out of the file.
        let limited = |(x, y): &(f64, f64)| {
            let x = x.clamp(self.plot.left - 2e3, self.plot.right() + 2e3);
            (x, y.clamp(self.plot.top - 2e3, self.plot.bottom() + 2e3))
        };
        let places: Vec<(f64, f64)> = places.iter().map(limited).collect();
        let (mut piece, mut rest) = (Vec::new(), &places[..]);
        while let Some(first) = rest.first() {
            let is_far = |place: &(f64, f64)| (first.0 - place.0).abs() > 0.5;
            let next = rest.iter().position(is_far);
            let (bucket, more) = rest.split_at(next.unwrap_or(rest.len()));
            rest = more;
            let last = bucket.len() - 1;
            if last < 4 {
                piece.extend(bucket);
                continue;
            }
            let by_height = |a: &usize, b: &usize| bucket[*a].1.total_cmp(&bucket[*b].1);
            let lowest = (0..=last).min_by(by_height).unwrap_or(0);
            let highest = (0..=last).max_by(by_height).unwrap_or(0);
            let extremes = BTreeSet::from([0, lowest, highest, last]);
            piece.extend(extremes.into_iter().map(|place| bucket[place]));
        }
        piece
    }
}
