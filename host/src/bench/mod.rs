//! Run time against error of the impact map, in each arithmetic. The kernels alternate; times are
//! CPU times of the thread. Errors are relative to f64.

pub mod workload;

use std::f64::consts::TAU;
use std::hint::black_box;
use std::time::Duration;

use kband::impact::{Integer, Kernel, Map, Single};
use workload::Launch;

/// Relative flight difference (rad, over 1 + flight) of another root; coarse errors are 3e-4.
const WRONG_ROOT_THRESHOLD: f64 = 1e-3;

/// A launch as the kernel represents it; flight and phase of its impact in rad.
pub type ComputedImpact = (Launch, f64, f64);

pub struct Candidate {
    pub name: &'static str,
    /// Computes the impact of each launch once; returns the CPU time of an impact in ns.
    pub pass: Box<dyn Fn() -> f64>,
    pub impacts: Vec<ComputedImpact>,
}

pub fn candidates(launches: &[Launch]) -> [Candidate; 3] {
    [
        candidate::<Map>(launches),
        candidate::<Single>(launches),
        candidate::<Integer>(launches),
    ]
}

fn candidate<K: Kernel<State: 'static> + 'static>(launches: &[Launch]) -> Candidate {
    // Leaves out launches that the arithmetic cannot represent.
    let ready = |launch: &Launch| {
        let kernel = K::build(launch.k, launch.restitution).ok()?;
        let state = K::state(launch.state.phase, launch.state.velocity).ok()?;
        Some((kernel, state, *launch))
    };
    let ready: Vec<(K, K::State, Launch)> = launches.iter().filter_map(ready).collect();
    let computed = |(kernel, state, launch): &(K, K::State, Launch)| {
        let held = Launch {
            state: K::observe(*state),
            ..*launch
        };
        let impact = kernel.impact(*state);
        (held, impact.flight, K::observe(impact.next).phase)
    };
    let impacts = ready.iter().map(computed).collect();
    let pass = move || {
        let start = cpu_time();
        for (kernel, state, _) in &ready {
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
pub fn median_and_range(mut rounds: Vec<f64>) -> [f64; 2] {
    rounds.sort_by(f64::total_cmp);
    let [low, median, high] = [0.25, 0.5, 0.75].map(|share| quantile(&rounds, share));
    [median, high - low]
}

/// Errors of the phase of the next impact in rad, over impacts with the right root.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Errors {
    pub median: f64,
    pub p99: f64,
    pub largest: f64,
    pub wrong_roots: u64,
}

impl Errors {
    /// Errors against f64. Grazing impacts are left out: rounding decides their first root.
    pub fn from_impacts(impacts: &[ComputedImpact]) -> Self {
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
    use super::workload::WORKLOADS;
    use super::*;

    #[test]
    fn a_wrong_root_is_counted_and_a_wrong_phase_is_an_error() {
        let launches = WORKLOADS[1].1(512);
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
        for (workload, launches) in WORKLOADS {
            for Candidate { name, impacts, .. } in candidates(&launches(512)) {
                let errors = Errors::from_impacts(&impacts);
                let count = impacts.len();
                assert!(count >= 400, "{name}, {workload}: {count}");
                assert!(errors.median < 1e-4, "{name}: {errors:?}");
                assert!(errors.wrong_roots <= 1, "{name}: {errors:?}");
            }
        }
    }
}
