//! Speeds as table, JSON and picture.

use std::f64::consts::TAU;

use kband::regime::band;
use kband::regime::classify::Regime;
use kband::transport::{Sensitivity, locked};
use serde_json::json;

use super::super::{Arguments, Feeder, ORDERS};
use super::{Over, Row};
use crate::ending::{self, FILLS};
use crate::picture::{Axis, Panel, Picture};
use crate::refusal::Refusal;
use crate::report::{Printout, columns, fields};

pub(super) fn closed_form(feeder: &Feeder, row: &Row) -> Option<f64> {
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

pub(super) fn bound(feeder: &Feeder) -> Option<f64> {
    let applies = feeder.settings.phase_lead == 0.0 && feeder.contact.is_instant();
    applies.then(|| locked::bound(feeder.restitution, &feeder.settings))
}

fn impact_mean(row: &Row) -> Option<f64> {
    row.sample(|run| run.impact_mean).mean()
}

struct Conversion<'a> {
    feeder: &'a Feeder,
    part_length: Option<f64>,
}

impl Conversion<'_> {
    /// A velocity of the map in mm/s.
    fn in_mm(&self, row: &Row, velocity: f64) -> f64 {
        velocity * self.feeder.velocity_unit(row.k)
    }

    /// Parts an hour, end to end.
    fn parts_per_hour(&self, row: &Row) -> Option<f64> {
        let speed = self.in_mm(row, row.mean());
        let parts = |length: f64| (speed / length * 3600.0).max(0.0);
        self.part_length.map(parts)
    }
}

fields! {
    fn speeds(row: Row, conversion: Conversion<'_>) {
        all K => row.k;
        all B.digits(5) => conversion.feeder.amplitude(row.k);
        all REGIME => row.named();
        json IN_GEAR => row.in_gear.map(|gear| gear.share);
        all STARTS => row.runs.len();
        all FROM_REST => row.from_rest;
        all SPEED.digits(5) => conversion.in_mm(row, row.mean());
        all SPEED_ERROR.digits(2) => row.time_mean().error().map(|error| conversion.in_mm(row, error));
        all IMPACT_MEAN.digits(5) => impact_mean(row).map(|mean| conversion.in_mm(row, mean));
        json VELOCITY => row.mean();
        json IMPACT_VELOCITY => impact_mean(row);
        all CLOSED_FORM.digits(5) => closed_form(conversion.feeder, row).map(|velocity| conversion.in_mm(row, velocity));
        all BOUND.digits(4) => bound(conversion.feeder).map(|velocity| conversion.in_mm(row, velocity));
        all CRITICAL_SLOPE.digits(7) => critical_slope(conversion.feeder, row);
        all INTERVAL.digits(5) => row.sample(|run| run.interval).mean().map(|mean| mean / TAU);
        all EXPONENT.titled("exponent").digits(3) => row.sample(|run| run.exponent).mean();
        all SENSITIVITY.digits(3) => row.sensitivity.map(|sensitivity| sensitivity.value);
        all SENSITIVITY_ERROR.digits(2) => row.sensitivity.map(|sensitivity| sensitivity.error);
        all PARTS_PER_HOUR.digits(4) => conversion.parts_per_hour(row);
    }
}

pub(super) fn report(
    feeder: &Feeder,
    arguments: &Arguments,
    over: &Over,
    rows: &[Row],
) -> Result<Printout, Refusal> {
    let part_length = arguments.part_length;
    let conversion = Conversion {
        feeder,
        part_length,
    };
    let view = speeds(&conversion);
    let objects: Vec<_> = rows.iter().map(|row| view.object(row)).collect();
    let view = match part_length {
        Some(_) => view,
        None => view.without(columns::PARTS_PER_HOUR),
    };
    // In phase all locks have one critical slope; with a lead it depends on the phase of impact.
    let critical = rows.iter().filter_map(|row| critical_slope(feeder, row));
    let critical: Vec<f64> = critical.collect();
    let in_phase = (feeder.settings.phase_lead == 0.0 && feeder.contact.is_instant())
        .then(|| locked::critical_slope_in_phase(feeder.restitution, &feeder.settings))
        .map(|tangent| tangent.atan().to_degrees());
    let (place, feeder_text) = (over.describe(), feeder.describe());
    let report = view
        .printout(rows)
        .heading(format!("Conveying speed at {place}; {feeder_text}"));
    let text = match (in_phase, critical.as_slice()) {
        (Some(slope), _) => Some(format!("{slope:.2}° (equation 22)")),
        (None, []) => None,
        (None, [slope]) => Some(format!("{slope:.2}°, from equation 20")),
        (None, slopes) => {
            let min_slope = slopes.iter().copied().fold(f64::INFINITY, f64::min);
            let max_slope = slopes.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            let slopes = format!("{min_slope:.2}° to {max_slope:.2}°");
            Some(format!("{slopes} by k, from equation 20"))
        }
    };
    let text = text.map(|text| format!("locked parts stand still on an incline of {text}"));
    report.notes(text).json(&json!({
        "rows": objects,
        "critical_slope": in_phase.or(match critical.as_slice() {
            [slope] => Some(*slope),
            _ => None,
        }),
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

pub(super) fn picture(feeder: &Feeder, over: &Over, rows: &[Row]) -> Picture {
    let speed = |row: &Row| row.mean() * feeder.velocity_unit(row.k);
    let place = |k: f64| over.place(feeder, k);
    let highest = rows.iter().map(speed).fold(0.0, f64::max);
    let lowest = rows.iter().map(speed).fold(0.0, f64::min);
    let room = 0.15 * (highest - lowest).max(1e-9);
    let forward = rows.iter().map(speed).filter(|speed| *speed > 0.0);
    let slowest = forward.fold(highest, f64::min);
    let axis = |low: f64, high: f64| Axis::new("conveying speed", "mm/s", low, high);
    // On double logarithmic axes a speed proportional to b is a straight line, and a locked one is
    // level.
    let up = if lowest < 0.0 || highest <= 0.0 {
        axis(lowest - room, highest + room)
    } else if highest > 3.0 * slowest {
        axis(0.7 * slowest, 1.4 * highest).logarithmic()
    } else {
        axis(0.0, highest + room)
    };
    let mut panel = Panel::new(over.axis(), up)
        .height(340.0)
        .heading("Time mean of the speed, measured (markers) and in closed form (lines)");
    let [first, last] = [over.displayed.start, over.displayed.end - 1].map(|n| place(over.k[n]));
    for order in 1..=3 {
        let edges = (
            band::flip(feeder.restitution, order),
            band::first_return_edge(feeder.restitution, order),
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
        (0..=600)
            .map(|n| {
                let part = f64::from(n) / 600.0;
                let at = first * (last / first).powf(part);
                let track = &feeder.track;
                let k = if over.amplitude {
                    track.k(1e-3 * at)
                } else {
                    at
                };
                let speed = line(k).map(|velocity| velocity * feeder.velocity_unit(k));
                (at, speed.unwrap_or(f64::NAN))
            })
            .collect()
    };
    let lock = |order: u32| {
        smooth(&|k| {
            let lock = feeder.lock(k, order)?;
            let velocity = || locked::velocity(&lock, k, &feeder.settings);
            lock.attracts().then(velocity)
        })
    };
    if let Some(bound) = bound(feeder) {
        let line = smooth(&|_| Some(bound));
        panel = panel.line("bound of the impact mean, equation 37", 1, line);
    }
    let measured = |row: &Row| (place(row.k), speed(row), row.regime);
    panel = add_markers(panel, rows.iter().map(measured).collect());
    // Drawn over the markers, which would hide it.
    for order in ORDERS {
        let line = lock(order);
        if line.iter().any(|(_, speed)| speed.is_finite()) {
            panel = panel.line("locked, equation 20", 6, line);
        }
    }
    let from_rest = rows.iter().filter(|row| row.from_rest);
    let fills = from_rest.map(|row| (place(row.k), ending::fill(row.regime)));
    let names = FILLS.map(|(fill, name)| (fill, format!("from rest: {name}")));
    panel = panel.ribbon_of_points([over.low, over.high], fills, &names);
    let answer = |row: &Row| {
        let Sensitivity { value, error } = row.sensitivity?;
        let is_shown = error < 0.5 && (-1.0..=3.0).contains(&value);
        is_shown.then_some((place(row.k), value, row.regime))
    };
    let answers = rows.iter().filter_map(answer).collect();
    let below = Panel::new(over.axis(), Axis::new("(dV/V) / (db/b)", "", -1.0, 3.0))
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

/// The points as markers by the fill of their regime.
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
