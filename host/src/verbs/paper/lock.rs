//! Equations (13) to (19): the period-1 orbit, its band, its cascade.

use std::f64::consts::{PI, TAU};

use kband::impact::{Kernel, Map, Orbit, Tangent};
use kband::regime::cascade::{Cascade, FEIGENBAUM};
use kband::regime::{Lock, Multipliers, band};

use super::engine::{Check, Ledger};
use crate::refusal::Refusal;
use crate::report::number;

pub(super) const CHECKS: &[Check] = &[
    period_one, birth, stability, flip, attraction, examples, above_one, cascade,
];

/// Band of a lock.
#[derive(Clone, Copy)]
pub(super) struct Band {
    pub restitution: f64,
    pub order: u32,
    /// k of the flip.
    pub low: f64,
    /// k of the birth.
    pub high: f64,
}

/// Bands of restitutions 0.05 to 0.95 and orders 1 to 5.
pub(super) fn bands() -> Result<Vec<Band>, Refusal> {
    let mut bands = Vec::new();
    for n in 1..20 {
        for order in 1..=5 {
            let restitution = 0.05 * f64::from(n);
            bands.push(Band {
                restitution,
                order,
                low: band::flip(restitution, order)?,
                high: band::birth(restitution, order)?,
            });
        }
    }
    Ok(bands)
}

pub(super) fn lock(k: f64, restitution: f64, order: u32) -> Result<Lock, Refusal> {
    Lock::at(k, restitution, order)?.ok_or_else(|| {
        Refusal::new(
            format!("no lock of order {order} at k = {k}"),
            "report this",
        )
    })
}

/// Trace of the tangent map of the lock, and the size of its larger multiplier.
fn multiplier(k: f64, restitution: f64, order: u32) -> Result<(f64, f64), Refusal> {
    let map = Map::build(k, restitution)?;
    let state = lock(k, restitution, order)?.state();
    let tangent = Tangent::of(&map, state, &map.impact(state));
    let [[a, b], [c, d]] = tangent.map_or([[f64::NAN; 2]; 2], |tangent| tangent.jacobian);
    Ok((a + d, Multipliers::of(a + d, a * d - b * c).modulus()))
}

/// (13), (14): the orbit that returns to itself after r drive periods.
fn period_one(rows: &mut Ledger) -> Result<(), Refusal> {
    for band in bands()? {
        for part in [0.1, 0.5, 0.9] {
            let (r, restitution) = (f64::from(band.order), band.restitution);
            let k = band.low + part * (band.high - band.low);
            let map = Map::build(k, restitution)?;
            // Found by the map alone, from a start beside the orbit.
            let beside = lock(k, restitution, band.order)?.state();
            let start = Map::state(beside.phase + 1e-6, beside.velocity)?;
            let mut orbit = Orbit::new(&map, start);
            orbit.watch(20_000, &mut ());
            let mut state = orbit.state();
            let velocity = TAU * r * k * restitution / (1.0 + restitution);
            let cosine = PI * r * k * (1.0 - restitution) / (1.0 + restitution);
            rows.compare("(14a)", velocity, state.velocity);
            rows.compare("(14b)", cosine.acos(), state.phase);
            let mut time = 0.0;
            for n in 1..=4 {
                let impact = map.impact(state);
                time += impact.flight;
                state = impact.next;
                rows.compare("(13)", TAU * r * f64::from(n), time);
                rows.print("(13)", TAU * r * f64::from(n - 1), time);
            }
        }
    }
    Ok(())
}

/// (15): a saddle-node, where a multiplier is 1 - O(sqrt(1 - k/k1)).
fn birth(rows: &mut Ledger) -> Result<(), Refusal> {
    for band in bands()? {
        let square = band.restitution * band.restitution;
        let (trace, _) = multiplier(band.high * (1.0 - 1e-13), band.restitution, band.order)?;
        rows.compare("(15)", trace - 1.0, square);
    }
    Ok(())
}

/// (16): the phase at the flip.
fn stability(rows: &mut Ledger) -> Result<(), Refusal> {
    for band in bands()? {
        let (r, square) = (f64::from(band.order), band.restitution * band.restitution);
        let steepest = 2.0 / (PI * r) * (1.0 + square) / (1.0 - square);
        let state = lock(band.low, band.restitution, band.order)?.state();
        let tangent = state.phase.tan();
        rows.compare("(16)", tangent / steepest, 1.0);
        rows.print("(16)", tangent / (steepest * r), 1.0);
    }
    Ok(())
}

/// (17), (17a): k of the multiplier -1, by one secant from the formula.
fn flip(rows: &mut Ledger) -> Result<(), Refusal> {
    for Band {
        restitution,
        order,
        low,
        ..
    } in bands()?
    {
        let square = restitution * restitution;
        let (trace, _) = multiplier(low, restitution, order)?;
        let (above, _) = multiplier(low * 1.000_001, restitution, order)?;
        let slope = (above - trace) / (low * 1e-6);
        rows.compare_in("(17a)", trace + 1.0, -square, slope);
        if order == 1 {
            rows.compare_in("(17)", trace + 1.0, -square, slope);
            let lossy = PI * PI * (1.0 - restitution) / (1.0 + restitution);
            let printed = lossy + 4.0 / (1.0 + square).sqrt() / (1.0 + restitution).powi(4);
            rows.print("(17)", printed, low);
        }
    }
    Ok(())
}

/// (18): the lock attracts within its band, and does not outside.
fn attraction(rows: &mut Ledger) -> Result<(), Refusal> {
    for Band {
        restitution,
        order,
        low,
        high,
    } in bands()?
    {
        for part in [0.01, 0.5, 0.99] {
            let (_, size) = multiplier(low + part * (high - low), restitution, order)?;
            rows.at_most("(18)", size, 1.0);
        }
        let (_, size) = multiplier(low * (1.0 - 1e-6), restitution, order)?;
        rows.at_most("(18)", 1.0, size);
        let beyond = Lock::at(high * (1.0 + 1e-12), restitution, order)?;
        rows.require("(18)", beyond.is_none());
    }
    Ok(())
}

/// The worked example at R = 0.2, as printed to four digits, and its listed numbers.
fn examples(rows: &mut Ledger) -> Result<(), Refusal> {
    for (key, order, low, high) in [
        ("example band-1", 1, 0.3928, 0.4774),
        ("example band-2", 2, 0.2213, 0.2387),
        ("example band-3", 3, 0.1551, 0.1591),
    ] {
        let (flip, birth) = (band::flip(0.2, order)?, band::birth(0.2, order)?);
        let trace = |k: f64| Ok::<_, Refusal>(lock(k, 0.2, order)?.trace());
        // Checked by the trace of the map at the edge, turned into k by its derivative there.
        let slope = (trace(flip * 1.000_001)? - trace(flip)?) / (flip * 1e-6);
        rows.compare_in(key, trace(flip)?, -1.04, slope);
        if order == 3 {
            // A value cut or rounded to four digits is within 1e-4.
            rows.require(key, (flip - low).abs().max((birth - high).abs()) < 1e-4);
            rows.count(key, 1);
        } else {
            rows.print(key, low, flip);
            rows.print(key, high, birth);
        }
        let recomputed = [number(flip, 5), number(birth, 5)];
        rows.fill(
            key,
            [low.to_string(), high.to_string()]
                .into_iter()
                .chain(recomputed),
        );
    }
    // k = g cos(alpha)/(b w^2): at 50 Hz and b in 1e-4 m the factor between k and cos(alpha)/b.
    let factor = 9.81 / (1e-4 * (TAU * 50.0).powi(2));
    rows.compare("example units", factor, 0.993_96);
    rows.print("example units", 1.0 / factor, 1.0);
    rows.fill("example units", [number(factor, 5)]);
    Ok(())
}

/// The claim that parts always come to rest at k > 1.
fn above_one(rows: &mut Ledger) -> Result<(), Refusal> {
    let lowest = (PI - 1.0) / (PI + 1.0);
    for n in 1..40 {
        let restitution = lowest + (0.98 - lowest) * f64::from(n) / 40.0;
        let birth = band::birth(restitution, 1)?;
        let k = 1.0 + 0.5 * (birth - 1.0);
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
    rows.fill("claim above-1", [number(lowest, 5)]);
    Ok(())
}

/// Restitution, order, and k of the doublings by a 40-digit continuation, rounded to f64.
const DOUBLINGS: [(f64, u32, &[f64]); 3] = [
    (
        0.2,
        1,
        &[
            0.393_052_167_586_172_9,
            0.366_000_656_686_421_4,
            0.360_278_291_826_409_34,
            0.359_056_247_737_207_4,
            0.358_794_621_746_470_17,
            0.358_738_595_215_785_3,
        ],
    ),
    (
        0.5,
        1,
        &[
            0.654_954_465_050_574_4,
            0.599_833_008_612_775_8,
            0.589_351_336_330_444_9,
            0.587_136_821_342_355_7,
            0.586_662_875_705_115_3,
            0.586_561_364_035_089_2,
        ],
    ),
    (
        0.5,
        2,
        &[
            0.421_784_812_671_680_56,
            0.406_784_778_021_891_2,
            0.403_821_877_710_445_55,
            0.403_185_960_263_948_7,
            0.403_049_584_204_998_5,
        ],
    ),
];

/// (19): the cascade and its constant.
fn cascade(rows: &mut Ledger) -> Result<(), Refusal> {
    for (restitution, order, flips) in DOUBLINGS {
        let cascade = Cascade::locate(restitution, order, flips.len())?;
        for (n, flip) in flips.iter().enumerate() {
            let found = cascade.flips().get(n).copied().unwrap_or(f64::NAN);
            rows.compare("finding doublings", found, *flip);
        }
        let ratio = cascade.ratios().last().unwrap_or(f64::NAN);
        rows.compare("(19)", ratio / FEIGENBAUM, 1.0);
        if (restitution, order) == (0.2, 1) {
            rows.fill("(19)", [number(ratio, 6)]);
        }
    }
    rows.print("(19)", 0.469_92 / FEIGENBAUM, 1.0);
    Ok(())
}
