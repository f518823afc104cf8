//! Run time against error of the impact map, in each arithmetic and by a baseline. The kernels
//! alternate; times are CPU times of the thread. Errors are relative to f64.

pub mod baseline;
pub mod workload;

use std::f64::consts::TAU;
use std::hint::black_box;
use std::time::Duration;

use baseline::Textbook;
use kband::impact::batch::{Block, LANES};
use kband::impact::{Integer, Kernel, Map, Single};
use workload::Launch;

/// Relative flight difference (rad, over 1 + flight) of another root; coarse errors are 3e-4.
const WRONG_ROOT_THRESHOLD: f64 = 1e-3;

/// A launch as the kernel represents it; flight and phase of its impact in rad.
pub type ComputedImpact = (Launch, f64, f64);

pub trait Candidate {
    fn name(&self) -> &'static str;
    /// Computes the impact of each launch once; returns the CPU time of an impact in ns.
    fn pass(&mut self) -> f64;
    fn impacts(&mut self) -> Vec<ComputedImpact>;
}

pub fn candidates(launches: &[Launch]) -> Vec<Box<dyn Candidate>> {
    vec![
        Box::new(Kernels::<Textbook>::new(launches)),
        Box::new(Kernels::<Map>::new(launches)),
        Box::new(Blocks {
            blocks: vec![Block::new(); launches.len().div_ceil(LANES)],
            lanes: Kernels::new(launches),
        }),
        Box::new(Kernels::<Single>::new(launches)),
        Box::new(Kernels::<Integer>::new(launches)),
    ]
}

/// CPU time of this thread; wall-clock time on systems without it.
pub fn cpu_time() -> Duration {
    #[cfg(unix)]
    {
        let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
        Duration::new(time.tv_sec.unsigned_abs(), time.tv_nsec as u32)
    }
    #[cfg(not(unix))]
    std::time::UNIX_EPOCH.elapsed().unwrap_or_default()
}

fn nanoseconds_since(start: Duration) -> f64 {
    cpu_time().saturating_sub(start).as_nanos() as f64
}

struct Kernels<K: Kernel> {
    ready: Vec<(K, K::State, Launch)>,
}

impl<K: Kernel> Kernels<K> {
    fn new(launches: &[Launch]) -> Self {
        // Leaves out launches that the arithmetic cannot represent.
        let ready = |launch: &Launch| {
            let kernel = K::build(launch.k, launch.restitution).ok()?;
            let state = K::state(launch.state.phase, launch.state.velocity).ok()?;
            let held = Launch {
                state: K::observe(state),
                ..*launch
            };
            Some((kernel, state, held))
        };
        Self {
            ready: launches.iter().filter_map(ready).collect(),
        }
    }
}

impl<K: Kernel> Candidate for Kernels<K> {
    fn name(&self) -> &'static str {
        K::NAME
    }

    fn pass(&mut self) -> f64 {
        let start = cpu_time();
        for (kernel, state, _) in &self.ready {
            // By reference, to avoid a copy of the result.
            black_box(&kernel.impact(*state));
        }
        nanoseconds_since(start) / self.ready.len() as f64
    }

    fn impacts(&mut self) -> Vec<ComputedImpact> {
        let computed = |(kernel, state, launch): &(K, K::State, Launch)| {
            let impact = kernel.impact(*state);
            (*launch, impact.flight, K::observe(impact.next).phase)
        };
        self.ready.iter().map(computed).collect()
    }
}

/// The batch kernel in the widest registers of this CPU, one impact of each launch.
struct Blocks {
    blocks: Vec<Block>,
    lanes: Kernels<Map>,
}

impl Candidate for Blocks {
    fn name(&self) -> &'static str {
        "batch"
    }

    fn pass(&mut self) -> f64 {
        let lanes = self.lanes.ready.chunks(LANES);
        for (block, lanes) in self.blocks.iter_mut().zip(lanes) {
            for (lane, (map, state, _)) in lanes.iter().enumerate() {
                // A chunk has at most as many launches as lanes.
                let _ = block.put(lane, map, *state);
            }
            // Sorts the lanes.
            block.advance(0);
        }
        let start = cpu_time();
        for block in &mut self.blocks {
            block.advance(1);
        }
        nanoseconds_since(start) / self.lanes.ready.len() as f64
    }

    fn impacts(&mut self) -> Vec<ComputedImpact> {
        self.pass();
        let computed = |(n, (.., launch)): (usize, &(_, _, Launch))| {
            let impact = self.blocks[n / LANES].impact(n % LANES)?;
            Some((*launch, impact.flight, impact.next.phase))
        };
        let ready = self.lanes.ready.iter().enumerate();
        ready.filter_map(computed).collect()
    }
}

/// Run time of an impact over the rounds, in ns of CPU time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Time {
    pub median: f64,
    pub range: f64,
}

impl Time {
    /// Median and interquartile range of the rounds.
    pub fn from_rounds(mut rounds: Vec<f64>) -> Self {
        rounds.sort_by(f64::total_cmp);
        Self {
            median: quantile(&rounds, 0.5),
            range: quantile(&rounds, 0.75) - quantile(&rounds, 0.25),
        }
    }
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
    fn one_slow_round_moves_neither_median_nor_range() {
        let rounds: Vec<f64> = (0..21).map(f64::from).collect();
        let time = Time::from_rounds(rounds.clone());
        assert_eq!((time.median, time.range), (10.0, 10.0));
        let mut slow = rounds;
        slow[20] = 1e6;
        assert_eq!(Time::from_rounds(slow), time);
    }

    #[test]
    fn a_wrong_root_is_counted_and_a_wrong_phase_is_an_error() {
        let launches = WORKLOADS[1].1(512);
        let mut impacts = Kernels::<Map>::new(&launches).impacts();
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
    fn every_contestant_finds_the_impacts_of_f64() {
        for (workload, launches) in WORKLOADS {
            for mut candidate in candidates(&launches(512)) {
                let impacts = candidate.impacts();
                let errors = Errors::from_impacts(&impacts);
                let (name, count) = (candidate.name(), impacts.len());
                assert!(count >= 400, "{name}, {workload}: {count}");
                assert!(errors.median < 1e-4, "{name}: {errors:?}");
                assert!(errors.wrong_roots <= 1, "{name}: {errors:?}");
                assert!(name != "batch" || errors.largest == 0.0, "{errors:?}");
            }
        }
    }
}
