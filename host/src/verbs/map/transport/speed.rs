//! Conveying speed over k or b: simulated, in closed form, and its sensitivity to the amplitude.

mod page;

use page::{picture, report};

use kband::impact::{Growth, Kernel, Map, Scatter, Tangential};
use kband::regime::band;
use kband::regime::classify::Regime;
use kband::transport::stationary::PhaseMeans;
use kband::transport::{Origin, SampleMean, Sensitivity, measure};

use super::{Arguments, Computed, Feeder, effort, starts};
use crate::arguments::{Range, k_of};
use crate::desk::Desk;
use crate::ending::{self, Endings, Gears, InGear, MAX_ORBIT_IMPACTS, ORBITS_PER_BLOCK};
use crate::picture::Axis;
use crate::refusal::Refusal;
use crate::report::{counted, span};

/// Smallest number of drive cycles between rests for which a part conveys like one without rests.
const MIN_CYCLES_BETWEEN_RESTS: u32 = 100;

/// Whether a part rests rarely, or hopped irregularly without a rest.
fn hops_on(regime: Regime) -> bool {
    match regime {
        Regime::HopAndRest { cycles } => cycles >= MIN_CYCLES_BETWEEN_RESTS,
        other => other == Regime::Undecided,
    }
}

/// Whether the regimes at two neighbouring values of k are the same orbit or the same chaos.
fn is_same_orbit(one: Regime, other: Regime) -> bool {
    match (one, other) {
        (Regime::Doubled { order: a, .. }, Regime::Doubled { order: b, .. }) => a == b,
        (
            Regime::Periodic { impacts, cycles },
            Regime::Periodic {
                impacts: p,
                cycles: r,
            },
        ) => u64::from(cycles) * u64::from(p) == u64::from(r) * u64::from(impacts),
        (Regime::Locked { .. }, _) | (_, Regime::Locked { .. }) => one == other,
        _ if hops_on(one) || hops_on(other) => hops_on(one) && hops_on(other),
        _ => ending::fill(one) == ending::fill(other),
    }
}

/// One orbit: regime, and means in `b w`.
#[derive(Clone, Copy, Debug)]
struct Run {
    regime: Regime,
    in_gear: Option<InGear>,
    time_mean: f64,
    impact_mean: Option<f64>,
    interval: Option<f64>,
    /// Impact mean in closed form, from the phases of impact.
    stationary: Option<f64>,
    exponent: Option<f64>,
}

/// A regime reached at one k, and the orbits in it.
#[derive(Clone, Debug)]
struct Row {
    k: f64,
    regime: Regime,
    in_gear: Option<InGear>,
    runs: Vec<Run>,
    from_rest: bool,
    sensitivity: Option<Sensitivity>,
}

impl Row {
    /// Values of the orbits that have one.
    fn sample(&self, value: fn(&Run) -> Option<f64>) -> SampleMean {
        SampleMean::from_values(self.runs.iter().filter_map(value))
    }

    fn time_mean(&self) -> SampleMean {
        self.sample(|run| Some(run.time_mean))
    }

    /// Name of the regime; with scatter, the share of time in gear.
    fn named(&self) -> String {
        match self.in_gear {
            Some(gear) => gear.to_string(),
            None => ending::describe_regime(self.regime, MAX_ORBIT_IMPACTS),
        }
    }

    /// Time mean in `b w`; 0 at rest.
    fn mean(&self) -> f64 {
        self.time_mean().mean().unwrap_or(0.0)
    }

    /// Standard error of the time mean; 0 for a periodic regime that only one start reached.
    fn error(&self) -> f64 {
        self.time_mean().error().unwrap_or(0.0)
    }
}

pub(super) fn compute(
    feeder: Feeder,
    arguments: &Arguments,
    desk: &Desk,
) -> Result<Computed, Refusal> {
    let over = Over::new(&feeder, arguments)?;
    let rows = rows(&feeder, arguments, &over, desk)?;
    let report = report(&feeder, arguments, &over, &rows)?;
    Ok((report, Box::new(move || picture(&feeder, &over, &rows))))
}

/// Values of k that are computed, and the range of them that is shown.
struct Over {
    amplitude: bool,
    low: f64,
    high: f64,
    /// In the order of the horizontal axis.
    k: Vec<f64>,
    displayed: std::ops::Range<usize>,
}

impl Over {
    fn new(feeder: &Feeder, arguments: &Arguments) -> Result<Self, Refusal> {
        let amplitude = arguments.b.is_some();
        let given = arguments.k.or(arguments.b);
        let range = match given {
            Some(range) => range,
            None => Range::new(0.02, 1.1 * band::birth(feeder.restitution, 1)?, 121),
        };
        let mut values: Vec<f64> = range.values().collect();
        if given.is_none() {
            // Regimes are dense at small k, so the values have equal ratios.
            let ratio = (range.high / range.low).ln();
            let last = (values.len() - 1) as f64;
            for (n, value) in values.iter_mut().enumerate() {
                *value = range.low * (ratio * n as f64 / last).exp();
            }
        }
        let mut displayed = 0..values.len();
        // A single value needs neighbours for its sensitivity.
        if let [only] = values[..] {
            values = vec![only * 0.95, only, only * 1.05];
            displayed = 1..2;
        }
        let k = if amplitude {
            let all = values.iter().map(|value| k_of(&feeder.track, *value));
            all.collect::<Result<_, Refusal>>()?
        } else {
            values
        };
        Ok(Self {
            amplitude,
            low: range.low,
            high: range.high,
            k,
            displayed,
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

    fn describe(&self) -> String {
        let (name, unit) = if self.amplitude {
            ("b", " mm")
        } else {
            ("k", "")
        };
        format!("{name} = {}{unit}", span(self.low, self.high, 6))
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
    // With scatter there is no final regime.
    let constant = match arguments.scatter.scatter {
        0.0 => over.k.len(),
        _ => 0,
    };
    let endings = desk.spread("regimes", constant, ORBITS_PER_BLOCK, |columns| {
        let tracks = columns.iter().map(|n| (over.k[*n], feeder.restitution));
        let tracks: Vec<_> = tracks.collect();
        Endings::from_tracks(&tracks, MAX_ORBIT_IMPACTS, feeder.contact)
    })?;
    let runs = desk.try_map("conveying", tasks.len(), |task| {
        let (n, start) = tasks[task];
        let scatter = arguments.scatter.stream(feeder.restitution, task as u64)?;
        run(feeder, over.k[n], endings.get(n), start, scatter, arguments)
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
    let displayed = &over.k[over.displayed.clone()];
    rows.retain(|row| displayed.contains(&row.k));
    Ok(rows)
}

/// One orbit at `k` from a start; with scatter there is no final regime, so no `endings`.
fn run(
    feeder: &Feeder,
    k: f64,
    endings: Option<&Endings>,
    start: Origin,
    scatter: Option<Scatter>,
    arguments: &Arguments,
) -> Result<Run, Refusal> {
    let map = Map::build(k, feeder.restitution)?;
    let tangential = Tangential::build(k, feeder.settings)?;
    let regime = match (endings, start) {
        (None, _) => Regime::Undecided,
        (Some(endings), Origin::Rest) => endings.from_rest(),
        (Some(endings), Origin::Hop(state)) => endings.classify(state),
    };
    // A rest erases the history. From rest, the period is measured without a transient.
    let start = match regime {
        Regime::HopAndRest { .. } if !hops_on(regime) => Origin::Rest,
        _ => start,
    };
    let mut orbit = start.orbit(&map).with_contact(feeder.contact);
    let scatters = scatter.is_some();
    if let Some(scatter) = scatter {
        orbit = orbit.scattering(scatter)?;
    }
    // A quarter of the shortest run, 100 impacts, aligns the tangent.
    let mut growth = Growth::new(&map, 25.max(arguments.impacts as u64 / 40));
    let mut gears = Gears::start_now()?;
    let mut phases = PhaseMeans::default();
    let watched = &mut (&mut growth, (&mut gears, &mut phases));
    let conveyed = measure(orbit, tangential, effort(arguments), watched).conveyed;
    // Closed form and exponent apply only to instantaneous impacts without rests.
    let is_defined = conveyed.rests == 0 && feeder.contact.is_instant();
    let stationary = phases.impact_mean(k, feeder.restitution, &feeder.settings);
    let exponent = growth.exponent();
    Ok(Run {
        regime,
        in_gear: gears.longest().filter(|_| scatters),
        time_mean: conveyed.time_mean().unwrap_or(0.0),
        impact_mean: conveyed.impact_mean(),
        interval: conveyed.mean_interval(),
        stationary: stationary.filter(|_| is_defined),
        exponent: exponent.filter(|_| is_defined && !scatters),
    })
}

fn grouped(k: f64, tasks: &[(usize, Origin)], runs: &[Run]) -> Vec<Row> {
    let regimes = counted(runs.iter().map(|run| run.regime)).into_iter();
    let row = |(regime, _): (Regime, usize)| {
        let own = runs.iter().filter(|run| run.regime == regime);
        let all = tasks.iter().zip(runs);
        let runs_of_rest = all.filter(|(task, _)| task.1 == Origin::Rest);
        let mut regimes_from_rest = runs_of_rest.map(|(_, run)| run.regime);
        Row {
            k,
            regime,
            in_gear: InGear::from_orbits(own.clone().map(|run| run.in_gear)),
            runs: own.copied().collect(),
            from_rest: regimes_from_rest.any(|reached| reached == regime),
            sensitivity: None,
        }
    };
    regimes.map(row).collect()
}

/// Sensitivity from the same regime at the neighbouring values of k, at both if it exists at both.
fn sensitivity(over: &Over, rows: &[Row], row: &Row) -> Option<Sensitivity> {
    let at = over.k.iter().position(|k| *k == row.k)?;
    let find = |n: usize| {
        let k = *over.k.get(n)?;
        let mut candidates = rows.iter().filter(|other| other.k == k);
        let same = candidates.find(|other| is_same_orbit(other.regime, row.regime))?;
        Some((k, same.mean(), same.error()))
    };
    let center = (row.k, row.mean(), row.error());
    let before = at.checked_sub(1).and_then(find).unwrap_or(center);
    let after = find(at + 1).unwrap_or(center);
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
        let over = Over::new(&feeder, &arguments).unwrap();
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
            assert!(
                (row.sample(|run| run.interval).mean().unwrap() - std::f64::consts::TAU).abs()
                    < 1e-9
            );
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
    fn a_single_k_has_a_sensitivity_from_its_neighbours() {
        let (_, _, rows) = rows_of("--restitution 0.2 --k 0.43 --impacts 300");
        let locked = rows.iter().find(|row| row.regime == ORDER_1).unwrap();
        assert!(locked.sensitivity.unwrap().value.abs() < 1e-6);
        assert!(rows.iter().all(|row| row.k == 0.43));
    }
}
