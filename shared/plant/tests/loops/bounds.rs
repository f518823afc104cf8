//! The measured amplitude of drawn machines keeps every limit: a walk through accepted settings.

use super::fidelity::{Loop, changes, drive_of, unwatched};
use super::lots::number;
use core::f32::consts::{PI, TAU};
use kband::arithmetic::Noise;
use kband_control::{SAMPLE_RATE, Settings, Target};
use kband_plant::{Change, EnvelopeLoop, Scene};

/// Largest steady amplitude over the smallest of setpoint, hard limits and safe amplitude.
const MAX_EXCESS: f32 = 1.05;

/// A walk through the accepted settings: each step draws some keys and keeps the accepted values.
struct Walk {
    noise: Noise,
    settings: Settings,
}

impl Walk {
    /// A number from `low` to 1, uniform on a logarithmic scale.
    fn ratio(&mut self, low: f32) -> f32 {
        libm::powf(low, self.noise.uniform())
    }

    fn step(&mut self, keys: u32) -> Settings {
        for _ in 0..keys {
            let key = &Settings::KEYS[self.noise.bits() as usize % Settings::KEYS.len()];
            let share = match self.noise.bits() % 8 {
                0 => 0.0,
                1 => 1.0,
                2..5 => self.noise.uniform(),
                _ => self.ratio(1e-5),
            };
            let mut next = self.settings;
            let value = key.low + share * (key.high - key.low);
            if next.set(key.name, value).is_ok() && next.check().is_ok() {
                self.settings = next;
            }
        }
        self.settings
    }
}

/// Amplitude in m at full output and a frequency in Hz: a resonance of the configured quality.
fn strength(settings: &Settings, frequency: f32) -> f32 {
    let x = frequency / settings.resonance;
    let (detuned, width) = (1.0 - x * x, x / settings.quality);
    let response = 1.0 / (settings.quality * (detuned * detuned + width * width).sqrt());
    1e-3 * settings.gain * response
}

/// Machines whose sensor has the configured sensitivity or less; a board knows no other amplitude.
#[test]
fn the_measured_amplitude_of_any_machine_keeps_every_limit() {
    const MEAN: usize = 100;
    let mut walk = Walk {
        noise: Noise::new(number("KBAND_SEED", 32)),
        settings: Settings::default(),
    };
    let (mut written, mut moving) = (0, 0);
    while written < 2000 {
        let mut scene = Scene::default();
        scene.parts.clear();
        let mut settings = walk.step(200);
        let cycles = settings.quality / PI * settings.frequency / settings.resonance;
        settings.tracking = 0.0;
        // The upper modes (Q 25) supply the response that the resonance lacks, and move the track
        // at the drive's frequency too: each by at most 1 %, and 0.4 of what the resonance adds in
        // a cycle. With 0.64 of it a loop cycled in period 4, without READY.
        let strength = |harmonic: f32| strength(&settings, harmonic * settings.frequency);
        let limit = 1e3 * ((0.4 / cycles).min(0.01) * 0.75 * 25.0 * strength(1.0));
        let upper =
            |harmonic: f32, gain: f32| gain.min((limit - 1e3 * strength(harmonic)).max(0.0));
        let second = upper(2.0, settings.second_gain);
        let third = upper(3.0, settings.third_gain);
        let strength = strength(1.0);
        (settings.second_gain, settings.third_gain) = (second, third);
        // With a larger lag the mode is far below: its response at the drive's frequency is large too.
        for lag in [&mut settings.second_lag, &mut settings.third_lag] {
            *lag = lag.clamp(-170.0, 170.0);
        }
        let soft = 40.0 / settings.frequency;
        (settings.soft_start, settings.soft_stop) = (soft, soft);
        settings.link_timeout = soft;
        let link_lost = written % 2 == 0;
        let angular = TAU * settings.frequency;
        let accelerated = settings.acceleration_limit / (angular * angular);
        let ceiling = (1e-3 * settings.amplitude_limit).min(accelerated);
        let setpoint = walk.ratio(1e-3) * settings.output_maximum * strength;
        let safe = 1e-3 * settings.safe_amplitude;
        let safe = if link_lost { safe } else { f32::INFINITY };
        let expected = setpoint.min(ceiling).min(safe);
        // The largest amplitude uses a third of the converter's range.
        let sensor = Settings::default();
        settings.sensor_zero = sensor.sensor_zero;
        // Not commissioned: otherwise the tests of the sensor would stop a drive with a weak one.
        settings.sensor_rest = sensor.sensor_rest;
        settings.gain_tolerance = sensor.gain_tolerance;
        settings.load_tolerance = sensor.load_tolerance;
        settings.current_gain = sensor.current_gain;
        settings.converter_reference = sensor.converter_reference;
        settings.converter_bits = sensor.converter_bits;
        let largest = setpoint.min(ceiling) * angular * angular / 9.8;
        settings.sensitivity = 0.3 * sensor.sensor_zero / largest;
        // The smallest detectable swing is 8 steps of the converter.
        let steps = libm::exp2f(settings.converter_bits);
        let noise_floor = 8.0 * 9.80665 * settings.converter_reference
            / (steps * settings.sensitivity * angular * angular);
        // The steps of the held output accelerate a stiff drive. Before each step the reading is
        // wrong by this share of the amplitude's acceleration. The loop corrects a factor of 4.
        let lag = PI * settings.resonance * settings.resonance
            / (settings.frequency * SAMPLE_RATE as f32);
        // A beat or a decay longer than the run gives no steady amplitude.
        if lag > 1.0 || cycles > 80.0 || setpoint > 1e-3 * 100.0 || settings.check().is_err() {
            continue;
        }
        scene.settings = settings;
        scene.drive = drive_of(&settings);
        scene.sensor.noise = 0.0;
        scene.sensor.sensitivity = [1.0, 0.8, 0.6][walk.noise.bits() as usize % 3];
        scene.target = Target::Amplitude(1e3 * setpoint);
        if link_lost {
            let at = 10.0 / f64::from(settings.frequency);
            scene.disturbances = changes([(at, Change::Link(false))]);
        }
        if EnvelopeLoop::build(&scene).is_err() {
            continue;
        }
        let mut looped = unwatched(&scene);
        written += 1;
        // Soft start, loss of the link and ten time constants, then the mean.
        let settling = 100 + (10.0 * cycles) as usize;
        let amplitudes = (0..settling + MEAN).map(|_| looped.cycle().report.amplitude);
        let last = amplitudes.skip(settling);
        let mean = last.fold(0.0, |sum, amplitude| sum + amplitude / MEAN as f32);
        let within = mean <= MAX_EXCESS * expected + noise_floor;
        let report = looped.moment().report;
        assert!(within, "{mean} of {expected} m: {report:?}: {scene:?}");
        if mean > 0.5 * expected && expected > noise_floor {
            moving += 1;
        }
    }
    assert!(moving > 600, "{moving} of {written}");
}

/// The drive is twice as strong as configured: the first output of the search would reach 1.6 times
/// the limit at the resonance.
#[test]
fn a_resonance_search_keeps_the_amplitude_limit() {
    let mut scene = Scene::default();
    scene.settings.tracking = 2.0;
    (
        scene.settings.safe_amplitude,
        scene.settings.amplitude_limit,
    ) = (0.2, 0.25);
    scene.target = Target::Amplitude(0.2);
    scene.drive.gain = 2.0 * scene.settings.gain;
    let limit = 1e-3 * scene.settings.amplitude_limit;
    for mut looped in Loop::both(&scene) {
        for _ in 0..600 {
            let report = looped.cycle().0.report;
            assert!(report.reference <= limit, "{report:?}");
            assert!(report.amplitude < 1.02 * limit, "{report:?}");
        }
        let report = looped.cycle().0.report;
        assert!((report.frequency - 50.0).abs() < 0.2, "{report:?}");
        assert!((report.amplitude - 0.2e-3).abs() < 4e-6, "{report:?}");
    }
}
