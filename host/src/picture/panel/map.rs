//! Maps of values and densities of points, as rasters.

use std::collections::HashSet;

use super::axes::Pixels;
use super::style::{frame, vertical_text};
use crate::picture::axis::Axis;
use crate::picture::shape::{Anchor, Raster, Rect, Shape};
use crate::picture::theme::{Colour, Theme};
use crate::report::when;

/// A rectangular grid of values, first row at the low end of the vertical axis.
#[derive(Clone, Debug, PartialEq)]
pub struct Grid<T> {
    columns: usize,
    pub(super) values: Vec<T>,
}

impl<T> Grid<T> {
    /// A grid of rows of `columns` values.
    pub fn new(columns: usize, values: Vec<T>) -> Self {
        let columns = columns.max(1);
        Self { columns, values }
    }
}

/// Raster of the numbers of points in cells, row by row.
fn shaded(theme: Theme, columns: usize, counts: &[u32]) -> Raster {
    const LEVELS: u8 = 32;
    let max_count = f64::from(counts.iter().copied().max().unwrap_or(0).max(2));
    let mut palette = vec![theme.background().with_opacity(0.0)];
    palette.extend((0..LEVELS).map(|n| theme.ink(f64::from(n) / f64::from(LEVELS - 1))));
    let pixel = |count: &u32| {
        let part = f64::from(*count).ln() / max_count.ln();
        let level = (part * f64::from(LEVELS - 1)).round() as u8;
        when(*count > 0, || 1 + level)
    };
    Raster::new(columns, palette, counts.iter().map(pixel).collect())
}

impl Pixels<'_> {
    pub(super) fn density(&self, points: &[(f64, f64)]) -> Raster {
        // Single points must be visible. With few points the cells are wider than a pixel, unless
        // many points are close together.
        let cells = if points.len() > 40_000 {
            1.5
        } else if self.is_dense(points) {
            1.0
        } else {
            0.5
        };
        let size = [self.plot.width, self.plot.height];
        let [columns, rows] = size.map(|size| ((cells * size) as usize).max(1));
        let mut counts = vec![0; columns * rows];
        for (x, y) in points {
            let across = self.panel.x.part(*x);
            if (-1e-9..=1.0 + 1e-9).contains(&across) {
                let column = ((across * columns as f64) as usize).min(columns - 1);
                if let Some(row) = self.panel.y.cell(*y, rows) {
                    counts[row * columns + column] += 1;
                }
            }
        }
        shaded(self.theme, columns, &counts)
    }

    pub(super) fn columns(&self, columns: &[Vec<u32>]) -> Raster {
        let rows = columns.first().map_or(0, Vec::len);
        let row = |n: usize| columns.iter().map(move |cells| cells[n]);
        let counts: Vec<u32> = (0..rows).flat_map(row).collect();
        shaded(self.theme, columns.len().max(1), &counts)
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

    pub(super) fn heat(&mut self, grid: &Grid<f64>, scale: &Axis) {
        let (plot, theme) = (self.plot, self.theme);
        let colours = (0..255).map(|n| theme.scale(f64::from(n) / 254.0));
        let mut palette: Vec<Colour> = colours.chain([theme.grid()]).collect();
        let number = |value: &f64| match scale.part(*value) {
            part if part.is_finite() => (part.clamp(0.0, 1.0) * 254.0).round() as u8,
            _ => 255,
        };
        self.image(raster(grid, palette.clone(), number));
        let bar = Rect::new(plot.right() + 14.0, plot.top, 14.0, plot.height);
        palette.truncate(255);
        let colours = Raster::new(1, palette, (0..255).rev().collect());
        self.push(Shape::Image(bar, colours));
        self.push(frame(bar, None, theme.axis(), 1.0));
        for (value, text) in scale.ticks((plot.height / 42.0) as usize) {
            let down = bar.bottom() - scale.part(value) * bar.height;
            let at = (bar.right() + 5.0, down + 4.2);
            self.text(at, &text, Anchor::Start, theme.text());
        }
        let at = (bar.right() + 58.0, plot.top + 0.5 * plot.height);
        self.push(vertical_text(at, &scale.title(), theme.text(), plot.height));
    }
}

pub(super) fn raster<T>(grid: &Grid<T>, palette: Vec<Colour>, number: impl Fn(&T) -> u8) -> Raster {
    let pixels = grid.values.chunks(grid.columns);
    let pixels = pixels.rev().flatten().map(number).collect();
    Raster::new(grid.columns, palette, pixels)
}
