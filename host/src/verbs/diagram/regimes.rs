//! The regimes over k and restitution at once.

use kband::feeder::OutOfRange;
use kband::impact::ContactTime;
use kband::regime::band::{birth, flip};
use kband::regime::classify::Regime;

use super::{Arguments, COLUMNS};
use crate::arguments::{ContactArguments, Range};
use crate::desk::Desk;
use crate::ending::{self, Endings, FILLS, FOLLOWED, TOGETHER};
use crate::picture::{Axis, Fill, Grid, Panel, Picture};
use crate::refusal::Refusal;
use crate::report::{Printout, Table, columns, number};

/// Largest number of points of a map: some minutes on one core.
const MAX_MAP_POINTS: usize = 250_000;

/// Final regimes over k and restitution.
pub(super) struct Map {
    k: Range,
    restitution: Range,
    contact: ContactArguments,
    /// Row by row from the lowest restitution, for each of [`STARTS`].
    ends: [Vec<Regime>; 2],
}

/// Starts of the parts, as named in tables and headings.
const STARTS: [(&str, &str); 2] = [
    ("rest", "from rest"),
    (
        "lock",
        "from next to the period-1 orbit of order 1, else from lift-off",
    ),
];

impl Map {
    pub(super) fn compute(
        arguments: &Arguments,
        contact: ContactTime,
        desk: &Desk,
    ) -> Result<Self, Refusal> {
        let (k, restitution) = ranges(arguments)?;
        let of_row = |restitution| k.values().map(move |k| (k, restitution));
        let places: Vec<(f64, f64)> = restitution.values().flat_map(of_row).collect();
        let ends = desk.spread("regimes", places.len(), TOGETHER, |places_of| {
            let tracks: Vec<_> = places_of.iter().map(|n| places[*n]).collect();
            let endings = Endings::of_tracks(&tracks, FOLLOWED, contact)?;
            let starts = endings.iter().map(|track| track.start_near_lock(1));
            let from_lock = ending::of_each(&endings, starts.enumerate()).into_iter();
            Ok(endings
                .iter()
                .map(Endings::from_rest)
                .zip(from_lock)
                .collect())
        })?;
        let (from_rest, from_lock) = ends.into_iter().unzip();
        Ok(Self {
            k,
            restitution,
            contact: arguments.contact,
            ends: [from_rest, from_lock],
        })
    }

    /// The occurring fills in the order of a legend, with their numbers.
    fn counts(&self, start: usize) -> Vec<(Fill, &'static str, usize)> {
        let count = |wanted: Fill| {
            let ends = self.ends[start].iter();
            ends.filter(|end| ending::fill(**end) == wanted).count()
        };
        FILLS
            .iter()
            .map(|(fill, name)| (*fill, *name, count(*fill)))
            .filter(|(.., count)| *count > 0)
            .collect()
    }

    pub(super) fn report(&self) -> Result<Printout, Refusal> {
        let mut table = Table::new(&[
            columns::START,
            columns::REGIME,
            columns::SHARE.digits(4),
            columns::POINTS,
        ]);
        let mut shares = Vec::new();
        for (n, (start, _)) in STARTS.iter().enumerate() {
            for (_, name, count) in self.counts(n) {
                let share = count as f64 / self.ends[n].len() as f64;
                table.push([(*start).into(), name.into(), share.into(), count.into()]);
                let told = serde_json::json!({
                    "start": start, "regime": name, "share": share, "points": count,
                });
                shares.push(told);
            }
        }
        let mut full = Table::new(&[
            columns::K,
            columns::RESTITUTION,
            columns::FROM_REST,
            columns::FROM_LOCK,
        ]);
        let places = self
            .restitution
            .values()
            .flat_map(|r| self.k.values().map(move |k| (k, r)));
        for (n, (k, restitution)) in places.enumerate() {
            let told = |start: usize| ending::describe_regime(self.ends[start][n], FOLLOWED);
            full.push([k.into(), restitution.into(), told(0).into(), told(1).into()]);
        }
        Printout::new(table)
            .heading(format!(
                "Where a part ends: k = {}..{} ({}), R = {}..{} ({}){}",
                number(self.k.low, 6),
                number(self.k.high, 6),
                self.k.count,
                number(self.restitution.low, 6),
                number(self.restitution.high, 6),
                self.restitution.count,
                self.contact.words()
            ))
            .note("--out FILE.svg draws the map, FILE.csv lists its points")
            .csv_of(full)
            .json(&serde_json::json!({
                "k": [self.k.low, self.k.high, self.k.count],
                "restitution": [self.restitution.low, self.restitution.high, self.restitution.count],
                "followed": FOLLOWED,
                "shares": shares,
            }))
    }

    pub(super) fn picture(&self) -> Picture {
        let mut picture = Picture::new("Regimes over k and restitution")
            .width(780.0)
            .caption(format!(
                "{} × {} parts, each followed for up to {FOLLOWED} impacts{}",
                self.k.count,
                self.restitution.count,
                self.contact.words()
            ));
        for start in 0..STARTS.len() {
            picture = picture.panel(self.panel(start));
        }
        picture
    }

    fn panel(&self, start: usize) -> Panel {
        let all = self.ends[start].len() as f64;
        let named = |(fill, name, count): (Fill, &str, usize)| {
            (fill, format!("{name}: {:.1} %", 100.0 * count as f64 / all))
        };
        let names: Vec<(Fill, String)> = self.counts(start).into_iter().map(named).collect();
        let ends = self.ends[start].iter();
        let fills = ends.map(|end| ending::fill(*end)).collect();
        // Half a cell beyond the outermost points on each side.
        let axis = |label: &str, range: Range| {
            let half = 0.5 * (range.high - range.low) / (range.count - 1) as f64;
            Axis::new(label, "", range.low - half, range.high + half)
        };
        let mut panel = Panel::new(
            axis("k = g cos α / (b ω²)", self.k),
            axis("restitution R", self.restitution),
        )
        .heading(STARTS[start].1)
        .height(380.0)
        .classes(Grid::new(self.k.count, fills), &names);
        for order in 1..=3 {
            let ends = |of: fn(f64, u32) -> Result<f64, OutOfRange>| {
                let place = |r: f64| (of(r, order).unwrap_or(f64::NAN), r);
                self.restitution.values().map(place).collect::<Vec<_>>()
            };
            let named = |name| if order == 1 { name } else { "" };
            panel = panel
                .line(named("k1: a lock is born, orders 1 to 3"), 1, ends(birth))
                .line(named("k2: it doubles"), 2, ends(flip));
        }
        panel
    }
}

/// Both ranges of the map.
fn ranges(arguments: &Arguments) -> Result<(Range, Range), Refusal> {
    let k = arguments.k.unwrap_or(Range::new(0.1, 0.8, 200));
    let restitution = arguments.restitution.unwrap_or(Range::new(0.0, 0.9, 150));
    // A range without a number gets as many values as fit.
    let fitted = |range: Range, most: usize| match range.count {
        COLUMNS if k.count.saturating_mul(restitution.count) > MAX_MAP_POINTS => Range {
            count: most.max(2),
            ..range
        },
        _ => range,
    };
    let beside = |other: Range| match other.count {
        COLUMNS => MAX_MAP_POINTS.isqrt(),
        count => MAX_MAP_POINTS / count,
    };
    let (k, restitution) = match (k.count, restitution.count) {
        (2.., 2..) => (
            fitted(k, beside(restitution)),
            fitted(restitution, beside(k)),
        ),
        _ => {
            return Err(Refusal::new(
                "--show regimes needs both --k and --restitution as a range",
                "for example --k 0.1..0.8:200 --restitution 0..0.9:150",
            ));
        }
    };
    if k.count.saturating_mul(restitution.count) > MAX_MAP_POINTS {
        return Err(Refusal::value(
            "the number of points",
            format!("{} x {}", k.count, restitution.count),
            format!("at most {MAX_MAP_POINTS}"),
            "give fewer, for example --k 0.1..0.8:200 --restitution 0..0.9:150",
        ));
    }
    let scatter = arguments.scatter.scatter;
    if scatter > 0.0 {
        return Err(Refusal::value(
            "--scatter",
            scatter,
            "0 with --show regimes: with scatter there is no final regime",
            "kband gear --scatter computes the share of time in gear",
        ));
    }
    Ok((k, restitution))
}
