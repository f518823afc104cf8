//! `kband settings commission --second-tone`, `--third-tone`: response of the track at twice or
//! three times the drive's frequency.
//!
//! The board adds a small tone to the output. The response is the ratio of the track's tone to the
//! output's, averaged over cycles: gain in mm at full output, lag in degrees.

use std::time::Duration;

use num_complex::Complex64 as Complex;

use kband_control::wire::{Request, Telemetry};
use kband_control::{Shape, Target, UpperTone};

use super::drive::{gather, why_off};
use super::offer::Commissioning;
use crate::board::Link;
use crate::desk::Desk;
use crate::refusal::Refusal;
use crate::report::{Column, Field, View, columns};

/// k of the trial: the track throws no part.
const TRIAL_K: f32 = 1.3;
/// Amplitude of the trial's tones over the first, if the drive affords as much.
const TRIAL_RATIO: f32 = 0.05;
/// Phases of the second and third tone in rad, as the map prefers them.
const TRIAL_PHASES: [f32; 2] = [2.356, 5.3];
/// Number of cycles over which the response is averaged.
const AVERAGED_CYCLES: usize = 50;
/// Delay in cycles from an output to its reading.
const OUTPUT_DELAY: usize = 2;
/// Number of cycles after which a tone has settled or was given up.
const SETTLING_CYCLES: usize = 300;

/// The measured tone above the first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Upper {
    /// That at twice the frequency.
    Second,
    /// That at three times it.
    Third,
}

impl Upper {
    /// Its name, the setting of its largest amplitude, and the settings of the track's response.
    fn names(self) -> (&'static str, &'static str, [&'static str; 2]) {
        match self {
            Self::Second => ("second tone", "second_tone", ["second_gain", "second_lag"]),
            Self::Third => ("third tone", "third_tone", ["third_gain", "third_lag"]),
        }
    }

    /// The output's tone in a cycle: cosine and sine part.
    fn output(self, telemetry: &Telemetry) -> [f32; 2] {
        let [second, third] = telemetry.overtones;
        match self {
            Self::Second => second,
            Self::Third => third,
        }
    }

    /// The track's tone in a cycle, relative to the output's phase, in m.
    fn seen(self, telemetry: &Telemetry) -> Complex {
        let (tone, times) = match self {
            Self::Second => (telemetry.shape.second, 2.0),
            Self::Third => (telemetry.shape.third, 3.0),
        };
        let size = f64::from(telemetry.amplitude) * f64::from(tone.ratio);
        let angle = f64::from(tone.phase) + times * f64::from(telemetry.lead);
        Complex::new(angle.cos(), angle.sin()) * size
    }
}

/// The track's response at a multiple of the frequency.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Answer {
    /// Track amplitude for full output in mm.
    gain: f64,
    /// Lag of the track in degrees.
    lag: f64,
    /// Standard deviation of a cycle's response, over the response.
    scatter: f64,
}

/// The response in the last cycles with the tone; `None` for too few.
fn answer(upper: Upper, cycles: &[Telemetry]) -> Option<Answer> {
    let pairs: Vec<(Complex, Complex)> = cycles
        .windows(OUTPUT_DELAY + 1)
        .filter_map(|window| {
            let (early, late) = (window.first()?, window.last()?);
            let output = upper.output(early).map(f64::from);
            let output = Complex::new(output[0], output[1]);
            (output.norm_sqr() > 1e-6).then_some((output, upper.seen(late)))
        })
        .collect();
    let last = pairs.get(pairs.len().checked_sub(AVERAGED_CYCLES)?..)?;
    let square: f64 = last.iter().map(|(output, _)| output.norm_sqr()).sum();
    let product: Complex = last.iter().map(|(output, seen)| seen * output.conj()).sum();
    let answer = product / square;
    let size = answer.norm_sqr().sqrt();
    let left: f64 = last
        .iter()
        .map(|(output, seen)| (seen - answer * output).norm_sqr())
        .sum();
    Some(Answer {
        gain: size * 1e3,
        lag: -answer.im.atan2(answer.re).to_degrees(),
        scatter: (left / square).sqrt() / size,
    })
}

/// Lets the board make a small tone above the first, and offers the track's response.
pub(super) fn run(upper: Upper, commissioning: &Commissioning<'_>) -> Result<(), Refusal> {
    let (mut link, settings) = commissioning.open()?;
    let (name, key, keys) = upper.names();
    let known = settings.known();
    let affords = match upper {
        Upper::Second => known.second_tone,
        Upper::Third => known.third_tone,
    };
    if affords <= 0.0 {
        return Err(Refusal::value(
            key,
            "0",
            "0.01..0.5",
            format!(
                "set the largest {name} that the drive affords first: kband settings set {key} {} --save",
                if upper == Upper::Second { 0.15 } else { 0.05 }
            ),
        ));
    }
    let [second, third] = TRIAL_PHASES.map(|phase| UpperTone {
        ratio: TRIAL_RATIO,
        phase,
    });
    let within_reach = |tone: UpperTone, most: f32| UpperTone {
        ratio: tone.ratio.min(most),
        ..tone
    };
    let shape = Shape {
        second: within_reach(second, known.second_tone),
        third: match upper {
            Upper::Second => UpperTone::default(),
            Upper::Third => within_reach(third, known.third_tone),
        },
    };
    let target = link.held()?;
    link.tell(&Request::Target(Target::Tones { k: TRIAL_K, shape }))?;
    let cycles = follow(upper, &mut link, commissioning.within, commissioning.desk);
    link.tell(&Request::Telemetry(0))?;
    link.tell(&Request::Target(target))?;
    let Some(found) = answer(upper, &cycles?) else {
        return Err(Refusal::new(
            format!("no {name} was made for {AVERAGED_CYCLES} cycles"),
            "kband monitor shows the limit; raise --within S",
        ));
    };
    let digits = |value: f64, scale: f64| ((value * scale).round() / scale) as f32;
    let (gain, lag) = (digits(found.gain, 1e4), digits(found.lag, 10.0));
    let [of_gain, of_lag] = keys;
    let notes = vec![
        format!("proposed: {of_gain} = {gain}, {of_lag} = {lag}"),
        "repeat the measurement with these values: the result is then more accurate".into(),
    ];
    let view = View::of(vec![
        Field::all(Column::of_key(of_gain, "mm").digits(4), |found: &Answer| {
            found.gain
        }),
        Field::all(
            Column::of_key(of_lag, "degrees").digits(4),
            |found: &Answer| found.lag,
        ),
        Field::all(
            columns::GAIN_SCATTER.titled("scatter").digits(2),
            |found: &Answer| found.scatter,
        ),
    ]);
    let offer = [(of_gain, gain), (of_lag, lag)];
    commissioning.conclude((link, settings), &offer, notes, view, found)
}

/// The cycles from now on, until the tone has settled or was given up.
fn follow(
    upper: Upper,
    link: &mut Link,
    within: Duration,
    desk: &Desk,
) -> Result<Vec<Telemetry>, Refusal> {
    if let Some(off) = why_off(link)? {
        return Err(off);
    }
    let made = |cycle: &&Telemetry| upper.output(cycle) != [0.0; 2];
    let enough = |cycles: &[Telemetry]| {
        let count = cycles.iter().filter(made).count();
        // An abandoned tone does not return.
        let silent = cycles.iter().rev().take_while(|cycle| !made(cycle)).count();
        count >= SETTLING_CYCLES || (count >= AVERAGED_CYCLES && silent > AVERAGED_CYCLES)
    };
    let (name, _, _) = upper.names();
    gather(
        link,
        desk,
        (name, SETTLING_CYCLES),
        within,
        Vec::push,
        enough,
    )
}

#[cfg(test)]
mod tests {
    use kband_control::Settings;
    use kband_plant::{EnvelopeLoop, Scene};

    use super::*;

    #[test]
    fn the_drive_response_is_measured_despite_wrong_settings() {
        let tone = |phase: f32| UpperTone {
            ratio: TRIAL_RATIO,
            phase,
        };
        let [second, third] = TRIAL_PHASES.map(tone);
        for (upper, gain, lag, told, exact) in [
            (Upper::Second, 0.5, 60.0, (0.5, 60.0), 0.02),
            (Upper::Second, 0.3, 120.0, (0.5, 90.0), 0.02),
            (Upper::Second, 0.05, 170.0, (0.5, 90.0), 0.15),
            (Upper::Third, 0.25, 60.0, (0.25, 60.0), 0.02),
            (Upper::Third, 0.2, 120.0, (0.25, 90.0), 0.02),
        ] {
            let mut scene = Scene {
                settings: Settings {
                    second_tone: 0.15,
                    ..Settings::default()
                },
                target: Target::Tones {
                    k: TRIAL_K,
                    shape: Shape::of_two(second),
                },
                ..Scene::default()
            };
            let settings = &mut scene.settings;
            match upper {
                Upper::Second => {
                    (settings.second_gain, settings.second_lag) = told;
                    (scene.drive.second_gain, scene.drive.second_lag) = (gain, lag);
                }
                Upper::Third => {
                    settings.third_tone = 0.06;
                    (settings.third_gain, settings.third_lag) = told;
                    scene.drive.second_gain = settings.second_gain;
                    scene.drive.second_lag = settings.second_lag;
                    (scene.drive.third_gain, scene.drive.third_lag) = (gain, lag);
                    scene.target = Target::Tones {
                        k: TRIAL_K,
                        shape: Shape { second, third },
                    };
                }
            }
            let mut closed = EnvelopeLoop::build(&scene).unwrap();
            let cycles: Vec<Telemetry> = (0..SETTLING_CYCLES)
                .map(|_| Telemetry::from(&closed.cycle().report))
                .collect();
            let found = answer(upper, &cycles).unwrap();
            assert!(
                (found.gain / f64::from(gain) - 1.0).abs() < exact,
                "{found:?}"
            );
            assert!(
                (found.lag - f64::from(lag)).abs() < 60.0 * exact,
                "{found:?}"
            );
        }
    }
}
