//! Tests: random feeders with several tones and a configured track mass, in both plants.
//!
//! `KBAND_SCENES` sets the number of feeders, `KBAND_SEED` the seed.

use super::{ClosedLoop, EnvelopeLoop, Moment, Scene};
use crate::model::drive::UpperMode;
use core::f32::consts::TAU;
use kband::arithmetic::Noise;
use kband_control::{Fault, Report, Shape, Target, UpperTone};
use std::vec::Vec;

/// Largest true amplitude and acceleration over their hard limits: else, with heavy parts, which
/// strike between measurements, and after fault 2 (sensor saturated), by the output's model.
const MAX_EXCESS: [f32; 3] = [1.1, 1.15, 1.2];
/// Largest peak-to-peak amplitude over its reference at READY, without and with heavy parts: 8 % to
/// each side as measured, and 8 % by impacts that are not heard. Measured: 0.12 and 0.21.
const MAX_VARIATION: [f32; 2] = [0.16, 0.24];
/// Largest relative error of the mean amplitude then, of a drive as configured and of another one,
/// whose difference counts as load of the parts. Measured with 60 seeds: 0.074, with heavy parts that
/// the sensor does not hear, and 0.091.
const MAX_MEAN_ERROR: [f32; 2] = [0.08, 0.12];
/// Cycles of READY at constant reference over which the variation is measured.
const VARIATION_CYCLES: usize = 40;

struct Draw(Noise);

impl Draw {
    fn between(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * (self.0.bits() as f32 / 4_294_967_296.0)
    }

    fn scale(&mut self, low: f32, high: f32) -> f32 {
        low * libm::powf(high / low, self.between(0.0, 1.0))
    }

    fn one(&mut self, all: &[f32]) -> f32 {
        all[self.0.bits() as usize % all.len()]
    }
}

/// A random feeder with modes near two and three times its frequency. Half differ from settings.
fn feeder(draw: &mut Draw) -> Scene {
    let mut scene = Scene {
        seed: u64::from(draw.0.bits()),
        ..Scene::default()
    };
    let frequency = draw.one(&[20.0, 33.3, 50.0, 60.0, 100.0, 150.0]);
    let square = (TAU * frequency) * (TAU * frequency);
    // Amplitude in mm at k = 0.35.
    let unit = 1e3 * 9.8 / (0.35 * square);
    let k = draw.between(0.25, 0.9);
    let settings = &mut scene.settings;
    (settings.frequency, settings.resonance) = (frequency, frequency);
    settings.quality = draw.scale(5.0, 60.0);
    settings.envelope = (settings.quality / 3.0).max(1.0);
    settings.gain = unit * draw.scale(1.5, 8.0);
    let amplitude = unit * 0.35 / k;
    settings.amplitude_limit = amplitude * draw.scale(1.02, 5.0);
    settings.acceleration_limit = 9.8 / 0.35 * draw.scale(1.5, 8.0);
    settings.safe_amplitude = 0.1 * unit.min(settings.amplitude_limit);
    settings.soft_start = draw.scale(0.1, 1.0);
    settings.track_mass = draw.scale(1.0, 100.0);
    settings.second_tone = draw.between(0.05, 0.2);
    settings.second_gain = settings.gain * draw.scale(0.1, 1.5);
    settings.second_lag = draw.one(&[-1.0, 1.0]) * draw.between(30.0, 150.0);
    if draw.0.bits().is_multiple_of(2) {
        settings.third_tone = draw.between(0.02, 0.1);
        settings.third_gain = settings.gain * draw.scale(0.1, 1.0);
        settings.third_lag = draw.one(&[-1.0, 1.0]) * draw.between(30.0, 150.0);
    }
    let second = UpperTone::new(settings.second_tone, draw.between(-3.0, 3.0));
    let third = UpperTone::new(settings.third_tone, draw.between(-3.0, 3.0));
    let shape = Shape::new(second, third);
    let middle = draw.between(0.12, 0.4);
    (settings.restitution_low, settings.restitution_high) = (middle - 0.02, middle + 0.02);
    scene.target = match draw.0.bits() % 5 {
        0 => Target::Gear { order: 1 },
        1 => Target::Tones { k, shape },
        2 => Target::Amplitude(amplitude),
        _ => Target::K(k),
    };
    let parts = draw.one(&[0.0, 1.0, 3.0, 8.0]) as usize;
    let restitutions = (0..parts).map(|_| draw.between(middle - 0.02, middle + 0.02));
    scene.parts = restitutions.collect();
    let heavy = draw.one(&[0.0, 0.0, 0.0, 0.02, 0.05]) * 1e3 * scene.settings.track_mass;
    scene.masses = (0..parts).map(|_| heavy / parts as f32).collect();
    let (settings, drive) = (&scene.settings, &mut scene.drive);
    (drive.resonance, drive.quality) = (settings.resonance, settings.quality);
    (drive.gain, drive.mass) = (settings.gain, settings.track_mass);
    (drive.second_gain, drive.second_lag) = (settings.second_gain, settings.second_lag);
    if settings.third_tone > 0.0 {
        (drive.third_gain, drive.third_lag) = (settings.third_gain, settings.third_lag);
    }
    drive.second_quality = settings.quality;
    if draw.0.bits().is_multiple_of(2) {
        drive.resonance *= 1.0 + draw.between(-0.15, 0.15) / drive.quality;
        drive.quality *= draw.scale(0.7, 1.4);
        drive.gain *= draw.scale(0.8, 1.25);
        drive.second_gain *= draw.scale(0.6, 1.6);
        drive.third_gain *= draw.scale(0.6, 1.6);
        drive.second_lag += draw.between(-25.0, 25.0);
        drive.second_lag = drive.second_lag.clamp(-180.0, 180.0);
        drive.second_quality = draw.scale(5.0, 100.0);
    }
    scene
}

/// Whether the modes are near twice and three times the drive frequency and at most twice as strong
/// as the resonance. A lag near 0 or half a turn implies a distant mode.
fn is_near(scene: &Scene) -> bool {
    let frequency = f64::from(scene.settings.frequency);
    let force = f64::from(scene.drive.gain / scene.drive.quality) * 1e-3;
    let modes = UpperMode::fit_configured(&scene.drive, frequency);
    modes.iter().all(|mode| {
        let turns = mode.frequency / frequency;
        let deviation = (turns / 2.0 - 1.0).abs().min((turns / 3.0 - 1.0).abs());
        deviation < 0.1 && mode.force.abs() < 2.0 * force
    })
}

/// Acceleration of the upper modes over that of the resonance, if the force ends at once. Each then
/// rings at its own frequency from the static displacement.
fn released(scene: &Scene) -> f32 {
    let frequency = f64::from(scene.settings.frequency);
    let modes = UpperMode::fit_configured(&scene.drive, frequency);
    let square = |mode: &UpperMode| (mode.frequency / frequency).powi(2);
    let accelerations = modes.iter().map(|mode| square(mode) * mode.force.abs());
    accelerations.sum::<f64>() as f32 / (1e-3 * scene.drive.gain)
}

#[derive(Clone, Copy, Debug, Default)]
struct RunResult {
    max_excess: f32,
    /// Largest acceleration over its limit after a fault opened the bridge.
    ringing: f32,
    swing: f32,
    deviation: f32,
    broken: bool,
    fault: u8,
}

/// Whether no number is NaN, and only those without an estimate or at rest are infinite.
fn finite(moment: &Moment) -> bool {
    let report = Report {
        k: 0.0,
        in_gear_error: 0.0,
        to_loss: 0.0,
        margin: None,
        ..moment.report
    };
    let masked = Moment { report, ..*moment };
    !std::format!("{moment:?}").contains("NaN") && !std::format!("{masked:?}").contains("inf")
}

/// A cycle: moment, READY, amplitude in m, and the peaks of displacement in m and of acceleration over
/// the squared angular frequency.
type Observed = (Moment, bool, f32, [f32; 2]);

fn run(scene: &Scene, cycles: usize, mut cycle: impl FnMut() -> Observed) -> RunResult {
    let settings = &scene.settings;
    let square = (TAU * settings.frequency) * (TAU * settings.frequency);
    let mut result = RunResult::default();
    let mut window: Vec<f32> = Vec::new();
    let mut reference = 0.0;
    for _ in 0..cycles {
        let (moment, ready, amplitude, [peak, push]) = cycle();
        result.broken |= !finite(&moment);
        let far = peak * 1e3 / settings.amplitude_limit;
        let hard = push * square / settings.acceleration_limit;
        let driven = if result.fault == 0 { hard } else { 0.0 };
        result.max_excess = result.max_excess.max(far).max(driven);
        result.ringing = result.ringing.max(hard - driven);
        result.fault = moment.report.fault.map_or(result.fault, Fault::number);
        if !ready || moment.report.reference != reference {
            window.clear();
        }
        reference = moment.report.reference;
        if ready {
            window.push(amplitude);
            if window.len() >= VARIATION_CYCLES {
                let last = &window[window.len() - VARIATION_CYCLES..];
                let high = last.iter().copied().fold(0.0, f32::max);
                let low = last.iter().copied().fold(f32::INFINITY, f32::min);
                result.swing = result.swing.max((high - low) / reference);
                let mean = last.iter().sum::<f32>() / VARIATION_CYCLES as f32;
                result.deviation = result.deviation.max((mean / reference - 1.0).abs());
            }
        }
    }
    result
}

/// Runs a feeder in waveform and envelope; `None` if settings or target are rejected. Heavy parts
/// on several tones run in the waveform only, because the envelope lacks their overtones.
fn run_fidelities(scene: &Scene, cycles: usize) -> Option<Vec<RunResult>> {
    let mut closed = ClosedLoop::build(scene).ok()?;
    let mut envelope = EnvelopeLoop::build(scene).ok()?;
    let slow = run(scene, cycles, || {
        let mut far = 0.0_f32;
        let moment = closed.trace_cycle(|sample| far = far.max(sample.displacement.abs()));
        let (amplitude, shape) = closed.plant().tones();
        let [_, push] = shape.peaks();
        let ready = closed.controller().is_ready();
        (moment, ready, amplitude, [far, amplitude * push])
    });
    if scene.has_mass() {
        return Some([slow].into());
    }
    let fast = run(scene, cycles, || {
        let moment = envelope.cycle();
        let amplitude = envelope.amplitude() as f32;
        let ready = envelope.controller().is_ready();
        // First tone only; during saturation the estimated shape is invalid.
        (moment, ready, amplitude, [amplitude; 2])
    });
    Some([slow, fast].into())
}

fn number(name: &str, otherwise: u64) -> u64 {
    std::env::var(name).map_or(otherwise, |value| value.parse().expect("a whole number"))
}

#[test]
fn drawn_feeders_keep_limits_and_steady_ready() {
    let mut draw = Draw(Noise::new(number("KBAND_SEED", 1)));
    let runs = core::iter::repeat_with(|| feeder(&mut draw))
        .filter(is_near)
        .filter_map(|scene| {
            let cycles = (6.0 * scene.settings.frequency) as usize;
            Some((run_fidelities(&scene, cycles)?, scene))
        });
    for (results, scene) in runs.take(number("KBAND_SCENES", 100) as usize) {
        let differs = scene.drive.quality != scene.settings.quality;
        for (n, result) in results.into_iter().enumerate() {
            let saturated = result.fault == Fault::SensorSaturated.number();
            let heavy = usize::from(scene.has_mass());
            let max_excess = MAX_EXCESS[if saturated { 2 } else { heavy }];
            let keeps = !result.broken
                && result.max_excess <= max_excess
                && result.ringing <= max_excess * (1.0 + released(&scene))
                && result.swing <= MAX_VARIATION[usize::from(scene.has_mass())]
                && result.deviation <= MAX_MEAN_ERROR[usize::from(differs)];
            assert!(keeps, "fidelity {n}: {result:?} {scene:?}");
        }
    }
}

/// A feeder of a seed, by its number.
fn numbered(seed: u64, number: usize) -> Scene {
    let mut draw = Draw(Noise::new(seed));
    (0..=number).map(|_| feeder(&mut draw)).last().unwrap()
}

/// Heavy parts of which one does not fit the lot leave gear while the reference rises. In a start of
/// 16 cycles the largest amplitude is 0.68 of its limit, in four time constants of the envelope 0.54.
#[test]
fn a_rise_waits_for_heavy_parts_on_two_tones() {
    let mut scene = numbered(427_200, 391);
    scene.scatter.extend([0.2]);
    let result = run_fidelities(&scene, 800).unwrap()[0];
    let rises = result.fault == 0 && (0.5..0.6).contains(&result.max_excess);
    assert!(rises, "{result:?}");
}

/// Eight heavy parts on two tones beat with the load over 60 to 80 cycles, until fault 16.
#[test]
fn ready_stays_off_while_heavy_parts_beat() {
    let result = run_fidelities(&numbered(9759, 39), 600).unwrap()[0];
    assert_eq!(result.fault, Fault::AmplitudeOscillates.number());
    assert!(result.swing < MAX_VARIATION[1], "{result:?}");
}

/// A mode at the second tone of 16 times the configured quality swings past the requested tone, or
/// beats with it at other angles. One that cancels the resonance's motion would ring if its tone
/// ended at once. Heavy parts push while the limit halves the tones, unheard, outside the lot, or on
/// tones whose peak is at the limit.
#[test]
fn hard_limits_hold_with_sharp_modes_and_heavy_parts() {
    for (seed, number, cycles) in [
        (71_008, 91, 120),
        (91_001, 12, 160),
        (85_011, 44, 120),
        (81_015, 4, 120),
        (85_003, 9, 600),
        (611_133, 83, 100),
        (620_052, 56, 200),
        (620_057, 69, 500),
    ] {
        let result = run_fidelities(&numbered(seed, number), cycles).unwrap()[0];
        let is_near = (0.88..MAX_EXCESS[1]).contains(&result.max_excess);
        assert!(is_near, "{result:?}");
    }
}

/// Fault 16 opens the bridge. The force ends at once, and a mode at 2.8 times the frequency, as
/// strong as the resonance, rings from its static displacement.
#[test]
fn released_modes_ring_beyond_the_acceleration_limit() {
    let result = run_fidelities(&numbered(417_743, 8), 260).unwrap()[0];
    let rings = result.max_excess < 0.85 && (1.2..1.6).contains(&result.ringing);
    assert!(rings, "{result:?}");
}
