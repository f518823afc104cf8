//! Tests: the amplitude loop settles at its setpoint over the whole range of the settings.
//!
//! The machines have no parts. `kband margins` prints the stability margins of the same loop.

use super::fidelity::unwatched;
use kband_control::{State, Target};
use kband_plant::Scene;

#[derive(Clone, Copy, Debug)]
struct Start {
    peak: f32,
    /// Settling time to 5 % from the reference's arrival, in time constants, less eight cycles.
    settles: f32,
    swing: f32,
    state: State,
}

/// A machine detuned by a share, with its gain over the configured one and limit over setpoint.
fn machine([frequency, quality, detuned, gain_error, limit, share]: [f32; 6]) -> (Scene, f32) {
    let mut scene = Scene::default();
    scene.parts.clear();
    let settings = &mut scene.settings;
    settings.frequency = frequency;
    settings.quality = quality;
    settings.resonance = frequency / (1.0 + detuned);
    let x = 1.0 + detuned;
    let response = 1.0 / (quality * ((1.0 - x * x).powi(2) + (x / quality).powi(2)).sqrt());
    let square = (std::f32::consts::TAU * frequency).powi(2);
    // 40 m/s^2 if the drive can, limited to a share of the output at the configured gain.
    let requested = (1e3 * 40.0 / square).min(40.0 * share * response);
    settings.gain = (requested / share / response).clamp(0.001, 100.0);
    let requested = share * settings.gain * response;
    settings.amplitude_limit = (limit * requested).clamp(0.001, 100.0);
    settings.acceleration_limit = 1000.0;
    settings.safe_amplitude = 0.1 * requested.min(settings.amplitude_limit);
    scene.drive.resonance = settings.resonance;
    scene.drive.quality = quality;
    scene.drive.gain = gain_error * settings.gain;
    // Half of the converter's range.
    settings.sensitivity =
        (0.8 * 9.8 / (1e-3 * requested * gain_error * square)).clamp(0.001, 10.0);
    scene.sensor.noise = 1e-3 / settings.sensitivity;
    scene.target = Target::Amplitude(requested);
    (scene, requested * 1e-3)
}

fn start(scene: &Scene, requested: f32) -> Start {
    let settings = &scene.settings;
    let cycles = settings.quality / std::f32::consts::PI * settings.frequency / settings.resonance;
    let mut looped = unwatched(scene);
    let (mut arrived, mut last) = (None, 0);
    let (mut peak, mut outside) = (0.0_f32, 0);
    for n in 1.. {
        let report = looped.cycle().report;
        if arrived.is_none() && report.reference >= 0.999 * requested {
            arrived = Some(n);
            last = n + (12.0 * cycles) as i32 + 60;
        }
        peak = peak.max(report.amplitude / requested);
        if (report.amplitude / requested - 1.0).abs() > 0.05 {
            outside = n;
        }
        if arrived.is_some() && n >= last || n > 4000 {
            break;
        }
    }
    let (mut low, mut high) = (f32::INFINITY, 0.0_f32);
    let mut state = State::Off;
    for _ in 0..60 {
        let report = looped.cycle().report;
        low = low.min(report.amplitude);
        high = high.max(report.amplitude);
        state = report.state;
    }
    let arrived = arrived.unwrap_or(4000);
    Start {
        peak,
        settles: (outside - arrived - 8) as f32 / cycles,
        swing: (high - low) / requested,
        state,
    }
}

const QUALITIES: [f32; 7] = [3.0, 5.0, 10.0, 25.0, 50.0, 100.0, 200.0];
const DETUNINGS: [f32; 17] = [
    0.0, 0.001, 0.002, 0.005, 0.01, 0.02, 0.03, 0.06, 0.1, 0.2, -0.002, -0.006, -0.015, -0.03,
    -0.06, -0.1, -0.2,
];
/// True gain over the configured one.
const GAIN_ERRORS: [f32; 3] = [1.0, 0.5, 2.0];

fn drives() -> impl Iterator<Item = (f32, f32, f32)> {
    let pairs = (QUALITIES.into_iter()).flat_map(|quality| DETUNINGS.map(|off| (quality, off)));
    pairs.flat_map(|(quality, off)| GAIN_ERRORS.map(|error| (quality, off, error)))
}

#[test]
fn every_drive_comes_to_its_amplitude_and_stays() {
    for (frequency, soft, share) in [
        (6.2, 0.4, 0.4),
        (50.0, 0.02, 0.4),
        (50.0, 0.4, 0.1),
        (400.0, 0.05, 0.4),
        (400.0, 0.2, 0.05),
    ] {
        for (quality, detuned, gain_error) in drives() {
            let (mut scene, requested) =
                machine([frequency, quality, detuned, gain_error, 2.0, share]);
            scene.settings.soft_start = soft;
            let result = start(&scene, requested);
            let drive = format!("{frequency} Hz, Q {quality}, {detuned}, gain {gain_error}");
            let case = format!("{drive}, {soft} s, {share}: {result:?}");
            assert_eq!(result.state, State::Holding, "{case}");
            assert!(result.peak < 1.03 && result.settles < 3.0, "{case}");
            assert!(result.swing < 0.005, "{case}");
        }
    }
}

/// The setpoint at the hard limit, and beyond it.
#[test]
fn no_start_goes_over_the_hard_limit_by_more_than_a_fiftieth() {
    for soft in [0.4, 0.02] {
        for (quality, detuned, gain_error) in drives() {
            let (mut scene, requested) = machine([50.0, quality, detuned, gain_error, 1.0, 0.4]);
            scene.settings.soft_start = soft;
            let result = start(&scene, requested);
            let case = format!("Q {quality}, {detuned}, gain {gain_error}, {soft} s: {result:?}");
            assert!(result.peak < 1.02, "{case}");
        }
    }
}

/// The drive's frequency is the configured resonance, while the true one differs. The amplitude is
/// held if the response is at least half the configured one; else the output saturates or faults.
#[test]
fn wrong_resonance_is_held_or_reported() {
    for quality in QUALITIES {
        for widths in [0.5, 1.0, 1.5, 1.7, 2.2, 4.0] {
            for side in [-1.0, 1.0] {
                let (mut scene, requested) = machine([50.0, quality, 0.0, 1.0, 2.0, 0.2]);
                scene.drive.resonance = 50.0 / (1.0 + side * widths / (2.0 * quality));
                let result = start(&scene, requested);
                let case = format!("Q {quality}, {widths} half widths, {side}: {result:?}");
                assert!(result.peak < 1.05 && result.swing < 0.005, "{case}");
                match result.state {
                    State::Holding => assert!(result.settles < 3.0, "{case}"),
                    State::Limiting | State::Fault => assert!(widths > 1.7, "{case}"),
                    _ => panic!("{case}"),
                }
            }
        }
    }
}
