//! Equations (13) to (23): the period-1 orbit, its band, its cascade, its conveying velocity.

use std::f64::consts::{PI, TAU};

use kband::impact::{Kernel, Map, Orbit, Tangent, TangentialSettings};
use kband::regime::cascade::{Cascade, FEIGENBAUM};
use kband::regime::{Lock, Multipliers, band};
use kband::transport::locked;

use super::engine::{Cases, Check, Ledger, along, convey};
use crate::refusal::{Refusal, Result};

pub(super) const CHECKS: &[Check] = &[
    period_one, edges, examples, above_one, cascade, velocity, phase_lead,
];

/// Restitutions 0.05 to 0.95 and orders 1 to 5, each with k of the flip and of the birth.
pub(super) fn bands() -> Result<Vec<(f64, u32, f64, f64)>> {
    let mut bands = Vec::new();
    for n in 1..20 {
        let restitution = 0.05 * f64::from(n);
        for order in 1..=5 {
            let low = band::flip(restitution, order)?;
            bands.push((restitution, order, low, band::birth(restitution, order)?));
        }
    }
    Ok(bands)
}

pub(super) fn lock(k: f64, restitution: f64, order: u32) -> Result<Lock> {
    Lock::build(k, restitution, order)?.ok_or_else(|| {
        let cause = format!("no lock of order {order} at k = {k}");
        Refusal::new(cause, "report this")
    })
}

/// Trace of the tangent map of the lock, and the size of its larger multiplier.
fn multiplier(k: f64, restitution: f64, order: u32) -> Result<(f64, f64)> {
    let map = Map::build(k, restitution)?;
    let state = lock(k, restitution, order)?.state();
    let tangent = Tangent::build(&map, state, &map.impact(state));
    let [[a, b], [c, d]] = tangent.map_or([[f64::NAN; 2]; 2], |tangent| tangent.jacobian);
    let multipliers = Multipliers::from_trace(a + d, a * d - b * c);
    Ok((a + d, multipliers.modulus()))
}

/// (13), (14): the orbit that returns to itself after r drive periods.
fn period_one(rows: &mut Ledger) -> Result<()> {
    for (restitution, order, low, high) in bands()? {
        for part in [0.1, 0.5, 0.9] {
            let k = low + part * (high - low);
            let map = Map::build(k, restitution)?;
            // Found by the map alone, from a start near the orbit.
            let lock = lock(k, restitution, order)?.state();
            let start = Map::state(lock.phase + 1e-6, lock.velocity)?;
            let mut orbit = Orbit::new(&map, start);
            orbit.watch(20_000, &mut ());
            let mut state = orbit.state();
            rows.compare("(14a)", lock.velocity, state.velocity);
            rows.compare("(14b)", lock.phase, state.phase);
            let (mut time, period) = (0.0, TAU * f64::from(order));
            for n in 1..=4 {
                let impact = map.impact(state);
                time += impact.flight;
                state = impact.next;
                rows.compare("(13)", period * f64::from(n), time);
                rows.print("(13)", period * f64::from(n - 1), time);
            }
        }
    }
    Ok(())
}

/// (15) to (18): the edges of the band, and attraction within.
fn edges(rows: &mut Ledger) -> Result<()> {
    for (restitution, order, low, high) in bands()? {
        let square = restitution * restitution;
        let multiplier = |k| multiplier(k, restitution, order);
        // At the saddle-node a multiplier is 1 - O(sqrt(1 - k/k1)).
        let (trace, _) = multiplier(high * (1.0 - 1e-13))?;
        rows.compare("(15)", trace - 1.0, square);
        // Phase at the flip.
        let r = f64::from(order);
        let steepest = 2.0 / (PI * r) * (1.0 + square) / (1.0 - square);
        let tangent = lock(low, restitution, order)?.state().phase.tan();
        rows.compare("(16)", tangent / steepest, 1.0);
        rows.print("(16)", tangent / (steepest * r), 1.0);
        // k of the multiplier -1, by one secant step from the formula.
        let (trace, _) = multiplier(low)?;
        let slope = (multiplier(low * 1.000_001)?.0 - trace) / (low * 1e-6);
        rows.compare_in("(17a)", trace + 1.0, -square, slope);
        if order == 1 {
            rows.compare_in("(17)", trace + 1.0, -square, slope);
            let lossy = PI * PI * (1.0 - restitution) / (1.0 + restitution);
            let printed = lossy + 4.0 / (1.0 + square).sqrt() / (1.0 + restitution).powi(4);
            rows.print("(17)", printed, low);
        }
        // The lock attracts only within its band.
        for part in [0.01, 0.5, 0.99] {
            rows.at_most("(18)", multiplier(low + part * (high - low))?.1, 1.0);
        }
        rows.at_most("(18)", 1.0, multiplier(low * (1.0 - 1e-6))?.1);
        let outside = Lock::build(high * (1.0 + 1e-12), restitution, order)?;
        rows.require("(18)", outside.is_none());
    }
    Ok(())
}

/// The worked example at R = 0.2, printed with four digits, and its listed numbers.
fn examples(rows: &mut Ledger) -> Result<()> {
    for (key, order, low, high) in [
        ("example band-1", 1, 0.3928, 0.4774),
        ("example band-2", 2, 0.2213, 0.2387),
        ("example band-3", 3, 0.1551, 0.1591),
    ] {
        let (flip, birth) = (band::flip(0.2, order)?, band::birth(0.2, order)?);
        let trace = |k: f64| Ok::<_, Refusal>(lock(k, 0.2, order)?.trace());
        // Checked by the trace of the map at the edge, converted to k by its derivative.
        let slope = (trace(flip * 1.000_001)? - trace(flip)?) / (flip * 1e-6);
        rows.compare_in(key, trace(flip)?, -1.04, slope);
        if order == 3 {
            // A value truncated or rounded to four digits is within 1e-4.
            rows.require(key, (flip - low).abs().max((birth - high).abs()) < 1e-4);
            rows.count(key, 1);
        } else {
            rows.print(key, low, flip);
            rows.print(key, high, birth);
        }
        rows.fill(key, &[(low, 4), (high, 4), (flip, 5), (birth, 5)]);
    }
    // k = g cos(alpha)/(b w^2): at 50 Hz and b in 1e-4 m the factor between k and cos(alpha)/b.
    let factor = 9.81 / (1e-4 * (TAU * 50.0).powi(2));
    rows.compare("example units", factor, 0.993_96);
    rows.print("example units", 1.0 / factor, 1.0);
    rows.fill("example units", &[(factor, 5)]);
    Ok(())
}

/// Claim: parts always come to rest at k > 1.
fn above_one(rows: &mut Ledger) -> Result<()> {
    let lowest = (PI - 1.0) / (PI + 1.0);
    for n in 1..40 {
        let restitution = lowest + (0.98 - lowest) * f64::from(n) / 40.0;
        let k = 1.0 + 0.5 * (band::birth(restitution, 1)? - 1.0);
        let lock = lock(k, restitution, 1)?;
        if !lock.attracts() {
            continue;
        }
        let map = Map::build(k, restitution)?;
        let state = lock.state();
        let mut orbit = Orbit::new(&map, Map::state(state.phase + 1e-4, state.velocity)?);
        orbit.watch(3000, &mut ());
        rows.compare("claim above-1", lock.distance(orbit.state()), 0.0);
    }
    rows.fill("claim above-1", &[(lowest, 5)]);
    Ok(())
}

/// k of doublings by a 40-digit continuation, rounded to f64.
const FLIPS: [&str; 3] = [
    "0.3930521675861729 0.3660006566864214 0.36027829182640934 0.3590562477372074 0.35879462174647017 0.3587385952157853",
    "0.6549544650505744 0.5998330086127758 0.5893513363304449 0.5871368213423557 0.5866628757051153 0.5865613640350892",
    "0.42178481267168056 0.4067847780218912 0.40382187771044555 0.4031859602639487 0.4030495842049985",
];

/// (19): the cascade and its constant.
fn cascade(rows: &mut Ledger) -> Result<()> {
    for ((restitution, order), flips) in [(0.2, 1), (0.5, 1), (0.5, 2)].into_iter().zip(FLIPS) {
        let flips: Vec<&str> = flips.split(' ').collect();
        let cascade = Cascade::locate(restitution, order, flips.len())?;
        for (n, flip) in flips.iter().enumerate() {
            let value = cascade.flips().get(n).copied().unwrap_or(f64::NAN);
            rows.compare("finding doublings", value, flip.parse().unwrap_or(f64::NAN));
        }
        let ratio = cascade.ratios().last().unwrap_or(f64::NAN);
        rows.compare("(19)", ratio / FEIGENBAUM, 1.0);
        if (restitution, order) == (0.2, 1) {
            rows.fill("(19)", &[(ratio, 6)]);
        }
    }
    rows.print("(19)", 0.469_92 / FEIGENBAUM, 1.0);
    Ok(())
}

/// A lock at a k in each band, and tangential settings with a phase lead of at most `lead`.
fn draw(seed: u64, lead: f64, inclines: (f64, f64)) -> Result<Vec<(Lock, TangentialSettings)>> {
    let mut cases = Cases(seed);
    let draw = |(restitution, order, low, high)| {
        let k = low + cases.within(0.05, 0.95) * (high - low);
        let (rt, eta) = (cases.within(0.0, 0.9), cases.within(0.2, 3.0));
        let gamma = cases.within(-lead, lead);
        let tangent = cases.within(inclines.0, inclines.1);
        Ok((lock(k, restitution, order)?, along(rt, eta, gamma, tangent)))
    };
    bands()?.into_iter().map(draw).collect()
}

/// Time mean of the velocity, measured on the map after a transient.
fn measured(lock: &Lock, along: TangentialSettings) -> Result<f64> {
    let map = Map::build(lock.k(), lock.restitution())?;
    let conveyed = convey(&map, along, lock.state(), [300, 20])?;
    Ok(conveyed.time_mean().unwrap_or(f64::NAN))
}

/// (20) to (23): the velocity of locked parts.
fn velocity(rows: &mut Ledger) -> Result<()> {
    for (lock, mut along) in draw(8, 3.0, (-0.3, 0.3))? {
        let (k, order, restitution) = (lock.k(), lock.order(), lock.restitution());
        let velocity = measured(&lock, along)?;
        rows.compare("(20)", locked::velocity(&lock, k, &along), velocity);
        let (rt, eta) = (along.restitution, along.amplitude_ratio);
        let (gamma, tangent) = (along.phase_lead, along.incline_tangent);
        let flight = PI * f64::from(order) * k;
        let loss = (1.0 - restitution) / (1.0 + restitution);
        let printed = flight * (eta * gamma.cos() * loss - tangent * (1.0 + rt) / (1.0 - rt))
            - eta * gamma.sin() * (1.0 - (flight * loss).powi(2)).sqrt();
        rows.compare("(23)", printed, velocity);
        along.phase_lead = 0.0;
        let closed = locked::velocity_in_phase(order, k, restitution, &along);
        rows.compare("(21)", closed, measured(&lock, along)?);
        along.incline_tangent = locked::critical_slope_in_phase(restitution, &along);
        rows.compare("(22)", measured(&lock, along)?, 0.0);
    }
    Ok(())
}

/// Critical slope and best phase lead of locked parts.
fn phase_lead(rows: &mut Ledger) -> Result<()> {
    for (lock, mut along) in draw(9, 1.5, (0.0, 0.2))? {
        let best = -lock.state().phase;
        let velocity = |phase_lead| {
            let along = TangentialSettings {
                phase_lead,
                ..along
            };
            measured(&lock, along)
        };
        let off_optimum = velocity(best + 0.01)?.max(velocity(best - 0.01)?);
        rows.at_most("finding lead", off_optimum, velocity(best)?);
        along.incline_tangent = locked::critical_slope(&lock, lock.k(), &along);
        if along.incline_tangent.abs() <= 2.0 {
            rows.compare("finding slope", measured(&lock, along)?, 0.0);
        }
    }
    Ok(())
}
