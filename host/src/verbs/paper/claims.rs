//! Claims of the text: what chaos does, where it is, and what stands beside it.

use std::f64::consts::TAU;

use kband::impact::{
    Contact, Ended, Friction, FrictionSettings, Kernel, Map, Orbit, PartState, Scatter, Tangential,
    Tone, Wave,
};
use kband::regime::cascade::{Cascade, FEIGENBAUM};
use kband::regime::classify::Regime;
use kband::regime::exponent::{self, Dynamics, ExponentSettings};
use kband::regime::{Lock, band};
use kband::transport::{Conveyed, Conveying, Sensitivity, Spread, locked};

use super::chaos::{CHAOS, wide_chaos};
use super::lock::lock;
use super::row::{Cases, Row, Work, Worst};
use crate::ending::Endings;
use crate::refusal::Refusal;
use crate::report::number;

pub(super) const ROWS: &[Work] = &[
    lyapunov,
    || strips(0.1),
    || strips(0.2),
    || strips(0.3),
    || strips(0.5),
    || strips(0.7),
    || strips(0.9),
    between,
    dead_cascade,
    robust,
    dispersion,
    noise,
    two_tones,
    track,
    sliding,
];

/// Chaos below the accumulation point is real.
fn lyapunov() -> Result<Vec<Row>, Refusal> {
    // docs/theory-reference.md#t11.3: known to 0.003.
    let references = [
        (0.43, 0.2, -1.3307),
        (0.358, 0.2, 0.0778),
        (0.355, 0.2, 0.0522),
        (0.35, 0.2, 0.3622),
        (0.34, 0.2, 0.5020),
        (0.586, 0.5, 0.0860),
    ];
    let mut worst = Worst::default();
    let impacts = 40_000;
    for (k, restitution, reference) in references {
        let map = Map::build(k, restitution)?;
        let settings = ExponentSettings {
            settle: 3000,
            impacts,
        };
        let found = exponent::measure(&map, exponent::start(&map, 1), settings)?.per_impact;
        worst.see((found.value - reference) / (0.003 + 6.0 * found.error));
    }
    Ok(vec![
        Row::new(800, "claim", "chaos beyond the doublings")
            .agrees(
                "chaotic below the cascade",
                "Lyapunov exponents positive there: 0.08 to 0.50 at R = 0.2, in a narrow band of k",
            )
            .within(
                Worst::of(worst.value, worst.cases * u64::from(impacts)),
                1.0,
            ),
    ])
}

/// Starts beside the period-1 orbits of orders 1 to 3, and so many spread over phase and velocity.
fn starts(k: f64, restitution: f64, spread: u32) -> Result<Vec<PartState>, Refusal> {
    let mut starts = Vec::new();
    for order in 1..=3 {
        if let Some(lock) = Lock::at(k, restitution, order)? {
            let PartState { phase, velocity } = lock.state();
            starts.push(Map::state(phase + 1e-3, velocity)?);
        }
    }
    let mut cases = Cases::new(16);
    let highest = 1.0 + 2.5 * restitution / (1.0 - restitution);
    for _ in 0..spread {
        starts.push(Map::state(
            cases.within(0.0, TAU),
            cases.within(0.0, highest),
        )?);
    }
    Ok(starts)
}

/// The claim that chaos has wide ranges of k between narrow strips of locks. Chaos is a positive exponent without a rest
/// in 3000 impacts: a part in wide chaos rests now and then, once in some 40 000.
fn strips(restitution: f64) -> Result<Vec<Row>, Refusal> {
    const COLUMNS: u32 = 96;
    let settings = ExponentSettings {
        settle: 2000,
        impacts: 960,
    };
    let (mut chaos, mut lock, mut rest) = (0_u32, 0_u32, 0_u32);
    for n in 0..COLUMNS {
        let k = 0.05 + 0.01 * f64::from(n);
        let map = Map::build(k, restitution)?;
        let (mut chaotic, mut resting) = (false, false);
        for start in starts(k, restitution, 2)? {
            match exponent::measure(&map, start, settings)?.dynamics {
                Dynamics::Chaotic => chaotic = true,
                Dynamics::Rest { .. } => resting = true,
                Dynamics::Regular | Dynamics::Undecided => {}
            }
        }
        let mut locked = false;
        for order in 1..=8 {
            let found = Lock::at(k, restitution, order)?;
            locked |= found.is_some_and(|lock| lock.attracts() && lock.is_first_return());
        }
        chaos += u32::from(chaotic);
        lock += u32::from(locked);
        rest += u32::from(resting);
    }
    let share = |count: u32| number(100.0 * f64::from(count) / f64::from(COLUMNS), 3);
    let found = format!(
        "of the k in 0.05 to 1: chaos at {} %, locks at {} %, hop and rest at {} %",
        share(chaos),
        share(lock),
        share(rest)
    );
    let (place, subject) = match (10.0 * restitution).round() as u32 {
        1 => (810, "chaotic ranges, R = 0.1"),
        2 => (811, "chaotic ranges, R = 0.2"),
        3 => (812, "chaotic ranges, R = 0.3"),
        5 => (813, "chaotic ranges, R = 0.5"),
        7 => (814, "chaotic ranges, R = 0.7"),
        _ => (815, "chaotic ranges, R = 0.9"),
    };
    let printed = "the chaotic ranges are much wider than the strips of locks";
    let row = Row::new(place, "claim", subject);
    // Wider or narrower beyond doubt: by half.
    let (row, wider, narrower) = if restitution > 0.8 {
        (row.agrees(printed, found), chaos, lock)
    } else {
        (row.refuted(printed, found), lock, chaos)
    };
    let ratio = f64::from(narrower) / f64::from(wider);
    Ok(vec![
        row.within(Worst::of(1.5 * ratio, COLUMNS.into()), 1.0),
    ])
}

/// The claim that between k1 and 1 parts hop and slide, which without friction is hop and rest.
fn between() -> Result<Vec<Row>, Refusal> {
    let mut other = Worst::default();
    for restitution in [0.2, 0.3, 0.5] {
        let birth = band::birth(restitution, 1)?;
        for n in 0..30 {
            let k = birth + (1.0 - birth) * (f64::from(n) + 0.5) / 30.0;
            let endings = Endings::new(k, restitution, 4000)?;
            let mut found = endings.of_all(starts(k, restitution, 6)?.into_iter());
            found.push(endings.from_rest());
            for regime in found {
                other.see(match regime {
                    Regime::HopAndRest { .. } => 0.0,
                    _ => 1.0,
                });
            }
        }
    }
    Ok(vec![
        Row::new(802, "claim", "parts at k₁ < k < 1")
            .agrees(
                "a mixture of hopping (H) and contact (S)",
                "every start hops and rests, at R = 0.2, 0.3 and 0.5",
            )
            .within(other, 0.0),
    ])
}

/// The claim that dead parts show the cascade of a quadratic map.
fn dead_cascade() -> Result<Vec<Row>, Refusal> {
    let (mut rests, count) = (0_u32, 600);
    for n in 0..count {
        let k = 0.05 + 0.949 * (f64::from(n) + 0.5) / f64::from(count);
        let map = Map::build(k, 0.0)?;
        rests += u32::from(Orbit::from_rest(&map).watch(2000, &mut ()) == Ended::Repeats);
    }
    let share = f64::from(rests) / f64::from(count);
    let flips = Cascade::locate(0.0, 1, 3)?.flips().to_vec();
    let first = flips.first().copied().unwrap_or(f64::NAN);
    // One flip, at (pi^2 + 4)^(-1/2), and 94.1 % of 1200 k elsewhere.
    let off = ((share - 0.941).abs() / 0.01)
        .max((first - (0.25 * TAU * TAU + 4.0).sqrt().recip()).abs() / 1e-12)
        .max(if flips.len() == 1 { 0.0 } else { 2.0 });
    Ok(vec![
        Row::new(820, "claim", "R and Rt → 0")
            .refuted(
                "the Feigenbaum cascade of a quadratic map",
                format!(
                    "one flip, at k = {}; {} % of the k in 0.05 to 1 end in a superstable cycle through rest",
                    number(first, 6),
                    number(100.0 * share, 3)
                ),
            )
            .within(Worst::of(off, u64::from(count as u32)), 1.0),
    ])
}

/// A part in the chaos of the cascade, from beside the lock, and what it conveyed in so many impacts.
fn narrow_chaos(k: f64, impacts: u64) -> Result<Conveyed, Refusal> {
    let map = Map::build(k, 0.2)?;
    let mut conveying = Conveying::new(Tangential::build(k, CHAOS)?, Contact::new(&map));
    let mut orbit = Orbit::new(&map, exponent::start(&map, 1));
    orbit.watch(2000, &mut conveying);
    conveying.restart();
    orbit.watch(impacts, &mut conveying);
    Ok(conveying.conveyed())
}

/// The claim that chaos makes the feed rate insensitive, and why it does in gear.
fn robust() -> Result<Vec<Row>, Refusal> {
    let at = |k: f64| -> Result<(f64, f64, f64), Refusal> {
        let spread = Spread::of(
            wide_chaos(k, 20, 6000)?
                .iter()
                .filter_map(Conveyed::time_mean),
        );
        Ok((
            k,
            spread.mean().unwrap_or(f64::NAN),
            spread.error().unwrap_or(f64::NAN),
        ))
    };
    let wide = Sensitivity::between(at(0.03)?, at(0.09)?);
    let (value, error) = wide.map_or((f64::NAN, f64::NAN), |found| (found.value, found.error));
    let impacts = 20_000;
    let (mut in_gear, mut time, mut rates) = (Worst::default(), Worst::default(), Vec::new());
    for k in [0.342, 0.346, 0.35, 0.354, 0.358] {
        let conveyed = narrow_chaos(k, impacts)?;
        let lock = locked::velocity_in_phase(1, k, 0.2, &CHAOS);
        // (34) with D = 2 pi: what is left are the ends of the run, one flight's W of at most 6.
        let mean = conveyed.impact_mean().unwrap_or(f64::NAN);
        in_gear.see((mean - lock) / (2.0 * 6.0 / impacts as f64));
        let speed = conveyed.time_mean().unwrap_or(f64::NAN);
        time.see((speed / lock - 1.0) / 4e-3);
        rates.push((k, speed));
    }
    let steepest = rates
        .windows(2)
        .filter_map(|pair| {
            let [(k, v), (k2, v2)] = [pair[0], pair[1]];
            Sensitivity::between((k, v, 0.0), (k2, v2, 0.0))
        })
        .map(|found| found.value.abs())
        .fold(0.0, f64::max);
    // A long run in wide chaos found 1.000 +- 0.002; runs at 17 k of the cascade at most 0.065.
    let off = ((value - 1.0).abs() / (0.005 + 6.0 * error)).max(steepest / 0.1);
    Ok(vec![
        Row::new(803, "claim", "robustness: chaos makes the rate insensitive")
            .corrected(
                "(dV/V)/(db/b) is small in chaos",
                format!(
                    "true in gear, in the chaos of the cascade: at most {}; false in wide chaos: {} ± {}",
                    number(steepest, 2),
                    number(value, 3),
                    number(error, 1)
                ),
            )
            .within(
                Worst::of(off, 2 * 20 * 6000 + rates.len() as u64 * impacts),
                1.0,
            ),
        Row::new(915, "finding", "chaos in gear has the lock's speed")
            .found(format!(
                "its mean flight is 2π r, so (34) gives the lock's impact mean; the time mean is within {} % of it",
                number(0.4 * time.value, 2)
            ))
            .within(
                Worst::of(in_gear.value.max(time.value), in_gear.cases * impacts),
                1.0,
            ),
    ])
}

/// `Var(x - V t)/(2 t)` over blocks of so many flights, in `b^2 w`.
fn spreading(
    k: f64,
    restitution: f64,
    start: PartState,
    lengths: [u64; 2],
) -> Result<[f64; 2], Refusal> {
    const FLIGHTS: u64 = 60_000;
    let map = Map::build(k, restitution)?;
    let mut conveying = Conveying::new(Tangential::build(k, CHAOS)?, Contact::new(&map));
    let mut orbit = Orbit::new(&map, start);
    orbit.watch(1000, &mut conveying);
    let mut blocks = Vec::new();
    // Blocks of one flight, from which all longer ones are made.
    for _ in 0..FLIGHTS {
        conveying.restart();
        orbit.watch(1, &mut conveying);
        let conveyed = conveying.conveyed();
        blocks.push((conveyed.distance, conveyed.flying + conveyed.resting));
    }
    let sum = |blocks: &[(f64, f64)]| {
        blocks
            .iter()
            .fold((0.0, 0.0), |sum, block| (sum.0 + block.0, sum.1 + block.1))
    };
    let (way, time) = sum(&blocks);
    let velocity = way / time;
    Ok(lengths.map(|length| {
        let apart = blocks.chunks_exact(length as usize).map(|chunk| {
            let (way, time) = sum(chunk);
            (way - velocity * time).powi(2)
        });
        apart.sum::<f64>() / (2.0 * time)
    }))
}

/// The paper's last paragraph: whether chaos spreads parts out as chance does.
fn dispersion() -> Result<Vec<Row>, Refusal> {
    let [one, many] = spreading(0.35, 0.2, Map::state(0.8, 0.36)?, [1, 300])?;
    let [wide_one, wide_many] = spreading(0.05, 0.9, Map::state(0.5, 4.0)?, [1, 300])?;
    // Where nothing diffuses the block's ends are all that is left: 1/300 of what one flight spreads.
    let off = (many / one / 0.02).max(0.1 / (wide_many / wide_one));
    let flights = 2 * 60_000;
    Ok(vec![
        Row::new(
            804,
            "claim",
            "chaos bridges deterministic and stochastic transport",
        )
        .corrected(
            "chaotic conveying spreads parts out as diffusion does",
            "true in wide chaos; the chaos of the cascade does not diffuse",
        )
        .within(Worst::of(off, flights), 1.0),
        Row::new(
            916,
            "finding",
            "dispersion Var(x − V t)/(2t) in b² ω, over 1 and 300 flights",
        )
        .found(format!(
            "cascade (k = 0.35, R = 0.2): {}, {}; wide chaos (k = 0.05, R = 0.9): {}, {}",
            number(one, 2),
            number(many, 2),
            number(wide_one, 2),
            number(wide_many, 2)
        ))
        .within(Worst::of(off, flights), 1.0),
    ])
}

/// Noise truncates the cascade.
fn noise() -> Result<Vec<Row>, Refusal> {
    // Between the third flip and the fourth, eight impacts repeat; with noise they do not.
    let (k, restitution) = (0.3595, 0.2);
    let map = Map::build(k, restitution)?;
    let settings = ExponentSettings {
        settle: 3000,
        impacts: 60_000,
    };
    let start = exponent::start(&map, 1);
    let still = exponent::measure(&map, start, settings)?.per_impact;
    let scatter = Scatter::build(restitution, 0.05 * restitution, 14)?;
    let noisy = exponent::measure_scattered(&map, start, settings, scatter)?.per_impact;
    let cascade = Cascade::locate(restitution, 1, 6)?;
    let visible: Vec<f64> = cascade.visible_below().flatten().collect();
    let ratio = visible
        .windows(2)
        .last()
        .map_or(f64::NAN, |pair| pair[0] / pair[1]);
    let off = (3.0 * still.error / -still.value)
        .max(3.0 * noisy.error / noisy.value)
        // The last of six doublings is that near to the limit.
        .max((ratio / 6.62 - 1.0).abs() / 0.15);
    let off = if still.value < 0.0 && noisy.value > 0.0 {
        off
    } else {
        f64::INFINITY
    };
    Ok(vec![
        Row::new(805, "claim", "noise")
            .agrees(
                "noise truncates the cascade and narrows its periodic ranges",
                format!(
                    "true: at k = 0.3595 eight impacts repeat (exponent {}), with 5 % scatter of R they do not ({}); \
                     each doubling bears {} times less (6.62 in the limit)",
                    number(still.value, 2),
                    number(noisy.value, 2),
                    number(ratio, 3)
                ),
            )
            .within(Worst::of(off, 120_000), 1.0),
    ])
}

/// Two tones shift the cascade and keep it.
fn two_tones() -> Result<Vec<Row>, Refusal> {
    let mut off = Worst::default();
    let mut flips = Vec::new();
    let single = band::flip(0.2, 1)?;
    for amplitude in [0.05, 0.1] {
        let second = Tone {
            amplitude,
            angle: 2.487,
        };
        let wave = Wave::build(second, Tone::default())?;
        let cascade = Cascade::on_tones(&wave, 0.2, 1, 6)?;
        let last = cascade.as_ref().and_then(|found| found.ratios().last());
        off.see((last.unwrap_or(f64::NAN) / FEIGENBAUM - 1.0) / 5e-3);
        let first = cascade.map_or(f64::NAN, |found| found.flips()[0]);
        // Shifted beyond doubt: by 1 % of k.
        off.see(0.01 * single / (first - single));
        flips.push(number(first, 4));
    }
    Ok(vec![
        Row::new(806, "claim", "two sines (reference 19)")
            .agrees(
                "a second tone shifts the bifurcations, chaos stays",
                format!(
                    "true: the first flip at R = 0.2 goes from {} to {} (e = 0.05) and {} (e = 0.10), and the gaps keep \
                     Feigenbaum's ratio",
                    number(single, 4),
                    flips[0],
                    flips[1]
                ),
            )
            .within(off, 1.0),
    ])
}

/// The claim that impacts do not alter the motion of the track.
fn track() -> Result<Vec<Row>, Refusal> {
    let mut worst = Worst::default();
    for (k, restitution) in [(0.43, 0.2), (0.55, 0.3), (0.75, 0.5)] {
        let lock = lock(k, restitution, 1)?;
        let map = Map::build(k, restitution)?;
        let launch = lock.state();
        let impact = map.impact(launch);
        // The impulse on the track, (1 + R) s, in m b w, and its first harmonic over one period.
        let impulse = (1.0 + restitution) / restitution * impact.next.velocity;
        let (sine, cosine) = impact.next.phase.sin_cos();
        let (in_phase, in_quadrature) = (2.0 * impulse / TAU * sine, 2.0 * impulse / TAU * cosine);
        // Force over M b w^2 in units of m/M: -2 k cos(tau - t0).
        let (t_sine, t_cosine) = launch.phase.sin_cos();
        worst.see(in_phase - 2.0 * k * t_sine);
        worst.see(in_quadrature - 2.0 * k * t_cosine);
    }
    let lost = 2.0 * 0.43 * lock(0.43, 0.2, 1)?.state().phase.cos();
    Ok(vec![
        Row::new(807, "claim", "impacts and the track")
            .corrected(
                "impacts do not alter the motion of the track",
                format!(
                    "true of light parts: a locked part of mass m pushes with 2 m g cos α, which adds 2(m/M) k cos τ₀ to 1/Q \
                     ({} m/M at R = 0.2, k = 0.43)",
                    number(lost, 3)
                ),
            )
            .within(worst, 1e-10)
            .off(lost),
    ])
}

/// The claim that parts are conveyed in contact too, by inertia, where the track's push is not symmetric.
fn sliding() -> Result<Vec<Row>, Refusal> {
    let mut worst = Worst::default();
    // docs/theory-real-parts.md#t10.4, from stepwise integrations.
    for (throw, mu, incline, reference) in [
        (0.6, 0.8, 3.0_f64, 0.386_499),
        (0.9, 0.8, 3.0, 0.822_437),
        (1.0, 0.3, 0.0, 0.636_358),
    ] {
        let settings = FrictionSettings {
            sticking: mu,
            sliding: mu,
            amplitude_ratio: 3.0_f64.sqrt(),
            phase_lead: 0.0,
            incline_tangent: incline.to_radians().tan(),
        };
        let cycle = Friction::build(1.0 / throw, settings)?.lying_for_ever();
        worst.see(cycle.map_or(f64::NAN, |cycle| cycle.distance / TAU - reference));
        // Level, in phase and without a normal motion, pushes cancel: nothing is conveyed.
        let still = FrictionSettings {
            incline_tangent: 0.0,
            ..settings
        };
        let even = Friction::build(1000.0, still)?.lying_for_ever();
        worst.see(even.map_or(f64::NAN, |cycle| cycle.distance));
    }
    Ok(vec![
        Row::new(808, "claim", "conveying in contact (S), and mixtures (H-S)")
            .agrees(
                "in S parts are conveyed by inertia where the excitation is asymmetric",
                "true: the normal motion makes friction uneven; W = 0.386 at throw number 0.6 (μ = 0.8, 3°, η = cot 30°)",
            )
            .within(worst, 2e-6),
    ])
}
