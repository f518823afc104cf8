//! Days of simulated operation: `day [--days N] [--seed S] [--fidelity waveform|envelope]`.
//!
//! It fails on a fault without injection, a lock that does not return, an uncounted cycle, and any
//! drift.

use std::process::ExitCode;

use kband_host::simulate::Fidelity;
use kband_tests::day::operate;

/// Difference in rad between the mean errors of the phase in lock of two tenths of the time:
/// largest allowed.
const DRIFT: f64 = 0.01;
/// Time error in s: largest allowed. One sample for the place of a wrap, one for its detection.
const TIME_OFF: f64 = 2.01 / 20_000.0;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (mut days, mut seed, mut fidelity) = (1.0, 1, Fidelity::Waveform);
    for pair in arguments.chunks(2) {
        let understood = match pair {
            [option, value] if option == "--days" => value
                .parse()
                .ok()
                .filter(|given| (0.01..=10_000.0).contains(given))
                .map(|given| days = given),
            [option, value] if option == "--seed" => value.parse().ok().map(|given| seed = given),
            [option, value] if option == "--fidelity" => Fidelity::ALL
                .into_iter()
                .find(|known| known.name() == value)
                .map(|given| fidelity = given),
            _ => None,
        };
        if understood.is_none() {
            eprintln!(
                "day: {}; usage: day [--days 0.01..10000] [--seed S] [--fidelity waveform|envelope]",
                pair.join(" ")
            );
            return ExitCode::from(2);
        }
    }
    let shift = operate(86_400.0 * days, seed, fidelity);
    for (name, times) in &shift.happened {
        println!("{times:>6}  {name}");
    }
    let errors: Vec<f64> = (0..10).map(|tenth| shift.mean_error(tenth)).collect();
    println!(
        "{} cycles, {:.1} % of them in lock; error of the phase heard in each tenth {errors:.4?} rad",
        shift.cycles,
        100.0 * shift.locked as f64 / shift.cycles.max(1) as f64
    );
    let (low, high) = errors
        .iter()
        .fold((f64::MAX, f64::MIN), |(low, high), &phase| {
            (low.min(phase), high.max(phase))
        });
    let mut wrong = shift.wrong;
    if high - low > DRIFT {
        wrong.push(format!(
            "the error of the phase heard drifts by {:.3} rad",
            high - low
        ));
    }
    println!(
        "cycle {} at the end, time at most {:.0} us from what the phase makes of it",
        shift.last_cycle,
        shift.time_off * 1e6
    );
    if shift.time_off > TIME_OFF {
        wrong.push(format!("the time drifts by {} s", shift.time_off));
    }
    let times = |name| shift.happened.get(name).copied().unwrap_or(0);
    if times("lost sensor") != times("faulted") {
        wrong.push("a lost sensor was no fault".into());
    }
    for line in &wrong {
        println!("{line}");
    }
    if wrong.is_empty() {
        println!("no fault that was not injected, every lock came back");
        ExitCode::SUCCESS
    } else {
        ExitCode::FAILURE
    }
}
