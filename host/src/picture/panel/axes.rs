//! Axes, grid, text above the plot and the ribbon.

use super::item::Item;
use super::style::{dashed, frame, label, swatch, vertical_text};
use super::{LEFT, LINE, Panel, RIBBON, SMALL_TEXT_SIZE};
use crate::picture::font;
use crate::picture::shape::{Anchor, Raster, Rect, Shape, Stroke};
use crate::picture::theme::{Colour, Theme};

/// A panel at its position on the sheet, and the shapes that draw it.
pub(super) struct Pixels<'a> {
    pub panel: &'a Panel,
    pub plot: Rect,
    pub theme: Theme,
    pub shapes: &'a mut Vec<Shape>,
}

impl Pixels<'_> {
    pub(super) fn x_pixel(&self, x: f64) -> f64 {
        self.plot.left + self.panel.x.part(x) * self.plot.width
    }

    pub(super) fn y_pixel(&self, y: f64) -> f64 {
        self.plot.bottom() - self.panel.y.part(y) * self.plot.height
    }

    pub(super) fn push(&mut self, shape: Shape) {
        self.shapes.push(shape);
    }

    pub(super) fn text(&mut self, at: (f64, f64), text: &str, anchor: Anchor, colour: Colour) {
        self.push(Shape::Text(label(at, text, anchor, colour)));
    }

    /// Draws a raster over the whole plot.
    pub(super) fn image(&mut self, raster: Raster) {
        self.push(Shape::Image(self.plot, raster));
    }

    pub(super) fn lines(&mut self, pieces: Vec<Vec<(f64, f64)>>, stroke: Stroke) {
        self.push(Shape::lines(pieces, stroke, None));
    }

    pub(super) fn within_x(&self, x: f64) -> bool {
        (-1e-9..=1.0 + 1e-9).contains(&self.panel.x.part(x))
    }

    /// Draws the text of the marks in as many rows as needed; returns the lower end of the rows.
    pub(super) fn draw_marks(&mut self) -> f64 {
        let marks = self.panel.marks.iter();
        let marks = marks.filter(|(x, text, _)| self.within_x(*x) && !text.is_empty());
        let mut marks: Vec<_> = marks.collect();
        if marks.is_empty() {
            return self.plot.top + 4.0;
        }
        marks.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut ends: Vec<f64> = Vec::new();
        let mut placed = Vec::new();
        for (x, text, _) in marks {
            let width = font::width(text, SMALL_TEXT_SIZE, false);
            // Only text wider than the panel extends beyond it, to the left.
            let last = (self.plot.right() - width).max(self.plot.left - 0.5 * LEFT);
            let first = self.plot.left.min(last);
            let start = (self.x_pixel(*x) - 0.5 * width).clamp(first, last);
            let free = ends.iter().position(|end| start > end + 8.0);
            let row = free.unwrap_or_else(|| {
                ends.push(f64::NEG_INFINITY);
                ends.len() - 1
            });
            ends[row] = start + width;
            placed.push((start, row, text));
        }
        let rows = ends.len();
        for (start, row, text) in placed {
            let y = self.plot.top + 12.0 + LINE * (rows - 1 - row) as f64 * 0.88;
            self.text((start, y), text, Anchor::Start, self.theme.muted());
        }
        self.plot.top + 12.0 + LINE * (rows - 1) as f64 * 0.88 + 6.0
    }

    pub(super) fn draw_ribbon(&mut self) {
        let plot = self.plot;
        for (from, to, tone) in &self.panel.ribbon {
            let left = self.x_pixel(*from).max(plot.left);
            let right = self.x_pixel(*to).min(plot.right());
            if right > left {
                let place = Rect::new(left, plot.top, right - left, RIBBON);
                swatch(self.theme, *tone, place, self.shapes);
            }
        }
        let ribbon = Rect::new(plot.left, plot.top, plot.width, RIBBON);
        self.push(frame(ribbon, None, self.theme.axis(), 1.0));
    }

    pub(super) fn draw_grid(&mut self) {
        let covers = |item: &Item| matches!(item, Item::Heat(..) | Item::Classes(_));
        if self.panel.items.iter().any(covers) {
            return;
        }
        let mut pieces = Vec::new();
        for (x, _) in self.x_ticks() {
            let across = self.x_pixel(x);
            pieces.push(vec![(across, self.plot.top), (across, self.plot.bottom())]);
        }
        for (y, _) in self.y_ticks() {
            let down = self.y_pixel(y);
            pieces.push(vec![(self.plot.left, down), (self.plot.right(), down)]);
        }
        self.lines(pieces, Stroke::new(self.theme.grid(), 1.0, &[]));
    }

    pub(super) fn x_ticks(&self) -> Vec<(f64, String)> {
        // A printed column has room for four labels.
        let fewest = if self.plot.width > 200.0 { 4 } else { 2 };
        let count = (self.plot.width / 90.0) as usize;
        self.panel.x.ticks(count.max(fewest))
    }

    pub(super) fn y_ticks(&self) -> Vec<(f64, String)> {
        let count = (self.plot.height / 42.0) as usize;
        self.panel.y.ticks(count.max(3))
    }

    /// Draws the dashed levels; their text has a patch of background, legible over anything.
    pub(super) fn draw_levels(&mut self) {
        let (plot, theme) = (self.plot, self.theme);
        for (n, (y, text)) in self.panel.levels.iter().enumerate() {
            let down = self.y_pixel(*y);
            if !(plot.top..=plot.bottom()).contains(&down) {
                continue;
            }
            let ends = vec![(plot.left, down), (plot.right(), down)];
            self.lines(vec![ends], dashed(theme));
            if text.is_empty() {
                continue;
            }
            let width = font::width(text, SMALL_TEXT_SIZE, false);
            let left = if n.is_multiple_of(2) {
                plot.right() - 10.0 - width
            } else {
                plot.left + 10.0
            };
            let fits_above = down - plot.top > LINE;
            let y = if fits_above { down - 4.0 } else { down + 14.0 };
            let patch = Rect::new(left - 2.0, y - 11.0, width + 4.0, 14.5);
            self.push(Shape::area(patch, theme.background().with_opacity(0.8)));
            self.text((left, y), text, Anchor::Start, theme.text());
        }
    }

    pub(super) fn draw_axes(&mut self) {
        let (plot, theme) = (self.plot, self.theme);
        self.push(frame(plot, None, theme.axis(), 1.0));
        let at_x = |across: f64, length: f64| {
            vec![(across, plot.bottom()), (across, plot.bottom() + length)]
        };
        let at_y = |down: f64, length: f64| vec![(plot.left - length, down), (plot.left, down)];
        let mut ticks = Vec::new();
        for (x, text) in self.x_ticks() {
            let across = self.x_pixel(x);
            ticks.push(at_x(across, 5.0));
            let at = (across, plot.bottom() + 18.0);
            self.text(at, &text, Anchor::Middle, theme.text());
        }
        for (y, text) in self.y_ticks() {
            let down = self.y_pixel(y);
            ticks.push(at_y(down, 5.0));
            let at = (plot.left - 8.0, down + 4.2);
            self.text(at, &text, Anchor::End, theme.text());
        }
        let small = self.panel.x.small_ticks().into_iter();
        ticks.extend(small.map(|x| at_x(self.x_pixel(x), 3.0)));
        let small = self.panel.y.small_ticks().into_iter();
        ticks.extend(small.map(|y| at_y(self.y_pixel(y), 3.0)));
        self.lines(ticks, Stroke::new(theme.axis(), 1.0, &[]));
        let across = self.panel.x.title();
        let at = (plot.left + 0.5 * plot.width, plot.bottom() + 37.0);
        let size = font::fit_size(&across, 13.0, false, plot.width + 0.5 * LEFT);
        let text = label(at, &across, Anchor::Middle, theme.text());
        self.push(Shape::Text(text.sized(size, false)));
        let at = (plot.left - LEFT + 16.0, plot.top + 0.5 * plot.height);
        let up = self.panel.y.title();
        self.push(vertical_text(at, &up, theme.text(), plot.height));
    }
}
