//! `kband diagram`: the bifurcation diagram.

use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::io::Write;
use std::sync::Arc;

use clap::ValueEnum;
use kband::feeder::{STANDARD_GRAVITY, Track, TrackSettings};
use kband::impact::{Event, Kernel, Map, Orbit, State};
use kband::regime::Lock;
use kband::regime::classify::Regime;
use serde::Serialize;

use crate::arguments::{self, Drawn, Printed, Range};
use crate::desk::Desk;
use crate::ending::{self, Endings, TONES};
use crate::picture::{Axis, Panel, Picture, Tone, Unit};
use crate::refusal::{Exit, Refusal};
use crate::report::{Column, Report, Table, number};

/// The regimes over k, over the amplitude or over restitution, from rest and followed both ways.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  kband diagram --restitution 0.2 --out diagram.svg
  kband diagram --restitution 0.5 --k 0.56..0.7 --show velocity --out diagram.png
  kband diagram --restitution 0.2 --b 0.2..0.28 --frequency 50 --incline 3 --out diagram.svg
  kband diagram --k 0.43 --restitution 0.1..0.5 --out points.csv

One of --k, --b, --restitution is a range LO..HI or LO..HI:N (else N = 1000 columns). The table and
JSON say what each start gives where; CSV has every impact.")]
pub struct Arguments {
    /// Restitution of the part, one value or a range.
    #[arg(long, value_name = "R", default_value = "0.2",
          value_parser = arguments::range_or_value((0.0, 0.999), 1000))]
    restitution: Range,

    /// k = g cos(alpha) / (b w^2), one value or a range [default: around the first band].
    #[arg(long, value_parser = arguments::range_or_value((0.001, 1000.0), 1000), conflicts_with = "b")]
    k: Option<Range>,

    /// Amplitude of the track normal to itself in mm, one value or a range.
    #[arg(long, value_name = "MM", value_parser = arguments::range_or_value((1e-6, 1e3), 1000))]
    b: Option<Range>,

    /// Drive frequency in Hz, for --b.
    #[arg(long, value_name = "HZ", default_value = "50",
          value_parser = arguments::within(1.0, 1000.0, "Hz"))]
    frequency: f64,

    /// Incline of the track in degrees, for --b.
    #[arg(long, value_name = "DEG", default_value = "3",
          value_parser = arguments::within(-60.0, 60.0, "degrees"))]
    incline: f64,

    /// What is drawn upwards.
    #[arg(long, value_enum, default_value_t = Show::Phase)]
    show: Show,

    /// How the parts start, one panel each.
    #[arg(long, value_enum, value_delimiter = ',', default_values_t = [Start::Rest, Start::Up, Start::Down])]
    starts: Vec<Start>,

    /// Impacts drawn in each column.
    #[arg(long, value_name = "N", default_value = "1000", value_parser = arguments::count(1, 1_000_000))]
    impacts: usize,

    /// Impacts in each column before the first that is drawn.
    #[arg(long, value_name = "N", default_value = "500", value_parser = arguments::count(0, 10_000_000))]
    settle: usize,

    #[command(flatten)]
    printed: Printed,

    #[command(flatten)]
    drawn: Drawn,
}

/// What is drawn upwards.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Show {
    /// Phase of the drive at impact.
    Phase,
    /// Velocity after impact.
    Velocity,
}

/// How parts start.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Start {
    /// From rest, in each column anew.
    Rest,
    /// From where the column to the left ended: following upwards.
    Up,
    /// From where the column to the right ended: following downwards.
    Down,
}

impl Branch {
    /// The stretches of one ending, as first and last column.
    fn regimes(&self) -> Vec<(usize, usize, Regime)> {
        let mut regimes: Vec<(usize, usize, Regime)> = Vec::new();
        for (n, column) in self.columns.iter().enumerate() {
            match regimes.last_mut() {
                Some((_, last, ending)) if *ending == column.ending => *last = n,
                _ => regimes.push((n, n, column.ending)),
            }
        }
        regimes
    }
}

impl Start {
    fn name(self) -> &'static str {
        match self {
            Self::Rest => "rest",
            Self::Up => "up",
            Self::Down => "down",
        }
    }

    fn words(self) -> &'static str {
        match self {
            Self::Rest => "from rest in each column",
            Self::Up => "followed to the right, each column from where the one before it ended",
            Self::Down => "followed to the left",
        }
    }
}

/// What the columns stand for.
#[derive(Clone, Copy, Debug)]
enum Over {
    K { restitution: f64 },
    Amplitude { restitution: f64, track: Track },
    Restitution { k: f64 },
}

impl Over {
    /// k and restitution of the column at `x`.
    fn at(self, x: f64) -> (f64, f64) {
        match self {
            Self::K { restitution } => (x, restitution),
            Self::Amplitude { restitution, track } => (track.k(x * 1e-3), restitution),
            Self::Restitution { k } => (k, x),
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::K { .. } => "k",
            Self::Amplitude { .. } => "b",
            Self::Restitution { .. } => "restitution",
        }
    }

    fn unit(self) -> &'static str {
        match self {
            Self::Amplitude { .. } => "mm",
            Self::K { .. } | Self::Restitution { .. } => "",
        }
    }

    fn axis(self, range: Range) -> Axis {
        let (label, unit) = match self {
            Self::K { .. } => ("k = g cos α / (b ω²)", Unit::NONE),
            Self::Amplitude { .. } => ("amplitude b normal to the track", Unit::MILLIMETRES),
            Self::Restitution { .. } => ("restitution R", Unit::NONE),
        };
        Axis::new(label, unit, range.low, range.high)
    }

    fn fixed(self) -> String {
        match self {
            Self::K { restitution } => format!("R = {}", number(restitution, 6)),
            Self::Amplitude { restitution, track } => format!(
                "R = {}, {} Hz, incline {}°",
                number(restitution, 6),
                number(track.frequency(), 6),
                number(track.incline().to_degrees(), 6)
            ),
            Self::Restitution { k } => format!("k = {}", number(k, 6)),
        }
    }
}

/// Draws the diagram.
pub fn run(arguments: &Arguments, desk: &Desk) -> Result<Exit, Refusal> {
    let output = arguments.drawn.output()?;
    let (over, range) = over(arguments)?;
    let values: Vec<f64> = range.values().collect();
    let maps: Vec<Map> = values
        .iter()
        .map(|x| {
            let (k, restitution) = over.at(*x);
            Map::build(k, restitution)
        })
        .collect::<Result<_, _>>()?;
    let mut starts = arguments.starts.clone();
    starts.dedup();
    let diagram = Arc::new(Diagram {
        over,
        range,
        show: arguments.show,
        branches: follow(arguments, &starts, &maps, desk)?,
        bands: bands(over, &values),
        values,
    });
    let report = diagram.report()?;
    report.print(arguments.printed.format)?;
    output.write(&report, || diagram.picture(arguments))?;
    Ok(Exit::Done)
}

/// Which of the three options is the range, and that range.
fn over(arguments: &Arguments) -> Result<(Over, Range), Refusal> {
    let restitution = arguments.restitution;
    let wide = |range: Range| range.count > 1;
    let ranges = "exactly one of --k, --b and --restitution as a range LO..HI";
    let refused = |given: String| {
        Refusal::value("the range", given, ranges, "for example --restitution 0.2 --k 0.3..0.5")
    };
    let track = Track::build(TrackSettings {
        frequency: arguments.frequency,
        incline: arguments.incline,
        amplitude_ratio: 0.0,
        phase_lead: 0.0,
        gravity: STANDARD_GRAVITY,
    })?;
    let single = restitution.low;
    match (arguments.k, arguments.b, wide(restitution)) {
        (Some(k), _, false) if wide(k) => Ok((Over::K { restitution: single }, k)),
        (Some(k), _, true) if !wide(k) => Ok((Over::Restitution { k: k.low }, restitution)),
        (_, Some(b), false) if wide(b) => {
            Ok((Over::Amplitude { restitution: single, track }, b))
        }
        (_, Some(b), true) if !wide(b) => {
            Ok((Over::Restitution { k: track.k(b.low * 1e-3) }, restitution))
        }
        (None, None, false) => {
            let low = kband::regime::band::flip(single, 1)?;
            let high = kband::regime::band::birth(single, 1)?;
            let range = Range {
                low: 0.8 * low,
                high: 1.05 * high,
                count: 1000,
            };
            Ok((Over::K { restitution: single }, range))
        }
        (k, b, _) => {
            let words = |name: &str, range: Option<Range>| {
                range.map(|range| {
                    let shown = if wide(range) { range.to_string() } else { range.low.to_string() };
                    format!("--{name} {shown}")
                })
            };
            let given = [words("k", k), words("b", b), words("restitution", Some(restitution))];
            Err(refused(given.into_iter().flatten().collect::<Vec<_>>().join(" ")))
        }
    }
}

/// The impacts of one start, column by column.
struct Branch {
    start: Start,
    columns: Vec<Struck>,
}

/// The impacts of one column, and what they are part of.
#[derive(Clone)]
struct Struck {
    impacts: Vec<State>,
    ending: Regime,
}

struct Diagram {
    over: Over,
    range: Range,
    show: Show,
    values: Vec<f64>,
    branches: Vec<Branch>,
    bands: Vec<Stretch>,
}

/// The stretch of columns where the period-1 orbit of an order attracts.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
struct Stretch {
    order: u32,
    low: f64,
    high: f64,
}

/// All branches: a followed one is one task, as each column needs the one before it; those from rest
/// are a task each column.
fn follow(
    arguments: &Arguments,
    starts: &[Start],
    maps: &[Map],
    desk: &Desk,
) -> Result<Vec<Branch>, Refusal> {
    let (settle, impacts) = (arguments.settle, arguments.impacts);
    let mut tasks: Vec<(Start, usize)> = Vec::new();
    for start in starts {
        if *start != Start::Rest {
            tasks.push((*start, 0));
        }
    }
    if starts.contains(&Start::Rest) {
        tasks.extend((0..maps.len()).map(|column| (Start::Rest, column)));
    }
    let endings: Vec<Endings> = maps
        .iter()
        .map(|map| Endings::new(map.k(), map.restitution(), 3000))
        .collect::<Result<_, _>>()?;
    let one = |column: usize, state: &mut Option<State>| {
        let endings = &endings[column];
        let impacts = column_of(&maps[column], state, settle, impacts);
        let ending = state.map_or(endings.from_rest(), |state| endings.of(state));
        Struck { impacts, ending }
    };
    let work = |task: usize| -> Result<Vec<Struck>, Refusal> {
        let (start, column) = tasks[task];
        let mut order: Vec<usize> = (0..maps.len()).collect();
        match start {
            Start::Rest => return Ok(vec![one(column, &mut None)]),
            Start::Up => {}
            Start::Down => order.reverse(),
        }
        let mut columns = Vec::with_capacity(maps.len());
        let mut state = None;
        for column in &order {
            desk.go_on()?;
            columns.push(one(*column, &mut state));
        }
        if start == Start::Down {
            columns.reverse();
        }
        Ok(columns)
    };
    let results = desk.try_map("diagram", tasks.len(), work)?;
    let mut branches: Vec<Branch> = starts
        .iter()
        .map(|start| Branch {
            start: *start,
            columns: Vec::new(),
        })
        .collect();
    for ((start, _), columns) in tasks.iter().zip(results) {
        if let Some(branch) = branches.iter_mut().find(|branch| branch.start == *start) {
            branch.columns.extend(columns);
        }
    }
    Ok(branches)
}

/// The impacts of one column after `settle` others, from `state` or from rest where it is `None`;
/// `state` is left where they end, `None` where the part rests for ever.
fn column_of(map: &Map, state: &mut Option<State>, settle: usize, impacts: usize) -> Vec<State> {
    let orbit = match *state {
        Some(state) => Orbit::new(map, state),
        None => Orbit::from_rest(map),
    };
    let mut struck = Vec::with_capacity(impacts);
    let mut count = 0;
    for event in orbit {
        if let Event::Impact(impact) = event {
            count += 1;
            if count > settle {
                struck.push(impact.next);
            }
            if count >= settle + impacts {
                *state = Some(impact.next);
                return struck;
            }
        }
    }
    *state = None;
    struck
}

/// Where along the columns the period-1 orbits of the first orders attract, each edge located by
/// bisection between two columns.
fn bands(over: Over, values: &[f64]) -> Vec<Stretch> {
    let mut bands = Vec::new();
    for order in 1..=5 {
        let attracts = |x: f64| {
            let (k, restitution) = over.at(x);
            Lock::at(k, restitution, order)
                .ok()
                .flatten()
                .is_some_and(|lock| lock.attracts() && lock.is_first_return())
        };
        let edge = |inside: f64, outside: f64| {
            let (mut inside, mut outside) = (inside, outside);
            for _ in 0..60 {
                let middle = 0.5 * (inside + outside);
                if attracts(middle) { inside = middle } else { outside = middle }
            }
            inside
        };
        let mut begun: Option<f64> = None;
        for (n, x) in values.iter().enumerate() {
            match (attracts(*x), begun) {
                (true, None) => begun = Some(if n == 0 { *x } else { edge(*x, values[n - 1]) }),
                (false, Some(low)) => {
                    let high = edge(values[n - 1], *x);
                    bands.push(Stretch { order, low, high });
                    begun = None;
                }
                _ => {}
            }
        }
        if let (Some(low), Some(high)) = (begun, values.last()) {
            bands.push(Stretch { order, low, high: *high });
        }
    }
    bands
}

impl Diagram {
    fn report(self: &Arc<Self>) -> Result<Report, Refusal> {
        let mut table = Table::new(&[
            Column::new("start", ""),
            Column::new("from", self.over.unit()),
            Column::new("to", self.over.unit()),
            Column::new("regime", ""),
        ]);
        let mut left_out = 0;
        let mut listed = Vec::new();
        for branch in &self.branches {
            for (first, last, ending) in branch.regimes() {
                let (low, high) = (self.values[first], self.values[last]);
                listed.push(serde_json::json!({
                    "start": branch.start,
                    "from": low,
                    "to": high,
                    "regime": ending::name(ending),
                }));
                // Chaos is full of narrow windows; the table to read shows what is wider than them.
                if 100 * (last - first + 1) >= self.values.len() {
                    let start = branch.start.name();
                    table.push([start.into(), low.into(), high.into(), ending::name(ending).into()]);
                } else {
                    left_out += 1;
                }
            }
        }
        let drawn: usize = self
            .branches
            .iter()
            .flat_map(|branch| &branch.columns)
            .map(|column| column.impacts.len())
            .sum();
        let mut report = Report::new(table).heading(format!(
            "Regimes over {} = {}..{} ({} columns), {}",
            self.over.name(),
            number(self.range.low, 6),
            number(self.range.high, 6),
            self.range.count,
            self.over.fixed()
        ));
        if left_out > 0 {
            report = report.note(format!(
                "{left_out} narrower stretches are left out here; --format json has them"
            ));
        }
        for band in &self.bands {
            report = report.note(format!(
                "the period-1 orbit of order {} attracts from {} to {}",
                band.order,
                number(band.low, 6),
                number(band.high, 6)
            ));
        }
        let rows = Arc::clone(self);
        report
            .note(format!("{drawn} impacts; --out FILE.svg draws them, FILE.csv lists them"))
            .csv(move |out| rows.write_csv(out))
            .json(&serde_json::json!({
                "over": self.over.name(),
                "bands": self.bands,
                "regimes": listed,
            }))
    }

    fn write_csv(&self, out: &mut dyn Write) -> std::io::Result<()> {
        let unit = if matches!(self.over, Over::Amplitude { .. }) { " (mm)" } else { "" };
        writeln!(out, "start,{}{unit},phase (rad),velocity (b w)", self.over.name())?;
        for branch in &self.branches {
            let start = branch.start.name();
            for (x, column) in self.values.iter().zip(&branch.columns) {
                let x = number(*x, 17);
                for state in &column.impacts {
                    writeln!(out, "{start},{x},{:.16e},{:.16e}", state.phase, state.velocity)?;
                }
            }
        }
        Ok(())
    }

    fn shown(&self, state: State) -> f64 {
        match self.show {
            // Locked parts strike shortly after phase 0, chaotic ones on both sides of it.
            Show::Phase if state.phase > PI => state.phase - TAU,
            Show::Phase => state.phase,
            Show::Velocity => state.velocity,
        }
    }

    fn picture(&self, arguments: &Arguments) -> Picture {
        let states = || self.branches.iter().flat_map(|branch| branch.columns.iter().flat_map(|column| &column.impacts));
        let (low, high) = states()
            .map(|state| self.shown(*state))
            .fold((0.0, 0.1), |(low, high): (f64, f64), y| (low.min(y), high.max(y)));
        let room = 0.05 * (high - low);
        let y_axis = match self.show {
            Show::Phase => Axis::new(
                "impact phase t",
                Unit::RADIANS,
                (low - room).max(-PI),
                (high + room).min(PI),
            )
            .in_pi(),
            Show::Velocity => {
                Axis::new("velocity ψ after impact", Unit::VELOCITY, 0.0, high + room)
            }
        };
        let mut picture = Picture::new(format!(
            "Impact {} over {}",
            if self.show == Show::Phase { "phase" } else { "velocity" },
            match self.over {
                Over::K { .. } => "k",
                Over::Amplitude { .. } => "amplitude",
                Over::Restitution { .. } => "restitution",
            }
        ))
        .caption(format!(
            "{}; {} impacts in each of {} columns, after {} to settle",
            self.over.fixed(),
            arguments.impacts,
            self.range.count,
            arguments.settle
        ));
        let mut names = Vec::new();
        for (tone, name) in TONES {
            let mut columns = self.branches.iter().flat_map(|branch| &branch.columns);
            if columns.any(|column| ending::tone(column.ending) == tone) {
                names.push((tone, name));
            }
        }
        for (place, branch) in self.branches.iter().enumerate() {
            // One legend serves all panels.
            let named = |name: &'static str| if place == 0 { name } else { "" };
            let points = self
                .values
                .iter()
                .zip(&branch.columns)
                .flat_map(|(x, column)| column.impacts.iter().map(|state| (*x, self.shown(*state))))
                .collect();
            let mut panel = Panel::new(self.over.axis(self.range), y_axis.clone())
                .heading(branch.start.words())
                .height(if self.branches.len() == 1 { 420.0 } else { 240.0 });
            for band in &self.bands {
                panel = panel.strip(named("band: the period-1 orbit attracts"), band.low, band.high);
            }
            panel = panel.columns(named("impacts, few to many"), self.values.len(), points);
            panel = panel.ribbon(self.ribbon(branch), if place == 0 { &names } else { &[] });
            for order in 1..=5 {
                let [attracting, repelling] = self.period_one(order);
                panel = panel
                    .line(named("period-1 orbit, attracting"), 1, attracting)
                    .line(named("period-1 orbit, repelling"), 2, repelling);
            }
            for band in &self.bands {
                let middle = 0.5 * (band.low + band.high);
                panel = panel.caption(middle, format!("r = {}", band.order));
                for edge in [band.low, band.high] {
                    if self.range.low < edge && edge < self.range.high {
                        panel = panel.mark(edge, number(edge, 4));
                    }
                }
            }
            picture = picture.panel(panel);
        }
        picture
    }

    /// The regimes of a branch as a ribbon, each column as wide as the next.
    fn ribbon(&self, branch: &Branch) -> Vec<(f64, f64, Tone)> {
        let half = 0.5 * (self.range.high - self.range.low) / (self.values.len() - 1) as f64;
        let mut ribbon: Vec<(f64, f64, Tone)> = Vec::new();
        for (first, last, ending) in branch.regimes() {
            let (low, high) = (self.values[first] - half, self.values[last] + half);
            match ribbon.last_mut() {
                Some((_, end, tone)) if *tone == ending::tone(ending) => *end = high,
                _ => ribbon.push((low, high, ending::tone(ending))),
            }
        }
        ribbon
    }

    /// The period-1 branch of an order over the columns: where it attracts, and where it repels below
    /// its flip.
    fn period_one(&self, order: u32) -> [Vec<(f64, f64)>; 2] {
        if !self.bands.iter().any(|band| band.order == order) {
            return [Vec::new(), Vec::new()];
        }
        let on = |keep: &dyn Fn(&Lock) -> bool| {
            let point = |x: f64| {
                let (k, restitution) = self.over.at(x);
                let lock = Lock::at(k, restitution, order).ok().flatten();
                let shown = lock.filter(|lock| lock.is_first_return() && keep(lock));
                let y = shown.map_or(f64::NAN, |lock| self.shown(lock.state()));
                (x, y)
            };
            self.values.iter().map(|x| point(*x)).collect::<Vec<_>>()
        };
        let below_flip = |lock: &Lock| !lock.attracts() && lock.state().phase < FRAC_PI_2;
        [on(&Lock::attracts), on(&below_flip)]
    }
}
