//! `kband settings commission --sensor`: settings for the start-up tests of the accelerometer. It
//! averages the voltage at rest (V), and the ratio of measured to configured gain in motion.

use std::time::Duration;

use kband::feeder::STANDARD_GRAVITY;
use kband_control::wire::{Request, Status, Telemetry};
use kband_control::{Settings, State, Target};

use super::offer::{Commissioning, gather, rest, why_off};
use crate::board::Link;
use crate::desk::Desk;
use crate::refusal::{Refusal, Result};
use crate::report::{Column, Field, View, when};

/// Number of averaged measurements at rest, and time between two of them.
const REST_READINGS: u32 = 20;
const READING_INTERVAL: Duration = Duration::from_millis(50);
/// Number of cycles in an average while the drive runs, and number of averages.
const BLOCK_CYCLES: usize = 16;
const BLOCKS: usize = 8;
/// Largest relative deviation of a steady amplitude from its setpoint.
const MAX_STEADY_DEVIATION: f32 = 0.1;
/// k at which the track throws no part, and largest amplitude over the hard limits.
const QUIET_K: f32 = 1.3;
const QUIET_SHARE: f32 = 0.2;
/// Factor for later changes: 5 % of the sensitivity, a quarter of the gain of a loaded drive.
const TOLERANCE_MARGIN: f64 = 1.3;
/// Relative deviation of the measured gain above which the user should check the sensor.
const MAX_GAIN_DEVIATION: f64 = 0.1;

/// Measured gain over the configured one: mean, smallest and largest of its blocks.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Ratio {
    mean: f64,
    min_ratio: f64,
    largest: f64,
}

impl Ratio {
    /// Largest factor between a block's gain and `gain`, both over the configured one.
    fn factor(&self, gain: f64) -> f64 {
        (self.largest / gain).max(gain / self.min_ratio)
    }
}

/// k at which no part is thrown and the amplitude is at most 0.2 of the hard limits.
fn quiet_k(settings: &Settings) -> f32 {
    let square = (std::f32::consts::TAU * settings.frequency).powi(2);
    let highest = (1e-3 * settings.amplitude_limit * square).min(settings.acceleration_limit);
    let gravity = settings.gravity * settings.incline.to_radians().cos();
    QUIET_K.max(gravity / (QUIET_SHARE * highest))
}

/// Track amplitude at the drive's frequency over that at resonance, by the settings.
fn response(settings: &Settings) -> f64 {
    if settings.tracking > 0.0 {
        return 1.0;
    }
    let x = f64::from(settings.frequency / settings.resonance);
    let quality = f64::from(settings.quality);
    1.0 / (quality * (1.0 - x * x).hypot(x / quality))
}

/// The ratio over the last steady cycles; `None` for too few.
fn ratio(settings: &Settings, cycles: &[Telemetry]) -> Option<Ratio> {
    let last = cycles.get(cycles.len().checked_sub(BLOCK_CYCLES * BLOCKS)?..)?;
    let sum = |block: &[Telemetry], value: fn(&Telemetry) -> f32| -> f64 {
        block.iter().map(|cycle| f64::from(value(cycle))).sum()
    };
    // Track amplitude in m for full output at the drive's frequency, by the settings.
    let strength = f64::from(settings.gain) * 1e-3 * response(settings);
    let average = |block: &[Telemetry]| {
        sum(block, |cycle| cycle.amplitude) / (strength * sum(block, |cycle| cycle.output))
    };
    let blocks = || last.chunks(BLOCK_CYCLES).map(average);
    Some(Ratio {
        mean: average(last),
        min_ratio: blocks().fold(f64::INFINITY, f64::min),
        largest: blocks().fold(0.0, f64::max),
    })
}

/// Whether the amplitude is at its setpoint, without a limit.
fn is_steady(cycle: &Telemetry) -> bool {
    let settled = [State::Holding, State::Locked].map(State::number);
    settled.contains(&cycle.state)
        && cycle.limits == 0
        && (cycle.amplitude - cycle.setpoint).abs() < MAX_STEADY_DEVIATION * cycle.setpoint
}

/// Keys of the proposed settings, with unit and digits.
const PROPOSED_SETTINGS: [Column; 5] = [
    Column::new("sensor_rest", "V").digits(5),
    Column::new("gain", "mm").digits(4),
    Column::new("gain_tolerance", "").digits(3),
    Column::new("load_tolerance", "").digits(3),
    Column::new("current_gain", "mm/A").digits(4),
];

/// Measures the accelerometer at rest and in motion; proposes settings for the start-up tests.
pub(super) fn run(commissioning: &Commissioning<'_>) -> Result<()> {
    let (mut link, settings) = commissioning.open()?;
    let (within, desk) = (commissioning.within, commissioning.desk);
    let configured = settings.configured();
    if let Some(off) = why_off(&mut link)? {
        return Err(off);
    }
    let target = link.target()?;
    if target == Target::Amplitude(0.0) {
        let cause = "the board's target is an amplitude of 0 mm, at which nothing can be measured";
        let next = "request the working target first, for example kband target gear 1 --save";
        return Err(Refusal::new(cause, next));
    }
    rest(&mut link)?;
    let mean = average(&mut link, desk, |status| status.mean);
    // The board returns to its previous state with or without a result.
    link.command(&Request::Enable(true))?;
    let mean = mean?;
    link.command(&Request::Target(Target::K(quiet_k(&configured))))?;
    let quiet = measure(&mut link, &configured, within, desk);
    link.command(&Request::Target(target))?;
    let (quiet, quiet_per_ampere) = quiet?;
    let (loaded, loaded_per_ampere) = measure(&mut link, &configured, within, desk)?;
    let digits = |value: f64, scale: f64| ((value * scale).round() / scale) as f32;
    let measured = mean / STANDARD_GRAVITY;
    let volts = f64::from(configured.sensor_zero) + measured * f64::from(configured.sensitivity);
    let voltage = digits(volts, 1e4);
    let gain = digits(f64::from(configured.gain) * quiet.mean, 1e4);
    let wired = configured.current_sensitivity > 0.0;
    let change = loaded_per_ampere / quiet_per_ampere;
    let by_current = if wired { change.max(1.0 / change) } else { 1.0 };
    let tolerance = |factor: f64| digits((TOLERANCE_MARGIN * factor).min(2.5), 100.0);
    let swing = tolerance(quiet.factor(quiet.mean));
    let run = tolerance(loaded.factor(quiet.mean).max(by_current));
    let per_ampere = 1e3 * quiet_per_ampere / response(&configured);
    let current_gain = when(wired, || digits(per_ampere, 1e5));
    let values = [voltage, gain, swing, run, current_gain];
    let pairs = PROPOSED_SETTINGS.map(|column| column.name);
    let pairs: Vec<_> = pairs.into_iter().zip(values).collect();
    let assigned = pairs.iter().map(|(key, value)| format!("{key} = {value}"));
    let assigned: Vec<_> = assigned.collect();
    let mut notes = vec![
        format!("proposed: {}", assigned.join(", ")),
        format!(
            "at rest the sensor measures {measured:.2} g, with sensor_zero and sensitivity; expected: {:.2} if its axis is normal to the track, 0 if the sensor passes no direct voltage",
            f64::from(configured.incline).to_radians().cos()
        ),
    ];
    if (quiet.mean - 1.0).abs() > MAX_GAIN_DEVIATION {
        notes.push(format!(
            "the track moves {:.2} times as far as gain says: check sensitivity by tilting the track before you set this",
            quiet.mean
        ));
    }
    let field = |n: usize| {
        Field::all(PROPOSED_SETTINGS[n], move |values: &[f32; 5]| {
            f64::from(values[n])
        })
    };
    let view = View::from_fields((0..PROPOSED_SETTINGS.len()).map(field).collect());
    commissioning.conclude((link, settings), &pairs, notes, view, values)
}

/// Mean of a measured quantity of the board's status over 1 s.
fn average(link: &mut Link, desk: &Desk, value: fn(&Status) -> f32) -> Result<f64> {
    let mut sum = 0.0;
    for _ in 0..REST_READINGS {
        desk.check_stop()?;
        let status = link.status()?.ok_or_else(|| {
            let cause = "the board does not send its status";
            Refusal::new(cause, "kband flash writes the firmware of this desk")
        })?;
        sum += f64::from(value(&status));
        link.listen(READING_INTERVAL)?;
    }
    Ok(sum / f64::from(REST_READINGS))
}

/// The gain ratio at the board's target, and the amplitude in m per ampere.
fn measure(
    link: &mut Link,
    configured: &Settings,
    within: Duration,
    desk: &Desk,
) -> Result<(Ratio, f64)> {
    let required = BLOCK_CYCLES * BLOCKS;
    // The last steady cycles in sequence.
    let take = |cycles: &mut Vec<Telemetry>, cycle: Telemetry| {
        if is_steady(&cycle) {
            cycles.push(cycle);
        } else {
            cycles.clear();
        }
    };
    let enough = |cycles: &[Telemetry]| cycles.len() >= required;
    let progress = ("steady cycles", required);
    let cycles = gather(link, desk, progress, within, take, enough);
    link.command(&Request::Telemetry(0))?;
    let cycles = cycles?;
    let ratio = ratio(configured, &cycles).ok_or_else(|| {
        let cause = format!("the drive did not hold its amplitude for {required} cycles");
        Refusal::new(cause, "kband monitor shows the limit; raise --within S")
    })?;
    let amplitudes = cycles.iter().map(|cycle| f64::from(cycle.amplitude));
    let amplitude = amplitudes.sum::<f64>() / cycles.len() as f64;
    let current = average(link, desk, |status| status.current)?;
    if configured.current_sensitivity > 0.0 && current <= 0.0 {
        let cause = "the current sensor measures no current of a running drive";
        let next = "check its wire; without one set current_sensitivity to 0";
        return Err(Refusal::new(cause, next));
    }
    Ok((ratio, amplitude / current))
}

#[cfg(test)]
mod tests {
    use kband_control::Target;
    use kband_plant::{EnvelopeLoop, Scene};

    use super::*;

    #[test]
    fn the_gain_is_measured_at_the_resonance_and_beside_it() {
        for (resonance, gain) in [(50.0, 1.0), (50.0, 0.7), (50.0, 1.4), (48.5, 1.2)] {
            let mut scene = Scene {
                target: Target::Amplitude(0.2),
                ..Scene::default()
            };
            scene.parts.clear();
            scene.settings.resonance = resonance;
            (scene.drive.resonance, scene.drive.gain) = (resonance, gain);
            let mut closed = EnvelopeLoop::build(&scene).unwrap();
            let cycles = (0..600).map(|_| Telemetry::from(&closed.cycle().report));
            let cycles: Vec<Telemetry> = cycles.filter(is_steady).collect();
            let result = ratio(&scene.settings, &cycles).unwrap();
            let deviation = (result.mean / f64::from(gain) - 1.0).abs();
            assert!(deviation < 0.02, "{result:?}");
            assert!(result.factor(result.mean) < 1.02, "{result:?}");
            let few = &cycles[..BLOCK_CYCLES * BLOCKS - 1];
            assert_eq!(ratio(&scene.settings, few), None);
        }
    }
}
