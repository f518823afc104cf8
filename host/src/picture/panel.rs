//! One panel of a picture: two axes and what is drawn between them.

use super::axis::Axis;
use super::font;
use super::shape::{Anchor, Raster, Rect, Shape, Stroke, Text};
use super::theme::{Colour, Hatch, Marker, Theme, Tone};

/// Size of small words in pixels.
pub(super) const SMALL: f64 = 12.0;
const LINE: f64 = 17.0;
/// Space for the labels of the vertical axis, to the left of the plot.
const LEFT: f64 = 74.0;
const RIGHT: f64 = 22.0;
/// Space for a colour bar, to the right of the plot.
const BAR: f64 = 92.0;
const RIBBON: f64 = 16.0;
/// More markers than this are drawn as a density, which neither clots nor bloats the file.
const MANY: usize = 2500;

/// A rectangular grid of values, first row at the low end of the vertical axis.
#[derive(Clone, Debug, PartialEq)]
pub struct Grid<T> {
    columns: usize,
    values: Vec<T>,
}

impl<T> Grid<T> {
    /// A grid of rows of `columns` values; an incomplete last row is dropped.
    #[must_use]
    pub fn new(columns: usize, mut values: Vec<T>) -> Self {
        let columns = columns.max(1);
        values.truncate(values.len() / columns * columns);
        Self { columns, values }
    }

    fn rows(&self) -> usize {
        self.values.len() / self.columns
    }
}

#[derive(Clone, Debug, PartialEq)]
enum Item {
    Line {
        series: usize,
        points: Vec<(f64, f64)>,
    },
    Markers {
        series: usize,
        points: Vec<(f64, f64)>,
    },
    Between {
        series: usize,
        points: Vec<(f64, f64, f64)>,
    },
    Bars {
        series: usize,
        bars: Vec<(f64, f64, f64)>,
    },
    Density {
        points: Vec<(f64, f64)>,
        /// Number of values of x that occur, evenly spaced over the axis; 0 where they are any.
        columns: usize,
    },
    Heat {
        grid: Grid<f64>,
        scale: Axis,
    },
    Classes(Grid<Tone>),
    Strip {
        low: f64,
        high: f64,
    },
    Shelf {
        low: f64,
        high: f64,
    },
    Note {
        x: f64,
        y: f64,
        words: String,
    },
}

#[derive(Clone, Debug, PartialEq)]
enum Key {
    Line(usize),
    Marker(usize),
    Area(usize),
    Strip,
    Tone(Tone),
    /// A tone of a map, where hatches do not show.
    Plain(Tone),
    Ink,
}

/// Two axes and what is drawn between them; given from the back to the front.
#[derive(Clone, Debug, PartialEq)]
pub struct Panel {
    heading: String,
    height: f64,
    x: Axis,
    y: Axis,
    items: Vec<Item>,
    legend: Vec<(Key, String)>,
    marks: Vec<(f64, String, bool)>,
    levels: Vec<(f64, String)>,
    ribbon: Vec<(f64, f64, Tone)>,
}

impl Panel {
    /// An empty panel between a horizontal and a vertical axis.
    #[must_use]
    pub fn new(x: Axis, y: Axis) -> Self {
        Self {
            heading: String::new(),
            height: 300.0,
            x,
            y,
            items: Vec::new(),
            legend: Vec::new(),
            marks: Vec::new(),
            levels: Vec::new(),
            ribbon: Vec::new(),
        }
    }

    /// Words above the panel.
    #[must_use]
    pub fn heading(mut self, words: impl Into<String>) -> Self {
        self.heading = words.into();
        self
    }

    /// Height between the axes in pixels (else 300).
    #[must_use]
    pub fn height(mut self, pixels: f64) -> Self {
        self.height = pixels.clamp(20.0, 4000.0);
        self
    }

    /// A line of the series' colour and dash; NaN breaks it. An empty name keeps it out of the legend.
    #[must_use]
    pub fn line(mut self, name: &str, series: usize, points: Vec<(f64, f64)>) -> Self {
        self.key(Key::Line(series), name);
        self.items.push(Item::Line { series, points });
        self
    }

    /// A marker at each point; thousands of them become a density.
    #[must_use]
    pub fn markers(mut self, name: &str, series: usize, points: Vec<(f64, f64)>) -> Self {
        if points.len() > MANY {
            return self.density(name, points);
        }
        self.key(Key::Marker(series), name);
        self.items.push(Item::Markers { series, points });
        self
    }

    /// The area between two lines, as (x, low, high).
    #[must_use]
    pub fn between(mut self, name: &str, series: usize, points: Vec<(f64, f64, f64)>) -> Self {
        self.key(Key::Area(series), name);
        self.items.push(Item::Between { series, points });
        self
    }

    /// Bars from the foot of the panel, as (low, high, height).
    #[must_use]
    pub fn bars(mut self, name: &str, series: usize, bars: Vec<(f64, f64, f64)>) -> Self {
        self.key(Key::Area(series), name);
        self.items.push(Item::Bars { series, bars });
        self
    }

    /// Any number of points, darker where there are more.
    #[must_use]
    pub fn density(mut self, name: &str, points: Vec<(f64, f64)>) -> Self {
        self.key(Key::Ink, name);
        let columns = 0;
        self.items.push(Item::Density { points, columns });
        self
    }

    /// A density of points that stand in `columns` evenly spaced columns, the first and last on the
    /// ends of the axis: each column is as wide as the next, so that no stripes appear.
    #[must_use]
    pub fn columns(mut self, name: &str, columns: usize, points: Vec<(f64, f64)>) -> Self {
        self.key(Key::Ink, name);
        self.items.push(Item::Density { points, columns });
        self
    }

    /// A map of values over the whole panel with a colour bar; NaN stays empty.
    #[must_use]
    pub fn heat(mut self, grid: Grid<f64>, scale: Axis) -> Self {
        self.items.push(Item::Heat { grid, scale });
        self
    }

    /// A map of tones over the whole panel; `names` go to the legend.
    #[must_use]
    pub fn classes(mut self, grid: Grid<Tone>, names: &[(Tone, &str)]) -> Self {
        for (tone, name) in names {
            self.key(Key::Plain(*tone), name);
        }
        self.items.push(Item::Classes(grid));
        self
    }

    /// A ribbon of tones above the plot, as (from, to, tone) along the horizontal axis.
    #[must_use]
    pub fn ribbon(mut self, stretches: Vec<(f64, f64, Tone)>, names: &[(Tone, &str)]) -> Self {
        for (tone, name) in names {
            self.key(Key::Tone(*tone), name);
        }
        self.ribbon = stretches;
        self
    }

    /// A shaded strip of the horizontal axis: a band of k.
    #[must_use]
    pub fn strip(mut self, name: &str, low: f64, high: f64) -> Self {
        self.key(Key::Strip, name);
        self.items.push(Item::Strip { low, high });
        self
    }

    /// A shaded strip of the vertical axis: a band of k where k is drawn upwards.
    #[must_use]
    pub fn shelf(mut self, name: &str, low: f64, high: f64) -> Self {
        self.key(Key::Strip, name);
        self.items.push(Item::Shelf { low, high });
        self
    }

    /// A dashed line up the panel at `x`, with words above it.
    #[must_use]
    pub fn mark(mut self, x: f64, words: impl Into<String>) -> Self {
        self.marks.push((x, words.into(), true));
        self
    }

    /// Words above the panel at `x`, without a line.
    #[must_use]
    pub fn caption(mut self, x: f64, words: impl Into<String>) -> Self {
        self.marks.push((x, words.into(), false));
        self
    }

    /// A dashed line across the panel at `y`, with words at its right end.
    #[must_use]
    pub fn level(mut self, y: f64, words: impl Into<String>) -> Self {
        self.levels.push((y, words.into()));
        self
    }

    /// Words at a point.
    #[must_use]
    pub fn note(mut self, x: f64, y: f64, words: impl Into<String>) -> Self {
        let words = words.into();
        self.items.push(Item::Note { x, y, words });
        self
    }

    fn key(&mut self, key: Key, name: &str) {
        let entry = (key, name.to_string());
        if !name.is_empty() && !self.legend.contains(&entry) {
            self.legend.push(entry);
        }
    }

    /// Draws the panel with its top at `top` into `shapes`; returns where it ends.
    pub(super) fn draw(
        &self,
        theme: Theme,
        left: f64,
        top: f64,
        width: f64,
        shapes: &mut Vec<Shape>,
    ) -> f64 {
        let bar = self
            .items
            .iter()
            .any(|item| matches!(item, Item::Heat { .. }));
        let mut plot = Rect {
            left: left + LEFT,
            top,
            width: width - LEFT - if bar { BAR } else { RIGHT },
            height: self.height,
        };
        if !self.heading.is_empty() {
            shapes.push(Shape::Text(Text {
                bold: true,
                ..text(
                    plot.left,
                    plot.top + 12.0,
                    &self.heading,
                    Anchor::Start,
                    theme.text(),
                    13.0,
                )
            }));
            plot.top += LINE + 4.0;
        }
        plot.top = self.draw_legend(theme, &plot, shapes);
        let pixel = Pixels { panel: self, plot };
        plot.top = pixel.draw_marks(theme, shapes);
        if !self.ribbon.is_empty() {
            let pixel = Pixels { panel: self, plot };
            pixel.draw_ribbon(theme, shapes);
            plot.top += RIBBON + 4.0;
        }
        let pixel = Pixels { panel: self, plot };
        pixel.draw_grid(theme, shapes);
        for item in &self.items {
            pixel.draw_item(theme, item, shapes);
        }
        for (x, words, line) in &self.marks {
            let across = pixel.across(*x);
            if *line && pixel.within_x(*x) {
                let foot = if words.is_empty() {
                    plot.top
                } else {
                    plot.top - 3.0
                };
                shapes.push(Shape::line(
                    vec![(across, foot), (across, plot.bottom())],
                    dashed(theme),
                ));
            }
        }
        for (y, words) in &self.levels {
            let down = pixel.down(*y);
            if (plot.top..=plot.bottom()).contains(&down) {
                shapes.push(Shape::line(
                    vec![(plot.left, down), (plot.right(), down)],
                    dashed(theme),
                ));
                pixel.halo(
                    theme,
                    plot.right() - 4.0,
                    down - 4.0,
                    words,
                    Anchor::End,
                    shapes,
                );
            }
        }
        pixel.draw_axes(theme, shapes);
        plot.bottom() + 46.0
    }

    fn draw_legend(&self, theme: Theme, plot: &Rect, shapes: &mut Vec<Shape>) -> f64 {
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
                Key::Tone(tone) => swatch(theme, *tone, box_, true, shapes),
                Key::Plain(tone) => {
                    shapes.push(framed(box_, tone.colour(theme), theme.muted()));
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

/// A panel at its place on the sheet.
struct Pixels<'a> {
    panel: &'a Panel,
    plot: Rect,
}

impl Pixels<'_> {
    fn across(&self, x: f64) -> f64 {
        self.plot.left + self.panel.x.part(x) * self.plot.width
    }

    fn down(&self, y: f64) -> f64 {
        self.plot.bottom() - self.panel.y.part(y) * self.plot.height
    }

    fn within_x(&self, x: f64) -> bool {
        (-1e-9..=1.0 + 1e-9).contains(&self.panel.x.part(x))
    }

    /// Words of the marks, in as many rows as they need side by side; returns where the rows end.
    fn draw_marks(&self, theme: Theme, shapes: &mut Vec<Shape>) -> f64 {
        let mut marks: Vec<&(f64, String, bool)> = self
            .panel
            .marks
            .iter()
            .filter(|(x, words, _)| self.within_x(*x) && !words.is_empty())
            .collect();
        if marks.is_empty() {
            return self.plot.top + 4.0;
        }
        marks.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut ends: Vec<f64> = Vec::new();
        let mut placed = Vec::new();
        for (x, words, _) in marks {
            let width = font::width(words, SMALL, false);
            let lowest = self.plot.left - 0.5 * LEFT;
            let highest = (self.plot.right() + 0.5 * RIGHT - width).max(lowest);
            let start = (self.across(*x) - 0.5 * width).clamp(lowest, highest);
            let free = ends.iter().position(|end| start > end + 8.0);
            let row = free.unwrap_or_else(|| {
                ends.push(f64::NEG_INFINITY);
                ends.len() - 1
            });
            ends[row] = start + width;
            placed.push((start, row, words));
        }
        let rows = ends.len();
        for (start, row, words) in placed {
            let y = self.plot.top + 12.0 + LINE * (rows - 1 - row) as f64 * 0.88;
            shapes.push(Shape::Text(text(
                start,
                y,
                words,
                Anchor::Start,
                theme.muted(),
                SMALL,
            )));
        }
        self.plot.top + 12.0 + LINE * (rows - 1) as f64 * 0.88 + 6.0
    }

    fn draw_ribbon(&self, theme: Theme, shapes: &mut Vec<Shape>) {
        for (from, to, tone) in &self.panel.ribbon {
            let (left, right) = (
                self.across(*from).max(self.plot.left),
                self.across(*to).min(self.plot.right()),
            );
            if right > left {
                let place = Rect {
                    left,
                    top: self.plot.top,
                    width: right - left,
                    height: RIBBON,
                };
                swatch(theme, *tone, place, false, shapes);
            }
        }
        let frame = Rect {
            height: RIBBON,
            ..self.plot
        };
        shapes.push(frame_of(frame, theme.axis(), 1.0));
    }

    fn draw_grid(&self, theme: Theme, shapes: &mut Vec<Shape>) {
        let covered = self
            .panel
            .items
            .iter()
            .any(|item| matches!(item, Item::Heat { .. } | Item::Classes(_)));
        if covered {
            return;
        }
        let stroke = Stroke {
            colour: theme.grid(),
            width: 1.0,
            dash: &[],
        };
        let mut pieces = Vec::new();
        for (x, _) in self.x_ticks() {
            pieces.push(vec![
                (self.across(x), self.plot.top),
                (self.across(x), self.plot.bottom()),
            ]);
        }
        for (y, _) in self.y_ticks() {
            pieces.push(vec![
                (self.plot.left, self.down(y)),
                (self.plot.right(), self.down(y)),
            ]);
        }
        shapes.push(Shape::Path {
            pieces,
            closed: false,
            fill: None,
            stroke: Some(stroke),
            clip: None,
        });
    }

    fn x_ticks(&self) -> Vec<(f64, String)> {
        self.panel.x.ticks((self.plot.width / 90.0) as usize)
    }

    fn y_ticks(&self) -> Vec<(f64, String)> {
        self.panel.y.ticks((self.plot.height / 42.0) as usize)
    }

    fn draw_axes(&self, theme: Theme, shapes: &mut Vec<Shape>) {
        let plot = self.plot;
        shapes.push(frame_of(plot, theme.axis(), 1.0));
        let mut ticks = Vec::new();
        for (x, label) in self.x_ticks() {
            let across = self.across(x);
            ticks.push(vec![(across, plot.bottom()), (across, plot.bottom() + 5.0)]);
            shapes.push(Shape::Text(text(
                across,
                plot.bottom() + 18.0,
                &label,
                Anchor::Middle,
                theme.text(),
                SMALL,
            )));
        }
        for (y, label) in self.y_ticks() {
            let down = self.down(y);
            ticks.push(vec![(plot.left - 5.0, down), (plot.left, down)]);
            shapes.push(Shape::Text(text(
                plot.left - 8.0,
                down + 4.2,
                &label,
                Anchor::End,
                theme.text(),
                SMALL,
            )));
        }
        shapes.push(Shape::Path {
            pieces: ticks,
            closed: false,
            fill: None,
            stroke: Some(Stroke {
                colour: theme.axis(),
                width: 1.0,
                dash: &[],
            }),
            clip: None,
        });
        shapes.push(Shape::Text(text(
            plot.left + 0.5 * plot.width,
            plot.bottom() + 37.0,
            &self.panel.x.title(),
            Anchor::Middle,
            theme.text(),
            13.0,
        )));
        shapes.push(Shape::Text(Text {
            upright: true,
            ..text(
                plot.left - LEFT + 16.0,
                plot.top + 0.5 * plot.height,
                &self.panel.y.title(),
                Anchor::Middle,
                theme.text(),
                13.0,
            )
        }));
    }

    fn draw_item(&self, theme: Theme, item: &Item, shapes: &mut Vec<Shape>) {
        let plot = self.plot;
        match item {
            Item::Line { series, points } => {
                let (colour, dash, _) = theme.series(*series);
                let pieces = self.pieces(points);
                shapes.push(Shape::Path {
                    pieces,
                    closed: false,
                    fill: None,
                    stroke: Some(Stroke {
                        colour,
                        width: 1.8,
                        dash,
                    }),
                    clip: Some(plot),
                });
            }
            Item::Markers { series, points } => {
                let places: Vec<(f64, f64)> = points
                    .iter()
                    .map(|(x, y)| (self.across(*x), self.down(*y)))
                    .filter(|(x, y)| x.is_finite() && y.is_finite())
                    .collect();
                shapes.push(marks(theme, *series, &places, Some(plot)));
            }
            Item::Between { series, points } => {
                let (colour, ..) = theme.series(*series);
                let side = |pick: fn(&(f64, f64, f64)) -> (f64, f64)| {
                    self.pieces(&points.iter().map(pick).collect::<Vec<_>>())
                };
                let low = side(|(x, low, _)| (*x, *low));
                let high = side(|(x, _, high)| (*x, *high));
                let pieces = low
                    .into_iter()
                    .zip(high)
                    .map(|(low, high)| low.into_iter().chain(high.into_iter().rev()).collect())
                    .collect();
                shapes.push(Shape::Path {
                    pieces,
                    closed: true,
                    fill: Some(colour.faint(0.3)),
                    stroke: Some(Stroke {
                        colour,
                        width: 0.8,
                        dash: &[],
                    }),
                    clip: Some(plot),
                });
            }
            Item::Bars { series, bars } => {
                let (colour, ..) = theme.series(*series);
                let foot = plot.bottom();
                let pieces = bars
                    .iter()
                    .filter(|(low, high, height)| low < high && height.is_finite())
                    .map(|(low, high, height)| {
                        let (left, right, top) = (
                            self.across(*low),
                            self.across(*high),
                            self.down(*height).min(foot),
                        );
                        vec![(left, foot), (left, top), (right, top), (right, foot)]
                    })
                    .filter(|bar| bar.iter().all(|(x, y)| x.is_finite() && y.is_finite()))
                    .collect();
                shapes.push(Shape::Path {
                    pieces,
                    closed: true,
                    fill: Some(colour.faint(0.45)),
                    stroke: Some(Stroke {
                        colour,
                        width: 0.8,
                        dash: &[],
                    }),
                    clip: Some(plot),
                });
            }
            Item::Density { points, columns } => shapes.push(Shape::Image {
                place: plot,
                raster: self.density(theme, points, *columns),
            }),
            Item::Heat { grid, scale } => self.heat(theme, grid, scale, shapes),
            Item::Classes(grid) => {
                let tones = [
                    Tone::Rest,
                    Tone::HopAndRest,
                    Tone::Locked,
                    Tone::Doubled,
                    Tone::Periodic,
                    Tone::Chaotic,
                    Tone::Undecided,
                    Tone::Fault,
                ];
                let palette = tones.iter().map(|tone| tone.colour(theme)).collect();
                let number =
                    |tone: &Tone| tones.iter().position(|other| other == tone).unwrap_or(0) as u8;
                shapes.push(Shape::Image {
                    place: plot,
                    raster: raster(grid, palette, number),
                });
            }
            Item::Strip { low, high } => {
                let left = self.across(*low).clamp(plot.left, plot.right());
                let right = self.across(*high).clamp(plot.left, plot.right());
                if right > left {
                    let width = right - left;
                    shapes.push(Shape::area(
                        Rect {
                            left,
                            width,
                            ..plot
                        },
                        theme.strip(),
                    ));
                }
            }
            Item::Shelf { low, high } => {
                let top = self.down(*high).clamp(plot.top, plot.bottom());
                let bottom = self.down(*low).clamp(plot.top, plot.bottom());
                if bottom > top {
                    let height = bottom - top;
                    shapes.push(Shape::area(
                        Rect {
                            top,
                            height,
                            ..plot
                        },
                        theme.strip(),
                    ));
                }
            }
            Item::Note { x, y, words } => {
                self.halo(
                    theme,
                    self.across(*x),
                    self.down(*y),
                    words,
                    Anchor::Start,
                    shapes,
                );
            }
        }
    }

    /// Words on a patch of background, legible over anything.
    fn halo(
        &self,
        theme: Theme,
        x: f64,
        y: f64,
        words: &str,
        anchor: Anchor,
        shapes: &mut Vec<Shape>,
    ) {
        if words.is_empty() || !x.is_finite() || !y.is_finite() {
            return;
        }
        let width = font::width(words, SMALL, false);
        let left = match anchor {
            Anchor::Start => x,
            Anchor::Middle => x - 0.5 * width,
            Anchor::End => x - width,
        };
        let patch = Rect {
            left: left - 2.0,
            top: y - 11.0,
            width: width + 4.0,
            height: 14.5,
        };
        shapes.push(Shape::area(patch, theme.background().faint(0.8)));
        shapes.push(Shape::Text(text(x, y, words, anchor, theme.text(), SMALL)));
    }

    /// The line as pieces of finite points; where several fall on half a pixel's width, first, lowest,
    /// highest and last stay, which looks the same.
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
            let mut kept = [
                0,
                (0..=last).min_by(by_height).unwrap_or(0),
                (0..=last).max_by(by_height).unwrap_or(0),
                last,
            ];
            kept.sort_unstable();
            for (n, place) in kept.iter().enumerate() {
                if n == 0 || kept[n - 1] != *place {
                    piece.push(bucket[*place]);
                }
            }
            bucket.clear();
        };
        for (x, y) in points {
            let place = (self.across(*x), self.down(*y));
            if !place.0.is_finite() || !place.1.is_finite() {
                flush(&mut bucket, &mut piece);
                if piece.len() > 1 {
                    pieces.push(std::mem::take(&mut piece));
                }
                piece.clear();
                continue;
            }
            // Far outside the panel nothing is seen, and the file stays free of huge numbers.
            let place = (
                place.0.clamp(self.plot.left - 2e3, self.plot.right() + 2e3),
                place.1.clamp(self.plot.top - 2e3, self.plot.bottom() + 2e3),
            );
            if bucket
                .first()
                .is_some_and(|first| (first.0 - place.0).abs() > 0.5)
            {
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

    fn density(&self, theme: Theme, points: &[(f64, f64)], given: usize) -> Raster {
        let rows = (1.5 * self.plot.height) as usize;
        let columns = if given > 1 {
            given
        } else {
            (1.5 * self.plot.width) as usize
        };
        let mut counts = vec![0_u32; columns * rows];
        for (x, y) in points {
            let (across, up) = (self.panel.x.part(*x), self.panel.y.part(*y));
            if (-1e-9..=1.0 + 1e-9).contains(&across) && (0.0..=1.0).contains(&up) {
                let column = if given > 1 {
                    (across * (columns - 1) as f64).round()
                } else {
                    (across * columns as f64).floor()
                };
                let column = (column.max(0.0) as usize).min(columns - 1);
                let row = (((1.0 - up) * rows as f64) as usize).min(rows - 1);
                counts[row * columns + column] += 1;
            }
        }
        let most = f64::from(counts.iter().copied().max().unwrap_or(0).max(2));
        let levels = 32;
        let mut palette = vec![theme.background().faint(0.0)];
        palette.extend((0..levels).map(|n| theme.ink(f64::from(n) / f64::from(levels - 1))));
        let pixels = counts
            .into_iter()
            .map(|count| match count {
                0 => 0,
                _ => {
                    let part = f64::from(count).ln() / most.ln();
                    1 + (part * f64::from(levels - 1)).round() as u8
                }
            })
            .collect();
        Raster {
            width: columns,
            height: rows,
            palette,
            pixels,
        }
    }

    fn heat(&self, theme: Theme, grid: &Grid<f64>, scale: &Axis, shapes: &mut Vec<Shape>) {
        let plot = self.plot;
        let mut palette: Vec<Colour> = (0..255)
            .map(|n| theme.scale(f64::from(n) / 254.0))
            .collect();
        palette.push(theme.grid());
        let number = |value: &f64| {
            let part = scale.part(*value);
            if part.is_finite() {
                (part.clamp(0.0, 1.0) * 254.0).round() as u8
            } else {
                255
            }
        };
        shapes.push(Shape::Image {
            place: plot,
            raster: raster(grid, palette.clone(), number),
        });
        let bar = Rect {
            left: plot.right() + 14.0,
            width: 14.0,
            ..plot
        };
        palette.truncate(255);
        shapes.push(Shape::Image {
            place: bar,
            raster: Raster {
                width: 1,
                height: 255,
                palette,
                pixels: (0..255).rev().collect(),
            },
        });
        shapes.push(frame_of(bar, theme.axis(), 1.0));
        for (value, label) in scale.ticks((plot.height / 42.0) as usize) {
            let down = bar.bottom() - scale.part(value) * bar.height;
            shapes.push(Shape::Text(text(
                bar.right() + 5.0,
                down + 4.2,
                &label,
                Anchor::Start,
                theme.text(),
                SMALL,
            )));
        }
        shapes.push(Shape::Text(Text {
            upright: true,
            ..text(
                bar.right() + 58.0,
                plot.top + 0.5 * plot.height,
                &scale.title(),
                Anchor::Middle,
                theme.text(),
                13.0,
            )
        }));
    }
}

fn raster<T>(grid: &Grid<T>, palette: Vec<Colour>, number: impl Fn(&T) -> u8) -> Raster {
    let pixels = grid
        .values
        .chunks(grid.columns)
        .rev()
        .flatten()
        .map(number)
        .collect();
    Raster {
        width: grid.columns,
        height: grid.rows(),
        palette,
        pixels,
    }
}

fn text(x: f64, y: f64, words: &str, anchor: Anchor, colour: Colour, size: f64) -> Text {
    Text {
        at: (x, y),
        words: words.into(),
        size,
        bold: false,
        colour,
        anchor,
        upright: false,
    }
}

fn dashed(theme: Theme) -> Stroke {
    Stroke {
        colour: theme.muted(),
        width: 1.2,
        dash: &[5.0, 3.0],
    }
}

fn frame_of(rect: Rect, colour: Colour, width: f64) -> Shape {
    Shape::Path {
        pieces: vec![rect.corners()],
        closed: true,
        fill: None,
        stroke: Some(Stroke {
            colour,
            width,
            dash: &[],
        }),
        clip: None,
    }
}

fn framed(rect: Rect, fill: Colour, line: Colour) -> Shape {
    Shape::Path {
        pieces: vec![rect.corners()],
        closed: true,
        fill: Some(fill),
        stroke: Some(Stroke {
            colour: line,
            width: 0.8,
            dash: &[],
        }),
        clip: None,
    }
}

/// A rectangle in a tone, with its hatch.
fn swatch(theme: Theme, tone: Tone, rect: Rect, frame: bool, shapes: &mut Vec<Shape>) {
    shapes.push(Shape::area(rect, tone.colour(theme)));
    let step = 6.0;
    let mut pieces = Vec::new();
    let hatch = tone.hatch();
    let rises: &[f64] = match hatch {
        Hatch::None => &[],
        Hatch::Up => &[1.0],
        Hatch::Down => &[-1.0],
        Hatch::Cross => &[1.0, -1.0],
        Hatch::Upright => &[0.0],
    };
    // The pattern hangs on the sheet, not on the rectangle, so that neighbours join.
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
        shapes.push(Shape::Path {
            pieces,
            closed: false,
            fill: None,
            stroke: Some(Stroke {
                colour: theme.text().faint(0.55),
                width: 0.8,
                dash: &[],
            }),
            clip: None,
        });
    }
    if frame {
        shapes.push(frame_of(rect, theme.muted(), 0.8));
    }
}

/// The part of a rising line within the sides of a rectangle.
fn clipped(rect: Rect, a: (f64, f64), b: (f64, f64)) -> Option<((f64, f64), (f64, f64))> {
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

fn marks(theme: Theme, series: usize, places: &[(f64, f64)], clip: Option<Rect>) -> Shape {
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
    let piece = |(x, y): &(f64, f64)| shape.iter().map(|(a, b)| (x + a, y + b)).collect();
    Shape::Path {
        pieces: places.iter().map(piece).collect(),
        closed: true,
        fill: Some(colour),
        stroke: Some(Stroke {
            colour: theme.background(),
            width: 0.6,
            dash: &[],
        }),
        clip,
    }
}
