//! `kband bench`: run time against error of every arithmetic of the impact map.

use std::f64::consts::TAU;
use std::hint::black_box;
use std::time::Duration;

use kband::impact::{Integer, Kernel, Map, PartState, Single};

use crate::arguments::{self, FormatArguments};
use crate::desk::{Desk, Progress};
use crate::random::SplitMix;
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
    for (workload, velocity) in WORKLOADS {
        let candidates = candidates(&draw(arguments.launches, velocity));
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

#[derive(Clone, Copy, Debug)]
struct Launch {
    k: f64,
    restitution: f64,
    state: PartState,
}

type Workload = (&'static str, fn(f64) -> f64);

/// Every workload: its name, and the velocity of a launch from a random number of 0..1. Those of
/// chatter are log-uniform: hops on the way to rest.
const WORKLOADS: [Workload; 3] = [
    ("high", |part| 20.0 * part),
    ("low", |part| 3.0 * part),
    ("chatter", |part| 10_f64.powf(-6.0 * part)),
];

fn draw(count: usize, velocity: fn(f64) -> f64) -> Vec<Launch> {
    // Random order: a CPU would learn to predict the branches of an evenly spaced sequence.
    let mut random = SplitMix(1);
    let launch = || {
        let restitution = 0.5 + 0.49 * random.uniform();
        let k = 0.02 + 0.96 * random.uniform();
        let phase = TAU * random.uniform();
        let velocity = velocity(random.uniform());
        Some(Launch {
            k,
            restitution,
            state: PartState { phase, velocity },
        })
    };
    // A chatter with a closed form has no hops.
    let hops = |launch: &Launch| {
        let map = Map::build(launch.k, launch.restitution);
        map.is_ok_and(|map| map.time_to_rest(launch.state).is_none())
    };
    let launches = std::iter::from_fn(launch).filter(hops);
    launches.take(count).collect()
}

/// A launch as the kernel represents it; flight and phase of its impact in rad.
type ComputedImpact = (Launch, f64, f64);

struct Candidate {
    name: &'static str,
    /// Computes the impact of each launch once; returns the CPU time of an impact in ns.
    pass: Box<dyn Fn() -> f64>,
    impacts: Vec<ComputedImpact>,
}

fn candidates(launches: &[Launch]) -> [Candidate; 3] {
    [
        candidate::<Map>(launches),
        candidate::<Single>(launches),
        candidate::<Integer>(launches),
    ]
}

fn candidate<K: Kernel<State: 'static> + 'static>(launches: &[Launch]) -> Candidate {
    let (mut ready, mut impacts) = (Vec::new(), Vec::new());
    for launch in launches {
        let kernel = K::build(launch.k, launch.restitution);
        let state = K::state(launch.state.phase, launch.state.velocity);
        // Leaves out launches that the arithmetic cannot represent.
        let (Ok(kernel), Ok(state)) = (kernel, state) else {
            continue;
        };
        let held = Launch {
            state: K::observe(state),
            ..*launch
        };
        let impact = kernel.impact(state);
        impacts.push((held, impact.flight, K::observe(impact.next).phase));
        ready.push((kernel, state));
    }
    let pass = move || {
        let start = cpu_time();
        for (kernel, state) in &ready {
            // By reference, to avoid a copy of the result.
            black_box(&kernel.impact(*state));
        }
        cpu_time().saturating_sub(start).as_nanos() as f64 / ready.len() as f64
    };
    Candidate {
        name: K::NAME,
        pass: Box::new(pass),
        impacts,
    }
}

/// CPU time of this thread; wall-clock time on systems without it.
fn cpu_time() -> Duration {
    #[cfg(unix)]
    {
        let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
        Duration::new(time.tv_sec.unsigned_abs(), time.tv_nsec as u32)
    }
    #[cfg(not(unix))]
    std::time::UNIX_EPOCH.elapsed().unwrap_or_default()
}

/// Median and interquartile range of the times of all rounds.
fn median_and_range(mut rounds: Vec<f64>) -> [f64; 2] {
    rounds.sort_by(f64::total_cmp);
    let [low, median, high] = [0.25, 0.5, 0.75].map(|share| quantile(&rounds, share));
    [median, high - low]
}

/// Relative flight difference (rad, over 1 + flight) of another root; coarse errors are 3e-4.
const WRONG_ROOT_THRESHOLD: f64 = 1e-3;

/// Errors of the phase of the next impact in rad, over impacts with the right root.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Errors {
    median: f64,
    p99: f64,
    largest: f64,
    wrong_roots: u64,
}

impl Errors {
    /// Errors against f64. Grazing impacts are left out: rounding decides their first root.
    fn from_impacts(impacts: &[ComputedImpact]) -> Self {
        let (mut errors, mut wrong_roots) = (Vec::new(), 0);
        for (launch, flight, phase) in impacts {
            let Ok(map) = Map::build(launch.k, launch.restitution) else {
                continue;
            };
            let truth = map.impact(launch.state);
            if truth.grazes {
                continue;
            }
            // NaN counts as another root.
            if (flight - truth.flight).abs() <= WRONG_ROOT_THRESHOLD * (1.0 + truth.flight) {
                let turned = (phase - truth.next.phase).abs();
                errors.push(turned.min((TAU - turned).abs()));
            } else {
                wrong_roots += 1;
            }
        }
        errors.sort_by(f64::total_cmp);
        Self {
            median: quantile(&errors, 0.5),
            p99: quantile(&errors, 0.99),
            largest: quantile(&errors, 1.0),
            wrong_roots,
        }
    }
}

/// Quantile of sorted values; NaN without values.
fn quantile(sorted: &[f64], share: f64) -> f64 {
    let last = sorted.len().saturating_sub(1) as f64;
    let value = sorted.get((share * last).round() as usize);
    value.copied().unwrap_or(f64::NAN)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wrong_root_is_counted_and_a_wrong_phase_is_an_error() {
        let launches = draw(512, WORKLOADS[1].1);
        let mut impacts = candidate::<Map>(&launches).impacts;
        let exact = Errors::from_impacts(&impacts);
        assert_eq!((exact.largest, exact.wrong_roots), (0.0, 0));
        impacts[0].1 += 1.0;
        for (.., phase) in &mut impacts[1..] {
            *phase = (*phase + 1e-3).rem_euclid(TAU);
        }
        let errors = Errors::from_impacts(&impacts);
        assert_eq!(errors.wrong_roots, 1);
        assert!((errors.median - 1e-3).abs() < 1e-12, "{errors:?}");
    }

    #[test]
    fn every_kernel_finds_the_impacts_of_f64() {
        for (workload, velocity) in WORKLOADS {
            for Candidate { name, impacts, .. } in candidates(&draw(512, velocity)) {
                let errors = Errors::from_impacts(&impacts);
                let count = impacts.len();
                assert!(count >= 400, "{name}, {workload}: {count}");
                assert!(errors.median < 1e-4, "{name}: {errors:?}");
                assert!(errors.wrong_roots <= 1, "{name}: {errors:?}");
            }
        }
    }
}
