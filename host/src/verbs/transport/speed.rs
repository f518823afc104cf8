//! Speed over k or b: measured, in closed form, and its sensitivity to the amplitude.

mod page;

use page::{picture, report};

use kband::impact::{Growth, Kernel, Map, Scatter, Tangential};
use kband::regime::band;
use kband::regime::classify::Regime;
use kband::transport::stationary::PhaseMeans;
use kband::transport::{Measured, Origin, SampleMean, Sensitivity, measure};

use super::{Arguments, Computed, Feeder, effort, starts};
use crate::arguments::Range;
use crate::desk::Desk;
use crate::ending::{self, Endings, FOLLOWED, Gears, InGear, TOGETHER};
use crate::picture::Axis;
use crate::refusal::Refusal;
use crate::report::number;

/// Drive cycles between rests from which on a part conveys as one that hops on.
const MIN_CYCLES_BETWEEN_RESTS: u32 = 100;

/// Whether a part rests rarely, or was not seen to rest while it hopped irregularly.
fn hops_on(regime: Regime) -> bool {
    match regime {
        Regime::HopAndRest { cycles } => cycles >= MIN_CYCLES_BETWEEN_RESTS,
        other => other == Regime::Undecided,
    }
}

/// Whether a regime at one k is the same orbit, or the same chaos, as at the k beside it.
fn continues(one: Regime, other: Regime) -> bool {
    match (one, other) {
        (Regime::Doubled { order: a, .. }, Regime::Doubled { order: b, .. }) => a == b,
        (
            Regime::Periodic {
                impacts: p,
                cycles: r,
            },
            Regime::Periodic {
                impacts: q,
                cycles: s,
            },
        ) => u64::from(r) * u64::from(q) == u64::from(s) * u64::from(p),
        (Regime::Locked { .. }, _) | (_, Regime::Locked { .. }) => one == other,
        _ if hops_on(one) || hops_on(other) => hops_on(one) && hops_on(other),
        _ => ending::fill(one) == ending::fill(other),
    }
}

/// One orbit: its regime and its means in units of `b w`.
#[derive(Clone, Copy, Debug)]
struct Run {
    regime: Regime,
    in_gear: Option<InGear>,
    time_mean: f64,
    impact_mean: Option<f64>,
    interval: Option<f64>,
    /// The impact mean by its closed form, from the phases of impact.
    stationary: Option<f64>,
    exponent: Option<f64>,
}

impl Run {
    /// Closed form and exponent are those of impacts in no time, without rests.
    fn of(
        feeder: &Feeder,
        regime: Regime,
        measured: &Measured,
        stationary: Option<f64>,
        exponent: Option<f64>,
    ) -> Self {
        let conveyed = &measured.conveyed;
        let known = conveyed.rests == 0 && feeder.contact.is_instant();
        Self {
            regime,
            in_gear: None,
            time_mean: conveyed.time_mean().unwrap_or(0.0),
            impact_mean: conveyed.impact_mean(),
            interval: conveyed.mean_interval(),
            stationary: stationary.filter(|_| known),
            exponent: exponent.filter(|_| known),
        }
    }
}

/// A regime reached at one k.
#[derive(Clone, Debug)]
struct Row {
    k: f64,
    regime: Regime,
    in_gear: Option<InGear>,
    starts: usize,
    from_rest: bool,
    time_mean: SampleMean,
    impact_mean: SampleMean,
    interval: SampleMean,
    stationary: SampleMean,
    exponent: SampleMean,
    sensitivity: Option<Sensitivity>,
}

impl Row {
    /// Its regime, or where restitution scatters the share of time in gear.
    fn named(&self) -> String {
        match self.in_gear {
            Some(gear) => gear.to_string(),
            None => ending::describe_regime(self.regime, FOLLOWED),
        }
    }

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
    let report = report(&feeder, arguments, &over, &rows)?;
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
            None => Range::new(0.02, 1.1 * band::birth(feeder.restitution, 1)?, 121),
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
        let mut shown = 0..values.len();
        // A single value needs neighbours for its sensitivity.
        if let [only] = values[..] {
            values = vec![only * 0.95, only, only * 1.05];
            shown = 1..2;
        }
        let k = if amplitude {
            let all = values.iter().map(|value| feeder.k_of(*value));
            all.collect::<Result<_, Refusal>>()?
        } else {
            values
        };
        Ok(Self {
            amplitude,
            low: range.low,
            high: range.high,
            k,
            shown,
        })
    }

    fn place(&self, feeder: &Feeder, k: f64) -> f64 {
        if self.amplitude {
            feeder.amplitude(k)
        } else {
            k
        }
    }

    fn axis(&self) -> Axis {
        let axis = if self.amplitude {
            Axis::of_b(self.low, self.high)
        } else {
            Axis::of_k(self.low, self.high)
        };
        if self.high > 4.0 * self.low {
            axis.logarithmic()
        } else {
            axis
        }
    }

    fn words(&self) -> String {
        let (name, unit) = if self.amplitude {
            ("b", " mm")
        } else {
            ("k", "")
        };
        let (low, high) = (number(self.low, 6), number(self.high, 6));
        if low == high {
            format!("{name} = {low}{unit}")
        } else {
            format!("{name} = {low}..{high}{unit}")
        }
    }
}

fn rows(
    feeder: &Feeder,
    arguments: &Arguments,
    over: &Over,
    desk: &Desk,
) -> Result<Vec<Row>, Refusal> {
    let mut tasks: Vec<(usize, Origin)> = Vec::new();
    for (n, k) in over.k.iter().enumerate() {
        let starts = starts(*k, feeder, arguments.starts);
        tasks.extend(starts.into_iter().map(|start| (n, start)));
    }
    // What scatters has no ending.
    let constant = match arguments.scatter.scatter {
        0.0 => over.k.len(),
        _ => 0,
    };
    let endings = desk.spread("regimes", constant, TOGETHER, |columns| {
        let tracks = columns.iter().map(|n| (over.k[*n], feeder.restitution));
        Endings::of_tracks(&tracks.collect::<Vec<_>>(), FOLLOWED, feeder.contact)
    })?;
    let runs = desk.try_map("conveying", tasks.len(), |task| {
        let (n, start) = tasks[task];
        match arguments.scatter.stream(feeder.restitution, task as u64)? {
            Some(scatter) => scattered(feeder, over.k[n], start, scatter, arguments),
            None => measured(feeder, over.k[n], &endings[n], start, arguments),
        }
    })?;
    let mut rows: Vec<Row> = Vec::new();
    let mut first = 0;
    for (n, k) in over.k.iter().enumerate() {
        let last = tasks[first..].iter().take_while(|task| task.0 == n).count() + first;
        rows.extend(grouped(*k, &tasks[first..last], &runs[first..last]));
        first = last;
    }
    let sensitivities = rows.iter().map(|row| sensitivity(over, &rows, row));
    let sensitivities: Vec<Option<Sensitivity>> = sensitivities.collect();
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
    start: Origin,
    arguments: &Arguments,
) -> Result<Run, Refusal> {
    let map = Map::build(k, feeder.restitution)?;
    let tangential = Tangential::build(k, feeder.settings)?;
    let regime = match start {
        Origin::Rest => endings.from_rest(),
        Origin::Hop(state) => endings.of(state),
    };
    // Every part that rests forgets how it started; from rest the period is measured without the
    // way to it.
    let start = match regime {
        Regime::HopAndRest { .. } if !hops_on(regime) => Origin::Rest,
        _ => start,
    };
    // A quarter of the shortest run, 100 impacts, turns the tangent.
    let mut growth = Growth::new(&map, 25.max(arguments.impacts as u64 / 40));
    let mut phases = PhaseMeans::default();
    let measured = measure(
        start.orbit(&map).with_contact(feeder.contact),
        tangential,
        effort(arguments),
        &mut (&mut growth, &mut phases),
    );
    let stationary = phases.impact_mean(k, feeder.restitution, &feeder.settings);
    Ok(Run::of(
        feeder,
        regime,
        &measured,
        stationary,
        growth.exponent(),
    ))
}

fn scattered(
    feeder: &Feeder,
    k: f64,
    start: Origin,
    scatter: Scatter,
    arguments: &Arguments,
) -> Result<Run, Refusal> {
    let map = Map::build(k, feeder.restitution)?;
    let tangential = Tangential::build(k, feeder.settings)?;
    let mut watched = Gears::watched()?;
    let mut phases = PhaseMeans::default();
    let orbit = start.orbit(&map).scattering(scatter)?;
    let measured = measure(
        orbit.with_contact(feeder.contact),
        tangential,
        effort(arguments),
        &mut (&mut watched, &mut phases),
    );
    let stationary = phases.impact_mean(k, feeder.restitution, &feeder.settings);
    Ok(Run {
        in_gear: watched.longest(),
        ..Run::of(feeder, Regime::Undecided, &measured, stationary, None)
    })
}

fn grouped(k: f64, tasks: &[(usize, Origin)], runs: &[Run]) -> Vec<Row> {
    let mut regimes: Vec<Regime> = Vec::new();
    for run in runs {
        if !regimes.contains(&run.regime) {
            regimes.push(run.regime);
        }
    }
    regimes
        .into_iter()
        .map(|regime| {
            let of = || runs.iter().filter(move |run| run.regime == regime);
            Row {
                k,
                regime,
                in_gear: InGear::together(of().map(|run| run.in_gear)),
                starts: of().count(),
                from_rest: (tasks.iter().zip(runs))
                    .any(|(task, run)| task.1 == Origin::Rest && run.regime == regime),
                time_mean: SampleMean::from_values(of().map(|run| run.time_mean)),
                impact_mean: SampleMean::from_values(of().filter_map(|run| run.impact_mean)),
                interval: SampleMean::from_values(of().filter_map(|run| run.interval)),
                stationary: SampleMean::from_values(of().filter_map(|run| run.stationary)),
                exponent: SampleMean::from_values(of().filter_map(|run| run.exponent)),
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
        let mut there = rows.iter().filter(|other| other.k == k);
        let found = there.find(|other| continues(other.regime, row.regime))?;
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

#[cfg(test)]
mod tests {
    use super::page::closed_form;
    use super::*;

    const ORDER_1: Regime = Regime::Locked { order: 1 };

    fn rows_of(line: &str) -> (Feeder, Over, Vec<Row>) {
        let arguments = super::super::read(line).unwrap();
        let feeder = Feeder::build(&arguments).unwrap();
        let over = Over::of(&feeder, &arguments).unwrap();
        let desk = Desk::new(Some(2)).unwrap();
        let rows = rows(&feeder, &arguments, &over, &desk).unwrap();
        (feeder, over, rows)
    }

    #[test]
    fn the_speed_in_lock_does_not_depend_on_the_amplitude() {
        let line = "--restitution 0.2 --k 0.40..0.44:3 --impacts 400 --settle 400";
        let (feeder, _, rows) = rows_of(line);
        let locked = rows.iter();
        let locked: Vec<&Row> = locked.filter(|row| row.regime == ORDER_1).collect();
        assert_eq!(locked.len(), 3);
        for row in &locked {
            let closed = closed_form(&feeder, row).unwrap();
            assert!((row.mean() - closed).abs() < 1e-9);
            assert!(row.sensitivity.unwrap().value.abs() < 1e-6);
            assert!((row.interval.mean().unwrap() - std::f64::consts::TAU).abs() < 1e-9);
        }
        // docs/theory-capture.md#t7.2: from rest the part locks below k = 0.41136 and never above
        // 0.4178.
        let from_rest: Vec<bool> = locked.iter().map(|row| row.from_rest).collect();
        assert_eq!(from_rest, [true, false, false]);
        let speed = |row: &Row| row.mean() * feeder.velocity_unit(row.k);
        let [first, last] = [0, 2].map(|n| speed(locked[n]));
        assert!((first - last).abs() < 1e-9 * first, "{first} {last}");
    }

    #[test]
    fn the_speed_in_wide_chaos_grows_like_the_amplitude() {
        let line =
            "--restitution 0.9 --k 0.03..0.08:6 --amplitude-ratio 2 --impacts 2500 --settle 300";
        let (_, over, rows) = rows_of(line);
        let irregular = |k: &f64| {
            rows.iter()
                .find(|row| row.k == *k && hops_on(row.regime))
                .map(|row| (*k, row.mean(), row.error()))
                .unwrap()
        };
        let ends = [over.k.last(), over.k.first()].map(|k| irregular(k.unwrap()));
        let found = Sensitivity::between(ends[1], ends[0]).unwrap();
        // Each the mean of 13 runs; the soak found 1.000 +- 0.002.
        assert!(
            (found.value - 1.0).abs() < 6.0 * found.error.max(0.01),
            "{found:?}"
        );
        let (_, _, single) = rows_of("--restitution 0.2 --k 0.43 --impacts 300");
        let locked = single.iter().find(|row| row.regime == ORDER_1).unwrap();
        assert!(locked.sensitivity.unwrap().value.abs() < 1e-6);
        assert!(single.iter().all(|row| row.k == 0.43));
    }
}
