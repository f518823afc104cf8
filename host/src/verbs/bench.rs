//! `kband bench`: run time against error of every arithmetic of the impact map.

use crate::arguments::{self, OutputArguments};
use crate::bench::workload::{WORKLOADS, Workload};
use crate::bench::{Errors, Time, candidates};
use crate::desk::{Desk, Progress};
use crate::picture::{Axis, Panel, Picture};
use crate::refusal::{Exit, Result};
use crate::report::{fields, number, numbers};

/// Measure run time and error of every arithmetic of the impact map.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  kband bench
  kband bench --format json
  kband bench --out time-against-error.svg

All kernels take turns on one core. impact_time is the CPU time of an impact, the median of the \
rounds; impact_time_range is its interquartile range. The errors are those of the phase of the \
next impact against f64, whose own are 0. Workloads: high (velocities up to 20), low (up to 3), \
chatter (1e-6 to 1), sweep (orbits over k and restitution). batch runs in the widest registers of \
this CPU.")]
pub struct Arguments {
    /// Number of measurement rounds.
    #[arg(long, value_name = "N", default_value = "41", value_parser = arguments::count(1, 1000))]
    rounds: usize,
    /// Number of launches of each workload.
    #[arg(long, value_name = "N", default_value = "4096", value_parser = arguments::count(512, 1_000_000))]
    launches: usize,
    #[command(flatten)]
    output: OutputArguments,
}

/// Interquartile range over median above which a time is marked as doubtful.
const DOUBTFUL_SCATTER: f64 = 0.1;

#[derive(Clone, Copy, Debug)]
struct Line {
    kernel: &'static str,
    workload: &'static str,
    time: Time,
    errors: Errors,
}

fields! {
    fn times(line: Line) {
        all KERNEL => line.kernel;
        all WORKLOAD => line.workload;
        all IMPACT_TIME.digits(4) => line.time.median;
        all IMPACT_TIME_RANGE.digits(2) => line.time.range;
        all IMPACT_RATE.digits(3) => 1e9 / line.time.median;
        all MEDIAN_ERROR.digits(2) => line.errors.median;
        all P99_ERROR.digits(2) => line.errors.p99;
        all MAX_ERROR.digits(2) => line.errors.largest;
        all WRONG_ROOTS => line.errors.wrong_roots;
    }
}

pub fn run(arguments: &Arguments, desk: &Desk) -> Result<Exit> {
    let output = arguments.output.check()?;
    let progress = Progress::new("bench", (WORKLOADS.len() * arguments.rounds) as u64);
    let mut lines = Vec::new();
    for workload in WORKLOADS {
        lines.extend(measure(workload, arguments, desk, &progress)?);
    }
    drop(progress);
    let report = times().printout(&lines);
    let mut report = report.heading("Run time against error, one core");
    for (workload, _) in WORKLOADS {
        let time = |kernel: &str| {
            let mut own = lines.iter().filter(|line| line.workload == workload);
            let line = own.find(|line| line.kernel == kernel);
            line.map_or(f64::NAN, |line| line.time.median)
        };
        let [ratio, rate] = numbers([time("textbook") / time("f64"), 1e3 / time("batch")], 3);
        report = report.note(format!(
            "{workload}: f64 is {ratio} times as fast as the textbook, batch makes {rate} million impacts a second"
        ));
    }
    if let Some(warning) = scatter_warning(&lines) {
        eprintln!("{warning}");
    }
    output.show(&report, || picture(&lines))
}

/// Each contestant once in a round.
fn measure(
    (workload, launches): Workload,
    arguments: &Arguments,
    desk: &Desk,
    progress: &Progress,
) -> Result<Vec<Line>> {
    let mut candidates = candidates(&launches(arguments.launches));
    let mut times = vec![Vec::new(); candidates.len()];
    for _ in 0..arguments.rounds {
        for (candidate, times) in candidates.iter_mut().zip(&mut times) {
            desk.check_stop()?;
            // One untimed pass warms caches and wide registers.
            candidate.pass();
            times.push(candidate.pass());
        }
        progress.advance(1);
    }
    let lines = candidates.iter_mut().zip(times);
    let lines = lines.map(|(candidate, times)| Line {
        kernel: candidate.name(),
        workload,
        time: Time::from_rounds(times),
        errors: Errors::from_impacts(&candidate.impacts()),
    });
    Ok(lines.collect())
}

fn scatter_warning(lines: &[Line]) -> Option<String> {
    let scatter = |line: &&Line| line.time.range / line.time.median;
    let lines = lines.iter();
    let worst = lines.max_by(|a, b| scatter(a).total_cmp(&scatter(b)))?;
    let (scatter, kernel, workload) = (scatter(&worst), worst.kernel, worst.workload);
    (scatter > DOUBTFUL_SCATTER).then(|| {
        let (percent, limit) = (number(100.0 * scatter, 2), 100.0 * DOUBTFUL_SCATTER);
        format!(
            "warning: the times are doubtful: the interquartile range is {percent} % of the median for {kernel} on {workload}, \
             more than {limit} %\n  next: close other programs and run again"
        )
    })
}

/// Error over time in decades; a line joins the kernels that no other exceeds in both.
fn picture(lines: &[Line]) -> Picture {
    // Errors of 0 are drawn at this level.
    const MIN_DRAWN_ERROR: f64 = 1e-18;
    let place = |line: &Line| (line.time.median, line.errors.median.max(MIN_DRAWN_ERROR));
    let (mut fastest, mut slowest, mut coarsest) = (f64::INFINITY, 0.0_f64, MIN_DRAWN_ERROR);
    for (time, error) in lines.iter().map(place) {
        (fastest, slowest) = (fastest.min(time), slowest.max(time));
        coarsest = coarsest.max(error);
    }
    let panel = |workload: &str, heading: &str| {
        let time = Axis::new("Time of one impact", "ns", 0.5 * fastest, 2.0 * slowest);
        let ends = (0.1 * MIN_DRAWN_ERROR, 10.0 * coarsest);
        let error = Axis::new("Median error of its phase", "rad", ends.0, ends.1);
        let own = || lines.iter().filter(move |line| line.workload == workload);
        let mut points: Vec<(f64, f64)> = own().map(place).collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut front: Vec<(f64, f64)> = Vec::new();
        for point in points {
            let best = front.last().copied();
            if best.is_none_or(|best| point.1 < best.1) {
                front.extend(best.map(|best| (point.0, best.1)));
                front.push(point);
            }
        }
        let mut panel = Panel::new(time.logarithmic(), error.logarithmic())
            .heading(heading)
            .height(300.0)
            .line("front", 6, front);
        for (n, line) in own().enumerate() {
            panel = panel.markers(line.kernel, n, vec![place(line)]);
        }
        panel
    };
    Picture::new("Run time against error of the impact map")
        .caption("Down and to the left is better; the line joins what nothing beats in both. f64 is what the others are compared with")
        .panel(panel("high", "Velocities up to 20"))
        .panel(panel("low", "Velocities up to 3"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_warning_names_the_kernel_whose_time_scatters() {
        let line = |kernel, range| Line {
            kernel,
            workload: "low",
            time: Time {
                median: 50.0,
                range,
            },
            errors: Errors::from_impacts(&[]),
        };
        assert_eq!(scatter_warning(&[line("f64", 4.9)]), None);
        let warning = scatter_warning(&[line("f64", 4.9), line("f32", 6.0)]).unwrap();
        assert!(warning.contains("12 % of the median for f32 on low"));
    }
}
