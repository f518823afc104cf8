//! Equations (13) to (19): the period-1 orbit, its band, its cascade.

use std::f64::consts::{PI, TAU};

use kband::impact::{Kernel, Map, Orbit, Tangent};
use kband::regime::cascade::{Cascade, FEIGENBAUM};
use kband::regime::{Lock, Multipliers, band};

use super::row::{Row, Work, Worst};
use crate::refusal::Refusal;
use crate::report::number;

pub(super) const ROWS: &[Work] = &[period_one, edges, examples, above_one, cascade];

/// Restitutions and orders of the cases, with both edges of the band.
pub(super) fn bands() -> Result<Vec<(f64, u32, f64, f64)>, Refusal> {
    let mut bands = Vec::new();
    for n in 1..20 {
        for order in 1..=5 {
            let restitution = 0.05 * f64::from(n);
            bands.push((
                restitution,
                order,
                band::flip(restitution, order)?,
                band::birth(restitution, order)?,
            ));
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

/// (13), (14): the orbit that returns to itself after r drive periods.
fn period_one() -> Result<Vec<Row>, Refusal> {
    let (mut period, mut index, mut velocity, mut phase) = (
        Worst::default(),
        Worst::default(),
        Worst::default(),
        Worst::default(),
    );
    for (restitution, order, low, high) in bands()? {
        for part in [0.1, 0.5, 0.9] {
            let k = low + part * (high - low);
            let map = Map::build(k, restitution)?;
            // Found by the map alone, from a start beside the orbit.
            let state = lock(k, restitution, order)?.state();
            let start = Map::state(state.phase + 1e-6, state.velocity)?;
            let mut orbit = Orbit::new(&map, start);
            orbit.watch(20_000, &mut ());
            let mut state = orbit.state();
            let r = f64::from(order);
            velocity.see(state.velocity - TAU * r * k * restitution / (1.0 + restitution));
            let cosine = PI * r * k * (1.0 - restitution) / (1.0 + restitution);
            phase.see(state.phase - cosine.acos());
            let mut since = 0.0;
            for n in 1..=4 {
                let impact = map.impact(state);
                since += impact.flight;
                state = impact.next;
                period.see(since - TAU * r * f64::from(n));
                index.see(since - TAU * r * f64::from(n - 1));
            }
        }
    }
    // An attracting orbit holds its rounding, a few ulp of flights of up to 130 rad over 1 - |mu|.
    let tolerance = 1e-11;
    Ok(vec![
        Row::new(130, "(13)", "times of impact of the lock")
            .corrected("τₙ₊₁ = τ₀ + r (2π n), r ∈ N", "τₙ = τ₀ + 2π r n")
            .within(period, 4.0 * tolerance)
            .off(index.value),
        Row::new(140, "(14a)", "launch velocity of the lock")
            .agrees("ψₙ₊₁ = ψₙ = ψ = (2π r k) R/(1+R)", "the same")
            .within(velocity, tolerance),
        Row::new(141, "(14b)", "phase of the lock")
            .agrees(
                "τ₀ = A cos{π r k (1−R)/(1+R)}",
                "the same (A cos is arccos); of its two branches only 0 < τ₀ < π/2 attracts",
            )
            .within(phase, tolerance),
    ])
}

/// Trace of the tangent map of the lock, and the size of its larger multiplier.
fn multiplier(k: f64, restitution: f64, order: u32) -> Result<(f64, f64), Refusal> {
    let map = Map::build(k, restitution)?;
    let state = lock(k, restitution, order)?.state();
    let tangent = Tangent::of(&map, state, &map.impact(state));
    let [[a, b], [c, d]] = tangent.map_or([[f64::NAN; 2]; 2], |tangent| tangent.jacobian);
    Ok((a + d, Multipliers::of(a + d, a * d - b * c).modulus()))
}

/// (15) to (18): where the orbit is born and where it flips, by the multipliers of the map itself.
fn edges() -> Result<Vec<Row>, Refusal> {
    let (mut birth, mut slope, mut factor) = (Worst::default(), Worst::default(), Worst::default());
    let (mut first, mut literal, mut flip, mut between) = (
        Worst::default(),
        Worst::default(),
        Worst::default(),
        Worst::default(),
    );
    for (restitution, order, low, high) in bands()? {
        let square = restitution * restitution;
        // A saddle-node: a multiplier 1 - O(sqrt(1 - k/k1)).
        let (trace, _) = multiplier(high * (1.0 - 1e-13), restitution, order)?;
        birth.see(trace - 1.0 - square);
        // k of the multiplier -1, by one secant from the formula.
        let (trace, _) = multiplier(low, restitution, order)?;
        let (above, _) = multiplier(low * 1.000_001, restitution, order)?;
        let apart = (trace + 1.0 + square) / ((above - trace) / (low * 1e-6));
        flip.see(apart);
        if order == 1 {
            first.see(apart);
            let lossy = PI * PI * (1.0 - restitution) / (1.0 + restitution);
            let printed = lossy + 4.0 / (1.0 + square).sqrt() / (1.0 + restitution).powi(4);
            literal.see(printed - low);
        }
        let r = f64::from(order);
        let steepest = 2.0 / (PI * r) * (1.0 + square) / (1.0 - square);
        let tangent = lock(low, restitution, order)?.state().phase.tan();
        slope.see(tangent / steepest - 1.0);
        factor.see(tangent / (steepest * r) - 1.0);
        // (18): it attracts within, and does not outside.
        for part in [0.01, 0.5, 0.99] {
            let (_, size) = multiplier(low + part * (high - low), restitution, order)?;
            between.see((size - 1.0).max(0.0));
        }
        let (_, size) = multiplier(low * (1.0 - 1e-6), restitution, order)?;
        between.see((1.0 - size).max(0.0));
        let beyond = Lock::at(high * (1.0 + 1e-12), restitution, order)?;
        between.see(if beyond.is_none() { 0.0 } else { 1.0 });
    }
    Ok(vec![
        Row::new(150, "(15)", "k where the lock is born")
            .agrees(
                "k ≤ (1/(π r))(1+R)/(1−R) = k₁,ᵣ",
                "the same: there a multiplier is +1",
            )
            // The trace goes like (1+R)^2/k times the square root of 2e-13.
            .within(birth, 2e-5),
        Row::new(160, "(16)", "condition of stability")
            .corrected(
                "τ₀ ≤ A tg{(2/π)(1+R²)/(1−R²)}",
                "right for r = 1; in general 2/(π r) in place of 2/π",
            )
            .within(slope, 1e-12)
            .off(factor.value),
        Row::new(170, "(17)", "k where the lock flips, r = 1")
            .corrected(
                "k ≥ [π²((1−R)/(1+R)) + 4(1+R²)^(−1/2)/(1+R)⁴] = k₂,₁",
                "(17a) with r = 1: exponents and a bracket lost",
            )
            .within(first, 1e-12)
            .off(literal.value),
        Row::new(171, "(17a)", "k where the lock flips")
            .agrees(
                "k ≥ [π² r² ((1−R)/(1+R))² + 4(1+R²)²/(1+R)⁴]^(−1/2) = k₂,ᵣ",
                "the same: there a multiplier is −1",
            )
            .within(flip, 1e-12),
        Row::new(180, "(18)", "band of the lock")
            .agrees(
                "k₁,ᵣ ≥ k ≥ k₂,ᵣ",
                "the same, for existence and linear stability (k₂ < k < k₁ strictly); it says nothing of basins",
            )
            .within(between, 1e-12),
    ])
}

/// The worked example at R = 0.2, as printed to four digits, and what it lists.
fn examples() -> Result<Vec<Row>, Refusal> {
    let mut rows = Vec::new();
    let printed = [
        (1, 0.3928, 0.4774, "band at R = 0.2, r = 1"),
        (2, 0.2213, 0.2387, "band at R = 0.2, r = 2"),
        (3, 0.1551, 0.1591, "band at R = 0.2, r = 3"),
    ];
    for (order, low, high, subject) in printed {
        let (flip, birth) = (band::flip(0.2, order)?, band::birth(0.2, order)?);
        // Checked by the multiplier of the map at the edge, turned into k by its derivative there.
        let slope = (trace_at(flip * 1.000_001, order)? - trace_at(flip, order)?) / (flip * 1e-6);
        let residual = (trace_at(flip, order)? + 1.04) / slope;
        let off = (flip - low).abs().max((birth - high).abs());
        // A value cut or rounded to four digits is within 1e-4.
        let agrees = off < 1e-4;
        let row = Row::new(191 + order, "example", subject);
        let words = (
            format!("{low}, {high}"),
            format!("{}, {}", number(flip, 5), number(birth, 5)),
        );
        let row = if agrees {
            row.agrees(words.0, words.1)
        } else {
            row.corrected(words.0, words.1).off(off)
        };
        rows.push(row.within(Worst::of(residual.abs(), 1), 1e-9));
    }
    // k = g cos(alpha)/(b w^2): at 50 Hz and b in 1e-4 m the factor between k and cos(alpha)/b.
    let factor = 9.81 / (1e-4 * (TAU * 50.0).powi(2));
    rows.push(
        Row::new(195, "example", "what the listed numbers are")
            .corrected(
                "values of cos α / b",
                format!(
                    "values of k; cos α / b in 1e-4 m is k/{}",
                    number(factor, 5)
                ),
            )
            .within(Worst::of((factor - 0.993_96).abs(), 1), 5e-6)
            .off(1.0 / factor - 1.0),
    );
    Ok(rows)
}

fn trace_at(k: f64, order: u32) -> Result<f64, Refusal> {
    Ok(lock(k, 0.2, order)?.trace())
}

/// The claim that parts always come to rest at k > 1.
fn above_one() -> Result<Vec<Row>, Refusal> {
    let mut worst = Worst::default();
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
        worst.see(lock.distance(orbit.state()));
    }
    Ok(vec![
        Row::new(801, "claim", "parts at k > 1")
            .refuted(
                "they always come to rest",
                format!(
                    "false for R > (π−1)/(π+1) = {}: stable hopping exists above k = 1",
                    number(lowest, 5)
                ),
            )
            .within(worst, 1e-10),
    ])
}

/// (19): the cascade and its constant.
fn cascade() -> Result<Vec<Row>, Refusal> {
    // 40-digit continuation, rounded to f64.
    let references: [(f64, u32, &[f64]); 3] = [
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
    let (mut worst, mut feigenbaum) = (Worst::default(), Worst::default());
    let mut last = f64::NAN;
    for (restitution, order, flips) in references {
        let cascade = Cascade::locate(restitution, order, flips.len())?;
        for (n, flip) in flips.iter().enumerate() {
            worst.see(
                cascade
                    .flips()
                    .get(n)
                    .map_or(f64::NAN, |found| found - flip),
            );
        }
        let ratio = cascade.ratios().last().unwrap_or(f64::NAN);
        feigenbaum.see(ratio / FEIGENBAUM - 1.0);
        if (restitution, order) == (0.2, 1) {
            last = ratio;
        }
    }
    Ok(vec![
        Row::new(190, "(19)", "ratio of successive gaps")
            .corrected(
                "lim_{r→∞} (k_{r+1,r} − k_{r,r})/(k_{r+2,r} − k_{r+1,r}) = 0.46992",
                format!(
                    "lim_{{n→∞}} (k_{{n+1,r}} − k_{{n,r}})/(k_{{n+2,r}} − k_{{n+1,r}}) = 4.66920, n the doublings \
                     (last ratio at R = 0.2: {})",
                    number(last, 6)
                ),
            )
            // Ratios of the fourth gaps are within 0.5 % of the limit.
            .within(feigenbaum, 5e-3)
            .off(1.0 - 0.469_92 / FEIGENBAUM),
        Row::new(901, "finding", "k of the doublings 1→2→4→…")
            .found("followed by Newton on the tangent map, against a 40-digit continuation")
            .within(worst, 1e-12),
    ])
}
