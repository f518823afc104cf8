//! One panel of a picture: two axes and the items between them.

mod axes;
mod item;
mod legend;
mod map;
mod style;

use axes::Pixels;
use item::Item;
use legend::Key;
pub use map::Grid;
use style::dashed;
pub(super) use style::label;

use super::axis::Axis;
use super::shape::{Anchor, Rect, Shape};
use super::theme::{Fill, Theme};
use super::wrapped;

pub(super) const SMALL_TEXT_SIZE: f64 = 12.0;
const HEADING: f64 = 13.0;
const LINE: f64 = 17.0;
/// Space in pixels for the labels of the vertical axis, left of the plot.
const LEFT: f64 = 74.0;
const RIGHT: f64 = 22.0;
/// Space in pixels for a colour bar, right of the plot.
const BAR: f64 = 92.0;
const RIBBON: f64 = 16.0;
/// Number of markers above which a density is drawn instead, for legibility and file size.
const MAX_MARKERS: usize = 2500;

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
    ribbon: Vec<(f64, f64, Fill)>,
}

impl Panel {
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

    pub fn heading(mut self, text: impl Into<String>) -> Self {
        self.heading = text.into();
        self
    }

    /// Height between the axes in pixels; default 300.
    pub fn height(mut self, pixels: f64) -> Self {
        self.height = pixels.clamp(20.0, 4000.0);
        self
    }

    /// A line in the series' colour and dash; NaN breaks it. An empty name omits it from the
    /// legend.
    pub fn line(self, name: &str, series: usize, points: Vec<(f64, f64)>) -> Self {
        self.item(Key::Line(series), name, Item::Line(series, points))
    }

    /// A marker at each point, or a density of more than 2500 points.
    pub fn markers(self, name: &str, series: usize, points: Vec<(f64, f64)>) -> Self {
        if points.len() > MAX_MARKERS {
            return self.density(name, points);
        }
        self.item(Key::Marker(series), name, Item::Markers(series, points))
    }

    /// The area between two lines, as (x, low, high).
    pub fn between(self, name: &str, series: usize, points: Vec<(f64, f64, f64)>) -> Self {
        self.item(Key::Area(series), name, Item::Between(series, points))
    }

    /// A density of any number of points, darker for more points.
    pub fn density(self, name: &str, points: Vec<(f64, f64)>) -> Self {
        self.item(Key::Ink, name, Item::Density(points))
    }

    /// A density from the numbers of points in evenly spaced columns, the first and last at the ends
    /// of the axis. The cells of a column are those of [`Axis::cell`].
    pub fn columns(self, name: &str, columns: Vec<Vec<u32>>) -> Self {
        self.item(Key::Ink, name, Item::Columns(columns))
    }

    /// A map of values over the whole panel, with a colour bar; NaN stays empty.
    pub fn heat(mut self, grid: Grid<f64>, scale: Axis) -> Self {
        self.items.push(Item::Heat(grid, scale));
        self
    }

    /// A map of fills over the whole panel; `names` are for the legend.
    pub fn classes(mut self, grid: Grid<Fill>, names: &[(Fill, impl AsRef<str>)]) -> Self {
        for (fill, name) in names {
            self.key(Key::Plain(*fill), name.as_ref());
        }
        self.items.push(Item::Classes(grid));
        self
    }

    /// A ribbon of fills above the plot, as (from, to, fill) along the horizontal axis. Neighbours
    /// of the same fill are merged.
    pub fn ribbon(
        mut self,
        stretches: impl IntoIterator<Item = (f64, f64, Fill)>,
        names: &[(Fill, impl AsRef<str>)],
    ) -> Self {
        for (fill, name) in names {
            self.key(Key::Fill(*fill), name.as_ref());
        }
        for (from, to, fill) in stretches {
            match self.ribbon.last_mut() {
                Some(last) if (last.1, last.2) == (from, fill) => last.1 = to,
                _ => self.ribbon.push((from, to, fill)),
            }
        }
        self
    }

    /// A ribbon of fills at points within `low..high`. Each extends halfway to both neighbours.
    pub fn ribbon_of_points(
        self,
        [low, high]: [f64; 2],
        points: impl IntoIterator<Item = (f64, Fill)>,
        names: &[(Fill, impl AsRef<str>)],
    ) -> Self {
        let points: Vec<(f64, Fill)> = points.into_iter().collect();
        let mut edges = vec![low];
        edges.extend(points.windows(2).map(|pair| 0.5 * (pair[0].0 + pair[1].0)));
        edges.push(high);
        let stretch = |(ends, (_, fill)): (&[f64], _)| (ends[0], ends[1], fill);
        self.ribbon(edges.windows(2).zip(points).map(stretch), names)
    }

    /// A shaded strip of the horizontal axis, for a band of k.
    pub fn strip(self, name: &str, low: f64, high: f64) -> Self {
        self.item(Key::Strip, name, Item::Strip(low, high))
    }

    /// A shaded strip of the vertical axis, for a band of k on that axis.
    pub fn shelf(self, name: &str, low: f64, high: f64) -> Self {
        self.item(Key::Strip, name, Item::Shelf(low, high))
    }

    /// A dashed vertical line at `x`, with text above it.
    pub fn mark(mut self, x: f64, text: impl Into<String>) -> Self {
        self.marks.push((x, text.into(), true));
        self
    }

    /// Text above the panel at `x`, without a line.
    pub fn caption(mut self, x: f64, text: impl Into<String>) -> Self {
        self.marks.push((x, text.into(), false));
        self
    }

    /// A dashed horizontal line at `y`, with text at its right end, at the left end of every other
    /// line.
    pub fn level(mut self, y: f64, text: impl Into<String>) -> Self {
        self.levels.push((y, text.into()));
        self
    }

    fn item(mut self, key: Key, name: &str, item: Item) -> Self {
        self.key(key, name);
        self.items.push(item);
        self
    }

    fn key(&mut self, key: Key, name: &str) {
        let entry = (key, name.to_string());
        if !name.is_empty() && !self.legend.contains(&entry) {
            self.legend.push(entry);
        }
    }

    /// Draws the panel with its top at `top` into `shapes`; returns its lower end.
    pub(super) fn draw(
        &self,
        theme: Theme,
        top: f64,
        width: f64,
        squeezed: f64,
        shapes: &mut Vec<Shape>,
    ) -> f64 {
        let mut items = self.items.iter();
        let bar = items.any(|item| matches!(item, Item::Heat(..)));
        let right = if bar { BAR } else { RIGHT };
        let plot = Rect::new(LEFT, top, width - LEFT - right, squeezed * self.height);
        let panel = self;
        let mut pixels = Pixels {
            panel,
            plot,
            theme,
            shapes,
        };
        if !self.heading.is_empty() {
            for line in wrapped(&self.heading, HEADING, true, plot.width) {
                let at = (plot.left, pixels.plot.top + 12.0);
                let text = label(at, &line, Anchor::Start, theme.text());
                pixels.push(Shape::Text(text.sized(HEADING, true)));
                pixels.plot.top += LINE;
            }
            pixels.plot.top += 4.0;
        }
        pixels.plot.top = pixels.draw_legend();
        pixels.plot.top = pixels.draw_marks();
        if !self.ribbon.is_empty() {
            pixels.draw_ribbon();
            pixels.plot.top += RIBBON + 4.0;
        }
        pixels.draw_grid();
        for item in &self.items {
            pixels.draw_item(item);
        }
        let plot = pixels.plot;
        for (x, text, line) in &self.marks {
            let across = pixels.x_pixel(*x);
            if *line && pixels.within_x(*x) {
                let foot = plot.top - if text.is_empty() { 0.0 } else { 3.0 };
                let line = vec![(across, foot), (across, plot.bottom())];
                pixels.lines(vec![line], dashed(theme));
            }
        }
        pixels.draw_levels();
        pixels.draw_axes();
        plot.bottom() + 46.0
    }
}
