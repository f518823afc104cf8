//! The legend of a panel.

use super::axes::Pixels;
use super::item::Item;
use super::style::{frame, label, marks, series_stroke, swatch};
use super::{LINE, Panel, SMALL_TEXT_SIZE};
use crate::picture::axis::Axis;
use crate::picture::font;
use crate::picture::shape::{Anchor, Rect, Shape};
use crate::picture::theme::Fill;

#[derive(Clone, Debug, PartialEq)]
pub(super) enum Key {
    Line(usize),
    Marker(usize),
    Area(usize),
    Strip,
    Fill(Fill),
    /// A fill of a map, without hatches.
    Plain(Fill),
    Ink,
}

impl Panel {
    fn shows(&self, key: &Key) -> bool {
        let within =
            |axis: &Axis, low: f64, high: f64| axis.part(high) > 0.0 && axis.part(low) < 1.0;
        let finite =
            |points: &[(f64, f64)]| points.iter().any(|(x, y)| x.is_finite() && y.is_finite());
        self.items.iter().any(|item| match (key, item) {
            (Key::Line(requested), Item::Line(series, points))
            | (Key::Marker(requested), Item::Markers(series, points)) => {
                series == requested && finite(points)
            }
            (Key::Area(requested), Item::Between(series, points)) => {
                // A sum is finite only if both terms are.
                series == requested && points.iter().any(|(_, low, high)| (low + high).is_finite())
            }
            (Key::Ink, Item::Density(points)) => finite(points),
            (Key::Ink, Item::Columns(columns)) => columns.iter().flatten().any(|count| *count > 0),
            (Key::Strip, Item::Strip(low, high)) => within(&self.x, *low, *high),
            (Key::Strip, Item::Shelf(low, high)) => within(&self.y, *low, *high),
            (Key::Plain(fill), Item::Classes(grid)) => grid.values.contains(fill),
            _ => false,
        }) || matches!(key, Key::Fill(fill) if self.ribbon.iter().any(|stretch| stretch.2 == *fill))
    }

    /// Number of points beyond the ends of an axis, which are not drawn.
    fn left_out(&self) -> usize {
        let outside = |axis: &Axis, value: f64| !(-1e-9..=1.0 + 1e-9).contains(&axis.part(value));
        let is_lost = |(x, y): &&(f64, f64)| {
            x.is_finite() && y.is_finite() && (outside(&self.x, *x) || outside(&self.y, *y))
        };
        let count_lost = |item: &Item| match item {
            Item::Markers(_, points) | Item::Density(points) => {
                points.iter().filter(is_lost).count()
            }
            _ => 0,
        };
        self.items.iter().map(count_lost).sum()
    }
}

impl Pixels<'_> {
    /// Draws the legend above the plot; returns its lower end.
    pub(super) fn draw_legend(&mut self) -> f64 {
        let (panel, plot, theme) = (self.panel, self.plot, self.theme);
        let displayed = panel.legend.iter().filter(|(key, _)| panel.shows(key));
        let displayed: Vec<&(Key, String)> = displayed.collect();
        let left_out = panel.left_out();
        let (mut x, mut y) = (plot.left, plot.top + 6.0);
        for (key, name) in &displayed {
            let size = font::fit_size(name, SMALL_TEXT_SIZE, false, plot.width - 32.0);
            let length = 26.0 + 6.0 + font::width(name, size, false) + 18.0;
            if x > plot.left && x + length - 18.0 > plot.right() {
                (x, y) = (plot.left, y + LINE);
            }
            let box_ = Rect::new(x, y - 5.5, 26.0, 11.0);
            match key {
                Key::Line(series) => {
                    let stroke = series_stroke(theme, *series, 2.0);
                    self.lines(vec![vec![(x, y), (x + 26.0, y)]], stroke);
                }
                Key::Marker(series) => self.push(marks(theme, *series, &[(x + 13.0, y)], None)),
                Key::Area(series) => {
                    let colour = theme.series(*series);
                    self.push(frame(box_, Some(colour.with_opacity(0.45)), colour, 0.8));
                }
                Key::Strip => self.push(frame(box_, Some(theme.strip()), theme.muted(), 0.8)),
                Key::Fill(fill) => {
                    swatch(theme, *fill, box_, self.shapes);
                    self.push(frame(box_, None, theme.muted(), 0.8));
                }
                Key::Plain(fill) => {
                    self.push(frame(box_, Some(fill.colour(theme)), theme.muted(), 0.8))
                }
                Key::Ink => {
                    for n in (0..13).map(f64::from) {
                        let cell = Rect::new(x + 2.0 * n, box_.top, 2.0, box_.height);
                        self.push(Shape::area(cell, theme.ink(n / 12.0)));
                    }
                }
            }
            let text = label((x + 32.0, y + 4.2), name, Anchor::Start, theme.text());
            self.push(Shape::Text(text.sized(size, false)));
            x += length;
        }
        if left_out > 0 {
            let text = match left_out {
                1 => "1 point beyond the scale".into(),
                n => format!("{n} points beyond the scale"),
            };
            if x > plot.left && x + font::width(&text, SMALL_TEXT_SIZE, false) > plot.right() {
                (x, y) = (plot.left, y + LINE);
            }
            self.text((x, y + 4.2), &text, Anchor::Start, theme.muted());
        }
        let is_empty = displayed.is_empty() && left_out == 0;
        if is_empty { plot.top } else { y + LINE - 4.0 }
    }
}
