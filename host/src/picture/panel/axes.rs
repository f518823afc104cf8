//! Axes, grid, text above the plot and the ribbon.

use super::style::{dashed, frame_of, label, swatch, vertical_text};
use super::{LEFT, LINE, Panel, RIBBON, SMALL_TEXT_SIZE};
use crate::picture::font;
use crate::picture::shape::{Anchor, Rect, Shape, Stroke, Text};
use crate::picture::theme::Theme;

/// A panel at its position on the sheet.
pub(super) struct Pixels<'a> {
    pub(super) panel: &'a Panel,
    pub(super) plot: Rect,
}

impl Pixels<'_> {
    pub(super) fn x_pixel(&self, x: f64) -> f64 {
        self.plot.left + self.panel.x.part(x) * self.plot.width
    }

    pub(super) fn y_pixel(&self, y: f64) -> f64 {
        self.plot.bottom() - self.panel.y.part(y) * self.plot.height
    }

    pub(super) fn within_x(&self, x: f64) -> bool {
        (-1e-9..=1.0 + 1e-9).contains(&self.panel.x.part(x))
    }

    /// Draws the text of the marks in as many rows as needed; returns the lower end of the rows.
    pub(super) fn draw_marks(&self, theme: Theme, shapes: &mut Vec<Shape>) -> f64 {
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
            let label = label((start, y), text, Anchor::Start, theme.muted());
            shapes.push(Shape::Text(label));
        }
        self.plot.top + 12.0 + LINE * (rows - 1) as f64 * 0.88 + 6.0
    }

    pub(super) fn draw_ribbon(&self, theme: Theme, shapes: &mut Vec<Shape>) {
        for (from, to, tone) in &self.panel.ribbon {
            let left = self.x_pixel(*from).max(self.plot.left);
            let right = self.x_pixel(*to).min(self.plot.right());
            if right > left {
                let place = Rect::new(left, self.plot.top, right - left, RIBBON);
                swatch(theme, *tone, place, false, shapes);
            }
        }
        let frame = Rect {
            height: RIBBON,
            ..self.plot
        };
        shapes.push(frame_of(frame, theme.axis(), 1.0));
    }

    pub(super) fn draw_grid(&self, theme: Theme, shapes: &mut Vec<Shape>) {
        if self.panel.is_covered() {
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
        let stroke = Stroke::solid(theme.grid(), 1.0);
        shapes.push(Shape::lines(pieces, stroke, None));
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
    pub(super) fn draw_levels(&self, theme: Theme, shapes: &mut Vec<Shape>) {
        let plot = self.plot;
        for (n, (y, text)) in self.panel.levels.iter().enumerate() {
            let down = self.y_pixel(*y);
            if !(plot.top..=plot.bottom()).contains(&down) {
                continue;
            }
            let ends = vec![(plot.left, down), (plot.right(), down)];
            shapes.push(Shape::lines(vec![ends], dashed(theme), None));
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
            shapes.push(Shape::area(patch, theme.background().with_opacity(0.8)));
            let label = label((left, y), text, Anchor::Start, theme.text());
            shapes.push(Shape::Text(label));
        }
    }

    pub(super) fn draw_axes(&self, theme: Theme, shapes: &mut Vec<Shape>) {
        let plot = self.plot;
        shapes.push(frame_of(plot, theme.axis(), 1.0));
        let mut ticks = Vec::new();
        for (x, text) in self.x_ticks() {
            let across = self.x_pixel(x);
            ticks.push(vec![(across, plot.bottom()), (across, plot.bottom() + 5.0)]);
            let at = (across, plot.bottom() + 18.0);
            shapes.push(Shape::Text(label(at, &text, Anchor::Middle, theme.text())));
        }
        for (y, text) in self.y_ticks() {
            let down = self.y_pixel(y);
            ticks.push(vec![(plot.left - 5.0, down), (plot.left, down)]);
            let at = (plot.left - 8.0, down + 4.2);
            shapes.push(Shape::Text(label(at, &text, Anchor::End, theme.text())));
        }
        for x in self.panel.x.small_ticks() {
            let across = self.x_pixel(x);
            ticks.push(vec![(across, plot.bottom()), (across, plot.bottom() + 3.0)]);
        }
        for y in self.panel.y.small_ticks() {
            let down = self.y_pixel(y);
            ticks.push(vec![(plot.left - 3.0, down), (plot.left, down)]);
        }
        let stroke = Stroke::solid(theme.axis(), 1.0);
        shapes.push(Shape::lines(ticks, stroke, None));
        let across = self.panel.x.title();
        let at = (plot.left + 0.5 * plot.width, plot.bottom() + 37.0);
        shapes.push(Shape::Text(Text {
            size: font::fit_size(&across, 13.0, false, plot.width + 0.5 * LEFT),
            ..label(at, &across, Anchor::Middle, theme.text())
        }));
        let at = (plot.left - LEFT + 16.0, plot.top + 0.5 * plot.height);
        let up = self.panel.y.title();
        shapes.push(vertical_text(at, &up, theme.text(), plot.height));
    }
}
