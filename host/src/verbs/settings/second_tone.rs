//! `kband settings commission --second-tone`: what the track answers at twice the drive's frequency, measured by the board.

use std::time::{Duration, Instant};

use num_complex::Complex64 as Complex;
use serde_json::json;

use kband::wire::{Request, SecondTone, Target, Telemetry};

use super::drive::why_off;
use super::offer::{Offer, print};
use crate::board::{Address, BoardSettings, Emulated, Link, Unasked};
use crate::desk::{Desk, Progress};
use crate::refusal::Refusal;
use crate::report::{Column, Format, Table};

/// k of the trial: the track throws no part.
const K: f32 = 1.3;
/// Second tone of the trial, where the drive affords as much.
const RATIO: f32 = 0.05;
/// Phase of it in rad: where the map wants it.
const PHASE: f32 = 2.356;
/// Cycles that the answer stands on.
const CYCLES: usize = 50;
/// Cycles from an output to the reading that shows it.
const LATE: usize = 2;
/// Cycles after which a second tone has settled, or was given up.
const SETTLED: usize = 300;
/// Time between two looks at what came.
const LOOK: Duration = Duration::from_millis(300);

/// The track's answer at twice the frequency.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Answer {
    /// Track amplitude for full output in mm.
    gain: f64,
    /// Lag of the track in degrees.
    lag: f64,
    /// Standard deviation of a cycle's answer, over the answer.
    scatter: f64,
}

/// The answer in the last cycles in which there was a second tone; `None` where they are too few.
fn answer(cycles: &[Telemetry]) -> Option<Answer> {
    let pairs: Vec<(Complex, Complex)> = cycles
        .windows(LATE + 1)
        .filter_map(|window| {
            let (told, seen) = (window.first()?, window.last()?);
            let output = told.overtone.map(f64::from);
            let output = Complex::new(output[0], output[1]);
            let size = f64::from(seen.amplitude) * f64::from(seen.second_ratio);
            let angle = f64::from(seen.second_phase) + 2.0 * f64::from(seen.lead);
            (output.norm_sqr() > 1e-6)
                .then_some((output, Complex::new(angle.cos(), angle.sin()) * size))
        })
        .collect();
    let last = pairs.get(pairs.len().checked_sub(CYCLES)?..)?;
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

/// Has the board make a small second tone and prints what the track answered; with `apply` the board takes and keeps it.
pub(super) fn run(
    address: &Address,
    apply: bool,
    within: f64,
    format: Format,
    desk: &Desk,
) -> Result<(), Refusal> {
    let mut link = address.open(Emulated::Running)?;
    let mut settings = BoardSettings::read(&mut link)?;
    let affords = settings.known().second_tone;
    if affords <= 0.0 {
        return Err(Refusal::value(
            "second_tone",
            "0",
            "0.01..0.5",
            "set the largest second tone that the drive affords first: kband settings set second_tone 0.15 --save",
        ));
    }
    let second = SecondTone {
        ratio: RATIO.min(affords),
        phase: PHASE,
    };
    let held = link.held()?;
    link.tell(&Request::Target(Target::Tones(K, second)))?;
    let cycles = follow(&mut link, Duration::from_secs_f64(within), desk);
    link.tell(&Request::Telemetry(0))?;
    link.tell(&Request::Target(held))?;
    let Some(found) = answer(&cycles?) else {
        return Err(Refusal::new(
            format!("no second tone was made for {CYCLES} cycles"),
            "see with kband monitor what holds the drive back; give it longer with --within S",
        ));
    };
    let digits = |value: f64, scale: f64| ((value * scale).round() / scale) as f32;
    let (gain, lag) = (digits(found.gain, 1e4), digits(found.lag, 10.0));
    let mut notes = vec![
        format!("offered: second_gain = {gain}, second_lag = {lag}"),
        "measured anew with these it is more exact: what was told before is the beginning".into(),
    ];
    let offer = Offer {
        keys: ["second_gain", "second_lag"],
        values: [gain, lag],
    };
    notes.extend(offer.conclude(&mut link, &mut settings, address, apply)?);
    let mut table = Table::new(&[
        Column::new("second_gain", "mm").digits(4),
        Column::new("second_lag", "degrees").digits(4),
        Column::new("scatter", "%").digits(2),
    ]);
    table.push([
        found.gain.into(),
        found.lag.into(),
        (found.scatter * 100.0).into(),
    ]);
    let document = json!({
        "second_gain": found.gain,
        "second_lag": found.lag,
        "scatter": found.scatter,
        "applied": apply,
    });
    print(table, &notes, &document, format)
}

/// The cycles from now on, until the second tone has settled or was given up.
fn follow(link: &mut Link, within: Duration, desk: &Desk) -> Result<Vec<Telemetry>, Refusal> {
    let progress = Progress::new("second tone", SETTLED as u64);
    let begun = Instant::now();
    let mut cycles: Vec<Telemetry> = Vec::new();
    let made = |cycle: &&Telemetry| cycle.overtone != [0.0; 2];
    if let Some(off) = why_off(link)? {
        return Err(off);
    }
    link.tell(&Request::Telemetry(1))?;
    while begun.elapsed() < within {
        desk.go_on()?;
        let before = cycles.len();
        for said in link.listen(LOOK)? {
            if let Unasked::Telemetry(telemetry) = said {
                cycles.push(telemetry);
            }
        }
        progress.advance((cycles.len() - before) as u64);
        let count = cycles.iter().filter(made).count();
        // A second tone that was given up comes no more.
        let silent = cycles.iter().rev().take_while(|cycle| !made(cycle)).count();
        if count >= SETTLED || (count >= CYCLES && silent > CYCLES) {
            break;
        }
        link.tell(&Request::Alive)?;
    }
    progress.finish();
    Ok(cycles)
}

#[cfg(test)]
mod tests {
    use kband::control::{self, Settings};
    use kband::plant::{EnvelopeLoop, Scene};

    use super::*;

    #[test]
    fn the_answer_of_a_drive_is_measured_also_where_it_was_told_wrong() {
        for (gain, lag, told, exact) in [
            (0.5, 60.0, (0.5, 60.0), 0.02),
            (0.3, 120.0, (0.5, 90.0), 0.02),
            (0.05, 170.0, (0.5, 90.0), 0.15),
        ] {
            let mut scene = Scene {
                settings: Settings {
                    second_tone: 0.15,
                    second_gain: told.0,
                    second_lag: told.1,
                    ..Settings::default()
                },
                target: control::Target::Tones {
                    k: K,
                    second: control::SecondTone {
                        ratio: RATIO,
                        phase: PHASE,
                    },
                },
                ..Scene::default()
            };
            (scene.drive.second_gain, scene.drive.second_lag) = (gain, lag);
            let mut closed = EnvelopeLoop::build(&scene).unwrap();
            let cycles: Vec<Telemetry> = (0..SETTLED)
                .map(|_| Telemetry::from(&closed.cycle().report))
                .collect();
            let found = answer(&cycles).unwrap();
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
