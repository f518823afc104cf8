//! Map of regimes over k and restitution.

use kband::feeder::OutOfRange;
use kband::regime::band::{birth, flip};
use kband::regime::classify::Regime;

use super::Arguments;
use crate::arguments::{ContactArguments, Range};
use crate::desk::Desk;
use crate::ending::{self, Endings, MAX_ORBIT_IMPACTS};
use crate::picture::{Axis, Grid, Panel, Picture};
use crate::refusal::{Refusal, Result};
use crate::report::columns::{FROM_LOCK, FROM_REST, K, RESTITUTION};
use crate::report::{Printout, Table, fields, numbers};

/// Largest number of points of a map; it takes some minutes on one core.
const MAX_MAP_POINTS: usize = 250_000;

pub(super) struct Map {
    k: Range,
    restitution: Range,
    contact: ContactArguments,
    /// Row by row from the lowest restitution, for each of [`STARTS`].
    ends: [Vec<Regime>; 2],
}

type Share = (&'static str, &'static str, f64, usize);

fields! {
    fn shares(row: Share) {
        all START => row.0;
        all REGIME => row.1;
        all SHARE.digits(4) => row.2;
        all POINTS => row.3;
    }
}

const STARTS: [(&str, &str); 2] = [
    ("rest", "from rest"),
    (
        "lock",
        "from next to the period-1 orbit of order 1, else from lift-off",
    ),
];

impl Map {
    pub fn compute(arguments: &Arguments, desk: &Desk) -> Result<Self> {
        let contact = arguments.contact.time(arguments.amplitude.hertz())?;
        let (k, restitution) = ranges(arguments)?;
        let of_row = |restitution| k.values().map(move |k| (k, restitution));
        let places: Vec<(f64, f64)> = restitution.values().flat_map(of_row).collect();
        let ends = desk.spread("regimes", places.len(), |places_of| {
            let tracks: Vec<_> = places_of.iter().map(|n| places[*n]).collect();
            let endings = Endings::from_tracks(&tracks, MAX_ORBIT_IMPACTS, contact)?;
            let starts = endings.iter().map(|track| track.start_near_lock(1));
            let from_lock = ending::of_each(&endings, starts.enumerate());
            let from_rest = endings.iter().map(Endings::from_rest);
            Ok(from_rest.zip(from_lock).collect())
        })?;
        let (from_rest, from_lock) = ends.into_iter().unzip();
        Ok(Self {
            k,
            restitution,
            contact: arguments.contact,
            ends: [from_rest, from_lock],
        })
    }

    pub fn report(&self) -> Printout {
        let mut rows: Vec<Share> = Vec::new();
        for (&(start, _), ends) in STARTS.iter().zip(&self.ends) {
            for (_, regime, points) in ending::count_fills(ends) {
                rows.push((start, regime, points as f64 / ends.len() as f64, points));
            }
        }
        let [k, restitution] = [self.k, self.restitution].map(|Range { low, high, count }| {
            let [low, high] = numbers([low, high], 6);
            format!("{low}..{high} ({count})")
        });
        let contact = self.contact.describe();
        let mut full = Table::new(&[K, RESTITUTION, FROM_REST, FROM_LOCK]);
        let places = self.restitution.values();
        let places = places.flat_map(|r| self.k.values().map(move |k| (k, r)));
        for (n, (k, restitution)) in places.enumerate() {
            let ends = [0, 1].map(|start: usize| self.ends[start][n]);
            let [rest, lock] = ends.map(|end| ending::describe_regime(end, MAX_ORBIT_IMPACTS));
            full.push([k.into(), restitution.into(), rest.into(), lock.into()]);
        }
        shares()
            .printout(&rows)
            .heading(format!("Where a part ends: k = {k}, R = {restitution}{contact}"))
            .note("--out FILE.svg draws the map, FILE.csv lists its points")
            .csv_of(full)
            .json(serde_json::json!({
                "k": [self.k.low, self.k.high, self.k.count],
                "restitution": [self.restitution.low, self.restitution.high, self.restitution.count],
                "followed": MAX_ORBIT_IMPACTS,
                "shares": shares().objects(&rows),
            }))
    }

    pub fn picture(&self) -> Picture {
        let (columns, rows) = (self.k.count, self.restitution.count);
        let contact = self.contact.describe();
        let picture = Picture::new("Regimes over k and restitution")
            .width(780.0)
            .caption(format!(
                "{columns} × {rows} parts, each followed for up to {MAX_ORBIT_IMPACTS} impacts{contact}"
            ));
        let panels = (0..STARTS.len()).map(|start| self.panel(start));
        panels.fold(picture, Picture::panel)
    }

    fn panel(&self, start: usize) -> Panel {
        let ends = &self.ends[start];
        let fills = ends.iter().map(|end| ending::fill(*end)).collect();
        // Half a cell beyond the outermost points on each side.
        let axis = |label: &str, range: Range| {
            let half = 0.5 * (range.high - range.low) / (range.count - 1) as f64;
            Axis::new(label, "", range.low - half, range.high + half)
        };
        let k = axis("k = g cos α / (b ω²)", self.k);
        let mut panel = Panel::new(k, axis("restitution R", self.restitution))
            .heading(STARTS[start].1)
            .height(380.0)
            .classes(Grid::new(self.k.count, fills), &ending::name_shares(ends));
        for order in 1..=3 {
            let ends = |bound: fn(f64, u32) -> Result<f64, OutOfRange>| {
                let place = |r: f64| (bound(r, order).unwrap_or(f64::NAN), r);
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

fn ranges(arguments: &Arguments) -> Result<(Range, Range)> {
    let k = arguments.k.unwrap_or(Range::new(0.1, 0.8, 200));
    let restitution = arguments.restitution.unwrap_or(Range::new(0.0, 0.9, 150));
    if k.count < 2 || restitution.count < 2 {
        let cause = "--show regimes needs both --k and --restitution as a range";
        let next = "for example --k 0.1..0.8:200 --restitution 0..0.9:150";
        return Err(Refusal::new(cause, next));
    }
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
        let accepted = "0 with --show regimes: with scatter there is no final regime";
        let next = "kband gear --scatter computes the share of time in gear";
        return Err(Refusal::value("--scatter", scatter, accepted, next));
    }
    Ok((k, restitution))
}
