//! Many runs of one scene at each combination of values of its keys.

use kband_scene::{Fidelity, SceneFile};
use toml::{Table, Value as Toml};

use super::runs::{self, Run, Runs};
use crate::desk::Desk;
use crate::picture::{Axis, Grid, Panel, Picture};
use crate::refusal::{Refusal, Result};
use crate::report::{Column, Field, Printout, Table as Rows, View, counted, fields, when};

const MAX_RUNS: usize = 1_000_000;

#[derive(Clone, Debug, PartialEq)]
pub struct Axes {
    /// The key with its tables, such as `drive.gain` or `disturbance.1.at`.
    pub key: String,
    pub values: Vec<f64>,
}

impl Axes {
    /// Parses `key=a..b:n` or `key=a`; the error states the accepted form.
    pub fn parse(text: &str) -> Result<Self, String> {
        let accepted = "KEY=VALUE or KEY=LOW..HIGH:COUNT with a COUNT of 1..100000";
        Self::read(text).ok_or_else(|| format!("{accepted}, such as drive.gain=0.5..1.5:11"))
    }

    fn read(text: &str) -> Option<Self> {
        let (key, range) = text.split_once('=')?;
        let number = |text: &str| {
            let number: f64 = text.trim().parse().ok()?;
            number.is_finite().then_some(number)
        };
        let values = match range.split_once("..") {
            None => vec![number(range)?],
            Some((low, rest)) => {
                let (high, count) = rest.rsplit_once(':')?;
                let (low, high) = (number(low)?, number(high)?);
                let count: usize = count.trim().parse().ok()?;
                if !(1..=100_000).contains(&count) {
                    return None;
                }
                let step = (high - low) / (count.max(2) - 1) as f64;
                let value = |n: usize| match n {
                    0 => low,
                    // The typed value, because a rounded one may be out of range.
                    _ if n + 1 == count => high,
                    _ => low + step * n as f64,
                };
                (0..count).map(value).collect()
            }
        };
        let key = key.trim();
        (!key.is_empty()).then(|| Self {
            key: key.into(),
            values,
        })
    }
}

/// Sets a key of a scene's table, and creates missing tables on its path.
fn set(table: &mut Table, key: &str, value: f64) -> Result<()> {
    let unknown = |part: &str| {
        let accepted =
            "a numeric key of the scene with its tables, such as drive.gain or disturbance.1.at";
        let next = format!("correct {part}; docs/scenes.md lists every key");
        Refusal::value("--sweep", key, accepted, next)
    };
    let mut parts: Vec<&str> = key.split('.').collect();
    let last = parts.pop().unwrap_or_default();
    let within = parts.last().copied();
    let mut inner = table;
    let mut parts = parts.into_iter();
    while let Some(part) = parts.next() {
        let entry = inner.entry(part);
        inner = match entry.or_insert_with(|| Toml::Table(Table::new())) {
            Toml::Table(table) => table,
            Toml::Array(list) => {
                // The next part is the number of a table in the list, from 1.
                let number = parts.next().ok_or_else(|| unknown(last))?;
                let index = number.parse::<usize>().ok().and_then(|n| n.checked_sub(1));
                match index.and_then(|index| list.get_mut(index)) {
                    Some(Toml::Table(table)) => table,
                    _ => return Err(unknown(number)),
                }
            }
            _ => return Err(unknown(part)),
        };
    }
    set_number(inner, within, last, value).ok_or_else(|| unknown(last))
}

/// Sets a number at a key; `None` if the key is a table.
fn set_number(table: &mut Table, within: Option<&str>, key: &str, value: f64) -> Option<()> {
    if matches!(table.get(key), Some(Toml::Table(_))) {
        return None;
    }
    if within == Some("target") {
        // A target has only one of several keys.
        table.clear();
    }
    let value = match key {
        "seed" | "locked" | "count" if value.fract() == 0.0 => Toml::Integer(value as i64),
        _ => Toml::Float(value),
    };
    table.insert(key.into(), value);
    Some(())
}

pub struct Point {
    /// Values of the swept keys, in their order.
    pub values: Vec<f64>,
    pub runs: Runs,
}

/// A refusal with its point of the sweep, unless it names a swept key.
fn at_point(refusal: Refusal, axes: &[Axes], values: &[f64]) -> Refusal {
    if axes.iter().any(|axis| refusal.key() == Some(&axis.key)) {
        return refusal;
    }
    let point = axes.iter().zip(values);
    let point = point.map(|(axis, value)| format!("{} = {value}", axis.key));
    let point: Vec<String> = point.collect();
    refusal.at(format!("--sweep at {}", point.join(", ")))
}

pub struct Sweep {
    axes: Vec<Axes>,
    /// The last key varies fastest.
    points: Vec<Point>,
}

fields! {
    fn summary(point: Point) {
        all RUNS => point.runs.0.len();
        all SHARE.titled("reached").digits(4) => point.runs.share().0;
        all LOW_95.digits(4) => point.runs.share().1;
        all HIGH_95.digits(4) => point.runs.share().2;
        all MEDIAN_TIME.titled("median (s)").digits(3) => point.runs.time_of(50);
        all B.digits(4) => point.middle(|run| run.amplitude * 1e3);
        all K.digits(4) => point.middle(|run| run.k);
        all IN_GEAR.digits(3) => point.runs.in_gear();
        all IN_GEAR_ESTIMATED.digits(3) => point.runs.in_gear_estimated();
        all IN_GEAR_COVERAGE.digits(3) => point.runs.in_gear_coverage();
        all SPEED.digits(4) => point.middle(|run| run.speed * 1e3);
        all STATE => most_frequent(point.runs.0.iter().map(|run| run.state.name()));
        all REGIME => most_frequent(point.runs.0.iter().map(|run| run.regime.as_str()));
    }
}

impl Point {
    fn middle(&self, value: impl Fn(&Run) -> f64) -> Option<f64> {
        let mut all: Vec<f64> = self.runs.0.iter().map(value).collect();
        all.sort_by(f64::total_cmp);
        let middle = all.get(all.len() / 2).copied();
        middle.filter(|value| value.is_finite())
    }
}

impl Sweep {
    /// Runs the scene of `table` once at each point, after `prepare`. With `drawn`, it makes so many
    /// runs, each with its own parts and noise, equal at all points (common random numbers).
    pub fn run(
        table: &Table,
        axes: &[Axes],
        prepare: &(dyn Fn(&mut SceneFile) + Sync),
        drawn: Option<usize>,
        fidelity: Option<Fidelity>,
        desk: &Desk,
    ) -> Result<Self> {
        let count = drawn.unwrap_or(1);
        let mut counts = axes.iter().map(|axis| axis.values.len());
        let points = counts.try_fold(1_usize, usize::checked_mul);
        let points = points.filter(|points| points.saturating_mul(count) <= MAX_RUNS);
        let Some(points) = points else {
            let key = "--sweep";
            let accepted = format!("up to {MAX_RUNS} runs, all values and --runs multiplied");
            let next = "give fewer values or fewer runs";
            return Err(Refusal::value(key, "(too many points)", accepted, next));
        };
        // All scenes are checked before the first run, so an invalid value costs no time.
        let mut scenes = Vec::with_capacity(points);
        for n in 0..points {
            let mut left = n;
            let mut values = vec![0.0; axes.len()];
            for (axis, value) in axes.iter().zip(&mut values).rev() {
                *value = axis.values[left % axis.values.len()];
                left /= axis.values.len();
            }
            let mut table = table.clone();
            for (axis, value) in axes.iter().zip(&values) {
                set(&mut table, &axis.key, *value)?;
            }
            let read = SceneFile::from_table(table).and_then(|mut file| {
                prepare(&mut file);
                file.check()?;
                Ok(file)
            });
            let file = read.map_err(|refusal| at_point(refusal, axes, &values))?;
            scenes.push((values, file));
        }
        let runs = desk.try_map("sweeping", points * count, |n| {
            let (_, file) = &scenes[n / count];
            let fidelity = fidelity.or(file.fidelity).unwrap_or_default();
            match drawn {
                Some(_) => runs::run_one(&runs::drawn(file, (n % count) as u64), fidelity),
                None => runs::run_one(file, fidelity),
            }
        })?;
        let mut runs = runs.into_iter();
        let points = scenes.into_iter().map(|(values, _)| Point {
            values,
            runs: Runs(runs.by_ref().take(count).collect()),
        });
        Ok(Self {
            points: points.collect(),
            axes: axes.to_vec(),
        })
    }

    /// One row for each point: share of runs that reached the requested state, and averages.
    pub fn summary(&self) -> Printout {
        let key = |(n, column)| Field::all(column, move |point: &Point| point.values[n]);
        let keys = self.key_columns().into_iter().enumerate().map(key);
        let view = View::from_fields(keys.collect()).and(summary());
        view.printout(&self.points)
    }

    pub fn table(&self) -> Rows {
        let cells = |point: &Point| point.values.iter().map(|value| (*value).into()).collect();
        let blocks = self.points.iter().map(|point| (cells(point), &point.runs));
        runs::table_of(self.key_columns(), blocks)
    }

    fn key_columns(&self) -> Vec<Column> {
        // A column's name is never freed: a few bytes for each swept key.
        let column = |axis: &Axes| Column::new(axis.key.clone().leak(), unit(&axis.key));
        self.axes.iter().map(column).collect()
    }

    /// Share of runs that reached the requested state over the swept key, or over the first two.
    pub fn draw(&self, file: &SceneFile) -> Picture {
        let count = self.points.first().map_or(0, |point| point.runs.0.len());
        let further: Vec<&str> = (self.axes.iter().skip(2))
            .map(|axis| axis.key.as_str())
            .collect();
        let mean_over = || format!(", mean over {}", further.join(" and "));
        let further = when(!further.is_empty(), mean_over);
        let runs = if count == 1 { "run" } else { "runs" };
        let target = super::describe(file.scene.target);
        let caption = format!("{count} {runs} a point, target {target}{further}");
        let picture = Picture::new("How sure the wanted state is").caption(caption);
        let axis = |axis: &Axes, cells: bool| {
            let (low, high) = bounds(&axis.values);
            // Room for half a cell, or for a marker at the end.
            let room = if !cells {
                0.02 * (high - low)
            } else if axis.values.len() > 1 {
                0.5 * (high - low) / (axis.values.len() - 1) as f64
            } else {
                0.0
            };
            let (low, high) = (low - room, high + room);
            Axis::new(axis.key.clone(), unit(&axis.key), low, high)
        };
        let share = |point: &Point| 100.0 * point.runs.share().0;
        match &self.axes[..] {
            [first, second, ..] => {
                // Further keys: mean over all their values.
                let inner = self.axes[2..].iter();
                let inner: usize = inner.map(|axis| axis.values.len()).product();
                let (columns, rows) = (first.values.len(), second.values.len());
                let mut cells = vec![0.0; columns * rows];
                for (n, point) in self.points.iter().enumerate() {
                    let (column, row) = (n / inner / rows, n / inner % rows);
                    cells[row * columns + column] += share(point) / inner as f64;
                }
                let scale = Axis::new("runs in the wanted state", "%", 0.0, 100.0);
                let panel = Panel::new(axis(first, true), axis(second, true));
                picture.panel(panel.heat(Grid::new(columns, cells), scale))
            }
            axes => {
                let shares = Axis::new("runs in the wanted state", "%", -5.0, 105.0);
                let Some(first) = axes.first() else {
                    return picture;
                };
                let at = |point: &Point| point.values[0];
                let line = self.points.iter().map(|point| (at(point), share(point)));
                let band = self.points.iter().map(|point| {
                    let (_, low, high) = point.runs.share();
                    (at(point), 100.0 * low, 100.0 * high)
                });
                let mut panel = Panel::new(axis(first, false), shares);
                if count > 1 {
                    panel = panel.between("95 % interval", 1, band.collect());
                }
                let line: Vec<(f64, f64)> = line.collect();
                if line.len() <= 60 {
                    panel = panel.markers("", 0, line.clone());
                }
                picture.panel(panel.line("share", 0, line))
            }
        }
    }
}

fn unit(key: &str) -> &'static str {
    let last = key.rsplit('.').next().unwrap_or_default();
    super::schema::unit(key.split('.').next().unwrap_or_default(), last)
}

fn bounds(values: &[f64]) -> (f64, f64) {
    let low = values.iter().copied().fold(f64::INFINITY, f64::min);
    let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let half = if high > low { 0.0 } else { 0.5 };
    (low - half, high + half)
}

/// The most frequent word; of equally frequent ones the first.
fn most_frequent<'a>(names: impl Iterator<Item = &'a str>) -> String {
    let counts = counted(names);
    // Of equal ones `max_by_key` takes the last.
    let entry = counts.iter().rev().max_by_key(|(_, count)| *count);
    entry.map_or(String::new(), |(name, _)| (*name).into())
}
