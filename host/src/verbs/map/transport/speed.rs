//! Conveying speed over k or b: simulated, in closed form, and its sensitivity to the amplitude.

use std::f64::consts::TAU;

use kband::impact::{Growth, Kernel, Map, PartState, Scatter, Tangential};
use kband::regime::band;
use kband::regime::cascade::Estimate;
use kband::regime::classify::Regime;
use kband::transport::stationary::PhaseMeans;
use kband::transport::{self, Conveyed, Origin, SampleMean, locked, measure};
use serde_json::json;

use super::{Feeder, ORDERS};
use crate::arguments::{Output, k_of};
use crate::desk::Desk;
use crate::ending::{self, Endings, FILLS, Gears, InGear, MAX_ORBIT_IMPACTS};
use crate::picture::{Axis, Panel, Picture};
use crate::refusal::{Exit, Result};
use crate::report::{Printout, columns, counted, fields, span, when};

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

#[derive(Clone, Copy, Debug)]
struct Run {
    /// Number of its k.
    column: usize,
    from_rest: bool,
    regime: Regime,
    in_gear: Option<InGear>,
    conveyed: Conveyed,
    /// Impact mean in closed form, from the phases of impact.
    stationary: Option<f64>,
    exponent: Option<f64>,
}

struct Row {
    k: f64,
    regime: Regime,
    in_gear: Option<InGear>,
    runs: Vec<Run>,
    from_rest: bool,
    sensitivity: Option<Estimate>,
}

impl Row {
    fn sample(&self, value: fn(&Run) -> Option<f64>) -> SampleMean {
        SampleMean::from_values(self.runs.iter().filter_map(value))
    }

    fn time_mean(&self) -> SampleMean {
        self.sample(|run| Some(run.conveyed.time_mean().unwrap_or(0.0)))
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

pub(super) fn run(feeder: &Feeder, output: &Output, desk: &Desk) -> Result<Exit> {
    let over = Over::new(feeder)?;
    let rows = rows(feeder, &over, desk)?;
    let report = report(feeder, &over, &rows);
    output.show(&report, || picture(feeder, &over, &rows))
}

struct Over {
    amplitude: bool,
    low: f64,
    high: f64,
    axis: Axis,
    /// The range in words.
    text: String,
    /// In the order of the horizontal axis.
    k: Vec<f64>,
    displayed: std::ops::Range<usize>,
}

impl Over {
    fn new(feeder: &Feeder) -> Result<Self> {
        let arguments = feeder.arguments;
        let amplitude = arguments.b.is_some();
        let (low, high, mut values) = if let Some(range) = arguments.k.or(arguments.b) {
            (range.low, range.high, range.values().collect())
        } else {
            // Regimes are dense at small k, so the values have equal ratios.
            let (low, high) = (0.02, 1.1 * band::birth(arguments.restitution, 1)?);
            let value = |n| low * ((high / low).ln() * f64::from(n) / 120.0).exp();
            (low, high, (0..=120).map(value).collect::<Vec<f64>>())
        };
        let mut displayed = 0..values.len();
        // A single value needs neighbours for its sensitivity.
        if let [only] = values[..] {
            values = vec![only * 0.95, only, only * 1.05];
            displayed = 1..2;
        }
        if amplitude {
            for value in &mut values {
                *value = k_of(&feeder.track, *value)?;
            }
        }
        let span = span(low, high, 6);
        let (axis, text) = match amplitude {
            true => (Axis::of_b(low, high), format!("b = {span} mm")),
            false => (Axis::of_k(low, high), format!("k = {span}")),
        };
        let is_wide = high > 4.0 * low;
        Ok(Self {
            amplitude,
            low,
            high,
            axis: if is_wide { axis.logarithmic() } else { axis },
            text,
            k: values,
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
}

/// Starts of parts at `k`: at rest, on each attracting lock, and starts spread evenly (additive
/// recurrence of the plastic number), to beyond the velocity of the highest bounces, `2.5 R/(1-R)`.
fn starts(k: f64, feeder: &Feeder) -> impl Iterator<Item = Origin> {
    const PLASTIC: f64 = 1.324_717_957_244_746;
    let restitution = feeder.arguments.restitution;
    let highest = 1.0 + 2.5 * restitution / (1.0 - restitution);
    let spread = (1..=feeder.arguments.starts).map(move |n| {
        let n = n as f64;
        let phase = (0.5 + n / PLASTIC).fract() * std::f64::consts::TAU;
        let velocity = (0.5 + n / (PLASTIC * PLASTIC)).fract() * highest;
        Origin::Hop(PartState::new(phase, velocity))
    });
    let unspread = [Origin::Rest].into_iter().chain(feeder.locked(k));
    unspread.chain(spread)
}

fn rows(feeder: &Feeder, over: &Over, desk: &Desk) -> Result<Vec<Row>> {
    let (restitution, scatter) = (feeder.arguments.restitution, feeder.arguments.scatter);
    let mut tasks: Vec<(usize, Origin)> = Vec::new();
    for (n, k) in over.k.iter().enumerate() {
        tasks.extend(starts(*k, feeder).map(|start| (n, start)));
    }
    // With scatter there is no final regime.
    let constant = when(scatter.scatter == 0.0, || over.k.len());
    let endings = desk.spread("regimes", constant, |columns| {
        let tracks: Vec<_> = columns.iter().map(|n| (over.k[*n], restitution)).collect();
        Endings::from_tracks(&tracks, MAX_ORBIT_IMPACTS, feeder.contact)
    })?;
    let runs = desk.try_map("conveying", tasks.len(), |task| {
        let (column, start) = tasks[task];
        let scatter = scatter.stream(restitution, task as u64)?;
        simulate(feeder, over, column, endings.get(column), start, scatter)
    })?;
    let mut rows = Vec::new();
    for runs in runs.chunk_by(|one, other| one.column == other.column) {
        for (regime, _) in counted(runs.iter().map(|run| run.regime)) {
            let own = runs.iter().filter(|run| run.regime == regime);
            rows.push(Row {
                k: over.k[runs[0].column],
                regime,
                in_gear: InGear::from_orbits(own.clone().map(|run| run.in_gear)),
                from_rest: own.clone().any(|run| run.from_rest),
                runs: own.copied().collect(),
                sensitivity: None,
            });
        }
    }
    for n in 0..rows.len() {
        rows[n].sensitivity = sensitivity(over, &rows, &rows[n]);
    }
    let displayed = &over.k[over.displayed.clone()];
    rows.retain(|row| displayed.contains(&row.k));
    Ok(rows)
}

/// One orbit at a k from a start; with scatter there is no final regime, so no `endings`.
fn simulate(
    feeder: &Feeder,
    over: &Over,
    column: usize,
    endings: Option<&Endings>,
    start: Origin,
    scatter: Option<Scatter>,
) -> Result<Run> {
    let (k, from_rest) = (over.k[column], start == Origin::Rest);
    let map = Map::build(k, feeder.arguments.restitution)?;
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
    let mut growth = Growth::new(&map, 25.max(feeder.effort().impacts / 40));
    let mut gears = Gears::start_now()?;
    let mut phases = PhaseMeans::default();
    let watched = &mut (&mut growth, (&mut gears, &mut phases));
    let conveyed = measure(orbit, tangential, feeder.effort(), watched).conveyed;
    // Closed form and exponent apply only to instantaneous impacts without rests.
    let is_defined = conveyed.rests == 0 && feeder.contact.is_instant();
    let stationary = phases.impact_mean(k, map.restitution(), &feeder.settings);
    let exponent = growth.exponent();
    Ok(Run {
        column,
        from_rest,
        regime,
        in_gear: gears.longest().filter(|_| scatters),
        conveyed,
        stationary: stationary.filter(|_| is_defined),
        exponent: exponent.filter(|_| is_defined && !scatters),
    })
}

/// Sensitivity from the same regime at the neighbouring values of k, at both if it exists at both.
fn sensitivity(over: &Over, rows: &[Row], row: &Row) -> Option<Estimate> {
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
    let is_rising = before.0 < after.0;
    let (low, high) = if is_rising {
        (before, after)
    } else {
        (after, before)
    };
    transport::sensitivity(low, high)
}

fn closed_form(feeder: &Feeder, row: &Row) -> Option<f64> {
    match row.regime {
        Regime::Locked { order } => {
            let lock = feeder.lock(row.k, order)?;
            Some(locked::velocity(&lock, row.k, &feeder.settings))
        }
        Regime::Doubled { .. } | Regime::Periodic { .. } | Regime::Chaotic | Regime::Undecided => {
            row.sample(|run| run.stationary).mean()
        }
        Regime::HopAndRest { .. } | Regime::Rest => None,
    }
}

fn bound(feeder: &Feeder) -> Option<f64> {
    let applies = feeder.settings.phase_lead == 0.0 && feeder.contact.is_instant();
    applies.then(|| locked::bound(feeder.arguments.restitution, &feeder.settings))
}

fn impact_mean(row: &Row) -> Option<f64> {
    row.sample(|run| run.conveyed.impact_mean()).mean()
}

/// A velocity of the map in mm/s.
fn in_mm(feeder: &Feeder, row: &Row, velocity: f64) -> f64 {
    velocity * feeder.velocity_unit(row.k)
}

fields! {
    fn speeds(row: Row, feeder: Feeder<'_>) {
        all K => row.k;
        all B.digits(5) => feeder.amplitude(row.k);
        all REGIME => row.named();
        json IN_GEAR => row.in_gear.map(|gear| gear.share);
        all STARTS => row.runs.len();
        all FROM_REST => row.from_rest;
        all SPEED.digits(5) => in_mm(feeder, row, row.mean());
        all SPEED_ERROR.digits(2) => row.time_mean().error().map(|error| in_mm(feeder, row, error));
        all IMPACT_MEAN.digits(5) => impact_mean(row).map(|mean| in_mm(feeder, row, mean));
        json VELOCITY => row.mean();
        json IMPACT_VELOCITY => impact_mean(row);
        all CLOSED_FORM.digits(5) => closed_form(feeder, row).map(|velocity| in_mm(feeder, row, velocity));
        all BOUND.digits(4) => bound(feeder).map(|velocity| in_mm(feeder, row, velocity));
        all CRITICAL_SLOPE.digits(7) => critical_slope(feeder, row);
        all INTERVAL.digits(5) => row.sample(|run| run.conveyed.mean_interval()).mean().map(|mean| mean / TAU);
        all EXPONENT.titled("exponent").digits(3) => row.sample(|run| run.exponent).mean();
        all SENSITIVITY.digits(3) => row.sensitivity.map(|sensitivity| sensitivity.value);
        all SENSITIVITY_ERROR.digits(2) => row.sensitivity.map(|sensitivity| sensitivity.error);
        all PARTS_PER_HOUR.digits(4) => feeder.arguments.part_length.map(|length| {
            (in_mm(feeder, row, row.mean()) / length * 3600.0).max(0.0)
        });
    }
}

fn report(feeder: &Feeder, over: &Over, rows: &[Row]) -> Printout {
    let mut view = speeds(feeder);
    let objects = view.objects(rows);
    if feeder.arguments.part_length.is_none() {
        view = view.without(columns::PARTS_PER_HOUR);
    }
    // In phase all locks have one critical slope; with a lead it depends on the phase of impact.
    let critical = rows.iter().filter_map(|row| critical_slope(feeder, row));
    let critical: Vec<f64> = critical.collect();
    let in_phase = (feeder.settings.phase_lead == 0.0 && feeder.contact.is_instant())
        .then(|| locked::critical_slope_in_phase(feeder.arguments.restitution, &feeder.settings))
        .map(|tangent| tangent.atan().to_degrees());
    let text = in_phase.map(|slope| {
        format!("locked parts stand still on an incline of {slope:.2}° (equation 22)")
    });
    let (range, drive) = (&over.text, feeder.describe());
    let heading = format!("Conveying speed at {range}; {drive}");
    let report = view.printout(rows).heading(heading).notes(text);
    report.json(json!({
        "rows": objects,
        "critical_slope": in_phase.or((critical.len() == 1).then(|| critical[0])),
        "velocity_bound": bound(feeder),
    }))
}

/// Incline in degrees at which a locked part does not advance; `None` for other regimes.
fn critical_slope(feeder: &Feeder, row: &Row) -> Option<f64> {
    let Regime::Locked { order } = row.regime else {
        return None;
    };
    let lock = feeder.lock(row.k, order)?;
    let tangent = locked::critical_slope(&lock, row.k, &feeder.settings);
    Some(tangent.atan().to_degrees())
}

fn picture(feeder: &Feeder, over: &Over, rows: &[Row]) -> Picture {
    let speed = |row: &Row| in_mm(feeder, row, row.mean());
    let place = |k: f64| over.place(feeder, k);
    let highest = rows.iter().map(speed).fold(0.0, f64::max);
    let lowest = rows.iter().map(speed).fold(0.0, f64::min);
    let room = 0.15 * (highest - lowest).max(1e-9);
    let forward = rows.iter().map(speed).filter(|speed| *speed > 0.0);
    let slowest = forward.fold(highest, f64::min);
    let axis = |low: f64, high: f64| Axis::new("conveying speed", "mm/s", low, high);
    // On double logarithmic axes a speed proportional to b is straight, and a locked one level.
    let up = if lowest < 0.0 || highest <= 0.0 {
        axis(lowest - room, highest + room)
    } else if highest > 3.0 * slowest {
        axis(0.7 * slowest, 1.4 * highest).logarithmic()
    } else {
        axis(0.0, highest + room)
    };
    let mut panel = Panel::new(over.axis.clone(), up)
        .height(340.0)
        .heading("Time mean of the speed, measured (markers) and in closed form (lines)");
    let [first, last] = [over.displayed.start, over.displayed.end - 1].map(|n| place(over.k[n]));
    for order in 1..=3 {
        let edges = (
            band::flip(feeder.arguments.restitution, order),
            band::first_return_edge(feeder.arguments.restitution, order),
        );
        let (Ok(flip), Ok(birth)) = edges else {
            continue;
        };
        let (left, right) = (place(flip).min(place(birth)), place(flip).max(place(birth)));
        let (left, right) = (left.max(over.low), right.min(over.high));
        if left < right {
            panel = panel
                .strip("bands of the locks", left, right)
                .caption(0.5 * (left + right), format!("r={order}"));
        }
    }
    let smooth = |line: &dyn Fn(f64) -> Option<f64>| -> Vec<(f64, f64)> {
        let point = |n| {
            let at = first * (last / first).powf(f64::from(n) / 600.0);
            let of_amplitude = feeder.track.k(1e-3 * at);
            let k = if over.amplitude { of_amplitude } else { at };
            let speed = line(k).map(|velocity| velocity * feeder.velocity_unit(k));
            (at, speed.unwrap_or(f64::NAN))
        };
        (0..=600).map(point).collect()
    };
    if let Some(bound) = bound(feeder) {
        let line = smooth(&|_| Some(bound));
        panel = panel.line("bound of the impact mean, equation 37", 1, line);
    }
    let measured = |row: &Row| (place(row.k), speed(row), row.regime);
    panel = add_markers(panel, rows.iter().map(measured).collect());
    // Drawn over the markers, which would hide it.
    for order in ORDERS {
        let line = smooth(&|k| {
            let lock = feeder.lock(k, order)?;
            let velocity = || locked::velocity(&lock, k, &feeder.settings);
            lock.attracts().then(velocity)
        });
        if line.iter().any(|(_, speed)| speed.is_finite()) {
            panel = panel.line("locked, equation 20", 6, line);
        }
    }
    let from_rest = rows.iter().filter(|row| row.from_rest);
    let fills = from_rest.map(|row| (place(row.k), ending::fill(row.regime)));
    let names = FILLS.map(|(fill, name)| (fill, format!("from rest: {name}")));
    panel = panel.ribbon_of_points([over.low, over.high], fills, &names);
    let answer = |row: &Row| {
        let Estimate { value, error } = row.sensitivity?;
        let is_shown = error < 0.5 && (-1.0..=3.0).contains(&value);
        is_shown.then_some((place(row.k), value, row.regime))
    };
    let answers = rows.iter().filter_map(answer).collect();
    let below = Panel::new(
        over.axis.clone(),
        Axis::new("(dV/V) / (db/b)", "", -1.0, 3.0),
    )
    .height(200.0)
    .heading("Sensitivity of the speed to the amplitude")
    .level(0.0, "does not feel b")
    .level(1.0, "grows like b");
    let below = add_markers(below, answers);
    Picture::new("Conveying speed in every regime")
        .caption(feeder.describe())
        .panel(panel)
        .panel(below)
}

fn add_markers(mut panel: Panel, points: Vec<(f64, f64, Regime)>) -> Panel {
    for (series, (fill, name)) in FILLS.iter().enumerate() {
        let own = points.iter().filter(|point| ending::fill(point.2) == *fill);
        let own: Vec<(f64, f64)> = own.map(|point| (point.0, point.1)).collect();
        if !own.is_empty() {
            panel = panel.markers(name, series, own);
        }
    }
    panel
}
