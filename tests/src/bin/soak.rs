//! Random and adversarial launches against the oracle, for as long as asked: `soak [MILLIONS] [SEED]`.

use std::process::ExitCode;

use kband_tests::states::{Kind, Random};
use kband_tests::verdict::{Verdict, judge};

fn main() -> ExitCode {
    let mut arguments = std::env::args().skip(1);
    let mut number = |default: f64| {
        arguments
            .next()
            .map_or(Some(default), |text| text.parse::<f64>().ok())
    };
    let (Some(millions), Some(seed)) = (number(100.0), number(1.0)) else {
        eprintln!("soak: not a number; usage: soak [MILLIONS] [SEED]");
        return ExitCode::from(2);
    };
    let mut failed = 0_u64;
    for kind in Kind::ALL {
        let count = (millions * 1e6 / Kind::ALL.len() as f64) as u64;
        let mut random = Random::new(seed as u64);
        let (mut flagged, mut worst) = (0_u64, 0.0_f64);
        for _ in 0..count {
            let launch = kind.draw(&mut random);
            match judge(&launch) {
                Ok(Verdict::First(deviation)) => worst = worst.max(deviation),
                Ok(Verdict::Flagged) => flagged += 1,
                Ok(Verdict::Rests) => {}
                Err(cause) => {
                    failed += 1;
                    if failed <= 20 {
                        println!("{kind:?}: {cause}");
                    }
                }
            }
        }
        println!(
            "{kind:?}: {count} launches, {flagged} flagged as grazing, worst deviation {worst:.1} roundings"
        );
    }
    if failed > 0 {
        println!("{failed} wrong");
        return ExitCode::FAILURE;
    }
    println!("every impact is the first");
    ExitCode::SUCCESS
}
