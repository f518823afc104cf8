//! `kband settings commission --second-tone`, `--third-tone`: gain (mm at full output) and lag
//! (degrees) of the track at twice or three times the drive's frequency.

use std::time::Duration;

use num_complex::Complex64 as Complex;

use kband_control::wire::{Request, Telemetry};
use kband_control::{Shape, Target, UpperTone};

use super::offer::{Commissioning, gather, why_off};
use crate::board::Link;
use crate::desk::Desk;
use crate::refusal::{Refusal, Result};
use crate::report::{Column, Field, View, columns};

/// k of the trial: the track throws no part.
const TRIAL_K: f32 = 1.3;
/// Amplitude of the trial's tones over the first, as far as the drive affords it.
const TRIAL_RATIO: f32 = 0.05;
/// Phases of the second and third tone in rad, near the best ones of the map.
const TRIAL_PHASES: [f32; 2] = [2.356, 5.3];
const AVERAGED_CYCLES: usize = 50;
/// Delay from an output to its measurement, in cycles.
const OUTPUT_DELAY: usize = 2;
/// Number of cycles after which a tone has settled or was abandoned.
const SETTLING_CYCLES: usize = 300;

/// Name of each upper tone, setting of its largest amplitude, and largest amplitude to begin with.
const TONES: [(&str, &str, f64); 2] = [
    ("second tone", "second_tone", 0.15),
    ("third tone", "third_tone", 0.05),
];
/// Settings of the track's response to each upper tone.
const RESPONSES: [[&str; 2]; 2] = [["second_gain", "second_lag"], ["third_gain", "third_lag"]];

/// Tone `upper` of the track in a cycle, 0 or 1, relative to the output's phase, in m.
fn tone(upper: usize, telemetry: &Telemetry) -> Complex {
    let tone = telemetry.shape.tones()[upper];
    let times = 2.0 + upper as f64;
    let size = f64::from(telemetry.amplitude) * f64::from(tone.ratio);
    let angle = f64::from(tone.phase) + times * f64::from(telemetry.lead);
    Complex::new(angle.cos(), angle.sin()) * size
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Answer {
    /// Track amplitude for full output, mm.
    gain: f64,
    lag: f64,
    /// Standard deviation of the response over cycles, relative to the response.
    scatter: f64,
}

/// Response in the last cycles with the tone; `None` for too few.
fn answer(upper: usize, cycles: &[Telemetry]) -> Option<Answer> {
    let pairs = cycles.windows(OUTPUT_DELAY + 1).filter_map(|window| {
        let (early, late) = (window.first()?, window.last()?);
        let [cosine, sine] = early.overtones[upper].map(f64::from);
        let output = Complex::new(cosine, sine);
        (output.norm_sqr() > 1e-6).then_some((output, tone(upper, late)))
    });
    let pairs: Vec<(Complex, Complex)> = pairs.collect();
    let last = pairs.get(pairs.len().checked_sub(AVERAGED_CYCLES)?..)?;
    let square: f64 = last.iter().map(|(output, _)| output.norm_sqr()).sum();
    let product: Complex = last.iter().map(|(output, tone)| tone * output.conj()).sum();
    let answer = product / square;
    let size = answer.norm_sqr().sqrt();
    let residual = |(output, tone): &(Complex, Complex)| (tone - answer * output).norm_sqr();
    let residual: f64 = last.iter().map(residual).sum();
    Some(Answer {
        gain: size * 1e3,
        lag: -answer.im.atan2(answer.re).to_degrees(),
        scatter: (residual / square).sqrt() / size,
    })
}

/// Makes the board drive a small upper tone, measures the response and proposes its settings.
pub(super) fn run(upper: usize, commissioning: &Commissioning<'_>) -> Result<()> {
    let (mut link, settings) = commissioning.open()?;
    let (name, key, first) = TONES[upper];
    let configured = settings.configured();
    let max_ratios = [configured.second_tone, configured.third_tone];
    if max_ratios[upper] <= 0.0 {
        let largest = format!("set the largest {name} that the drive affords first");
        let next = format!("{largest}: kband settings set {key} {first} --save");
        return Err(Refusal::value(key, "0", "0.01..0.5", next));
    }
    let trial = |n: usize| UpperTone::new(TRIAL_RATIO.min(max_ratios[n]), TRIAL_PHASES[n]);
    let third = [UpperTone::default(), trial(1)][upper];
    let shape = Shape::new(trial(0), third);
    let target = link.target()?;
    link.command(&Request::Target(Target::Tones { k: TRIAL_K, shape }))?;
    let cycles = follow(upper, &mut link, commissioning.within, commissioning.desk);
    link.command(&Request::Telemetry(0))?;
    link.command(&Request::Target(target))?;
    let Some(answer) = answer(upper, &cycles?) else {
        let cause = format!("no {name} was made for {AVERAGED_CYCLES} cycles");
        let next = "kband monitor shows the limit; raise --within S";
        return Err(Refusal::new(cause, next));
    };
    let digits = |value: f64, scale: f64| ((value * scale).round() / scale) as f32;
    let (gain, lag) = (digits(answer.gain, 1e4), digits(answer.lag, 10.0));
    let [of_gain, of_lag] = RESPONSES[upper];
    let offer = [(of_gain, gain), (of_lag, lag)];
    let notes = vec![
        format!("proposed: {of_gain} = {gain}, {of_lag} = {lag}"),
        "repeat the measurement with these values: the result is then more accurate".into(),
    ];
    let gain = Column::new(of_gain, "mm").digits(4);
    let lag = Column::new(of_lag, "degrees").digits(4);
    let scatter = columns::GAIN_SCATTER.titled("scatter").digits(2);
    let view = View::from_fields(vec![
        Field::all(gain, |answer: &Answer| answer.gain),
        Field::all(lag, |answer: &Answer| answer.lag),
        Field::all(scatter, |answer: &Answer| answer.scatter),
    ]);
    commissioning.conclude((link, settings), &offer, notes, view, answer)
}

/// Collects cycles until the tone has settled or was abandoned.
fn follow(upper: usize, link: &mut Link, within: Duration, desk: &Desk) -> Result<Vec<Telemetry>> {
    if let Some(off) = why_off(link)? {
        return Err(off);
    }
    let made = |cycle: &&Telemetry| cycle.overtones[upper] != [0.0; 2];
    let enough = |cycles: &[Telemetry]| {
        let count = cycles.iter().filter(made).count();
        // An abandoned tone does not return.
        let silent = cycles.iter().rev().take_while(|cycle| !made(cycle)).count();
        count >= SETTLING_CYCLES || (count >= AVERAGED_CYCLES && silent > AVERAGED_CYCLES)
    };
    let progress = (TONES[upper].0, SETTLING_CYCLES);
    gather(link, desk, progress, within, Vec::push, enough)
}

#[cfg(test)]
mod tests {
    use kband_plant::{EnvelopeLoop, Scene};

    use super::*;

    #[test]
    fn the_drive_response_is_measured_despite_wrong_settings() {
        let [second, third] = TRIAL_PHASES.map(|phase| UpperTone::new(TRIAL_RATIO, phase));
        for (upper, gain, lag, configured, exact) in [
            (0, 0.5, 60.0, (0.5, 60.0), 0.02),
            (0, 0.3, 120.0, (0.5, 90.0), 0.02),
            (0, 0.05, 170.0, (0.5, 90.0), 0.15),
            (1, 0.25, 60.0, (0.25, 60.0), 0.02),
            (1, 0.2, 120.0, (0.25, 90.0), 0.02),
        ] {
            let k = TRIAL_K;
            let shape = [Shape::of_two(second), Shape { second, third }][upper];
            let mut scene = Scene {
                target: Target::Tones { k, shape },
                ..Scene::default()
            };
            let (settings, drive) = (&mut scene.settings, &mut scene.drive);
            settings.second_tone = 0.15;
            if upper == 0 {
                (settings.second_gain, settings.second_lag) = configured;
                (drive.second_gain, drive.second_lag) = (gain, lag);
            } else {
                settings.third_tone = 0.06;
                (settings.third_gain, settings.third_lag) = configured;
                (drive.second_gain, drive.second_lag) = (settings.second_gain, settings.second_lag);
                (drive.third_gain, drive.third_lag) = (gain, lag);
            }
            let mut closed = EnvelopeLoop::build(&scene).unwrap();
            let cycles = (0..SETTLING_CYCLES).map(|_| Telemetry::from(&closed.cycle().report));
            let cycles: Vec<Telemetry> = cycles.collect();
            let answer = answer(upper, &cycles).unwrap();
            let gain_deviation = (answer.gain / f64::from(gain) - 1.0).abs();
            let lag_deviation = (answer.lag - f64::from(lag)).abs();
            assert!(gain_deviation < exact, "{answer:?}");
            assert!(lag_deviation < 60.0 * exact, "{answer:?}");
        }
    }
}
