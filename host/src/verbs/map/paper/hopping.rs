//! Equations (26) to (38): hopping parts by sums over impacts and by intervals; bounds; dead parts.

use std::f64::consts::{PI, TAU};

use kband::impact::{Impact, Kernel, Map, Orbit, PartState, Tangential, TangentialSettings};
use kband::regime::band;
use kband::transport::stationary::{self, PhaseMeans};
use kband::transport::{Conveyed, Conveying, SampleMean, locked};

use super::engine::{Cases, Check, Flights, Ledger, along, convey, estimate};
use super::lock::bands;
use crate::refusal::Result;

pub(super) const CHECKS: &[Check] = &[
    velocities,
    in_phase,
    with_lead,
    correlated,
    independent,
    highest_launch,
    bounds,
    dead,
];

/// Example in the paper's section on chaotic conveying (docs/theory-transport.md#t8.2).
pub(super) const CHAOS: TangentialSettings = along(0.3, 2.0, 0.0, 0.05);

const IMPACTS: u64 = 4000;

struct Run {
    k: f64,
    restitution: f64,
    conveyed: Conveyed,
    phases: PhaseMeans,
    /// Launch phase, launch velocity, velocity along the track, and duration of each flight.
    flights: Vec<[f64; 4]>,
}

impl Run {
    fn impact_mean(&self) -> f64 {
        self.conveyed.impact_mean().unwrap_or(f64::NAN)
    }

    fn sum(&self, term: impl Fn([f64; 4]) -> f64) -> f64 {
        self.flights.iter().copied().map(term).sum()
    }

    /// Largest remainder, per impact, of a sum that telescopes: twice the size of its terms.
    fn ends(&self) -> f64 {
        2.0 * (4.0 + largest_launch(self.k, self.restitution) + 2.0 * 3.0) / IMPACTS as f64
    }
}

/// Runs of a part in hopping regimes, without those with a rest, which have no impact mean.
fn hop(settings: TangentialSettings) -> Result<Vec<Run>> {
    let mut runs = Vec::new();
    for (k, restitution) in [
        (0.05, 0.9),
        (0.1, 0.95),
        (0.2, 0.9),
        (0.34, 0.2),
        (0.36, 0.2),
        (0.43, 0.2),
    ] {
        let map = Map::build(k, restitution)?;
        let tangential = Tangential::build(k, settings)?;
        for run in 0..6 {
            let mut conveying = Conveying::new(tangential, &map);
            let mut orbit = Orbit::new(&map, Map::state(0.45 + 1e-3 * f64::from(run), 0.45)?);
            orbit.watch(200, &mut conveying);
            let (mut flights, mut phi) = (Flights::default(), conveying.velocity());
            let mut phases = PhaseMeans::default();
            conveying.restart();
            orbit.watch(IMPACTS, &mut (&mut conveying, (&mut flights, &mut phases)));
            let flight = |(launch, impact): &(PartState, Impact<PartState>)| {
                let flight = [launch.phase, launch.velocity, phi, impact.flight];
                (_, phi) = tangential.move_in_flight(*launch, impact, phi);
                flight
            };
            let conveyed = conveying.conveyed();
            if conveyed.rests == 0 {
                runs.push(Run {
                    k,
                    restitution,
                    conveyed,
                    phases,
                    flights: flights.0.iter().map(flight).collect(),
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

/// (26) to (28): both velocities after n impacts, as sums over all earlier impacts.
fn velocities(rows: &mut Ledger) -> Result<()> {
    let mut cases = Cases(14);
    for _ in 0..200 {
        let k = cases.within(0.1, 0.6);
        let (r, rt) = (cases.within(0.2, 0.9), cases.within(0.2, 0.9));
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
            (_, phi) = tangential.move_in_flight(launch, &impact, phi);
            launch = impact.next;
            let turns = (clock - launch.phase) / TAU;
            rows.compare_in("(28)", turns, turns.round(), 1.0 / TAU);
            let slides = weighted(rt, start, &times, |d, delta| -pull * d - eta * delta);
            rows.compare("(26a)", rt.powi(n) * phi0 + slides, phi);
            let initial = (-r).powi(n) * psi0;
            let sum = weighted(-r, start, &times, |d, delta| -(k * d + delta));
            rows.compare("(26b)", initial + sum, launch.velocity);
            let printed = weighted(-r, start, &times, |d, delta| k * d - delta);
            rows.print("(26b)", initial + printed, launch.velocity);
        }
    }
    Ok(())
}

/// (34) and the stationary means at gamma = 0.
fn in_phase(rows: &mut Ledger) -> Result<()> {
    let count = IMPACTS as f64;
    let (eta, tangent) = (CHAOS.amplitude_ratio, CHAOS.incline_tangent);
    for run in hop(CHAOS)? {
        let (k, r, ends) = (run.k, run.restitution, run.ends());
        let interval = run.conveyed.mean_interval().unwrap_or(f64::NAN);
        let expected = stationary::mean_velocity(k, r, interval);
        let launch = run.sum(|[_, psi, ..]| psi) / count;
        rows.compare_in("finding launch", expected, launch, ends);
        let bracket = run.sum(|[t, _, _, d]| (t + d).cos() - t.cos()) / count;
        rows.compare_in("finding bracket", bracket, 0.0, ends);
        let closed = stationary::impact_mean(k, r, &CHAOS, interval).unwrap_or(f64::NAN);
        rows.compare_in("(34)", closed, run.impact_mean(), ends);
        let fall = tangent * (1.0 + CHAOS.restitution) / (1.0 - CHAOS.restitution);
        let printed = closed + k * interval * fall;
        rows.print("(34)", (printed - run.impact_mean()) / ends, 0.0);

        let drive = 0.5 * k * (eta - tangent);
        let carried = run.sum(|[_, psi, phi, d]| (phi - eta * psi) * d);
        let moments = drive * run.sum(|[.., d]| d * d) + carried;
        let time_mean = run.conveyed.time_mean().unwrap_or(f64::NAN);
        rows.compare("finding moments", moments / run.conveyed.flying, time_mean);

        // Four sums telescope: psi^2, psi cos, cos^2 and 2 k sin, weighed by R^2/(1 - R^2).
        let highest = largest_launch(k, r);
        let ends = r * r / (1.0 - r * r)
            * (4.0 * k + 2.0 + 2.0 * highest * (highest / r + 2.0) / r)
            / count;
        let gain = 2.0 * r / (1.0 - r);
        let squares = run.sum(|[_, psi, ..]| psi * psi);
        let difference = squares - gain * run.sum(|[t, psi, ..]| psi * t.cos());
        rows.compare_in("finding energy", difference / count, 0.0, ends);
        let share = share_of_bounds(k, r, squares / count, interval);
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

/// Ratios of the rms of psi and of the mean interval to their bounds; the larger one.
fn share_of_bounds(k: f64, r: f64, launch_squared: f64, interval: f64) -> f64 {
    let launch = launch_squared.sqrt() / (2.0 * r / (1.0 - r));
    launch.max(interval / (2.0 / k * (1.0 + r) / (1.0 - r)))
}

/// (29): the impact mean with a phase lead, from means over the impacts.
fn with_lead(rows: &mut Ledger) -> Result<()> {
    let (eta, gamma, tangent): (f64, f64, f64) = (1.7, 0.6, 0.07);
    let leading = along(0.3, eta, gamma, tangent);
    for run in hop(leading)? {
        let flight = 0.5 * run.k * (eta * gamma.cos() - tangent);
        let sine = run.sum(|[t, ..]| t.sin());
        let chord = run.sum(|[t, _, _, d]| ((t + d).cos() - t.cos()) / d);
        let sum = run.sum(|[_, _, phi, _]| phi) - eta * gamma.cos() * run.sum(|[_, psi, ..]| psi)
            + run.sum(|[.., d]| d) * flight
            - eta * gamma.sin() * (sine + chord);
        rows.compare("(29)", sum / IMPACTS as f64, run.impact_mean());
        let closed = run.phases.impact_mean(run.k, run.restitution, &leading);
        let closed = closed.unwrap_or(f64::NAN);
        let key = "finding impact-mean";
        rows.compare_in(key, closed, run.impact_mean(), run.ends());
    }
    Ok(())
}

fn mean_cosine(flights: &Flights) -> f64 {
    let cosines = flights.0.iter().map(|(launch, _)| launch.phase.cos());
    cosines.sum::<f64>() / flights.0.len() as f64
}

/// (30), and the correlation of the flights at k = 0.05, R = 0.9.
fn correlated(rows: &mut Ledger) -> Result<()> {
    const RUNS: u32 = 24;
    const IMPACTS: u64 = 5000;
    const BINS: f64 = 200.0;
    const LONGEST: f64 = 1000.0;
    const WINDOW: f64 = 3000.0;
    let map = Map::build(0.05, 0.9)?;
    let [mut lag, mut variances, mut cosines] = [SampleMean::default(); 3];
    for run in 0..RUNS {
        let run = f64::from(run);
        let mut orbit = Orbit::new(&map, Map::state(0.2 * run, 4.0 + 0.3 * run)?);
        orbit.watch(300, &mut ());
        let mut flights = Flights::default();
        orbit.watch(IMPACTS, &mut flights);
        cosines.add(mean_cosine(&flights));
        // Sums about a rough mean avoid cancellation.
        let times: Vec<f64> = flights.0.iter().map(|(_, impact)| impact.flight).collect();
        let (off, all) = (|time: f64| time - 150.0, times.len() as f64);
        let bias = times.iter().map(|time| off(*time)).sum::<f64>() / all;
        let square = times.iter().map(|time| off(*time).powi(2)).sum::<f64>() / all - bias * bias;
        // At this k parts rest once in 40 000 impacts, so nearly every pair is without a rest.
        let products = times.windows(2).map(|pair| off(pair[0]) * off(pair[1]));
        lag.add((products.sum::<f64>() / (all - 1.0) - bias * bias) / square);
        let plain = 150.0 + bias;
        // The mean of the binned distribution differs from the plain mean by half a bin at most.
        let width = LONGEST / BINS;
        let binned = times.iter().filter(|time| **time < LONGEST);
        let middles: Vec<f64> = binned
            .map(|time| ((time / width).floor() + 0.5) * width)
            .collect();
        let from_bins = middles.iter().sum::<f64>() / middles.len() as f64;
        rows.compare_in("(30)", from_bins, plain, 0.5 * width);
        // Number of impacts in successive windows of time.
        let (mut counted, mut time, mut count) = (SampleMean::default(), 0.0, 0.0);
        for (_, impact) in &flights.0 {
            time += impact.flight;
            while time >= WINDOW {
                time -= WINDOW;
                counted.add(std::mem::take(&mut count));
            }
            count += 1.0;
        }
        let (counts, error) = estimate(&counted);
        rows.compare_in("finding count", counts, WINDOW / plain, 6.0 * error);
        let variance = error * error * counted.count() as f64;
        variances.add(variance / (square * WINDOW / plain.powi(3)));
    }
    // Phase-synchronised chaos, where the mean cosine is larger still.
    let narrow = Map::build(0.34, 0.2)?;
    let mut orbit = Orbit::new(&narrow, Map::state(0.9, 0.36)?);
    orbit.watch(1000, &mut ());
    let mut flights = Flights::default();
    orbit.watch(20_000, &mut flights);
    let narrow = mean_cosine(&flights);
    // Reference: long runs, rounded.
    let (cos, cos_error) = estimate(&cosines);
    let key = "finding cosine";
    rows.compare_in(key, cos, 0.197, 5e-4 + 6.0 * cos_error);
    rows.compare_in(key, narrow, 0.681, 5e-3);
    rows.fill(key, &[(cos, 3), (cos_error, 1), (narrow, 3)]);
    // A correlation is reported at 10 standard errors from zero.
    let (rho, rho_error) = estimate(&lag);
    rows.deviation("finding correlation", 10.0 * rho_error / rho.abs());
    rows.fill("finding correlation", &[(rho, 3), (rho_error, 1)]);
    // A variance other than that of independent intervals is 6 standard errors from one.
    let (ratio, ratio_error) = estimate(&variances);
    rows.deviation("finding variance", 6.0 * ratio_error / (ratio - 1.0).abs());
    rows.fill("finding variance", &[(ratio, 3), (ratio_error, 1)]);
    let impacts = u64::from(RUNS) * IMPACTS;
    for key in [
        "(30)",
        "finding correlation",
        "finding count",
        "finding variance",
    ] {
        rows.count(key, impacts);
    }
    rows.count("finding cosine", impacts + 20_000);
    Ok(())
}

/// (31) to (33), for independent intervals: averages over all sequences of two interval lengths.
fn independent(rows: &mut Ledger) -> Result<()> {
    const N: usize = 9;
    let mut cases = Cases(15);
    for _ in 0..60 {
        let lengths = [cases.within(0.5, 8.0), cases.within(0.5, 8.0)];
        let chance = cases.within(0.1, 0.9);
        let chances = [chance, 1.0 - chance];
        let mean =
            |value: fn(f64) -> f64| chances[0] * value(lengths[0]) + chances[1] * value(lengths[1]);
        let k = cases.within(0.05, 0.6);
        let (r, rt) = (cases.within(0.2, 0.9), cases.within(0.2, 0.9));
        let (eta, tangent) = (cases.within(0.2, 3.0), cases.within(-0.3, 0.3));
        // (30), and <delta(tau_l)> by the characteristic function, Re chi^l (chi - 1): the
        // convolutions of (32).
        let interval = mean(|length| length);
        let (re, im) = (mean(f64::cos), mean(f64::sin));
        let power = |n: usize| re.hypot(im).powi(n as i32) * (n as f64 * im.atan2(re)).cos();
        let expected = |l: usize| power(l + 1) - power(l);
        // With stationary initial values (31) holds for every n, not only for large n.
        let settled_along = -k * tangent * rt * interval / (1.0 - rt);
        let settled_normal = k * r * interval / (1.0 + r);
        let (mut phi_mean, mut psi_mean, mut w_mean) = (0.0, 0.0, 0.0);
        let mut deltas = [0.0; N];
        for sequence in 0_u32..1 << (N + 1) {
            let pick = |l: usize| (sequence >> l & 1) as usize;
            let weight: f64 = (0..=N).fold(1.0, |weight, l| weight * chances[pick(l)]);
            let (mut phi, mut psi, mut clock) = (settled_along, settled_normal, 0.0_f64);
            for (l, sum) in deltas.iter_mut().enumerate() {
                let d = lengths[pick(l)];
                let delta = (clock + d).cos() - clock.cos();
                *sum += weight * delta;
                phi = rt * (phi - eta * delta - k * tangent * d);
                psi = r * (k * d + delta - psi);
                clock += d;
            }
            phi_mean += weight * phi;
            psi_mean += weight * psi;
            w_mean += weight * (phi - eta * psi + lengths[pick(N)] * 0.5 * k * (eta - tangent));
        }
        for (l, delta) in deltas.into_iter().enumerate() {
            rows.compare("(32)", expected(l), delta);
        }
        let sum = |base: f64| -> f64 {
            let terms = (0..N).map(|l| base.powi((N - l) as i32) * expected(l));
            terms.sum()
        };
        rows.compare("(31a)", settled_along - eta * sum(rt), phi_mean);
        rows.compare("(31b)", settled_normal - sum(-r), psi_mean);
        rows.print("(31b)", settled_normal + sum(-r), psi_mean);
        let drive = eta * (1.0 - r) / (1.0 + r) - tangent * (1.0 + rt) / (1.0 - rt);
        let mean = 0.5 * k * interval * drive - eta * (sum(rt) - sum(-r));
        rows.compare("(33)", mean, w_mean);
    }
    Ok(())
}

/// Largest launch velocity of a persistent orbit: fixed point of
/// `psi = R (1 + sqrt((psi + 1)^2 + 4 k))`, for any track within -1..1 of speed at most 1.
fn largest_launch(k: f64, restitution: f64) -> f64 {
    let next = |psi: f64, _| restitution * (1.0 + ((psi + 1.0).powi(2) + 4.0 * k).sqrt());
    (0..2000).fold(0.0, next)
}

/// (35): the largest psi, in units of its bound.
fn highest_launch(rows: &mut Ledger) -> Result<()> {
    let mut cases = Cases(10);
    for _ in 0..400 {
        let k = cases.within(0.02, 1.0);
        let restitution = cases.within(0.05, 0.9);
        let printed = (1.0 + restitution) / (1.0 - restitution);
        let map = Map::build(k, restitution)?;
        let start = Map::state(cases.within(0.0, TAU), cases.within(0.0, printed))?;
        let mut flights = Flights::default();
        Orbit::new(&map, start).watch(400, &mut flights);
        let launches = flights.0.iter().map(|(_, impact)| impact.next.velocity);
        rows.deviation("(35)", launches.fold(0.0, f64::max) / printed);
        rows.deviation("(35)", largest_launch(k, restitution) / printed);
    }
    rows.count("(35)", 400 * 400);
    Ok(())
}

pub(super) fn run_wide_chaos(k: f64, runs: u32, impacts: u64) -> Result<Vec<Conveyed>> {
    let map = Map::build(k, 0.9)?;
    let run = |n| {
        let n = f64::from(n);
        let launch = Map::state(0.5 + 0.37 * n, 3.0 + 0.41 * n)?;
        Ok(convey(&map, CHAOS, launch, [300, impacts])?)
    };
    (0..runs).map(run).collect()
}

/// Mean over runs, and its standard error.
pub(super) fn mean_of(runs: &[Conveyed], value: fn(&Conveyed) -> Option<f64>) -> (f64, f64) {
    estimate(&SampleMean::from_values(runs.iter().filter_map(value)))
}

/// (36), (37): longest mean interval and bound of the impact mean, attained where a lock is born.
fn bounds(rows: &mut Ledger) -> Result<()> {
    for (restitution, order, _, k) in bands()? {
        if restitution > 0.91 {
            break;
        }
        let gain = (1.0 + restitution) / (1.0 - restitution);
        let interval = TAU * f64::from(order);
        rows.compare("(36)", 2.0 / k * gain / interval, 1.0);
        rows.print("(36)", 1.0 / k * gain / interval, 1.0);
        let velocity = locked::velocity_in_phase(order, k, restitution, &CHAOS);
        rows.compare("(37)", locked::bound(restitution, &CHAOS), velocity);
    }
    let runs = run_wide_chaos(0.05, 24, 6000)?;
    let bound = locked::bound(0.9, &CHAOS);
    for mean in runs.iter().filter_map(Conveyed::impact_mean) {
        rows.at_most("(37)", mean, bound);
    }
    let (time, time_error) = mean_of(&runs, Conveyed::time_mean);
    let (impact, impact_error) = mean_of(&runs, Conveyed::impact_mean);
    // Reference: long runs, rounded.
    let key = "finding time-mean";
    rows.compare_in(key, impact, 0.0463, 5e-5 + 6.0 * impact_error);
    rows.compare_in(key, time, 0.272, 5e-4 + 6.0 * time_error);
    rows.count(key, runs.iter().map(|run| run.impacts).sum());
    rows.fill(key, &[(time, 3), (time_error, 1), (bound, 3), (impact, 3)]);
    Ok(())
}

/// (38): dead parts.
fn dead(rows: &mut Ledger) -> Result<()> {
    let mut cases = Cases(11);
    for _ in 0..500 {
        let k = cases.within(0.05, 0.95);
        let map = Map::build(k, 0.0)?;
        let Some(low) = map.lift_off() else { continue };
        let margin = 0.01 * (PI - 2.0 * low);
        let phase = cases.within(low + margin, PI - low - margin);
        let (eta, tangent) = (cases.within(0.2, 3.0), cases.within(-0.3, 0.3));
        let launch = Map::state(phase, 0.0)?;
        let impact = map.impact(launch);
        let d = impact.flight;
        if d <= 0.0 {
            continue;
        }
        let tangential = Tangential::build(k, along(0.0, eta, 0.0, tangent))?;
        let (distance, _) = tangential.move_in_flight(launch, &impact, 0.0);
        let mean = distance / d;
        rows.compare("(38)", 0.5 * k * d * (eta - tangent), mean);
        rows.print("(38)", d * (k - 0.5 * k * tangent), mean);
    }
    Ok(())
}
