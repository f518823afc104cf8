//! Equations (26) to (29) and (34): sums and means over the impacts of orbits.

use std::f64::consts::TAU;

use kband::impact::{
    Contact, Impact, Kernel, Map, Observer, Orbit, PartState, Tangential, TangentialSettings,
};
use kband::regime::band;
use kband::transport::stationary::{self, PhaseMeans};
use kband::transport::{Conveyed, Conveying};

use super::bounds::{CHAOS, largest_launch};
use super::engine::{Cases, Check, Ledger};
use crate::refusal::Refusal;

pub(super) const CHECKS: &[Check] = &[velocities, in_phase, with_lead];

/// k and R of hopping regimes in which the stationary means are checked.
const HOPPING: [(f64, f64); 6] = [
    (0.05, 0.9),
    (0.1, 0.95),
    (0.2, 0.9),
    (0.34, 0.2),
    (0.36, 0.2),
    (0.43, 0.2),
];

/// Impacts of one run.
const IMPACTS: u64 = 4000;

/// Sums over the impacts of a run, of which `phi` is the velocity along the track.
struct Sums {
    tangential: Tangential,
    phi: f64,
    along: f64,
    launch: f64,
    time: f64,
    sine: f64,
    /// (cos t' - cos t)/d.
    chord: f64,
    /// cos t' - cos t.
    bracket: f64,
    flight_squared: f64,
    /// (phi - eta psi) d.
    carried: f64,
    launch_squared: f64,
    launch_cosine: f64,
}

impl Sums {
    fn new(tangential: Tangential, phi: f64) -> Self {
        Self {
            tangential,
            phi,
            along: 0.0,
            launch: 0.0,
            time: 0.0,
            sine: 0.0,
            chord: 0.0,
            bracket: 0.0,
            flight_squared: 0.0,
            carried: 0.0,
            launch_squared: 0.0,
            launch_cosine: 0.0,
        }
    }

    /// (29) as printed.
    fn impact_mean(&self, k: f64) -> f64 {
        let along = self.tangential.settings();
        let (eta, gamma) = (along.amplitude_ratio, along.phase_lead);
        let flight = 0.5 * k * (eta * gamma.cos() - along.incline_tangent);
        let sum = self.along - eta * gamma.cos() * self.launch + self.time * flight
            - eta * gamma.sin() * (self.sine + self.chord);
        sum / IMPACTS as f64
    }
}

impl Observer for Sums {
    fn impact(&mut self, launch: PartState, impact: &Impact<PartState>) {
        let (t, psi, d) = (launch.phase, launch.velocity, impact.flight);
        let eta = self.tangential.settings().amplitude_ratio;
        let change = (t + d).cos() - t.cos();
        self.along += self.phi;
        self.launch += psi;
        self.time += d;
        self.sine += t.sin();
        self.chord += change / d;
        self.bracket += change;
        self.flight_squared += d * d;
        self.carried += (self.phi - eta * psi) * d;
        self.launch_squared += psi * psi;
        self.launch_cosine += psi * t.cos();
        self.phi = self.tangential.after(launch, impact, self.phi);
    }
}

/// A run in a hopping regime.
struct Run {
    k: f64,
    restitution: f64,
    conveyed: Conveyed,
    impact_mean: f64,
    interval: f64,
    sums: Sums,
    phases: PhaseMeans,
}

impl Run {
    /// Largest remainder, per impact, of a sum that telescopes: twice the size of its terms.
    fn ends(&self) -> f64 {
        2.0 * (4.0 + largest_launch(self.k, self.restitution) + 2.0 * 3.0) / IMPACTS as f64
    }
}

/// Runs of a part in every hopping regime. A run with a rest, as in wide chaos now and then, has no
/// impact mean and is left out.
fn hop(settings: TangentialSettings) -> Result<Vec<Run>, Refusal> {
    let mut runs = Vec::new();
    for (k, restitution) in HOPPING {
        let map = Map::build(k, restitution)?;
        let tangential = Tangential::build(k, settings)?;
        for run in 0..6 {
            let mut conveying = Conveying::new(tangential, Contact::new(&map));
            let mut orbit = Orbit::new(&map, Map::state(0.45 + 1e-3 * f64::from(run), 0.45)?);
            orbit.watch(200, &mut conveying);
            let mut sums = Sums::new(tangential, conveying.velocity());
            let mut phases = PhaseMeans::default();
            conveying.restart();
            orbit.watch(IMPACTS, &mut (&mut conveying, (&mut sums, &mut phases)));
            let conveyed = conveying.conveyed();
            if conveyed.rests == 0 {
                runs.push(Run {
                    k,
                    restitution,
                    impact_mean: conveyed.impact_mean().unwrap_or(f64::NAN),
                    interval: conveyed.mean_interval().unwrap_or(f64::NAN),
                    conveyed,
                    sums,
                    phases,
                });
            }
        }
    }
    Ok(runs)
}

/// Sum of `base^(n-l) term(d, delta)` over n flights, as in (26), with the times since `start`.
fn weighted(base: f64, start: f64, times: &[f64], term: impl Fn(f64, f64) -> f64) -> f64 {
    let terms = times.windows(2).enumerate().map(|(l, pair)| {
        let delta = (start + pair[1]).cos() - (start + pair[0]).cos();
        base.powi(-(l as i32)) * term(pair[1] - pair[0], delta)
    });
    base.powi(times.len() as i32 - 1) * terms.sum::<f64>()
}

/// (26) to (28): both velocities after n impacts, as sums over all before.
fn velocities(rows: &mut Ledger) -> Result<(), Refusal> {
    let mut cases = Cases::new(14);
    for _ in 0..200 {
        let k = cases.within(0.1, 0.6);
        let r = cases.within(0.2, 0.9);
        let rt = cases.within(0.2, 0.9);
        let along = TangentialSettings {
            restitution: rt,
            phase_lead: 0.0,
            ..cases.settings()
        };
        let (eta, pull) = (along.amplitude_ratio, k * along.incline_tangent);
        let map = Map::build(k, r)?;
        let tangential = Tangential::build(k, along)?;
        let mut launch = Map::state(cases.within(0.0, TAU), cases.within(1.0, 3.0))?;
        let (phi0, psi0) = (cases.within(-1.0, 1.0), launch.velocity);
        let start = launch.phase;
        let (mut phi, mut clock) = (phi0, start);
        let mut times = vec![0.0];
        for n in 1..=12 {
            let impact = map.impact(launch);
            let d = impact.flight;
            if d < 1e-2 {
                break;
            }
            let delta = (clock + d).cos() - clock.cos();
            let arrival = impact.next.velocity / r;
            rows.compare("(27)", arrival + launch.velocity - k * d, delta);
            clock += d;
            times.push(clock - start);
            phi = tangential.after(launch, &impact, phi);
            launch = impact.next;
            let turns = (clock - launch.phase) / TAU;
            rows.compare_in("(28)", turns, turns.round(), 1.0 / TAU);
            let slides = weighted(rt, start, &times, |d, delta| -pull * d - eta * delta);
            rows.compare("(26a)", rt.powi(n) * phi0 + slides, phi);
            let begun = (-r).powi(n) * psi0;
            let sum = weighted(-r, start, &times, |d, delta| -(k * d + delta));
            rows.compare("(26b)", begun + sum, launch.velocity);
            let printed = weighted(-r, start, &times, |d, delta| k * d - delta);
            rows.print("(26b)", begun + printed, launch.velocity);
        }
    }
    Ok(())
}

/// (34) and the stationary means at gamma = 0.
fn in_phase(rows: &mut Ledger) -> Result<(), Refusal> {
    let count = IMPACTS as f64;
    for run in hop(CHAOS)? {
        let (k, r, sums, ends) = (run.k, run.restitution, &run.sums, run.ends());
        let expected = stationary::mean_velocity(k, r, run.interval);
        rows.compare_in("finding launch", expected, sums.launch / count, ends);
        rows.compare_in("finding bracket", sums.bracket / count, 0.0, ends);
        let closed = stationary::impact_mean(k, r, &CHAOS, run.interval).unwrap_or(f64::NAN);
        rows.compare_in("(34)", closed, run.impact_mean, ends);
        let fall = CHAOS.incline_tangent * (1.0 + CHAOS.restitution) / (1.0 - CHAOS.restitution);
        let printed = closed + k * run.interval * fall;
        rows.print_in("(34)", printed, run.impact_mean, ends);

        let drive = 0.5 * k * (CHAOS.amplitude_ratio - CHAOS.incline_tangent);
        let by_moments = (drive * sums.flight_squared + sums.carried) / run.conveyed.flying;
        let time_mean = run.conveyed.time_mean().unwrap_or(f64::NAN);
        rows.compare("finding moments", by_moments, time_mean);

        // Four sums telescope: psi^2, psi cos, cos^2 and 2 k sin, weighed by R^2/(1 - R^2).
        let highest = largest_launch(k, r);
        let ends = r * r / (1.0 - r * r)
            * (4.0 * k + 2.0 + 2.0 * highest * (highest / r + 2.0) / r)
            / count;
        let gain = 2.0 * r / (1.0 - r);
        let difference = sums.launch_squared - gain * sums.launch_cosine;
        rows.compare_in("finding energy", difference / count, 0.0, ends);
        let share = share_of_bounds(k, r, sums.launch_squared / count, run.interval);
        rows.at_most("finding bounds", share, 1.0);
    }
    // The bounds are reached at the birth of the lock, where cos t0 = 1.
    for n in 1..19 {
        let r = 0.05 * f64::from(n);
        let k = band::birth(r, 1)?;
        let psi = TAU * k * r / (1.0 + r);
        rows.compare("finding bounds", share_of_bounds(k, r, psi * psi, TAU), 1.0);
    }
    Ok(())
}

/// Larger share that the rms of psi and the mean interval have of their bounds.
fn share_of_bounds(k: f64, r: f64, launch_squared: f64, interval: f64) -> f64 {
    let launch = launch_squared.sqrt() / (2.0 * r / (1.0 - r));
    launch.max(interval / (2.0 / k * (1.0 + r) / (1.0 - r)))
}

/// (29): the impact mean with a phase lead, from means over the impacts.
fn with_lead(rows: &mut Ledger) -> Result<(), Refusal> {
    let leading = TangentialSettings {
        restitution: 0.3,
        amplitude_ratio: 1.7,
        phase_lead: 0.6,
        incline_tangent: 0.07,
    };
    for run in hop(leading)? {
        rows.compare("(29)", run.sums.impact_mean(run.k), run.impact_mean);
        let closed = run.phases.impact_mean(run.k, run.restitution, &leading);
        let closed = closed.unwrap_or(f64::NAN);
        rows.compare_in("finding impact-mean", closed, run.impact_mean, run.ends());
    }
    Ok(())
}
