//! Bands, doublings, gear, basins, diagrams, capture, exponents and conveying speed.

use std::f64::consts::TAU;
use std::num::NonZero;
use std::task::Poll;

use kband::feeder::{Restitution, STANDARD_GRAVITY, Track, TrackSettings};
use kband::impact::{
    ContactTime, Friction, FrictionSettings, Kernel, Map, Orbit, OrbitEvent, PartState, Scatter,
    Tangential, TangentialSettings, WaveMap,
};
use kband::regime::band::{Band, BandError};
use kband::regime::capture::{DriveLag, DriveLagSettings, Lot, PlanSettings, Planner};
use kband::regime::cascade::{Cascade, CascadeEnd};
use kband::regime::exponent::{self, Dynamics, ExponentSettings, start_near_lock};
use kband::regime::gear::{GearLimits, GearPlanSettings, GearPlanner, Share, shares_from_rest};
use kband::regime::wave_band::WaveBands;
use kband::transport::{Effort, Motion, Origin, measure, measure_on_tones};
use kband_scene::ending::{Endings, describe_regime};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::map::{Tones, stream, wave};
use crate::refused::Refused;
use crate::work::{self, InterruptPoll};

fn lot([low, high]: [f64; 2]) -> Result<Restitution, Refused> {
    Ok(Restitution::interval(low, high)?)
}

/// Common band of k of a lot: lowest k, highest k, and the k with the largest margin.
#[pyfunction]
pub fn band(
    restitution: [f64; 2],
    order: u32,
    tones: Option<Tones>,
) -> Result<Option<(f64, f64, f64)>, Refused> {
    let (lot, wave) = (lot(restitution)?, wave(tones)?);
    if !wave.is_sine() {
        let widest = WaveBands::common(&wave, lot, order)?.widest();
        return Ok(widest.map(|band| (band.low.k, band.high.k, band.setpoint())));
    }
    match Band::common(lot, order) {
        Ok(band) => Ok(Some((band.low(), band.high(), band.setpoint()))),
        Err(BandError::Empty(_)) => Ok(None),
        Err(BandError::OutOfRange(refused)) => Err(refused.into()),
    }
}

/// Birth of a lock, its flips, the ratios of their gaps, and the onset of chaos with its error. The
/// last field: whether all requested flips were found.
type Doublings = (f64, Vec<f64>, Vec<f64>, Option<(f64, f64)>, bool);

/// The period doublings of a lock; `None` if no band ends in a flip.
#[pyfunction]
pub fn doublings(
    py: Python<'_>,
    restitution: f64,
    order: u32,
    count: usize,
    tones: Option<Tones>,
) -> Result<Option<Doublings>, Refused> {
    let wave = wave(tones)?;
    let result = py.detach(|| {
        if wave.is_sine() {
            Cascade::locate(restitution, order, count).map(Some)
        } else {
            Cascade::on_tones(&wave, restitution, order, count)
        }
    })?;
    Ok(result.map(|cascade| {
        let limit = cascade.k_infinity().map(|limit| (limit.value, limit.error));
        let (flips, ratios) = (cascade.flips().to_vec(), cascade.ratios().collect());
        let complete = cascade.end() == CascadeEnd::Complete;
        (cascade.birth(), flips, ratios, limit, complete)
    }))
}

/// Largest number of drive periods of the gear runs between two checks for Ctrl-C.
const TASK_PERIODS: f64 = 1e5;

/// Share of time in gear of each part at each k. Then the mean time to a loss over all parts, in
/// drive periods; infinite without a loss.
#[pyfunction]
pub fn gear_shares(
    py: Python<'_>,
    restitutions: Vec<f64>,
    scatter: f64,
    k: Vec<f64>,
    order: u32,
    tones: Option<Tones>,
    runs: usize,
    periods: f64,
    seed: u64,
    threads: Option<NonZero<usize>>,
) -> PyResult<Vec<(Vec<f64>, f64)>> {
    let wave = wave(tones)?;
    let shape = [k.len()];
    let batch_size = (TASK_PERIODS / periods).max(1.0) as usize;
    work::map(py, &shape, k.len(), threads, |n, stop| {
        let map = WaveMap::on(wave, k[n], 0.5).map_err(Refused::element(n))?;
        let mut shares = vec![Share::default(); restitutions.len()];
        for (part, restitution) in restitutions.iter().enumerate() {
            let draws = |run: usize| {
                let number = (part as u64) << 32 | run as u64;
                Scatter::build(*restitution, scatter, stream(seed, number))
            };
            let scatters = (0..runs).map(draws).collect::<Result<Vec<_>, _>>()?;
            for scatters in scatters.chunks(batch_size) {
                if stop.is_requested() {
                    break;
                }
                let add = |_: usize, share: Share| shares[part] = shares[part].plus(&share);
                shares_from_rest(&map, ContactTime::INSTANT, scatters, order, periods, add)?;
            }
        }
        let add = |sum: Share, share: &Share| sum.plus(share);
        let all = shares.iter().fold(Share::default(), add);
        let to_loss = all.time_to_loss().unwrap_or(f64::INFINITY);
        Ok((shares.iter().map(Share::share).collect(), to_loss))
    })
}

/// k, amplitudes and angles of the tones, gear band and predicted share.
type GearPlanned = (f32, [[f32; 2]; 2], [f32; 2], f32);

/// Plans gear for a lot; `None` if no k throws the parts far enough.
#[pyfunction]
pub fn gear_plan(
    py: Python<'_>,
    restitution: [f64; 2],
    scatter: f32,
    order: u32,
    k: [f32; 2],
    max_tones: [f32; 2],
    amplitude_error: f32,
) -> PyResult<Option<GearPlanned>> {
    let mut planner = GearPlanner::new(GearPlanSettings {
        restitution: lot(restitution)?,
        scatter,
        amplitude_error,
        order,
        k,
        max_tones,
        limits: GearLimits::NONE,
        contact: ContactTime::INSTANT,
    })
    .map_err(Refused::from)?;
    py.detach(|| {
        let mut poll = InterruptPoll::new();
        while planner.advance(10_000) {
            poll.poll()?;
        }
        let plan = planner.plan().filter(|plan| plan.settled);
        Ok(plan.map(|plan| (plan.k, plan.tones, plan.band, plan.share)))
    })
}

/// Largest number of impacts of one task of a basin: a tenth of a second.
const TASK_IMPACTS: usize = 5_000_000;

/// Names of the regimes, index of the final regime of each start, and regime of a part from rest.
type Basins = (Vec<String>, Vec<u16>, String);

/// Final regimes of parts that start at the centres of `side * side` cells of phase 0..2 pi and
/// speed 0..`top`, row by row.
#[pyfunction]
pub fn basins(
    py: Python<'_>,
    k: f64,
    restitution: f64,
    side: usize,
    top: f64,
    impacts: usize,
    threads: Option<NonZero<usize>>,
) -> PyResult<Basins> {
    Map::state(0.0, top).map_err(Refused::from)?;
    let endings = py.detach(|| Endings::new(k, restitution, impacts));
    let endings = endings.map_err(Refused::from)?;
    let count = side * side;
    let batch_size = (TASK_IMPACTS / impacts.max(1)).clamp(8, 4096);
    let middle = |n: usize| (n as f64 + 0.5) / side as f64;
    let start = |n: usize| PartState::new(TAU * middle(n % side), top * middle(n / side));
    let ends = work::map(py, &[], count.div_ceil(batch_size), threads, |task, _| {
        let range = task * batch_size..count.min((task + 1) * batch_size);
        Ok(endings.classify_all(range.map(start)))
    })?;
    let mut distinct = Vec::new();
    let numbers = ends.into_iter().flatten().map(|regime| {
        let number = distinct.iter().position(|other| *other == regime);
        number.unwrap_or_else(|| {
            distinct.push(regime);
            distinct.len() - 1
        }) as u16
    });
    let numbers = numbers.collect();
    let name = |regime| describe_regime(regime, impacts);
    let names = distinct.into_iter().map(name).collect();
    Ok((names, numbers, name(endings.from_rest())))
}

/// Phase and speed of settled impacts of a part from rest at each k; NaN once it rests for ever.
#[pyfunction]
pub fn diagram(
    py: Python<'_>,
    k: Vec<f64>,
    restitution: f64,
    settle: usize,
    impacts: usize,
    threads: Option<NonZero<usize>>,
) -> PyResult<Vec<(Vec<f64>, Vec<f64>)>> {
    let shape = [k.len()];
    work::map(py, &shape, k.len(), threads, |n, stop| {
        let map = Map::build(k[n], restitution).map_err(Refused::element(n))?;
        let states = Orbit::from_rest(&map).filter_map(|event| match event {
            OrbitEvent::Impact(impact) => Some(impact.next),
            _ => None,
        });
        let (mut phase, mut speed): (Vec<f64>, Vec<f64>) = states
            .take(settle + impacts)
            .take_while(|_| !stop.is_requested())
            .skip(settle)
            .map(|state| (state.phase, state.velocity))
            .unzip();
        phase.resize(impacts, f64::NAN);
        speed.resize(impacts, f64::NAN);
        Ok((phase, speed))
    })
}

/// k, and of each kick in the order of its attempt: factor, hold and descent in drive cycles,
/// release, share of the parts captured.
type CapturePlanned = (f64, Vec<(f32, u16, u16, f32)>, f64);

/// Plans the kicks that lock a lot.
#[pyfunction]
pub fn capture_plan(
    py: Python<'_>,
    restitution: [f64; 2],
    order: u32,
    k: Option<f64>,
    time_constant: f64,
    limit: f64,
    amplitude_error: f64,
    effort: u32,
) -> PyResult<CapturePlanned> {
    let restitution = lot(restitution)?;
    let band = Band::common(restitution, order).map_err(|error| match error {
        BandError::OutOfRange(refused) => Refused::from(refused).into(),
        BandError::Empty(none) => PyValueError::new_err(none.to_string()),
    })?;
    let k = k.unwrap_or(band.setpoint());
    if !band.contains(k) {
        let accepted = format!("{}..{}, the band of this lot", band.low(), band.high());
        let message = format!("k = {k} is refused; accepted: {accepted}");
        return Err(PyValueError::new_err(message));
    }
    let lag = DriveLagSettings {
        time_constant,
        start: 0.0,
        limit,
    };
    let lot = Lot {
        k,
        restitution,
        order,
        amplitude_error,
        contact: ContactTime::INSTANT,
    };
    let drive = DriveLag::build(lag).map_err(Refused::from)?;
    let settings = PlanSettings {
        lot,
        drive,
        time_constant,
        effort,
    };
    let mut planner = Planner::new(settings).map_err(Refused::from)?;
    let plan = py.detach(|| {
        let mut poll = InterruptPoll::new();
        loop {
            if let Poll::Ready(plan) = planner.advance(10_000) {
                return Ok::<_, PyErr>(plan);
            }
            poll.poll()?;
        }
    })?;
    let kicks = (0..).map_while(|attempt| plan.attempt(attempt)).take(20);
    let kicks = kicks.map(|kick| {
        let kick = kick.settings();
        (kick.factor, kick.hold, kick.descent, kick.release)
    });
    let share = plan.best().map_or(0.0, |best| best.share());
    Ok((k, kicks.collect(), share))
}

/// Exponent per impact with its error, the same per drive cycle, mean flight, type of the orbit.
type Exponents = ([f64; 2], [f64; 2], f64, &'static str);

/// The largest Lyapunov exponent at each k, of the orbit that begins beside the lock.
#[pyfunction]
pub fn exponents(
    py: Python<'_>,
    k: Vec<f64>,
    restitution: f64,
    order: u32,
    settle: u32,
    impacts: u32,
    scatter: f64,
    seed: u64,
    threads: Option<NonZero<usize>>,
) -> PyResult<Vec<Exponents>> {
    let settings = ExponentSettings { settle, impacts };
    let shape = [k.len()];
    work::map(py, &shape, k.len(), threads, |n, _| {
        let map = Map::build(k[n], restitution).map_err(Refused::element(n))?;
        let start = start_near_lock(&map, order);
        let result = if scatter > 0.0 {
            let scatter = Scatter::build(restitution, scatter, stream(seed, n as u64))?;
            exponent::measure_scattered(&map, start, settings, scatter)?
        } else {
            exponent::measure(&map, start, settings)?
        };
        let dynamics = match result.dynamics {
            Dynamics::Regular => "regular",
            Dynamics::Chaotic => "chaotic",
            Dynamics::Undecided => "undecided",
            Dynamics::Rest { .. } => "rest",
        };
        let [impact, cycle] = [result.per_impact, result.per_cycle].map(|of| [of.value, of.error]);
        Ok((impact, cycle, result.flight, dynamics))
    })
}

/// Law of the motion along the track: tangential restitution, or friction (sliding, sticking).
#[derive(FromPyObject)]
pub enum Along {
    Kept(f64),
    Friction([f64; 2]),
}

/// Mean speed (m/s) at each k of a part from rest, share of time in flight, and type of motion.
#[pyfunction]
pub fn transport_speeds(
    py: Python<'_>,
    k: Vec<f64>,
    restitution: f64,
    along: Along,
    track: [f64; 4],
    settle: u64,
    impacts: u64,
    tones: Option<Tones>,
    threads: Option<NonZero<usize>>,
) -> PyResult<Vec<(f64, f64, &'static str)>> {
    let [frequency, incline, amplitude_ratio, phase_lead] = track;
    let track = Track::build(TrackSettings {
        frequency,
        incline,
        amplitude_ratio,
        phase_lead,
        gravity: STANDARD_GRAVITY,
    })
    .map_err(Refused::from)?;
    let wave = wave(tones)?;
    if !wave.is_sine() && matches!(along, Along::Kept(_)) {
        let message =
            "tones are refused with tangential_restitution; accepted: friction with tones";
        return Err(PyValueError::new_err(message));
    }
    let effort = Effort { settle, impacts };
    let shape = [k.len()];
    work::map(py, &shape, k.len(), threads, |n, _| {
        let map = Map::build(k[n], restitution).map_err(Refused::element(n))?;
        let result = match along {
            Along::Kept(kept) => {
                let tangential = Tangential::build(k[n], TangentialSettings::on(&track, kept))?;
                measure(Orbit::from_rest(&map), tangential, effort, &mut ())
            }
            Along::Friction([sliding, sticking]) => {
                let settings = FrictionSettings::on(&track, sticking, sliding);
                if wave.is_sine() {
                    let friction = Friction::build(k[n], settings)?;
                    measure(Orbit::from_rest(&map), friction, effort, &mut ())
                } else {
                    let map = WaveMap::on(wave, k[n], restitution)?;
                    let friction = Friction::on(&wave, k[n], settings)?;
                    measure_on_tones(Origin::Rest.orbit(&map), friction, effort)
                }
            }
        };
        let conveyed = result.conveyed;
        let motion = match result.motion {
            Motion::Rest => "rest",
            Motion::HopAndRest => "hops and rests",
            Motion::Hopping => "hops",
        };
        let unit = track.velocity_unit(track.amplitude(k[n]));
        let speed = unit * conveyed.time_mean().unwrap_or(f64::NAN);
        let share = conveyed.flying / (conveyed.flying + conveyed.resting);
        Ok((speed, share, motion))
    })
}
