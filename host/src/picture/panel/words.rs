//! Label placement: text beside points and lines, at the candidate place of least cost.

use super::SMALL;
use super::axes::Pixels;
use super::item::Item;
use super::style::{dashed, label};
use crate::picture::font;
use crate::picture::shape::{Anchor, Rect, Shape};
use crate::picture::theme::Theme;

/// Half the width of a marker in pixels, with a margin.
const MARKER: f64 = 8.0;
/// Space in pixels between texts, and between a text and the frame.
const APART: f64 = 6.0;
/// Space in pixels between a text and its point.
const BESIDE: f64 = 9.0;
/// Costs of a text that covers a line, a marker or another text, or leaves the panel.
const LINE_COVERED: u32 = 1;
const MARKER_COVERED: u32 = 6;
const WORDS_COVERED: u32 = 30;
const OUTSIDE: u32 = 200;

#[derive(Clone, Copy)]
struct Place {
    x: f64,
    y: f64,
    anchor: Anchor,
}

impl Place {
    fn new(x: f64, y: f64, anchor: Anchor) -> Self {
        Self { x, y, anchor }
    }

    fn patch(&self, words: &str) -> Rect {
        let width = font::width(words, SMALL, false);
        let left = match self.anchor {
            Anchor::Start => self.x,
            Anchor::Middle => self.x - 0.5 * width,
            Anchor::End => self.x - width,
        };
        Rect {
            left: left - 2.0,
            top: self.y - 11.0,
            width: width + 4.0,
            height: 14.5,
        }
    }
}

struct Obstacles {
    plot: Rect,
    markers: Vec<(f64, f64)>,
    lines: Vec<[(f64, f64); 2]>,
    words: Vec<Rect>,
}

impl Obstacles {
    fn of(pixels: &Pixels<'_>) -> Self {
        let mut obstacles = Self {
            plot: pixels.plot,
            markers: Vec::new(),
            lines: Vec::new(),
            words: Vec::new(),
        };
        for item in &pixels.panel.items {
            match item {
                Item::Markers { points, .. } => {
                    let places = points
                        .iter()
                        .map(|(x, y)| (pixels.across(*x), pixels.down(*y)));
                    obstacles.markers.extend(places);
                }
                Item::Line { points, .. } => {
                    for piece in pixels.pieces(points) {
                        let pairs = piece.windows(2).map(|pair| [pair[0], pair[1]]);
                        obstacles.lines.extend(pairs);
                    }
                }
                _ => {}
            }
        }
        obstacles
    }

    fn cost(&self, patch: &Rect) -> u32 {
        let plot = &self.plot;
        let inside = patch.left >= plot.left
            && patch.right() <= plot.right()
            && patch.top >= plot.top
            && patch.bottom() <= plot.bottom();
        let crowded = patch.right() > plot.right() - APART;
        let near = |(x, y): &&(f64, f64)| {
            (patch.left - MARKER..patch.right() + MARKER).contains(x)
                && (patch.top - MARKER..patch.bottom() + MARKER).contains(y)
        };
        let markers = self.markers.iter().filter(near).count() as u32;
        let lines = self.lines.iter().filter(|line| crosses(patch, line));
        let words = self.words.iter().filter(|other| {
            other.left < patch.right() + APART
                && patch.left < other.right() + APART
                && other.top < patch.bottom()
                && patch.top < other.bottom()
        });
        u32::from(!inside) * OUTSIDE
            + u32::from(crowded) * LINE_COVERED
            + markers * MARKER_COVERED
            + lines.count() as u32 * LINE_COVERED
            + words.count() as u32 * WORDS_COVERED
    }

    /// The first place of least cost.
    fn choose(&mut self, words: &str, places: &[Place]) -> Option<Place> {
        let cost = |place: &&Place| self.cost(&place.patch(words));
        let chosen = places.iter().min_by_key(cost).copied()?;
        self.words.push(chosen.patch(words));
        Some(chosen)
    }
}

/// Whether a line segment intersects a rectangle (Liang and Barsky 1984).
fn crosses(patch: &Rect, [from, to]: &[(f64, f64); 2]) -> bool {
    let (dx, dy) = (to.0 - from.0, to.1 - from.1);
    let (mut enters, mut leaves) = (0.0_f64, 1.0_f64);
    for (towards, room) in [
        (-dx, from.0 - patch.left),
        (dx, patch.right() - from.0),
        (-dy, from.1 - patch.top),
        (dy, patch.bottom() - from.1),
    ] {
        if towards < 0.0 {
            enters = enters.max(room / towards);
        } else if towards > 0.0 {
            leaves = leaves.min(room / towards);
        } else if room < 0.0 {
            return false;
        }
    }
    enters <= leaves
}

impl Pixels<'_> {
    /// The dashed lines across the panel and all text within it.
    pub(super) fn draw_words(&self, theme: Theme, shapes: &mut Vec<Shape>) {
        let plot = self.plot;
        let mut obstacles = Obstacles::of(self);
        for (y, words) in &self.panel.levels {
            let down = self.down(*y);
            if !(plot.top..=plot.bottom()).contains(&down) {
                continue;
            }
            let ends = vec![(plot.left, down), (plot.right(), down)];
            shapes.push(Shape::lines(vec![ends], dashed(theme), None));
            let (above, below) = (down - 4.0, down + 14.0);
            let (right, left) = (plot.right() - APART - 4.0, plot.left + 4.0);
            let middle = 0.5 * (left + right);
            let places = [
                Place::new(right, above, Anchor::End),
                Place::new(right, below, Anchor::End),
                Place::new(left, above, Anchor::Start),
                Place::new(left, below, Anchor::Start),
                Place::new(middle, above, Anchor::Middle),
                Place::new(middle, below, Anchor::Middle),
            ];
            self.put(theme, words, obstacles.choose(words, &places), shapes);
        }
        for item in &self.panel.items {
            let Item::Note { x, y, words } = item else {
                continue;
            };
            let (x, y) = (self.across(*x), self.down(*y));
            let beside = y + 4.0;
            let places = [
                Place::new(x + BESIDE, beside, Anchor::Start),
                Place::new(x, y - BESIDE, Anchor::Middle),
                Place::new(x - BESIDE, beside, Anchor::End),
                Place::new(x, y + BESIDE + 9.0, Anchor::Middle),
            ];
            self.put(theme, words, obstacles.choose(words, &places), shapes);
        }
    }

    /// Text on a patch of background, legible over anything.
    fn put(&self, theme: Theme, words: &str, place: Option<Place>, shapes: &mut Vec<Shape>) {
        let Some(place) = place.filter(|place| place.x.is_finite() && place.y.is_finite()) else {
            return;
        };
        if words.is_empty() {
            return;
        }
        let patch = place.patch(words);
        shapes.push(Shape::area(patch, theme.background().faint(0.8)));
        let Place { x, y, anchor } = place;
        shapes.push(Shape::Text(label((x, y), words, anchor, theme.text())));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_keep_off_markers_lines_and_each_other() {
        let plot = Rect {
            left: 0.0,
            top: 0.0,
            width: 400.0,
            height: 200.0,
        };
        let mut obstacles = Obstacles {
            plot,
            markers: vec![(130.0, 100.0)],
            lines: vec![[(0.0, 80.0), (400.0, 80.0)]],
            words: Vec::new(),
        };
        let around = |x: f64, y: f64| {
            [
                Place::new(x + BESIDE, y + 4.0, Anchor::Start),
                Place::new(x, y - BESIDE, Anchor::Middle),
                Place::new(x - BESIDE, y + 4.0, Anchor::End),
            ]
        };
        // A marker on the right, a line above: the text goes to the left.
        let first = obstacles.choose("single", &around(100.0, 100.0)).unwrap();
        assert_eq!(first.anchor, Anchor::End);
        // Earlier texts keep their place.
        let second = obstacles.choose("integer", &around(100.0, 100.0)).unwrap();
        assert_ne!(second.anchor, Anchor::End);
        // No text leaves the panel without need.
        let edge = obstacles.choose("bracket", &around(395.0, 150.0)).unwrap();
        assert_eq!(edge.anchor, Anchor::End);
    }

    #[test]
    fn a_line_that_passes_by_is_not_in_the_way() {
        let patch = Rect {
            left: 10.0,
            top: 10.0,
            width: 20.0,
            height: 10.0,
        };
        assert!(crosses(&patch, &[(0.0, 0.0), (40.0, 30.0)]));
        assert!(crosses(&patch, &[(15.0, 12.0), (16.0, 13.0)]));
        assert!(!crosses(&patch, &[(0.0, 25.0), (40.0, 25.0)]));
        assert!(!crosses(&patch, &[(0.0, 0.0), (5.0, 40.0)]));
    }
}
