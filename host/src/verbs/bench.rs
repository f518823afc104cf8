//! `kband bench`: run time against error of every arithmetic of the impact map.

use crate::arguments::{self, FormatArguments};
use crate::bench::workload::WORKLOADS;
use crate::bench::{Errors, candidates, median_and_range};
use crate::desk::{Desk, Progress};
use crate::refusal::{Exit, Result};
use crate::report::fields;

/// Measure run time and error of every arithmetic of the impact map.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  kband bench
  kband bench --format json

All kernels take turns on one core. impact_time is the CPU time of an impact, the median of the \
rounds; impact_time_range is its interquartile range. The errors are those of the phase of the \
next impact against f64, whose own are 0. Workloads: high (velocities up to 20), low (up to 3), \
chatter (1e-6 to 1).")]
pub struct Arguments {
    /// Number of measurement rounds.
    #[arg(long, value_name = "N", default_value = "41", value_parser = arguments::count(1, 1000))]
    rounds: usize,
    /// Number of launches of each workload.
    #[arg(long, value_name = "N", default_value = "4096", value_parser = arguments::count(512, 1_000_000))]
    launches: usize,
    #[command(flatten)]
    printed: FormatArguments,
}

#[derive(Clone, Copy, Debug)]
struct Line {
    kernel: &'static str,
    workload: &'static str,
    /// Median and interquartile range of the rounds in ns.
    time: [f64; 2],
    errors: Errors,
}

fields! {
    fn times(line: Line) {
        all KERNEL => line.kernel;
        all WORKLOAD => line.workload;
        all IMPACT_TIME.digits(4) => line.time[0];
        all IMPACT_TIME_RANGE.digits(2) => line.time[1];
        all IMPACT_RATE.digits(3) => 1e9 / line.time[0];
        all MEDIAN_ERROR.digits(2) => line.errors.median;
        all P99_ERROR.digits(2) => line.errors.p99;
        all MAX_ERROR.digits(2) => line.errors.largest;
        all WRONG_ROOTS => line.errors.wrong_roots;
    }
}

pub fn run(arguments: &Arguments, desk: &Desk) -> Result<Exit> {
    let progress = Progress::new("bench", (WORKLOADS.len() * arguments.rounds) as u64);
    let mut lines = Vec::new();
    for (workload, launches) in WORKLOADS {
        let candidates = candidates(&launches(arguments.launches));
        let mut times = vec![Vec::new(); candidates.len()];
        for _ in 0..arguments.rounds {
            for (candidate, times) in candidates.iter().zip(&mut times) {
                desk.check_stop()?;
                // One untimed pass warms the caches.
                (candidate.pass)();
                times.push((candidate.pass)());
            }
            progress.advance(1);
        }
        let measured = candidates.iter().zip(times);
        lines.extend(measured.map(|(candidate, times)| Line {
            kernel: candidate.name,
            workload,
            time: median_and_range(times),
            errors: Errors::from_impacts(&candidate.impacts),
        }));
    }
    drop(progress);
    let report = times().printout(&lines);
    let report = report.heading("Run time against error, one core");
    report.print(arguments.printed.format)?;
    Ok(Exit::Done)
}
