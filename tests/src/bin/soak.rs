//! Random and adversarial launches in every arithmetic against the oracle, for as long as asked.

use std::process::ExitCode;
use std::sync::atomic::{AtomicU64, Ordering};

use kband_tests::soak::{Tally, replay, soak};
use kband_tests::states::{Kind, Launch};

const USAGE: &str = "usage: soak [MILLIONS [SEED]]
       soak --replay K RESTITUTION PHASE VELOCITY";

/// Wrong impacts that are printed.
const PRINTED: u64 = 40;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let numbers = |texts: &[String]| -> Option<Vec<f64>> {
        texts.iter().map(|text| text.parse().ok()).collect()
    };
    let (replayed, texts) = match arguments.split_first() {
        Some((first, rest)) if first == "--replay" => (true, rest),
        _ => (false, &arguments[..]),
    };
    match (replayed, numbers(texts).as_deref()) {
        (true, Some(&[k, restitution, phase, velocity])) => once(&Launch {
            k,
            restitution,
            phase,
            velocity,
        }),
        (false, Some([])) => run(100.0, 1),
        (false, Some(&[millions])) => run(millions, 1),
        (false, Some(&[millions, seed])) => run(millions, seed as u64),
        _ => {
            eprintln!("soak: {arguments:?} is not understood\n{USAGE}");
            ExitCode::from(2)
        }
    }
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

fn run(millions: f64, seed: u64) -> ExitCode {
    // A round has some of every kind, so that a soak that is cut short has tried them all.
    let rounds = (millions / 5.0).ceil().max(1.0);
    let count = (millions * 1e6 / (rounds * Kind::ALL.len() as f64)).ceil() as u64;
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let printed = AtomicU64::new(0);
    let begun = std::time::Instant::now();
    let mut tallies = Kind::ALL.map(|kind| (kind, Tally::default()));
    for round in 0..rounds as u64 {
        let seen = soak(count, seed << 16 | round, threads, |cause| {
            if printed.fetch_add(1, Ordering::Relaxed) < PRINTED {
                println!("{cause}");
            }
        });
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
        println!(
            "{wrong} of {launches} launches wrong; soak --replay K RESTITUTION PHASE VELOCITY repeats one"
        );
        return ExitCode::FAILURE;
    }
    println!(
        "every impact of {launches} launches of seed {seed} is the first, in every arithmetic ({:.0} s)",
        begun.elapsed().as_secs_f64()
    );
    ExitCode::SUCCESS
}
