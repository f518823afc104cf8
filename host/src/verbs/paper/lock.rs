//! Equations (12) to (25): the period-1 orbit, its band, its cascade, its conveying.

use std::f64::consts::{PI, TAU};

use kband::impact::{Contact, Kernel, Map, Orbit, Tangent, Tangential, TangentialSettings};
use kband::regime::cascade::{Cascade, FEIGENBAUM};
use kband::regime::{Lock, band};
use kband::transport::{Conveying, locked};

use super::row::{Cases, Row, Verdict, Work, Worst};
use crate::refusal::Refusal;
use crate::report::number;

pub(super) const ROWS: &[Work] = &[
    period_one, edges, examples, above_one, cascade, conveying, phase_lead,
];

/// Restitutions and orders of the cases, with both edges of the band.
fn bands() -> Result<Vec<(f64, u32, f64, f64)>, Refusal> {
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

fn lock(k: f64, restitution: f64, order: u32) -> Result<Lock, Refusal> {
    Lock::at(k, restitution, order)?.ok_or_else(|| {
        Refusal::new(
            format!("no lock of order {order} at k = {k}"),
            "report this",
        )
    })
}

/// (12) to (14): the orbit that returns to itself after r drive periods.
fn period_one() -> Result<Vec<Row>, Refusal> {
    let (mut period, mut velocity, mut phase) =
        (Worst::default(), Worst::default(), Worst::default());
    for (restitution, order, low, high) in bands()? {
        for part in [0.1, 0.5, 0.9] {
            let k = low + part * (high - low);
            let map = Map::build(k, restitution)?;
            // Found by the map alone, from a start beside the orbit.
            let state = lock(k, restitution, order)?.state();
            let start = Map::state(state.phase + 1e-6, state.velocity)?;
            let mut orbit = Orbit::new(&map, start);
            orbit.watch(20_000, &mut ());
            let state = orbit.state();
            let r = f64::from(order);
            period.see(map.impact(state).flight - TAU * r);
            velocity.see(state.velocity - TAU * r * k * restitution / (1.0 + restitution));
            let cosine = PI * r * k * (1.0 - restitution) / (1.0 + restitution);
            phase.see(state.phase - cosine.acos());
        }
    }
    // An attracting orbit holds its rounding, a few ulp of a flight of up to 32 rad over 1 - |mu|.
    let row = |place, equation, subject, printed, recomputed, verdict, worst| {
        Row::of(
            place,
            equation,
            [subject, printed, recomputed],
            verdict,
            worst,
            1e-11,
        )
    };
    let (step, missing) = (Verdict::Step, "not transcribed");
    Ok(vec![
        row(
            120,
            "(12)",
            "period 1",
            missing,
            "t' = t + 2π r, every flight alike",
            step,
            period,
        ),
        row(
            130,
            "(13)",
            "launch velocity of the lock",
            missing,
            "ψ = 2π r k R/(1+R)",
            step,
            velocity,
        ),
        row(
            140,
            "(14b)",
            "phase of the lock",
            "\"A cos\"",
            "t₀ = arccos[π r k (1−R)/(1+R)]",
            Verdict::Corrected,
            phase,
        ),
    ])
}

/// (15) to (17): where the orbit is born and where it flips, by the multipliers of the map itself.
fn edges() -> Result<Vec<Row>, Refusal> {
    let (mut birth, mut slope, mut flip, mut factor) = (
        Worst::default(),
        Worst::default(),
        Worst::default(),
        Worst::default(),
    );
    let trace = |k: f64, restitution: f64, order: u32| -> Result<f64, Refusal> {
        let map = Map::build(k, restitution)?;
        let state = lock(k, restitution, order)?.state();
        let tangent = Tangent::of(&map, state, &map.impact(state));
        let [[a, _], [_, d]] = tangent.map_or([[f64::NAN; 2]; 2], |tangent| tangent.jacobian);
        Ok(a + d)
    };
    for (restitution, order, low, high) in bands()? {
        let square = restitution * restitution;
        // A saddle-node: a multiplier 1 - O(sqrt(1 - k/k1)).
        birth.see(trace(high * (1.0 - 1e-13), restitution, order)? - 1.0 - square);
        flip.see(trace(low, restitution, order)? + 1.0 + square);
        let r = f64::from(order);
        let steepest = 2.0 / (PI * r) * (1.0 + square) / (1.0 - square);
        let tangent = lock(low, restitution, order)?.state().phase.tan();
        slope.see(tangent / steepest - 1.0);
        factor.see(tangent / (steepest * r) - 1.0);
    }
    Ok(vec![
        Row {
            place: 150,
            equation: "(15)".into(),
            subject: "k where the lock is born",
            printed: "k₁ = (1+R)/((1−R) π r)".into(),
            recomputed: "the same: there a multiplier is +1".into(),
            verdict: Verdict::Agrees,
            residual: birth.value,
            // The trace goes like (1+R)^2/k times the square root of 2e-13.
            tolerance: 2e-5,
            printed_error: None,
            cases: birth.cases,
        },
        Row {
            place: 160,
            equation: "(16)".into(),
            subject: "condition of stability",
            printed: "factor 2/π".into(),
            recomputed: "tan t₀ ≤ (2/(π r)) (1+R²)/(1−R²)".into(),
            verdict: Verdict::Corrected,
            residual: slope.value,
            tolerance: 1e-12,
            printed_error: Some(factor.value),
            cases: slope.cases,
        },
        Row {
            place: 170,
            equation: "(17)".into(),
            subject: "k where the lock flips",
            printed: "exponents lost".into(),
            recomputed: "k₂ = [π²r²((1−R)/(1+R))² + 4(1+R²)²/(1+R)⁴]^(−1/2): multiplier −1".into(),
            verdict: Verdict::Corrected,
            residual: flip.value,
            // The trace is a sum of terms of up to (1+R)^2/k2 < 100.
            tolerance: 1e-11,
            printed_error: None,
            cases: flip.cases,
        },
    ])
}

/// The worked example at R = 0.2, as printed to four digits, and what it lists.
fn examples() -> Result<Vec<Row>, Refusal> {
    let mut rows = Vec::new();
    let printed = [
        (1, 0.3928, 0.4774),
        (2, 0.2213, 0.2387),
        (3, 0.1551, 0.1591),
    ];
    for (order, low, high) in printed {
        let (flip, birth) = (band::flip(0.2, order)?, band::birth(0.2, order)?);
        // Checked by the multiplier of the map at the edge, turned into k by its derivative there.
        let slope = (trace_at(flip * 1.000_001, order)? - trace_at(flip, order)?) / (flip * 1e-6);
        let residual = (trace_at(flip, order)? + 1.04) / slope;
        let off = (flip - low).abs().max((birth - high).abs());
        // A value cut or rounded to four digits is within 1e-4.
        let agrees = off < 1e-4;
        rows.push(Row {
            place: 171 + order,
            equation: format!("example r={order}"),
            subject: "band at R = 0.2",
            printed: format!("{low}, {high}"),
            recomputed: format!("{}, {}", number(flip, 5), number(birth, 5)),
            verdict: if agrees {
                Verdict::Agrees
            } else {
                Verdict::Corrected
            },
            residual: residual.abs(),
            tolerance: 1e-9,
            printed_error: (!agrees).then_some(off),
            cases: 1,
        });
    }
    // k = g cos(alpha)/(b w^2): at 50 Hz and b in 1e-4 m the factor between k and cos(alpha)/b.
    let factor = 9.81 / (1e-4 * (TAU * 50.0).powi(2));
    rows.push(Row {
        place: 175,
        equation: "example".into(),
        subject: "what the listed numbers are",
        printed: "values of cos α / b".into(),
        recomputed: format!(
            "values of k; cos α / b in 1e-4 m is k/{}",
            number(factor, 5)
        ),
        verdict: Verdict::Corrected,
        residual: (factor - 0.993_96).abs(),
        tolerance: 5e-6,
        printed_error: Some(1.0 / factor - 1.0),
        cases: 1,
    });
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
    Ok(vec![Row {
        place: 176,
        equation: "claim, k > 1".into(),
        subject: "parts at k > 1",
        printed: "they always come to rest".into(),
        recomputed: format!(
            "false for R > (π−1)/(π+1) = {}: stable hopping exists above k = 1",
            number(lowest, 5)
        ),
        verdict: Verdict::Refuted,
        residual: worst.value,
        tolerance: 1e-10,
        printed_error: None,
        cases: worst.cases,
    }])
}

/// (18), (19): the cascade and its constant.
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
        Row {
            place: 180,
            equation: "(18)".into(),
            subject: "period doublings",
            printed: "not transcribed".into(),
            recomputed: "the flips 1→2→4→…, against a 40-digit continuation".into(),
            verdict: Verdict::Step,
            residual: worst.value,
            tolerance: 1e-12,
            printed_error: None,
            cases: worst.cases,
        },
        Row {
            place: 190,
            equation: "(19)".into(),
            subject: "ratio of successive gaps",
            printed: "0.46992".into(),
            recomputed: format!("4.66920 (last ratio at R = 0.2: {})", number(last, 6)),
            verdict: Verdict::Corrected,
            residual: feigenbaum.value,
            // Ratios of the fourth gaps are within 0.5 % of the limit.
            tolerance: 5e-3,
            printed_error: Some(1.0 - 0.469_92 / FEIGENBAUM),
            cases: feigenbaum.cases,
        },
    ])
}

/// Time mean of a locked part, measured on the map after it has settled.
fn measured(
    k: f64,
    lock: &Lock,
    restitution: f64,
    settings: TangentialSettings,
) -> Result<f64, Refusal> {
    let map = Map::build(k, restitution)?;
    let tangential = Tangential::build(k, settings)?;
    let mut conveying = Conveying::new(tangential, Contact::new(&map));
    let mut orbit = Orbit::new(&map, lock.state());
    orbit.watch(300, &mut conveying);
    conveying.restart();
    orbit.watch(20, &mut conveying);
    Ok(conveying.conveyed().time_mean().unwrap_or(f64::NAN))
}

/// (20) to (22): locked conveying in phase.
fn conveying() -> Result<Vec<Row>, Refusal> {
    let mut cases = Cases::new(8);
    let (mut general, mut in_phase, mut critical) =
        (Worst::default(), Worst::default(), Worst::default());
    for (restitution, order, low, high) in bands()? {
        let k = low + cases.within(0.05, 0.95) * (high - low);
        let lock = lock(k, restitution, order)?;
        let mut settings = TangentialSettings {
            restitution: cases.within(0.0, 0.9),
            amplitude_ratio: cases.within(0.2, 3.0),
            phase_lead: cases.within(-3.0, 3.0),
            incline_tangent: cases.within(-0.3, 0.3),
        };
        general.see(
            measured(k, &lock, restitution, settings)? - locked::velocity(&lock, k, &settings),
        );
        settings.phase_lead = 0.0;
        let closed = locked::velocity_in_phase(order, k, restitution, &settings);
        in_phase.see(measured(k, &lock, restitution, settings)? - closed);
        settings.incline_tangent = locked::critical_slope_in_phase(restitution, &settings);
        critical.see(measured(k, &lock, restitution, settings)?);
    }
    // Velocities of up to 30 on orbits known to 1e-12.
    let row = |place, equation, subject, printed, recomputed, verdict, worst| {
        Row::of(
            place,
            equation,
            [subject, printed, recomputed],
            verdict,
            worst,
            1e-10,
        )
    };
    Ok(vec![
        row(
            200,
            "(20)",
            "velocity of locked parts",
            "W = η cos(t₀+γ) − π r k tan α (1+Rt)/(1−Rt)",
            "the same",
            Verdict::Agrees,
            general,
        ),
        row(
            210,
            "(21)",
            "in phase, γ = 0",
            "W = π r k {η (1−R)/(1+R) − tan α (1+Rt)/(1−Rt)}",
            "the same; W b ω does not depend on the amplitude",
            Verdict::Agrees,
            in_phase,
        ),
        row(
            220,
            "(22)",
            "critical slope, γ = 0",
            "\"A tg\"",
            "α_c = arctan[η (1−R)(1−Rt)/((1+R)(1+Rt))]: there W = 0",
            Verdict::Corrected,
            critical,
        ),
    ])
}

/// (23) to (25): locked conveying with a phase lead.
fn phase_lead() -> Result<Vec<Row>, Refusal> {
    let mut cases = Cases::new(9);
    let (mut critical, mut lead, mut best) = (Worst::default(), Worst::default(), Worst::default());
    for (restitution, order, low, high) in bands()? {
        let k = low + cases.within(0.05, 0.95) * (high - low);
        let lock = lock(k, restitution, order)?;
        let mut settings = TangentialSettings {
            restitution: cases.within(0.0, 0.9),
            amplitude_ratio: cases.within(0.2, 3.0),
            phase_lead: cases.within(-1.5, 1.5),
            incline_tangent: cases.within(0.0, 0.2),
        };
        // The gamma part alone: what a lead adds to the velocity in phase, from equation (11).
        let gamma = settings.phase_lead;
        let with = measured(k, &lock, restitution, settings)?;
        let without = measured(
            k,
            &lock,
            restitution,
            TangentialSettings {
                phase_lead: 0.0,
                ..settings
            },
        )?;
        let t0 = lock.state().phase;
        let eta = settings.amplitude_ratio;
        lead.see(with - without - eta * ((gamma.cos() - 1.0) * t0.cos() - gamma.sin() * t0.sin()));
        let at = |phase_lead: f64| {
            measured(
                k,
                &lock,
                restitution,
                TangentialSettings {
                    phase_lead,
                    ..settings
                },
            )
        };
        // No lead beside -t0 conveys more.
        let top = at(-t0)?;
        best.see((at(-t0 + 0.01)?.max(at(-t0 - 0.01)?) - top).max(0.0));
        settings.incline_tangent = locked::critical_slope(&lock, k, &settings);
        if settings.incline_tangent.abs() <= 2.0 {
            critical.see(measured(k, &lock, restitution, settings)?);
        }
    }
    let row = |place, equation, subject, printed, recomputed, verdict, worst| {
        Row::of(
            place,
            equation,
            [subject, printed, recomputed],
            verdict,
            worst,
            1e-10,
        )
    };
    Ok(vec![
        row(
            230,
            "(23)",
            "critical slope, any γ",
            "tan α_c = η cos(t₀+γ)(1−Rt)/(π r k (1+Rt))",
            "the same: there W = 0",
            Verdict::Agrees,
            critical,
        ),
        row(
            240,
            "(24)",
            "the γ part",
            "signs and terms misprinted",
            "W(γ) − W(0) = η [(cos γ − 1) cos t₀ − sin γ sin t₀], from (11)",
            Verdict::Corrected,
            lead,
        ),
        row(
            250,
            "(25)",
            "the best γ",
            "signs and terms misprinted",
            "γ = −t₀ conveys most, from (11)",
            Verdict::Corrected,
            best,
        ),
    ])
}
