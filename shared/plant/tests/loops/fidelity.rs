//! Both plants under the controller, and the true and estimated time in gear of their parts.

use core::f64::consts::TAU;
use kband::regime::classify::Regime;
use kband::regime::gear::GearWatch;
use kband_control::{Controller, GearPlanned, Settings, Target};
use kband_plant::{
    Change, ClosedLoop, Disturbance, Disturbances, DriveModel, EnvelopeLoop, Moment, Scene, Strike,
};
use std::sync::Mutex;

pub enum Loop {
    Envelope(Box<EnvelopeLoop>),
    Waveform(Box<ClosedLoop>),
}

impl Loop {
    pub fn build(scene: &Scene, waveform: bool) -> Self {
        if waveform {
            Self::Waveform(Box::new(ClosedLoop::build(scene).unwrap()))
        } else {
            Self::Envelope(Box::new(EnvelopeLoop::build(scene).unwrap()))
        }
    }

    pub fn both(scene: &Scene) -> [Self; 2] {
        [false, true].map(|waveform| Self::build(scene, waveform))
    }

    /// A drive cycle: the moment, its impacts and READY.
    pub fn cycle(&mut self) -> (Moment, Vec<Strike>, bool) {
        let (moment, strikes) = match self {
            Self::Envelope(closed) => {
                closed.advance_supplied(supply_plan);
                (closed.moment(), closed.strikes().to_vec())
            }
            Self::Waveform(closed) => {
                supply_plan(closed.controller_mut());
                (closed.cycle(), closed.plant().strikes().to_vec())
            }
        };
        (moment, strikes, self.controller().is_ready())
    }

    pub fn controller(&self) -> &Controller {
        match self {
            Self::Envelope(closed) => closed.controller(),
            Self::Waveform(closed) => closed.controller(),
        }
    }
}

/// Plans for gear of earlier runs. A plan takes as long as a run of many seconds.
static PLANS: Mutex<Vec<GearPlanned>> = Mutex::new(Vec::new());

/// Supplies an earlier plan: it depends on its settings alone, so no bit of the run changes.
fn supply_plan(controller: &mut Controller) {
    if let Some(requested) = controller.gear_search() {
        let plans = PLANS.lock().unwrap();
        if let Some(made) = plans.iter().find(|plan| plan.settings == *requested) {
            controller.supply_gear(made.clone());
        }
    }
}

impl Drop for Loop {
    fn drop(&mut self) {
        let made = self.controller().gear_planned().cloned();
        PLANS.lock().unwrap().extend(made);
    }
}

/// The envelope without displacement, READY and an unneeded regime, in half of the time.
pub fn unwatched(scene: &Scene) -> EnvelopeLoop {
    let mut closed = EnvelopeLoop::build(scene).unwrap();
    closed.watch(false);
    closed.watch_ready(false);
    closed
}

/// Changes at their times in s.
pub fn changes<const N: usize>(changes: [(f64, Change); N]) -> Disturbances {
    let changes = changes.map(|(at, change)| Disturbance { at, change });
    changes.into_iter().collect()
}

/// Moves a feeder to another frequency in Hz, with the same k at each output.
pub fn tune(scene: &mut Scene, frequency: f32) {
    let settings = &mut scene.settings;
    let unit = (settings.frequency / frequency) * (settings.frequency / frequency);
    (settings.frequency, settings.resonance) = (frequency, frequency);
    settings.gain *= unit;
    settings.amplitude_limit *= unit;
    settings.safe_amplitude *= unit;
    (scene.drive.resonance, scene.drive.gain) = (frequency, settings.gain);
}

/// The drive that a controller with these settings assumes.
pub fn drive_of(settings: &Settings) -> DriveModel {
    DriveModel {
        resonance: settings.resonance,
        quality: settings.quality,
        gain: settings.gain,
        second_gain: settings.second_gain,
        second_lag: settings.second_lag,
        third_gain: settings.third_gain,
        third_lag: settings.third_lag,
        ..DriveModel::default()
    }
}

/// Records the strikes of a cycle, with one watch for each part.
pub fn record(watches: &mut [GearWatch], strikes: &[Strike]) {
    for strike in strikes {
        let landed = strike.time as f64 / 4_294_967_296.0 * TAU;
        let flight = f64::from(strike.flight) * TAU;
        let watch = &mut watches[usize::from(strike.part)];
        if strike.rested {
            watch.add_rest(landed - flight);
        }
        watch.add_landing(landed, flight);
    }
}

/// Parts evenly spaced over a lot, configured correctly, at a fixed k.
pub fn lot([low, high]: [f32; 2], scatter: f32, k: f32, parts: usize, seed: u64) -> Scene {
    let part = |n: usize| low + (high - low) * (n as f32 + 0.5) / parts as f32;
    let mut scene = Scene {
        target: Target::K(k),
        seed,
        parts: (0..parts).map(part).collect(),
        scatter: core::iter::repeat_n(scatter, parts).collect(),
        ..Scene::default()
    };
    let settings = &mut scene.settings;
    settings.scatter = scatter;
    (settings.restitution_low, settings.restitution_high) = (low, high);
    scene
}

/// Cycles of a run of a minute, and number of initial cycles that do not count.
pub const CYCLES: usize = 3000;
pub const SETTLED: usize = 250;

/// True and estimated share in gear over a minute: means from 5 s on.
#[derive(Debug, Default)]
pub struct ShareResult {
    pub actual: f64,
    pub estimated: f64,
    pub error: f64,
    /// Cycles without an estimate.
    pub deaf_cycles: usize,
    pub locked: usize,
}

/// Runs a scene whose gear is of order 1 for a minute.
pub fn measure_share(scene: &Scene, waveform: bool) -> ShareResult {
    let mut closed = Loop::build(scene, waveform);
    if let Loop::Envelope(closed) = &mut closed {
        closed.watch_displacement(false);
    }
    let parts = scene.parts.len();
    let mut watches = vec![GearWatch::build(1).unwrap(); parts];
    let mut all = ShareResult::default();
    for cycle in 0..CYCLES {
        if cycle == SETTLED {
            let begin = cycle as f64 * TAU;
            watches.iter_mut().for_each(|watch| watch.begin(begin));
        }
        let (Moment { report, .. }, strikes, _) = closed.cycle();
        record(&mut watches, &strikes);
        if cycle < SETTLED {
            continue;
        }
        if report.in_gear_error.is_finite() {
            all.estimated += f64::from(report.in_gear);
            all.error += f64::from(report.in_gear_error);
        } else {
            all.deaf_cycles += 1;
        }
        all.locked += usize::from(report.regime.is_some_and(|verdict| {
            matches!(verdict.regime, Regime::Locked { .. }) && verdict.confidence > 0.5
        }));
    }
    let count = (CYCLES - SETTLED - all.deaf_cycles).max(1) as f64;
    all.estimated /= count;
    all.error /= count;
    let shares = watches.iter().map(|watch| watch.share(CYCLES as f64 * TAU));
    all.actual = shares.map(|share| share.share()).sum::<f64>() / parts as f64;
    all
}
