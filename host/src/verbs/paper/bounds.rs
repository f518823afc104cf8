//! Equations (35) to (38): bounds, and dead parts.

use std::f64::consts::{PI, TAU};

use kband::impact::{
    Impact, Kernel, Map, Observer, Orbit, PartState, Tangential, TangentialSettings,
};
use kband::regime::band;
use kband::transport::{Conveyed, Effort, Inelastic, Origin, Spread, locked, measure};

use super::engine::{Cases, Check, Ledger, estimate};
use crate::refusal::Refusal;
use crate::report::number;

pub(super) const CHECKS: &[Check] = &[highest_launch, longest_mean, bound, dead];

/// The example of the paper's section on chaotic conveying (docs/theory-transport.md#t8.2).
pub(super) const CHAOS: TangentialSettings = TangentialSettings {
    restitution: 0.3,
    amplitude_ratio: 2.0,
    phase_lead: 0.0,
    incline_tangent: 0.05,
};

/// Largest launch velocity that any orbit can keep.
///
/// Fixed point of `psi = R (1 + sqrt((psi + 1)^2 + 4 k))`, which uses only that the track stays
/// within -1..1 and moves no faster than 1.
pub(super) fn largest_launch(k: f64, restitution: f64) -> f64 {
    let mut psi = 0.0_f64;
    for _ in 0..2000 {
        psi = restitution * (1.0 + ((psi + 1.0).powi(2) + 4.0 * k).sqrt());
    }
    psi
}

#[derive(Default)]
struct Highest(f64);

impl Observer for Highest {
    fn impact(&mut self, _: PartState, impact: &Impact<PartState>) {
        self.0 = self.0.max(impact.next.velocity);
    }
}

/// (35): the largest psi, in units of its bound.
fn highest_launch(rows: &mut Ledger) -> Result<(), Refusal> {
    let mut cases = Cases::new(10);
    for _ in 0..400 {
        let k = cases.within(0.02, 1.0);
        let restitution = cases.within(0.05, 0.9);
        let printed = (1.0 + restitution) / (1.0 - restitution);
        let map = Map::build(k, restitution)?;
        let start = Map::state(cases.within(0.0, TAU), cases.within(0.0, printed))?;
        let mut seen = Highest::default();
        Orbit::new(&map, start).watch(400, &mut seen);
        rows.deviation("(35)", seen.0 / printed);
        rows.deviation("(35)", largest_launch(k, restitution) / printed);
    }
    rows.count("(35)", 400 * 400);
    Ok(())
}

/// (36): the longest mean interval, reached at the birth of the lock.
fn longest_mean(rows: &mut Ledger) -> Result<(), Refusal> {
    for n in 1..19 {
        let restitution = 0.05 * f64::from(n);
        for order in 1..=5 {
            let k = band::birth(restitution, order)?;
            let gain = (1.0 + restitution) / (1.0 - restitution);
            let interval = TAU * f64::from(order);
            rows.compare("(36)", 2.0 / k * gain / interval, 1.0);
            rows.print("(36)", 1.0 / k * gain / interval, 1.0);
        }
    }
    Ok(())
}

/// Runs in wide chaos at R = 0.9.
pub(super) fn run_wide_chaos(k: f64, runs: u32, impacts: u64) -> Result<Vec<Conveyed>, Refusal> {
    let map = Map::build(k, 0.9)?;
    let tangential = Tangential::build(k, CHAOS)?;
    let effort = Effort {
        settle: 300,
        impacts,
    };
    (0..runs)
        .map(|n| {
            let n = f64::from(n);
            let start = Origin::Hop(Map::state(0.5 + 0.37 * n, 3.0 + 0.41 * n)?);
            Ok(measure(&map, tangential, start, effort, &mut ()).conveyed)
        })
        .collect()
}

/// (37): the bound of the impact mean, reached by the lock at k1, and the time mean beyond it.
fn bound(rows: &mut Ledger) -> Result<(), Refusal> {
    for n in 1..19 {
        let restitution = 0.05 * f64::from(n);
        let bound = locked::bound(restitution, &CHAOS);
        for order in 1..=5 {
            let k = band::birth(restitution, order)?;
            let velocity = locked::velocity_in_phase(order, k, restitution, &CHAOS);
            rows.compare("(37)", bound, velocity);
        }
    }
    let runs = run_wide_chaos(0.05, 24, 6000)?;
    let bound = locked::bound(0.9, &CHAOS);
    for mean in runs.iter().filter_map(Conveyed::impact_mean) {
        rows.at_most("(37)", mean, bound);
    }
    let (time, time_error) = estimate(&Spread::of(runs.iter().filter_map(Conveyed::time_mean)));
    let (impact, impact_error) =
        estimate(&Spread::of(runs.iter().filter_map(Conveyed::impact_mean)));
    // Reference: long runs, rounded.
    let key = "finding time-mean";
    rows.compare_in(key, impact, 0.0463, 5e-5 + 6.0 * impact_error);
    rows.compare_in(key, time, 0.272, 5e-4 + 6.0 * time_error);
    rows.count(key, runs.iter().map(|run| run.impacts).sum());
    let shown = [(time, 3), (time_error, 1), (bound, 3), (impact, 3)];
    rows.fill(key, shown.map(|(value, digits)| number(value, digits)));
    Ok(())
}

/// (38): dead parts.
fn dead(rows: &mut Ledger) -> Result<(), Refusal> {
    let mut cases = Cases::new(11);
    for _ in 0..500 {
        let k = cases.within(0.05, 0.95);
        let dead = Inelastic::build(k)?;
        let Some(low) = dead.lift_off() else { continue };
        let margin = 0.01 * (PI - 2.0 * low);
        let phase = cases.within(low + margin, PI - low - margin);
        let (eta, tangent) = (cases.within(0.2, 3.0), cases.within(-0.3, 0.3));
        let along = TangentialSettings {
            restitution: 0.0,
            amplitude_ratio: eta,
            phase_lead: 0.0,
            incline_tangent: tangent,
        };
        let Some(flight) = dead.flight(phase) else {
            continue;
        };
        let d = flight.flight;
        let impact = Impact {
            flight: d,
            next: Map::state(flight.landing, 0.0)?,
            grazes: false,
        };
        let launch = Map::state(phase, 0.0)?;
        let mean = Tangential::build(k, along)?.distance(launch, &impact, 0.0) / d;
        rows.compare("(38)", dead.velocity(d, eta, tangent), mean);
        rows.print("(38)", d * (k - 0.5 * k * tangent), mean);
    }
    Ok(())
}
