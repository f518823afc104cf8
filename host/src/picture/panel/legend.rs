//! The legend of a panel.

use super::style::{framed, marks, swatch, text};
use super::{LINE, Panel, SMALL};
use crate::picture::font;
use crate::picture::shape::{Anchor, Rect, Shape, Stroke};
use crate::picture::theme::{Fill, Theme};

#[derive(Clone, Debug, PartialEq)]
pub(super) enum Key {
    Line(usize),
    Marker(usize),
    Area(usize),
    Strip,
    Fill(Fill),
    /// A fill of a map, where hatches do not show.
    Plain(Fill),
    Ink,
}

impl Panel {
    pub(super) fn draw_legend(&self, theme: Theme, plot: &Rect, shapes: &mut Vec<Shape>) -> f64 {
        let (mut x, mut y) = (plot.left, plot.top + 6.0);
        for (key, name) in &self.legend {
            let length = 26.0 + 6.0 + font::width(name, SMALL, false) + 18.0;
            if x > plot.left && x + length - 18.0 > plot.right() {
                (x, y) = (plot.left, y + LINE);
            }
            let box_ = Rect {
                left: x,
                top: y - 5.5,
                width: 26.0,
                height: 11.0,
            };
            match key {
                Key::Line(series) => {
                    let (colour, dash, _) = theme.series(*series);
                    let stroke = Stroke {
                        colour,
                        width: 2.0,
                        dash,
                    };
                    shapes.push(Shape::line(vec![(x, y), (x + 26.0, y)], stroke));
                }
                Key::Marker(series) => shapes.push(marks(theme, *series, &[(x + 13.0, y)], None)),
                Key::Area(series) => {
                    let (colour, ..) = theme.series(*series);
                    shapes.push(framed(box_, colour.faint(0.45), colour));
                }
                Key::Strip => shapes.push(framed(box_, theme.strip(), theme.muted())),
                Key::Fill(fill) => swatch(theme, *fill, box_, true, shapes),
                Key::Plain(fill) => {
                    shapes.push(framed(box_, fill.colour(theme), theme.muted()));
                }
                Key::Ink => {
                    for n in 0..13 {
                        let cell = Rect {
                            left: x + 2.0 * f64::from(n),
                            width: 2.0,
                            ..box_
                        };
                        shapes.push(Shape::area(cell, theme.ink(f64::from(n) / 12.0)));
                    }
                }
            }
            shapes.push(Shape::Text(text(
                x + 32.0,
                y + 4.2,
                name,
                Anchor::Start,
                theme.text(),
                SMALL,
            )));
            x += length;
        }
        if self.legend.is_empty() {
            plot.top
        } else {
            y + LINE - 4.0
        }
    }
}
