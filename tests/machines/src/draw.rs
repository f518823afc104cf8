//! Random machines within the range of the settings, and failing sensors.

use kband::arithmetic::Noise;
use kband_control::{Settings, Target};
use kband_plant::{Change, Disturbance, Scene};

#[derive(Clone, Debug)]
pub struct Draw(Noise);

impl Draw {
    pub fn new(seed: u64) -> Self {
        Self(Noise::new(seed))
    }

    /// A number from 0 to 1.
    pub fn unit(&mut self) -> f32 {
        self.0.uniform()
    }

    /// Uniform from `low` to `high`.
    pub fn between(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.unit()
    }

    /// Uniform in the logarithm from `low` to `high`.
    pub fn scale(&mut self, low: f32, high: f32) -> f32 {
        low * (high / low).powf(self.unit())
    }

    pub fn below(&mut self, limit: u32) -> u32 {
        self.0.bits() % limit
    }
}

/// A machine at its resonance: 5 to 500 Hz, quality 5 to 200, gain 0.3 to 5 mm. Its limits are
/// within reach of the drive, and its sensor has a suitable range.
pub fn machine(draw: &mut Draw) -> Scene {
    let mut scene = Scene::default();
    scene.parts.clear();
    let settings = &mut scene.settings;
    settings.frequency = draw.scale(5.0, 500.0);
    settings.resonance = settings.frequency;
    settings.quality = draw.scale(5.0, 200.0);
    settings.gain = draw.scale(0.3, 5.0);
    settings.amplitude_limit = settings.gain * draw.scale(0.05, 0.9);
    settings.soft_start = draw.scale(0.05, 1.0);
    let limit = ceiling(settings);
    settings.safe_amplitude = 0.05_f32.min(0.5e3 * limit);
    let acceleration = limit * square(settings);
    settings.sensitivity = (1.65 * 9.8 / (1.7 * acceleration)).clamp(0.001, 10.0);
    scene.drive.resonance = settings.frequency;
    scene.drive.quality = settings.quality;
    scene.drive.gain = settings.gain;
    // Two counts of the converter.
    scene.sensor.noise = 2.0 * 3.3 / 4096.0 / settings.sensitivity * 9.8;
    scene.seed = draw.0.bits().into();
    settings.check().expect("they fit each other");
    scene
}

/// Squared angular frequency, 1/s^2.
pub fn square(settings: &Settings) -> f32 {
    (core::f32::consts::TAU * settings.frequency).powi(2)
}

/// Hard limits as an amplitude, m.
pub fn ceiling(settings: &Settings) -> f32 {
    (settings.amplitude_limit * 1e-3).min(settings.acceleration_limit / square(settings))
}

/// Time until the machine is at its setpoint, s: the start, eight time constants of its envelope
/// and 60 cycles.
pub fn settled(settings: &Settings) -> f64 {
    let envelope = settings.quality / (core::f32::consts::PI * settings.frequency);
    f64::from(settings.soft_start + 8.0 * envelope + 60.0 / settings.frequency)
}

/// A [`machine`] whose sensor fails at a random time after its start: it is lost, weak, inverted,
/// bouncing, fading, or briefly lost and weak. Also returns the time from the start in s at which
/// the machine is at its setpoint.
pub fn failure(draw: &mut Draw) -> (Scene, f64) {
    let mut scene = machine(draw);
    let limit = ceiling(&scene.settings);
    let share = draw.between(0.1, 1.0);
    scene.target = Target::Amplitude(share * 1e3 * limit);
    let ready = settled(&scene.settings);
    let at = f64::from(draw.unit()) * 1.5 * ready;
    let kind = draw.below(6);
    let low = draw.unit() * draw.unit();
    let steps = |pace: f64, share: &dyn Fn(i32) -> f32| {
        let step = |n| (at + f64::from(n) * pace, Change::Sensitivity(share(n)));
        (0..32).map(step).collect()
    };
    let changes = match kind {
        0 => vec![(at, Change::SensorLost(true))],
        1 => vec![(at, Change::Sensitivity(low))],
        2 => vec![(at, Change::SensorInverted(true))],
        // Each change follows after 0.5 to 20 cycles.
        3 => {
            let period = f64::from(draw.scale(0.5, 20.0) / scene.settings.frequency);
            steps(period, &|n| if n % 2 == 0 { low } else { 1.0 })
        }
        4 => steps(ready / 16.0, &|n| 1.0 - (1.0 - low) * n as f32 / 31.0),
        _ => vec![
            (at, Change::SensorLost(true)),
            (at + 0.05, Change::SensorLost(false)),
            (at + 0.06, Change::Sensitivity(low)),
        ],
    };
    let changes = changes.into_iter();
    scene
        .disturbances
        .extend(changes.map(|(at, change)| Disturbance { at, change }));
    (scene, ready)
}
