//! Speed over k or b: measured, in closed form, and its sensitivity to the amplitude.

use kband::impact::{Growth, Kernel, Map, Tangential};
use kband::regime::classify::Regime;
use kband::regime::{Lock, band};
use kband::transport::{Sensitivity, Spread, Start, locked, measure, stationary};
use serde_json::json;

use super::{Arguments, Computed, Feeder, ORDERS, effort, starts};
use crate::arguments::Range;
use crate::desk::Desk;
use crate::ending::{self, Endings, TONES};
use crate::picture::{Axis, Panel, Picture, Tone, Unit};
use crate::refusal::Refusal;
use crate::report::{Column, Report, Table, Value, number};

/// The regime as rows and pictures name it: how many cycles a hop and rest takes does not matter here.
fn named(regime: Regime) -> String {
    match regime {
        Regime::HopAndRest { .. } => "hops and rests".into(),
        other => ending::name(other),
    }
}

/// Regimes whose speeds are one row: all that hop and rest.
fn alike(one: Regime, other: Regime) -> bool {
    matches!((one, other), (Regime::HopAndRest { .. }, Regime::HopAndRest { .. })) || one == other
}

/// Regimes whose sensitivity is one number: locks of one order, and one kind of any other.
fn kin(one: Regime, other: Regime) -> bool {
    match (one, other) {
        (Regime::Locked { .. }, _) | (_, Regime::Locked { .. }) => one == other,
        _ => ending::tone(one) == ending::tone(other),
    }
}

/// One orbit: its regime and its means in units of `b w`.
#[derive(Clone, Copy, Debug)]
struct Run {
    regime: Regime,
    time_mean: f64,
    impact_mean: Option<f64>,
    interval: Option<f64>,
    exponent: Option<f64>,
}

/// A regime reached at one k.
#[derive(Clone, Debug)]
struct Row {
    k: f64,
    regime: Regime,
    starts: usize,
    from_rest: bool,
    time_mean: Spread,
    impact_mean: Spread,
    interval: Spread,
    exponent: Spread,
    sensitivity: Option<Sensitivity>,
}

impl Row {
    /// Time mean in `b w`; 0 at rest.
    fn mean(&self) -> f64 {
        self.time_mean.mean().unwrap_or(0.0)
    }

    /// Standard error of the time mean, 0 for a periodic regime that one start reached.
    fn error(&self) -> f64 {
        self.time_mean.error().unwrap_or(0.0)
    }
}

pub(super) fn computed(
    feeder: Feeder,
    arguments: &Arguments,
    desk: &Desk,
) -> Result<Computed, Refusal> {
    let over = Over::of(&feeder, arguments)?;
    let rows = rows(&feeder, arguments, &over, desk)?;
    let report = report(&feeder, arguments, &over, &rows, &fits(&over, &rows))?;
    Ok((report, Box::new(move || picture(&feeder, &over, &rows))))
}

/// The values of k that are computed and which of them are shown.
struct Over {
    amplitude: bool,
    low: f64,
    high: f64,
    /// In the order of the horizontal axis.
    k: Vec<f64>,
    shown: std::ops::Range<usize>,
}

impl Over {
    fn of(feeder: &Feeder, arguments: &Arguments) -> Result<Self, Refusal> {
        let amplitude = arguments.b.is_some();
        let given = arguments.k.or(arguments.b);
        let range = match given {
            Some(range) => range,
            None => Range {
                low: 0.02,
                high: 1.1 * band::birth(feeder.restitution, 1)?,
                count: 121,
            },
        };
        let mut values: Vec<f64> = range.values().collect();
        if given.is_none() {
            // Regimes crowd towards small k: equal ratios.
            let ratio = (range.high / range.low).ln();
            let last = (values.len() - 1) as f64;
            for (n, value) in values.iter_mut().enumerate() {
                *value = range.low * (ratio * n as f64 / last).exp();
            }
        }
        // A single value needs neighbours for its sensitivity.
        let shown = if values.len() == 1 {
            let only = values[0];
            values = vec![only * 0.95, only, only * 1.05];
            1..2
        } else {
            0..values.len()
        };
        let k: Vec<f64> = values
            .iter()
            .map(|value| if amplitude { feeder.track.k(1e-3 * value) } else { *value })
            .collect();
        for k in &k {
            Map::build(*k, feeder.restitution)?;
        }
        Ok(Self { amplitude, low: range.low, high: range.high, k, shown })
    }

    fn place(&self, feeder: &Feeder, k: f64) -> f64 {
        if self.amplitude { feeder.amplitude(k) } else { k }
    }

    fn axis(&self) -> Axis {
        let axis = if self.amplitude {
            Axis::new("amplitude b normal to the track", Unit::MILLIMETRES, self.low, self.high)
        } else {
            Axis::new("k = g cos α / (b ω²)", Unit::NONE, self.low, self.high)
        };
        if self.high > 4.0 * self.low { axis.logarithmic() } else { axis }
    }

    fn words(&self) -> String {
        let name = if self.amplitude { "b" } else { "k" };
        let unit = if self.amplitude { " mm" } else { "" };
        let (low, high) = (number(self.low, 6), number(self.high, 6));
        if low == high { format!("{name} = {low}{unit}") } else { format!("{name} = {low}..{high}{unit}") }
    }
}

fn rows(
    feeder: &Feeder,
    arguments: &Arguments,
    over: &Over,
    desk: &Desk,
) -> Result<Vec<Row>, Refusal> {
    let mut tasks: Vec<(usize, Start)> = Vec::new();
    for (n, k) in over.k.iter().enumerate() {
        let starts = starts(*k, feeder.restitution, arguments.starts);
        tasks.extend(starts.into_iter().map(|start| (n, start)));
    }
    let impacts = arguments.settle + arguments.impacts;
    let endings = desk.try_map("regimes", over.k.len(), |n| {
        Endings::new(over.k[n], feeder.restitution, impacts)
    })?;
    let runs = desk.try_map("conveying", tasks.len(), |task| {
        let (n, start) = tasks[task];
        measured(feeder, over.k[n], &endings[n], start, arguments)
    })?;
    let mut rows: Vec<Row> = Vec::new();
    let mut first = 0;
    for (n, k) in over.k.iter().enumerate() {
        let last = tasks[first..].iter().take_while(|task| task.0 == n).count() + first;
        rows.extend(grouped(*k, &tasks[first..last], &runs[first..last]));
        first = last;
    }
    let sensitivities: Vec<Option<Sensitivity>> =
        rows.iter().map(|row| sensitivity(over, &rows, row)).collect();
    for (row, sensitivity) in rows.iter_mut().zip(sensitivities) {
        row.sensitivity = sensitivity;
    }
    let shown = &over.k[over.shown.clone()];
    rows.retain(|row| shown.contains(&row.k));
    Ok(rows)
}

fn measured(
    feeder: &Feeder,
    k: f64,
    endings: &Endings,
    start: Start,
    arguments: &Arguments,
) -> Result<Run, Refusal> {
    let map = Map::build(k, feeder.restitution)?;
    let tangential = Tangential::build(k, feeder.settings)?;
    let regime = match start {
        Start::Rest => endings.from_rest(),
        Start::Hop(state) => endings.of(state),
    };
    // Every part that rests forgets how it started; from rest the period is measured without the way to it.
    let start = match regime {
        Regime::HopAndRest { .. } => Start::Rest,
        _ => start,
    };
    let mut growth = Growth::new(&map);
    let conveyed = measure(&map, tangential, start, effort(arguments), &mut growth).conveyed;
    let hops = conveyed.rests == 0;
    Ok(Run {
        regime,
        time_mean: conveyed.time_mean().unwrap_or(0.0),
        impact_mean: conveyed.impact_mean(),
        interval: conveyed.mean_interval(),
        exponent: growth.exponents().map(|[largest, _]| largest).filter(|_| hops),
    })
}

fn grouped(k: f64, tasks: &[(usize, Start)], runs: &[Run]) -> Vec<Row> {
    let mut regimes: Vec<Regime> = Vec::new();
    for run in runs {
        if !regimes.iter().any(|known| alike(*known, run.regime)) {
            regimes.push(run.regime);
        }
    }
    regimes
        .into_iter()
        .map(|regime| {
            let of = || runs.iter().filter(move |run| alike(run.regime, regime));
            Row {
                k,
                regime,
                starts: of().count(),
                from_rest: tasks
                    .iter()
                    .zip(runs)
                    .any(|(task, run)| task.1 == Start::Rest && alike(run.regime, regime)),
                time_mean: Spread::of(of().map(|run| run.time_mean)),
                impact_mean: Spread::of(of().filter_map(|run| run.impact_mean)),
                interval: Spread::of(of().filter_map(|run| run.interval)),
                exponent: Spread::of(of().filter_map(|run| run.exponent)),
                sensitivity: None,
            }
        })
        .collect()
}

/// From the same regime at the neighbouring values of k, both of them where they have it.
fn sensitivity(over: &Over, rows: &[Row], row: &Row) -> Option<Sensitivity> {
    let at = over.k.iter().position(|k| *k == row.k)?;
    let find = |n: usize| {
        let k = *over.k.get(n)?;
        let found = rows.iter().find(|other| other.k == k && alike(other.regime, row.regime))?;
        Some((k, found.mean(), found.error()))
    };
    let here = (row.k, row.mean(), row.error());
    let before = at.checked_sub(1).and_then(find).unwrap_or(here);
    let after = find(at + 1).unwrap_or(here);
    if before.0 < after.0 {
        Sensitivity::between(before, after)
    } else {
        Sensitivity::between(after, before)
    }
}

/// The sensitivity of a regime over its rows: the slope of ln V against ln b.
#[derive(Clone, Copy, Debug)]
struct Fit {
    regime: Regime,
    rows: usize,
    low: f64,
    high: f64,
    slope: f64,
    error: f64,
}

fn fits(over: &Over, rows: &[Row]) -> Vec<Fit> {
    let mut regimes: Vec<Regime> = Vec::new();
    for row in rows {
        if !regimes.iter().any(|known| kin(*known, row.regime)) {
            regimes.push(row.regime);
        }
    }
    regimes.sort_by_key(|regime| match regime {
        Regime::Locked { order } => *order,
        _ => u32::MAX,
    });
    regimes
        .into_iter()
        .filter_map(|regime| fit(regime, over, rows))
        .collect()
}

/// What a fit stands for.
fn kind(regime: Regime) -> String {
    let tone = ending::tone(regime);
    match regime {
        Regime::Locked { .. } => ending::name(regime),
        _ => TONES
            .iter()
            .find(|known| known.0 == tone)
            .map_or_else(String::new, |known| known.1.into()),
    }
}

/// Whether a regime at one k is the same orbit, or the same chaos, as at the k beside it.
fn continues(one: Regime, other: Regime) -> bool {
    match (one, other) {
        (Regime::Doubled { order: a, .. }, Regime::Doubled { order: b, .. }) => a == b,
        (
            Regime::Periodic { impacts: p, cycles: r },
            Regime::Periodic { impacts: q, cycles: s },
        ) => u64::from(r) * u64::from(q) == u64::from(s) * u64::from(p),
        _ => kin(one, other),
    }
}

/// One slope for all stretches of neighbouring k in which the regime goes on; each stretch has a level
/// of its own, as locks and what grows out of them have.
fn fit(regime: Regime, over: &Over, rows: &[Row]) -> Option<Fit> {
    let mut stretches: Vec<(usize, Vec<&Row>)> = Vec::new();
    for (n, k) in over.k.iter().enumerate() {
        for row in rows.iter().filter(|row| row.k == *k && kin(row.regime, regime) && row.mean() > 0.0) {
            let open = stretches.iter_mut().find(|(last, stretch)| {
                last + 1 == n && stretch.last().is_some_and(|before| continues(before.regime, row.regime))
            });
            match open {
                Some((last, stretch)) => {
                    *last = n;
                    stretch.push(row);
                }
                None => stretches.push((n, vec![row])),
            }
        }
    }
    stretches.retain(|(_, stretch)| stretch.len() > 1);
    let (mut squares, mut products, mut heights) = (0.0, 0.0, 0.0);
    for (_, stretch) in &stretches {
        let count = stretch.len() as f64;
        let points = || stretch.iter().map(|row| (-row.k.ln(), (row.mean() / row.k).ln()));
        let (x, y) = points().fold((0.0, 0.0), |sum, point| (sum.0 + point.0 / count, sum.1 + point.1 / count));
        for point in points() {
            let (dx, dy) = (point.0 - x, point.1 - y);
            squares += dx * dx;
            products += dx * dy;
            heights += dy * dy;
        }
    }
    let used: usize = stretches.iter().map(|(_, stretch)| stretch.len()).sum();
    let free = used.checked_sub(stretches.len() + 1).filter(|free| *free > 0)?;
    let slope = products / squares;
    let k = stretches.iter().flat_map(|(_, stretch)| stretch).map(|row| row.k);
    Some(Fit {
        regime,
        rows: used,
        low: k.clone().fold(f64::INFINITY, f64::min),
        high: k.fold(0.0, f64::max),
        slope,
        error: ((heights - slope * products).max(0.0) / free as f64 / squares).sqrt(),
    })
}

fn closed_form(feeder: &Feeder, row: &Row) -> Option<f64> {
    match row.regime {
        Regime::Locked { order } => {
            let lock = Lock::at(row.k, feeder.restitution, order).ok().flatten()?;
            Some(locked::velocity(&lock, row.k, &feeder.settings))
        }
        Regime::Doubled { .. } | Regime::Periodic { .. } | Regime::Chaotic => {
            stationary::impact_mean(row.k, feeder.restitution, &feeder.settings, row.interval.mean()?)
        }
        Regime::HopAndRest { .. } | Regime::Rest | Regime::Undecided => None,
    }
}

fn bound(feeder: &Feeder) -> Option<f64> {
    (feeder.settings.phase_lead == 0.0)
        .then(|| locked::bound(feeder.restitution, &feeder.settings))
}

fn report(
    feeder: &Feeder,
    arguments: &Arguments,
    over: &Over,
    rows: &[Row],
    fits: &[Fit],
) -> Result<Report, Refusal> {
    let mut columns = vec![
        Column::new("k", ""),
        Column::new("b", "mm").digits(5),
        Column::new("regime", ""),
        Column::new("starts", ""),
        Column::new("from_rest", ""),
        Column::new("speed", "mm/s").digits(5),
        Column::new("speed_error", "mm/s").digits(2),
        Column::new("impact_mean", "mm/s").digits(5),
        Column::new("closed_form", "mm/s").digits(5),
        Column::new("bound", "mm/s").digits(4),
        Column::new("interval", "cycles").digits(5),
        Column::new("exponent", "").digits(3),
        Column::new("sensitivity", "").digits(3),
        Column::new("sensitivity_error", "").digits(2),
    ];
    if arguments.part_length.is_some() {
        columns.push(Column::new("parts_per_hour", "").digits(4));
    }
    let mut table = Table::new(&columns);
    for row in rows {
        let unit = feeder.velocity_unit(row.k);
        let speed = row.mean() * unit;
        let mut cells: Vec<Value> = vec![
            row.k.into(),
            feeder.amplitude(row.k).into(),
            named(row.regime).into(),
            row.starts.into(),
            row.from_rest.into(),
            speed.into(),
            row.time_mean.error().map(|error| error * unit).into(),
            row.impact_mean.mean().map(|mean| mean * unit).into(),
            closed_form(feeder, row).map(|velocity| velocity * unit).into(),
            bound(feeder).map(|velocity| velocity * unit).into(),
            row.interval.mean().map(|mean| mean / std::f64::consts::TAU).into(),
            row.exponent.mean().into(),
            row.sensitivity.map(|found| found.value).into(),
            row.sensitivity.map(|found| found.error).into(),
        ];
        if let Some(length) = arguments.part_length {
            cells.push((speed / length * 3600.0).max(0.0).into());
        }
        table.push_row(cells);
    }
    let shown: Vec<_> = rows.iter().map(|row| row_json(feeder, arguments, row)).collect();
    let regimes: Vec<_> = fits
        .iter()
        .map(|fit| {
            json!({
                "regime": kind(fit.regime), "rows": fit.rows, "k_low": fit.low, "k_high": fit.high,
                "sensitivity": fit.slope, "sensitivity_error": fit.error,
            })
        })
        .collect();
    let critical = critical_slope(feeder);
    let mut report = Report::new(table).heading(format!(
        "Conveying speed at {}; {}",
        over.words(),
        feeder.words()
    ));
    for fit in fits {
        report = report.note(format!(
            "{}: (dV/V)/(db/b) = {:.3} ± {:.3} over k = {}..{} ({} values)",
            kind(fit.regime),
            // No minus sign before a zero.
            if fit.slope.abs() < 5e-4 { 0.0 } else { fit.slope },
            fit.error,
            number(fit.low, 4),
            number(fit.high, 4),
            fit.rows
        ));
    }
    if let Some(chaos) = fits.iter().find(|fit| fit.regime == Regime::Chaotic) {
        report = report.note(if chaos.slope > 0.5 {
            "chaos does not make the speed insensitive to the amplitude; a lock does"
        } else {
            "chaos beside a band keeps the mean interval of its lock, and so its speed; wide chaos (R = 0.9, k \
             below 0.2) grows with the amplitude"
        });
    }
    if let Some(tangent) = critical {
        report = report.note(format!(
            "locked parts stand still on an incline of {:.2}° (equation 22)",
            tangent.atan().to_degrees()
        ));
    }
    report.json(&json!({
        "rows": shown,
        "regimes": regimes,
        "critical_slope": critical.map(|tangent| tangent.atan().to_degrees()),
        "bound": bound(feeder),
    }))
}

fn row_json(feeder: &Feeder, arguments: &Arguments, row: &Row) -> serde_json::Value {
    let unit = feeder.velocity_unit(row.k);
    let speed = row.mean() * unit;
    json!({
        "k": row.k,
        "b": feeder.amplitude(row.k),
        "regime": named(row.regime),
        "starts": row.starts,
        "from_rest": row.from_rest,
        "speed": speed,
        "speed_error": row.time_mean.error().map(|error| error * unit),
        "impact_mean": row.impact_mean.mean().map(|mean| mean * unit),
        "time_mean_dimensionless": row.mean(),
        "impact_mean_dimensionless": row.impact_mean.mean(),
        "closed_form": closed_form(feeder, row).map(|velocity| velocity * unit),
        "bound": bound(feeder).map(|velocity| velocity * unit),
        "interval": row.interval.mean().map(|mean| mean / std::f64::consts::TAU),
        "exponent": row.exponent.mean(),
        "sensitivity": row.sensitivity.map(|found| found.value),
        "sensitivity_error": row.sensitivity.map(|found| found.error),
        "parts_per_hour": arguments.part_length.map(|length| (speed / length * 3600.0).max(0.0)),
    })
}

fn critical_slope(feeder: &Feeder) -> Option<f64> {
    (feeder.settings.phase_lead == 0.0)
        .then(|| locked::critical_slope_in_phase(feeder.restitution, &feeder.settings))
}

fn picture(feeder: &Feeder, over: &Over, rows: &[Row]) -> Picture {
    let speed = |row: &Row| row.mean() * feeder.velocity_unit(row.k);
    let place = |k: f64| over.place(feeder, k);
    let highest = rows.iter().map(speed).fold(0.0, f64::max);
    let lowest = rows.iter().map(speed).fold(0.0, f64::min);
    let room = 0.15 * (highest - lowest).max(1e-9);
    let slowest = rows.iter().map(speed).filter(|speed| *speed > 0.0).fold(highest, f64::min);
    let axis = |low: f64, high: f64| Axis::new("conveying speed", Unit::MILLIMETRES_A_SECOND, low, high);
    // Double logarithmic, a speed that grows like b is a straight line and a locked one is level.
    let up = if lowest < 0.0 || highest <= 0.0 {
        axis(lowest - room, highest + room)
    } else if highest > 3.0 * slowest {
        axis(0.7 * slowest, 1.4 * highest).logarithmic()
    } else {
        axis(0.0, highest + room)
    };
    let mut panel = Panel::new(over.axis(), up).height(340.0).heading(
        "Time mean of the speed, measured (markers) and in closed form (lines)",
    );
    let (first, last) = (place(over.k[over.shown.start]), place(over.k[over.shown.end - 1]));
    let mut covered: Vec<(f64, f64)> = Vec::new();
    for order in ORDERS {
        let edges = (
            band::flip(feeder.restitution, order),
            band::first_return_edge(feeder.restitution, order),
        );
        let (Ok(flip), Ok(birth)) = edges else { continue };
        let (left, right) = (place(flip).min(place(birth)), place(flip).max(place(birth)));
        let (left, right) = (left.max(over.low), right.min(over.high));
        let apart = covered.iter().all(|other| right < other.0 || left > other.1);
        if order <= 3 && left < right && apart {
            panel = panel
                .strip("bands of the locks", left, right)
                .caption(0.5 * (left + right), format!("r={order}"));
            covered.push((left, right));
        }
    }
    let smooth = |line: &dyn Fn(f64) -> Option<f64>| -> Vec<(f64, f64)> {
        (0..=600)
            .map(|n| {
                let part = f64::from(n) / 600.0;
                let at = first * (last / first).powf(part);
                let k = if over.amplitude { feeder.track.k(1e-3 * at) } else { at };
                (at, line(k).map_or(f64::NAN, |velocity| velocity * feeder.velocity_unit(k)))
            })
            .collect()
    };
    let lock = |order: u32| {
        smooth(&|k| {
            let lock = Lock::at(k, feeder.restitution, order).ok().flatten()?;
            lock.attracts().then(|| locked::velocity(&lock, k, &feeder.settings))
        })
    };
    for order in ORDERS {
        let name = if order == 1 { "locked, equation 20" } else { "" };
        panel = panel.line(name, 0, lock(order));
    }
    if let Some(bound) = bound(feeder) {
        panel = panel.line("bound of the impact mean, equation 37", 1, smooth(&|_| Some(bound)));
    }
    let names = &TONES[..6];
    let measured = rows.iter().map(|row| (place(row.k), speed(row), row.regime)).collect();
    panel = marked(panel, measured).ribbon(ribbon(over, rows, &place), names);
    let answers = rows
        .iter()
        .filter_map(|row| Some((place(row.k), row.sensitivity?, row.regime)))
        .filter(|(_, found, _)| found.error < 0.5 && (-1.0..=3.0).contains(&found.value))
        .map(|(at, found, regime)| (at, found.value, regime))
        .collect();
    let below = Panel::new(
        over.axis(),
        Axis::new("(dV/V) / (db/b)", Unit::NONE, -1.0, 3.0),
    )
    .height(200.0)
    .heading("Sensitivity of the speed to the amplitude")
    .level(0.0, "does not feel b")
    .level(1.0, "grows like b");
    let below = marked(below, answers);
    Picture::new("Conveying speed in every regime")
        .caption(feeder.words())
        .panel(panel)
        .panel(below)
}

/// The points as markers by the tone of their regime.
fn marked(mut panel: Panel, points: Vec<(f64, f64, Regime)>) -> Panel {
    for (series, (tone, name)) in TONES[..5].iter().enumerate() {
        let of: Vec<(f64, f64)> = points
            .iter()
            .filter(|point| ending::tone(point.2) == *tone)
            .map(|point| (point.0, point.1))
            .collect();
        if !of.is_empty() {
            panel = panel.markers(name, series, of);
        }
    }
    panel
}

/// The regime of a part from rest, from half way to the left neighbour to half way to the right one.
fn ribbon(over: &Over, rows: &[Row], place: &dyn Fn(f64) -> f64) -> Vec<(f64, f64, Tone)> {
    let found: Vec<(f64, Tone)> = rows
        .iter()
        .filter(|row| row.from_rest)
        .map(|row| (place(row.k), ending::tone(row.regime)))
        .collect();
    let middle = |n: usize| 0.5 * (found[n].0 + found[n + 1].0);
    let mut stretches: Vec<(f64, f64, Tone)> = Vec::new();
    for (n, (_, tone)) in found.iter().enumerate() {
        let left = if n == 0 { over.low } else { middle(n - 1) };
        let right = if n + 1 == found.len() { over.high } else { middle(n) };
        match stretches.last_mut() {
            Some(last) if last.2 == *tone => last.1 = right,
            _ => stretches.push((left, right, *tone)),
        }
    }
    stretches
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        arguments: Arguments,
    }

    fn rows_of(line: &str, threads: usize) -> (Feeder, Over, Vec<Row>) {
        let words = std::iter::once("transport").chain(line.split_whitespace());
        let arguments = Line::parse_from(words).arguments;
        let feeder = Feeder::build(&arguments).unwrap();
        let over = Over::of(&feeder, &arguments).unwrap();
        let desk = Desk::new(Some(threads)).unwrap();
        let rows = rows(&feeder, &arguments, &over, &desk).unwrap();
        (feeder, over, rows)
    }

    #[test]
    fn the_same_bits_for_any_number_of_threads() {
        let line = "--restitution 0.9 --k 0.05..0.07:3 --impacts 300 --settle 100";
        let (_, _, one) = rows_of(line, 1);
        let (_, _, three) = rows_of(line, 3);
        // Debug prints every f64 so that it reads back to the same bits.
        assert_eq!(format!("{one:?}"), format!("{three:?}"));
    }

    #[test]
    fn a_lock_is_found_fast_or_slow_from_rest_or_not_and_does_not_feel_the_amplitude() {
        let line = "--restitution 0.2 --k 0.40..0.44:3 --impacts 400 --settle 400";
        let (feeder, _, rows) = rows_of(line, 2);
        let locked: Vec<&Row> =
            rows.iter().filter(|row| row.regime == (Regime::Locked { order: 1 })).collect();
        assert_eq!(locked.len(), 3);
        for row in &locked {
            let closed = closed_form(&feeder, row).unwrap();
            assert!((row.mean() - closed).abs() < 1e-9);
            assert!(row.sensitivity.unwrap().value.abs() < 1e-6);
            assert!((row.interval.mean().unwrap() - std::f64::consts::TAU).abs() < 1e-9);
        }
        // Physics, section 7: from rest the part locks below k = 0.4117 and never above 0.4183.
        let from_rest: Vec<bool> = locked.iter().map(|row| row.from_rest).collect();
        assert_eq!(from_rest, [true, false, false]);
        let speeds: Vec<f64> =
            locked.iter().map(|row| row.mean() * feeder.velocity_unit(row.k)).collect();
        assert!((speeds[0] - speeds[2]).abs() < 1e-9 * speeds[0], "{speeds:?}");
    }

    #[test]
    fn wide_chaos_grows_like_the_amplitude_and_a_single_k_has_a_sensitivity() {
        let line = "--restitution 0.9 --k 0.03..0.08:6 --amplitude-ratio 2 --impacts 2500 --settle 300";
        let (_, over, rows) = rows_of(line, 2);
        let fit = fit(Regime::Chaotic, &over, &rows).unwrap();
        // Six values of k, each the mean of 13 runs; the soak found 1.000 +- 0.002.
        assert!((fit.slope - 1.0).abs() < 6.0 * fit.error.max(0.01), "{fit:?}");
        let (_, _, single) = rows_of("--restitution 0.2 --k 0.43 --impacts 300", 2);
        let locked = single.iter().find(|row| row.regime == (Regime::Locked { order: 1 })).unwrap();
        assert!(locked.sensitivity.unwrap().value.abs() < 1e-6);
        assert!(single.iter().all(|row| row.k == 0.43));
    }
}
