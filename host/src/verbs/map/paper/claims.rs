//! Claims of Hongler & Figour 1989 about chaos and its neighbourhood, each recomputed.

use std::f64::consts::TAU;

use kband::impact::{
    Friction, FrictionSettings, Kernel, Map, Orbit, PartState, Scatter, Tangential, Tone, Wave,
};
use kband::regime::cascade::{Cascade, FEIGENBAUM};
use kband::regime::classify::Regime;
use kband::regime::exponent::{self, Dynamics, ExponentSettings};
use kband::regime::{Lock, band};
use kband::transport::{Conveyed, Conveying, locked, sensitivity};

use super::engine::{Cases, Check, Ledger, convey};
use super::hopping::{CHAOS, mean_of, run_wide_chaos};
use super::lock::lock;
use crate::ending::Endings;
use crate::refusal::Result;

pub(super) const CHECKS: &[Check] = &[
    lyapunov,
    |rows| chaotic_ranges(rows, "claim ranges-0.1", 0.1),
    |rows| chaotic_ranges(rows, "claim ranges-0.2", 0.2),
    |rows| chaotic_ranges(rows, "claim ranges-0.3", 0.3),
    |rows| chaotic_ranges(rows, "claim ranges-0.5", 0.5),
    |rows| chaotic_ranges(rows, "claim ranges-0.7", 0.7),
    |rows| chaotic_ranges(rows, "claim ranges-0.9", 0.9),
    hop_and_rest,
    dead_cascade,
    robustness,
    diffusion,
    noise,
    two_tones,
    impacts_on_track,
    sliding,
];

const fn effort(settle: u32, impacts: u32) -> ExponentSettings {
    ExponentSettings { settle, impacts }
}

/// Whether chaos below the accumulation point has a positive Lyapunov exponent.
fn lyapunov(rows: &mut Ledger) -> Result<()> {
    const IMPACTS: u32 = 40_000;
    // docs/theory-reference.md#t11.3, with an error of 0.003.
    let references = [
        (0.43, 0.2, -1.3307),
        (0.358, 0.2, 0.0778),
        (0.355, 0.2, 0.0522),
        (0.35, 0.2, 0.3622),
        (0.34, 0.2, 0.5020),
        (0.586, 0.5, 0.0860),
    ];
    for (k, restitution, reference) in references {
        let map = Map::build(k, restitution)?;
        let start = exponent::start_near_lock(&map, 1);
        let estimate = exponent::measure(&map, start, effort(3000, IMPACTS))?.per_impact;
        let allowed = 0.003 + 6.0 * estimate.error;
        rows.compare_in("claim chaos", estimate.value, reference, allowed);
    }
    rows.count("claim chaos", references.len() as u64 * u64::from(IMPACTS));
    Ok(())
}

/// Starts near the period-1 orbits of orders 1 to 3, and `spread` starts over phase and velocity.
fn starts(k: f64, restitution: f64, spread: u32) -> Result<Vec<PartState>> {
    let mut starts = Vec::new();
    for order in 1..=3 {
        if let Some(lock) = Lock::build(k, restitution, order)? {
            let PartState { phase, velocity } = lock.state();
            starts.push(Map::state(phase + 1e-3, velocity)?);
        }
    }
    let mut cases = Cases(16);
    let highest = 1.0 + 2.5 * restitution / (1.0 - restitution);
    for _ in 0..spread {
        let phase = cases.within(0.0, TAU);
        starts.push(Map::state(phase, cases.within(0.0, highest))?);
    }
    Ok(starts)
}

/// Claim: chaos has wide ranges of k between narrow strips of locks. Chaos is a positive exponent
/// without a rest in 3000 impacts: a part in wide chaos rests once in some 40 000.
fn chaotic_ranges(rows: &mut Ledger, key: &'static str, restitution: f64) -> Result<()> {
    const COLUMNS: u32 = 96;
    let settings = effort(2000, 960);
    // Numbers of columns with chaos, with a lock, and with hopping and resting.
    let mut counts = [0_u32; 3];
    for n in 0..COLUMNS {
        let k = 0.05 + 0.01 * f64::from(n);
        let map = Map::build(k, restitution)?;
        let mut occurs = [false; 3];
        for start in starts(k, restitution, 2)? {
            match exponent::measure(&map, start, settings)?.dynamics {
                Dynamics::Chaotic => occurs[0] = true,
                Dynamics::Rest { .. } => occurs[2] = true,
                Dynamics::Regular | Dynamics::Undecided => {}
            }
        }
        for order in 1..=8 {
            let lock = Lock::build(k, restitution, order)?;
            occurs[1] |= lock.is_some_and(|lock| lock.attracts() && lock.is_first_return());
        }
        for (count, occurs) in counts.iter_mut().zip(occurs) {
            *count += u32::from(occurs);
        }
    }
    let percent = |count| (100.0 * f64::from(count) / f64::from(COLUMNS), 3);
    rows.fill(key, &counts.map(percent));
    let [chaos, lock, _] = counts;
    // Chaos has the wider ranges only if parts lose little speed.
    let (chaos, lock) = (f64::from(chaos), f64::from(lock));
    let is_lively = restitution > 0.8;
    let ratio = if is_lively {
        lock / chaos
    } else {
        chaos / lock
    };
    // Required margin: 1.5 times as wide.
    rows.deviation(key, 1.5 * ratio);
    rows.count(key, COLUMNS.into());
    Ok(())
}

/// Claim: between k1 and 1 parts hop and slide; without friction this is hopping and resting.
fn hop_and_rest(rows: &mut Ledger) -> Result<()> {
    for restitution in [0.2, 0.3, 0.5] {
        let birth = band::birth(restitution, 1)?;
        for n in 0..30 {
            let k = birth + (1.0 - birth) * (f64::from(n) + 0.5) / 30.0;
            let endings = Endings::new(k, restitution, 4000)?;
            let mut regimes = endings.classify_all(starts(k, restitution, 6)?.into_iter());
            regimes.push(endings.from_rest());
            for regime in regimes {
                rows.require("claim rest", matches!(regime, Regime::HopAndRest { .. }));
            }
        }
    }
    Ok(())
}

/// Claim: dead parts have the cascade of a quadratic map.
fn dead_cascade(rows: &mut Ledger) -> Result<()> {
    const COLUMNS: u32 = 600;
    let mut rests = 0_u32;
    for n in 0..COLUMNS {
        let k = 0.05 + 0.949 * (f64::from(n) + 0.5) / f64::from(COLUMNS);
        let map = Map::build(k, 0.0)?;
        rests += u32::from(Orbit::from_rest(&map).watch(2000, &mut ()));
    }
    let share = f64::from(rests) / f64::from(COLUMNS);
    let flips = Cascade::locate(0.0, 1, 3)?.flips().to_vec();
    let first = flips.first().copied().unwrap_or(f64::NAN);
    // One flip, at (pi^2 + 4)^(-1/2). Of 1200 other k, 94.1 % are periodic.
    let closed = (0.25 * TAU * TAU + 4.0).sqrt().recip();
    rows.compare_in("claim dead", share, 0.941, 0.01);
    rows.compare_in("claim dead", first, closed, 1e-12);
    rows.require("claim dead", flips.len() == 1);
    rows.fill("claim dead", &[(first, 6), (100.0 * share, 3)]);
    rows.count("claim dead", COLUMNS.into());
    Ok(())
}

/// Claim: chaos makes the conveying speed insensitive to the amplitude. It holds only in gear.
fn robustness(rows: &mut Ledger) -> Result<()> {
    const RUNS: u32 = 20;
    const WIDE_IMPACTS: u64 = 6000;
    const NARROW_IMPACTS: u64 = 20_000;
    let time_mean = |k: f64| -> Result<(f64, f64, f64)> {
        let runs = run_wide_chaos(k, RUNS, WIDE_IMPACTS)?;
        let (mean, error) = mean_of(&runs, Conveyed::time_mean);
        Ok((k, mean, error))
    };
    let wide = sensitivity(time_mean(0.03)?, time_mean(0.09)?);
    let (value, error) = wide.map_or((f64::NAN, f64::NAN), |wide| (wide.value, wide.error));
    let key = "finding in-gear";
    let (mut rates, mut largest) = (Vec::new(), 0.0_f64);
    for k in [0.342, 0.346, 0.35, 0.354, 0.358] {
        let map = Map::build(k, 0.2)?;
        let start = exponent::start_near_lock(&map, 1);
        let conveyed = convey(&map, CHAOS, start, [2000, NARROW_IMPACTS])?;
        let lock = locked::velocity_in_phase(1, k, 0.2, &CHAOS);
        // (34) with D = 2 pi. The tolerance is the part of the run's two ends, with W of at most 6.
        let mean = conveyed.impact_mean().unwrap_or(f64::NAN);
        rows.compare_in(key, mean, lock, 2.0 * 6.0 / NARROW_IMPACTS as f64);
        let speed = conveyed.time_mean().unwrap_or(f64::NAN);
        rows.compare_in(key, speed / lock, 1.0, 4e-3);
        largest = largest.max((speed / lock - 1.0).abs());
        rates.push((k, speed, 0.0));
    }
    rows.fill(key, &[(100.0 * largest, 2)]);
    let narrow = rates.len() as u64 * NARROW_IMPACTS;
    rows.count(key, narrow);
    let pairs = rates.windows(2);
    let slopes = pairs.filter_map(|pair| sensitivity(pair[0], pair[1]));
    let steepness = slopes.map(|estimate| estimate.value.abs());
    let steepest = steepness.fold(0.0, f64::max);
    // References: 1.000 +- 0.002 of a long run in wide chaos; at most 0.065 at 17 k of the cascade.
    let key = "claim robustness";
    rows.compare_in(key, value, 1.0, 0.005 + 6.0 * error);
    rows.deviation(key, steepest / 0.1);
    rows.fill(key, &[(steepest, 2), (value, 3), (error, 1)]);
    rows.count(key, 2 * u64::from(RUNS) * WIDE_IMPACTS + narrow);
    Ok(())
}

/// `Var(x - V t)/(2 t)` over blocks of 1 and of 300 flights, in `b^2 w`.
fn dispersions(k: f64, restitution: f64, start: PartState) -> Result<[f64; 2]> {
    const FLIGHTS: u64 = 60_000;
    let map = Map::build(k, restitution)?;
    let mut conveying = Conveying::new(Tangential::build(k, CHAOS)?, &map);
    let mut orbit = Orbit::new(&map, start);
    orbit.watch(1000, &mut conveying);
    let mut flights = Vec::new();
    for _ in 0..FLIGHTS {
        conveying.restart();
        orbit.watch(1, &mut conveying);
        let conveyed = conveying.conveyed();
        flights.push((conveyed.distance, conveyed.flying + conveyed.resting));
    }
    let sum = |flights: &[(f64, f64)]| -> (f64, f64) {
        let add = |sum: (f64, f64), flight: &(f64, f64)| (sum.0 + flight.0, sum.1 + flight.1);
        flights.iter().fold((0.0, 0.0), add)
    };
    let (travel, time) = sum(&flights);
    let velocity = travel / time;
    Ok([1, 300].map(|length| {
        let squares = flights.chunks_exact(length).map(|block| {
            let (travel, time) = sum(block);
            (travel - velocity * time).powi(2)
        });
        squares.sum::<f64>() / (2.0 * time)
    }))
}

/// Claim in the paper's last paragraph: chaos spreads parts as diffusion does.
fn diffusion(rows: &mut Ledger) -> Result<()> {
    let [one, many] = dispersions(0.35, 0.2, Map::state(0.8, 0.36)?)?;
    let [wide_one, wide_many] = dispersions(0.05, 0.9, Map::state(0.5, 4.0)?)?;
    for key in ["claim diffusion", "finding dispersion"] {
        // Without diffusion only the ends of the blocks contribute: 1/300 of that of one flight.
        rows.deviation(key, many / one / 0.02);
        rows.deviation(key, 0.1 / (wide_many / wide_one));
        rows.count(key, 2 * 60_000);
    }
    let cells = [one, many, wide_one, wide_many].map(|value| (value, 2));
    rows.fill("finding dispersion", &cells);
    Ok(())
}

/// Claim: noise truncates the cascade.
fn noise(rows: &mut Ledger) -> Result<()> {
    // Between the third and the fourth flip the orbit repeats after eight impacts.
    let (k, restitution) = (0.3595, 0.2);
    let map = Map::build(k, restitution)?;
    let settings = effort(3000, 60_000);
    let start = exponent::start_near_lock(&map, 1);
    let still = exponent::measure(&map, start, settings)?.per_impact;
    let scatter = Scatter::build(restitution, 0.05 * restitution, 14)?;
    let noisy = exponent::measure_scattered(&map, start, settings, scatter)?.per_impact;
    let cascade = Cascade::locate(restitution, 1, 6)?;
    let visible: Vec<f64> = cascade.max_visible_scatters().flatten().collect();
    let ratio = visible.windows(2);
    let ratio = ratio.last().map_or(f64::NAN, |pair| pair[0] / pair[1]);
    let key = "claim noise";
    rows.require(key, still.value < 0.0 && noisy.value > 0.0);
    rows.deviation(key, 3.0 * still.error / -still.value);
    rows.deviation(key, 3.0 * noisy.error / noisy.value);
    // The last of six doublings is within 15 % of the limit.
    rows.compare_in(key, ratio / 6.62, 1.0, 0.15);
    rows.count(key, 120_000);
    rows.fill(key, &[(still.value, 2), (noisy.value, 2), (ratio, 3)]);
    Ok(())
}

/// Claim: a second tone shifts the cascade and keeps its ratio.
fn two_tones(rows: &mut Ledger) -> Result<()> {
    let key = "claim tones";
    let single = band::flip(0.2, 1)?;
    let mut flips = vec![(single, 4)];
    for amplitude in [0.05, 0.1] {
        let wave = Wave::build(Tone::new(amplitude, 2.487), Tone::default())?;
        let cascade = Cascade::on_tones(&wave, 0.2, 1, 6)?;
        let last = cascade.as_ref().and_then(|cascade| cascade.ratios().last());
        let last = last.unwrap_or(f64::NAN);
        rows.compare_in(key, last / FEIGENBAUM, 1.0, 5e-3);
        let first = cascade.map_or(f64::NAN, |cascade| cascade.flips()[0]);
        // Required shift: 1 % of k.
        rows.deviation(key, 0.01 * single / (first - single));
        flips.push((first, 4));
    }
    rows.fill(key, &flips);
    Ok(())
}

/// Claim: impacts do not alter the motion of the track.
fn impacts_on_track(rows: &mut Ledger) -> Result<()> {
    for (k, restitution) in [(0.43, 0.2), (0.55, 0.3), (0.75, 0.5)] {
        let launch = lock(k, restitution, 1)?.state();
        let impact = Map::build(k, restitution)?.impact(launch);
        // The impulse on the track, (1 + R) s, in m b w, and its first harmonic over one period.
        let impulse = (1.0 + restitution) / restitution * impact.next.velocity;
        let (sine, cosine) = impact.next.phase.sin_cos();
        // Force over M b w^2 in units of m/M: -2 k cos(tau - t0).
        let (t_sine, t_cosine) = launch.phase.sin_cos();
        let harmonic = 2.0 * impulse / TAU;
        rows.compare("claim track", 2.0 * k * t_sine, harmonic * sine);
        rows.compare("claim track", 2.0 * k * t_cosine, harmonic * cosine);
    }
    // The printed formula neglects the added loss.
    let lost = 2.0 * 0.43 * lock(0.43, 0.2, 1)?.state().phase.cos();
    rows.print("claim track", 0.0, lost);
    rows.fill("claim track", &[(lost, 3)]);
    Ok(())
}

/// Claim: inertia conveys parts in contact if the track's force is asymmetric.
fn sliding(rows: &mut Ledger) -> Result<()> {
    // References of docs/theory-real-parts.md#t10.4, from stepwise integrations.
    for (throw, friction, incline, reference) in [
        (0.6, 0.8, 3.0_f64, 0.386_499),
        (0.9, 0.8, 3.0, 0.822_437),
        (1.0, 0.3, 0.0, 0.636_358),
    ] {
        let settings = FrictionSettings {
            sticking: friction,
            sliding: friction,
            amplitude_ratio: 3.0_f64.sqrt(),
            phase_lead: 0.0,
            incline_tangent: incline.to_radians().tan(),
        };
        let cycle = Friction::build(1.0 / throw, settings)?.steady_contact_cycle();
        let velocity = cycle.map_or(f64::NAN, |cycle| cycle.distance / TAU);
        rows.compare("claim contact", velocity, reference);
        // On a level track, in phase and without normal motion, the forces cancel.
        let still = FrictionSettings {
            incline_tangent: 0.0,
            ..settings
        };
        let even = Friction::build(1000.0, still)?.steady_contact_cycle();
        let distance = even.map_or(f64::NAN, |cycle| cycle.distance);
        rows.compare("claim contact", distance, 0.0);
    }
    Ok(())
}
