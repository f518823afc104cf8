//! Maps of values and densities of points, as rasters.

use std::collections::HashSet;

use super::axes::Pixels;
use super::style::{frame_of, label, vertical_text};
use crate::picture::axis::Axis;
use crate::picture::shape::{Anchor, Raster, Rect, Shape};
use crate::picture::theme::{Colour, Theme};

/// A rectangular grid of values, first row at the low end of the vertical axis.
#[derive(Clone, Debug, PartialEq)]
pub struct Grid<T> {
    columns: usize,
    pub(super) values: Vec<T>,
}

impl<T> Grid<T> {
    /// A grid of rows of `columns` values; an incomplete last row is dropped.
    pub fn new(columns: usize, mut values: Vec<T>) -> Self {
        let columns = columns.max(1);
        values.truncate(values.len() / columns * columns);
        Self { columns, values }
    }
}

/// Number of points in each cell of a raster.
struct Counts {
    columns: usize,
    rows: usize,
    counts: Vec<u32>,
}

impl Counts {
    fn new(columns: usize, rows: usize) -> Self {
        let (columns, rows) = (columns.max(1), rows.max(1));
        let counts = vec![0; columns * rows];
        Self {
            columns,
            rows,
            counts,
        }
    }

    fn raster(self, theme: Theme) -> Raster {
        let max_count = f64::from(self.counts.iter().copied().max().unwrap_or(0).max(2));
        let levels = 32;
        let mut palette = vec![theme.background().with_opacity(0.0)];
        palette.extend((0..levels).map(|n| theme.ink(f64::from(n) / f64::from(levels - 1))));
        let pixels = self.counts.into_iter().map(|count| match count {
            0 => 0,
            _ => {
                let part = f64::from(count).ln() / max_count.ln();
                1 + (part * f64::from(levels - 1)).round() as u8
            }
        });
        Raster {
            width: self.columns,
            height: self.rows,
            palette,
            pixels: pixels.collect(),
        }
    }
}

impl Pixels<'_> {
    pub(super) fn density(&self, theme: Theme, points: &[(f64, f64)]) -> Raster {
        // Single points must be visible. With few points the cells are wider than a pixel, unless
        // many points are close together.
        let cells = if points.len() > 40_000 {
            1.5
        } else if self.is_dense(points) {
            1.0
        } else {
            0.5
        };
        let [columns, rows] =
            [self.plot.width, self.plot.height].map(|size| (cells * size) as usize);
        let mut counts = Counts::new(columns, rows);
        for (x, y) in points {
            let across = self.panel.x.part(*x);
            if (-1e-9..=1.0 + 1e-9).contains(&across) {
                let column = (across * counts.columns as f64).floor().max(0.0);
                if let Some(row) = self.panel.y.cell(*y, rows) {
                    let column = (column as usize).min(columns - 1);
                    counts.counts[row * columns + column] += 1;
                }
            }
        }
        counts.raster(theme)
    }

    pub(super) fn columns(theme: Theme, columns: &[Vec<u32>]) -> Raster {
        let rows = columns.first().map_or(0, Vec::len);
        let mut counts = Counts::new(columns.len(), rows);
        for (column, cells) in columns.iter().enumerate() {
            for (row, count) in cells.iter().enumerate() {
                counts.counts[row * columns.len() + column] = *count;
            }
        }
        counts.raster(theme)
    }

    /// Whether the occupied squares of two pixels have many points each.
    fn is_dense(&self, points: &[(f64, f64)]) -> bool {
        let square = |(x, y): &(f64, f64)| {
            let place = (0.5 * self.x_pixel(*x), 0.5 * self.y_pixel(*y));
            (place.0 as i64, place.1 as i64)
        };
        let squares: HashSet<(i64, i64)> = points.iter().map(square).collect();
        points.len() > 12 * squares.len()
    }

    pub(super) fn heat(
        &self,
        theme: Theme,
        grid: &Grid<f64>,
        scale: &Axis,
        shapes: &mut Vec<Shape>,
    ) {
        let plot = self.plot;
        let colours = (0..255).map(|n| theme.scale(f64::from(n) / 254.0));
        let mut palette: Vec<Colour> = colours.chain([theme.grid()]).collect();
        let number = |value: &f64| match scale.part(*value) {
            part if part.is_finite() => (part.clamp(0.0, 1.0) * 254.0).round() as u8,
            _ => 255,
        };
        shapes.push(Shape::Image(plot, raster(grid, palette.clone(), number)));
        let bar = Rect {
            left: plot.right() + 14.0,
            width: 14.0,
            ..plot
        };
        palette.truncate(255);
        let colours = Raster {
            width: 1,
            height: 255,
            palette,
            pixels: (0..255).rev().collect(),
        };
        shapes.push(Shape::Image(bar, colours));
        shapes.push(frame_of(bar, theme.axis(), 1.0));
        for (value, text) in scale.ticks((plot.height / 42.0) as usize) {
            let down = bar.bottom() - scale.part(value) * bar.height;
            let at = (bar.right() + 5.0, down + 4.2);
            shapes.push(Shape::Text(label(at, &text, Anchor::Start, theme.text())));
        }
        let at = (bar.right() + 58.0, plot.top + 0.5 * plot.height);
        shapes.push(vertical_text(at, &scale.title(), theme.text(), plot.height));
    }
}

pub(super) fn raster<T>(grid: &Grid<T>, palette: Vec<Colour>, number: impl Fn(&T) -> u8) -> Raster {
    let pixels = grid.values.chunks(grid.columns);
    let pixels = pixels.rev().flatten().map(number).collect();
    Raster {
        width: grid.columns,
        height: grid.values.len() / grid.columns,
        palette,
        pixels,
    }
}
