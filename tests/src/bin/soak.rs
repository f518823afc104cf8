//! Soak test: random and adversarial launches in every arithmetic against the oracle, for a
//! requested number.

use std::collections::HashMap;
use std::process::ExitCode;
use std::sync::{Mutex, PoisonError};

use kband::impact::Tone;
use kband_tests::oracle::Track;
use kband_tests::soak::{Tally, replay, soak};
use kband_tests::states::{Kind, Launch};

const USAGE: &str = "usage: soak [--tones] [--threads N] [MILLIONS [SEED]]
       soak --replay K RESTITUTION PHASE VELOCITY [E TH E3 TH3]";

/// Printed wrong impacts per kind: one cause can have thousands, another a single
/// one.
const PRINTED: u32 = 40;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let mut texts = arguments.as_slice();
    let (mut replayed, mut on_tones) = (false, false);
    let mut threads = std::thread::available_parallelism().map_or(1, usize::from);
    loop {
        texts = match texts {
            [first, rest @ ..] if first == "--replay" => {
                replayed = true;
                rest
            }
            [first, rest @ ..] if first == "--tones" => {
                on_tones = true;
                rest
            }
            [first, number, rest @ ..]
                if first == "--threads" && number.parse::<usize>().is_ok() =>
            {
                threads = number.parse().unwrap_or(1);
                rest
            }
            _ => break,
        };
    }
    let numbers: Option<Vec<f64>> = texts.iter().map(|text| text.parse().ok()).collect();
    let (millions, seed) = match (replayed, numbers.as_deref()) {
        (true, Some(&[k, restitution, phase, velocity])) => {
            return once(&Launch::new(k, restitution, phase, velocity));
        }
        (true, Some(&[k, restitution, phase, velocity, e, th, e3, th3])) => {
            return once(&Launch {
                track: Track::on(k, [Tone::new(e, th), Tone::new(e3, th3)]),
                restitution,
                phase,
                velocity,
            });
        }
        (false, Some([])) => (100.0, 1),
        (false, Some(&[millions])) => (millions, 1),
        (false, Some(&[millions, seed])) => (millions, seed as u64),
        _ => {
            eprintln!("soak: {arguments:?} is not understood\n{USAGE}");
            return ExitCode::from(2);
        }
    };
    run(millions, on_tones, seed, threads)
}

fn once(launch: &Launch) -> ExitCode {
    match replay(launch) {
        Ok(text) => {
            println!("{text}");
            ExitCode::SUCCESS
        }
        Err(text) => {
            println!("{text}");
            ExitCode::FAILURE
        }
    }
}

/// Prints the first wrong impacts of each kind, the first word of the message.
fn printer() -> impl Fn(&str) + Sync {
    let printed = Mutex::new(HashMap::<String, u32>::new());
    move |cause: &str| {
        let of = cause.split_whitespace().next().unwrap_or_default();
        let mut printed = printed.lock().unwrap_or_else(PoisonError::into_inner);
        let count = printed.entry(of.into()).or_default();
        *count += 1;
        if *count <= PRINTED {
            println!("{cause}");
        }
    }
}

fn run(millions: f64, on_tones: bool, seed: u64, threads: usize) -> ExitCode {
    // A round has some of every kind, so a soak that is cut short has tried them all.
    let rounds = (millions / 5.0).ceil().max(1.0) as u64;
    let count = (millions * 1e6 / (rounds as f64 * Kind::ALL.len() as f64)).ceil() as u64;
    let tell = printer();
    let begun = std::time::Instant::now();
    let mut tallies = Kind::ALL.map(|kind| (kind, Tally::default()));
    for round in 0..rounds {
        let seen = soak(count, on_tones, seed << 16 | round, threads, &tell);
        for ((_, total), (_, tally)) in tallies.iter_mut().zip(&seen) {
            total.add(tally);
        }
        let sum = |count: fn(&Tally) -> u64| -> u64 { tallies.iter().map(|(_, t)| count(t)).sum() };
        println!(
            "{} launches of seed {seed} in {:.0} s, {} wrong",
            sum(|tally| tally.launches),
            begun.elapsed().as_secs_f64(),
            sum(|tally| tally.wrong)
        );
    }
    let (mut launches, mut wrong) = (0, 0);
    for (kind, tally) in tallies {
        println!(
            "{kind:?}: {} launches, {} at rest, {} flagged as grazing, {} left open by the oracle, worst deviation {:.1} roundings, {} wrong",
            tally.launches, tally.rests, tally.flagged, tally.undecided, tally.worst, tally.wrong
        );
        launches += tally.launches;
        wrong += tally.wrong;
    }
    if wrong > 0 {
        println!("{wrong} of {launches} launches wrong; soak --replay repeats one");
        return ExitCode::FAILURE;
    }
    println!(
        "every impact of {launches} launches of seed {seed} is the first, in every arithmetic ({:.0} s)",
        begun.elapsed().as_secs_f64()
    );
    ExitCode::SUCCESS
}
