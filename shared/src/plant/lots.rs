//! READY of lots that are drawn at random, and of lots whose parts change or leave: when it may be on, and how soon it is off.
//!
//! `KBAND_LOTS` and `KBAND_SEED` say how many random lots are run, and which.

use core::f64::consts::TAU;
use std::boxed::Box;
use std::vec::Vec;

use super::{Change, ClosedLoop, Disturbance, EnvelopeLoop, Moment, Noise, Scene, Strike};
use crate::control::{Limits, Target};
use crate::feeder::STANDARD_GRAVITY;
use crate::regime::gear::GearWatch;

/// Drive cycles of a window in which the true share in gear is counted, and windows of a run.
const WINDOW: u32 = 512;
const WINDOWS: u32 = 3;
/// True share in gear in a window below which READY must not be on.
const OUT_OF_GEAR: f64 = 0.05;

/// Either fidelity.
enum Loop {
    Envelope(Box<EnvelopeLoop>),
    Waveform(Box<ClosedLoop>),
}

impl Loop {
    fn both(scene: &Scene) -> [Self; 2] {
        [
            Self::Envelope(Box::new(EnvelopeLoop::build(scene).unwrap())),
            Self::Waveform(Box::new(ClosedLoop::build(scene).unwrap())),
        ]
    }

    /// A drive cycle: the moment, its impacts and READY.
    fn cycle(&mut self) -> (Moment, Vec<Strike>, bool) {
        match self {
            Self::Envelope(closed) => {
                let moment = closed.cycle();
                let strikes = closed.strikes().to_vec();
                (moment, strikes, closed.controller().ready())
            }
            Self::Waveform(closed) => {
                let moment = closed.cycle();
                let strikes = closed.plant().strikes().to_vec();
                (moment, strikes, closed.controller().ready())
            }
        }
    }
}

fn between(noise: &mut Noise, low: f64, high: f64) -> f64 {
    low + (high - low) * f64::from(noise.uniform())
}

fn log_between(noise: &mut Noise, low: f64, high: f64) -> f64 {
    libm::exp(between(noise, libm::log(low), libm::log(high)))
}

/// A feeder of 20 to 300 Hz with 1 to 12 parts of R 0.1 to 0.6 and s 0.02 to 0.10, for gear of order 1 or 2; the sensor's gain is 0.7 to
/// 1.4 of the configured one, in a quarter of the lots exactly that.
fn random_lot(seed: u64, number: u64) -> (Scene, u8) {
    let noise = &mut Noise::new(seed.wrapping_mul(1_000_003).wrapping_add(number));
    let order = 1 + (noise.bits() % 2) as u8;
    let frequency = log_between(noise, 20.0, 300.0);
    let square = (TAU * frequency) * (TAU * frequency);
    // Amplitude in mm at k = 0.35.
    let unit = 1e3 * STANDARD_GRAVITY / (0.35 * square);
    let mut scene = Scene {
        target: Target::Gear { order },
        seed: number + 1,
        ..Scene::default()
    };
    let settings = &mut scene.settings;
    settings.frequency = frequency as f32;
    settings.resonance = settings.frequency;
    settings.quality = log_between(noise, 8.0, 60.0) as f32;
    settings.envelope = (settings.quality / core::f32::consts::PI).max(1.0);
    let middle = between(noise, 0.1, 0.6);
    let half = between(noise, -0.05, 0.05).max(0.0);
    settings.restitution_low = (middle - half) as f32;
    settings.restitution_high = (middle + half) as f32;
    settings.scatter = between(noise, 0.02, 0.10) as f32;
    settings.gain = (8.0 * unit) as f32;
    settings.amplitude_limit = (5.0 * unit) as f32;
    settings.acceleration_limit = (6.0 * STANDARD_GRAVITY / 0.35) as f32;
    settings.safe_amplitude = (0.2 * unit) as f32;
    settings.sensitivity = 0.02;
    scene.drive.resonance = settings.resonance;
    scene.drive.quality = settings.quality;
    scene.drive.gain = settings.gain;
    scene.sensor.noise = (1e-3 * unit * square * log_between(noise, 1e-3, 6e-3)) as f32;
    let gain = between(noise, 0.7, 1.4) as f32;
    scene.sensor.sensitivity = if noise.bits().is_multiple_of(4) {
        1.0
    } else {
        gain
    };
    let parts = 1 + noise.bits() as usize % 12;
    scene.parts = (0..parts)
        .map(|_| between(noise, middle - half, middle + half) as f32)
        .collect();
    scene.scatter = core::iter::repeat_n(settings.scatter, parts).collect();
    (scene, order)
}

/// Counts the strikes of a cycle.
fn count(watches: &mut [GearWatch], strikes: &[Strike]) {
    for strike in strikes {
        let landed = strike.time as f64 / 4_294_967_296.0 * TAU;
        let flight = f64::from(strike.flight) * TAU;
        let watch = &mut watches[usize::from(strike.part)];
        if strike.rested {
            watch.rested(landed - flight);
        }
        watch.landed(landed, flight);
    }
}

#[test]
fn ready_is_off_where_no_part_is_in_gear() {
    let number = |name: &str, otherwise: u64| {
        std::env::var(name).map_or(otherwise, |value| value.parse().expect("a whole number"))
    };
    let (lots, seed) = (number("KBAND_LOTS", 40), number("KBAND_SEED", 1));
    let (mut out_of_gear, mut ready_in_gear, mut wrong) = (0_u32, 0_u32, Vec::new());
    for lot in 0..lots {
        let (scene, order) = random_lot(seed, lot);
        for (fidelity, mut closed) in Loop::both(&scene).into_iter().enumerate() {
            let mut watches =
                std::vec![GearWatch::build(u32::from(order)).unwrap(); scene.parts.len()];
            for window in 0..WINDOWS {
                let [begin, end] = [window, window + 1].map(|n| f64::from(n * WINDOW) * TAU);
                watches.iter_mut().for_each(|watch| watch.begin(begin));
                let mut on = 0;
                for _ in 0..WINDOW {
                    let (_, strikes, ready) = closed.cycle();
                    count(&mut watches, &strikes);
                    on += u32::from(ready);
                }
                let shares = watches.iter().map(|watch| watch.share(end).share());
                let share = shares.sum::<f64>() / scene.parts.len() as f64;
                if share < OUT_OF_GEAR {
                    out_of_gear += 1;
                    if on > 0 {
                        wrong.push((lot, fidelity, window, share, on));
                    }
                } else if share > 0.7 && on > 0 {
                    ready_in_gear += 1;
                }
            }
        }
    }
    std::println!(
        "{out_of_gear} windows out of gear, READY in {}",
        wrong.len()
    );
    assert!(
        wrong.is_empty(),
        "lot, fidelity, window, share, cycles: {wrong:?}"
    );
    assert!(
        u64::from(out_of_gear) > lots,
        "{out_of_gear} of {lots} lots"
    );
    assert!(
        u64::from(ready_in_gear) * 20 > lots,
        "{ready_in_gear} of {lots} lots"
    );
}

/// Time in s at which a lot of R 0.18 to 0.22 without scatter changes.
const CHANGED_AT: f64 = 8.0;

/// Parts of that lot, of which `change` makes something else.
fn changing(parts: usize, seed: u64, changes: &[Change]) -> Scene {
    let mut scene = Scene {
        target: Target::Gear { order: 1 },
        seed,
        parts: (0..parts)
            .map(|part| 0.18 + 0.04 * (part as f32 + 0.5) / parts as f32)
            .collect(),
        ..Scene::default()
    };
    scene.settings.scatter = 0.0;
    let at = |change: &Change| Disturbance {
        at: CHANGED_AT,
        change: *change,
    };
    scene.disturbances = changes.iter().map(at).collect();
    scene
}

/// The last time in s after the change at which `reported` holds, of a run of 8 s after it; READY is on before the change.
fn last_report(closed: &mut Loop, reported: impl Fn(&Moment, bool) -> bool) -> f64 {
    let (mut was_ready, mut last) = (false, 0.0);
    loop {
        let (moment, _, ready) = closed.cycle();
        if moment.time < CHANGED_AT {
            was_ready = ready;
        } else if reported(&moment, ready) {
            last = moment.time - CHANGED_AT;
        }
        if moment.time > CHANGED_AT + 8.0 {
            assert!(was_ready);
            return last;
        }
    }
}

/// A part of R 0.05 lands at the same phase in each stroke and rests; the others hop and rest.
#[test]
fn ready_is_off_a_second_after_parts_fell_out_of_gear() {
    for (parts, restitution, scatter) in [
        (1, 0.05, 0.0),
        (1, 0.4, 0.0),
        (6, 0.05, 0.0),
        (6, 0.6, 0.1),
        (6, 0.7, 0.05),
    ] {
        let changes = [Change::Restitution(restitution), Change::Scatter(scatter)];
        for seed in 100..124 {
            let scene = changing(parts, seed, &changes);
            let mut closed = Loop::Waveform(Box::new(ClosedLoop::build(&scene).unwrap()));
            let last = last_report(&mut closed, |_, ready| ready);
            assert!(last < 1.0, "{parts} of {restitution}, {seed}: {last} s");
        }
    }
}

#[test]
fn nothing_is_reported_of_an_empty_track() {
    for parts in [1, 6] {
        for closed in &mut Loop::both(&changing(parts, 1, &[Change::Parts(0)])) {
            let last = last_report(closed, |Moment { report, .. }, ready| {
                ready
                    || report.in_gear > 0.0
                    || report.in_gear_error.is_finite()
                    || report.margin.is_some()
                    || report.load.is_some()
            });
            // A second, and the flights on the way.
            assert!(last < 1.1, "{parts}: {last} s");
        }
    }
}

/// Six parts of R 0.4 at 200 Hz, wanted in a lock of order 2: none is loud enough alone.
#[test]
fn nothing_is_reported_while_deaf() {
    let mut scene = Scene {
        target: Target::Locked { order: 2 },
        parts: [0.4; 6].into_iter().collect(),
        scatter: [0.04; 6].into_iter().collect(),
        ..Scene::default()
    };
    let settings = &mut scene.settings;
    (settings.frequency, settings.resonance) = (200.0, 200.0);
    (settings.restitution_low, settings.restitution_high) = (0.4, 0.4);
    (settings.scatter, settings.quality, settings.gain) = (0.04, 34.0, 0.05);
    (settings.amplitude_limit, settings.acceleration_limit) = (0.06, 80.0);
    settings.safe_amplitude = 0.003;
    (scene.drive.resonance, scene.drive.quality, scene.drive.gain) = (200.0, 34.0, 0.05);
    (scene.sensor.noise, scene.sensor.ringing) = (0.04, 100.0);
    for mut closed in Loop::both(&scene) {
        let mut deaf = 0;
        for _ in 0..1600 {
            let (Moment { report, .. }, _, ready) = closed.cycle();
            if report.limits.contains(Limits::DEAF) {
                deaf += 1;
                assert_eq!(report.in_gear, 0.0);
                assert!(report.in_gear_error.is_infinite());
                assert!(report.margin.is_none() && report.load.is_none() && !ready);
            }
        }
        assert!(deaf > 800, "{deaf}");
        // The limit hides the estimate; the estimate itself has no order 2 either.
        let share = match &closed {
            Loop::Envelope(closed) => closed.controller().estimated_share(),
            Loop::Waveform(closed) => closed.controller().estimated_share(),
        };
        assert!(share.unwrap().share < 0.3, "{share:?}");
    }
}
