//! A feeder with the drive of a scene, but other springs, track and setpoint.

use kband::feeder::{OutOfRange, Track};
use kband::impact::{
    Friction, FrictionSettings, Tangential, TangentialSettings, Tone, Wave, WaveMap,
};
use kband::regime::gear::{GearLimits, Tones};
use kband::transport::WaveLaw;
use kband_control::{Settings, Shape, Target, drive_limits};
use kband_plant::Scene;

/// A feeder and its setpoint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Feeder {
    /// Drive frequency in Hz.
    pub frequency: f64,
    /// Angle of throw in degrees: between the track and its motion, 90 for a motion normal to it.
    pub throw_angle: f64,
    /// Phase lead of the motion along the track (symbol gamma) in degrees.
    pub phase_lead: f64,
    /// Incline of the track (symbol alpha) in degrees, positive where parts climb.
    pub incline: f64,
    /// k, normal gravity over b w^2.
    pub k: f64,
    /// Amplitude over the first (symbol e) and angle in rad (symbol th) of the upper tones.
    pub tones: [[f64; 2]; 2],
}

impl Feeder {
    pub(super) fn from_settings(settings: &Settings, k: f64, tones: Tones) -> Self {
        let ratio = f64::from(settings.amplitude_ratio);
        Self {
            frequency: settings.frequency.into(),
            throw_angle: ratio.recip().atan().to_degrees(),
            phase_lead: settings.phase_lead.into(),
            incline: settings.incline.into(),
            k,
            tones: tones.map(|tone| tone.map(f64::from)),
        }
    }

    /// Amplitude along the track over that normal to it (symbol eta).
    pub fn amplitude_ratio(&self) -> f64 {
        self.throw_angle.to_radians().tan().recip()
    }

    /// Amplitude normal to the track (symbol b) in mm, at a gravity in m/s^2.
    pub fn amplitude(&self, gravity: f64) -> f64 {
        let angular = std::f64::consts::TAU * self.frequency;
        1e3 * gravity * self.incline.to_radians().cos() / (self.k * angular * angular)
    }

    pub(super) fn target(&self) -> Target {
        let (k, tones) = (self.k as f32, single(self.tones));
        if self.tones[0][0] > 0.0 {
            let shape = Shape::from_tones(tones);
            return Target::Tones { k, shape };
        }
        Target::K(k)
    }

    pub(super) fn wave(&self) -> Result<Wave, OutOfRange> {
        wave(self.tones)
    }

    pub(super) fn law(&self, scene: &Scene) -> Result<WaveLaw, OutOfRange> {
        let track = Settings {
            amplitude_ratio: self.amplitude_ratio() as f32,
            phase_lead: self.phase_lead as f32,
            incline: self.incline as f32,
            ..scene.settings
        };
        law(scene, &self.wave()?, self.k, &track.track()?)
    }
}

pub(super) fn wave(tones: [[f64; 2]; 2]) -> Result<Wave, OutOfRange> {
    let [second, third] = tones.map(|[amplitude, angle]| Tone::new(amplitude, angle));
    Wave::build(second, third)
}

pub(super) fn single(tones: [[f64; 2]; 2]) -> Tones {
    tones.map(|tone| tone.map(|number| number as f32))
}

pub(super) fn law(
    scene: &Scene,
    wave: &Wave,
    k: f64,
    track: &Track,
) -> Result<WaveLaw, OutOfRange> {
    Ok(match scene.friction {
        Some([sliding, sticking]) => {
            let settings = FrictionSettings::on(track, sticking.into(), sliding.into());
            WaveLaw::Friction(Friction::on(wave, k, settings)?)
        }
        None => {
            let tangential = f64::from(scene.settings.tangential_restitution);
            let settings = TangentialSettings::on(track, tangential);
            WaveLaw::Tangential(Tangential::on(wave, k, settings)?)
        }
    })
}

/// The map of parts on a wave; restitution is drawn at each impact.
pub(super) fn map(wave: Wave, k: f64) -> Result<WaveMap, OutOfRange> {
    WaveMap::on(wave, k, 0.5)
}

/// Largest displacement over that normal to the track: the larger half axis of an ellipse.
fn stroke(amplitude_ratio: f64, phase_lead: f64) -> f64 {
    let square = 1.0 + amplitude_ratio * amplitude_ratio;
    let area = 2.0 * amplitude_ratio * phase_lead.to_radians().sin();
    (0.5 * (square + (square * square - area * area).max(0.0).sqrt())).sqrt()
}

/// The scene's settings for a feeder with the same drive: force, quality, swinging mass, and limits
/// of stroke and acceleration along the motion. The ratio of resonance to frequency is constant.
pub(super) fn settings_of(base: &Settings, feeder: &Feeder) -> Settings {
    let factors = factors(base, feeder);
    let mut settings = Settings {
        frequency: feeder.frequency as f32,
        incline: feeder.incline as f32,
        amplitude_ratio: feeder.amplitude_ratio() as f32,
        phase_lead: feeder.phase_lead as f32,
        resonance: base.resonance * factors.frequency,
        gain: base.gain * factors.gain,
        second_gain: base.second_gain * factors.gain,
        third_gain: base.third_gain * factors.gain,
        amplitude_limit: base.amplitude_limit * factors.limit,
        acceleration_limit: base.acceleration_limit * factors.limit,
        second_tone: feeder.tones[0][0] as f32,
        third_tone: feeder.tones[1][0] as f32,
        tracking: base.tracking * factors.frequency,
        // The calibration applies only to the scene's frequency.
        current_gain: 0.0,
        ..*base
    };
    settings.safe_amplitude = (base.safe_amplitude).min(0.5 * settings.largest_safe_amplitude());
    settings
}

struct Factors {
    frequency: f32,
    /// Factor for amplitudes normal to the track at full output, at constant force.
    gain: f32,
    /// Factor for the limits of amplitude and acceleration normal to the track.
    limit: f32,
}

fn factors(base: &Settings, feeder: &Feeder) -> Factors {
    let frequency = feeder.frequency / f64::from(base.frequency);
    let limit = stroke(base.amplitude_ratio.into(), base.phase_lead.into())
        / stroke(feeder.amplitude_ratio(), feeder.phase_lead);
    Factors {
        frequency: frequency as f32,
        gain: (limit / (frequency * frequency)) as f32,
        limit: limit as f32,
    }
}

pub(super) fn scene_of(base: &Scene, feeder: &Feeder) -> Scene {
    let mut scene = base.clone();
    scene.settings = settings_of(&base.settings, feeder);
    scene.target = feeder.target();
    let Factors {
        frequency, gain, ..
    } = factors(&base.settings, feeder);
    let drive = &mut scene.drive;
    drive.resonance *= frequency;
    drive.gain *= gain;
    drive.second_gain *= gain;
    drive.third_gain *= gain;
    drive.current_gain *= gain;
    scene
}

/// The limit of the scene's drive that a feeder reaches within 2 %; `None` if it reaches none.
pub(super) fn limit_reached(base: &Settings, feeder: &Feeder) -> Option<&'static str> {
    let limits = drive_limits(&settings_of(base, feeder));
    let [mut stroke, mut acceleration, mut force] = [GearLimits::NONE; 3];
    stroke.displacement = limits.displacement;
    acceleration.acceleration = limits.acceleration;
    (force.output, force.overtones) = (limits.output, limits.overtones);
    let reached =
        |limits: &GearLimits| feeder.k < 1.02 * f64::from(limits.min_k(single(feeder.tones)));
    let alone = [
        ("stroke", stroke),
        ("acceleration", acceleration),
        ("force", force),
    ];
    let limit = alone.iter().find(|(_, limits)| reached(limits))?;
    Some(limit.0)
}

/// Lowest k within the limits of the scene's drive; infinite if the settings are out of range.
pub(super) fn lowest_k(base: &Settings, feeder: &Feeder) -> f64 {
    let settings = settings_of(base, feeder);
    if settings.check().is_err() {
        return f64::INFINITY;
    }
    drive_limits(&settings).min_k(single(feeder.tones)).into()
}
