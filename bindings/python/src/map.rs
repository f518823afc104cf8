//! The impact map over arrays, and orbits.

use std::num::NonZero;
use std::sync::{Mutex, PoisonError};

use kband::impact::batch::{Block, LANES};
use kband::impact::{
    Impact, Kernel, Map, Orbit, OrbitEvent, PartState, Scatter, Tone, Wave, WaveMap,
};
use numpy::{PyReadonlyArray1, PyReadwriteArray1};
use pyo3::prelude::*;

use crate::refused::Refused;
use crate::work::{self, Stop};

/// Amplitude over the first tone and angle in rad of the second and the third tone.
pub type Tones = [[f64; 2]; 2];

/// The motion of a track with these tones; a sine without them.
pub fn wave(tones: Option<Tones>) -> Result<Wave, Refused> {
    let tones = tones.unwrap_or_default();
    let [second, third] = tones.map(|[amplitude, angle]| Tone::new(amplitude, angle));
    Ok(Wave::build(second, third)?)
}

/// Number of launches per task.
const TASK: usize = 64 * LANES;

/// Columns of launches, each with one value for all launches or one value per launch.
#[derive(Clone, Copy)]
struct Launches<'a> {
    phase: &'a [f64],
    speed: &'a [f64],
    k: &'a [f64],
    restitution: &'a [f64],
}

fn pick(column: &[f64], n: usize) -> f64 {
    match column {
        [one] => *one,
        many => many[n],
    }
}

impl<'a> Launches<'a> {
    fn new([phase, speed, k, restitution]: [&'a PyReadonlyArray1<'_, f64>; 4]) -> PyResult<Self> {
        Ok(Self {
            phase: phase.as_slice()?,
            speed: speed.as_slice()?,
            k: k.as_slice()?,
            restitution: restitution.as_slice()?,
        })
    }

    fn state(&self, n: usize) -> Result<PartState, Refused> {
        let state = Map::state(pick(self.phase, n), pick(self.speed, n));
        state.map_err(Refused::element(n))
    }

    fn track(&self, n: usize) -> [f64; 2] {
        [pick(self.k, n), pick(self.restitution, n)]
    }
}

/// Map of the previous launch, reused for bitwise equal k and restitution.
#[derive(Default)]
struct Maps(Option<([u64; 2], Map)>);

impl Maps {
    #[inline]
    fn of(&mut self, launches: &Launches<'_>, n: usize) -> Result<&Map, Refused> {
        let [k, restitution] = launches.track(n);
        let bits = [k.to_bits(), restitution.to_bits()];
        if !matches!(&self.0, Some((known, _)) if *known == bits) {
            self.0 = None;
        }
        match &mut self.0 {
            Some((_, map)) => Ok(map),
            none => {
                let map = Map::build(k, restitution).map_err(Refused::element(n))?;
                Ok(&none.insert((bits, map)).1)
            }
        }
    }
}

/// One impact of each of the launches from `from` on.
fn fly(
    launches: &Launches<'_>,
    from: usize,
    phase: &mut [f64],
    speed: &mut [f64],
) -> Result<(), Refused> {
    let (mut block, mut maps) = (Block::new(), Maps::default());
    let columns = phase.chunks_mut(LANES).zip(speed.chunks_mut(LANES));
    for (at, (phase, speed)) in columns.enumerate() {
        let first = from + at * LANES;
        for lane in 0..phase.len() {
            let map = maps.of(launches, first + lane)?;
            block.put(lane, map, launches.state(first + lane)?)?;
        }
        for lane in phase.len()..LANES {
            block.clear(lane);
        }
        block.advance(1);
        for (lane, (phase, speed)) in phase.iter_mut().zip(speed).enumerate() {
            let next = match block.impact(lane) {
                Some(Impact { flight, next, .. }) if flight > 0.0 => next,
                // The block does not advance parts that rest or whose chatter has a closed form.
                _ => {
                    let map = maps.of(launches, first + lane)?;
                    map.impact(launches.state(first + lane)?).next
                }
            };
            (*phase, *speed) = (next.phase, next.velocity);
        }
    }
    Ok(())
}

fn fly_on_tones(
    wave: &Wave,
    launches: &Launches<'_>,
    from: usize,
    phase: &mut [f64],
    speed: &mut [f64],
) -> Result<(), Refused> {
    for (n, (phase, speed)) in (from..).zip(phase.iter_mut().zip(speed)) {
        let [k, restitution] = launches.track(n);
        let map = WaveMap::on(*wave, k, restitution).map_err(Refused::element(n))?;
        let next = map.impact(launches.state(n)?).next;
        (*phase, *speed) = (next.phase, next.velocity);
    }
    Ok(())
}

/// One impact of each launch: phase and speed after it, into `next_phase` and `next_speed`.
#[pyfunction]
pub fn impacts(
    py: Python<'_>,
    phase: PyReadonlyArray1<'_, f64>,
    speed: PyReadonlyArray1<'_, f64>,
    k: PyReadonlyArray1<'_, f64>,
    restitution: PyReadonlyArray1<'_, f64>,
    mut next_phase: PyReadwriteArray1<'_, f64>,
    mut next_speed: PyReadwriteArray1<'_, f64>,
    shape: Vec<usize>,
    tones: Option<Tones>,
    threads: Option<NonZero<usize>>,
) -> PyResult<()> {
    let launches = Launches::new([&phase, &speed, &k, &restitution])?;
    let wave = wave(tones)?;
    let phases = next_phase.as_slice_mut()?.chunks_mut(TASK);
    let speeds = next_speed.as_slice_mut()?.chunks_mut(TASK);
    let tasks: Vec<Mutex<(&mut [f64], &mut [f64])>> = phases.zip(speeds).map(Mutex::new).collect();
    work::map(py, &shape, tasks.len(), threads, |n, _| {
        let mut task = tasks[n].lock().unwrap_or_else(PoisonError::into_inner);
        let (phase, speed) = &mut *task;
        if wave.is_sine() {
            fly(&launches, n * TASK, phase, speed)
        } else {
            fly_on_tones(&wave, &launches, n * TASK, phase, speed)
        }
    })?;
    Ok(())
}

/// Columns of one orbit: state after each impact, flight before it, and whether the part rested
/// since the previous impact.
struct Row<'a> {
    columns: [&'a mut [f64]; 3],
    rested: &'a mut [bool],
    at: usize,
    rests: bool,
}

impl Row<'_> {
    /// Records the impacts of an orbit until it is complete or `stop` is requested.
    fn take_all(&mut self, orbit: impl Iterator<Item = OrbitEvent>, stop: &Stop) {
        for event in orbit {
            if !self.take(event) || stop.is_requested() {
                return;
            }
        }
        // A part that rests for ever makes no more impacts.
        for column in &mut self.columns {
            column[self.at..].fill(f64::NAN);
        }
        self.rested[self.at..].fill(true);
    }

    /// Records an event; returns whether more impacts are needed.
    fn take(&mut self, event: OrbitEvent) -> bool {
        match event {
            OrbitEvent::Rest { .. } => self.rests = true,
            OrbitEvent::LiftOff { .. } => {}
            OrbitEvent::Impact(Impact { next, flight, .. }) => {
                let [phase, speed, flights] = &mut self.columns;
                phase[self.at] = next.phase;
                speed[self.at] = next.velocity;
                flights[self.at] = flight;
                self.rested[self.at] = self.rests;
                self.rests = false;
                self.at += 1;
            }
        }
        self.at < self.rested.len()
    }
}

/// Seed of one of many streams of random numbers.
pub fn stream(seed: u64, number: u64) -> u64 {
    seed.rotate_left(20) ^ number
}

/// The first `impacts` impacts of the orbit from each launch, orbit by orbit.
#[pyfunction]
pub fn orbits(
    py: Python<'_>,
    phase: PyReadonlyArray1<'_, f64>,
    speed: PyReadonlyArray1<'_, f64>,
    k: PyReadonlyArray1<'_, f64>,
    restitution: PyReadonlyArray1<'_, f64>,
    mut phases: PyReadwriteArray1<'_, f64>,
    mut speeds: PyReadwriteArray1<'_, f64>,
    mut flights: PyReadwriteArray1<'_, f64>,
    mut rested: PyReadwriteArray1<'_, bool>,
    impacts: usize,
    shape: Vec<usize>,
    scatter: f64,
    seed: u64,
    tones: Option<Tones>,
    threads: Option<NonZero<usize>>,
) -> PyResult<()> {
    let launches = Launches::new([&phase, &speed, &k, &restitution])?;
    let wave = wave(tones)?;
    let rows = phases
        .as_slice_mut()?
        .chunks_mut(impacts)
        .zip(speeds.as_slice_mut()?.chunks_mut(impacts))
        .zip(flights.as_slice_mut()?.chunks_mut(impacts))
        .zip(rested.as_slice_mut()?.chunks_mut(impacts));
    let row = |(((phase, speed), flight), rested)| Row {
        columns: [phase, speed, flight],
        rested,
        at: 0,
        rests: false,
    };
    let rows: Vec<Mutex<Row<'_>>> = rows.map(row).map(Mutex::new).collect();
    work::map(py, &shape, rows.len(), threads, |n, stop| {
        let mut row = rows[n].lock().unwrap_or_else(PoisonError::into_inner);
        let ([k, restitution], start) = (launches.track(n), launches.state(n)?);
        // Checked after the map, whose range of restitution is narrower.
        let seed = stream(seed, n as u64);
        let scatter = || Scatter::build(restitution, scatter, seed).map_err(Refused::element(n));
        if wave.is_sine() {
            let map = Map::build(k, restitution).map_err(Refused::element(n))?;
            let orbit = Orbit::new(&map, start).scattering(scatter()?);
            row.take_all(orbit.map_err(Refused::element(n))?, stop);
        } else {
            let map = WaveMap::on(wave, k, restitution).map_err(Refused::element(n))?;
            row.take_all(Orbit::new(&map, start).scattering(scatter()?), stop);
        }
        Ok(())
    })?;
    Ok(())
}
