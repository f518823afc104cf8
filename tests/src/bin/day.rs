//! A day of simulated operation: `day [HOURS] [SEED]`; fails on a fault that was not injected, on a
//! lock that does not come back and on anything that drifts.

use std::process::ExitCode;

use kband_tests::day::operate;

/// Most that the mean error of the phase heard in lock may differ between two tenths of the time, in rad.
const DRIFT: f64 = 0.01;

fn main() -> ExitCode {
    let mut arguments = std::env::args().skip(1);
    let mut number = |default: f64| {
        arguments
            .next()
            .map_or(Some(default), |text| text.parse::<f64>().ok())
    };
    let (Some(hours), Some(seed)) = (number(24.0), number(1.0)) else {
        eprintln!("day: not a number; usage: day [HOURS] [SEED]");
        return ExitCode::from(2);
    };
    let shift = operate(3600.0 * hours, seed as u64);
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
